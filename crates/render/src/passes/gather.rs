//! Gather: the attributes of the points that won a pixel become level 0 of the pyramid (marroquim2007
//! section 3.1). Radius, normal and colour are looked up here, once a covered pixel, not once a point.
//!
//! Drawn radius (DESIGN section 8): the stored radius, in units of the node's spacing, times the
//! effective spacing of the finest drawn cell that holds the point.

use crate::inputs::camera::Camera;
use crate::inputs::lookup::{Lookup, NO_NORMAL, RADIUS_MAX, normal_code};
use crate::passes::fit_planes::{BARE_REACH, FittedPlane, FittedPlanes};
use crate::passes::project::{EMPTY, unpack};
use crate::passes::tangent::{Lens, SLOPE_MAX};
use crate::picture::pyramid::{INVALID, Level, Planes, RowMut, for_each_row};
use crate::simd::lanes::{FITTED, FLAT, LANES, Lane, NORMALS, Pixels, moved, only};
use crate::simd::values::directions;
use fearless_simd::{Level as Simd, dispatch};
use glam::{Vec3, Vec4};
use std::sync::atomic::{AtomicU64, AtomicU64 as Counter, Ordering::Relaxed};

/// Drawn radii over stored ones, with normals and without. A coarser pixel's ellipse is the mean of its
/// points' ellipses, which covers less than they do: with covering radii as they are, up to 0.2 % of a
/// tilted wall's pixels stay holes, with these up to 0.01 % (jittered grids of 1 to 20 pixels, tilted 0
/// to 70 degrees). Circles lose less, and what they add shows at silhouettes.
const RADIUS_FACTOR: [f32; 2] = [1.4, 1.15];
/// Added to radii in the picture, pixels, with normals and without: pixels are covered where their centres are. With 0.2 the far side shows
/// through a sphere of half a point a pixel.
const RADIUS_MARGIN_PX: [f32; 2] = [0.35, 0.5];
/// How much of what pictures are stretched by away from their middle radii take. Greatest gaps of even samples are 0.84 spacings, and
/// discs without normals 1.15 wide: only what is stretched by more than their ratio opens. With 0.87 arriving nodes pop by 2.1 %
/// of a picture, with all of it by 3.4 (asked 2).
const STRETCHED: f32 = 0.83;
/// Minor axes over those of the disc's projection, for tilted discs: the mean of two ellipses one above
/// the other covers least of all (70 degrees, 21 pixels: 0.06 % holes without, 0.01 % with).
const MINOR_FACTOR: f32 = 1.3;
/// Half the least minor axis of an ellipse, pixels. Thinner ones pass between the pixels' centres: a
/// floor tilted by 70 degrees, its points 1.7 pixels apart, had 6 % holes, with this 0.0004 %.
const MINOR_MIN_PX: f32 = 1.4;
/// Thickness of a surface across its plane, over the stored radius, with normals.
const THICKNESS: f32 = 1.0;
/// Length of the depth interval over the drawn radius, at most, where planes are told from depths: what is told of steep
/// ones is rough.
const SLANT_REACH_MAX: f32 = 3.0;

/// Fills level 0 from the frame buffer; its pixels' planes, where they are told, from `fitted`. Returns the number of
/// valid pixels.
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

/// What a pixel is made from.
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

/// An index of what differs with normals and without.
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

/// Points that are fetched before anything is computed of them: memory is waited for once, not once each.
const HITS: usize = 32;
/// So many pixels before it is fetched, a point is asked for.
const AHEAD: usize = 24;

/// Points of a row that won a pixel, attribute by attribute.
struct Hits {
    count: usize,
    /// Pixels of the row.
    x: [usize; HITS],
    depth: [f32; HITS],
    draw: [u32; HITS],
    offset: [[u32; 3]; HITS],
    radius_code: [u8; HITS],
    colour: [[f32; HITS]; 3],
    normal: [[i16; 2]; HITS],
    /// Against the eye, in steps.
    steps: [[f32; HITS]; 3],
    /// Stored radius, the file's unit.
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

    /// Adds the point that won pixel `x`; there must be room.
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

    /// Makes pixels of them, which are then no more.
    #[inline(always)]
    fn write_all<const PLANE: usize>(&mut self, pass: Gather<'_>, row: &mut RowMut<'_>) {
        let lookup = pass.lookup;
        let factor = RADIUS_FACTOR[normals_index::<PLANE>()];
        for k in 0..self.count.min(HITS) {
            let (d, offset) = (self.draw[k] as usize, self.offset[k]);
            let place = &lookup.draws[d].place;
            (0..3).for_each(|axis| self.steps[axis][k] = place.axis_steps(axis, offset[axis]));
            let stored = lookup.radius_factors[usize::from(self.radius_code[k])];
            self.radius[k] = lookup.spacing(d, offset) * factor * stored;
        }
        self.x[self.count..].fill(usize::MAX);
        for first in (0..self.count).step_by(LANES) {
            self.write::<PLANE>(pass, first, row);
        }
        self.count = 0;
    }

    /// Makes pixels of four of them.
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
        // What is no number is nothing: of a number and none, the second is the greater and the less.
        let stored = four(&self.radius).max(Vec4::ZERO);
        let radius = stored.min(Vec4::splat(RADIUS_MAX));
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
            let [right, up, back] = camera.view_from_world;
            let step = camera.step.to_array();
            let [x, y, z] = &self.steps;
            let from_eye = [four(x) * step[0], four(y) * step[1], four(z) * step[2]];
            let per_depth = focal_px / depth;
            let place = [
                dot(right, from_eye) * per_depth + camera.centre_px[0],
                -dot(up, from_eye) * per_depth + camera.centre_px[1],
            ];
            // From the point's place to the pixel's centre: within the pixel, however the place was rounded.
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
                reach = radius * (plate * across).min(Vec4::splat(SLANT_REACH_MAX));
                // Discs stay where their pixels are; their depths are those that their planes have there.
                let to_centre = [out.front[2], out.front[3]];
                let moved = moved::<PLANE, _>(tilt, tilt[0], to_centre);
                out.depth = depth * moved;
                out.front = [out.depth, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO];
                out.plane = [tilt[0] * moved, tilt[1] * moved, Vec4::ZERO, Vec4::ZERO];
            }
            if PLANE == NORMALS {
                let [a, b, c, d] = normals.map(|code| code.map(f32::from));
                let code = |i: usize| Vec4::new(a[i], b[i], c[i], d[i]);
                let world = directions(code(0), code(1));
                let [x, y, z] = world;
                let length = (x * x + y * y + z * z).sqrt();
                let has_normal = length.cmpgt(Vec4::ZERO);
                let unit = |c: Lane| only(has_normal, c / length);
                let world = [unit(x), unit(y), unit(z)];
                let normal = [dot(right, world), dot(up, world), dot(back, world)];
                let [x, y, z] =
                    [world[0] * from_eye[0], world[1] * from_eye[1], world[2] * from_eye[2]];
                // Where back faces are not culled, a normal may look either way: it is turned to the eye.
                let is_away = (x + y + z).cmpgt(Vec4::ZERO);
                let turns = !pass.lookup.frame.cull_back_faces;
                let turn = |c: Lane| if turns { Vec4::select(is_away, -c, c) } else { c };
                let turned = [turn(normal[0]), turn(normal[1]), turn(normal[2])];
                let plate = Lens::new(camera).thickness(turned, place);
                let thick = radius * (THICKNESS / RADIUS_FACTOR[0]) * plate;
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

/// What is told of four pixels of row `y`: the growth of depth right and down, and the reach.
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

/// The tilt ([`Level::tilt`]) of planes whose depth grows so at places on the picture, not steeper than can be followed;
/// the depth that plates of unit thickness take there; and the planes' normals in view space.
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

#[inline(always)]
fn dot(a: Vec3, [x, y, z]: [Lane; 3]) -> Lane {
    x * a.x + y * a.y + z * a.z
}

/// At most half a pixel to either side.
#[inline(always)]
fn within_half(x: Lane) -> Lane {
    x.max(Vec4::splat(-0.5)).min(Vec4::splat(0.5))
}

/// The greatest radius of a sphere's picture over that in the middle of the picture, where it is seen along `seen`: to the right
/// and upwards, over the depth. It is stretched away from the middle.
#[inline(always)]
fn sphere_stretch([x, y]: [Lane; 2]) -> Lane {
    (x * x + y * y + 1.0).sqrt()
}

/// Half the minor and the major axis of a disc's picture over those of one that is seen in the middle of the picture and faces
/// the eye. A step `v` in space is `v.xy + seen v.z` on the picture, where z grows towards the eye. So the disc reaches
/// `|z - k|` far along its normal's projection, with `k = seen . normal.xy`, and `sqrt(1 + |seen|^2 |normal.xy|^2 - k^2)` across
/// it. In the middle that is `|z|` and 1, and no disc is drawn narrower than there: at a sphere's limb the far side would show.
/// Where the former is more than the latter, the disc is drawn as a circle.
#[inline(always)]
fn disc_stretch([nx, ny, nz]: [Lane; 3], [x, y]: [Lane; 2]) -> [Lane; 2] {
    let k = x * nx + y * ny;
    let along = (nz - k).abs();
    let across = ((x * x + y * y) * (nx * nx + ny * ny) - k * k + 1.0).max(Vec4::ONE).sqrt();
    [along, across.max(along)]
}

/// Ellipses' minor axes over their major ones: never so small that an ellipse falls between pixels.
#[inline(always)]
fn filter_minor(minor: Lane, radius_px: Lane) -> Lane {
    (minor * MINOR_FACTOR).max(MINOR_MIN_PX / radius_px).min(Vec4::ONE)
}
