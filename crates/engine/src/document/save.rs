//! Writes the document of a picture: complete or not at all, and never over another kind of file.

use super::picture;
use super::places::{named, placed};
use super::read::{Document, is_document};
use crate::draw::scene::PictureRequest;
use crate::io::output;
use crate::io::picture::readable_by_all;
use anyhow::{Context, Result, ensure};
use esker_scene::{Cloud, Scene};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A document that was written.
#[derive(Clone, Debug, Serialize)]
pub struct SaveReport {
    /// Path of the document.
    pub scene: String,
    /// Number of its clouds.
    pub clouds: usize,
}

/// Text of a report.
pub fn text(report: &SaveReport) -> String {
    format!("{}: scene document, clouds: {}", report.scene, report.clouds)
}

/// Refuses an output that would replace an input, or a file that is neither empty nor a scene
/// document.
///
/// # Errors
/// If `out` is such an output, or cannot be written.
pub fn may_save(out: &Path, inputs: &[PathBuf], from: Option<&Document>) -> Result<()> {
    let mut read: Vec<PathBuf> = inputs.to_vec();
    read.extend(from.map(|document| document.path.clone()));
    output::may_write(out, &read)?;
    let holds_something = out.metadata().is_ok_and(|m| m.is_file() && m.len() > 0);
    ensure!(
        !holds_something || is_document(out).is_ok_and(|is_document| is_document),
        "{}: is there already, and is no scene document: choose another name, or remove it first",
        out.display()
    );
    Ok(())
}

/// Writes the document of the picture of `inputs` that `request` asks for to `out`. What `from`,
/// the document that the picture came from, has beside its picture is kept.
///
/// # Errors
/// If the request cannot be written as a document, a file that it names does not exist, or `out`
/// cannot be written.
pub fn save(
    out: &Path,
    inputs: &[PathBuf],
    from: Option<&Document>,
    request: &PictureRequest,
) -> Result<SaveReport> {
    may_save(out, inputs, from)?;
    write(out, inputs, from, request)
}

/// Writes a document as [`save`] does, also over the document `from` itself: for programs that ask
/// before they replace a file.
///
/// # Errors
/// As for [`save`].
pub fn save_over(
    out: &Path,
    inputs: &[PathBuf],
    from: &Document,
    request: &PictureRequest,
) -> Result<SaveReport> {
    may_save(out, inputs, None)?;
    write(out, inputs, Some(from), request)
}

fn write(
    out: &Path,
    inputs: &[PathBuf],
    from: Option<&Document>,
    request: &PictureRequest,
) -> Result<SaveReport> {
    let shown = || format!("{}: cannot write the scene document", out.display());
    let scene = scene_of(out, inputs, from, request).with_context(shown)?;
    let text = scene.to_json().with_context(shown)?;
    ensure!(
        text.len() as u64 <= esker_scene::BYTES_MAX,
        "{}: {}",
        out.display(),
        esker_scene::SceneError::TooLong
    );
    let mut file = tempfile::NamedTempFile::new_in(output::folder_of(out)).with_context(shown)?;
    file.write_all(text.as_bytes()).with_context(shown)?;
    readable_by_all(file.as_file()).with_context(shown)?;
    file.persist(out).with_context(shown)?;
    Ok(SaveReport { scene: out.display().to_string(), clouds: scene.clouds.len() })
}

fn scene_of(
    out: &Path,
    inputs: &[PathBuf],
    from: Option<&Document>,
    request: &PictureRequest,
) -> Result<Scene> {
    let folder = output::folder_of(out);
    let picture = picture::scene(request, folder)?;
    let Some(document) = from else {
        let cloud = |(at, path): (usize, &PathBuf)| -> Result<Cloud> {
            let offset = request.offsets.get(at).copied().unwrap_or_default();
            Ok(Cloud { offset, ..Cloud::of(named(path, folder)?) })
        };
        let clouds = inputs.iter().enumerate().map(cloud);
        return Ok(Scene { clouds: clouds.collect::<Result<_>>()?, ..picture });
    };
    let renamed = |cloud: &Cloud| -> Result<Cloud> {
        let path = placed(&cloud.file, document.folder());
        Ok(Cloud { file: named(&path, folder)?, ..cloud.clone() })
    };
    let kept = document.scene.clone();
    Ok(Scene {
        clouds: kept.clouds.iter().map(renamed).collect::<Result<_>>()?,
        measurements: kept.measurements,
        annotations: kept.annotations,
        bookmarks: kept.bookmarks,
        camera_path: kept.camera_path,
        ..picture
    })
}
