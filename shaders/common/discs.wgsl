// Splats as discs, and where rays meet them. Twin: crates/trace/src/accel/disc.rs. The shader that
// includes this declares `discs`, two `vec4<f32>` each: centre and radius; then, as bits, the code
// of the normal, and albedo and emitter as four numbers of 16 bits.

// include common/normal.wgsl

struct Ray {
    origin: vec3<f32>,
    // Greatest distance of a hit.
    reach: f32,
    // Unit length.
    direction: vec3<f32>,
}

// Normal of a disc; zero if it has none.
fn stored_normal(disc: u32) -> vec3<f32> {
    return normal_of(bitcast<u32>(discs[2u * disc + 1u].x));
}

// Distance at which a ray meets a disc, and the weight of the disc there, from 1 at its centre to 0
// at its rim; 0 if the ray misses it. A disc without a normal faces the ray.
fn meet(disc: u32, ray: Ray) -> vec2<f32> {
    let place = discs[2u * disc];
    let own = stored_normal(disc);
    let normal = select(own, ray.direction, all(own == vec3<f32>(0.0)));
    let towards = place.xyz - ray.origin;
    let distance = dot(normal, towards) / dot(normal, ray.direction);
    let off = ray.direction * distance - towards;
    let share = dot(off, off) / (place.w * place.w);
    if distance > 0.0 && share < 1.0 {
        return vec2<f32>(distance, 1.0 - share);
    }
    return vec2<f32>(0.0);
}

// Albedo of a disc.
fn albedo_of(disc: u32) -> vec3<f32> {
    let bits = bitcast<vec2<u32>>(discs[2u * disc + 1u].yz);
    return vec3<f32>(vec3<u32>(bits.x & 0xffffu, bits.x >> 16u, bits.y & 0xffffu)) / 65535.0;
}
