// Sums of planes over windows along an axis. Twin: crates/trace/src/filter/boxes.rs.

// include common/box_sum.wgsl

// Whether along columns, else along rows.
override DOWN: bool;

// Rows of the source and of the sums.
struct Rows {
    width: u32,
    radius: i32,
    // First row of the source, and their number.
    source_first: u32,
    source_rows: u32,
    // First row of the sums, and their number.
    first: u32,
    rows: u32,
    unused: u32,
    unused_2: u32,
}

@group(0) @binding(0) var<uniform> shape: Rows;
@group(0) @binding(1) var<storage, read> source: array<f32>;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

// Column, or row of the sums.
var<private> line: u32;
var<private> plane: u32;

fn item(at: i32) -> f32 {
    let start = select(0, i32(shape.source_first), DOWN);
    let count = select(shape.width, shape.source_rows, DOWN);
    if at < start || at >= start + i32(count) {
        return 0.0;
    }
    let x = select(u32(at), line, DOWN);
    let row = select(shape.first + line, u32(at), DOWN) - shape.source_first;
    return source[(plane * shape.source_rows + row) * shape.width + x];
}

fn put(at: i32, sum: f32) {
    let end = select(shape.width, shape.first + shape.rows, DOWN);
    if at < i32(end) {
        let x = select(u32(at), line, DOWN);
        let row = select(line, u32(at) - shape.first, DOWN);
        sums[(plane * shape.rows + row) * shape.width + x] = sum;
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    line = select(id.y, id.x, DOWN);
    plane = id.z;
    let run = i32(select(id.x, id.y, DOWN)) * RUN;
    let first = run + select(0, i32(shape.first), DOWN);
    let end = select(shape.width, shape.first + shape.rows, DOWN);
    if line >= select(shape.rows, shape.width, DOWN) || first >= i32(end) {
        return;
    }
    box_sums(first, shape.radius);
}
