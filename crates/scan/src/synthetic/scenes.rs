//! The list of generated scenes.

use super::scene::Scene;
use super::{airborne, bridge, office};

/// A kind of scene.
pub struct SceneKind {
    /// Name in `synthetic:NAME:...`.
    pub name: &'static str,
    /// Makes the scene.
    pub(crate) make: fn(points: u64, seed: u64) -> Box<dyn Scene>,
}

/// All scenes.
pub static SCENES: &[SceneKind] = &[
    SceneKind { name: "bridge", make: bridge::make },
    SceneKind { name: "office", make: office::make },
    SceneKind { name: "terrain", make: airborne::make },
];
