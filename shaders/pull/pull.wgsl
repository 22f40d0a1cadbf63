// Pull (marroquim2007 section 3.2): averages a level of the pyramid into the next coarser one. Twin:
// crates/render/src/pull.rs, which says how.

// include common/level.wgsl

// Whether pixels carry normals.
override NORMALS: bool;

@group(0) @binding(0) var<uniform> fine: LevelShape;
@group(0) @binding(1) var<uniform> coarse: LevelShape;
@group(0) @binding(2) var<storage, read> fine_front: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> fine_tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> fine_depth: array<f32>;
@group(0) @binding(5) var<storage, read> fine_normal: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> coarse_front: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> coarse_tint: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> coarse_depth: array<f32>;
@group(0) @binding(9) var<storage, read_write> coarse_normal: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= coarse.width || id.y >= coarse.height {
        return;
    }
    let out = id.y * coarse.width + id.x;
    let first = id.y * 2u * fine.width + id.x * 2u;
    let has_right = id.x * 2u + 1u < fine.width;
    let has_lower = id.y * 2u + 1u < fine.height;
    var fronts = array<vec4<f32>, 4>(fine_front[first], invalid(), invalid(), invalid());
    if has_right {
        fronts[1] = fine_front[first + 1u];
    }
    if has_lower {
        fronts[2] = fine_front[first + fine.width];
    }
    if has_right && has_lower {
        fronts[3] = fine_front[first + fine.width + 1u];
    }
    var nearest = invalid();
    for (var k = 0u; k < 4u; k++) {
        if is_valid(fronts[k]) && (!is_valid(nearest) || fronts[k].x < nearest.x) {
            nearest = fronts[k];
        }
    }
    if !is_valid(nearest) {
        coarse_front[out] = nearest;
        // No normal, for those who look for one.
        if NORMALS {
            coarse_normal[out] = vec4<f32>(0.0);
        }
        return;
    }
    let quarter = fine.edge_px * 0.5;
    var depth_max = nearest.y;
    var displaced = vec2<f32>(0.0);
    var tint = vec4<f32>(0.0);
    var depth = 0.0;
    var normal = vec4<f32>(0.0);
    var count = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let front = fronts[k];
        if !is_valid(front) || front.x > nearest.y {
            continue;
        }
        let right = k & 1u;
        let down = k >> 1u;
        let pixel = first + right + down * fine.width;
        depth_max = max(depth_max, front.y);
        // From the finer centre to the coarser: half a finer pixel right and down, or back.
        let to_coarser = vec2<f32>(1.0 - 2.0 * f32(right), 1.0 - 2.0 * f32(down)) * quarter;
        displaced += front.zw + to_coarser;
        tint += fine_tint[pixel];
        depth += fine_depth[pixel];
        if NORMALS {
            normal += fine_normal[pixel];
        }
        count += 1.0;
    }
    let share = 1.0 / count;
    coarse_front[out] = vec4<f32>(nearest.x, depth_max, displaced * share);
    coarse_tint[out] = tint * share;
    coarse_depth[out] = depth * share;
    if NORMALS {
        coarse_normal[out] = normal * share;
    }
}
