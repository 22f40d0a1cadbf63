// Colours of points. Mapped quantities (values of any type, classes, coordinates, depths, sizes of
// cells) become the bits of a double, and the host prepares runs of doubles of one colour: the
// colour is the same as on the CPU, bit by bit. Needs common/draws.wgsl, common/lookup.wgsl, and
// variables `lookup` and `draws`. Twin: `Lookup::colour` in crates/render/src/inputs/lookup.rs.

// include common/double.wgsl
// include common/normal.wgsl

// Source of colours, `ColourBy::number` in crates/render/src/inputs/colour.rs.
override COLOUR: u32 = 0u;
const BY_PLAIN: u32 = 0u;
const BY_RGB: u32 = 1u;
const BY_VALUE: u32 = 2u;
const BY_X: u32 = 3u;
const BY_Y: u32 = 4u;
const BY_Z: u32 = 5u;
const BY_EYE_DEPTH: u32 = 6u;
const BY_CELL: u32 = 7u;
const BY_NORMAL: u32 = 8u;


// Whether colours follow a coordinate.
fn is_by_coordinate() -> bool {
    return COLOUR == BY_X || COLOUR == BY_Y || COLOUR == BY_Z;
}

// The coordinate that colours follow, steps, high word first: of the point at `place`, which is at
// `offset` in its node. It may need more than 32 bits, of which the carry is the high word.
fn coordinate_of(place: vec3<u32>, offset: vec3<u32>) -> vec2<u32> {
    if COLOUR == BY_X {
        return vec2<u32>(u32(place.x < offset.x), place.x);
    }
    if COLOUR == BY_Y {
        return vec2<u32>(u32(place.y < offset.y), place.y);
    }
    return vec2<u32>(u32(place.z < offset.z), place.z);
}

// Linear light of a point, from its fetched words, the coordinate that colours follow
// (`coordinate_of`) and the bits of its depth.
fn colour_of(paint: vec4<u32>, coordinate: vec2<u32>, depth_bits: u32) -> vec3<f32> {
    let draw = paint.x & ~HAS_COLOUR;
    let plain = lookup.plain.xyz;
    if is_by_coordinate() {
        return mapped(double_of_u64(coordinate));
    }
    if COLOUR == BY_EYE_DEPTH {
        return mapped(double_of_f32(depth_bits));
    }
    if COLOUR == BY_CELL {
        return mapped(double_of_u64(vec2<u32>(0u, draws[draw].cell_log2)));
    }
    if COLOUR == BY_NORMAL {
        let has_normals = draws[draw].normal_page != NO_PAGE;
        return select(plain, normal_of(paint.w) * 0.5 + 0.5, has_normals);
    }
    let has_colour = (paint.x & HAS_COLOUR) != 0u;
    let kind = draws[draw].colour_kind;
    if COLOUR == BY_RGB && has_colour && kind == COLOUR_RGBA {
        return vec3<f32>(
            linear_of(paint.y & 0xffu),
            linear_of((paint.y >> 8u) & 0xffu),
            linear_of((paint.y >> 16u) & 0xffu),
        );
    }
    if COLOUR == BY_VALUE && has_colour && kind > COLOUR_RGBA {
        return mapped(double_of_value(paint.yz, kind));
    }
    return plain;
}

fn linear_of(byte: u32) -> f32 {
    return lookup.linear[byte / 4u][byte % 4u];
}

// The double of a value of a colour plane, whose words come low word first.
fn double_of_value(words: vec2<u32>, kind: u32) -> vec2<u32> {
    switch kind {
        case COLOUR_U8, COLOUR_INDEX: { return double_of_u64(vec2<u32>(0u, words.x & 0xffu)); }
        case COLOUR_I8: { return double_of_i64(widened(words.x << 24u, 24u)); }
        case COLOUR_U16: { return double_of_u64(vec2<u32>(0u, words.x & 0xffffu)); }
        case COLOUR_I16: { return double_of_i64(widened(words.x << 16u, 16u)); }
        case COLOUR_U32: { return double_of_u64(vec2<u32>(0u, words.x)); }
        case COLOUR_I32: { return double_of_i64(widened(words.x, 0u)); }
        case COLOUR_U64: { return double_of_u64(words.yx); }
        case COLOUR_I64: { return double_of_i64(words.yx); }
        case COLOUR_F32: { return double_of_f32(words.x); }
        default: { return words.yx; }
    }
}

// The whole number of 64 bits that `top`, shifted down with its sign, stands for.
fn widened(top: u32, down: u32) -> vec2<u32> {
    let value = bitcast<i32>(top) >> down;
    return vec2<u32>(bitcast<u32>(value >> 31u), bitcast<u32>(value));
}

// The colour of the run that contains a double.
fn mapped(bits: vec2<u32>) -> vec3<f32> {
    if is_no_number(bits) {
        return lookup.no_number.xyz;
    }
    let value = ordered(bits);
    // Binary search for the last run that begins at or below the value; the first begins below all.
    var run = 0u;
    for (var step = 128u; step > 0u; step >>= 1u) {
        let pair = lookup.starts[(run + step) / 2u];
        let start = select(pair.xy, pair.zw, ((run + step) & 1u) == 1u);
        if start.x < value.x || (start.x == value.x && start.y <= value.y) {
            run += step;
        }
    }
    return lookup.colours[run].xyz;
}
