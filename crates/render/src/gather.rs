//! Gather: the attributes of the points that won a pixel become level 0 of the pyramid (marroquim2007
//! section 3.1). Radius, normal and colour are looked up here, once a covered pixel, not once a point.
//!
//! Drawn radius (DESIGN section 8): the stored radius, in units of the node's spacing, times the
//! effective spacing of the finest drawn cell that holds the point.

use crate::camera::{Camera, NodePlace, Positions};
use crate::colour::{ColourBy, MapTable, PLAIN, hue, linear};
use crate::ellipse::{FACING, UNKNOWN};
use crate::frame::{ColourPlane, DrawNode, Frame};
use crate::project::{DrawList, EMPTY, normal_at, unpack};
use crate::pyramid::{INVALID, Level, for_each_row};
use crate::tangent::Lens;
use esker_points::quant::radius_factor;
use glam::{Vec2, Vec3, Vec4};
use std::sync::atomic::{AtomicU64, AtomicU64 as Counter, Ordering::Relaxed};

/// Drawn radii over stored ones, with normals and without. A coarser pixel's ellipse is the mean of its
/// points' ellipses, which covers less than they do: with covering radii as they are, up to 0.2 % of a
/// tilted wall's pixels stay holes, with these up to 0.01 % (jittered grids of 1 to 20 pixels, tilted 0
/// to 70 degrees). Circles lose less, and what they add shows at silhouettes.
const RADIUS_FACTOR: [f32; 2] = [1.4, 1.15];
/// Added to radii in the picture, pixels, with normals and without: pixels are covered where their centres are. With 0.2 the far side shows
/// through a sphere of half a point a pixel.
const RADIUS_MARGIN_PX: [f32; 2] = [0.35, 0.5];
/// Minor axes over those of the disc's projection, for tilted discs: the mean of two ellipses one above
/// the other covers least of all (70 degrees, 21 pixels: 0.06 % holes without, 0.01 % with).
const MINOR_FACTOR: f32 = 1.3;
/// Half the least minor axis of an ellipse, pixels. Thinner ones pass between the pixels' centres: a
/// floor tilted by 70 degrees, its points 1.7 pixels apart, had 6 % holes, with this 0.0004 %.
const MINOR_MIN_PX: f32 = 1.4;
/// Length of the depth interval over the drawn radius, for clouds without normals: one as published, but a disc of
/// unknown tilt reaches farther back: at one, floors seen aslant break into steps.
const BARE_REACH: f32 = 2.0;
/// Thickness of a surface across its plane, over the stored radius, with normals.
const THICKNESS: f32 = 1.0;
/// Radii are clamped here, so that sums of depth and radius stay finite.
const RADIUS_MAX: f32 = 1e30;

/// What is made once a frame to look points up.
pub struct Lookup<'a> {
    frame: &'a Frame<'a>,
    camera: &'a Camera,
    list: &'a DrawList,
    draws: Vec<DrawLookup<'a>>,
    map: Option<MapTable>,
    codes: Option<Box<[Vec3; 256]>>,
    radius_factors: [f32; 256],
}

struct DrawLookup<'a> {
    positions: Positions<'a>,
    place: NodePlace,
    colour: Vec3,
}

/// A point that won a pixel.
pub struct Hit {
    /// Linear light.
    pub colour: Vec3,
    /// Drawn radius, the file's unit.
    pub radius: f32,
    /// In view space, unit length, and in w its own z; zero and 1 where the point has none.
    pub normal: Vec4,
    /// Where it is on the picture, pixels.
    pub place: Vec2,
}

impl<'a> Lookup<'a> {
    /// Tables of a frame.
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
            DrawLookup { positions, place, colour }
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

    /// Whether any node brings normals.
    pub fn has_normals(&self) -> bool {
        self.frame.draws.iter().any(|d| d.normal.is_some())
    }

    /// Colour of a point alone, for the method without surfaces.
    pub fn colour_of(&self, point: u32, depth: f32) -> Vec3 {
        let (d, index) = self.list.find(point);
        let (offset, _) = self.draws[d].positions.offset(index);
        self.colour(d, index, offset, depth)
    }

    /// Everything of a point.
    fn hit<const NORMALS: bool>(&self, point: u32, depth: f32) -> Hit {
        let (d, index) = self.list.find(point);
        let draw = &self.frame.draws[d];
        let (offset, code) = self.draws[d].positions.offset(index);
        let spacing = self.spacing(draw, offset);
        let radius = (spacing
            * RADIUS_FACTOR[usize::from(!NORMALS)]
            * self.radius_factors[usize::from(code)])
        .clamp(0.0, RADIUS_MAX);
        let radius = if radius.is_nan() { 0.0 } else { radius };
        let normal = if NORMALS { self.normal(draw, index, d, offset) } else { FACING };
        let place = self.place(d, offset, depth);
        Hit { colour: self.colour(d, index, offset, depth), radius, normal, place }
    }

    /// Where a point is on the picture.
    fn place(&self, d: usize, offset: [u32; 3], depth: f32) -> Vec2 {
        let from_eye = self.draws[d].place.steps_from_eye(offset) * self.camera.step;
        let [right, up, _] = self.camera.view_from_world;
        let flat = Vec2::new(right.dot(from_eye), -up.dot(from_eye));
        Vec2::from_array(self.camera.centre_px) + flat * (self.camera.focal_px / depth)
    }

    /// Drawn radius of a point, from its offset and its radius code.
    #[inline]
    pub(crate) fn radius(&self, draw: usize, offset: [u32; 3], code: u8) -> f32 {
        let spacing = self.spacing(&self.frame.draws[draw], offset);
        let radius = spacing * self.radius_factors[usize::from(code)];
        if radius.is_nan() { 0.0 } else { radius.clamp(0.0, RADIUS_MAX) }
    }

    /// Effective spacing of the finest drawn cell that holds the point.
    fn spacing(&self, draw: &DrawNode<'_>, offset: [u32; 3]) -> f32 {
        let stored = draw.node.spacing;
        let Some(octree) = self.frame.octree.filter(|o| draw.entry < o.len()) else {
            return stored;
        };
        let p = [0, 1, 2].map(|i| draw.node.box_min[i].wrapping_add(offset[i]));
        let drawn = octree.spacing_from(draw.entry, p);
        if drawn > 0.0 { drawn } else { stored }
    }

    fn normal(&self, draw: &DrawNode<'_>, index: usize, d: usize, offset: [u32; 3]) -> Vec4 {
        let world = draw.normal.map_or(Vec3::ZERO, |plane| normal_at(plane, index));
        if world == Vec3::ZERO {
            return UNKNOWN;
        }
        let n = self.camera.to_view(world);
        // Where back faces are not culled, a normal may look either way: it is turned to the eye.
        let from_eye = self.draws[d].place.steps_from_eye(offset) * self.camera.step;
        let away = world.dot(from_eye) > 0.0 && !self.frame.cull_back_faces;
        (if away { -n } else { n }).extend(n.z)
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

/// Fills level 0 from the frame buffer. Returns the number of valid pixels.
pub fn gather(lookup: &Lookup<'_>, target: &[AtomicU64], base: &mut Level) -> u64 {
    let valid = Counter::new(0);
    if base.normal.is_empty() {
        gather_level::<false>(lookup, target, base, &valid);
    } else {
        gather_level::<true>(lookup, target, base, &valid);
    }
    valid.into_inner()
}

fn gather_level<const NORMALS: bool>(
    lookup: &Lookup<'_>,
    target: &[AtomicU64],
    base: &mut Level,
    valid: &Counter,
) {
    let width = base.width;
    let focal_px = lookup.camera.focal_px;
    let lens = Lens::new(lookup.camera);
    for_each_row(base, |row| {
        let mut count = 0;
        let values = &target[row.y * width..][..width];
        for (x, value) in values.iter().enumerate() {
            let value = value.load(Relaxed);
            if value == EMPTY {
                row.front[x] = INVALID;
                continue;
            }
            let (depth, point) = unpack(value);
            let hit = lookup.hit::<NORMALS>(point, depth);
            let radius_px = (hit.radius * focal_px / depth
                + RADIUS_MARGIN_PX[usize::from(!NORMALS)])
            .min(RADIUS_MAX);
            // From the point's place to the pixel's centre: within the pixel, however the place was rounded. Without
            // normals the place serves no plane: arriving nodes then change less where points count as pixels' centres.
            let centre = Vec2::new(x as f32, row.y as f32) + 0.5;
            let within = if NORMALS { Vec2::splat(0.5) } else { Vec2::ZERO };
            let displaced = (centre - hit.place).clamp(-within, within);
            let reach = if NORMALS && hit.normal.truncate() != Vec3::ZERO {
                let plate = lens.thickness(hit.normal, hit.place);
                hit.radius * (THICKNESS / RADIUS_FACTOR[0]) * plate
            } else {
                hit.radius * BARE_REACH
            };
            row.front[x] = Vec4::new(depth, depth + reach, displaced.x, displaced.y);
            row.tint[x] = hit.colour.extend(radius_px);
            row.depth[x] = depth;
            if NORMALS {
                row.normal[x] = hit.normal.truncate().extend(filter_z(hit.normal.w, radius_px));
            }
            count += 1;
        }
        valid.fetch_add(count, Relaxed);
    });
}

/// An ellipse's minor axis over its major one: never so small that the ellipse falls between pixels.
fn filter_z(normal_z: f32, radius_px: f32) -> f32 {
    (normal_z.abs() * MINOR_FACTOR).max(MINOR_MIN_PX / radius_px).min(1.0)
}
