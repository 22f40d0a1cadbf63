//! The elliptical box filter (`marroquim2007`, section 3.2): the orthogonal projection of a point's
//! disc onto the picture. Its major axis is twice the radius, across the normal's projection; its
//! minor axis is the major one times the normal's z, or a little more ([`crate::passes::gather`]).

use crate::simd::values::Values;

/// Whether positions lie in an ellipse. Given are their offsets from its centre and its `radius`
/// (pixels, y down); x and y of the disc's normal in view space (y up), of any length; and the
/// minor axis over the major one, at most 1.
///
/// With offset v, minor over major axis w and projection m of the normal, the ellipse is
/// `(v.m/|m|)^2 / (r w)^2 + (v x m/|m|)^2 / r^2 <= 1`. Multiplied out that is `(v.m)^2 (1 - w^2) <=
/// (r^2 - |v|^2) w^2 |m|^2`: there is no division, and as m is squared everywhere, its length
/// cancels. For a disc seen edge-on (w = 0) the inequality holds along a whole line, hence the test
/// of the circle; without a direction (m = 0) only the circle is tested.
#[inline(always)]
pub(crate) fn covers_at<V: Values>([x, y]: [V; 2], radius: V, [nx, ny, share]: [V; 3]) -> V::Mask {
    let beyond = x * x + y * y - radius * radius;
    let along = x * nx - y * ny;
    let (minor, tilt) = (share * share, nx * nx + ny * ny);
    let form = along * along * (-minor + 1.0) + beyond * (minor * tilt);
    let zero = x.like(0.0);
    beyond.cmple(zero) & (tilt.cmpeq(zero) | form.cmple(zero))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec2, Vec4};

    /// A disc that faces the viewer: normal's x and y, unused, and minor over major axis.
    const FACING: Vec4 = Vec4::new(0.0, 0.0, 1.0, 1.0);
    /// A point without a normal.
    const UNKNOWN: Vec4 = Vec4::new(0.0, 0.0, 0.0, 1.0);

    fn covers(from_centre: Vec2, radius: f32, normal: Vec4) -> bool {
        let disc = [normal.x, normal.y, normal.w].map(Vec4::splat);
        covers_at(from_centre.to_array().map(Vec4::splat), Vec4::splat(radius), disc).all()
    }

    #[test]
    fn a_disc_facing_the_viewer_is_a_circle() {
        for angle in 0..12 {
            let v = Vec2::from_angle(angle as f32 * 0.5);
            assert!(covers(v * 2.99, 3.0, FACING));
            assert!(!covers(v * 3.01, 3.0, FACING));
        }
    }

    #[test]
    fn the_minor_axis_lies_along_the_normal_and_is_shortened_by_its_z() {
        // Tilted by 60 degrees towards the upper right, so nz = 1/2. Length does not matter.
        let n = Vec4::new(0.6 * 7.0, 0.8 * 7.0, 0.0, 0.5);
        let (along, across) = (Vec2::new(0.6, -0.8), Vec2::new(0.8, 0.6));
        assert!(covers(along * 1.99, 4.0, n) && !covers(along * 2.01, 4.0, n));
        assert!(covers(across * 3.99, 4.0, n) && !covers(across * 4.01, 4.0, n));
        let diagonal = (along * 2.0 + across * 4.0) * 0.5f32.sqrt();
        assert!(covers(diagonal * 0.999, 4.0, n) && !covers(diagonal * 1.001, 4.0, n));
    }

    #[test]
    fn an_edge_on_disc_is_a_line_and_no_normal_is_a_circle() {
        let edge_on = Vec4::new(1.0, 0.0, 0.0, 0.0);
        assert!(covers(Vec2::new(0.0, 1.5), 2.0, edge_on));
        assert!(!covers(Vec2::new(0.0, 2.5), 2.0, edge_on));
        assert!(!covers(Vec2::new(0.1, 0.0), 2.0, edge_on));
        assert!(covers(Vec2::new(1.0, 1.0), 2.0, UNKNOWN));
        assert!(!covers(Vec2::new(2.0, 1.0), 2.0, UNKNOWN));
    }
}
