//! Gather (`marroquim2007`, section 3.1): fills level 0 of the pyramid with the attributes of the
//! points that won a pixel. Radius, normal and colour are looked up here
//! ([`crate::inputs::lookup`]), once per covered pixel instead of once per point.

use crate::inputs::camera::Camera;
use crate::inputs::lookup::{Lookup, NO_NORMAL, RADIUS_MAX, normal_code};
use crate::passes::fit_planes::{BARE_REACH, FittedPlane, FittedPlanes};
use crate::passes::project::{EMPTY, unpack};
use crate::passes::tangent::{Lens, SLOPE_MAX};
use crate::picture::pyramid::{
    FITTED, FLAT, INVALID, Level, NORMALS, Planes, RowMut, for_each_row,
};
use crate::simd::lanes::{LANES, Pixels, moved, only};
use crate::simd::values::{Lane, Mask, directions, towards_eye};
use fearless_simd::{Level as Simd, dispatch};
use glam::{Vec3, Vec4};
use std::sync::atomic::{AtomicU64, AtomicU64 as Counter, Ordering::Relaxed};

/// Drawn radii over stored ones, with normals and without. A coarser pixel's ellipse is the mean of
/// its points' ellipses, which covers less than they do, so stored radii would leave holes in
/// tilted walls. Circles lose less, and what they add shows at silhouettes.
pub(crate) const RADIUS_FACTOR: [f32; 2] = [1.4, 1.15];
/// Added to projected radii, pixels, with normals and without: a pixel is covered where its centre
/// is. With less, the far side shows through a sphere of half a point per pixel.
pub(crate) const RADIUS_MARGIN_PX: [f32; 2] = [0.35, 0.5];
/// Share that radii take of the stretch of the picture away from its middle. Discs without normals
/// are 1.15 spacings wide and gaps of even samples at most 0.84, so only a stretch beyond their
/// ratio opens holes. A greater share exceeds the bound of `crates/engine/tests/popping.rs`.
pub(crate) const STRETCHED: f32 = 0.83;
/// Minor axes over those of the projected disc, for tilted discs: the mean of two ellipses one
/// above the other covers least of all.
pub(crate) const MINOR_FACTOR: f32 = 1.3;
/// Half of the least minor axis of an ellipse, pixels. Thinner ellipses pass between the centres of
/// pixels and leave holes in tilted floors.
pub(crate) const MINOR_MIN_PX: f32 = 1.4;
/// Thickness of a surface across its plane, over the stored radius, with normals.
pub(crate) const THICKNESS: f32 = 1.0;
/// Greatest length of the depth interval with normals: in drawn radii, and in pixels that are
/// added, since normals are rough from pixel to pixel. Along the ray a disc is no longer, however
/// near to edge-on it is seen: with longer intervals what lies behind an outline takes part in it,
/// which makes it ragged (`tests/inner_outlines.rs`).
pub(crate) const THICK_MAX: [f32; 2] = [1.5, 8.0];
/// Drawn radii from which that limit sets in, and holds wholly, pixels. Of wires drawn with smaller
/// discs, both sides are seen edge-on within a pixel or two, and shorter intervals part them.
pub(crate) const THICK_FROM_PX: [f32; 2] = [4.0, 6.0];
/// Least share of the limit: with it the limit is longer than any interval of small discs.
pub(crate) const SHARE_MIN: f32 = 0.0625;
/// Greatest length of the depth interval over the drawn radius with fitted planes, since steep ones
/// are rough.
pub(crate) const FITTED_REACH_MAX: f32 = 3.0;

/// Greatest radius on the picture of points without a normal among points with normals, pixels:
/// they belong to no surface (leaves, wires, strays), so they stay dots where the camera is near.
pub(crate) const DOT_RADIUS_PX: f32 = 5.0;

/// Depth that is added to points whose normal looks away, over the radius. At an outline the back
/// of a surface lies just behind its front, which covers it then; elsewhere the backs of surfaces
/// keep their order.
pub(crate) const BACK_DEPTH: f32 = 3.0;

/// Fills level 0 from the frame buffer. Planes of pixels are those of `fitted`, if the level has
/// fitted planes. Returns the number of valid pixels.
pub fn gather(
    lookup: &Lookup<'_>,
    target: &[AtomicU64],
    fitted: Option<&FittedPlanes>,
    base: &mut Level,
) -> u64 {
    let pass = Gather { lookup, target, fitted };
    match base.planes() {
        Planes::None => pass.level::<FLAT>(base),
        Planes::Fitted => pass.level::<FITTED>(base),
        Planes::Normals => pass.level::<NORMALS>(base),
    }
}

/// Inputs of the pass.
#[derive(Clone, Copy)]
struct Gather<'a> {
    lookup: &'a Lookup<'a>,
    target: &'a [AtomicU64],
    fitted: Option<&'a FittedPlanes>,
}

impl Gather<'_> {
    fn level<const PLANE: usize>(self, base: &mut Level) -> u64 {
        let width = base.width;
        let valid = Counter::new(0);
        for_each_row(base, |row| {
            let values = &self.target[row.y * width..][..width];
            let count = dispatch!(Simd::new(), _ => gather_row::<PLANE>(self, values, row));
            valid.fetch_add(count, Relaxed);
        });
        valid.into_inner()
    }
}

/// Index into constants that differ with normals and without.
const fn normals_index<const PLANE: usize>() -> usize {
    if PLANE == NORMALS { 0 } else { 1 }
}

#[inline(always)]
fn gather_row<const PLANE: usize>(
    pass: Gather<'_>,
    values: &[AtomicU64],
    mut row: RowMut<'_>,
) -> u64 {
    let (mut hits, mut count) = (Hits::NONE, 0);
    for (x, value) in values.iter().enumerate() {
        let value = value.load(Relaxed);
        if let Some(ahead) = values.get(x + AHEAD).map(|value| value.load(Relaxed))
            && ahead != EMPTY
        {
            pass.lookup.prefetch(unpack(ahead).1, PLANE == NORMALS);
        }
        if value == EMPTY {
            row.front[x] = INVALID;
            continue;
        }
        hits.fetch::<PLANE>(pass.lookup, x, value);
        count += 1;
        if hits.count == HITS {
            hits.write_all::<PLANE>(pass, &mut row);
        }
    }
    hits.write_all::<PLANE>(pass, &mut row);
    count
}

/// Points that are fetched before anything is computed from them, so that their reads overlap.
const HITS: usize = 32;
/// Distance of the prefetch, pixels.
const AHEAD: usize = 24;

/// Points of a row that won a pixel, attribute by attribute.
struct Hits {
    count: usize,
    /// Pixels in the row.
    x: [usize; HITS],
    depth: [f32; HITS],
    draw: [u32; HITS],
    offset: [[u32; 3]; HITS],
    radius_code: [u8; HITS],
    colour: [[f32; HITS]; 3],
    normal: [[i16; 2]; HITS],
    /// Position relative to the eye, in steps.
    steps: [[f32; HITS]; 3],
    /// Drawn radius, in the unit of the file.
    radius: [f32; HITS],
}

impl Hits {
    const NONE: Self = Self {
        count: 0,
        x: [usize::MAX; HITS],
        depth: [0.0; HITS],
        draw: [0; HITS],
        offset: [[0; 3]; HITS],
        radius_code: [0; HITS],
        colour: [[0.0; HITS]; 3],
        normal: [NO_NORMAL; HITS],
        steps: [[0.0; HITS]; 3],
        radius: [0.0; HITS],
    };

    /// Adds the point that won pixel `x`. There must be room for it.
    #[inline(always)]
    fn fetch<const PLANE: usize>(&mut self, lookup: &Lookup<'_>, x: usize, value: u64) {
        let (depth, point) = unpack(value);
        let k = self.count % HITS;
        self.count += 1;
        (self.x[k], self.depth[k]) = (x, depth);
        let (d, index) = lookup.list.find(point);
        self.draw[k] = d as u32;
        let offset;
        (offset, self.radius_code[k]) = lookup.draws[d].positions.offset(index);
        self.offset[k] = offset;
        let colour = lookup.colour(d, index, offset, depth);
        (0..3).for_each(|i| self.colour[i][k] = colour[i]);
        if PLANE == NORMALS {
            let code = lookup.frame.draws[d].normal.and_then(|plane| normal_code(plane, index));
            self.normal[k] = code.unwrap_or(NO_NORMAL);
        }
    }

    /// Makes pixels of all points, and removes these.
    #[inline(always)]
    fn write_all<const PLANE: usize>(&mut self, pass: Gather<'_>, row: &mut RowMut<'_>) {
        let lookup = pass.lookup;
        let factor = RADIUS_FACTOR[normals_index::<PLANE>()];
        for k in 0..self.count.min(HITS) {
            let (d, offset) = (self.draw[k] as usize, self.offset[k]);
            let place = &lookup.draws[d].place;
            (0..3).for_each(|axis| self.steps[axis][k] = place.axis_steps(axis, offset[axis]));
            let code = self.radius_code[k];
            let stored = lookup.radius_factors[usize::from(code)];
            self.radius[k] = lookup.spacing(d, offset, code) * factor * stored;
            if PLANE == NORMALS && self.normal[k] == NO_NORMAL {
                let most = DOT_RADIUS_PX * self.depth[k] / lookup.camera.focal_px;
                self.radius[k] = self.radius[k].min(most);
            }
        }
        self.x[self.count..].fill(usize::MAX);
        for first in (0..self.count).step_by(LANES) {
            self.write::<PLANE>(pass, first, row);
        }
        self.count = 0;
    }

    /// Makes pixels of four points, from `first` on.
    #[inline(always)]
    fn write<const PLANE: usize>(&self, pass: Gather<'_>, first: usize, row: &mut RowMut<'_>) {
        let four = |values: &[f32; HITS]| Vec4::from_slice(&values[first..]);
        let (Some(to), Some(normals)) =
            (self.x[first..].first_chunk(), self.normal[first..].first_chunk())
        else {
            return;
        };
        let camera = pass.lookup.camera;
        let focal_px = camera.focal_px;
        // Of a number and a NaN, `max` returns the second: a radius that is NaN becomes zero.
        let drawn = four(&self.radius).max(Vec4::ZERO);
        let radius = drawn.min(Vec4::splat(RADIUS_MAX));
        let depth = four(&self.depth);
        let margin = RADIUS_MARGIN_PX[normals_index::<PLANE>()];
        let in_middle = (radius * focal_px / depth).min(Vec4::splat(RADIUS_MAX));
        let in_pixels = |share: Lane, stretch: Lane| {
            let least = (in_middle + margin) * share;
            (in_middle * (stretch * STRETCHED)).max(least).min(Vec4::splat(RADIUS_MAX))
        };
        let [a, b, c, d] = *to;
        let centre = [
            Vec4::new(a as f32, b as f32, c as f32, d as f32) + 0.5,
            Vec4::splat(row.y as f32 + 0.5),
        ];
        let per_focal = 1.0 / focal_px;
        let ray = [
            (centre[0] - camera.centre_px[0]) * per_focal,
            (Vec4::splat(camera.centre_px[1]) - centre[1]) * per_focal,
        ];
        let mut radius_px = in_pixels(Vec4::ONE, sphere_stretch(ray));
        let [r, g, b] = &self.colour;
        let [r, g, b] = [four(r), four(g), four(b)];
        let mut out = Pixels {
            front: [depth, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO],
            tint: [r, g, b, radius_px],
            depth,
            plane: [Vec4::ZERO; 4],
        };
        let mut reach = radius * BARE_REACH;
        if PLANE != FLAT {
            let [right, up, _] = camera.view_from_world;
            let step = camera.step.to_array();
            let [x, y, z] = &self.steps;
            let from_anchor = [four(x) * step[0], four(y) * step[1], four(z) * step[2]];
            let [per_depth, always] = camera.divisor();
            let scale = focal_px / (depth * per_depth + always);
            let place =
                camera.placed([dot(right, from_anchor) * scale, -dot(up, from_anchor) * scale]);
            // From the point to the centre of its pixel: at most half a pixel, however the position
            // was rounded.
            out.front[2] = within_half(centre[0] - place[0]);
            out.front[3] = within_half(centre[1] - place[1]);
            if let (FITTED, Some(fitted)) = (PLANE, pass.fitted) {
                let [growth @ .., across] =
                    four_fitted_planes(fitted, to, row.y, in_middle + margin);
                let (tilt, plate, normal) = plane_at(camera, place, growth);
                let is_fitted = (growth[0].abs() + growth[1].abs()).cmpgt(Vec4::ZERO);
                let [_, major] = disc_stretch(normal, ray);
                radius_px = Vec4::select(is_fitted, in_pixels(Vec4::ONE, major), radius_px);
                out.tint[3] = radius_px;
                reach = radius * (plate * across).min(Vec4::splat(FITTED_REACH_MAX));
                // Discs stay at their pixels, and get the depths of their planes there.
                let to_centre = [out.front[2], out.front[3]];
                let moved = moved::<PLANE, _>(tilt, tilt[0], to_centre);
                out.depth = depth * moved;
                out.front = [out.depth, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO];
                out.plane = [tilt[0] * moved, tilt[1] * moved, Vec4::ZERO, Vec4::ZERO];
            }
            if PLANE == NORMALS {
                let frame = pass.lookup.frame;
                let fronts = [frame.cull_back_faces, frame.has_fronts];
                let ahead = camera.to_anchor().to_array();
                let from_eye = [0, 1, 2].map(|axis| from_anchor[axis] + ahead[axis]);
                let (turned, has_normal, looks_away) =
                    normals_to_eye(camera, normals, from_eye, fronts);
                out.depth += only(looks_away, radius * BACK_DEPTH);
                out.front[0] = out.depth;
                let plate = Lens::new(camera).thickness(turned, place);
                let thick = radius * (THICKNESS / RADIUS_FACTOR[0]) * plate;
                let thick = thick.min(longest(in_middle) * depth * per_focal);
                reach = Vec4::select(has_normal, thick, reach);
                let [minor, major] = disc_stretch(turned, ray);
                radius_px = Vec4::select(has_normal, in_pixels(Vec4::ONE, major), radius_px);
                out.tint[3] = radius_px;
                let minor = filter_minor(in_pixels(turned[2].abs(), minor) / radius_px, radius_px);
                let minor = Vec4::select(has_normal, minor, Vec4::ONE);
                out.plane = [turned[0], turned[1], turned[2], minor];
            }
        }
        out.front[1] = out.depth + reach;
        out.scatter::<PLANE>(*to, row);
    }
}

/// Unit normal in view space of a point with this code, turned to the eye; `from_anchor` is its
/// place.
pub(crate) fn normal_to_eye(
    camera: &Camera,
    code: [i16; 2],
    from_anchor: [f32; 3],
    fronts: [bool; 2],
) -> Vec3 {
    let ahead = camera.to_anchor().to_array();
    let from_eye = [0, 1, 2].map(|axis| Vec4::splat(from_anchor[axis] + ahead[axis]));
    let (turned, ..) = normals_to_eye(camera, &[code; LANES], from_eye, fronts);
    Vec3::from_array(turned.map(|part| part.x))
}

/// Unit normals in view space from octahedral codes, turned to the eye, which of them exist, and
/// which are the backs of surfaces, if normals have fronts. Where back faces are culled (`culls`),
/// normals face the eye already.
#[inline(always)]
fn normals_to_eye(
    camera: &Camera,
    codes: &[[i16; 2]; LANES],
    from_eye: [Lane; 3],
    [culls, has_fronts]: [bool; 2],
) -> ([Lane; 3], Mask, Mask) {
    let [right, up, back] = camera.view_from_world;
    let [a, b, c, d] = codes.map(|code| code.map(f32::from));
    let code = |i: usize| Vec4::new(a[i], b[i], c[i], d[i]);
    let world = directions(code(0), code(1));
    let [x, y, z] = world;
    let length = (x * x + y * y + z * z).sqrt();
    let has_normal = length.cmpgt(Vec4::ZERO);
    let unit = |c: Lane| only(has_normal, c / length);
    let world = [unit(x), unit(y), unit(z)];
    let away = world[0] * from_eye[0] + world[1] * from_eye[1] + world[2] * from_eye[2];
    let away = if culls || !has_fronts { Vec4::ZERO } else { away };
    let world = if culls { world } else { towards_eye(world, from_eye, has_fronts) };
    let turned = [dot(right, world), dot(up, world), dot(back, world)];
    (turned, has_normal, away.cmpgt(Vec4::ZERO))
}

/// Growth of depth to the right and downwards, and reach, of the planes fitted at four pixels of
/// row `y`.
#[inline(always)]
fn four_fitted_planes(
    fitted: &FittedPlanes,
    to: &[usize; LANES],
    y: usize,
    radius_px: Lane,
) -> [Lane; 3] {
    let radii = radius_px.to_array();
    let mut all = [[0.0; LANES]; 3];
    for k in 0..LANES {
        let is_there = to[k] != usize::MAX;
        let plane = if is_there { fitted.at(to[k], y, radii[k]) } else { FittedPlane::NONE };
        (all[0][k], all[1][k], all[2][k]) = (plane.growth[0], plane.growth[1], plane.reach);
    }
    all.map(Vec4::from_array)
}

/// Tilt ([`Level::tilt`]) of planes with the given growth of depth at positions on the picture,
/// limited to [`SLOPE_MAX`]; the depth of plates of unit thickness there; and the planes' normals
/// in view space.
#[inline(always)]
fn plane_at(
    camera: &Camera,
    place: [Lane; 2],
    [right, down]: [Lane; 2],
) -> ([Lane; 2], Lane, [Lane; 3]) {
    let [x, y] = [place[0] - camera.centre_px[0], place[1] - camera.centre_px[1]];
    let back = (right * x + down * y + 1.0) / camera.focal_px;
    let length = (right * right + down * down + back * back).sqrt();
    let steepness = (right.abs() + down.abs()) * (camera.focal_px / SLOPE_MAX);
    let followed = 1.0 / steepness.max(Vec4::ONE);
    let plate = length * followed * camera.focal_px;
    ([right * followed, -down * followed], plate, [right / length, -down / length, back / length])
}

/// Greatest length of the depth interval of discs with normals and this radius, pixels.
#[inline(always)]
fn longest(radius_px: Lane) -> Lane {
    let [from, full] = THICK_FROM_PX;
    let share = (radius_px - from) * (1.0 / (full - from));
    // Without a limit at the lower end, nearly.
    let share = share.max(Vec4::splat(SHARE_MIN)).min(Vec4::ONE);
    (radius_px * THICK_MAX[0] + THICK_MAX[1]) / share
}

#[inline(always)]
fn dot(a: Vec3, [x, y, z]: [Lane; 3]) -> Lane {
    x * a.x + y * a.y + z * a.z
}

/// Limits `x` to half a pixel to either side.
#[inline(always)]
fn within_half(x: Lane) -> Lane {
    x.max(Vec4::splat(-0.5)).min(Vec4::splat(0.5))
}

/// Greatest radius of a projected sphere over that in the middle of the picture: perspective
/// stretches it away from the middle. `ray` is the direction to the sphere, to the right and
/// upwards, over the depth.
#[inline(always)]
fn sphere_stretch([x, y]: [Lane; 2]) -> Lane {
    (x * x + y * y + 1.0).sqrt()
}

/// Half of the minor and of the major axis of a projected disc, over those of a disc in the middle
/// of the picture that faces the eye. A vector `v` in space projects to `v.xy + ray v.z`, where z
/// grows towards the eye. So the disc extends `|z - k|` along its normal's projection, with `k =
/// ray . normal.xy`, and `sqrt(1 + |ray|^2 |normal.xy|^2 - k^2)` across it. In the middle these are
/// `|z|` and 1, and no disc is drawn narrower than there, or the far side would show at a sphere's
/// limb. If the former exceeds the latter, the disc is drawn as a circle.
#[inline(always)]
fn disc_stretch([nx, ny, nz]: [Lane; 3], [x, y]: [Lane; 2]) -> [Lane; 2] {
    let k = x * nx + y * ny;
    let along = (nz - k).abs();
    let across = ((x * x + y * y) * (nx * nx + ny * ny) - k * k + 1.0).max(Vec4::ONE).sqrt();
    [along, across.max(along)]
}

/// Minor axes of ellipses over their major ones, at least [`MINOR_MIN_PX`] so that no ellipse falls
/// between pixels.
#[inline(always)]
fn filter_minor(minor: Lane, radius_px: Lane) -> Lane {
    (minor * MINOR_FACTOR).max(MINOR_MIN_PX / radius_px).min(Vec4::ONE)
}
