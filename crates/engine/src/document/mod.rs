//! Scene documents (`esker_scene`) as programs draw and write them: a document becomes the inputs
//! and the request of a picture, as the options of `esker render` do, and a request becomes a
//! document again. Paths in a document are relative to its folder.

mod about;
mod build;
mod clips;
mod filter;
mod lights;
mod picture;
mod places;
mod read;
mod save;
mod values;

pub use about::SceneInfo;
pub use esker_scene::{Annotation, Measurement, MeasurementKind};
pub use read::{Document, PlacedCloud, is_document};
pub use save::{SaveReport, may_save, save, save_over, text};
