// Adds each point of a pixel's front surface to the sums of the pixel (schuetz2021). A workgroup a
// chunk. Twin: crates/render/src/passes/average.rs.

// include common/points.wgsl
// include common/lookup.wgsl
// include common/colour.wgsl
// include common/facing.wgsl
// include common/average.wgsl

// Whether pixels carry normals.
override NORMALS: bool = false;
// Whether colours come from the colour plane.
override COLOURS: bool = true;

// A whole page.
@group(0) @binding(7) var<storage, read> colours: array<u32>;
@group(0) @binding(8) var<storage, read_write> sums: array<atomic<u32>>;
@group(0) @binding(9) var<uniform> lookup: Lookup;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let item = group.x + group.y * groups.x;
    if item >= arrayLength(&work) {
        return;
    }
    let chunk = chunks[work[item]];
    let draw = draws[chunk.draw];
    let points = min(chunk.points, CHUNK_POINTS);
    for (var i = thread; i < points; i += 256u) {
        add(chunk.draw, draw, chunk.first + i);
    }
}

// Least reach, so that a quotient by it is not NaN.
const LEAST_REACH: f32 = 1.1754944e-38;

fn float_at(word: u32) -> f32 {
    return bitcast<f32>(atomicLoad(&sums[word]));
}

// Adds point `index` of the node in row `row`, if it is in the front surface.
fn add(row: u32, draw: Draw, index: u32) {
    let seen = see(draw, index);
    if !is_inside(seen) {
        return;
    }
    let at = min(vec2<u32>(seen.at), vec2<u32>(frame.width, frame.height) - 1u);
    let first = (at.y * frame.width + at.x) * words();
    let slope = vec2<f32>(float_at(first + AT_SLOPE), float_at(first + AT_SLOPE + 1u));
    let plane = float_at(first + AT_SCALE) + dot(slope, seen.at - vec2<f32>(at) - 0.5);
    let behind = plane - frame.focal_px / seen.depth;
    let reach = float_at(first + AT_REACH);
    // The plane is infinite in pixels without a winning point.
    if is_infinite(plane) || behind > reach || is_dropped(row, draw, index, seen) {
        return;
    }
    let offset = offset_at(draw, index);
    let paint = paint_of(row, draw, index);
    let coordinate = coordinate_of(draw.box_min + offset, offset);
    let colour = whole(colour_of(paint, coordinate, bitcast<u32>(seen.depth)));
    atomicAdd(&sums[first + AT_COUNT], 1u);
    for (var k = 0u; k < 3u; k += 1u) {
        atomicAdd(&sums[first + AT_COLOUR + k], colour[k]);
    }
    if NORMALS {
        let normal = whole(to_eye(paint.w, seen.from_eye) * 0.5 + 0.5);
        for (var k = 0u; k < 3u; k += 1u) {
            atomicAdd(&sums[first + AT_NORMAL + k], normal[k]);
        }
    } else {
        let depth = whole(vec3<f32>(behind / max(reach, LEAST_REACH)));
        atomicAdd(&sums[first + AT_DEPTH], depth.x);
    }
}

// Numbers from 0 to 1 as whole numbers of steps.
fn whole(value: vec3<f32>) -> vec3<u32> {
    return vec3<u32>(clamp(value, vec3<f32>(0.0), vec3<f32>(1.0)) * STEPS + 0.5);
}

// The words of a point, as `gather/fetch` writes them.
fn paint_of(row: u32, draw: Draw, index: u32) -> vec4<u32> {
    var paint = vec4<u32>(row, 0u, 0u, NO_NORMAL);
    if COLOURS && draw.colour_page != NO_PAGE && index < draw.colour_points {
        let place = colour_place(draw.colour_kind, index);
        let word = draw.colour_word + place.x;
        paint.x = row | HAS_COLOUR;
        paint.y = colours[word] >> place.y;
        if place.z == 1u {
            paint.z = colours[word + 1u];
        }
    }
    if draw.normal_page != NO_PAGE && index < draw.normal_points && (NORMALS || COLOUR == BY_NORMAL) {
        paint.w = normals[draw.normal_word + index];
    }
    return paint;
}

// A normal in view space, turned to the eye unless back faces are culled.
fn to_eye(code: u32, from_eye: vec3<f32>) -> vec3<f32> {
    let world = normal_of(code);
    let n = select(world, towards_eye(world, from_eye), frame.cull_back_faces == 0u);
    return vec3<f32>(dot(frame.right, n), dot(frame.up, n), dot(frame.back, n));
}
