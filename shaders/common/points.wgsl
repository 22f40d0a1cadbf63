// Reads points from the pages and projects them to the picture. The work of a dispatch is a list of
// chunks whose planes are in the pages that are bound. Host: `GpuCut::bind` in
// crates/render/src/gpu/memory/cut.rs. Twins: crates/render/src/inputs/camera.rs,
// passes/project.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/normal.wgsl
// include common/thinning.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> draws: array<Draw>;
@group(0) @binding(2) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(3) var<storage, read> work: array<u32>;
// A whole page each.
@group(0) @binding(4) var<storage, read> positions: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> residuals: array<u32>;
@group(0) @binding(6) var<storage, read> normals: array<u32>;

// Whether points whose normal faces away from the eye are culled.
override CULLS_BACK_FACES: bool = false;
// Whether points that a filter has marked are hidden.
override HIDES_POINTS: bool = false;
// Whether points that are closer together than asked are left out.
override THINS_POINTS: bool = false;

// A projected point.
struct Seen {
    // Place in the picture, pixels.
    at: vec2<f32>,
    // Linear eye depth.
    depth: f32,
    // Position against the eye, in the file's unit, along the world's axes.
    from_eye: vec3<f32>,
}

// Offset of a point in its node's box, steps.
fn offset_at(draw: Draw, index: u32) -> vec3<u32> {
    let hot = positions[(draw.position_word >> 1u) + index];
    let q = hot_of(hot) << vec3<u32>(draw.shift);
    if draw.residual_page == NO_PAGE {
        return q;
    }
    if draw.shift <= 10u {
        let low = residuals[draw.residual_word + index];
        return q | vec3<u32>(low & 1023u, (low >> 10u) & 1023u, (low >> 20u) & 1023u);
    }
    // Six bytes a point: points of odd index begin in the middle of a word.
    let word = draw.residual_word + ((index * 3u) >> 1u);
    let a = residuals[word];
    let b = residuals[word + 1u];
    if (index & 1u) == 0u {
        return q | vec3<u32>(a & 0xffffu, a >> 16u, b & 0xffffu);
    }
    return q | vec3<u32>(a >> 16u, b & 0xffffu, b >> 16u);
}

// Projects a point.
fn see(draw: Draw, index: u32) -> Seen {
    let offset = offset_at(draw, index);
    let steps = steps_from_anchor(draw.base_high, draw.base_low, draw.bias_steps, offset);
    let place = steps * frame.step;
    let depth = frame.anchor_depth - dot(frame.back, place);
    let scale = frame.focal_px / select(depth, frame.anchor_depth, frame.is_parallel == 1u);
    let at = placed(vec2<f32>(dot(frame.right, place) * scale, -dot(frame.up, place) * scale));
    return Seen(at, depth, place - frame.back * frame.anchor_depth);
}

// Whether a point is in the picture; NaN is outside.
fn is_inside(seen: Seen) -> bool {
    let in_x = seen.at.x >= 0.0 && seen.at.x < f32(frame.width);
    let in_y = seen.at.y >= 0.0 && seen.at.y < f32(frame.height);
    return in_x && in_y && seen.depth >= frame.near && !is_infinite(seen.depth);
}

// Whether a point's normal faces the eye, or the point has none.
fn faces_eye(draw: Draw, index: u32, from_eye: vec3<f32>) -> bool {
    if index >= draw.normal_points {
        return true;
    }
    return dot(normal_of(normals[draw.normal_word + index]), from_eye) <= 0.0;
}

// Whether a point of the node in a row is hidden by a filter, left out as too close to others, or
// culled by its normal.
fn is_dropped(row: u32, draw: Draw, index: u32, seen: Seen) -> bool {
    if HIDES_POINTS && (positions[(draw.position_word >> 1u) + index].y >> 24u) != 0u {
        return true;
    }
    if THINS_POINTS && is_left_out(row, index, seen.depth) {
        return true;
    }
    return CULLS_BACK_FACES && !faces_eye(draw, index, seen.from_eye);
}
