//! The document: all its fields, and the checks that no renderer makes.

use crate::camera::{Camera, KeyFrame, check_path};
use crate::error::SceneError;
use crate::fields::{Build, Filter, LightOptions, Quantity, is_default, is_yes, yes};
use crate::limits::VERSION;
use crate::marks::{Annotation, Bookmark, Clip, Measurement, check_bookmarks};
use serde::{Deserialize, Serialize};

/// A scene document. Fields of the options of `esker render` have their names and units; one that
/// is missing has the option's default. Coordinates are those of the scans.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// Version of the document, [`VERSION`].
    #[serde(rename = "esker_scene")]
    pub version: u32,
    /// The scans.
    #[serde(skip_serializing_if = "is_default")]
    pub clouds: Vec<Cloud>,
    /// How scans that are not built yet are built.
    #[serde(skip_serializing_if = "is_default")]
    pub build: Build,
    /// The camera; fitted to the scan where parts are missing.
    #[serde(skip_serializing_if = "is_default")]
    pub camera: Camera,
    /// Width and height of the picture, pixels.
    #[serde(skip_serializing_if = "is_default")]
    pub size: Option<[u32; 2]>,
    /// Part of the picture that is drawn: first column and row, width and height, pixels.
    #[serde(skip_serializing_if = "is_default")]
    pub window: Option<[u32; 4]>,
    /// Name of the drawing method.
    #[serde(skip_serializing_if = "is_default")]
    pub method: Option<String>,
    /// Most points that are drawn.
    #[serde(skip_serializing_if = "is_default")]
    pub budget_points: Option<u64>,
    /// Time of a frame that settings are chosen for, milliseconds.
    #[serde(skip_serializing_if = "is_default")]
    pub budget_ms: Option<f64>,
    /// Distance of neighbouring points in the picture that is fine enough, pixels.
    #[serde(skip_serializing_if = "is_default")]
    pub target_spacing: Option<f64>,
    /// Source of colours, perhaps a range of its values and a colour map: `NAME`, `NAME:MIN..MAX`,
    /// `NAME:MAP` or `NAME:MIN..MAX:MAP`.
    #[serde(skip_serializing_if = "is_default")]
    pub colour: Option<String>,
    /// Which points are drawn.
    #[serde(skip_serializing_if = "is_default")]
    pub filter: Filter,
    /// Whether surfaces are lit without highlights.
    #[serde(skip_serializing_if = "is_default")]
    pub no_highlights: bool,
    /// Whether points of surfaces that look away from the camera are left out.
    #[serde(skip_serializing_if = "is_default")]
    pub cull_back: bool,
    /// Diameter of points that are drawn alone, pixels, or `adaptive`.
    #[serde(skip_serializing_if = "is_default")]
    pub point_size: Option<Quantity>,
    /// Strength of the shading of points that are drawn alone; 0 for none.
    #[serde(skip_serializing_if = "is_default")]
    pub eye_dome: Option<f64>,
    /// Whether differences of exposure between scans are evened out.
    #[serde(skip_serializing_if = "is_default")]
    pub even_exposure: bool,
    /// Whether exact colours are drawn although the file has compact ones.
    #[serde(skip_serializing_if = "is_default")]
    pub full: bool,
    /// How pictures of the method `lit` are lit.
    #[serde(skip_serializing_if = "is_default")]
    pub light: LightOptions,
    /// Regions whose points are kept or cut away.
    #[serde(skip_serializing_if = "is_default")]
    pub clips: Vec<Clip>,
    /// Measurements between points.
    #[serde(skip_serializing_if = "is_default")]
    pub measurements: Vec<Measurement>,
    /// Texts at points.
    #[serde(skip_serializing_if = "is_default")]
    pub annotations: Vec<Annotation>,
    /// Cameras with names.
    #[serde(skip_serializing_if = "is_default")]
    pub bookmarks: Vec<Bookmark>,
    /// Key frames of a flight.
    #[serde(skip_serializing_if = "is_default")]
    pub camera_path: Vec<KeyFrame>,
}

/// A scan of a document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cloud {
    /// An `.esker` file, a scan, a folder of scans, relative to the folder of the document; or a
    /// generated scan.
    pub file: String,
    /// Whether it is drawn.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub visible: bool,
    /// What is added to its coordinates, their unit.
    #[serde(default, skip_serializing_if = "is_default")]
    pub offset: [f64; 3],
}

impl Cloud {
    /// A visible scan where its coordinates are.
    pub fn of(file: impl Into<String>) -> Self {
        Self { file: file.into(), visible: true, offset: [0.0; 3] }
    }
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            version: VERSION,
            clouds: Vec::new(),
            build: Build::default(),
            camera: Camera::default(),
            size: None,
            window: None,
            method: None,
            budget_points: None,
            budget_ms: None,
            target_spacing: None,
            colour: None,
            filter: Filter::default(),
            no_highlights: false,
            cull_back: false,
            point_size: None,
            eye_dome: None,
            even_exposure: false,
            full: false,
            light: LightOptions::default(),
            clips: Vec::new(),
            measurements: Vec::new(),
            annotations: Vec::new(),
            bookmarks: Vec::new(),
            camera_path: Vec::new(),
        }
    }
}

impl Scene {
    /// Checks what JSON of the right types may still have wrong. Values of options are checked by
    /// what draws them.
    ///
    /// # Errors
    /// If a cloud has no file, a name is empty or occurs twice, a clip or a measurement has no
    /// shape, or key frames are not in the order of their times.
    pub fn check(&self) -> Result<(), SceneError> {
        if let Some(i) = self.clouds.iter().position(|cloud| cloud.file.trim().is_empty()) {
            return Err(SceneError::of(format!("clouds[{i}].file"), "is empty: name a scan"));
        }
        for (i, clip) in self.clips.iter().enumerate() {
            clip.check(&format!("clips[{i}]"))?;
        }
        for (i, measurement) in self.measurements.iter().enumerate() {
            measurement.check(&format!("measurements[{i}]"))?;
        }
        if let Some(i) = self.annotations.iter().position(|a| a.text.trim().is_empty()) {
            return Err(SceneError::of(format!("annotations[{i}].text"), "is empty"));
        }
        check_bookmarks(&self.bookmarks)?;
        check_path(&self.camera_path)
    }
}
