// Rows of the tables of the cut: nodes, and chunks of their points. A point has the number
// `chunk * CHUNK_POINTS + index in the chunk`. Host: crates/render/src/gpu/memory/table.rs, which
// describes each field.

const CHUNK_POINTS: u32 = 4096u;
// Page of a plane that does not exist.
const NO_PAGE: u32 = 0xffffffffu;

// Row of a node. A plane is given by its page and its first word there.
struct Draw {
    // `box_min` minus the eye, in steps, rounded down: the multiples of 2^16.
    base_high: vec3<i32>,
    // Bits that hot positions drop.
    shift: u32,
    // The rest, below 2^16.
    base_low: vec3<i32>,
    // Number of points drawn.
    points: u32,
    // Remainder of rounding down, plus half a hot step without residual bits.
    bias_steps: vec3<f32>,
    // Spacing of the node, in the file's unit.
    spacing: f32,
    // Least lattice coordinates of the node.
    box_min: vec3<u32>,
    // Index of the node's cell in the compact octree.
    entry: u32,
    position_page: u32,
    position_word: u32,
    residual_page: u32,
    residual_word: u32,
    colour_page: u32,
    colour_word: u32,
    normal_page: u32,
    normal_word: u32,
    // Log2 of the edge of the node's cell.
    cell_log2: u32,
    // First chunk of the node.
    chunk: u32,
    // Kind of the colour plane.
    colour_kind: u32,
    // Points of the colour plane.
    colour_points: u32,
    // Points of the normal plane.
    normal_points: u32,
    clip_page: u32,
    clip_word: u32,
    // Points of the plane of clip lines.
    clip_points: u32,
    tangent_page: u32,
    tangent_word: u32,
    // Points of the plane of shapes.
    tangent_points: u32,
    // 1 over the depth up to which all points are drawn, and shares of the density: of the
    // ancestors' points, and of each point.
    per_reach: f32,
    above: f32,
    per_point: f32,
    // 1 if points thin out along a line, else as a surface.
    is_line: u32,
    // Number of points up to the end of each level.
    level_ends: array<u32, 16>,
}

// Kinds of colour planes: none; bytes red, green, blue and one unused; a value of a type; or the
// last byte of each position.
const COLOUR_NONE: u32 = 0u;
const COLOUR_RGBA: u32 = 1u;
const COLOUR_U8: u32 = 2u;
const COLOUR_I8: u32 = 3u;
const COLOUR_U16: u32 = 4u;
const COLOUR_I16: u32 = 5u;
const COLOUR_U32: u32 = 6u;
const COLOUR_I32: u32 = 7u;
const COLOUR_U64: u32 = 8u;
const COLOUR_I64: u32 = 9u;
const COLOUR_F32: u32 = 10u;
const COLOUR_F64: u32 = 11u;
const COLOUR_INDEX: u32 = 12u;

// Place of the value of point `index` in a colour plane: its word, the bits to shift it down by,
// and 1 if a second word follows, else 0.
fn colour_place(kind: u32, index: u32) -> vec3<u32> {
    if kind == COLOUR_U8 || kind == COLOUR_I8 {
        return vec3<u32>(index / 4u, index % 4u * 8u, 0u);
    }
    if kind == COLOUR_U16 || kind == COLOUR_I16 {
        return vec3<u32>(index / 2u, index % 2u * 16u, 0u);
    }
    if kind == COLOUR_INDEX {
        return vec3<u32>(index * 2u + 1u, 24u, 0u);
    }
    let is_double = kind == COLOUR_U64 || kind == COLOUR_I64 || kind == COLOUR_F64;
    return select(vec3<u32>(index, 0u, 0u), vec3<u32>(index * 2u, 0u, 1u), is_double);
}

// Row of a chunk: consecutive points of a node.
struct Chunk {
    draw: u32,
    // First point in the node.
    first: u32,
    // Number of points, at most CHUNK_POINTS.
    points: u32,
    unused: u32,
}
