//! Reads scene documents: which input is one, what it names, and what it keeps beside its picture.

use super::values::in_field;
use super::{picture, places};
use crate::cameras::camera::Camera;
use crate::draw::scene::PictureRequest;
use anyhow::{Context, Error, Result, ensure};
use esker_points::place::no_file_at;
use esker_points::read_at::is_remote;
use esker_scan::synthetic::is_spec;
use esker_scene::{Cloud, Found, Scene, detect};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A scene document, and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Document {
    /// The document.
    pub scene: Scene,
    /// Its path.
    pub path: PathBuf,
}

/// A cloud of a document, as it is opened.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedCloud {
    /// Path of its file, or the name of a generated scan.
    pub path: PathBuf,
    /// What is added to its coordinates, their unit.
    pub offset: [f64; 3],
    /// Whether it is drawn.
    pub is_visible: bool,
}

impl Document {
    /// A document of `inputs` alone, which is no file yet: its path is empty.
    ///
    /// # Errors
    /// If the name of an input is no Unicode.
    pub fn of_inputs(inputs: &[PathBuf]) -> Result<Self> {
        let cloud = |path: &PathBuf| -> Result<Cloud> {
            let name = path.to_str().with_context(|| {
                let shown = path.display();
                format!(
                    "{shown}: the name is no Unicode, which a scene document cannot hold; rename it"
                )
            })?;
            Ok(Cloud::of(name.to_owned()))
        };
        let clouds = inputs.iter().map(cloud).collect::<Result<_>>()?;
        Ok(Self { scene: Scene { clouds, ..Scene::default() }, path: PathBuf::new() })
    }

    /// All clouds, also those that are not visible, in their order.
    pub fn clouds(&self) -> Vec<PlacedCloud> {
        let clouds =
            self.scene.clouds.iter().map(|Cloud { file, visible, offset, .. }| PlacedCloud {
                path: places::placed(file, self.folder()),
                offset: *offset,
                is_visible: *visible,
            });
        clouds.collect()
    }

    /// The document among the inputs of a picture; none if they are scans or `.esker` files.
    ///
    /// # Errors
    /// If there are other inputs beside it, it cannot be read or is invalid, or an input is a
    /// `.json` file without the field of scene documents.
    pub fn among(inputs: &[PathBuf]) -> Result<Option<Self>> {
        for path in inputs {
            if !is_document(path)? {
                continue;
            }
            let shown = path.display();
            ensure!(
                inputs.len() == 1,
                "{shown}: a scene document names all scans of its picture; name no other input"
            );
            return Self::read(path).map(Some);
        }
        Ok(None)
    }

    /// Reads the document at `path`.
    ///
    /// # Errors
    /// If it cannot be read or is invalid; the message names the field.
    pub fn read(path: &Path) -> Result<Self> {
        let shown = || path.display().to_string();
        let document =
            Self { scene: esker_scene::read(path).with_context(shown)?, path: path.to_owned() };
        document.check_cameras().with_context(shown)?;
        Ok(document)
    }

    /// Checks the cameras that no picture of the document needs.
    fn check_cameras(&self) -> Result<()> {
        for (i, bookmark) in self.scene.bookmarks.iter().enumerate() {
            in_field(format!("bookmarks[{i}].camera"), Camera::parse(&bookmark.camera.text()))?;
        }
        for (i, frame) in self.scene.camera_path.iter().enumerate() {
            let field = format!("camera_path[{i}].camera");
            let camera = in_field(&field, Camera::parse(&frame.camera.text()))?;
            ensure!(camera.eye.is_some(), "`{field}`: key frames need an eye");
        }
        Ok(())
    }

    /// Folder that paths in the document start from.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Inputs of the picture: the clouds that are visible.
    ///
    /// # Errors
    /// If none is visible.
    pub fn inputs(&self) -> Result<Vec<PathBuf>> {
        let inputs: Vec<_> =
            self.visible().map(|cloud| places::placed(&cloud.file, self.folder())).collect();
        ensure!(
            !inputs.is_empty(),
            "{}: `clouds`: none is visible, so that there is nothing to draw",
            self.path.display()
        );
        Ok(inputs)
    }

    /// The clouds that are visible.
    fn visible(&self) -> impl Iterator<Item = &Cloud> {
        self.scene.clouds.iter().filter(|cloud| cloud.visible)
    }

    /// Request of the picture, with the defaults of `esker render`.
    ///
    /// # Errors
    /// If a value is invalid or out of range, or a file that is named cannot be read; the message
    /// names the field.
    pub fn request(&self) -> Result<PictureRequest> {
        let shown = || self.path.display().to_string();
        let request = picture::request(&self.scene, self.folder()).with_context(shown)?;
        let offsets = self.visible().map(|cloud| cloud.offset).collect();
        Ok(PictureRequest { offsets, ..request })
    }

    /// What is in the document and not in its picture, a line each.
    pub fn notes(&self) -> Vec<String> {
        let counts = [
            (self.scene.measurements.len(), "measurements"),
            (self.scene.annotations.len(), "annotations"),
        ];
        let shown = self.path.display();
        let some = counts.into_iter().filter(|(count, _)| *count > 0);
        some.map(|(count, what)| format!("{shown}: pictures do not show {what} yet ({count})"))
            .collect()
    }
}

/// Whether an input is a scene document, by its content. What cannot be opened is none.
///
/// # Errors
/// If it cannot be read, or has the name of a JSON file, and is JSON without the field of scene
/// documents.
pub fn is_document(path: &Path) -> Result<bool> {
    if is_spec(path) || is_remote(path) || !matches!(no_file_at(path), Ok(None)) {
        return Ok(false);
    }
    let Ok(file) = File::open(path) else { return Ok(false) };
    let shown = || format!("{}: cannot read", path.display());
    let found = detect(file).with_context(shown)?;
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if found == Found::OtherObject && is_json {
        let fault = esker_scene::read(path).err().unwrap_or(esker_scene::SceneError::NoScene);
        return Err(Error::from(fault).context(path.display().to_string()));
    }
    Ok(matches!(found, Found::Scene(_)))
}
