//! Glossy reflection above the Lambert term: a GGX lobe (Walter et al. 2007) with the height-
//! correlated shadowing of Smith and Schlick's Fresnel term, sampled by visible normals (Heitz
//! 2018). In: directions to the eye and the light. Out: reflected shares.

use super::directions::{disc, frame};
use glam::Vec3;
use std::f32::consts::PI;

/// A glossy coat of all surfaces: a GGX lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// Share of light that is reflected at normal incidence, 0 to 1; 0.04 for plastic and varnish.
    /// The Lambert term is scaled by the rest.
    pub reflectance: f32,
    /// Roughness, 0.05 (polished) to 1; the width of the lobe is its square (Burley 2012).
    pub roughness: f32,
}

impl Gloss {
    /// The same within the ranges of its values.
    pub(crate) fn clamped(self) -> Self {
        let range = |value: f32, low: f32| if value >= low { value.min(1.0) } else { low };
        Self { reflectance: range(self.reflectance, 0.0), roughness: range(self.roughness, 0.05) }
    }

    fn alpha(&self) -> f32 {
        self.roughness * self.roughness
    }

    fn fresnel(&self, cos: f32) -> f32 {
        self.reflectance + (1.0 - self.reflectance) * (1.0 - cos.clamp(0.0, 1.0)).powi(5)
    }

    /// Reflected radiance over normal irradiance: the lobe times the cosine at the surface.
    pub(crate) fn reflected(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3) -> f32 {
        let (nv, nl) = (normal.dot(to_eye), normal.dot(to_light));
        let half = (to_eye + to_light).normalize_or_zero();
        if nv <= 0.0 || nl <= 0.0 {
            return 0.0;
        }
        let nh = normal.dot(half).clamp(0.0, 1.0);
        let a2 = self.alpha() * self.alpha();
        let base = nh * nh * (a2 - 1.0) + 1.0;
        let density = a2 / (PI * base * base);
        let smith = |n: f32| (a2 + (1.0 - a2) * n * n).sqrt();
        let visible = 0.5 / (nl * smith(nv) + nv * smith(nl)).max(1e-6);
        density * visible * self.fresnel(to_eye.dot(half)) * nl
    }

    /// Direction to look into for light that is reflected to the eye, and its weight.
    pub(crate) fn sample(&self, normal: Vec3, to_eye: Vec3, u: [f32; 2]) -> Option<(Vec3, f32)> {
        let (x, y) = frame(normal);
        let v = Vec3::new(to_eye.dot(x), to_eye.dot(y), to_eye.dot(normal).max(1e-4));
        let alpha = self.alpha();
        let stretched = Vec3::new(alpha * v.x, alpha * v.y, v.z).normalize_or(Vec3::Z);
        let (a, b) = frame(stretched);
        let [s, t] = disc(u);
        // Half of the disc is seen under the angle of the eye.
        let share = 0.5 * (1.0 + stretched.z);
        let edge = Vec3::Z.cross(stretched).try_normalize();
        let (a, b) = edge.map_or((a, b), |edge| (edge, stretched.cross(edge)));
        let t = (1.0 - share) * (1.0 - s * s).max(0.0).sqrt() + share * t;
        let depth = (1.0 - s * s - t * t).max(0.0).sqrt();
        let h = a * s + b * t + stretched * depth;
        let h = Vec3::new(alpha * h.x, alpha * h.y, h.z.max(0.0)).try_normalize()?;
        let l = h * (2.0 * v.dot(h)) - v;
        if l.z <= 0.0 {
            return None;
        }
        let a2 = alpha * alpha;
        let smith = |n: f32| (a2 + (1.0 - a2) * n * n).sqrt();
        let (gv, gl) = (l.z * smith(v.z), v.z * smith(l.z));
        // Both-sided shadowing over that of the eye alone.
        let weight = l.z * (v.z + smith(v.z)) / (gv + gl).max(1e-6);
        let direction = (x * l.x + y * l.y + normal * l.z).try_normalize()?;
        Some((direction, self.fresnel(v.dot(h)) * weight.min(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::directions::cosine;

    #[test]
    fn sampled_and_evaluated_lobes_reflect_the_same_share() {
        let normal = Vec3::new(0.36, -0.48, 0.8);
        for (roughness, tilt) in [(0.4, 0.2), (0.7, 1.0), (1.0, 1.3f32)] {
            let gloss = Gloss { reflectance: 0.3, roughness };
            let to_eye = (normal * tilt.cos() + frame(normal).0 * tilt.sin()).normalize_or_zero();
            let side = 256;
            let (mut sampled, mut evaluated) = (0.0f64, 0.0f64);
            for i in 0..side * side {
                let u = [(i % side) as f32 + 0.5, (i / side) as f32 + 0.5].map(|v| v / side as f32);
                if let Some((_, weight)) = gloss.sample(normal, to_eye, u) {
                    sampled += f64::from(weight) / f64::from(side * side);
                }
                let to_light = cosine(normal, u);
                let cos = normal.dot(to_light).max(1e-4);
                let value = gloss.reflected(normal, to_eye, to_light) * PI / cos;
                evaluated += f64::from(value) / f64::from(side * side);
            }
            assert!((sampled - evaluated).abs() < 0.01 * evaluated, "{sampled} {evaluated}");
            assert!(evaluated < 1.0);
        }
    }
}
