//! A thin tube along a torus knot with scales and a ridge of spikes: fine relief that shadows
//! itself, as the skin of a dragon does, above a floor between two walls.

use super::solids::Solids;
use super::view::{Lamp, Viewpoint};
use crate::mesh::triangles::{TriangleMesh, add, cross, dot, sub, unit};
use std::f64::consts::TAU;

pub const VIEW: Viewpoint =
    Viewpoint { eye: [1.5, -4.3, 2.35], target: [0.0, 0.0, 1.42], fov_deg: 42.0 };

pub const LAMPS: [Lamp; 2] = [
    Lamp::Sun {
        azimuth_deg: 215.0,
        elevation_deg: 38.0,
        diameter_deg: 2.0,
        irradiance: [2.6, 2.35, 2.0],
    },
    Lamp::Sky { zenith: [0.25, 0.4, 0.7], horizon: [0.6, 0.65, 0.7] },
];

/// Turns about the axis of the torus and about its core; without a common divisor.
const TURNS: [f64; 2] = [2.0, 5.0];
/// Radii of the torus: of its core and from the core.
const TORUS_M: [f64; 2] = [0.95, 0.4];
/// Mean radius of the tube.
const TUBE_M: f64 = 0.105;
/// Rows of scales along the tube, even so that every other row is shifted, and scales in a row.
const SCALES: [f64; 2] = [260.0, 14.0];
/// Height of the centre above the floor.
const CENTRE_M: f64 = 1.5;
/// Length of the tube divided by its circumference, so that quads are about square.
const ASPECT: f64 = 25.0;
/// Triangles of the floor and the walls.
const WALLS: u64 = 36;

/// The knot with about this number of triangles.
pub fn make(triangles: u64) -> TriangleMesh {
    let quads = (triangles - WALLS) as f64 / 2.0;
    let around = ((quads / ASPECT).sqrt().round() as usize).max(3);
    let along = ((quads / around as f64).round() as usize).max(3);
    let mut mesh = TriangleMesh::default();
    for i in 0..along {
        let t = i as f64 / along as f64;
        let frame = Frame::at(t);
        for j in 0..around {
            mesh.positions.push(frame.skin(t, j as f64 / around as f64));
        }
    }
    for i in 0..along {
        for j in 0..around {
            let at = |i: usize, j: usize| ((i % along) * around + j % around) as u32;
            let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut solids = Solids::of(mesh, |p| {
        let green = 0.5 + 0.5 * libm::sin(p[0] * 3.0 + p[2] * 2.0);
        [(110.0 + 60.0 * green) as u8, (160.0 + 20.0 * green) as u8, (96.0 - 30.0 * green) as u8]
    });
    solids.block([-3.0, -5.0, -0.1], [3.0, 2.0, 0.0], [190, 184, 172]);
    solids.block([-3.0, 2.0, -0.1], [3.0, 2.1, 4.5], [176, 140, 96]);
    solids.block([3.0, -5.0, -0.1], [3.1, 2.1, 4.5], [84, 112, 168]);
    // The steps between scales stay smooth, so that every vertex has one normal.
    solids.finish(0.2)
}

/// Centre of the tube at a part of its length, and the plane across it.
struct Frame {
    centre: [f64; 3],
    out: [f64; 3],
    side: [f64; 3],
}

impl Frame {
    fn at(t: f64) -> Self {
        let [around, through] = TURNS.map(|n| libm::sincos(n * t * TAU));
        let [core, radius] = TORUS_M;
        let r = core + radius * through.1;
        // The knot stands upright: the axis of the torus is y.
        let centre = [r * around.1, radius * through.0, r * around.0 + CENTRE_M];
        let dr = -radius * through.0 * TURNS[1];
        let tangent = [
            dr * around.1 - r * around.0 * TURNS[0],
            radius * through.1 * TURNS[1],
            dr * around.0 + r * around.1 * TURNS[0],
        ];
        let tangent = unit(tangent).unwrap_or([1.0, 0.0, 0.0]);
        // Away from the core of the torus: periodic, so the tube closes without a twist.
        let away = [through.1 * around.1, through.0, through.1 * around.0];
        let along = dot(away, tangent);
        let out = unit(sub(away, tangent.map(|c| c * along))).unwrap_or([0.0, 1.0, 0.0]);
        Self { centre, out, side: cross([[0.0; 3], tangent, out]) }
    }

    /// A place on the skin: at a part of the length and of the turn.
    fn skin(&self, t: f64, turn: f64) -> [f64; 3] {
        let (s, c) = libm::sincos(turn * TAU);
        let girth = TUBE_M * (0.78 + 0.22 * libm::sin(3.0 * t * TAU));
        let r = girth + relief(t, turn);
        let across = add(self.out.map(|o| o * c * r), self.side.map(|o| o * s * r));
        add(self.centre, across)
    }
}

/// Height of the relief: overlapping scales, and spikes along the back.
fn relief(t: f64, turn: f64) -> f64 {
    let row = t * SCALES[0];
    let shift = if (row as i64) & 1 == 1 { 0.5 } else { 0.0 };
    let (along, across) = (row.fract(), (turn * SCALES[1] + shift).fract());
    let across = 2.0 * across - 1.0;
    let scale = (1.0 - across * across) * (1.0 - along * along) * along.sqrt();
    // Distance from the back in turns, from -1/2 to 1/2.
    let from_back = turn - turn.round();
    let width = (1.0 - (from_back * 14.0) * (from_back * 14.0)).max(0.0);
    let spike = 0.5 - 0.5 * libm::cos(t * SCALES[0] / 4.0 * TAU);
    0.016 * scale + 0.06 * width * width * spike * spike
}
