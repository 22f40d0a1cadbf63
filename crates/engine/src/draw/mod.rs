//! From an open file to pictures: sessions that stream, planes that are read completely, and the
//! painters of both.

pub mod budget;
pub mod calibration;
pub mod change;
pub mod choice;
pub mod empty_picture;
pub mod enlarge;
pub(crate) mod facing;
pub mod frame;
pub mod layers;
pub mod method;
pub mod options;
pub mod pace;
mod painter;
pub(crate) mod probe;
pub mod scene;
pub mod session;
mod slots;
mod staging;
pub mod whole;
pub(crate) mod window;
