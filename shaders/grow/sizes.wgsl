// Sizes of adaptive dots: the radius of the dot of each pixel's point. Twin:
// crates/render/src/passes/grow.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/octree.wgsl
// include common/radius.wgsl

const ADAPTIVE_FACTOR: f32 = 0.84;
const ADAPTIVE_MAX: f32 = 5.0;
const PIXEL_RADIUS: f32 = 0.5;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lookup: Lookup;
@group(0) @binding(2) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> draws: array<Draw>;
@group(0) @binding(4) var<storage, read> octree: array<OctreeCell>;
@group(0) @binding(5) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> paint: array<vec4<u32>>;
// Radii, pixels; 0 without a point.
@group(0) @binding(7) var<storage, read_write> radii: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height {
        return;
    }
    let hit = hits[pixel];
    var radius = 0.0;
    if hit.y != NO_HIT {
        let words = geometry[pixel];
        let draw = paint[pixel].x & ~HAS_COLOUR;
        let p = draws[draw].box_min + offset_of(words, draws[draw].shift);
        let code = radius_code_of(words.xy);
        let stored = min(lookup.radius_factors[code / 4u][code % 4u], 1.0);
        let drawn = radius_within(spacing_of(draw, p) * stored * ADAPTIVE_FACTOR);
        let radius_px = drawn * frame.focal_px / bitcast<f32>(hit.y) + PIXEL_RADIUS;
        radius = clamp(radius_px, PIXEL_RADIUS, ADAPTIVE_MAX);
    }
    radii[pixel] = radius;
}
