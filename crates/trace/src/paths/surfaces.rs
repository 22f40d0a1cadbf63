//! What the tracer asks of a scene. Tests trace exact spheres and planes through the same trait, so
//! that an error of the paths is told from one of the splats.

use crate::ray::{Hit, Ray};
use crate::scene::{AreaLight, Scene};

/// Surfaces that rays meet.
pub trait Surfaces: Sync {
    /// The surface that a ray meets first.
    fn hit(&self, ray: &Ray) -> Option<Hit>;

    /// The surface that a ray from the eye meets first: it may pass through the backs of surfaces.
    fn seen(&self, ray: &Ray) -> Option<Hit> {
        self.hit(ray)
    }

    /// Whether anything lies on the ray before its reach.
    fn is_blocked(&self, ray: &Ray) -> bool;

    /// Length of the diagonal of the box around the surfaces: depth as a guide is divided by it.
    fn diagonal(&self) -> f32;

    /// Surfaces that are sampled as lights. If there are none, the emission that [`Surfaces::hit`]
    /// reports is found by bounces and filtered with indirect light.
    fn emitters(&self) -> &[AreaLight] {
        &[]
    }
}

impl Surfaces for Scene {
    fn hit(&self, ray: &Ray) -> Option<Hit> {
        Scene::hit(self, ray)
    }

    fn seen(&self, ray: &Ray) -> Option<Hit> {
        Scene::seen(self, ray)
    }

    fn is_blocked(&self, ray: &Ray) -> bool {
        Scene::is_blocked(self, ray)
    }

    fn diagonal(&self) -> f32 {
        let bounds = self.bounds();
        let diagonal = (bounds.max - bounds.min).length();
        if !bounds.is_empty() && diagonal.is_finite() { diagonal } else { 0.0 }
    }

    fn emitters(&self) -> &[AreaLight] {
        self.area_lights()
    }
}
