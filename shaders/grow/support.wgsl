// Makes dots of wide points that too few others support as a surface. Twin: `supports` in
// crates/render/src/passes/split.rs.

// include common/frame.wgsl
// include common/hits.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/normal.wgsl

const CELL_PX: u32 = 4u;
// Points that make a surface of a point with a normal.
const SUPPORTERS: u32 = 3u;
// Distance up to which points support a surface, and their greatest distance from its plane, over
// the distance of neighbours; least cosine between their normals.
const SUPPORT_REACH: f32 = 2.5;
const SUPPORT_OFF: f32 = 0.4;
const SUPPORT_COS: f32 = 0.8;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> hits: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> draws: array<Draw>;
@group(0) @binding(3) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> paint: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> cells: array<u32>;
@group(0) @binding(6) var<storage, read_write> dots: array<vec2<u32>>;
// The first is the number of pixels with a point.
@group(0) @binding(7) var<storage, read_write> counts: array<atomic<u32>>;

// Position of a pixel's point against the anchor.
fn place_at(pixel: u32) -> vec3<f32> {
    let draw = &draws[paint[pixel].x & ~HAS_COLOUR];
    let offset = offset_of(geometry[pixel], (*draw).shift);
    let steps =
        steps_from_anchor((*draw).base_high, (*draw).base_low, (*draw).bias_steps, offset);
    return steps * frame.step;
}

// Whether enough points support a surface at `pixel`, whose neighbours are `apart_px` pixels away:
// fewer by the share of the cells around that lie outside the picture.
fn has_support(pixel: u32, apart_px: f32) -> bool {
    let columns = i32((frame.width + CELL_PX - 1u) / CELL_PX);
    let rows = i32((frame.height + CELL_PX - 1u) / CELL_PX);
    let steps = i32(apart_px * SUPPORT_REACH / f32(CELL_PX)) + 1;
    let cell = vec2<i32>(vec2<u32>(pixel % frame.width, pixel / frame.width) / CELL_PX);
    let low = max(cell - steps, vec2<i32>(0));
    let high = min(cell + steps, vec2<i32>(columns, rows) - 1);
    let place = place_at(pixel);
    let normal = normal_of(paint[pixel].w);
    let apart = apart_px * bitcast<f32>(hits[pixel].y) / frame.focal_px;
    let reach = apart * SUPPORT_REACH;
    let off = apart * SUPPORT_OFF;
    var count = 0u;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            let other = cells[u32(y * columns + x)];
            if other == NO_HIT || other == pixel {
                continue;
            }
            let way = place_at(other) - place;
            if dot(way, way) > reach * reach {
                continue;
            }
            let is_level = abs(dot(normal, way)) <= off;
            if is_level && abs(dot(normal, normal_of(paint[other].w))) >= SUPPORT_COS {
                count += 1u;
            }
        }
    }
    let sides = vec2<u32>(high - low + 1);
    let all = u32(2 * steps + 1);
    return count * all * all >= SUPPORTERS * sides.x * sides.y;
}

@compute @workgroup_size(256)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = id.x + id.y * groups.x * 256u;
    if pixel >= frame.width * frame.height {
        return;
    }
    let wide = dots[pixel];
    if wide.y != NO_HIT || wide.x == NO_HIT {
        return;
    }
    if !has_support(pixel, bitcast<f32>(wide.x)) {
        dots[pixel] = hits[pixel];
        hits[pixel] = vec2<u32>(NO_HIT);
        atomicAdd(&counts[0], 1u);
    } else {
        dots[pixel] = vec2<u32>(NO_HIT);
    }
}
