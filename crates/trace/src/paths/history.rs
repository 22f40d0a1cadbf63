//! Indirect light of the last picture for a new camera. In: guides and incident light of the last
//! picture, guides of the new one. Out: incident light at the new guides, with the number of
//! samples that it stands for. Incident light on a Lambert surface does not depend on the eye.

use super::guide::Seen;
use super::lookup::fits;
use crate::camera::Camera;
use glam::Vec3;
use rayon::prelude::*;

/// Samples of new light from which on the last picture no longer counts: what it held about other
/// places of the camera, of objects or of finer levels must not stay.
pub(crate) const HISTORY_SAMPLES: f32 = 8.0;

/// Incident light of the last picture at a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Past {
    pub light: Vec3,
    /// Number of samples that it stands for, at most [`HISTORY_SAMPLES`].
    pub samples: f32,
}

impl Past {
    /// The sum of `samples` new samples and this, and the number of samples. The more new ones
    /// there are, the less of this is left.
    pub(crate) fn add(&self, sum: Vec3, samples: f32) -> (Vec3, f32) {
        let left = self.samples.min(HISTORY_SAMPLES - samples).max(0.0);
        (sum + self.light * left, samples + left)
    }
}

/// A picture whose light is used again.
#[derive(Clone, Copy)]
pub(crate) struct Last<'a> {
    pub camera: &'a Camera,
    pub guides: &'a [Seen],
    pub light: &'a [Past],
}

/// Light of the last picture at the guides of `camera`.
pub(crate) fn reproject(last: &Last<'_>, camera: &Camera, guides: &[Seen]) -> Vec<Past> {
    guides.par_iter().map(|seen| past(last, camera, seen)).collect()
}

/// The mean of the guides of the last picture around a place, of those that lie on its surface.
fn past(last: &Last<'_>, camera: &Camera, seen: &Seen) -> Past {
    let place = last.camera.project(seen.surface.point).filter(|_| seen.receives());
    let Some(place) = place else { return Past::default() };
    let corner = place - 0.5;
    let (left, top) = (corner.x.floor(), corner.y.floor());
    let (mut light, mut samples, mut weights) = (Vec3::ZERO, 0.0, 0.0);
    for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let (x, y) = (left + i as f32, top + j as f32);
        let inside = (0.0..last.camera.width as f32).contains(&x)
            && (0.0..last.camera.height as f32).contains(&y);
        if !inside {
            continue;
        }
        let index = y as usize * last.camera.width + x as usize;
        let (guide, past) = (&last.guides[index], &last.light[index]);
        let near = |at: f32, centre: f32| 1.0 - (at - centre).abs();
        // A part of the weight is the same for all, so that a fitting corner always counts.
        let weight = near(corner.x, x) * near(corner.y, y) + 1e-3;
        if guide.receives() && past.samples > 0.0 && fits(camera, guide, seen) {
            light += past.light * weight;
            samples += past.samples * weight;
            weights += weight;
        }
    }
    if weights == 0.0 {
        return Past::default();
    }
    Past { light: light / weights, samples: (samples / weights).min(HISTORY_SAMPLES) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::surface::Surface;
    use esker_lod::View;
    use glam::DVec3;

    const SIDE: u32 = 32;

    /// Camera above the plane z = 0 at `x`, looking down, and the guides of the plane.
    fn floor_from(x: f64) -> (Camera, Vec<Seen>) {
        let eye = DVec3::new(x, 0.0, 4.0);
        let target = DVec3::new(x, 0.0, 0.0);
        let view = View::look_at(eye, target, DVec3::Y, 1.0, SIDE, SIDE);
        let camera = Camera::new(&view, DVec3::ZERO);
        let side = SIDE as usize;
        let guide = |i: usize| {
            let ray = camera.ray((i % side) as f32 + 0.5, (i / side) as f32 + 0.5);
            let point = ray.at(-ray.origin.z / ray.direction.z);
            let surface =
                Surface { point, normal: Vec3::Z, albedo: Vec3::ONE, ..Surface::default() };
            Seen { surface, depth: camera.depth(point) }
        };
        (camera, (0..side * side).map(guide).collect())
    }

    /// Light that is linear in the place, so that interpolation keeps it.
    fn light(point: Vec3) -> Vec3 {
        Vec3::new(3.0 + point.x, 2.0 - point.y, 1.0)
    }

    #[test]
    fn light_stays_with_its_place_and_uncovered_places_have_none() {
        let (camera, guides) = floor_from(0.0);
        let past = |seen: &Seen| Past { light: light(seen.surface.point), samples: 3.0 };
        let held: Vec<Past> = guides.iter().map(past).collect();
        let last = Last { camera: &camera, guides: &guides, light: &held };
        let (moved, seen) = floor_from(0.7);
        let out = reproject(&last, &moved, &seen);
        let mut found = 0;
        for (past, seen) in out.iter().zip(&seen) {
            let x = camera.project(seen.surface.point).unwrap().x;
            if (0.5..SIDE as f32 - 0.5).contains(&x) {
                found += 1;
                assert!((past.samples - 3.0).abs() < 1e-5);
                let error = past.light - light(seen.surface.point);
                // The constant part of the weights shifts the mean by a thousandth of a pixel.
                assert!(error.length() < 2e-3, "{error}");
            } else if x >= SIDE as f32 + 0.5 {
                assert_eq!(*past, Past::default());
            }
        }
        assert!(found > 700, "{found}");
    }

    #[test]
    fn light_of_another_surface_is_not_used() {
        let (camera, guides) = floor_from(0.0);
        let held = vec![Past { light: Vec3::ONE, samples: 1.0 }; guides.len()];
        let last = Last { camera: &camera, guides: &guides, light: &held };
        let mut turned = guides.clone();
        turned.iter_mut().for_each(|seen| seen.surface.normal = Vec3::X);
        assert!(reproject(&last, &camera, &turned).iter().all(|past| past.samples == 0.0));
    }

    #[test]
    fn the_past_fades_as_samples_come() {
        let past = Past { light: Vec3::ONE, samples: 4.0 };
        assert_eq!(past.add(Vec3::ZERO, 0.0), (Vec3::splat(4.0), 4.0));
        assert_eq!(past.add(Vec3::ZERO, 6.0), (Vec3::splat(2.0), 8.0));
        assert_eq!(past.add(Vec3::splat(9.0), 9.0), (Vec3::splat(9.0), 9.0));
    }
}
