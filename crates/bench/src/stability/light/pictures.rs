//! Pictures to filter: a ball before two planes, the light on it, noise as of path tracing, and
//! guides that are noisy or depend on each other.

use esker_trace::Image;
use esker_trace::filter::{GuideKind, Guides};
use esker_truth::dice::Dice;
use glam::Vec3;
use std::f64::consts::TAU;

/// One in so many samples is bright.
const RARE: f64 = 20.0;
/// Normals and depths that pixels see; none where there is no surface.
pub(super) type Seen = Vec<Option<(Vec3, f32)>>;

/// What the pixels of a picture see of a ball on a floor before a wall, and the smooth light there.
pub(super) fn ball(width: usize, height: usize) -> (Seen, Image<3>) {
    let mut seen = Vec::new();
    let mut light = Image::new(width, height);
    for i in 0..width * height {
        let x = ((i % width) as f32 + 0.5) / width as f32 * 2.0 - 1.0;
        let y = ((i / width) as f32 + 0.5) / height as f32 * 2.0 - 1.0;
        let radius = (x * x + y * y).sqrt() / 0.5;
        let (normal, depth) = if radius < 1.0 {
            let z = (1.0 - radius * radius).sqrt();
            (Vec3::new(x / 0.5, -y / 0.5, z), 2.0 - 0.5 * z)
        } else if y > 0.3 {
            (Vec3::new(0.0, 0.9, 0.435_89), 2.6 - y)
        } else {
            (Vec3::Z, 2.3)
        };
        seen.push(Some((normal, depth)));
        let colour = [0.6 + 0.3 * normal.y, 0.5 + 0.2 * normal.x, 0.4 + 0.1 * normal.z];
        for (plane, colour) in light.planes.iter_mut().zip(colour) {
            plane[i] = colour * (1.0 + 0.2 * x);
        }
    }
    (seen, light)
}

/// The guides of what is seen.
pub(super) fn guides(width: usize, height: usize, seen: &Seen) -> Guides {
    Guides::of_surfaces(width, height, seen, 4.0)
}

/// The same with normals that lean by an angle of this standard deviation.
pub(super) fn tilted(seen: &Seen, deviation_deg: f64, dice: &mut Dice) -> Seen {
    let tilt = |(normal, depth): (Vec3, f32), dice: &mut Dice| {
        let angle = gaussian(dice) * deviation_deg.to_radians();
        let (x, y) = normal.any_orthonormal_pair();
        let (sin, cos) = (dice.unit() * TAU).sin_cos();
        let aside = x * cos as f32 + y * sin as f32;
        let leaning = normal * angle.cos() as f32 + aside * angle.sin() as f32;
        (leaning.normalize_or(normal), depth)
    };
    seen.iter().map(|seen| seen.map(|seen| tilt(seen, dice))).collect()
}

/// Guides each of which is the first one times a factor, up to single roundings.
pub(super) fn dependent(guides: &Guides) -> Guides {
    let mut guides = guides.clone();
    let first = guides.planes[0].clone();
    for (plane, scale) in guides.planes.iter_mut().skip(1).zip([0.5, -0.3, 0.9]) {
        plane.iter_mut().zip(&first).for_each(|(to, from)| *to = scale * from);
    }
    guides.kinds.fill(GuideKind::Normal);
    guides
}

/// Light with the noise of path tracing at so many samples: most are black, few are bright.
pub(super) fn traced(light: &Image<3>, samples: u32, dice: &mut Dice) -> Image<3> {
    let mut out = Image::new(light.width, light.height);
    for i in 0..light.len() {
        for _ in 0..samples {
            if dice.unit() < 1.0 / RARE {
                // Exponentially distributed, of mean one.
                let bright = -(1.0 - dice.unit()).ln() * RARE / f64::from(samples);
                for (out, light) in out.planes.iter_mut().zip(&light.planes) {
                    out[i] += light[i] * bright as f32;
                }
            }
        }
    }
    out
}

/// A normally distributed number.
fn gaussian(dice: &mut Dice) -> f64 {
    (-2.0 * dice.unit().max(1e-300).ln()).sqrt() * (dice.unit() * TAU).cos()
}
