// Pull (marroquim2007, section 3.2): averages a level of the pyramid into the next coarser one.
// Twin: crates/render/src/passes/pull.rs, which explains the method.

// include common/frame.wgsl
// include common/level.wgsl
// include common/tangent.wgsl
// include common/plane.wgsl
// include common/set_plane.wgsl

// Square of the length from which a mean of normals is one.
const AGREE2: f32 = 0.16;

@group(0) @binding(0) var<uniform> fine: LevelShape;
@group(0) @binding(1) var<uniform> coarse: LevelShape;
@group(0) @binding(2) var<storage, read> fine_front: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> fine_tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> fine_depth: array<f32>;
@group(0) @binding(5) var<storage, read> from_planes: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> coarse_front: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> coarse_tint: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> coarse_depth: array<f32>;
@group(0) @binding(9) var<storage, read_write> to_planes: array<vec2<f32>>;
@group(0) @binding(10) var<uniform> frame: Frame;

// The four finer pixels of a coarser one: their fronts, with displacements to the coarser pixel's
// centre, and which of them take part.
var<private> pixels: array<u32, 4>;
var<private> fronts: array<vec4<f32>, 4>;
var<private> kept: array<bool, 4>;
// Factor of each pixel's depths from its ellipse's centre to where depths are compared.
var<private> factors: array<f32, 4>;

// One over the number of pixels that take part.
fn share() -> f32 {
    var count = 0.0;
    for (var k = 0u; k < 4u; k++) {
        count += select(0.0, 1.0, kept[k]);
    }
    return 1.0 / count;
}

// Mean displacement of the pixels that take part.
fn mean_displacement() -> vec2<f32> {
    var sum = vec2<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        if kept[k] {
            sum += fronts[k].zw;
        }
    }
    return sum * share();
}

// Sets the factors of depths: `centre` is the centre of the coarser pixel, `middle` the
// displacement of the place where depths are compared from it.
fn set_factors(centre: vec2<f32>, middle: vec2<f32>) {
    for (var k = 0u; k < 4u; k++) {
        factors[k] = 1.0;
        if PLANE > 0u && kept[k] {
            let displaced = fronts[k].zw;
            factors[k] = moved(plane_of(pixels[k]), centre - displaced, displaced - middle);
        }
    }
}

// Drops the pixels whose depth interval does not meet that of the frontmost. Whether it drops any.
fn keep_frontmost() -> bool {
    var least = infinity();
    var limit = least;
    var is_first = true;
    for (var k = 0u; k < 4u; k++) {
        let depth = fronts[k].x * factors[k];
        if kept[k] && (is_first || depth < least) {
            least = depth;
            limit = fronts[k].y * factors[k];
            is_first = false;
        }
    }
    var drops = false;
    for (var k = 0u; k < 4u; k++) {
        if kept[k] && fronts[k].x * factors[k] > limit {
            kept[k] = false;
            drops = true;
        }
    }
    return drops;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= coarse.width || id.y >= coarse.height {
        return;
    }
    let out = id.y * coarse.width + id.x;
    let first = id.y * 2u * fine.width + id.x * 2u;
    let has_right = id.x * 2u + 1u < fine.width;
    let has_lower = id.y * 2u + 1u < fine.height;
    let quarter = fine.edge_px * 0.5;
    var is_empty = true;
    for (var k = 0u; k < 4u; k++) {
        let right = k & 1u;
        let down = k >> 1u;
        kept[k] = false;
        if (right == 1u && !has_right) || (down == 1u && !has_lower) {
            continue;
        }
        pixels[k] = first + right + down * fine.width;
        let front = fine_front[pixels[k]];
        if is_valid(front) {
            // From the finer pixel's centre to the coarser one's: half a finer pixel along each
            // axis.
            let to_coarser = vec2<f32>(1.0 - 2.0 * f32(right), 1.0 - 2.0 * f32(down)) * quarter;
            fronts[k] = front + vec4<f32>(0.0, 0.0, to_coarser);
            kept[k] = true;
            is_empty = false;
        }
    }
    if is_empty {
        coarse_front[out] = invalid();
        // A zero vector means that there is no normal.
        set_plane(out, vec4<f32>(0.0));
        return;
    }
    let centre = (vec2<f32>(id.xy) + 0.5) * coarse.edge_px;
    var middle = mean_displacement();
    set_factors(centre, middle);
    if keep_frontmost() {
        middle = mean_displacement();
        set_factors(centre, middle);
    }
    var depth_min = infinity();
    var depth_max = 0.0;
    var is_first = true;
    var tint = vec4<f32>(0.0);
    var depth = 0.0;
    var plane = vec4<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        if !kept[k] {
            continue;
        }
        let pixel = pixels[k];
        let least = fronts[k].x * factors[k];
        depth_min = select(min(depth_min, least), least, is_first);
        depth_max = max(depth_max, fronts[k].y * factors[k]);
        is_first = false;
        tint += fine_tint[pixel];
        depth += fine_depth[pixel] * factors[k];
        if PLANE > 0u {
            plane += plane_of(pixel);
        }
    }
    let part = share();
    coarse_front[out] = vec4<f32>(depth_min, depth_max, middle);
    coarse_tint[out] = tint * part;
    coarse_depth[out] = depth * part;
    var mean = plane * part;
    if PLANE == NORMAL && dot(mean.xyz, mean.xyz) < AGREE2 {
        mean = vec4<f32>(0.0, 0.0, 0.0, mean.w);
    }
    set_plane(out, mean);
}
