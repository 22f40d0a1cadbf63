//! What a scene document holds, for `esker info`.

use super::read::Document;
use esker_scene::{Cloud, VERSION};
use serde::Serialize;

/// Contents of a document; the files that it names are not opened.
#[derive(Clone, Debug, Serialize)]
pub struct SceneInfo {
    /// Path of the document.
    pub scene: String,
    /// Version of the document.
    pub version: u32,
    /// Files of its visible clouds, as the document names them.
    pub clouds: Vec<String>,
    /// Files of its other clouds.
    pub clouds_hidden: Vec<String>,
    /// Drawing method; none for the default.
    pub method: Option<String>,
    /// Source of colours; none for the default.
    pub colour: Option<String>,
    /// Number of clips.
    pub clips: usize,
    /// Number of measurements.
    pub measurements: usize,
    /// Number of annotations.
    pub annotations: usize,
    /// Names of the bookmarks.
    pub bookmarks: Vec<String>,
    /// Number of key frames of the camera path.
    pub key_frames: usize,
}

impl SceneInfo {
    /// Contents of a document.
    pub fn of(document: &Document) -> Self {
        let scene = &document.scene;
        let files = |visible: bool| {
            let clouds = scene.clouds.iter().filter(|cloud| cloud.visible == visible);
            clouds.map(|Cloud { file, .. }| file.clone()).collect()
        };
        Self {
            scene: document.path.display().to_string(),
            version: VERSION,
            clouds: files(true),
            clouds_hidden: files(false),
            method: scene.method.clone(),
            colour: scene.colour.clone(),
            clips: scene.clips.len(),
            measurements: scene.measurements.len(),
            annotations: scene.annotations.len(),
            bookmarks: scene.bookmarks.iter().map(|bookmark| bookmark.name.clone()).collect(),
            key_frames: scene.camera_path.len(),
        }
    }

    /// The contents as text.
    pub fn text(&self) -> String {
        let default = || "the default".to_owned();
        let list = |names: &[String]| match names {
            [] => "none".to_owned(),
            names => names.join(", "),
        };
        [
            format!("{}: a scene document of version {}", self.scene, self.version),
            format!("clouds: {}", list(&self.clouds)),
            format!("hidden clouds: {}", list(&self.clouds_hidden)),
            format!("method: {}", self.method.clone().unwrap_or_else(default)),
            format!("colour: {}", self.colour.clone().unwrap_or_else(default)),
            format!("bookmarks: {}", list(&self.bookmarks)),
            format!(
                "clips: {}; measurements: {}; annotations: {}; key frames: {}",
                self.clips, self.measurements, self.annotations, self.key_frames
            ),
        ]
        .join("\n")
    }
}
