//! From an open file to pictures: sessions that stream, planes that are read completely, and the
//! painters of both.

pub mod budget;
pub mod empty_picture;
pub mod frame;
pub mod options;
pub mod painter;
pub mod scene;
pub mod session;
pub mod slots;
pub mod staging;
pub mod whole;
