// The tables of what is drawn: nodes, and equal chunks of their points (crates/render/src/gpu/table.rs has
// the same structures). A point's number is `chunk * CHUNK_POINTS + place in the chunk`.

const CHUNK_POINTS: u32 = 4096u;
// The page of a plane that is not there.
const NO_PAGE: u32 = 0xffffffffu;

// A drawn node. Planes are given by page and first 32-bit word in it.
struct Draw {
    // `box_min` less the eye, in steps, rounded down: the part above 2^16.
    base_high: vec3<i32>,
    // Bits that hot positions drop.
    shift: u32,
    // The part below.
    base_low: vec3<i32>,
    // Points drawn.
    points: u32,
    // What rounding down left, and half a hot step where the dropped bits are not there.
    bias_steps: vec3<f32>,
    // Typical distance of the node's points, the file's unit.
    spacing: f32,
    // Least lattice coordinates.
    box_min: vec3<u32>,
    // Its place in the compact octree.
    entry: u32,
    position_page: u32,
    position_word: u32,
    residual_page: u32,
    residual_word: u32,
    colour_page: u32,
    colour_word: u32,
    normal_page: u32,
    normal_word: u32,
    // Log2 of its cell's edge.
    cell_log2: u32,
    // Its first chunk.
    chunk: u32,
    // What a point of the colour plane is: COLOUR_NONE ...
    colour_kind: u32,
    // Points that the colour plane has.
    colour_points: u32,
    // Points that the normal plane has.
    normal_points: u32,
    clip_page: u32,
    clip_word: u32,
    // Points that the plane of clip lines has.
    clip_points: u32,
    tangent_page: u32,
    tangent_word: u32,
    // Points that the plane of shapes has.
    tangent_points: u32,
}

// Kinds of colour planes: bytes red, green, blue and one unused; one value of a type; or the last byte of a position.
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

// Where a colour plane has a point's value: the word, by how many bits it is shifted down, and whether (1) a second
// word follows.
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

// A run of a node's points.
struct Chunk {
    draw: u32,
    // First point, in the node.
    first: u32,
    // Points, at most CHUNK_POINTS.
    points: u32,
    unused: u32,
}
