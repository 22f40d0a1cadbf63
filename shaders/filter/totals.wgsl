// Nested windows: sums of the light of all pixels that count before and after the
// filter, by as many groups as there are parts of the sum. Twin: crates/trace/src/filter/nested.rs.

// include common/usable.wgsl

@group(0) @binding(0) var<storage, read> guides: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> light: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> filtered: array<vec4<f32>>;
// For each group the sums before and after the filter.
@group(0) @binding(3) var<storage, read_write> totals: array<vec4<f32>>;

const LANES: u32 = 256u;

var<workgroup> before: array<vec4<f32>, 256>;
var<workgroup> after: array<vec4<f32>, 256>;

@compute @workgroup_size(256)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    var sums = array<vec4<f32>, 2>();
    for (var pixel = group.x * LANES + lane; pixel < arrayLength(&light); pixel += groups.x * LANES) {
        if is_usable(light[pixel], guides[pixel]) {
            sums[0] += light[pixel];
            sums[1] += filtered[pixel];
        }
    }
    before[lane] = sums[0];
    after[lane] = sums[1];
    workgroupBarrier();
    for (var step = LANES / 2u; step > 0u; step >>= 1u) {
        if lane < step {
            before[lane] += before[lane + step];
            after[lane] += after[lane + step];
        }
        workgroupBarrier();
    }
    if lane == 0u {
        totals[2u * group.x] = before[0];
        totals[2u * group.x + 1u] = after[0];
    }
}
