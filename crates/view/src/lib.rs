//! The window: flies through an `.esker` file, or scans, while the points stream in. Input moves a
//! camera, a session of the engine draws what the camera sees, and the picture is shown as a
//! texture. This is the only crate that depends on egui.

mod app;
pub mod args;
mod autopilot;
pub mod camera;
mod canvas;
mod clouds;
mod commands;
mod counters;
mod depth;
pub mod device;
mod dialog;
mod document;
mod fault;
mod files;
mod fit;
mod fonts;
mod frustum;
mod history;
mod hud;
mod input_events;
mod job;
mod keep;
mod keys;
mod overlay;
mod pacing;
mod panel;
mod pilot;
mod pose;
mod progress;
mod prompt;
mod report;
pub mod scene;
mod script;
mod scripted_run;
pub mod settings;
mod sharpness;
mod shots;
mod soft;
pub mod source;
mod theme;
mod times;
mod tools;
mod viewer;
mod views;
pub mod window;
