// Sizes of adaptive dots: the radius of the dot of each pixel's point. On request, parts the points
// of surfaces from dots before. Twins: crates/render/src/passes/grow.rs, split.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/octree.wgsl
// include common/radius.wgsl
// include common/normal.wgsl

// Whether points of surfaces are parted from dots, and whether there are normals.
override SPLITS: bool = false;
override NORMALS: bool = false;

const ADAPTIVE_FACTOR: f32 = 0.84;
const ADAPTIVE_MAX: f32 = 5.0;
const PIXEL_RADIUS: f32 = 0.5;
// Greatest distance of points of a surface on the picture, pixels: with a normal, without one among
// points with normals, and where no point has one.
const SURFACE_PX: vec3<f32> = vec3<f32>(64.0, 6.0, 32.0);
// Distance of points with a normal on the picture from which others have to support the surface
// (support.wgsl), pixels.
const WIDE_PX: f32 = 8.0;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lookup: Lookup;
// Dots are removed where they are parted from surfaces.
@group(0) @binding(2) var<storage, read_write> hits: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> draws: array<Draw>;
@group(0) @binding(4) var<storage, read> octree: array<OctreeCell>;
@group(0) @binding(5) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> paint: array<vec4<u32>>;
// Radii, pixels; 0 without a point.
@group(0) @binding(7) var<storage, read_write> radii: array<f32>;
// The parted dots; a wide point has no depth and its distance in place of its number.
@group(0) @binding(8) var<storage, read_write> dots: array<vec2<u32>>;
// The first is the number of pixels with a point.
@group(0) @binding(9) var<storage, read_write> counts: array<atomic<u32>>;

var<workgroup> parted: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel < frame.width * frame.height {
        size_dot(pixel);
    }
    if SPLITS {
        workgroupBarrier();
        if local == 0u {
            atomicAdd(&counts[0], atomicLoad(&parted));
        }
    }
}

fn size_dot(pixel: u32) {
    let hit = hits[pixel];
    var radius = 0.0;
    var is_dot = false;
    // Distance of the neighbours of a wide point.
    var wide = NO_HIT;
    if hit.y != NO_HIT {
        let words = geometry[pixel];
        let draw = paint[pixel].x & ~HAS_COLOUR;
        let p = draws[draw].box_min + offset_of(words, draws[draw].shift);
        let code = radius_code_of(words.xy);
        let spacing = spacing_of(draw, p, code);
        let stored = lookup.radius_factors[code / 4u][code % 4u];
        let depth = bitcast<f32>(hit.y);
        let narrow = select(min(stored, 1.0), stored, code > SCALED_CODE_MAX);
        let own_px = radius_within(spacing) * frame.focal_px / depth;
        let apart_px = select(max(own_px, frame.thinned_px), own_px, code > SCALED_CODE_MAX);
        let radius_px = apart_px * narrow * ADAPTIVE_FACTOR + PIXEL_RADIUS;
        radius = clamp(radius_px, PIXEL_RADIUS, ADAPTIVE_MAX);
        if SPLITS {
            var most = SURFACE_PX.z;
            if NORMALS {
                most = select(SURFACE_PX.x, SURFACE_PX.y, paint[pixel].w == NO_NORMAL);
            }
            let apart = radius_within(spacing * stored) * frame.focal_px;
            is_dot = apart > most * depth;
            if NORMALS && !is_dot && apart > WIDE_PX * depth {
                wide = bitcast<u32>(apart / depth);
            }
        }
    }
    radii[pixel] = radius;
    if SPLITS {
        dots[pixel] = select(vec2<u32>(wide, NO_HIT), hit, is_dot);
        if is_dot {
            hits[pixel] = vec2<u32>(NO_HIT);
            atomicAdd(&parted, 1u);
        }
    }
}
