// Blends the splats of a batch (zwicker2004, section 6): the visibility pass, the attribute pass,
// or both as one. A workgroup is a tile, a thread a pixel; sums stay in registers of 32 bits, so
// that no target has to support blending. Twin: crates/render/src/ewa/blend.rs.

// include common/frame.wgsl
// include common/splats.wgsl

// The pass to run.
override PASS: u32 = 0u;
// Finds the front of each pixel.
const VISIBILITY: u32 = 0u;
// Sums the attributes of the splats that are not behind the front.
const ATTRIBUTES: u32 = 1u;
// Takes the attributes of the nearest splat.
const SINGLE: u32 = 2u;
// Whether the cloud has normals.
override NORMALS: bool = false;
// Whether splats are clipped.
override CLIPS: bool = false;

// Thickness of a surface along the line of sight at its clip lines, in pixels, and its growth per
// pixel away from them (clip.rs).
const EDGE_PX: f32 = 1.0;
const EDGE_GROWTH: f32 = 1.0;
// Distance from an edge where a splat has no lines.
const NO_EDGE_PX: f32 = 1e30;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> boxes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> starts: array<u32>;
@group(0) @binding(5) var<storage, read> entries: array<u32>;
// Inverse depth of the front, moved back; 0 without a splat.
@group(0) @binding(6) var<storage, read_write> front: array<f32>;
// Sums of red, green, blue and the weight.
@group(0) @binding(7) var<storage, read_write> tint: array<vec4<f32>>;
// Sums of the normal (or radius) and the inverse depth.
@group(0) @binding(8) var<storage, read_write> shape: array<vec4<f32>>;

// Two rows a point: lines over pixels from the picture's centre; the last word of the first row is
// the part that is kept.
@group(0) @binding(9) var<storage, read> clips: array<vec4<u32>>;

// Threads of a block of pixels, which run in lockstep, and blocks of a tile.
const THREADS: u32 = 32u;
const BLOCKS: u32 = 8u;
// Splats that a workgroup loads together; two threads test each.
const BATCH: u32 = 128u;
var<workgroup> batched: array<Splat, 128>;
// Splats that touch each block, and their numbers: most blocks skip a small splat.
var<workgroup> touching: array<u32, 1024>;
var<workgroup> touches: array<atomic<u32>, 8>;
// Indices of the splats in the batch, if splats are clipped.
var<workgroup> places: array<u32, 128>;

// Approximates exp(-t) for t from 0 to 2 (crates/render/src/ewa/gauss.rs).
fn falloff(t: f32) -> f32 {
    let s = t * 0.5;
    let root = s * (s * (s * (s * 0.02553654 - 0.15375047) + 0.49556967) - 0.9994563) + 0.99998916;
    return root * root;
}

// First pixel of a block in its tile; blocks are 8 pixels wide and 4 high.
fn corner_of(block: u32) -> vec2<u32> {
    return vec2<u32>(block % 2u * 8u, block / 2u * 4u);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let corner = group.xy * TILE;
    let block = thread / THREADS;
    let id = corner + corner_of(block) + vec2<u32>(thread % 8u, thread % THREADS / 8u);
    let tile = group.y * batch.tiles.x + group.x;
    let tiles = batch.tiles.x * batch.tiles.y;
    let has_room = starts[tiles] <= batch.entries;
    let first = select(0u, starts[tile], has_room);
    let end = select(batch.points, starts[tile + 1u], has_room);
    let is_pixel = id.x < frame.width && id.y < frame.height;
    let pixel = min(id.y, frame.height - 1u) * frame.width + min(id.x, frame.width - 1u);
    let place = vec2<f32>(id) + 0.5;
    var nearest = 0.0;
    var sum_tint = vec4<f32>(0.0);
    var sum_shape = vec4<f32>(0.0);
    if PASS == ATTRIBUTES || batch.is_first == 0u {
        nearest = front[pixel];
    }
    if PASS != VISIBILITY && batch.is_first == 0u {
        sum_tint = tint[pixel];
        sum_shape = shape[pixel];
    }
    for (var start = first; start < end; start += BATCH) {
        workgroupBarrier();
        if thread < BLOCKS {
            atomicStore(&touches[thread], 0u);
        }
        workgroupBarrier();
        let member = thread % BATCH;
        if start + member < end {
            var at = start + member;
            if has_room {
                at = entries[at];
            }
            let box = vec4<u32>(boxes[at] & vec2<u32>(0xffffu), boxes[at] >> vec2<u32>(16u));
            if thread < BATCH && is_in(box, corner, vec2<u32>(TILE)) {
                batched[member] = splats[at];
                if CLIPS {
                    places[member] = at;
                }
            }
            // Each of the two threads tests half of the blocks.
            let half = thread / BATCH * (BLOCKS / 2u);
            for (var b = half; b < half + BLOCKS / 2u; b += 1u) {
                if is_in(box, corner + corner_of(b), vec2<u32>(8u, 4u)) {
                    touching[b * BATCH + atomicAdd(&touches[b], 1u)] = member;
                }
            }
        }
        workgroupBarrier();
        let count = atomicLoad(&touches[block]);
        for (var k = 0u; k < count; k += 1u) {
            let member = touching[block * BATCH + k];
            let splat = batched[member];
            let seen = seen_at(splat, place, frame.near);
            if seen.x > 1.0 {
                continue;
            }
            var from_edge = NO_EDGE_PX;
            if CLIPS {
                from_edge = distance_of(places[member], place - frame.centre_px);
                if from_edge < 0.0 {
                    continue;
                }
            }
            let z = seen.y;
            if PASS == VISIBILITY {
                var moved = z / (1.0 - splat.c.w * z);
                if splat.c.w > 0.0 {
                    moved = min(z, splat.b.w) - splat.c.w;
                }
                if CLIPS {
                    let thin = (from_edge * EDGE_GROWTH + EDGE_PX) / frame.focal_px;
                    moved = max(moved, z / (1.0 + thin));
                }
                nearest = max(nearest, moved);
                continue;
            }
            if select(z < nearest, z <= nearest, PASS == SINGLE) {
                continue;
            }
            let colour = vec4<f32>(bitcast<vec3<f32>>(splat.d.xyz), 1.0);
            var own = vec4<f32>(bitcast<f32>(splat.d.w), 0.0, 0.0, z);
            if NORMALS {
                own = vec4<f32>(unpacked_normal(splat.d.w), z);
            }
            if PASS == SINGLE {
                nearest = z;
                sum_tint = colour;
                sum_shape = own;
            } else {
                let amplitude = select(abs(splat.b.y), 1.0, splat.c.w < 0.0);
                let weight = falloff(seen.x * batch.half_cutoff) * amplitude;
                sum_tint += colour * weight;
                sum_shape += own * weight;
            }
        }
    }
    if !is_pixel {
        return;
    }
    if PASS != ATTRIBUTES {
        front[pixel] = nearest;
    }
    if PASS != VISIBILITY {
        tint[pixel] = sum_tint;
        shape[pixel] = sum_shape;
    }
}

// Distance of a pixel from the edge of what the clip lines of a splat keep, in pixels, not negative
// where the pixel is kept; very large without lines. The splats on both sides of a line compute the
// same numbers but for their signs, so that each pixel is kept by exactly one of them.
fn distance_of(splat: u32, place: vec2<f32>) -> f32 {
    let row = clips[2u * splat];
    let kept = row.w;
    if kept == KEPT_WHOLE {
        return NO_EDGE_PX;
    }
    let a = bitcast<vec3<f32>>(row.xyz);
    let first = a.x * place.x + (a.z + a.y * place.y);
    if kept == KEPT_ONE {
        return first;
    }
    let b = bitcast<vec3<f32>>(clips[2u * splat + 1u].xyz);
    let second = b.x * place.x + (b.z + b.y * place.y);
    return select(min(first, second), max(first, second), kept == KEPT_EITHER);
}

// Whether a splat's box overlaps the rectangle of `size` pixels at `corner`.
fn is_in(box: vec4<u32>, corner: vec2<u32>, size: vec2<u32>) -> bool {
    return all(box.xy < box.zw) && all(box.zw > corner) && all(box.xy < corner + size);
}
