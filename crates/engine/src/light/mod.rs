//! Light: pictures lit by path tracing (`bauszat2011`), as users ask for them. Takes lights from
//! the command line or a document, builds the scene of a cut, and draws still pictures and the
//! frames of sessions. Without the feature `light` only the settings remain, which are refused.

#[cfg(feature = "light")]
pub mod document;
#[cfg(feature = "light")]
pub mod lights;
#[cfg(feature = "light")]
pub(crate) mod options;
#[cfg(feature = "light")]
pub(crate) mod progressive;
#[cfg(not(feature = "light"))]
#[path = "unlit.rs"]
pub(crate) mod progressive;
#[cfg(feature = "light")]
mod refining;
#[cfg(feature = "light")]
pub(crate) mod scene;
#[cfg(feature = "light")]
pub(crate) mod scene_tracer;
pub mod settings;
pub mod spec;
pub mod status;
#[cfg(feature = "light")]
pub mod still;
#[cfg(feature = "light")]
pub mod sun;
#[cfg(feature = "light")]
pub(crate) mod tone;
#[cfg(feature = "light")]
pub(crate) mod tracing;
#[cfg(feature = "light")]
pub(crate) mod written;

use crate::draw::method::Method;
use anyhow::{Result, ensure};
use esker_format::{Forest, PlaneKind};
use esker_lod::Surroundings;
use esker_points::AttrType;
use esker_points::attribute::names;
use settings::{FilterName, LightSettings};

/// Most bytes a splat while a scene is built: the splat itself (48), its disc with albedo and
/// normal, and its share of the tree.
const SPLAT_BYTES: u64 = 128;
/// Whether this program can light.
pub const IS_BUILT: bool = cfg!(feature = "light");

/// Refuses to light in a program that was built without it.
///
/// # Errors
/// If the feature `light` is off; the message has the command that builds with it.
pub fn check_built() -> Result<()> {
    ensure!(
        IS_BUILT,
        "this program was built without light, so that it has no --method lit; build it with: \
         cargo build --release -p esker -p esker-view --features light"
    );
    Ok(())
}

/// Why a GPU does not draw the lit frames of a session; none if it does. What depends on the size
/// of the picture is found when it is drawn.
pub(crate) fn gpu_refusal(settings: &LightSettings) -> Option<String> {
    #[cfg(feature = "light")]
    return options::gpu_refusal(settings);
    #[cfg(not(feature = "light"))]
    {
        let _ = settings;
        None
    }
}

/// Bytes of lights in the memory of a GPU: an image of the sky may be large.
pub(crate) fn gpu_bytes(settings: &LightSettings) -> u64 {
    #[cfg(feature = "light")]
    return options::gpu_bytes(settings);
    #[cfg(not(feature = "light"))]
    {
        let _ = settings;
        0
    }
}

/// Names of the passes of a lit picture, in their order (`bauszat2011`, figure 1).
pub(crate) fn passes(settings: &LightSettings) -> Vec<&'static str> {
    let has_indirect = settings.bounces > 0;
    let passes = [
        ("splats", true),
        ("tree", true),
        ("guide", true),
        ("indirect", has_indirect),
        ("filter", has_indirect && settings.filter != FilterName::None),
        ("direct", true),
        ("tone", true),
    ];
    passes.into_iter().filter(|(_, runs)| *runs).map(|(name, _)| name).collect()
}

/// Most splats of a lit scene within some bytes of memory.
pub(crate) fn splats_max(bytes: u64) -> u64 {
    bytes / SPLAT_BYTES
}

/// How many splats are of the picture, and how many of what lies around it: a quarter of the most,
/// within the default of [`Surroundings`], as pictures are a sixteenth of all directions and their
/// surroundings an eighth as fine.
pub(crate) fn shares(splats_max: u64) -> (u64, Surroundings) {
    let default = Surroundings::default();
    let points_budget = default.points_budget.min(splats_max / 4);
    (splats_max - points_budget, Surroundings { points_budget, ..default })
}

/// Plane of the classes of points, if lights of a picture choose points by them.
pub(crate) fn class_plane(
    file: &Forest,
    method: Method,
    settings: &LightSettings,
) -> Option<PlaneKind> {
    let index = file.schema().find_typed(names::CLASSIFICATION, AttrType::U8);
    let is_needed = method == Method::Lit && needs_classes(settings);
    index.filter(|_| is_needed).map(|index| PlaneKind::Attribute(index as u16))
}

/// Whether lights choose points by their classes.
fn needs_classes(settings: &LightSettings) -> bool {
    #[cfg(feature = "light")]
    return settings.lights.as_ref().is_some_and(settings::Lights::name_classes);
    #[cfg(not(feature = "light"))]
    {
        let _ = settings;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_refused_exactly_where_it_is_not_built() {
        let refused = check_built().map_err(|e| e.to_string());
        assert_eq!(refused.is_ok(), IS_BUILT);
        assert!(refused.err().is_none_or(|fault| fault.contains("--features light")));
    }
}
