// Boxes of a level of the implicit tree: of the leaves' discs, or of the nodes of the level below.
// One thread makes the box of one child of a node. Twin: crates/trace/src/accel.

// include common/discs.wgsl

struct Level {
    // First node of the level, and first of the level below.
    first: u32,
    below: u32,
    // Number of children: of leaves, or of the nodes of the level below.
    children: u32,
    // Number of nodes of the level.
    nodes: u32,
    // Number of discs.
    discs: u32,
    // Whether children are leaves.
    has_leaves: u32,
    unused: u32,
    unused_2: u32,
}

// Coordinates that no disc has: an empty box.
const BEYOND: f32 = 1e30;

@group(0) @binding(0) var<uniform> level: Level;
@group(0) @binding(1) var<storage, read> discs: array<vec4<f32>>;
// Twelve `vec4<f32>` a node, as single numbers.
@group(0) @binding(2) var<storage, read_write> boxes: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let child = id.x + id.y * groups.x * 256u;
    if child >= level.nodes * 8u {
        return;
    }
    var low = vec3<f32>(BEYOND);
    var high = vec3<f32>(-BEYOND);
    if child < level.children {
        if level.has_leaves == 1u {
            for (var i = child * 8u; i < min(child * 8u + 8u, level.discs); i++) {
                let disc = discs[2u * i];
                // No ray meets a disc without extent.
                if !(disc.w > 0.0) {
                    continue;
                }
                let normal = stored_normal(i);
                let half = sqrt(max(vec3<f32>(1.0) - normal * normal, vec3<f32>(0.0))) * disc.w;
                low = min(low, disc.xyz - half);
                high = max(high, disc.xyz + half);
            }
        } else {
            let below = (level.below + child) * 48u;
            for (var k = 0u; k < 8u; k++) {
                let at = below + k;
                low = min(low, vec3<f32>(boxes[at], boxes[at + 8u], boxes[at + 16u]));
                high = max(high, vec3<f32>(boxes[at + 24u], boxes[at + 32u], boxes[at + 40u]));
            }
        }
    }
    let at = (level.first + child / 8u) * 48u + child % 8u;
    boxes[at] = low.x;
    boxes[at + 8u] = low.y;
    boxes[at + 16u] = low.z;
    boxes[at + 24u] = high.x;
    boxes[at + 32u] = high.y;
    boxes[at + 40u] = high.z;
}
