// Fetch: copies the words of the planes of each winning point to the buffers `geometry` and
// `paint`. A dispatch reads up to three pages; pixels whose planes are in other pages end at once.
// Host: crates/render/src/gpu/memory/lookup.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/normal.wgsl
// include common/lookup.wgsl

// Whether positions, colours and normals are fetched.
override GEOMETRY: bool = true;
override COLOURS: bool = true;
override NORMALS: bool = true;
// Whether only clip lines are fetched, to the even rows of `paint`.
override CLIPS: bool = false;
// Whether only shapes of splats are fetched, to the first words of the odd rows of `paint`.
override TANGENTS: bool = false;

struct Pages {
    numbers: vec3<u32>,
    // 1 for the first dispatch of a frame, which fills in defaults.
    is_first: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> pages: Pages;
@group(0) @binding(2) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(4) var<storage, read> draws: array<Draw>;
@group(0) @binding(5) var<storage, read_write> geometry: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read_write> paint: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read> page_a: array<u32>;
@group(0) @binding(8) var<storage, read> page_b: array<u32>;
@group(0) @binding(9) var<storage, read> page_c: array<u32>;

// Slot of a page that is not bound.
const ELSEWHERE: u32 = 3u;

// Slot of a page among those that are bound.
fn slot_of(page: u32) -> u32 {
    let is_it = vec3<u32>(page) == pages.numbers;
    return select(select(select(ELSEWHERE, 2u, is_it.z), 1u, is_it.y), 0u, is_it.x);
}

// Word `i` of the page in a slot.
fn word(slot: u32, i: u32) -> u32 {
    switch slot {
        case 0u: { return page_a[i]; }
        case 1u: { return page_b[i]; }
        default: { return page_c[i]; }
    }
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height {
        return;
    }
    let hit = hits[pixel];
    if hit.y == NO_HIT {
        return;
    }
    let chunk = chunks[hit.x / CHUNK_POINTS];
    let index = chunk.first + hit.x % CHUNK_POINTS;
    if CLIPS {
        fetch_clips(pixel, chunk.draw, index);
        return;
    }
    if TANGENTS {
        fetch_tangents(pixel, chunk.draw, index);
        return;
    }
    if pages.is_first == 1u {
        paint[pixel] = vec4<u32>(chunk.draw, 0u, 0u, NO_NORMAL);
    }
    if GEOMETRY {
        fetch_position(pixel, chunk.draw, index);
        fetch_residual(pixel, chunk.draw, index);
    }
    if COLOURS {
        fetch_colour(pixel, chunk.draw, index);
    }
    if NORMALS && index < draws[chunk.draw].normal_points {
        let slot = slot_of(draws[chunk.draw].normal_page);
        if slot != ELSEWHERE {
            paint[pixel].w = word(slot, draws[chunk.draw].normal_word + index);
        }
    }
}

fn fetch_clips(pixel: u32, draw: u32, index: u32) {
    if pages.is_first == 1u {
        paint[pixel * 2u] = vec4<u32>(0u);
    }
    let slot = slot_of(draws[draw].clip_page);
    if slot == ELSEWHERE || index >= draws[draw].clip_points {
        return;
    }
    let at = draws[draw].clip_word + index * 4u;
    paint[pixel * 2u] =
        vec4<u32>(word(slot, at), word(slot, at + 1u), word(slot, at + 2u), word(slot, at + 3u));
}

fn fetch_tangents(pixel: u32, draw: u32, index: u32) {
    if pages.is_first == 1u {
        paint[pixel * 2u + 1u] = vec4<u32>(0u);
    }
    let slot = slot_of(draws[draw].tangent_page);
    if slot != ELSEWHERE && index < draws[draw].tangent_points {
        paint[pixel * 2u + 1u].x = word(slot, draws[draw].tangent_word + index);
    }
}

fn fetch_position(pixel: u32, draw: u32, index: u32) {
    let slot = slot_of(draws[draw].position_page);
    if slot == ELSEWHERE {
        return;
    }
    let at = draws[draw].position_word + index * 2u;
    geometry[pixel].x = word(slot, at);
    geometry[pixel].y = word(slot, at + 1u);
}

// Fetches the residual bits: a word of 10-10-10 bits, or three numbers of 16 bits; zero without
// any.
fn fetch_residual(pixel: u32, draw: u32, index: u32) {
    if draws[draw].residual_page == NO_PAGE {
        if pages.is_first == 1u {
            geometry[pixel].z = 0u;
            geometry[pixel].w = 0u;
        }
        return;
    }
    let slot = slot_of(draws[draw].residual_page);
    if slot == ELSEWHERE {
        return;
    }
    let first = draws[draw].residual_word;
    var low: vec3<u32>;
    if draws[draw].shift <= 10u {
        let bits = word(slot, first + index);
        low = (vec3<u32>(bits) >> vec3<u32>(0u, 10u, 20u)) & vec3<u32>(1023u);
    } else {
        // Six bytes a point: points of odd index begin in the middle of a word.
        let at = first + index * 3u / 2u;
        let pair = vec2<u32>(word(slot, at), word(slot, at + 1u));
        let even = vec3<u32>(pair.x & 0xffffu, pair.x >> 16u, pair.y & 0xffffu);
        let odd = vec3<u32>(pair.x >> 16u, pair.y & 0xffffu, pair.y >> 16u);
        low = select(even, odd, (index & 1u) == 1u);
    }
    geometry[pixel].z = low.x | (low.y << 16u);
    geometry[pixel].w = low.z;
}

fn fetch_colour(pixel: u32, draw: u32, index: u32) {
    let slot = slot_of(draws[draw].colour_page);
    if slot == ELSEWHERE || index >= draws[draw].colour_points {
        return;
    }
    let place = colour_place(draws[draw].colour_kind, index);
    let first = draws[draw].colour_word + place.x;
    paint[pixel].y = word(slot, first) >> place.y;
    if place.z == 1u {
        paint[pixel].z = word(slot, first + 1u);
    }
    paint[pixel].x = draw | HAS_COLOUR;
}
