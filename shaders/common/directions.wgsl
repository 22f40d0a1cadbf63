// Directions about a normal. Twin: crates/trace/src/paths/directions.rs.

const QUARTER_PI: f32 = 0.7853982;

// Sine and cosine for angles within a quarter of pi, by Taylor polynomials, so that all drivers
// give the same values.
fn sine_cosine(x: f32) -> vec2<f32> {
    let s = x * x;
    let sine = x
        * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s / 362880.0))));
    let cosine = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s / 40320.0)));
    return vec2<f32>(sine, cosine);
}

// Point of the unit disc by the concentric map.
fn disc_point(u: vec2<f32>) -> vec2<f32> {
    let p = 2.0 * u - 1.0;
    if p.x == 0.0 && p.y == 0.0 {
        return vec2<f32>(0.0);
    }
    if abs(p.x) > abs(p.y) {
        return p.x * sine_cosine(QUARTER_PI * (p.y / p.x)).yx;
    }
    return p.y * sine_cosine(QUARTER_PI * (p.x / p.y));
}

// Direction about a unit normal with the density cosine over pi (frame: `duff2017`).
fn cosine_direction(n: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let p = disc_point(u);
    let side = select(1.0, -1.0, (bitcast<u32>(n.z) >> 31u) == 1u);
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    let x = vec3<f32>(1.0 + side * n.x * n.x * a, side * b, -side * n.x);
    let y = vec3<f32>(b, side + n.y * n.y * a, -n.y);
    let z = sqrt(max(1.0 - p.x * p.x - p.y * p.y, 0.0));
    return unit_or(x * p.x + y * p.y + n * z, n);
}
