// Lets go of pixels that trimming has left alone, and makes the picture's depth: that of what each pixel shows. Twin:
// `Waves::left_alone` in crates/render/src/trim.rs.

// include common/frame.wgsl
// include common/limit.wgsl

// A pixel is left alone where so many of its eight neighbours show what lies behind it, and its radius has so many
// pixels; not beside what went from a line.
const ALONE: u32 = 7u;
const ALONE_RADIUS_PX: f32 = 3.0;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> depth: array<f32>;
@group(0) @binding(3) var<storage, read> tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> sources_after: array<u32>;
@group(0) @binding(5) var<storage, read_write> settled: array<f32>;

// include common/source.wgsl

fn is_alone(at: vec2<u32>, pixel: u32, beyond: f32) -> bool {
    if any(at == vec2<u32>(0u)) || any(at + 1u == vec2<u32>(frame.width, frame.height)) {
        return false;
    }
    if !(tint[pixel].w >= ALONE_RADIUS_PX) {
        return false;
    }
    var behind = 0u;
    for (var i = 0u; i < 9u; i++) {
        let beside = pixel + i / 3u * frame.width + i % 3u - frame.width - 1u;
        if sources[beside] > PIXEL_MASK {
            return false;
        }
        if depth[shown(beside)] > beyond {
            behind++;
        }
    }
    return behind >= ALONE;
}

// Of a pixel found so far and one beside it, the one that went and shows what is farther; the pixel itself for none.
fn farther(found: u32, beside: u32, pixel: u32) -> u32 {
    if sources[beside] == 0u {
        return found;
    }
    let is_farther = found == pixel || depth[shown(beside)] > depth[shown(found)];
    return select(found, beside, is_farther);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let beyond = limit(depth[pixel], pixel);
    var after = pixel;
    if sources[pixel] == 0u && is_alone(id.xy, pixel, beyond) {
        after = farther(after, pixel - 1u, pixel);
        after = farther(after, pixel + 1u, pixel);
        after = farther(after, pixel - frame.width, pixel);
        after = farther(after, pixel + frame.width, pixel);
        // What it shows itself is not behind it.
        if !(depth[shown(after)] > beyond) {
            after = pixel;
        }
    }
    sources_after[pixel] = sources[after];
    settled[pixel] = depth[shown(after)];
}
