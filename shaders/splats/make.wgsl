// Writes the splats of a batch in the order of their points: place and radius, then the code of the
// normal and the colour. One workgroup a chunk. Host: crates/render/src/gpu/splats.rs. Twin:
// crates/render/src/inputs/splats.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/colour.wgsl
// include common/octree.wgsl
// include common/radius.wgsl
// include common/splats.wgsl
// include common/kept.wgsl

// The eye of the picture relative to the origin, for colours by depth.
struct Eye {
    place: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(2) var<storage, read> draws: array<Draw>;
@group(0) @binding(3) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> paint: array<vec4<u32>>;
// Number of splats before each chunk.
@group(0) @binding(5) var<storage, read> starts: array<u32>;
@group(0) @binding(6) var<uniform> lookup: Lookup;
@group(0) @binding(7) var<storage, read> octree: array<OctreeCell>;
@group(0) @binding(8) var<uniform> eye: Eye;
// Two `vec4<f32>` a splat.
@group(0) @binding(9) var<storage, read_write> made: array<vec4<f32>>;

// Threads of a workgroup.
const MAKERS: u32 = 256u;

// Splats of the threads up to each one.
var<workgroup> sums: array<u32, 256>;

// Writes the splat of point `i` of the batch.
fn write(i: u32, point: Point, at: u32) {
    let own = paint[i];
    let lattice = draws[point.draw].box_min + point.offset;
    let code = radius_code_of(geometry[i].xy);
    let factor = lookup.radius_factors[code / 4u][code % 4u];
    let radius = radius_within(spacing_of(point.draw, lattice, code) * factor);
    let depth = -dot(point.centre - eye.place.xyz, frame.back);
    let colour = colour_of(own, coordinate_of(lattice, point.offset), bitcast<u32>(depth));
    made[2u * at] = vec4<f32>(point.centre, radius);
    made[2u * at + 1u] = vec4<f32>(bitcast<f32>(own.w), colour);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    var next = starts[group.x];
    for (var first = 0u; first < CHUNK_POINTS; first += MAKERS) {
        let i = group.x * CHUNK_POINTS + first + lane;
        let point = point_of(i);
        sums[lane] = u32(point.is_kept);
        workgroupBarrier();
        for (var step = 1u; step < MAKERS; step <<= 1u) {
            var below = 0u;
            if lane >= step {
                below = sums[lane - step];
            }
            workgroupBarrier();
            sums[lane] += below;
            workgroupBarrier();
        }
        let at = next + sums[lane] - 1u;
        if point.is_kept && at < arrayLength(&made) / 2u {
            write(i, point, at);
        }
        next += sums[MAKERS - 1u];
        workgroupBarrier();
    }
}
