//! Shapes of splats that a file stores ([`esker_points::tangents`]): decodes them to ellipses in
//! the plane of the normal, eight at a time.

use crate::simd::values::{EIGHT, Values, cross, dot, load};
use esker_points::quant::radius_factor;
use esker_points::tangents::{ASPECT_MAX, COARSER, LEAST, ROOM, TANGENT_BYTES, aspect_of, axis_of};
use fearless_simd::{Simd, f32x8};

/// Longest half axis of a splat over the radius of a disc of the same area.
pub const WIDEST: f32 = ASPECT_MAX;
/// Squared sine between a long axis and the normal below which the axis has no direction in the
/// plane.
pub(crate) const SINE_MIN: f32 = 1e-4;

/// Values of the codes of shapes.
#[derive(Clone, Debug)]
pub struct ShapeTable {
    /// Distance of points along the long axis, over the spacing of the node.
    apart: [f32; 256],
    /// Ratio of that distance to the one across.
    aspect: [f32; 256],
}

impl Default for ShapeTable {
    fn default() -> Self {
        Self {
            apart: std::array::from_fn(|code| radius_factor(code as u8)),
            aspect: std::array::from_fn(|code| aspect_of(code as u8)),
        }
    }
}

/// Shapes of several splats.
#[derive(Clone, Copy, Debug)]
pub struct Shapes<V> {
    /// Directions of the long axes, in the world.
    pub along: [V; 3],
    /// See [`esker_points::tangents::Shape`].
    apart: V,
    /// See [`esker_points::tangents::Shape`].
    aspect: V,
}

/// Code of the shape of a point; that of a disc if the plane is too short.
#[inline(always)]
pub fn shape_code(plane: &[u8], index: usize) -> [u8; TANGENT_BYTES] {
    let bytes = plane.get(index * TANGENT_BYTES..).and_then(<[u8]>::first_chunk);
    bytes.copied().unwrap_or_default()
}

impl<S: Simd> Shapes<f32x8<S>> {
    /// Decodes the shapes of eight points of a node with this spacing.
    #[inline(always)]
    pub fn of(
        simd: S,
        codes: &[[u8; TANGENT_BYTES]; EIGHT],
        spacing: f32,
        table: &ShapeTable,
    ) -> Self {
        let mut along = [[0.0; EIGHT]; 3];
        let (mut apart, mut aspect) = ([0.0; EIGHT], [0.0; EIGHT]);
        for (k, &[x, y, a, b]) in codes.iter().enumerate() {
            let axis = axis_of([x.cast_signed(), y.cast_signed()]);
            (along[0][k], along[1][k], along[2][k]) = (axis[0], axis[1], axis[2]);
            (apart[k], aspect[k]) = (table.apart[usize::from(a)], table.aspect[usize::from(b)]);
        }
        let of = |values: [f32; EIGHT]| load(simd, &values);
        Self { along: along.map(of), apart: of(apart) * spacing, aspect: of(aspect) }
    }
}

impl<V: Values> Shapes<V> {
    /// Tangents of splats. `along` is [`Shapes::along`] in the space of `normal`, which has unit
    /// length; `radius` is the radius of discs of the same area, `factor` times the distance of
    /// points; `round` are the tangents of these discs, for splats without a shape.
    #[inline(always)]
    pub fn tangents(
        &self,
        along: [V; 3],
        normal: [V; 3],
        radius: V,
        factor: V,
        round: [[V; 3]; 2],
    ) -> [[V; 3]; 2] {
        let one = radius.like(1.0);
        // As in `esker_points::tangents::Shape::half_axes`; an aspect of at most 1 is a disc.
        let apart = self.apart * factor * ROOM;
        let over = radius * self.aspect / apart;
        let coarser = (over - COARSER).max(radius.like(0.0)).min(one);
        let share = (coarser * (1.0 - LEAST) + LEAST).max(one / over).min(one);
        let own = radius * share;
        let long = own.max(apart.min(own * self.aspect));
        let short = own * (own / long);
        let height = dot(along, normal);
        let [x, y, z] = normal;
        let flat = [along[0] - x * height, along[1] - y * height, along[2] - z * height];
        let squared = dot(flat, flat);
        let per_length = one / squared.sqrt();
        let u = [flat[0] * per_length, flat[1] * per_length, flat[2] * per_length];
        let v = cross(normal, u);
        let has_axis = radius.like(SINE_MIN).cmplt(squared) & one.cmplt(self.aspect);
        [or_round(has_axis, u, long, round[0]), or_round(has_axis, v, short, round[1])]
    }
}

/// Axis of this length, or that of a disc where the splat has none.
#[inline(always)]
fn or_round<V: Values>(has_axis: V::Mask, own: [V; 3], length: V, round: [V; 3]) -> [V; 3] {
    [
        V::select(has_axis, own[0] * length, round[0]),
        V::select(has_axis, own[1] * length, round[1]),
        V::select(has_axis, own[2] * length, round[2]),
    ]
}
