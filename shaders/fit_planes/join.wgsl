// Finds the nearest point of each square of the wider levels among those of the finest level. Twin:
// crates/render/src/passes/fit_planes.rs.

// include common/frame.wgsl
// include common/squares.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
// Nearest points (fit_planes/nearest.wgsl), level by level.
@group(0) @binding(1) var<storage, read_write> nears: array<vec2<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let finest = squares();
    let square = square_of(id.x + id.y * groups.x * 256u + finest.x * finest.y);
    if square.level >= LEVELS {
        return;
    }
    let joined = 1u << square.level;
    let end = min((square.place + 1u) * joined, finest);
    var nearest = vec2<u32>(0u);
    for (var y = square.place.y * joined; y < end.y; y += 1u) {
        for (var x = square.place.x * joined; x < end.x; x += 1u) {
            let own = nears[y * finest.x + x];
            if bitcast<f32>(own.x) > bitcast<f32>(nearest.x) {
                nearest = own;
            }
        }
    }
    nears[square.index] = nearest;
}
