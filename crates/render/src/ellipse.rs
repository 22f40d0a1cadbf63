//! The elliptical box filter (marroquim2007 section 3.2): the orthogonal projection of a point's disc
//! onto the picture. Its major axis is twice the radius, across the normal's projection; its minor axis
//! is the major one times the normal's z.

use glam::{Vec2, Vec4};

/// Whether a place lies in the ellipse; `from_centre` and `radius` in pixels (y down), `normal` in view
/// space (y up) and of any length: its x and y, and in w the z that the ellipse is made with.
///
/// With the unit normal n, offset v and m the normal's projection, the ellipse is
/// `(v.m/|m|)^2 / (r nz)^2 + (v x m/|m|)^2 / r^2 <= 1`. Multiplied out with `|m|^2 = 1 - nz^2` that is
/// `(v.m)^2 + |v|^2 nz^2 <= r^2 nz^2`: no division, and as n stands squared everywhere its length
/// cancels. Edge on (nz = 0) the inequality holds along a whole line, hence the circle as well; without
/// a normal the circle alone is left.
#[inline(always)]
pub fn covers(from_centre: Vec2, radius: f32, normal: Vec4) -> bool {
    let beyond = from_centre.length_squared() - radius * radius;
    let along = from_centre.x * normal.x - from_centre.y * normal.y;
    beyond <= 0.0 && along * along + beyond * (normal.w * normal.w) <= 0.0
}

/// The normal of a disc that faces the viewer: the ellipse is a circle.
pub const FACING: Vec4 = Vec4::new(0.0, 0.0, 1.0, 1.0);

/// A point without a normal among points that have one: a circle, and nothing to add to a mean.
pub const UNKNOWN: Vec4 = Vec4::new(0.0, 0.0, 0.0, 1.0);

#[cfg(test)]
mod tests {
    use super::*;

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
        // Tilted by 60 degrees towards the upper right: nz = 1/2. Length does not matter.
        let n = Vec4::new(0.75f32.sqrt() * 0.6, 0.75f32.sqrt() * 0.8, 0.0, 0.5) * 7.0;
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
