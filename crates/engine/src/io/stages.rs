//! Times of a frame's passes for reports: as entries of a JSON object, and as text.

use esker_render::{Pass, PassTimes};
use serde::Serializer;
use serde::ser::SerializeMap;

/// A text leaves out passes that took less time, milliseconds: most of them did not run.
const SHOWN_MS: f64 = 0.05;

/// Serialises `stages` as an object of milliseconds by the names of [`Pass::ALL`], with the time of
/// the whole frame as `whole_frame`.
///
/// # Errors
/// If the serialiser fails.
pub fn serialize<S: Serializer>(
    stages: &PassTimes,
    whole_frame: &str,
    to: S,
) -> Result<S::Ok, S::Error> {
    let mut map = to.serialize_map(Some(Pass::ALL.len() + 1))?;
    for pass in Pass::ALL {
        map.serialize_entry(pass.name(), &stages.ms(pass))?;
    }
    map.serialize_entry(whole_frame, &stages.total_ms)?;
    map.end()
}

/// Serialises `stages` with the time of the whole frame as `draw`.
///
/// # Errors
/// If the serialiser fails.
pub(crate) fn serialize_draw<S: Serializer>(stages: &PassTimes, to: S) -> Result<S::Ok, S::Error> {
    serialize(stages, "draw", to)
}

/// Names and times, milliseconds, of the steps `before` the frame, of its passes, and of the whole
/// frame, called `whole_frame`.
pub fn text(before: &[(&str, f64)], stages: &PassTimes, whole_frame: &str) -> String {
    let passes = Pass::ALL.map(|pass| (pass.name(), stages.ms(pass)));
    let times = before.iter().copied().chain(passes).chain([(whole_frame, stages.total_ms)]);
    let shown = times.filter(|(_, ms)| *ms >= SHOWN_MS);
    shown.map(|(name, ms)| format!("{name} {ms:.1}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_has_the_stages_that_took_time_in_their_order() {
        let mut stages = PassTimes { total_ms: 3.0, ..PassTimes::default() };
        stages.add(Pass::Antialias, 0.1);
        stages.add(Pass::FitPlanes, 1.26);
        stages.add(Pass::Blend, 0.0);
        assert_eq!(
            text(&[("select", 0.2)], &stages, "draw"),
            "select 0.2, fit_planes 1.3, antialias 0.1, draw 3.0"
        );
    }
}
