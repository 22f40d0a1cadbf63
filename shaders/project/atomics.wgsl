// Project by one 64-bit atomic minimum a point (crates/render/src/project.rs, the same steps): a pixel keeps
// the least `depth << 32 | point`. A group of threads draws a chunk. The frame buffer is read before it is
// written: most points lose already there.

// include common/points.wgsl

@group(0) @binding(7) var<storage, read_write> hits: array<atomic<u64>>;

const THREADS: u32 = 256u;

// Whether pixels are read and written. Without, all the rest is done: what the pass takes but for its frame
// buffer, to compare with (`esker bench draw`).
override TOUCHES_PIXELS: bool = true;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let item = group.x + group.y * groups.x;
    if item >= arrayLength(&work) {
        return;
    }
    let number = work[item];
    let chunk = chunks[number];
    let draw = draws[chunk.draw];
    let points = min(chunk.points, CHUNK_POINTS);
    for (var i = thread; i < points; i += THREADS) {
        let index = chunk.first + i;
        let seen = see(draw, index);
        if !is_inside(seen) {
            continue;
        }
        let at = min(vec2<u32>(seen.at), vec2<u32>(frame.width, frame.height) - 1u);
        let pixel = at.y * frame.width + at.x;
        let value = (u64(bitcast<u32>(seen.depth)) << 32u) | u64(number * CHUNK_POINTS + i);
        if TOUCHES_PIXELS {
            if value >= atomicLoad(&hits[pixel]) {
                continue;
            }
        } else if value > u64(pixel) {
            // Always, since a depth has bits above all pixels; but a compiler cannot know, and must have both.
            continue;
        }
        if CULLS_BACK_FACES && !faces_eye(draw, index, seen.from_eye) {
            continue;
        }
        atomicMin(&hits[pixel], value);
    }
}
