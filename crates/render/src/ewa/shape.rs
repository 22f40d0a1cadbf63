//! Ellipses in the plane of the normal, where a file keeps the shapes of splats ([`esker_points::tangents`]): four at a time.

use super::real::{cross, dot};
use crate::lanes::{LANES, Lane};
use esker_points::quant::radius_factor;
use esker_points::tangents::{ASPECT_MAX, COARSER, LEAST, ROOM, TANGENT_BYTES, aspect_of, axis_of};
use glam::Vec4;

/// A splat's longest half axis over the radius of a disc as large.
pub const WIDEST: f32 = ASPECT_MAX;
/// Square of the sine between a long axis and the normal under which it tells no direction.
const SINE_MIN: f32 = 1e-4;

/// What the bytes of codes stand for.
#[derive(Clone, Debug)]
pub struct Codes {
    /// Distances, over the node's spacing.
    apart: [f32; 256],
    aspect: [f32; 256],
}

impl Default for Codes {
    fn default() -> Self {
        Self {
            apart: std::array::from_fn(|code| radius_factor(code as u8)),
            aspect: std::array::from_fn(|code| aspect_of(code as u8)),
        }
    }
}

/// Four shapes.
#[derive(Clone, Copy, Debug)]
pub struct Shapes {
    /// Long axes, in the world.
    pub along: [Lane; 3],
    /// As in [`esker_points::tangents::Shape`].
    apart: Lane,
    aspect: Lane,
}

impl Shapes {
    /// The code of a point of a plane; that of a round one where the plane is too short.
    #[inline(always)]
    pub fn code(plane: &[u8], index: usize) -> [u8; TANGENT_BYTES] {
        let bytes = plane.get(index * TANGENT_BYTES..).and_then(<[u8]>::first_chunk);
        bytes.copied().unwrap_or_default()
    }

    /// Of codes of points of a node of this spacing.
    #[inline(always)]
    pub fn of(codes: [[u8; TANGENT_BYTES]; LANES], spacing: f32, table: &Codes) -> Self {
        let [a, b, c, d] = codes.map(|[x, y, ..]| axis_of([x, y].map(u8::cast_signed)));
        let along = |i: usize| Vec4::new(a[i], b[i], c[i], d[i]);
        Self {
            along: [along(0), along(1), along(2)],
            apart: Vec4::from_array(codes.map(|c| table.apart[usize::from(c[2])])) * spacing,
            aspect: Vec4::from_array(codes.map(|c| table.aspect[usize::from(c[3])])),
        }
    }

    /// Tangents of splats as large as discs of these radii, which are `factor` times the distances of points, with these
    /// normals of unit length; `along` is [`Shapes::along`] as the normals are seen. `round` where a shape tells none.
    #[inline(always)]
    pub fn tangents(
        &self,
        along: [Lane; 3],
        normal: [Lane; 3],
        radius: Lane,
        factor: Lane,
        round: [[Lane; 3]; 2],
    ) -> [[Lane; 3]; 2] {
        let one = Vec4::ONE;
        // As `esker_points::tangents::Shape::half_axes`; round ones have no extent, and are discs.
        let apart = self.apart * factor * ROOM;
        let over = radius * self.aspect / apart;
        let coarser = (over - COARSER).max(Vec4::ZERO).min(one);
        let share = (coarser * (1.0 - LEAST) + LEAST).max(1.0 / over).min(one);
        let own = radius * share;
        let long = own.max(apart.min(own * self.aspect));
        let short = own * (own / long);
        let height = dot(along, normal);
        let flat = |i: usize| along[i] - normal[i] * height;
        let flat = [flat(0), flat(1), flat(2)];
        let squared = dot(flat, flat);
        let per_length = 1.0 / squared.sqrt();
        let u = flat.map(|c| c * per_length);
        let v = cross(normal, u);
        let is_told = squared.cmpgt(Vec4::splat(SINE_MIN)) & self.aspect.cmpgt(one);
        let or_round = |own: [Lane; 3], length: Lane, round: [Lane; 3]| {
            let or_round = |i: usize| Vec4::select(is_told, own[i] * length, round[i]);
            [or_round(0), or_round(1), or_round(2)]
        };
        [or_round(u, long, round[0]), or_round(v, short, round[1])]
    }
}
