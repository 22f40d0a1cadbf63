// Gather (marroquim2007, section 3.1): fills level 0 of the pyramid from the winning points.
// `front` and `tint` come in with the words of the points (gather/fetch.wgsl), and each pixel's are
// replaced by its attributes, so that no further memory is needed. Twin:
// crates/render/src/passes/gather.rs, which explains the constants.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/colour.wgsl
// include common/facing.wgsl
// include common/point_normal.wgsl
// include common/octree.wgsl
// include common/radius.wgsl
// include common/tangent.wgsl
// include common/seen.wgsl

// Whether pixels carry normals.
override NORMALS: bool = false;
// Whether pixels carry planes; fitted ones are assigned afterwards by fit_planes/tilt.wgsl.
override PLANES: bool = false;

// Radii: factor on stored ones and margin, with normals and without (bare); factor and least size
// of the minor axis.
const RADIUS_FACTOR_NORMALS: f32 = 1.4;
const RADIUS_FACTOR_BARE: f32 = 1.15;
const RADIUS_MARGIN_PX_NORMALS: f32 = 0.35;
const RADIUS_MARGIN_PX_BARE: f32 = 0.5;
const MINOR_FACTOR: f32 = 1.3;
const MINOR_MIN_PX: f32 = 1.4;
// Length of depth intervals in radii, without a normal and with one.
const BARE_REACH: f32 = 2.0;
const THICKNESS: f32 = 1.0;
// Greatest length of depth intervals with a normal: in drawn radii, and in pixels that are added;
// the radii in pixels from which it sets in, and holds; and its least share.
const THICK_MAX: vec2<f32> = vec2<f32>(1.5, 8.0);
const THICK_FROM_PX: vec2<f32> = vec2<f32>(4.0, 6.0);
const SHARE_MIN: f32 = 0.0625;
// Greatest radius of points without a normal among points with normals, pixels.
const DOT_RADIUS_PX: f32 = 5.0;
// Depth that is added to points whose normal looks away, in radii.
const BACK_DEPTH: f32 = 3.0;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lookup: Lookup;
@group(0) @binding(2) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> draws: array<Draw>;
@group(0) @binding(4) var<storage, read> octree: array<OctreeCell>;
@group(0) @binding(5) var<storage, read_write> front: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read_write> tint: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> depths: array<f32>;
@group(0) @binding(8) var<storage, read_write> normals: array<vec4<f32>>;
// Number of pixels with a winning point.
@group(0) @binding(9) var<storage, read_write> counts: array<atomic<u32>>;

var<workgroup> won: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    var has_point = false;
    if pixel < frame.width * frame.height {
        let hit = hits[pixel];
        has_point = hit.y != NO_HIT;
        if has_point {
            gather(pixel, hit.y);
        } else {
            front[pixel] = vec4<u32>(INFINITE_BITS, INFINITE_BITS, 0u, 0u);
        }
    }
    if has_point {
        atomicAdd(&won, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&counts[0], atomicLoad(&won));
    }
}

// Fills a pixel from its winning point.
fn gather(pixel: u32, depth_bits: u32) {
    let geometry = front[pixel];
    let paint = tint[pixel];
    let draw = paint.x & ~HAS_COLOUR;
    let offset = offset_of(geometry, draws[draw].shift);
    let p = draws[draw].box_min + offset;

    let code = radius_code_of(geometry.xy);
    let stored = lookup.radius_factors[code / 4u][code % 4u];
    let factor = select(RADIUS_FACTOR_BARE, RADIUS_FACTOR_NORMALS, NORMALS);
    let depth = bitcast<f32>(depth_bits);
    var radius = radius_within(spacing_of(draw, p, code) * factor * stored);
    if NORMALS && paint.w == NO_NORMAL {
        radius = min(radius, DOT_RADIUS_PX * depth / frame.focal_px);
    }
    let margin = select(RADIUS_MARGIN_PX_BARE, RADIUS_MARGIN_PX_NORMALS, NORMALS);
    // From the point's place to the pixel's centre, clamped to the pixel against rounding.
    let place = place_of(draw, offset, depth);
    let centre = vec2<f32>(vec2<u32>(pixel % frame.width, pixel / frame.width)) + 0.5;
    let within = vec2<f32>(select(0.0, 0.5, PLANES));
    let displaced = clamp(centre - place, -within, within);
    var reach = radius * BARE_REACH;
    let seen = seen_at(centre);
    var stretch = of_sphere(seen);
    var minor = stretch;
    var share = 1.0;
    var n = vec3<f32>(0.0);
    var own_depth = depth;
    if NORMALS {
        let turned = normal_to_eye(paint.w, draw, offset);
        n = turned.xyz;
        own_depth += turned.w * radius * BACK_DEPTH;
        if any(n != vec3<f32>(0.0)) {
            let thick = thickness(vec4<f32>(n, 0.0), place) * (THICKNESS / RADIUS_FACTOR_NORMALS);
            reach = min(radius * thick, longest(radius * frame.focal_px / depth) * depth / frame.focal_px);
            let axes = of_disc(n, seen);
            minor = axes.x;
            stretch = axes.y;
            share = abs(n.z);
        }
    }
    let in_middle = min(radius * frame.focal_px / depth, RADIUS_MAX);
    let radius_px = min(max(in_middle * (stretch * STRETCHED), in_middle + margin), RADIUS_MAX);
    if NORMALS {
        // Not so small that the ellipse falls between pixels.
        let minor_px = min(max(in_middle * (minor * STRETCHED), (in_middle + margin) * share), RADIUS_MAX);
        let filtered = min(max(minor_px / radius_px * MINOR_FACTOR, MINOR_MIN_PX / radius_px), 1.0);
        normals[pixel] = vec4<f32>(n, filtered);
    }

    let colour = colour_of(paint, coordinate_of(p, offset), depth_bits);
    let interval = bitcast<vec2<u32>>(vec2<f32>(own_depth, own_depth + reach));
    front[pixel] = vec4<u32>(interval, bitcast<vec2<u32>>(displaced));
    tint[pixel] = bitcast<vec4<u32>>(vec4<f32>(colour, radius_px));
    depths[pixel] = own_depth;
}

// Greatest length of the depth interval of discs with normals and this radius, pixels.
fn longest(radius_px: f32) -> f32 {
    let share = (radius_px - THICK_FROM_PX.x) / (THICK_FROM_PX.y - THICK_FROM_PX.x);
    return (radius_px * THICK_MAX.x + THICK_MAX.y) / clamp(share, SHARE_MIN, 1.0);
}

// Place of a point in the picture, pixels.
fn place_of(draw: u32, offset: vec3<u32>, depth: f32) -> vec2<f32> {
    let d = &draws[draw];
    let steps = steps_from_anchor((*d).base_high, (*d).base_low, (*d).bias_steps, offset);
    let from_anchor = steps * frame.step;
    let flat = vec2<f32>(dot(frame.right, from_anchor), -dot(frame.up, from_anchor));
    let at = select(depth, frame.anchor_depth, frame.is_parallel == 1u);
    return placed(flat * (frame.focal_px / at));
}
