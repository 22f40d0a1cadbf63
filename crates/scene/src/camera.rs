//! Cameras: as on the command line, in one text, or as an object of its parts.

use crate::error::SceneError;
use crate::fields::{Quantity, is_default};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// A camera, whose parts may be missing.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Camera {
    /// Text as on the command line: `eye=x,y,z;target=x,y,z;up=x,y,z;fovy=60`.
    Text(String),
    /// An object of its parts.
    Parts(CameraParts),
}

/// Parts of a camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraParts {
    /// Position, coordinates of the scan.
    #[serde(skip_serializing_if = "is_default")]
    pub eye: Option<[f64; 3]>,
    /// Point that it looks at, coordinates of the scan.
    #[serde(skip_serializing_if = "is_default")]
    pub target: Option<[f64; 3]>,
    /// Up direction.
    #[serde(skip_serializing_if = "is_default")]
    pub up: Option<[f64; 3]>,
    /// Direction of view, in place of a target.
    #[serde(skip_serializing_if = "is_default")]
    pub direction: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    #[serde(skip_serializing_if = "is_default")]
    pub fovy: Option<f64>,
    /// Height of the picture of a parallel view, the scan's unit, or `fit`.
    #[serde(skip_serializing_if = "is_default")]
    pub ortho: Option<Quantity>,
}

/// A camera at a time of a flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyFrame {
    /// Time since the start of the flight, seconds.
    pub time_s: f64,
    /// The camera.
    pub camera: Camera,
}

impl Default for Camera {
    fn default() -> Self {
        Self::Parts(CameraParts::default())
    }
}

impl Camera {
    /// The camera as on the command line.
    pub fn text(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Parts(parts) => parts.text(),
        }
    }
}

impl CameraParts {
    fn text(&self) -> String {
        let vector =
            |name: &str, v: Option<[f64; 3]>| v.map(|[x, y, z]| format!("{name}={x},{y},{z}"));
        let parts = [
            vector("eye", self.eye),
            vector("target", self.target),
            vector("up", self.up),
            vector("direction", self.direction),
            self.fovy.map(|degrees| format!("fovy={degrees}")),
            self.ortho.as_ref().map(|height| format!("ortho={height}")),
        ];
        parts.into_iter().flatten().collect::<Vec<_>>().join(";")
    }
}

impl<'de> Deserialize<'de> for Camera {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(CameraVisitor)
    }
}

/// Reads either form; an error within an object names the part, which an untagged enum would not.
struct CameraVisitor;

impl<'de> Visitor<'de> for CameraVisitor {
    type Value = Camera;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a camera: an object with eye, target, up, direction, fovy or ortho, or a text as behind --camera")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Camera, E> {
        Ok(Camera::Text(text.to_owned()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Camera, A::Error> {
        CameraParts::deserialize(MapAccessDeserializer::new(map)).map(Camera::Parts)
    }
}

/// Checks that the times of key frames rise from 0 or later.
pub(crate) fn check_path(path: &[KeyFrame]) -> Result<(), SceneError> {
    let mut before = None;
    for (i, frame) in path.iter().enumerate() {
        let time = frame.time_s;
        let is_later = before.map_or(time >= 0.0, |before| time > before);
        if !is_later || !time.is_finite() {
            let fault = format!("is {time}: times rise from key frame to key frame, from 0");
            return Err(SceneError::of(format!("camera_path[{i}].time_s"), fault));
        }
        before = Some(time);
    }
    Ok(())
}
