//! Shapes of splats as files store them: four bytes a point for the direction of elongation, the
//! distance of points along it, and the aspect, which is that distance over the mean distance. A
//! splat is then an ellipse in its tangent plane; points of a coarser sample are equally far apart
//! in all directions, so their splats are discs again ([`Shape::half_axes`]).

/// Bytes of a point's shape.
pub const TANGENT_BYTES: usize = 4;
/// Steps of an axis's code to each side.
const AXIS_STEPS: f32 = 127.0;
/// Steps of an octave of aspects: the greatest is just under [`ASPECT_MAX`].
const ASPECT_STEPS: f32 = 128.0;
/// Greatest ratio of the long half axis to the radius of a disc of equal area.
pub const ASPECT_MAX: f32 = 4.0;

/// Greatest rotation of an axis by its code, degrees.
pub const AXIS_ERROR_DEGREES: f64 = 0.7;
/// Greatest relative error of a code's distance of points, for distances from 1/256 to 245
/// spacings, to which codes are limited.
pub const APART_ERROR: f64 = 0.022;
/// Greatest relative error of a code's aspect.
pub const ASPECT_ERROR: f64 = 0.006;

/// Widening of splats against the symmetric cells that shapes are estimated from, which are smaller
/// than the points' own cells.
pub const ROOM: f32 = 1.1;
/// Least ratio of an ellipse's size to the disc's radius. Radii are those of cells of eight points,
/// which lines fill unevenly: 1.4 times the mean distance if lines are four times as far apart as
/// their points.
pub const LEAST: f32 = 0.7;
/// Ratio of the radius to the shape's own at which a sample begins to count as coarser than the
/// points that the shape was estimated from; at one more, it does so fully.
pub const COARSER: f32 = 2.0;

/// The shape of a splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Direction of the long axis, unit length, of either sign, and not exactly in the tangent
    /// plane.
    pub along: [f32; 3],
    /// Distance of points along it, the file's unit.
    pub apart: f32,
    /// That distance over the mean distance, from 1 to [`ASPECT_MAX`].
    pub aspect: f32,
}

impl Shape {
    /// Its code, for a point of a node with this spacing. Round shapes have one code.
    pub fn code(&self, spacing: f32) -> [u8; TANGENT_BYTES] {
        let aspect = (self.aspect.max(1.0).log2() * ASPECT_STEPS).round().min(255.0) as u8;
        if aspect == 0 {
            return [0; TANGENT_BYTES];
        }
        let [x, y] = axis_code(self.along).map(i8::cast_unsigned);
        let apart = (self.apart / spacing).log2() * 16.0 + 128.0;
        // `as` saturates, and maps a value that is not a number to 0.
        [x, y, apart.round() as u8, aspect]
    }

    /// The shape of a code; any four bytes give one. `factors` are those of
    /// [`crate::quant::radius_factor`].
    #[inline]
    pub fn of_code(code: [u8; TANGENT_BYTES], spacing: f32, factors: &[f32; 256]) -> Self {
        let [x, y, apart, aspect] = code;
        Self {
            along: axis_of([x, y].map(u8::cast_signed)),
            apart: spacing * factors[usize::from(apart)],
            aspect: aspect_of(aspect),
        }
    }

    /// Half axes, long and short, of a splat `factor` times as wide as points are apart, which
    /// would be a disc of `radius` without a shape. If the radius shows that all points there are
    /// drawn, they are this shape's; points of a coarser sample are as far apart across the long
    /// axis as along it, so the result is a disc.
    #[inline]
    pub fn half_axes(&self, radius: f32, factor: f32) -> [f32; 2] {
        let apart = self.apart * factor * ROOM;
        let over = radius * self.aspect / apart;
        let share = (LEAST + (1.0 - LEAST) * (over - COARSER).clamp(0.0, 1.0)).max(1.0 / over);
        let own = radius * share.min(1.0);
        let long = own.max(apart.min(own * self.aspect));
        [long, own * (own / long)]
    }
}

/// Aspect of its code.
#[inline]
pub fn aspect_of(code: u8) -> f32 {
    (f32::from(code) / ASPECT_STEPS).exp2()
}

/// A direction, of either sign, as two bytes: a hemisphere's octahedron, rotated by 45 degrees,
/// fills the square.
pub fn axis_code(along: [f32; 3]) -> [i8; 2] {
    let sum = along[0].abs() + along[1].abs() + along[2].abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return [0; 2];
    }
    let sum = if along[2] < 0.0 { -sum } else { sum };
    let (x, y) = (along[0] / sum, along[1] / sum);
    [x + y, x - y].map(|c| (c * AXIS_STEPS).round() as i8)
}

/// Direction of its code, unit length.
#[inline]
pub fn axis_of(code: [i8; 2]) -> [f32; 3] {
    let [u, v] = code.map(|c| (f32::from(c) / AXIS_STEPS).max(-1.0));
    let (x, y) = ((u + v) * 0.5, (u - v) * 0.5);
    let z = 1.0 - x.abs() - y.abs();
    let norm = (x * x + y * y + z * z).sqrt();
    [x / norm, y / norm, z / norm]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quant::radius_factor;
    use proptest::prelude::*;

    fn factors() -> [f32; 256] {
        std::array::from_fn(|code| radius_factor(code as u8))
    }

    /// Angle between two directions, either way round, degrees.
    fn angle(a: [f32; 3], b: [f32; 3]) -> f64 {
        let dot = |a: [f32; 3], b: [f32; 3]| -> f64 {
            (0..3).map(|i| f64::from(a[i]) * f64::from(b[i])).sum()
        };
        (dot(a, b).abs() / (dot(a, a) * dot(b, b)).sqrt()).min(1.0).acos().to_degrees()
    }

    proptest! {
        #[test]
        fn a_shape_comes_back_within_the_steps_of_its_code(
            along in [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], aspect in 1.0f32..=ASPECT_MAX, log in -7.0f32..7.0, spacing in 1e-3f32..1e3,
        ) {
            prop_assume!(along.iter().map(|c| c * c).sum::<f32>() > 1e-4);
            let shape = Shape { along, apart: spacing * log.exp2(), aspect };
            let back = Shape::of_code(shape.code(spacing), spacing, &factors());
            let off = |of: f32, from: f32| (f64::from(of) / f64::from(from) - 1.0).abs();
            prop_assert!(off(back.aspect, aspect) <= ASPECT_ERROR, "{back:?}");
            if back.aspect > 1.0 {
                let turned = angle(along, back.along);
                prop_assert!(turned <= AXIS_ERROR_DEGREES, "{turned}");
                prop_assert!(off(back.apart, shape.apart) <= APART_ERROR, "{back:?}");
            }
        }

        #[test]
        fn any_bytes_are_a_harmless_shape(code: [u8; 4], radius in 1e-6f32..1e6, spacing in 1e-6f32..1e6) {
            let shape = Shape::of_code(code, spacing, &factors());
            let [long, short] = shape.half_axes(radius, 1.2);
            prop_assert!(shape.along.iter().all(|c| c.is_finite()));
            let area = long * short / (radius * radius);
            prop_assert!(short > 0.0 && long >= short && long <= radius * ASPECT_MAX);
            prop_assert!(area > LEAST * LEAST * 0.999 && area < 1.001, "{area}");
        }
    }

    #[test]
    fn coarser_samples_have_rounder_splats_without_a_step() {
        let shape = Shape { along: [1.0, 0.0, 0.0], apart: 3.0 / ROOM, aspect: 1.5 };
        let of = |radius: f32, factor: f32| {
            shape.half_axes(radius, factor).map(|half| (half * 1e4).round())
        };
        // As dense as the points are, also by a radius that is too large: their own ellipse.
        assert_eq!(of(2.0, 1.0), [30_000.0, 13_333.0]);
        assert_eq!(of(2.5, 1.0), [30_000.0, 13_333.0]);
        // Drawn wider, it is wider; denser than the points were, it is smaller.
        assert_eq!(of(2.4, 1.2), [36_000.0, 16_000.0]);
        assert_eq!(of(1.0, 1.0), [15_000.0, 6667.0]);
        // The gaps along it stay; across they grow, until all are alike.
        assert_eq!(of(4.0, 1.0), [30_000.0, 26_133.0]);
        assert_eq!(of(6.0, 1.0), [60_000.0; 2]);
        // Without a step.
        let axes: Vec<_> =
            (0..2000).map(|i| shape.half_axes(1.0 + i as f32 * 0.005, 1.0)).collect();
        let steps = |k: usize| axes.windows(2).map(move |w| w[1][k] / w[0][k]);
        assert!(steps(0).chain(steps(1)).all(|step| (0.99..1.02).contains(&step)));
        assert_eq!(Shape::of_code([0; 4], 1.0, &factors()).half_axes(5.0, 1.2), [5.0; 2]);
    }
}
