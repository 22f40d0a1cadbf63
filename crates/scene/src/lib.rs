//! The scene document: what a user makes of scans, as JSON that people read and edit. It names the
//! scans and holds camera, method, colours, filter, lights, clips, measurements, annotations,
//! bookmarks and a camera path; `docs/scene.md` lists the fields. This crate reads and writes it,
//! and knows neither how a value is drawn nor what is in a file that it names.

mod camera;
mod detect;
mod document;
mod error;
mod fields;
mod limits;
mod marks;
mod read;
mod write;

pub use camera::{Camera, CameraParts, KeyFrame};
pub use detect::{Found, detect};
pub use document::{Cloud, Scene};
pub use error::SceneError;
pub use fields::{Build, Filter, LightItem, LightOptions, PolygonForm, Quantity};
pub use limits::{BYTES_MAX, VERSION};
pub use marks::{
    Annotation, Bookmark, Clip, Keep, Measurement, MeasurementKind, OrientedBox, Plane,
};
pub use read::{parse, read};
