//! The scene that rays meet: the splats of a cut as one tree, and meshes and moving objects in a
//! small tree above theirs. Lights are kept apart ([`crate::light`]).

use crate::ray::{Hit, Ray};
use esker_render::Splat;

/// What rays meet.
#[derive(Debug, Default)]
pub struct Scene {}

impl Scene {
    /// A scene of splats, relative to the origin that they were made for.
    pub fn of_splats(_splats: &[Splat]) -> Self {
        Self {}
    }

    /// The surface that a ray meets first.
    pub fn hit(&self, _ray: &Ray) -> Option<Hit> {
        None
    }

    /// Whether anything lies on the ray before its reach.
    pub fn is_blocked(&self, _ray: &Ray) -> bool {
        false
    }
}
