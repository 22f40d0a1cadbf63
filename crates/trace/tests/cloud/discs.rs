//! Random clouds of splats, and rays against them in `f64`, one disc after another.

use crate::cloud::{Random, splat};
use esker_render::Splat;
use esker_trace::Ray;
use esker_trace::scene::RADIUS_FACTOR;
use glam::DVec3;

/// Discs of all sizes in a cube.
pub fn soup(count: usize, largest: f32, seed: u64) -> Vec<Splat> {
    let mut random = Random(seed);
    (0..count)
        .map(|i| {
            let radius = largest * random.next().powi(2) + 1e-4;
            splat(random.vector(), random.unit(), radius, i)
        })
        .collect()
}

/// A sphere of radius 1 with splats anywhere on it, their radii the spacing, their normals and
/// places off by `noise` (radians; spacings).
pub fn sphere(count: usize, noise: [f32; 2], seed: u64) -> Vec<Splat> {
    let mut random = Random(seed);
    let spacing = (4.0 * std::f32::consts::PI / count as f32).sqrt();
    (0..count)
        .map(|i| {
            let at = random.unit();
            let normal = (at + random.unit() * noise[0]).normalize_or_zero();
            splat(at + at * (random.next() - 0.5) * noise[1] * spacing, normal, spacing, i)
        })
        .collect()
}

/// Where a ray meets a disc.
pub struct Met {
    pub distance: f64,
    /// Squared distance from the centre over the squared radius.
    pub off: f64,
    pub radius: f64,
    pub index: usize,
}

/// All discs that a ray meets, from near to far; `None` if one is met so near to its rim, or is so
/// nearly parallel to the ray, that `f32` may see it otherwise.
pub fn all_met(splats: &[Splat], ray: &Ray) -> Option<Vec<Met>> {
    let v = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut met = Vec::new();
    for (index, splat) in splats.iter().enumerate() {
        let to = v(splat.centre) - origin;
        let has_normal = splat.normal != [0.0; 3];
        let normal = if has_normal { v(splat.normal) } else { direction };
        let radius = f64::from(splat.radius * RADIUS_FACTOR);
        let speed = normal.dot(direction);
        let distance = normal.dot(to) / speed;
        let off = (direction * distance - to).length_squared() / (radius * radius);
        let is_near_rim =
            (off - 1.0).abs() < 1e-3 / speed.abs().max(1e-9) * 1e-3_f64.max(1e-6 / radius);
        if is_near_rim && distance > -1e-3 || distance.abs() < 1e-5 && off < 1.1 {
            return None;
        }
        if distance > 0.0 && distance < f64::from(ray.reach) && off < 1.0 {
            met.push(Met { distance, off, radius, index });
        }
    }
    met.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    Some(met)
}
