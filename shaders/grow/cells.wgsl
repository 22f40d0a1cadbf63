// The nearest wide point of each cell of pixels: a point with a normal whose neighbours are far on
// the picture, as sizes.wgsl marks them. Twin: `Grid` in crates/render/src/passes/split.rs.

// include common/frame.wgsl
// include common/hits.wgsl

// Side of a cell, pixels.
const CELL_PX: u32 = 4u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> hits: array<vec2<u32>>;
// Parted dots; a wide point has no depth and its distance in place of its number.
@group(0) @binding(2) var<storage, read> dots: array<vec2<u32>>;
// Pixels of the nearest wide points.
@group(0) @binding(3) var<storage, read_write> cells: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let columns = (frame.width + CELL_PX - 1u) / CELL_PX;
    let rows = (frame.height + CELL_PX - 1u) / CELL_PX;
    if id.x >= columns * rows {
        return;
    }
    let first = vec2<u32>(id.x % columns, id.x / columns) * CELL_PX;
    let end = min(first + CELL_PX, vec2<u32>(frame.width, frame.height));
    var nearest = NO_HIT;
    var depth = NO_HIT;
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            let pixel = y * frame.width + x;
            let dot = dots[pixel];
            // Bits of positive depths are ordered as these.
            if dot.y == NO_HIT && dot.x != NO_HIT && hits[pixel].y < depth {
                nearest = pixel;
                depth = hits[pixel].y;
            }
        }
    }
    cells[id.x] = nearest;
}
