// Assigns the planes of the squares to the pixels of level 0, and sets depth intervals of matching
// length. Twin: crates/render/src/passes/gather.rs, which explains the constants.

// include common/frame.wgsl
// include common/tangent.wgsl
// include common/squares.wgsl
// include common/seen.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
// Planes of the squares (fit_planes/fit.wgsl).
@group(0) @binding(1) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> front: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> tilts: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> depths: array<f32>;

// Reach of depth intervals without a plane, greatest reach with one, and the margin of radii.
const BARE_REACH: f32 = 2.0;
const FITTED_REACH_MAX: f32 = 3.0;
const RADIUS_MARGIN_PX: f32 = 0.5;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height {
        return;
    }
    let own = front[pixel];
    if is_infinite(own.x) {
        return;
    }
    let at = vec2<u32>(pixel % frame.width, pixel / frame.width);
    let centre = vec2<f32>(at) + 0.5;
    let seen = seen_at(centre);
    // The radius that gather has set, which is that of a sphere; and the radius in the picture's
    // centre.
    let of_sphere_px = tint[pixel].w;
    let in_middle = min(of_sphere_px - RADIUS_MARGIN_PX, of_sphere_px / (of_sphere(seen) * STRETCHED));
    let radius_px = in_middle + RADIUS_MARGIN_PX;
    var plane = vec3<f32>(0.0, 0.0, BARE_REACH);
    if radius_px <= f32(SQUARE_PX) {
        let square = at / SQUARE_PX;
        plane = planes[square.y * squares().x + square.x].xyz;
    }
    let place = centre - own.zw;
    // The normal, scaled so that q is -1 at the place (crates/render/src/passes/tangent.rs), and no
    // steeper than can be followed.
    let back = (dot(plane.xy, place - frame.centre_px) + 1.0) / frame.focal_px;
    let steepness = (abs(plane.x) + abs(plane.y)) * (frame.focal_px / SLOPE_MAX);
    let followed = 1.0 / max(steepness, 1.0);
    let tilt = vec2<f32>(plane.x, -plane.y) * followed;
    let across = length(vec3<f32>(plane.xy, back));
    let plate = across * followed * frame.focal_px;
    if any(plane.xy != vec2<f32>(0.0)) {
        let stretch = of_disc(vec3<f32>(plane.x, -plane.y, back) / across, seen).y;
        tint[pixel].w = max(in_middle * (stretch * STRETCHED), radius_px);
    }
    let radius = in_middle * own.x / frame.focal_px;
    let reach = radius * min(plate * plane.z, FITTED_REACH_MAX);
    // Discs are moved to the centres of their pixels, along their planes.
    let to_centre = over_turn(-1.0, turn_of(tilt, own.zw));
    let depth = own.x * to_centre;
    front[pixel] = vec4<f32>(depth, depth + reach, 0.0, 0.0);
    depths[pixel] = depth;
    tilts[pixel] = tilt * to_centre;
}
