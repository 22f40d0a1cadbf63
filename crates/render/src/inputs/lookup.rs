//! Attributes of single points: their numbers in a frame ([`DrawList`]), and their colours, radii,
//! normals and marks, read from the planes of the drawn nodes. Passes look up the points that won a
//! pixel (`marroquim2007`, section 3.1).
//!
//! The drawn radius is the stored one, which is in units of the node's spacing, times the effective
//! spacing of the finest drawn cell that holds the point; radii of over 8 spacings are drawn as
//! they are stored (`docs/design/surfaces.md`).

use crate::frame::{ColourPlane, DrawNode, Frame};
use crate::gpu::memory::table::CHUNK_POINTS;
use crate::inputs::camera::{Camera, NodePlace, Positions};
use crate::inputs::colour::{ColourBy, MapTable, PLAIN, hue, linear};
use esker_points::Node;
use esker_points::fetch::fetch;
use esker_points::quant::{
    HIDDEN_AT, HOT_POSITION_BYTES, INDEX_AT, SCALED_CODE_MAX, oct_decode, radius_factor,
};
use glam::Vec3;

/// Greatest drawn radius: sums of depth and radius stay finite.
pub(crate) const RADIUS_MAX: f32 = 1e30;
/// Octahedral code of a point without a normal.
pub(crate) const NO_NORMAL: [i16; 2] = [i16::MIN; 2];

/// Numbers of the points of a frame. Each draw begins at a multiple of [`CHUNK_POINTS`], as on a
/// GPU, so a table of chunks gives the draw of a point without a search.
#[derive(Clone, Debug, Default)]
pub struct DrawList {
    /// Number of the first point of each draw.
    pub starts: Vec<u32>,
    /// Points of each draw.
    counts: Vec<u32>,
    /// Draw of each chunk of numbers.
    owners: Vec<u32>,
    points: u32,
}

impl DrawList {
    /// Numbers the points of `draws`. Points beyond the last number are not drawn.
    pub fn new(draws: &[DrawNode<'_>]) -> Self {
        let mut list = Self::default();
        let mut next = 0u64;
        for (owner, draw) in (0..).zip(draws) {
            // The last chunk stays free: all ones is no point.
            let left = u64::from(u32::MAX - CHUNK_POINTS).saturating_sub(next);
            let count = (Positions::of(draw).len as u64).min(left) as u32;
            let chunks = count.div_ceil(CHUNK_POINTS);
            list.starts.push(next as u32);
            list.counts.push(count);
            list.owners.extend(std::iter::repeat_n(owner, chunks as usize));
            list.points += count;
            next += u64::from(chunks) * u64::from(CHUNK_POINTS);
        }
        list
    }

    /// Number of points of a draw.
    pub fn len(&self, draw: usize) -> usize {
        self.counts[draw] as usize
    }

    /// Whether the frame has no point.
    pub fn is_empty(&self) -> bool {
        self.points == 0
    }

    /// Number of points of the frame.
    pub fn points(&self) -> u32 {
        self.points
    }

    /// Draw of a numbered point, and its index in the draw.
    ///
    /// # Panics
    /// If no point has that number.
    #[inline]
    pub fn find(&self, point: u32) -> (usize, usize) {
        let draw = self.owners[(point / CHUNK_POINTS) as usize] as usize;
        (draw, (point - self.starts[draw]) as usize)
    }
}

/// Tables of a frame, from which attributes of its points are looked up.
pub struct Lookup<'a> {
    pub(crate) frame: &'a Frame<'a>,
    pub(crate) camera: &'a Camera,
    pub(crate) list: &'a DrawList,
    pub(crate) draws: Vec<DrawLookup<'a>>,
    map: Option<MapTable>,
    codes: Option<Box<[Vec3; 256]>>,
    /// Stored radius over the effective spacing, for each radius code.
    pub(crate) radius_factors: [f32; 256],
}

/// Values that all points of a draw share.
pub(crate) struct DrawLookup<'a> {
    pub(crate) positions: Positions<'a>,
    pub(crate) place: NodePlace,
    colour: Vec3,
    /// Effective spacing of the points, if no node below theirs is drawn.
    spacing: Option<f32>,
}

impl<'a> Lookup<'a> {
    /// Builds the tables of `frame`.
    pub fn new(frame: &'a Frame<'a>, camera: &'a Camera, list: &'a DrawList) -> Self {
        let map = match &frame.colour {
            ColourBy::Scalar(m) | ColourBy::Coordinate(_, m) | ColourBy::EyeDepth(m) => {
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

    /// Whether any draw has normals.
    pub fn has_normals(&self) -> bool {
        self.frame.draws.iter().any(|d| d.normal.is_some())
    }

    /// Positions of the points of `draw`, and the place of their node relative to the eye.
    pub(crate) fn places(&self, draw: usize) -> (&Positions<'a>, &NodePlace) {
        (&self.draws[draw].positions, &self.draws[draw].place)
    }

    /// Colour of a numbered point at `depth`, in linear light.
    pub fn colour_of(&self, point: u32, depth: f32) -> Vec3 {
        let (d, index) = self.list.find(point);
        let (offset, _) = self.draws[d].positions.offset(index);
        self.colour(d, index, offset, depth)
    }

    /// Drawn radius of the point of `draw` at `offset` with radius code `code`.
    #[inline(always)]
    pub(crate) fn radius(&self, draw: usize, offset: [u32; 3], code: u8) -> f32 {
        self.radius_at_spacing(self.spacing(draw, offset, code), code)
    }

    /// Drawn radius of a point with radius code `code`, given its effective spacing.
    #[inline(always)]
    fn radius_at_spacing(&self, spacing: f32, code: u8) -> f32 {
        let radius = spacing * self.radius_factors[usize::from(code)];
        if radius.is_nan() { 0.0 } else { radius.clamp(0.0, RADIUS_MAX) }
    }

    /// Drawn radii of all radius codes, if all points of `draw` have the same effective spacing.
    pub(crate) fn radii(&self, draw: usize) -> Option<[f32; 256]> {
        let spacing = self.draws[draw].spacing?;
        let own = self.frame.draws[draw].node.spacing;
        let spacing = |code: u8| if code > SCALED_CODE_MAX { own } else { spacing };
        Some(std::array::from_fn(|code| self.radius_at_spacing(spacing(code as u8), code as u8)))
    }

    /// Spacing by which the radius of the point of `draw` at `offset` is scaled: the effective one
    /// of the finest drawn cell that holds it, or that of its node if its `code` does not follow
    /// what is drawn.
    #[inline(always)]
    pub(crate) fn spacing(&self, draw: usize, offset: [u32; 3], code: u8) -> f32 {
        if code > SCALED_CODE_MAX {
            return self.frame.draws[draw].node.spacing;
        }
        // Most points are in the finest nodes.
        self.draws[draw].spacing.unwrap_or_else(|| self.spacing_below(draw, offset))
    }

    /// Effective spacing looked up in the octree of drawn cells, below the point's node.
    fn spacing_below(&self, draw: usize, offset: [u32; 3]) -> f32 {
        let draw = &self.frame.draws[draw];
        let Some(octree) = self.frame.octree else { return draw.node.spacing };
        let p = [0, 1, 2].map(|i| draw.node.box_min[i].wrapping_add(offset[i]));
        spacing_or(octree.spacing_from(draw.entry, p), draw.node)
    }

    /// Colour of all points of `draw` in linear light, if they have the same.
    pub(crate) fn only_colour(&self, draw: usize) -> Option<Vec3> {
        let by = self.frame.colour;
        let has_none = matches!(self.frame.draws[draw].colour, ColourPlane::None);
        let is_one = matches!(by, ColourBy::Plain | ColourBy::Cell) || by.reads_plane() && has_none;
        is_one.then_some(self.draws[draw].colour)
    }

    /// Prefetches the attributes of a numbered point, its normal only if `reads_normal`.
    #[inline(always)]
    pub(crate) fn prefetch(&self, point: u32, reads_normal: bool) {
        let (d, index) = self.list.find(point);
        self.draws[d].positions.fetch(index);
        let draw = &self.frame.draws[d];
        match draw.colour {
            ColourPlane::Rgba(plane) => fetch(plane, index * 4),
            ColourPlane::Scalar { bytes, ty } => fetch(bytes, index * ty.size()),
            _ => (),
        }
        if reads_normal && let Some(plane) = draw.normal {
            fetch(plane, index * 4);
        }
    }

    /// Colour of point `index` of draw `d`, which is at `offset` in its node and at `depth`, in
    /// linear light.
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
            (ColourBy::Coordinate(axis, _), _, Some(map)) => {
                let axis = axis.min(2);
                let steps = f64::from(draw.node.box_min[axis]) + f64::from(offset[axis]);
                map.at(self.frame.lattice.world_axis(axis, steps))
            }
            (ColourBy::EyeDepth(_), _, Some(map)) => map.at(f64::from(depth)),
            (ColourBy::Normal, ..) => {
                draw.normal.map_or(plain, |plane| normal_at(plane, index) * 0.5 + Vec3::splat(0.5))
            }
            _ => plain,
        }
    }
}

/// `drawn`, or the own spacing of `node` where `drawn` is not positive: then nothing is known about
/// how it is drawn.
fn spacing_or(drawn: f32, node: &Node) -> f32 {
    if drawn > 0.0 { drawn } else { node.spacing }
}

/// Whether point `index` is marked as hidden.
pub(crate) fn is_hidden(positions: &[u8], index: usize) -> bool {
    positions.get(index * HOT_POSITION_BYTES + HIDDEN_AT).is_some_and(|&mark| mark != 0)
}

/// Octahedral code of the normal of point `index`, if the plane is long enough.
#[inline]
pub(crate) fn normal_code(normals: &[u8], index: usize) -> Option<[i16; 2]> {
    let b = normals.get(index * 4..index * 4 + 4)?;
    Some([i16::from_le_bytes([b[0], b[1]]), i16::from_le_bytes([b[2], b[3]])])
}

/// World normal of point `index`; zero if it has none or the plane is too short.
#[inline]
pub(crate) fn normal_at(normals: &[u8], index: usize) -> Vec3 {
    normal_code(normals, index).map_or(Vec3::ZERO, |code| Vec3::from_array(oct_decode(code)))
}
