//! Times of passes in reports: [`PassTimes`] as an object of milliseconds by the names of
//! [`Pass::ALL`], with the time of the whole frame beside them.

use esker_engine::io::stages;
use esker_render::{Pass, PassTimes};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};
use std::collections::BTreeMap;

/// Applies `statistic` to the times of each pass, and to those of whole frames.
pub(crate) fn of_frames(frames: &[PassTimes], statistic: impl Fn(&[f64]) -> f64) -> PassTimes {
    let of = |ms: &dyn Fn(&PassTimes) -> f64| statistic(&frames.iter().map(ms).collect::<Vec<_>>());
    PassTimes {
        passes_ms: Pass::ALL.map(|pass| of(&|stages| stages.ms(pass))),
        total_ms: of(&|stages| stages.total_ms),
    }
}

/// Writes `stages` with the whole frame as `total`.
pub(crate) fn with_total<S: Serializer>(stages: &PassTimes, to: S) -> Result<S::Ok, S::Error> {
    stages::serialize(stages, "total", to)
}

/// Writes `stages` with the whole frame as `all`.
pub(crate) fn with_all<S: Serializer>(stages: &PassTimes, to: S) -> Result<S::Ok, S::Error> {
    stages::serialize(stages, "all", to)
}

/// Reads what [`with_all`] writes.
///
/// # Errors
/// If a pass, or the whole frame, has no time.
pub(crate) fn from_all<'de, D: Deserializer<'de>>(from: D) -> Result<PassTimes, D::Error> {
    let times = BTreeMap::<String, f64>::deserialize(from)?;
    let ms = |name| times.get(name).copied().ok_or_else(|| D::Error::missing_field(name));
    let mut stages = PassTimes { total_ms: ms("all")?, ..PassTimes::default() };
    for pass in Pass::ALL {
        stages.add(pass, ms(pass.name())?);
    }
    Ok(stages)
}
