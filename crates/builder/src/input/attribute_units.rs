//! Checks that attributes of one name and type mean the same in all inputs: that their stored
//! values have one scale and offset.

use crate::error::BuildError;
use esker_points::{Conflict, Schema};
use std::path::Path;

/// Refuses attributes of one name and type whose stored values have different scales or offsets.
///
/// # Errors
/// If two of `files` (path and schema of each) differ; the message names both.
pub fn check_attribute_units<'a>(
    files: impl Iterator<Item = (&'a Path, &'a Schema)>,
) -> Result<(), BuildError> {
    // Most of thousands of files have the same schema.
    let mut known: Vec<(&Path, &Schema)> = Vec::new();
    for (path, schema) in files {
        if known.iter().any(|(_, other)| *other == schema) {
            continue;
        }
        let conflict = known.iter().find_map(|(at, other)| Some((at, other.conflict(schema)?)));
        if let Some((at, Conflict { name, scales, offsets })) = conflict {
            let steps = |i: usize| format!("{} * n + {}", scales[i], offsets[i]);
            return Err(BuildError::Options(format!(
                "`{name}` of {} is {}, and of {} is {}: both cannot be kept under one name; give it one scale and offset in all of them, or another name, or build the files apart",
                at.display(),
                steps(0),
                path.display(),
                steps(1)
            )));
        }
        known.push((path, schema));
    }
    Ok(())
}
