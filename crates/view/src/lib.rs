//! The window: flies through an `.esker` file, or a scan, while it streams. Input moves a camera,
//! the engine's session draws for it, the picture becomes a texture. The only crate that knows
//! egui.

pub mod app;
pub mod args;
pub mod autopilot;
pub mod camera;
pub mod canvas;
pub mod counters;
pub mod depth;
pub mod device;
pub mod filters;
mod frustum;
pub mod gestures;
pub mod input_events;
pub mod keys;
pub mod legend;
pub mod looking;
pub mod measure;
pub mod panel;
pub mod pilot;
pub mod plot;
pub mod progress;
pub mod report;
pub mod rig;
pub mod scene;
pub mod script;
pub mod settings;
pub mod sharpness;
pub mod shots;
pub mod soft;
pub mod source;
pub mod theme;
pub mod times;
pub mod window;
