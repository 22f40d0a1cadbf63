// Makes splats of the points of a batch (zwicker2004, sections 4.1 to 4.4 and 5), and counts the
// splats that touch each tile. Twins: crates/render/src/ewa/place.rs, splat.rs, mapping.rs, clip.rs
// and shape.rs, which explain the method and the constants.

// include common/frame.wgsl
// include common/draws.wgsl
// include common/place.wgsl
// include common/lookup.wgsl
// include common/colour.wgsl
// include common/facing.wgsl
// include common/octree.wgsl
// include common/radius.wgsl
// include common/splats.wgsl
// include common/squares.wgsl
// include common/tilt_splat.wgsl

// Whether the cloud has normals.
override NORMALS: bool = false;
// Whether points that a filter has marked are hidden.
override HIDES_POINTS: bool = false;
// Whether splats are clipped.
override CLIPS: bool = false;
// Whether splats have shapes of their own.
override TANGENTS: bool = false;
// Whether splats are tilted as fitted planes, which `clips` holds then.
override FITTED: bool = false;

// Constants of splat.rs.
const REACH_MAX: f32 = 0.7;
const CONDITION_MAX: f32 = 1e6;
const EXACT_REACH: f32 = 0.02;
const BACK: f32 = 1.0;
const AMPLITUDE_MIN: f32 = 1e-12;
// Sine between plane and line of sight below which rounding decides what is seen (mapping.rs).
const SINE_MIN: f32 = 1e-6;
// Square of the sine between a long axis and the normal below which the axis gives no direction.
const AXIS_SINE_MIN: f32 = 1e-4;
// Greatest radius of points without a normal among points with normals, pixels.
const DOT_RADIUS_PX: f32 = 5.0;
// Constants of crates/points/src/tangents.rs.
const SHAPE_ROOM: f32 = 1.1;
const SHAPE_LEAST: f32 = 0.7;
const SHAPE_COARSER: f32 = 2.0;
// Margin of boxes for rounding, pixels.
const MARGIN: f32 = 0.01;
// Half the side of an octagon around a unit circle.
const HALF: f32 = 0.41422;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> lookup: Lookup;
@group(0) @binding(2) var<uniform> batch: Batch;
@group(0) @binding(3) var<storage, read> draws: array<Draw>;
@group(0) @binding(4) var<storage, read> octree: array<OctreeCell>;
@group(0) @binding(5) var<storage, read> geometry: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> paint: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> splats: array<Splat>;
// First pixel and one past the last, 16 bits each: x in the first word, y in the second.
@group(0) @binding(8) var<storage, read_write> boxes: array<vec2<u32>>;
@group(0) @binding(9) var<storage, read_write> cursors: array<atomic<u32>>;
// Two rows a point. Input: the words of its clip lines in the file, and of its shape. Output: lines
// over pixels from the picture's centre; the last word of the first row is the part that is kept.
// If planes are fitted: the bits of the plane of each square (fit_planes/fit.wgsl).
@group(0) @binding(10) var<storage, read_write> clips: array<vec4<u32>>;

// Plane of a square.
fn plane_at(square: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(clips[square]);
}

struct Placed {
    splat: Splat,
    // Left, top, right, bottom; empty if the splat is not drawn.
    bounds: vec4<u32>,
}

// First pixel whose centre is right of and below a place, clamped to a picture of this size.
fn past(place: vec2<f32>, size: vec2<f32>) -> vec2<u32> {
    return vec2<u32>(clamp(place + 0.5, vec2<f32>(0.0), size));
}

// The box of pixels between two places; empty if a coordinate is NaN.
fn clip(low: vec2<f32>, high: vec2<f32>) -> vec4<u32> {
    if !(is_number(low.x) && is_number(low.y) && is_number(high.x) && is_number(high.y)) {
        return vec4<u32>(0u);
    }
    let size = vec2<f32>(f32(frame.width), f32(frame.height));
    return vec4<u32>(past(low - MARGIN, size), past(high + MARGIN, size));
}

// Middle of the pixels of the whole picture between two places.
fn middle_of(low: vec2<f32>, high: vec2<f32>) -> vec2<f32> {
    let size = (frame.centre_px + frame.origin_px) * 2.0;
    let first = past(low + frame.origin_px - MARGIN, size);
    let last = past(high + frame.origin_px + MARGIN, size);
    return (vec2<f32>(first) + vec2<f32>(last)) * 0.5 - frame.origin_px;
}

fn is_empty(box: vec4<u32>) -> bool {
    return any(box.xy >= box.zw);
}

fn all_finite(v: vec4<f32>) -> bool {
    return !(is_infinite(v.x) || is_infinite(v.y) || is_infinite(v.z) || is_infinite(v.w));
}

// Box of a splat in the picture that cannot be drawn.
const NOT_DRAWN: vec4<u32> = vec4<u32>(DROPPED, 0u, 0u, 0u);

// The splat, with the box NOT_DRAWN if a coefficient is not finite.
fn checked(splat: Splat, box: vec4<u32>) -> Placed {
    let fine = all_finite(splat.a) && all_finite(splat.b) && all_finite(splat.c) && splat.c.w != 0.0;
    return Placed(splat, select(NOT_DRAWN, box, fine));
}

// Growth of the depth of a splat that is moved back along its line of sight.
fn back_of(p: vec3<f32>, radius: f32) -> f32 {
    return BACK * radius * max(abs(p.z) / length(p), 0.1);
}

// A splat as an ellipse in the picture.
fn ellipse(p: vec3<f32>, t_a: vec3<f32>, t_b: vec3<f32>, radius: f32) -> Placed {
    // Equation 4, recentred.
    let inverse = 1.0 / p.z;
    let slope = p.xy * inverse;
    let focal = frame.focal_px * inverse;
    let a = vec3<f32>((t_a.xy - slope * t_a.z) * focal, t_a.z * inverse);
    let b = vec3<f32>((t_b.xy - slope * t_b.z) * focal, t_b.z * inverse);
    let lengths = (length(t_a) * focal) * (length(t_b) * focal) * sqrt(dot(slope, slope) + 1.0);
    let area = a.x * b.y - a.y * b.x;
    let depths = a.z * a.z + b.z * b.z;
    let discriminant = 1.0 - depths;
    // Equation 7.
    let middle = (a.xy * a.z + b.xy * b.z) * (-1.0 / discriminant);
    // Equations 10 and 11.
    let d = 1.0 / discriminant;
    let xy = (a.x * a.y + b.x * b.y) * d + middle.x * middle.y;
    let kernel = (a.xy * a.xy + b.xy * b.xy) * d + middle * middle;
    let kernel_root = abs(area) * d * sqrt(d);
    // Equation 3.
    let h = batch.lowpass;
    let shape = kernel + h;
    let root = sqrt(kernel_root * kernel_root + h * (kernel.x + kernel.y) + h * h);
    let amplitude = max(kernel_root / root, AMPLITUDE_MIN);
    // Equations 8 and 9.
    let half = sqrt(shape) * 1.000002;
    let origin = placed(slope * frame.focal_px + middle);
    let box = clip(origin - half, origin + half);
    let condition = lengths / (abs(area) * max(discriminant, 0.0));
    if is_empty(box) {
        return Placed(Splat(), vec4<u32>(0u));
    }
    if !(condition >= 0.0 && condition < CONDITION_MAX) {
        return Placed(Splat(), NOT_DRAWN);
    }
    let along = 1.0 / sqrt(shape.y);
    let across = 1.0 / (root * along);
    let shear = xy * along / root;
    let reach = sqrt(depths);
    let grows = vec2<f32>(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z) / area * inverse;
    let back = back_of(p, radius);
    let signed = select(amplitude, -amplitude, reach > EXACT_REACH);
    return checked(Splat(
        vec4<f32>(origin, across, shear),
        vec4<f32>(along, signed, inverse / (1.0 + reach), inverse / (1.0 - reach)),
        vec4<f32>(inverse + dot(grows, middle), grows, inverse * back / (p.z + back)),
        vec4<u32>(0u),
    ), box);
}

// Makes the depths of an ellipse follow the fitted plane through its centre.
fn along_plane(splat: Splat, p: vec3<f32>, growth: vec2<f32>) -> Splat {
    let nearness = 1.0 / p.z;
    let slope = -(growth * nearness);
    let middle = splat.a.xy - placed(p.xy * (nearness * frame.focal_px));
    // The box of the ellipse, from its conic.
    let along = 1.0 / splat.b.x;
    let across = 1.0 / splat.a.z;
    let half = vec2<f32>(across * length(vec2<f32>(1.0, splat.a.w * along)), along);
    let reach = dot(abs(slope), half);
    let least = max(nearness - reach, nearness * (1.0 - REACH_MAX));
    var own = splat;
    own.b = vec4<f32>(splat.b.x, abs(splat.b.y), least, nearness + reach);
    own.c = vec4<f32>(nearness + dot(slope, middle), slope, splat.c.w);
    return own;
}

// Corner `k` of an octagon around a disc.
fn corner(p: vec3<f32>, a: vec3<f32>, b: vec3<f32>, k: u32) -> vec3<f32> {
    // (1, HALF), (HALF, 1), and so on around.
    let is_long = ((k + 1u) & 2u) == 0u;
    let x = select(HALF, 1.0, is_long) * select(1.0, -1.0, ((k + 6u) & 7u) < 4u);
    let y = select(1.0, HALF, is_long) * select(1.0, -1.0, (k & 7u) >= 4u);
    return p + a * x + b * y;
}

// Bits of the exponent of a number, and those of 1 twice.
const EXPONENT: u32 = 0x7f800000u;
const TWICE_ONE: u32 = 0x7f000000u;

// The power of two that brings a length to 1 to 2, so that products of lengths stay within `f32` in
// any unit; 0 of infinity.
fn to_one(length: f32) -> f32 {
    return bitcast<f32>(TWICE_ONE - min(bitcast<u32>(length) & EXPONENT, TWICE_ONE));
}

// A splat that is evaluated by rays, because its disc reaches the near plane or far in depth.
fn by_rays(p: vec3<f32>, a: vec3<f32>, b: vec3<f32>, radius: f32) -> Placed {
    // Bounds of the part of the disc beyond the near plane.
    var low = vec2<f32>(3e38);
    var high = vec2<f32>(-3e38);
    for (var k = 0u; k < 8u; k += 1u) {
        let start = corner(p, a, b, k);
        let next = corner(p, a, b, k + 1u);
        if start.z >= frame.near {
            let at = start.xy * (frame.focal_px / start.z);
            low = min(low, at);
            high = max(high, at);
        }
        if (start.z >= frame.near) != (next.z >= frame.near) {
            let cut = start + (next - start) * ((frame.near - start.z) / (next.z - start.z));
            let at = cut.xy * (frame.focal_px / frame.near);
            low = min(low, at);
            high = max(high, at);
        }
    }
    let least = low + frame.centre_px;
    let most = high + frame.centre_px;
    let box = clip(least, most);
    let unit = to_one(max(max(abs(p.x), abs(p.y)), abs(p.z)));
    let centre = p * unit;
    let normal = cross(a * unit, b * unit);
    let seen = dot(normal, centre);
    let sine = abs(seen) / (length(normal) * length(centre));
    if low.x > high.x || is_empty(box) {
        return Placed(Splat(), vec4<u32>(0u));
    }
    if !(sine >= SINE_MIN && sine < 2.0) {
        return Placed(Splat(), NOT_DRAWN);
    }
    let origin = middle_of(least, most);
    let place = origin - frame.centre_px;
    let u = row(cross(b * unit, centre) / seen * unit, place);
    let v = row(cross(centre, a * unit) / seen * unit, place);
    let z = row(normal / seen * unit, place);
    return checked(Splat(
        vec4<f32>(origin, u.xy),
        vec4<f32>(u.z, v),
        vec4<f32>(z.z, z.xy, -back_of(p, radius)),
        vec4<u32>(0u),
    ), box);
}

// A row of the inverse mapping, as a function of pixels from `place`.
fn row(n: vec3<f32>, place: vec2<f32>) -> vec3<f32> {
    let grows = n.xy / frame.focal_px;
    return vec3<f32>(grows, n.z + grows.x * place.x + grows.y * place.y);
}

// Greatest shift of the unit of a clip line (crates/points/src/clip.rs).
const CLIP_SHIFT_MAX: u32 = 22u;
// Constants of clip.rs.
const CLIP_FLAT: f32 = 0.1;
const CLIP_WIDER: f32 = 1.3;
const CLIP_STROKE: f32 = 0.5;
const CLIP_PAST: f32 = 1.0;

// Three signed numbers of 9 bits.
fn parts(word: u32) -> vec3<i32> {
    return bitcast<vec3<i32>>(vec3<u32>(word) << vec3<u32>(23u, 14u, 5u)) >> vec3<u32>(23u);
}

// A vector in view space: right, down and away from the eye.
fn in_view(world: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(frame.right, world), -dot(frame.up, world), -dot(frame.back, world));
}

// Coordinates of a point against the eye, from those against the anchor. In a parallel view the
// point is moved sideways, so that a pinhole projects it to its place in the parallel projection.
fn seen(place: vec3<f32>) -> vec3<f32> {
    let depth = place.z + frame.anchor_depth;
    let squeeze = select(1.0, depth / frame.anchor_depth, frame.is_parallel == 1u);
    return vec3<f32>(place.xy * squeeze, depth);
}

// The direction of a line through a point (`seen`).
fn seen_way(place: vec3<f32>, way: vec3<f32>) -> vec3<f32> {
    if frame.is_parallel == 1u {
        let depth = place.z + frame.anchor_depth;
        return vec3<f32>((way.xy * depth + place.xy * way.z) / frame.anchor_depth, way.z);
    }
    return way;
}

// A clip line of the file: a point and the vector to another point, which is zero if there is no
// line.
struct Line {
    c: vec3<f32>,
    e: vec3<f32>,
    keeps_right: bool,
}

// The clip line of two words of the file; `hot` is the point on the lattice without its residual
// bits.
fn line_of(words: vec2<u32>, hot: vec3<u32>) -> Line {
    let shifts = batch.grain + vec3<u32>(words.x >> 27u);
    if any(shifts > vec3<u32>(CLIP_SHIFT_MAX)) {
        return Line();
    }
    let along = parts(words.y) << shifts;
    let begin = ((hot >> shifts) + bitcast<vec3<u32>>(parts(words.x))) << shifts;
    let high = vec3<i32>(begin >> vec3<u32>(16u)) - batch.anchor_high;
    let low = vec3<i32>(begin & vec3<u32>(0xffffu)) - batch.anchor_low;
    let steps = vec3<f32>(high) * 65536.0 + vec3<f32>(low) - batch.anchor_rest;
    let from_anchor = in_view(steps * frame.step);
    let e = seen_way(from_anchor, in_view(vec3<f32>(along) * frame.step));
    return Line(seen(from_anchor), e, (words.y & 0x8000000u) != 0u);
}

// The line over homogeneous pixels, not negative where the splat is kept; zeros if there is no
// line.
fn clip_line(line: Line, p: vec3<f32>, normal: vec3<f32>, is_flat: bool) -> vec3<f32> {
    let plane = cross(line.c, line.e);
    let by_normal = (dot(normal, p) < 0.0) != line.keeps_right;
    let sign = select(1.0, -1.0, select(by_normal, dot(plane, p) < 0.0, is_flat));
    return in_pixels(vec3<f32>(plane.xy / frame.focal_px, plane.z) * sign);
}

// A line scaled so that it gives distances in pixels; zeros if it is no line on the picture.
fn in_pixels(line: vec3<f32>) -> vec3<f32> {
    let own = line * (1.0 / sqrt(dot(line.xy, line.xy)));
    let fine = is_number(own.x) && is_number(own.y) && is_number(own.z);
    return select(vec3<f32>(0.0), own, fine && !(is_infinite(own.x) || is_infinite(own.y) || is_infinite(own.z)));
}

// Computes the lines of a point from its words.
fn make_lines(i: u32, words: vec4<u32>, hot: vec3<u32>, p: vec3<f32>, normal: vec3<f32>) {
    let either = ((words.w & 0x10000000u) != 0u) && any(parts(words.w) != vec3<i32>(0));
    let is_flat = abs(dot(normal, p)) < CLIP_FLAT * length(p) && !either;
    var first = vec3<f32>(0.0);
    if any(normal != vec3<f32>(0.0)) {
        first = clip_line(line_of(words.xy, hot), p, normal, is_flat);
    }
    var second = vec3<f32>(0.0);
    if any(first != vec3<f32>(0.0)) {
        second = clip_line(line_of(words.zw, hot), p, normal, is_flat);
    }
    var kept = select(KEPT_WHOLE, KEPT_ONE, any(first != vec3<f32>(0.0)));
    if any(second != vec3<f32>(0.0)) {
        kept = select(KEPT_BOTH, KEPT_EITHER, either);
    }
    clips[2u * i] = vec4<u32>(bitcast<vec3<u32>>(first), kept);
    clips[2u * i + 1u] = vec4<u32>(bitcast<vec3<u32>>(second), 0u);
}

// End of a splat that is seen edge-on as a stroke and that a line cuts short: the plane there
// through the eye along the normal; zeros if the line does not cut the stroke short.
fn end_of(line: Line, p: vec3<f32>, normal: vec3<f32>, a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    let flat = normal * dot(normal, p) - p;
    let eye = vec2<f32>(dot(flat, a) / dot(a, a), dot(flat, b) / dot(b, b));
    let way = cross(normal, line.e) * select(-1.0, 1.0, line.keeps_right);
    let on_disc = vec2<f32>(dot(way, a), dot(way, b));
    let out = on_disc / length(on_disc);
    let reach = dot(way, line.c - p) / length(on_disc);
    let away = dot(eye, eye);
    let aside = vec2<f32>(-eye.y, eye.x) * sqrt(max(away - 1.0, 0.0));
    let first = dot(out, eye + aside) / away - reach;
    let second = dot(out, eye - aside) / away - reach;
    let side = select(-1.0, 1.0, first >= second);
    if !(away > 1.0 && max(first, second) > 0.0 && abs(reach) < 1.0) {
        return vec3<f32>(0.0);
    }
    let half = vec2<f32>(-out.y, out.x) * sqrt(1.0 - reach * reach);
    let u = out * reach + half;
    let v = out * reach - half;
    let turn = (v.x - eye.x) * (u.y - eye.y) - (v.y - eye.y) * (u.x - eye.x);
    let place = select(v, u, turn * side < 0.0);
    let hand = select(1.0, -1.0, dot(normal, cross(a, b)) < 0.0);
    return cross(p + a * place.x + b * place.y, normal) * (-side * hand);
}

// Adds a second line to a splat with one line that is seen nearly edge-on.
fn end_lines(i: u32, words: vec4<u32>, hot: vec3<u32>, p: vec3<f32>, normal: vec3<f32>, a: vec3<f32>, b: vec3<f32>) {
    if clips[2u * i].w != KEPT_ONE || !(abs(dot(normal, p)) < CLIP_STROKE * length(p)) {
        return;
    }
    let end = end_of(line_of(words.xy, hot), p, normal, a, b);
    var second = in_pixels(vec3<f32>(end.xy / frame.focal_px, end.z));
    if all(second == vec3<f32>(0.0)) {
        return;
    }
    second.z += CLIP_PAST;
    clips[2u * i].w = KEPT_BOTH;
    clips[2u * i + 1u] = vec4<u32>(bitcast<vec3<u32>>(second), 0u);
}

// Whether all pixels of a box are beyond a line, by more than rounding.
fn is_beyond(line: vec3<f32>, box: vec4<u32>) -> bool {
    let low = vec2<f32>(box.xy) + 0.5 - frame.centre_px;
    let high = vec2<f32>(box.zw) - 0.5 - frame.centre_px;
    let greatest = max(line.xy * low, line.xy * high);
    let size = dot(abs(line.xy), max(abs(low), abs(high))) + abs(line.z);
    return greatest.x + greatest.y + line.z < -1e-6 * size;
}

// Whether the lines keep nothing of a splat within its box.
fn is_cut_away(i: u32, box: vec4<u32>) -> bool {
    let row = clips[2u * i];
    if row.w == KEPT_WHOLE {
        return false;
    }
    let first = is_beyond(bitcast<vec3<f32>>(row.xyz), box);
    if row.w == KEPT_ONE {
        return first;
    }
    let second = is_beyond(bitcast<vec3<f32>>(clips[2u * i + 1u].xyz), box);
    return select(first || second, first && second, row.w == KEPT_EITHER);
}

// The direction of the first two bytes of a shape (crates/points/src/tangents.rs).
fn axis_of(code: u32) -> vec3<f32> {
    let bits = bitcast<i32>(code);
    let uv = max(vec2<f32>(vec2<i32>(extractBits(bits, 0u, 8u), extractBits(bits, 8u, 8u))) / 127.0, vec2<f32>(-1.0));
    let xy = vec2<f32>(uv.x + uv.y, uv.x - uv.y) * 0.5;
    return normalize(vec3<f32>(xy, 1.0 - abs(xy.x) - abs(xy.y)));
}

// Makes the splat of point `i` of the batch.
fn place(i: u32) -> Placed {
    let words = geometry[i];
    let own = paint[i];
    let draw = own.x & ~HAS_COLOUR;
    let d = &draws[draw];
    let offset = offset_of(words, (*d).shift);
    let lattice = (*d).box_min + offset;
    let steps = steps_from_anchor((*d).base_high, (*d).base_low, (*d).bias_steps, offset);
    let from_anchor = steps * frame.step;
    let from_eye = from_anchor - frame.back * frame.anchor_depth;
    let p = seen(in_view(from_anchor));
    let code = radius_code_of(words.xy);
    let stored = radius_within(spacing_of(draw, lattice, code) * lookup.radius_factors[code / 4u][code % 4u]);
    var radius = stored * batch.radius_factor;
    var factor = batch.radius_factor;
    // Read before make_lines overwrites the row.
    var shape = 0u;
    if TANGENTS {
        shape = clips[2u * i + 1u].x;
    }

    let none = Placed(Splat(), vec4<u32>(0u));
    var world = vec3<f32>(0.0);
    if NORMALS {
        world = normal_of(own.w);
    }
    var normal = in_view(world);
    if NORMALS && all(normal == vec3<f32>(0.0)) {
        radius = min(radius, p.z * (DOT_RADIUS_PX / frame.focal_px));
    }
    var clip_words = vec4<u32>(0u);
    let dropped = vec3<u32>((*d).shift);
    let hot = (*d).box_min + ((offset >> dropped) << dropped);
    if CLIPS {
        clip_words = clips[2u * i];
        make_lines(i, clip_words, hot, p, normal);
        if clips[2u * i].w != KEPT_WHOLE {
            radius *= CLIP_WIDER;
            factor *= CLIP_WIDER;
        }
    }
    let looks_away = dot(normal, p) > 0.0;
    if looks_away && frame.cull_back_faces == 1u {
        return none;
    }
    if all(normal == vec3<f32>(0.0)) {
        normal = normalize(select(p, vec3<f32>(0.0, 0.0, 1.0), all(p == vec3<f32>(0.0))));
    }
    var growth = vec2<f32>(0.0);
    if FITTED {
        growth = growth_of(p, radius);
        let tilted = widened_normal(p, growth);
        normal = select(normal, tilted, any(tilted != vec3<f32>(0.0)));
    }
    // Two directions across the normal (duff2017).
    let sign = select(1.0, -1.0, (bitcast<u32>(normal.z) >> 31u) == 1u);
    let s = -1.0 / (sign + normal.z);
    let t = normal.x * normal.y * s;
    var a = vec3<f32>(1.0 + sign * normal.x * normal.x * s, sign * t, -sign * normal.x) * radius;
    var b = vec3<f32>(t, sign + normal.y * normal.y * s, -normal.y) * radius;
    if TANGENTS {
        // The ellipse of the shape (shape.rs).
        let apart = (*d).spacing * lookup.radius_factors[(shape >> 18u) & 63u][(shape >> 16u) & 3u];
        let aspect = exp2(f32(shape >> 24u) / 128.0);
        let room = apart * factor * SHAPE_ROOM;
        let over = radius * aspect / room;
        let coarser = clamp(over - SHAPE_COARSER, 0.0, 1.0);
        let own = radius * min(max(mix(SHAPE_LEAST, 1.0, coarser), 1.0 / over), 1.0);
        let long = max(own, min(room, own * aspect));
        let along = in_view(axis_of(shape));
        let flat = along - normal * dot(along, normal);
        if aspect > 1.0 && dot(flat, flat) > AXIS_SINE_MIN {
            let u = normalize(flat);
            a = u * long;
            b = cross(normal, u) * (own * (own / long));
        }
    }

    if CLIPS {
        end_lines(i, clip_words, hot, p, normal, a, b);
    }

    let extent = sqrt(a.z * a.z + b.z * b.z);
    let farthest = p.z + extent;
    if !(farthest >= frame.near) || is_infinite(farthest) {
        return none;
    }
    var placed: Placed;
    if p.z - extent >= frame.near && extent <= REACH_MAX * p.z {
        placed = ellipse(p, a, b, radius);
        if FITTED && any(growth != vec2<f32>(0.0)) {
            placed.splat = along_plane(placed.splat, p, growth);
        }
    } else {
        placed = by_rays(p, a, b, radius);
    }
    if is_empty(placed.bounds) {
        return placed;
    }
    if CLIPS && is_cut_away(i, placed.bounds) {
        return none;
    }
    let colour = colour_of(own, coordinate_of(lattice, offset), bitcast<u32>(p.z));
    var last = bitcast<u32>(radius * frame.focal_px / max(p.z, frame.near));
    if NORMALS {
        last = packed_normal(towards_eye(world, from_eye));
    }
    placed.splat.d = vec4<u32>(bitcast<vec3<u32>>(colour), last);
    return placed;
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.x + id.y * groups.x * 256u;
    if i >= batch.points {
        return;
    }
    var box = vec4<u32>(0u);
    let is_hidden = HIDES_POINTS && (geometry[i].y >> 24u) != 0u;
    if paint[i].x != NOTHING && !is_hidden {
        let placed = place(i);
        box = placed.bounds;
        splats[i] = placed.splat;
    }
    if is_empty(box) {
        boxes[i] = vec2<u32>(box.x, 0u);
        return;
    }
    boxes[i] = box.xy | (box.zw << vec2<u32>(16u));
    let last = min((box.zw - 1u) / TILE, batch.tiles - 1u);
    for (var y = box.y / TILE; y <= last.y; y += 1u) {
        for (var x = box.x / TILE; x <= last.x; x += 1u) {
            atomicAdd(&cursors[y * batch.tiles.x + x], 1u);
        }
    }
}
