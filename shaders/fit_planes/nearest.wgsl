// Finds the nearest point of each square of the frame buffer. Twin:
// crates/render/src/passes/fit_planes.rs.

// include common/frame.wgsl
// include common/hits.wgsl
// include common/squares.wgsl

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> hits: array<vec2<u32>>;
// Bits of the inverse depth of the nearest point, or zero without a point; and its pixel, 16 bits
// an axis.
@group(0) @binding(2) var<storage, read_write> nears: array<vec2<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let square = id.x + id.y * groups.x * 256u;
    let all = squares();
    if square >= all.x * all.y {
        return;
    }
    let corner = vec2<u32>(square % all.x, square / all.x) * SQUARE_PX;
    let end = min(corner + SQUARE_PX, vec2<u32>(frame.width, frame.height));
    var near = 0.0;
    var place = 0u;
    for (var y = corner.y; y < end.y; y += 1u) {
        // Within a row depths themselves are compared, as in the twin.
        var least = NO_HIT;
        var at = 0u;
        for (var x = corner.x; x < end.x; x += 1u) {
            let depth = hits[y * frame.width + x].y;
            if depth < least {
                least = depth;
                at = x;
            }
        }
        let row = 1.0 / bitcast<f32>(least);
        if least != NO_HIT && row > near {
            near = row;
            place = at | (y << 16u);
        }
    }
    nears[square] = vec2<u32>(bitcast<u32>(near), place);
}
