//! Boxes in world coordinates (the file's unit, `f64`): a node's contour, which bounds its own
//! points, and a cell, which bounds its subtree. Computes the distance of a box and how much of it
//! faces the eye.

use esker_points::{Cell, Lattice, Node};
use glam::{DMat3, DVec3};

/// A box with axes of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Centre, world coordinates.
    pub centre: DVec3,
    /// Half its edges along its own axes, not negative.
    pub half: DVec3,
    /// Axes in world coordinates: orthonormal columns.
    pub axes: DMat3,
}

impl OrientedBox {
    /// The box that spans the lattice points of a cell.
    pub fn of_cell(cell: &Cell, lattice: &Lattice) -> Self {
        let low = DVec3::from_array(lattice.world(cell.first()));
        let high = DVec3::from_array(lattice.world(cell.last()));
        Self { centre: low.midpoint(high), half: (high - low) * 0.5, axes: DMat3::IDENTITY }
    }

    /// The contour of a node: holds all of the node's own points, not those of its children.
    pub fn of_contour(node: &Node, lattice: &Lattice) -> Self {
        let contour = node.contour();
        let corner = lattice.world(node.corner);
        // The corner of a cell that was moved beyond the lattice has wrapped around.
        let whole = (1u64 << 32) as f64;
        let edge = node.cell().edge();
        let reaches_beyond = |axis: usize| u64::from(node.corner[axis]) + edge > 1 << 32;
        let wraps = |axis: usize| reaches_beyond(axis) && node.box_min[axis] < node.corner[axis];
        let turn = |axis: usize| if wraps(axis) { whole * lattice.scale[axis] } else { 0.0 };
        let corner = DVec3::from_array([0, 1, 2].map(|axis| corner[axis] - turn(axis)));
        Self {
            centre: corner + DVec3::from_array(contour.centre),
            half: DVec3::from_array(contour.half).max(DVec3::ZERO),
            axes: DMat3::from_cols_array_2d(&contour.axes),
        }
    }

    /// Distance from `p` to the nearest point of the box; 0 inside.
    pub fn distance(&self, p: DVec3) -> f64 {
        let local = self.axes.transpose() * (p - self.centre);
        (local.abs() - self.half).max(DVec3::ZERO).length()
    }

    /// Radius of the enclosing sphere.
    pub fn radius(&self) -> f64 {
        self.half.length()
    }

    /// Half its extent along a unit direction.
    pub fn extent_along(&self, direction: DVec3) -> f64 {
        (self.axes.transpose() * direction).abs().dot(self.half)
    }

    /// Upper bound of the area of its silhouette seen from `eye`, divided by the area of its
    /// greatest face, in 0 to 1: 1 for a box as thick as wide, small for a flat box seen edge-on, 1
    /// for a box without area. Each face counts by the greatest cosine that a line from the eye to
    /// any point of the box can have with its normal: the eye's distance to the farther of the two
    /// planes, divided by that to the nearest point. So no part of a large box nearby is taken for
    /// edge-on because its centre is.
    pub fn facing(&self, eye: DVec3) -> f64 {
        let faces = DVec3::new(
            self.half.y * self.half.z,
            self.half.z * self.half.x,
            self.half.x * self.half.y,
        );
        let greatest = faces.max_element();
        let distance = self.distance(eye);
        if !(greatest > 0.0 && distance > 0.0) {
            return 1.0;
        }
        let heights = (self.axes.transpose() * (self.centre - eye)).abs() + self.half;
        let cosines = (heights / distance).min(DVec3::ONE);
        (faces.dot(cosines) / greatest).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plate(angle: f64) -> OrientedBox {
        OrientedBox {
            centre: DVec3::ZERO,
            half: DVec3::new(1.0, 1.0, 0.01),
            axes: DMat3::from_rotation_x(angle),
        }
    }

    #[test]
    fn an_edge_on_plate_faces_the_eye_less_and_a_cube_always_does() {
        let eye = DVec3::new(0.0, 0.0, 1000.0);
        assert!(plate(0.0).facing(eye) == 1.0);
        assert!((plate(1.0).facing(eye) - 1f64.cos()).abs() < 0.02);
        assert!(plate(std::f64::consts::FRAC_PI_2).facing(eye) < 0.02);
        // However near: the eye is in its plane.
        let near = DVec3::new(0.0, 0.0, 1.2);
        assert!(plate(std::f64::consts::FRAC_PI_2).facing(near) < 0.1);
        assert!(plate(1.5).facing(near) > 0.4);
        let cube = OrientedBox { half: DVec3::ONE, ..plate(0.3) };
        assert_eq!(cube.facing(eye), 1.0);
        let point = OrientedBox { half: DVec3::ZERO, ..plate(0.3) };
        assert_eq!(point.facing(eye), 1.0);
    }

    #[test]
    fn a_cell_spans_its_lattice_points_on_every_axis() {
        let lattice = Lattice {
            scale: [0.01, 0.1, 2.0],
            offset: [5.0; 3],
            shift: [0; 3],
            ..Lattice::default()
        };
        let cell = Cell::containing([1 << 31; 3], 3);
        let b = OrientedBox::of_cell(&cell, &lattice);
        assert!((b.centre - b.half - DVec3::splat(5.0)).length() < 1e-9);
        assert!((b.half * 2.0 - DVec3::new(0.07, 0.7, 14.0)).length() < 1e-9);
    }

    proptest! {
        #[test]
        fn no_point_of_the_box_is_nearer_than_its_distance(
            half in [0.0f64..5.0, 0.0..5.0, 0.0..5.0], at in [-1.0f64..=1.0, -1.0..=1.0, -1.0..=1.0],
            eye in [-20.0f64..20.0, -20.0..20.0, -20.0..20.0], turn in [-3.0f64..3.0, -3.0..3.0],
        ) {
            let axes = DMat3::from_rotation_x(turn[0]) * DMat3::from_rotation_z(turn[1]);
            let b = OrientedBox { centre: DVec3::ONE, half: half.into(), axes };
            let (p, eye) = (b.centre + axes * (b.half * DVec3::from_array(at)), DVec3::from_array(eye));
            prop_assert!(b.distance(eye) <= p.distance(eye) + 1e-9);
            prop_assert!(b.distance(p) < 1e-9);
            prop_assert!(p.distance(b.centre) <= b.radius() + 1e-9);
            if eye.length() > 0.1 {
                let n = eye.normalize_or_zero();
                prop_assert!(n.dot(p - b.centre).abs() <= b.extent_along(n) + 1e-9);
            }
        }
    }
}
