//! A smooth head with shoulders on a plinth, one closed surface of a distance function whose parts
//! are blended (Quilez's smooth minimum), in a niche of three coloured walls.

use super::isosurface::mesh_of;
use super::solids::Solids;
use super::view::{Lamp, Viewpoint};
use crate::mesh::triangles::{TriangleMesh, dot, sub};

pub const VIEW: Viewpoint =
    Viewpoint { eye: [0.5, -1.3, 1.0], target: [0.0, 0.03, 0.6], fov_deg: 38.0 };

pub const LAMPS: [Lamp; 2] = [
    Lamp::Sun {
        azimuth_deg: 140.0,
        elevation_deg: 42.0,
        diameter_deg: 2.0,
        irradiance: [2.6, 2.4, 2.1],
    },
    Lamp::Sky { zenith: [0.25, 0.4, 0.7], horizon: [0.6, 0.65, 0.7] },
];

/// Height of the plinth.
const PLINTH_M: f64 = 0.36;
const MARBLE: [u8; 3] = [232, 226, 214];
const STONE: [u8; 3] = [150, 138, 128];
/// Triangles of the three walls.
const WALLS: u64 = 36;

/// The bust with about this number of triangles.
pub fn make(triangles: u64) -> TriangleMesh {
    let bounds = [[-0.27, -0.25, -0.02], [0.27, 0.25, 1.06]];
    let surface = mesh_of(bounds, triangles - WALLS, distance);
    let mut solids = Solids::of(surface, |p| if p[2] < PLINTH_M + 0.005 { STONE } else { MARBLE });
    solids.block([-1.6, -2.2, -0.1], [1.6, 0.9, -0.004], [196, 190, 180]);
    solids.block([-1.6, 0.9, -0.1], [1.6, 1.0, 2.6], [186, 188, 192]);
    solids.block([-1.7, -2.2, -0.1], [-1.6, 1.0, 2.6], [176, 62, 48]);
    // The surface has no edges: those of the plinth are rounded.
    solids.finish(0.5)
}

/// Distance to the surface, about; negative inside.
fn distance(p: [f64; 3]) -> f64 {
    let base = rounded_box(p, [0.0, 0.0, 0.03], [0.21, 0.19, 0.03], 0.008);
    let die = rounded_box(p, [0.0, 0.0, 0.18], [0.17, 0.15, 0.14], 0.006);
    let cornice = rounded_box(p, [0.0, 0.0, 0.34], [0.2, 0.18, 0.02], 0.008);
    let plinth = blend(blend(base, die, 0.012), cornice, 0.012);
    let q = [p[0], p[1], p[2] - PLINTH_M];
    // The face is symmetric.
    let m = [q[0].abs(), q[1], q[2]];
    // A part that is farther away than the width of the blend does not change the surface.
    if q[2] < -0.08 {
        plinth
    } else if q[2] < 0.33 {
        blend(plinth, torso(m), 0.008)
    } else if q[2] < 0.52 {
        blend(torso(m), head(m), 0.03)
    } else {
        head(m)
    }
}

fn torso(m: [f64; 3]) -> f64 {
    let socle = capsule(m, [0.0, 0.01, 0.0], [0.0, 0.01, 0.09], 0.055);
    let chest = ellipsoid(m, [0.0, 0.015, 0.19], [0.155, 0.092, 0.13]);
    let shoulder = ellipsoid(m, [0.15, 0.025, 0.2], [0.07, 0.068, 0.062]);
    let breast = ellipsoid(m, [0.065, -0.055, 0.165], [0.07, 0.035, 0.05]);
    let body = blend(blend(chest, shoulder, 0.06), breast, 0.03);
    // Cut below by a large sphere, as busts are.
    let cut = 0.5 - length(sub(m, [0.0, 0.02, -0.4]));
    let body = -blend(-body, -cut, 0.01);
    let neck = capsule(m, [0.0, 0.02, 0.27], [0.0, 0.008, 0.42], 0.054);
    let collar = capsule(m, [0.012, -0.05, 0.293], [0.12, -0.012, 0.258], 0.008);
    blend(blend(blend(body, neck, 0.06), collar, 0.02), socle, 0.02)
}

fn head(m: [f64; 3]) -> f64 {
    let skull = ellipsoid(m, [0.0, 0.022, 0.535], [0.082, 0.1, 0.1]);
    let face = ellipsoid(m, [0.0, -0.025, 0.485], [0.066, 0.068, 0.105]);
    let chin = ellipsoid(m, [0.0, -0.068, 0.4], [0.026, 0.02, 0.018]);
    let jaw = capsule(m, [0.0, -0.06, 0.403], [0.052, 0.0, 0.44], 0.02);
    let mut d = blend(blend(skull, face, 0.04), blend(chin, jaw, 0.03), 0.03);
    let socket = ellipsoid(m, [0.031, -0.1, 0.508], [0.022, 0.022, 0.013]);
    d = -blend(-d, socket, 0.016);
    d = blend(d, ellipsoid(m, [0.03, -0.074, 0.507], [0.016, 0.015, 0.0125]), 0.005);
    d = blend(d, capsule(m, [0.012, -0.092, 0.53], [0.05, -0.075, 0.529], 0.007), 0.016);
    d = blend(d, capsule(m, [0.0, -0.09, 0.52], [0.0, -0.112, 0.472], 0.009), 0.016);
    d = blend(d, ellipsoid(m, [0.011, -0.1, 0.468], [0.01, 0.013, 0.008]), 0.008);
    d = blend(d, ellipsoid(m, [0.009, -0.09, 0.443], [0.018, 0.011, 0.0055]), 0.006);
    d = blend(d, ellipsoid(m, [0.0, -0.088, 0.431], [0.02, 0.011, 0.0065]), 0.006);
    let ear = ellipsoid(m, [0.082, 0.01, 0.49], [0.012, 0.026, 0.036]);
    let hollow = ellipsoid(m, [0.094, 0.0, 0.492], [0.008, 0.015, 0.022]);
    d = blend(d, -blend(-ear, hollow, 0.006), 0.008);
    blend(d, hair(m), 0.01)
}

/// A cap of wavy hair with a knot behind.
fn hair(m: [f64; 3]) -> f64 {
    let cap = ellipsoid(m, [0.0, 0.034, 0.545], [0.09, 0.105, 0.106]);
    if cap > 0.03 {
        return cap;
    }
    let wave = libm::sin(m[0] * 130.0 + 3.0 * libm::sin(m[2] * 40.0)) * libm::sin(m[1] * 55.0);
    let front = m[1] + 0.06 - 0.6 * (0.575 - m[2]).max(0.0);
    let cap = -blend(-(cap - 0.0035 * wave), front, 0.012);
    let knot = ellipsoid(m, [0.0, 0.135, 0.53], [0.035, 0.034, 0.033]);
    blend(cap, knot, 0.012)
}

/// Smooth minimum over a width (Quilez, polynomial of degree 2).
fn blend(a: f64, b: f64, width: f64) -> f64 {
    let h = (width - (a - b).abs()).max(0.0);
    a.min(b) - h * h / (4.0 * width)
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Distance to an ellipsoid, first order.
fn ellipsoid(p: [f64; 3], centre: [f64; 3], radii: [f64; 3]) -> f64 {
    let q = sub(p, centre);
    let k0 = length([0, 1, 2].map(|a| q[a] / radii[a]));
    let k1 = length([0, 1, 2].map(|a| q[a] / (radii[a] * radii[a])));
    if k1 > 0.0 { k0 * (k0 - 1.0) / k1 } else { -radii[0] }
}

fn capsule(p: [f64; 3], a: [f64; 3], b: [f64; 3], radius: f64) -> f64 {
    let (pa, ba) = (sub(p, a), sub(b, a));
    let t = (dot(pa, ba) / dot(ba, ba)).clamp(0.0, 1.0);
    length([0, 1, 2].map(|i| pa[i] - ba[i] * t)) - radius
}

fn rounded_box(p: [f64; 3], centre: [f64; 3], half: [f64; 3], round: f64) -> f64 {
    let q = sub(p, centre);
    let q = [0, 1, 2].map(|a| q[a].abs() - half[a] + round);
    length(q.map(|c| c.max(0.0))) + q[0].max(q[1]).max(q[2]).min(0.0) - round
}
