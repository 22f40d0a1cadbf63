//! The record of the file that a divided build has made.

use crate::error::BuildError;
use crate::jobs::place::Place;
use crate::jobs::step::{Step, VERSION, failed, refused};
use crate::options::Report;
use esker_points::read_at::is_remote;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Most bytes of the record of a finished join.
const JOINED_BYTES_MAX: u64 = 1 << 16;

/// Record of the file that was made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joined {
    version: u32,
    plan: String,
    /// Path of the file.
    pub out: PathBuf,
    /// Its bytes.
    pub bytes: u64,
    /// Number of its points.
    pub points: u64,
    /// Their multiset hash.
    pub hash: String,
}

impl Joined {
    /// The record of the plan of a place; `None` if no file was made.
    ///
    /// # Errors
    /// If it cannot be read, or is of another plan.
    pub fn find(place: &dyn Place, plan: &str) -> Result<Option<Self>, BuildError> {
        let name = Step::Join.record();
        let bytes = place.read(&name, JOINED_BYTES_MAX);
        let Some(bytes) = bytes.map_err(failed(place, &name, "cannot be read"))? else {
            return Ok(None);
        };
        let joined: Self = serde_json::from_slice(&bytes)
            .map_err(|e| refused(place, &name, format!("is no record of a step ({e})")))?;
        if joined.version != VERSION || joined.plan != plan {
            return Err(refused(place, &name, "is of another plan"));
        }
        Ok(Some(joined))
    }
    /// Creates the record of the file `out`, unless another join has made one.
    ///
    /// # Errors
    /// If the place cannot be written.
    pub fn create(
        place: &dyn Place,
        plan: &str,
        out: &Path,
        report: &Report,
    ) -> Result<(), BuildError> {
        let from_anywhere = if is_remote(out) { None } else { std::path::absolute(out).ok() };
        let joined = Self {
            version: VERSION,
            plan: plan.into(),
            out: from_anywhere.unwrap_or_else(|| out.into()),
            bytes: report.bytes_out,
            points: report.points_out,
            hash: report.hash.to_string(),
        };
        let name = Step::Join.record();
        let text = serde_json::to_vec(&joined).map_err(std::io::Error::from);
        let created = text.and_then(|text| place.create(&name, &text));
        created.map(|_| ()).map_err(failed(place, &name, "cannot be created"))
    }
}
