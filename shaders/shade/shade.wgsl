// Shade (marroquim2007, section 3.4): deferred Phong lighting of the filled picture, with
// interpolated normals, or with normals from the smoothed depth image; pixels behind their
// surroundings are darkened (boucheny2009). Twins: crates/render/src/passes/shade.rs,
// smooth_depth.rs.

// include common/frame.wgsl
// include common/radii.wgsl
// include common/smoothing.wgsl
// include common/unit.wgsl
// include common/srgb.wgsl
// include common/backdrop.wgsl
// include common/phong.wgsl

// Whether pixels carry normals.
override NORMALS: bool;
// Whether surfaces have highlights, which need the direction to the eye.
override SHINES: bool = true;
// Whether pixels with a normal are darkened behind edges.
override EDGES: bool = true;

// Exponent of the greatest darkening, and the slope up to which nothing is darkened; with normals
// (EDGE) and without (DOME).
const EDGE: vec2<f32> = vec2<f32>(1.0, 4.0);
const DOME: vec2<f32> = vec2<f32>(2.0, 0.5);
// Distance of the surroundings that a pixel is compared with, pixels.
const REACH: i32 = 2;
// Slope above which darkening grows no more.
const BEHIND_MAX: f32 = 4.0;

@group(0) @binding(0) var<uniform> frame: Frame;
// Mean radii of discs, without normals.
@group(0) @binding(1) var<storage, read> radii: array<f32>;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> normals: array<vec4<f32>>;
// Normals of the next coarser level.
@group(0) @binding(5) var<storage, read> coarse_normals: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> sources: array<u32>;
// sRGB bytes.
@group(0) @binding(7) var<storage, read_write> shaded: array<u32>;

// include common/source.wgsl

// Depth at a pixel; infinite outside of the picture.
fn depth_at(at: vec2<i32>) -> f32 {
    if any(at < vec2<i32>(0)) || any(at >= vec2<i32>(i32(frame.width), i32(frame.height))) {
        return infinity();
    }
    return depth[u32(at.y) * frame.width + u32(at.x)];
}

// Change of depth a pixel, from the changes on both sides: their mean, or that of the only side
// that is on the surface.
fn slope(before: f32, after: f32, limit: f32) -> f32 {
    let is_before = abs(before) < limit;
    let is_after = abs(after) < limit;
    if is_before && is_after {
        return (before + after) * 0.5;
    }
    if is_before {
        return before;
    }
    if is_after {
        return after;
    }
    // Between two steps, as at a silhouette: as steep as possible, towards the nearer side.
    let nearer = select(after, before, abs(before) < abs(after));
    return select(clamp(nearer, -limit, limit), 0.0, is_infinite(nearer));
}

// The normal in view space from the differences of the depth image.
fn depth_normal(at: vec2<i32>, here: f32, from_centre: vec2<f32>) -> vec3<f32> {
    let limit = near_share(1.0, radius_around(vec2<u32>(at))) * here;
    let right = vec2<i32>(1, 0);
    let down = vec2<i32>(0, 1);
    let du = slope(here - depth_at(at - right), depth_at(at + right) - here, limit);
    let dv = slope(here - depth_at(at + down), depth_at(at - down) - here, limit);
    let towards = (here + from_centre.x * du + from_centre.y * dv) / frame.focal_px;
    return unit_or(vec3<f32>(du, dv, towards), vec3<f32>(0.0, 0.0, 1.0));
}

// Darkening of a pixel at depth `here` by surroundings at `depth`, 0 to BEHIND_MAX.
fn dark(here: f32, depth: f32, flat_slope: f32) -> f32 {
    let per_slope = frame.focal_px / (here * f32(REACH));
    if is_infinite(depth) {
        return 0.0;
    }
    return clamp((here - depth) * per_slope - flat_slope, 0.0, BEHIND_MAX);
}

// How far a pixel is behind its surroundings, 0 to 1.
fn behind(at: vec2<i32>, here: f32) -> f32 {
    var sum = 0.0;
    for (var y = -REACH; y <= REACH; y += REACH) {
        for (var x = -REACH; x <= REACH; x += REACH) {
            if x != 0 || y != 0 {
                sum += dark(here, depth_at(at + vec2<i32>(x, y)), DOME.y);
            }
        }
    }
    return sum / (8.0 * BEHIND_MAX);
}

// How far a pixel is behind the mean of both sides, 0 to 1, so that plain slopes are not darkened.
fn sunken(at: vec2<i32>, here: f32) -> f32 {
    var sum = 0.0;
    for (var k = 0; k < 4; k++) {
        // Along the row, the two diagonals, the column.
        let side = select(vec2<i32>(k - 2, 1), vec2<i32>(1, 0), k == 0) * REACH;
        sum += dark(here, (depth_at(at - side) + depth_at(at + side)) * 0.5, EDGE.y);
    }
    return sum / (4.0 * BEHIND_MAX);
}

// The interpolated normal, or that of the surroundings if the pixel has none; zero without any.
fn carried_normal(at: vec2<u32>, pixel: u32) -> vec3<f32> {
    let own = normals[source_of(pixel)].xyz;
    if has_direction(own) {
        return unit_or(own, vec3<f32>(0.0));
    }
    let above = (at.y >> 1u) * ((frame.width + 1u) >> 1u) + (at.x >> 1u);
    return unit_or(coarse_normals[above].xyz, vec3<f32>(0.0));
}

// Approximates exp(-x) for x from 0.
fn darken(x: f32) -> f32 {
    return 1.0 / (1.0 + x * (1.0 + x * 0.5));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let here = depth[pixel];
    if is_infinite(here) {
        let top = frame.background_top;
        let bottom = frame.background_bottom;
        shaded[pixel] = backdrop(top, bottom, backdrop_row(id.y), frame.backdrop_rows);
        return;
    }
    let at = vec2<i32>(id.xy);
    let from_centre = (vec2<f32>(id.xy) + 0.5 - frame.centre_px) * vec2<f32>(1.0, -1.0);
    // Without highlights the light at the eye comes along the axis.
    var to_eye = vec3<f32>(0.0, 0.0, 1.0);
    if SHINES {
        to_eye = unit_or(vec3<f32>(-from_centre, frame.focal_px), to_eye);
    }
    var normal = to_eye;
    var darkness = 0.0;
    if NORMALS {
        let carried = carried_normal(id.xy, pixel);
        if all(carried == vec3<f32>(0.0)) {
            // Depth alone shows the shape of what has no normal.
            darkness = DOME.x * behind(at, here);
        } else {
            normal = carried;
            if EDGES {
                darkness = EDGE.x * sunken(at, here);
            }
        }
    } else {
        normal = depth_normal(at, here, from_centre);
        darkness = DOME.x * behind(at, here);
    }
    let light = phong(tint[source_of(pixel)].xyz, normal, to_eye) * darken(darkness);
    shaded[pixel] = packed_bytes(vec4<u32>(vec4<f32>(srgb_of(light), 1.0) * 255.0 + 0.5));
}
