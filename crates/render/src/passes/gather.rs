//! Gather (marroquim2007 section 3.1): writes the attributes of the points that won a pixel into
//! level 0 of the pyramid. Radius, normal and colour are looked up once a covered pixel and not
//! once a point.
//!
//! The drawn radius is the stored radius, in units of the node's spacing, times the effective
//! spacing of the finest drawn cell that holds the point. See `docs/design/surfaces.md`.

use crate::frame::{ColourPlane, Frame};
use crate::inputs::camera::{Camera, NodePlace, Positions};
use crate::inputs::colour::{ColourBy, MapTable, PLAIN, hue, linear};
use crate::passes::fit_planes::{BARE_REACH, FittedPlane, FittedPlanes};
use crate::passes::project::{DrawList, EMPTY, NO_NORMAL, normal_at, normal_code, unpack};
use crate::passes::tangent::{Lens, SLOPE_MAX};
use crate::picture::pyramid::{
    FITTED, FLAT, INVALID, Level, NORMALS, Planes, RowMut, for_each_row,
};
use crate::simd::lanes::{LANES, Pixels, moved, only};
use crate::simd::values::{Lane, directions};
use esker_points::Node;
use esker_points::fetch::fetch;
use esker_points::quant::{HOT_POSITION_BYTES, INDEX_AT, radius_factor};
use fearless_simd::{Level as Simd, dispatch};
use glam::{Vec3, Vec4};
use std::sync::atomic::{AtomicU64, AtomicU64 as Counter, Ordering::Relaxed};

/// Drawn radius over stored radius, with normals and without. A coarser pixel's ellipse is the mean
/// of its points' ellipses, which covers less than they do: covering radii as they are leave holes
/// in tilted walls. Circles lose less, and any excess shows at silhouettes.
pub(crate) const RADIUS_FACTOR: [f32; 2] = [1.4, 1.15];
/// Added to radii in the picture, pixels, with normals and without, since a pixel is covered only
/// if its centre is. With 0.2 the far side shows through a sphere of half a point a pixel.
pub(crate) const RADIUS_MARGIN_PX: [f32; 2] = [0.35, 0.5];
/// Share of the perspective stretch away from the middle of the picture that radii take. The
/// greatest gaps of even samples are 0.84 spacings and discs without normals are 1.15 wide, so that
/// only a stretch beyond their ratio opens gaps. A larger share makes arriving nodes visible
/// (`crates/engine/tests/popping.rs`).
pub(crate) const STRETCHED: f32 = 0.83;
/// Minor axis over that of the projected disc, for tilted discs: the mean of two ellipses one above
/// the other covers least.
pub(crate) const MINOR_FACTOR: f32 = 1.3;
/// Half the least minor axis of an ellipse, pixels. Thinner ellipses pass between the centres of
/// pixels, which leaves holes in floors seen at a slant.
pub(crate) const MINOR_MIN_PX: f32 = 1.4;
/// Thickness of a surface across its plane, over the stored radius, with normals.
pub(crate) const THICKNESS: f32 = 1.0;
/// Greatest length of the depth interval over the drawn radius where planes are fitted: the fit of
/// steep planes is rough.
pub(crate) const FITTED_REACH_MAX: f32 = 3.0;
/// Greatest radius, so that sums of depth and radius stay finite.
pub(crate) const RADIUS_MAX: f32 = 1e30;

/// Tables made once a frame, to look up attributes of points.
pub struct Lookup<'a> {
    pub(crate) frame: &'a Frame<'a>,
    pub(crate) camera: &'a Camera,
    pub(crate) list: &'a DrawList,
    draws: Vec<DrawLookup<'a>>,
    map: Option<MapTable>,
    codes: Option<Box<[Vec3; 256]>>,
    radius_factors: [f32; 256],
}

struct DrawLookup<'a> {
    positions: Positions<'a>,
    place: NodePlace,
    colour: Vec3,
    /// Effective spacing of the points, if nothing is drawn below their node.
    spacing: Option<f32>,
}

impl<'a> Lookup<'a> {
    /// Makes the tables of a frame.
    pub fn new(frame: &'a Frame<'a>, camera: &'a Camera, list: &'a DrawList) -> Self {
        let map = match &frame.colour {
            ColourBy::Scalar(m) | ColourBy::Elevation(m) | ColourBy::EyeDepth(m) => {
                Some(MapTable::new(m))
            }
            _ => None,
        };
        let draws = frame.draws.iter().map(|draw| {
            let positions = Positions::of(draw);
            let place = camera.place(draw.node, positions.is_exact());
            let colour = match frame.colour {
                ColourBy::Cell => hue(u32::from(draw.node.cell_log2)),
                _ => linear(PLAIN),
            };
            let drawn = frame.octree.filter(|o| draw.entry < o.len());
            let spacing = match drawn.map(|octree| octree.leaf_spacing(draw.entry)) {
                Some(leaf) => leaf.map(|drawn| spacing_or(drawn, draw.node)),
                None => Some(draw.node.spacing),
            };
            DrawLookup { positions, place, colour, spacing }
        });
        Self {
            frame,
            camera,
            list,
            draws: draws.collect(),
            map,
            codes: match frame.colour {
                ColourBy::Codes(book) => Some(Box::new(book.colours())),
                _ => None,
            },
            radius_factors: std::array::from_fn(|code| radius_factor(code as u8)),
        }
    }

    /// Whether any node has normals.
    pub fn has_normals(&self) -> bool {
        self.frame.draws.iter().any(|d| d.normal.is_some())
    }

    /// Positions of a draw's points, and the place of their node relative to the eye.
    pub(crate) fn places(&self, draw: usize) -> (&Positions<'a>, &NodePlace) {
        (&self.draws[draw].positions, &self.draws[draw].place)
    }

    /// Colour of a point, for the method without surfaces.
    pub fn colour_of(&self, point: u32, depth: f32) -> Vec3 {
        let (d, index) = self.list.find(point);
        let (offset, _) = self.draws[d].positions.offset(index);
        self.colour(d, index, offset, depth)
    }

    /// Drawn radius of a point, from its offset and its radius code.
    #[inline(always)]
    pub(crate) fn radius(&self, draw: usize, offset: [u32; 3], code: u8) -> f32 {
        self.radius_in(self.spacing(draw, offset), code)
    }

    /// Drawn radius of a point with an effective spacing.
    #[inline(always)]
    fn radius_in(&self, spacing: f32, code: u8) -> f32 {
        let radius = spacing * self.radius_factors[usize::from(code)];
        if radius.is_nan() { 0.0 } else { radius.clamp(0.0, RADIUS_MAX) }
    }

    /// Radii of all codes, if all points of a draw have the same effective spacing.
    pub(crate) fn radii(&self, draw: usize) -> Option<[f32; 256]> {
        let spacing = self.draws[draw].spacing?;
        Some(std::array::from_fn(|code| self.radius_in(spacing, code as u8)))
    }

    /// Effective spacing of the finest drawn cell that holds the point.
    #[inline(always)]
    fn spacing(&self, draw: usize, offset: [u32; 3]) -> f32 {
        // Most points are in the finest nodes.
        self.draws[draw].spacing.unwrap_or_else(|| self.spacing_below(draw, offset))
    }

    fn spacing_below(&self, draw: usize, offset: [u32; 3]) -> f32 {
        let draw = &self.frame.draws[draw];
        let Some(octree) = self.frame.octree else { return draw.node.spacing };
        let p = [0, 1, 2].map(|i| draw.node.box_min[i].wrapping_add(offset[i]));
        spacing_or(octree.spacing_from(draw.entry, p), draw.node)
    }

    /// Colour that all points of a draw share, linear light, if they do.
    pub(crate) fn only_colour(&self, draw: usize) -> Option<Vec3> {
        let by = self.frame.colour;
        let has_none = matches!(self.frame.draws[draw].colour, ColourPlane::None);
        let is_one = matches!(by, ColourBy::Plain | ColourBy::Cell) || by.reads_plane() && has_none;
        is_one.then_some(self.draws[draw].colour)
    }

    /// Prefetches the attributes of the point of a frame-buffer value, if it has one.
    #[inline(always)]
    fn prefetch<const PLANE: usize>(&self, value: u64) {
        if value == EMPTY {
            return;
        }
        let (d, index) = self.list.find(unpack(value).1);
        self.draws[d].positions.fetch(index);
        let draw = &self.frame.draws[d];
        match draw.colour {
            ColourPlane::Rgba(plane) => fetch(plane, index * 4),
            ColourPlane::Scalar { bytes, ty } => fetch(bytes, index * ty.size()),
            _ => (),
        }
        if PLANE == NORMALS
            && let Some(plane) = draw.normal
        {
            fetch(plane, index * 4);
        }
    }

    /// Colour of a point, linear light.
    pub(crate) fn colour(&self, d: usize, index: usize, offset: [u32; 3], depth: f32) -> Vec3 {
        let (draw, plain) = (&self.frame.draws[d], self.draws[d].colour);
        match (self.frame.colour, draw.colour, &self.map) {
            (ColourBy::Rgb, ColourPlane::Rgba(plane), _) => {
                plane.get(index * 4..index * 4 + 3).map_or(plain, |b| linear([b[0], b[1], b[2]]))
            }
            (ColourBy::Scalar(_), ColourPlane::Scalar { bytes, ty }, Some(map)) => {
                let size = ty.size();
                bytes.get(index * size..(index + 1) * size).map_or(plain, |b| map.at(ty.to_f64(b)))
            }
            (ColourBy::Codes(_), ColourPlane::Scalar { bytes, ty }, _) => bytes
                .get(index * ty.size()..(index + 1) * ty.size())
                .zip(self.codes.as_deref())
                .map_or(plain, |(b, colours)| colours[usize::from(ty.to_f64(b) as u8)]),
            (_, ColourPlane::Indexed, map) if self.frame.colour.reads_plane() => {
                let number = draw.position.get(index * HOT_POSITION_BYTES + INDEX_AT);
                match (number, self.codes.as_deref(), map) {
                    (Some(&i), Some(colours), _) => colours[usize::from(i)],
                    (Some(&i), None, Some(map)) => map.at(f64::from(i)),
                    _ => plain,
                }
            }
            (ColourBy::Elevation(_), _, Some(map)) => {
                let z = f64::from(draw.node.box_min[2]) + f64::from(offset[2]);
                map.at(self.frame.lattice.world_axis(2, z))
            }
            (ColourBy::EyeDepth(_), _, Some(map)) => map.at(f64::from(depth)),
            (ColourBy::Normal, ..) => {
                draw.normal.map_or(plain, |plane| normal_at(plane, index) * 0.5 + Vec3::splat(0.5))
            }
            _ => plain,
        }
    }
}

/// The drawn spacing, or the spacing of the node if that is not known.
fn spacing_or(drawn: f32, node: &Node) -> f32 {
    if drawn > 0.0 { drawn } else { node.spacing }
}

/// Fills level 0 from the frame buffer `target`, with the planes of `fitted` if pixels have fitted
/// planes. Returns the number of valid pixels.
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
const fn bare<const PLANE: usize>() -> usize {
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
        if let Some(ahead) = values.get(x + AHEAD) {
            pass.lookup.prefetch::<PLANE>(ahead.load(Relaxed));
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

/// Points that are fetched before they are processed, so that their cache misses overlap.
const HITS: usize = 32;
/// Distance in pixels at which points are prefetched.
const AHEAD: usize = 24;

/// Points of a row that won a pixel, as arrays of attributes.
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
    /// Position relative to the eye, in steps of the lattice.
    steps: [[f32; HITS]; 3],
    /// Stored radius, in the file's unit.
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

    /// Adds the point that won pixel `x`. Needs room for it.
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

    /// Writes all points as pixels, and empties the list.
    #[inline(always)]
    fn write_all<const PLANE: usize>(&mut self, pass: Gather<'_>, row: &mut RowMut<'_>) {
        let lookup = pass.lookup;
        let factor = RADIUS_FACTOR[bare::<PLANE>()];
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

    /// Writes four points, from `first` on, as pixels.
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
        // `max` and `min` return the second operand if the first is NaN, so that NaN becomes 0.
        let stored = four(&self.radius).max(Vec4::ZERO);
        let radius = stored.min(Vec4::splat(RADIUS_MAX));
        let depth = four(&self.depth);
        let margin = RADIUS_MARGIN_PX[bare::<PLANE>()];
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
        let seen = [
            (centre[0] - camera.centre_px[0]) * per_focal,
            (Vec4::splat(camera.centre_px[1]) - centre[1]) * per_focal,
        ];
        let mut radius_px = in_pixels(Vec4::ONE, sphere_stretch(seen));
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
            // From the point's projection to the pixel's centre, limited to the pixel, however the
            // projection was rounded.
            out.front[2] = within_half(centre[0] - place[0]);
            out.front[3] = within_half(centre[1] - place[1]);
            if let (FITTED, Some(fitted)) = (PLANE, pass.fitted) {
                let [growth @ .., across] = four_planes(fitted, to, row.y, in_middle + margin);
                let (tilt, plate, normal) = plane_of(camera, place, growth);
                let is_fitted = (growth[0].abs() + growth[1].abs()).cmpgt(Vec4::ZERO);
                let [_, major] = disc_axes(normal, seen);
                radius_px = Vec4::select(is_fitted, in_pixels(Vec4::ONE, major), radius_px);
                out.tint[3] = radius_px;
                reach = radius * (plate * across).min(Vec4::splat(FITTED_REACH_MAX));
                // Discs stay at the centres of their pixels, with the depth that their planes have
                // there.
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
                // If back faces are not culled, normals are turned to the eye.
                let is_away = (x + y + z).cmpgt(Vec4::ZERO);
                let turns = !pass.lookup.frame.cull_back_faces;
                let turn = |c: Lane| if turns { Vec4::select(is_away, -c, c) } else { c };
                let turned = [turn(normal[0]), turn(normal[1]), turn(normal[2])];
                let plate = Lens::new(camera).thickness(turned, place);
                let thick = radius * (THICKNESS / RADIUS_FACTOR[0]) * plate;
                reach = Vec4::select(has_normal, thick, reach);
                let [minor, major] = disc_axes(turned, seen);
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

/// Fitted planes of four pixels of row `y`: growth of depth to the right and down, and reach.
#[inline(always)]
fn four_planes(fitted: &FittedPlanes, to: &[usize; LANES], y: usize, radius_px: Lane) -> [Lane; 3] {
    let radii = radius_px.to_array();
    let mut all = [[0.0; LANES]; 3];
    for k in 0..LANES {
        let is_there = to[k] != usize::MAX;
        let plane = if is_there { fitted.at(to[k], y, radii[k]) } else { FittedPlane::NONE };
        (all[0][k], all[1][k], all[2][k]) = (plane.growth[0], plane.growth[1], plane.reach);
    }
    all.map(Vec4::from_array)
}

/// For planes whose depth grows by `right` and `down` a pixel at `place`: the tilt
/// ([`Level::tilt`]), limited to the steepest slope that is followed; the depth of plates of unit
/// thickness; and the normals in view space.
#[inline(always)]
fn plane_of(
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

/// Clamps to half a pixel to either side.
#[inline(always)]
fn within_half(x: Lane) -> Lane {
    x.max(Vec4::splat(-0.5)).min(Vec4::splat(0.5))
}

/// Radius of a projected sphere along its major axis over that in the middle of the picture. The
/// sphere is seen in direction (x, y) to the right and upwards, over the depth; perspective
/// stretches it away from the middle.
#[inline(always)]
fn sphere_stretch([x, y]: [Lane; 2]) -> Lane {
    (x * x + y * y + 1.0).sqrt()
}

/// Semi-axes, minor and major, of a projected disc with view-space normal n, over the radius of a
/// disc in the middle of the picture that faces the eye. A step `v` in space projects to
/// `v.xy + seen v.z`, where z grows towards the eye. So the disc reaches `|z - k|` along its
/// normal's projection, with `k = seen . normal.xy`, and `sqrt(1 + |seen|^2 |normal.xy|^2 - k^2)`
/// across it. In the middle these are `|z|` and 1. No disc is drawn narrower than there: the far
/// side would show at a sphere's limb. If the former exceeds the latter, the disc is drawn as a
/// circle.
#[inline(always)]
fn disc_axes([nx, ny, nz]: [Lane; 3], [x, y]: [Lane; 2]) -> [Lane; 2] {
    let k = x * nx + y * ny;
    let along = (nz - k).abs();
    let across = ((x * x + y * y) * (nx * nx + ny * ny) - k * k + 1.0).max(Vec4::ONE).sqrt();
    [along, across.max(along)]
}

/// Minor over major axis of ellipses, at least so large that no ellipse falls between pixels.
#[inline(always)]
fn filter_minor(minor: Lane, radius_px: Lane) -> Lane {
    (minor * MINOR_FACTOR).max(MINOR_MIN_PX / radius_px).min(Vec4::ONE)
}
