//! The bridge: stone viaducts with arches cut out of a block, and a steel span between them, whose
//! girders and railings are bars in planes.

use super::draw::beyond;
use super::ray::{Hit, Material, Ray, Texture, Vec3};

/// Half the length of the steel span and of the bridge, half its width; the roadway's height;
/// metres.
pub const SPAN: f64 = 24.0;
pub const END: f64 = 92.0;
pub const WIDTH: f64 = 4.5;
pub const ROADWAY: f64 = 18.0;
/// Middles of the arches, on both sides; their radius, and the height at which the round begins.
const ARCHES: [f64; 4] = [33.5, 48.0, 62.5, 77.0];
const RADIUS: f64 = 5.6;
const SPRINGING: f64 = 10.0;
/// Height of the lower end of the stone's foundations.
const FOOT: f64 = -5.0;
/// Thickness of the steel span's deck.
const DECK: f64 = 0.7;
/// Height of its girders, and distance of their verticals, metres.
const GIRDER: f64 = 6.5;
const PANEL: f64 = 4.0;
/// Planes of bars: girders have two faces.
const GIRDER_PLANES: [f64; 4] = [-4.45, -4.2, 4.2, 4.45];
const RAILING_PLANES: [f64; 2] = [-4.0, 4.0];

const STONE: Material = Material::new([176, 160, 134], 0.5, 17, Texture::Masonry(0.45));
const TARMAC: Material = Material::new([96, 96, 98], 0.2, 17, Texture::Speckle(12.0));
const STEEL: Material = Material::new([92, 116, 112], 0.35, 17, Texture::Speckle(4.0));
const RAIL: Material = Material::new([70, 76, 82], 0.3, 17, Texture::Plain);

/// The first hit of a ray on the bridge before `t_max`.
pub fn cast(ray: &Ray, t_max: f64) -> Option<Hit> {
    let mut nearest = None;
    let mut t = t_max;
    let hits = [stone(ray, SPAN, END), stone(ray, -END, -SPAN), deck(ray)];
    let bars = GIRDER_PLANES.into_iter().map(|y| bars(ray, y, is_girder, STEEL));
    let rails = RAILING_PLANES.into_iter().map(|y| bars_of_railing(ray, y));
    for hit in hits.into_iter().chain(bars).chain(rails).flatten() {
        if hit.t < t {
            (t, nearest) = (hit.t, Some(hit));
        }
    }
    nearest
}

/// The hit on a block of stone between two x, without its arches.
fn stone(ray: &Ray, from: f64, to: f64) -> Option<Hit> {
    let [(t, axis), _] = ray.through([from, -WIDTH, FOOT], [to, WIDTH, ROADWAY])?;
    let p = ray.at(t.max(0.0));
    let arch = ARCHES.map(|x| if from < 0.0 { -x } else { x }).into_iter().find(|x| {
        let (dx, dz) = (p[0] - x, p[2] - SPRINGING);
        dx.abs() < RADIUS && (dz < 0.0 || dx * dx + dz * dz < RADIUS * RADIUS)
    });
    match arch {
        Some(x) if axis == 1 || t < 0.0 => vault(ray, x),
        _ if t < 0.0 => None,
        _ => {
            let material = if axis == 2 { TARMAC } else { STONE };
            Some(Hit::on_face(ray, t, axis, ray.to[axis] < 0.0, material))
        }
    }
}

/// The hit on the side or the round of an arch, from inside, if the ray does not leave through a
/// face.
fn vault(ray: &Ray, middle: f64) -> Option<Hit> {
    let t_face = ray.reach(1, if ray.to[1] > 0.0 { WIDTH } else { -WIDTH });
    let t_side = ray.reach(0, middle + if ray.to[0] > 0.0 { RADIUS } else { -RADIUS });
    if ray.at(t_side)[2] < SPRINGING {
        let hit = Hit::on_face(ray, t_side, 0, ray.to[0] < 0.0, STONE);
        return (t_side < t_face).then_some(hit);
    }
    // The farther of the two intersections with the cylinder.
    let (x, z) = (ray.from[0] - middle, ray.from[2] - SPRINGING);
    let a = ray.to[0] * ray.to[0] + ray.to[2] * ray.to[2];
    let b = x * ray.to[0] + z * ray.to[2];
    let root = b * b - a * (x * x + z * z - RADIUS * RADIUS);
    let t = (root.max(0.0).sqrt() - b) / a;
    let p = ray.at(t);
    let outward = ((p[0] - middle) * ray.to[0] + (p[2] - SPRINGING) * ray.to[2]) / RADIUS;
    let hit = Hit { t, incidence: outward.abs().min(1.0), light: 0.66, material: STONE };
    (t < t_face).then_some(hit)
}

fn deck(ray: &Ray) -> Option<Hit> {
    let low: Vec3 = [-SPAN, -WIDTH, ROADWAY - DECK];
    let [(t, axis), _] = ray.through(low, [SPAN, WIDTH, ROADWAY])?;
    let is_roadway = axis == 2 && ray.to[2] < 0.0;
    let material = if is_roadway { TARMAC } else { STEEL };
    (t > 0.0).then(|| Hit::on_face(ray, t, axis, ray.to[axis] < 0.0, material))
}

fn bars(ray: &Ray, y: f64, is_bar: fn(f64, f64) -> bool, material: Material) -> Option<Hit> {
    let t = ray.reach(1, y);
    let p = ray.at(t);
    (t > 0.0 && is_bar(p[0], p[2] - ROADWAY))
        .then(|| Hit::on_face(ray, t, 1, ray.to[1] < 0.0, material))
}

fn bars_of_railing(ray: &Ray, y: f64) -> Option<Hit> {
    bars(ray, y, is_railing, RAIL)
}

/// Whether a girder has steel at this position along the bridge and height above the roadway: a
/// bow, verticals and diagonals that change direction in the middle.
fn is_girder(x: f64, up: f64) -> bool {
    let bow = GIRDER * (1.0 - (x / SPAN) * (x / SPAN));
    if x.abs() > SPAN || up < 0.0 || up > bow {
        return false;
    }
    let in_panel = beyond(x.abs(), PANEL);
    let panel = x.abs() - in_panel;
    let height = |x: f64| GIRDER * (1.0 - (x / SPAN) * (x / SPAN));
    let diagonal = height(panel) * (1.0 - in_panel / PANEL);
    up > bow - 0.35 || in_panel < 0.16 || (up - diagonal).abs() < 0.14
}

/// Posts, a handrail and two bars.
fn is_railing(x: f64, up: f64) -> bool {
    let is_bar = [0.35, 0.7].iter().any(|bar| (up - bar).abs() < 0.015) || (up - 1.08).abs() < 0.03;
    x.abs() < END && up > 0.0 && (is_bar || up < 1.1 && beyond(x, 2.0) < 0.06)
}
