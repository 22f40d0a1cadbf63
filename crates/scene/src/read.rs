//! Reads documents: first the version, then all fields, then what types do not check. An error
//! names the field.

use crate::detect::{Found, detect};
use crate::document::Scene;
use crate::error::SceneError;
use crate::limits::{BOM, BYTES_MAX, VERSION};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Reads and checks the document at `path`.
///
/// # Errors
/// If the file cannot be read or is longer than [`BYTES_MAX`], or as for [`parse`].
pub fn read(path: &Path) -> Result<Scene, SceneError> {
    let mut text = String::new();
    File::open(path)?.take(BYTES_MAX + 1).read_to_string(&mut text)?;
    if text.len() as u64 > BYTES_MAX {
        return Err(SceneError::TooLong);
    }
    parse(&text)
}

/// Parses and checks the text of a document.
///
/// # Errors
/// If the text is no JSON object with the field `esker_scene`, has another version, or a field is
/// unknown or invalid.
pub fn parse(text: &str) -> Result<Scene, SceneError> {
    let text = text.strip_prefix(BOM).unwrap_or(text);
    match detect(text.as_bytes())? {
        Found::Scene(found) if found == VERSION.to_string() => {}
        Found::Scene(found) => return Err(SceneError::Version { found }),
        Found::OtherObject | Found::Other => return Err(SceneError::NoScene),
    }
    let mut json = serde_json::Deserializer::from_str(text);
    let scene: Scene = serde_path_to_error::deserialize(&mut json)
        .map_err(|error| SceneError::of(error.path().to_string(), error.inner().to_string()))?;
    json.end().map_err(|error| SceneError::of(".", error.to_string()))?;
    scene.check()?;
    Ok(scene)
}
