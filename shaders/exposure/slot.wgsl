// Stores the slot of the scan of each winning point, from the words that gather/fetch.wgsl has
// written and before gather turns them into colours. Twin: crates/render/src/passes/exposure.rs.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/exposure.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> paint: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> slots: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height || hits[pixel].y == NO_HIT {
        return;
    }
    let has_colour = (paint[pixel].x & HAS_COLOUR) != 0u;
    let scan = select(0u, paint[pixel].y >> 24u, has_colour);
    slots[pixel] = 1u + scan % (SLOTS - 1u);
}
