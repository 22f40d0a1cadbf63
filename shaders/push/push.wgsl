// Push (marroquim2007, section 3.3): interpolates the invalid or occluded pixels of a level from
// the coarser level, which has been pushed already. Twin: crates/render/src/passes/push.rs, which
// explains the method and the constants.

// include common/frame.wgsl
// include common/level.wgsl
// include common/tangent.wgsl
// include common/plane.wgsl
// include common/set_plane.wgsl
// include common/ellipse.wgsl

// Whether pixels that are kept are smoothed by the interpolated value.
override SMOOTHS: bool;

@group(0) @binding(0) var<uniform> fine: LevelShape;
@group(0) @binding(1) var<uniform> coarse: LevelShape;
@group(0) @binding(2) var<storage, read_write> fine_front: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> fine_tint: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> fine_depth: array<f32>;
@group(0) @binding(5) var<storage, read_write> to_planes: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read> coarse_front: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> coarse_tint: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> coarse_depth: array<f32>;
@group(0) @binding(9) var<storage, read> from_planes: array<vec2<f32>>;
@group(0) @binding(10) var<uniform> frame: Frame;

// Radius above which an ellipse also hides pixels below the neighbours of its own pixel, pixels.
const HIDING_PX: f32 = 24.0;
// Distance in radii of a pixel from the centre of each of four ellipses that enclose it, at most.
const ENCLOSING: f32 = 1.15;
// Share of the interpolated value in a pixel that is kept, if all four coarser pixels take part.
const SMOOTH: f32 = 0.5;
// Square of the cosine of the angle between similar normals at most (15 degrees).
const NEAR: f32 = 0.933;
// Factor just below one: a pixel must not be in front of the coarser pixel that it was averaged
// into only by rounding.
const ROUNDING: f32 = 0.99999;

// One of the four nearest coarser pixels: the one above (0), its neighbour in x (1), in y (2), in
// both (3).
struct Near {
    pixel: u32,
    // Weight of the biquadratic B-spline, times 16.
    weight: f32,
    // From its centre to that of the finer pixel.
    to_finer: vec2<f32>,
}

// The coarser pixel `k`. `above` is the coarser pixel that contains the finer one; `odd` is whether
// the finer one is in its right and in its lower half, towards which the neighbours lie.
fn near(k: u32, above: vec2<u32>, odd: vec2<bool>) -> Near {
    let side = vec2<u32>(k & 1u, k >> 1u);
    let is_beside = side == vec2<u32>(1u);
    let at = select(above, select(above - 1u, above + 1u, odd), is_beside);
    // Half a finer pixel from the centre of the pixel above, and one and a half from those of its
    // neighbours, to the other side.
    let half = select(vec2<f32>(-0.5), vec2<f32>(0.5), odd) * fine.edge_px;
    let weights = select(vec2<f32>(3.0), vec2<f32>(1.0), is_beside);
    return Near(
        at.y * coarse.width + at.x,
        weights.x * weights.y,
        select(half, half * -3.0, is_beside),
    );
}

// Factor of the depths of a coarser pixel, centred at `centre`, at `place`.
fn factor(pixel: u32, centre: vec2<f32>, place: vec2<f32>) -> f32 {
    if PLANE == 0u {
        return 1.0;
    }
    let origin = centre - coarse_front[pixel].zw;
    return moved(plane_of(pixel), origin, place - origin);
}

// Whether a pixel is behind the interval of a neighbour of the pixel above that has a wide ellipse.
fn is_behind(own: f32, place: vec2<f32>, centre: vec2<f32>, above: vec2<u32>, odd: vec2<bool>, has: vec2<bool>) -> bool {
    for (var k = 1u; k < 4u; k++) {
        if ((k & 1u) != 0u && !has.x) || ((k & 2u) != 0u && !has.y) {
            continue;
        }
        let source = near(k, above, odd);
        let front = coarse_front[source.pixel];
        if is_valid(front)
            && coarse_tint[source.pixel].w >= HIDING_PX
            && own > front.y * factor(source.pixel, centre - source.to_finer, place)
        {
            return true;
        }
    }
    return false;
}

// Whether a pixel is behind all four coarser pixels and between the centres of their ellipses.
fn is_enclosed(own: f32, place: vec2<f32>, centre: vec2<f32>, above: vec2<u32>, odd: vec2<bool>, has: vec2<bool>) -> bool {
    if !all(has) {
        return false;
    }
    // Extent of the centres along four lines, in both directions.
    var low = vec4<f32>(0.0);
    var high = vec4<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        let source = near(k, above, odd);
        let front = coarse_front[source.pixel];
        let by = source.to_finer + front.zw;
        let reach = ENCLOSING * coarse_tint[source.pixel].w;
        if !is_valid(front)
            || dot(by, by) > reach * reach
            || own <= front.y * factor(source.pixel, centre - source.to_finer, place)
        {
            return false;
        }
        let along = vec4<f32>(by, by.x + by.y, by.x - by.y);
        low = min(low, along);
        high = max(high, along);
    }
    return all(low < vec4<f32>(0.0)) && all(high > vec4<f32>(0.0));
}

// A coarser pixel at the place of a finer one.
struct Cover {
    near: Near,
    // Whether it exists, and its ellipse covers the finer pixel or is one of four that enclose it.
    covers: bool,
    // Its depth interval where depths are compared.
    depths: vec2<f32>,
    normal: vec4<f32>,
}

// The coarser pixel `k` at the place of the finer one; `place` is where depths are compared.
fn see(k: u32, place: vec2<f32>, centre: vec2<f32>, above: vec2<u32>, odd: vec2<bool>, has: vec2<bool>, encloses: bool) -> Cover {
    var seen = Cover(near(k, above, odd), false, vec2<f32>(0.0), FACING);
    if ((k & 1u) != 0u && !has.x) || ((k & 2u) != 0u && !has.y) {
        return seen;
    }
    let source = seen.near;
    let front = coarse_front[source.pixel];
    if !is_valid(front) {
        return seen;
    }
    if PLANE == NORMAL {
        seen.normal = plane_of(source.pixel);
    }
    seen.covers = encloses || covers(source.to_finer + front.zw, coarse_tint[source.pixel].w, seen.normal);
    if seen.covers {
        seen.depths = front.xy * factor(source.pixel, centre - source.to_finer, place);
    }
    return seen;
}

// Whether the angle between normals of any length is small, or one of them is zero.
fn are_near(a: vec3<f32>, b: vec3<f32>) -> bool {
    let along = dot(a, b);
    return dot(a, a) * NEAR * dot(b, b) <= along * max(along, 0.0);
}

// Smooths a pixel that is kept: mixes it with the coarser pixels that cover it, whose intervals
// meet its own and whose normals are similar. `place` is where depths are compared.
fn smooth_pixel(pixel: u32, place: vec2<f32>, centre: vec2<f32>, above: vec2<u32>, odd: vec2<bool>, has: vec2<bool>) {
    let own = fine_front[pixel].xy;
    var tint = vec3<f32>(0.0);
    var normal = vec3<f32>(0.0);
    var own_normal = vec4<f32>(0.0);
    if PLANE == NORMAL {
        own_normal = vec4<f32>(to_planes[2u * pixel], to_planes[2u * pixel + 1u]);
    }
    var sum = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let seen = see(k, place, centre, above, odd, has, false);
        var takes_part = seen.covers && seen.depths.x <= own.y && own.x <= seen.depths.y;
        if PLANE == NORMAL {
            takes_part = takes_part && are_near(own_normal.xyz, seen.normal.xyz);
        }
        if takes_part {
            tint += coarse_tint[seen.near.pixel].xyz * seen.near.weight;
            normal += seen.normal.xyz * seen.near.weight;
            sum += seen.near.weight;
        }
    }
    if sum > 0.0 {
        let share = sum * (SMOOTH * (1.0 - frame.crowding) / 16.0);
        let old = fine_tint[pixel];
        fine_tint[pixel] = vec4<f32>(old.xyz * (1.0 - share) + tint / sum * share, old.w);
        if PLANE == NORMAL {
            let mixed = own_normal.xyz * (1.0 - share) + normal / sum * share;
            set_plane(pixel, vec4<f32>(mixed, own_normal.w));
        }
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= fine.width || id.y >= fine.height {
        return;
    }
    let pixel = id.y * fine.width + id.x;
    let above = id.xy >> vec2<u32>(1u);
    let odd = (id.xy & vec2<u32>(1u)) == vec2<u32>(1u);
    let own = fine_front[pixel].x;
    let is_filled = !is_infinite(own);
    // Whether the neighbours in x and in y are in the picture.
    let has = select(id.xy > vec2<u32>(1u), above + 1u < vec2<u32>(coarse.width, coarse.height), odd);
    let centre = (vec2<f32>(id.xy) + 0.5) * fine.edge_px;
    // Where depths are compared.
    var place = centre;
    if is_filled {
        place -= fine_front[pixel].zw;
        let over = above.y * coarse.width + above.x;
        let cover = coarse_front[over];
        let to_place = factor(over, centre - near(0u, above, odd).to_finer, place);
        let least = select(to_place, to_place * ROUNDING, PLANE > 0u);
        let is_within = own >= cover.x * least && own <= cover.y * to_place;
        if is_within && !is_behind(own, place, centre, above, odd, has) {
            if SMOOTHS {
                smooth_pixel(pixel, place, centre, above, odd, has);
            }
            return;
        }
    }

    let encloses = PLANE == NORMAL && is_filled && is_enclosed(own, place, centre, above, odd, has);

    // Coarser pixels that cover the finer one, a bit each, and the depths of the frontmost of them.
    var taken = 0u;
    var nearest = vec2<f32>(0.0);
    var least = array<f32, 4>();
    for (var k = 0u; k < 4u; k++) {
        let seen = see(k, place, centre, above, odd, has, encloses);
        if seen.covers {
            least[k] = seen.depths.x;
            if taken == 0u || seen.depths.x < nearest.x {
                nearest = seen.depths;
            }
            taken |= 1u << k;
        }
    }
    // Nothing covers the pixel, or it is valid and not behind what covers it.
    if taken == 0u || (is_filled && own <= nearest.y) {
        if SMOOTHS && is_filled {
            smooth_pixel(pixel, place, centre, above, odd, has);
        }
        return;
    }
    var sum = 0.0;
    for (var k = 0u; k < 4u; k++) {
        if (taken & (1u << k)) == 0u {
            continue;
        }
        if least[k] > nearest.y {
            taken &= ~(1u << k);
        } else {
            sum += near(k, above, odd).weight;
        }
    }
    var middle = vec2<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        if (taken & (1u << k)) != 0u {
            let source = near(k, above, odd);
            middle += (coarse_front[source.pixel].zw + source.to_finer) * (source.weight / sum);
        }
    }
    var depths = vec2<f32>(0.0);
    var tint = vec4<f32>(0.0);
    var depth = 0.0;
    var plane = vec4<f32>(0.0);
    for (var k = 0u; k < 4u; k++) {
        if (taken & (1u << k)) == 0u {
            continue;
        }
        let source = near(k, above, odd);
        let share = source.weight / sum;
        let moved_share = factor(source.pixel, centre - source.to_finer, centre - middle) * share;
        depths += coarse_front[source.pixel].xy * moved_share;
        tint += coarse_tint[source.pixel] * share;
        depth += coarse_depth[source.pixel] * moved_share;
        if PLANE > 0u {
            plane += plane_of(source.pixel) * share;
        }
    }
    fine_front[pixel] = vec4<f32>(depths, middle);
    fine_tint[pixel] = tint;
    fine_depth[pixel] = depth;
    set_plane(pixel, plane);
}
