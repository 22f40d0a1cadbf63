//! What the programs do, a module a call.

pub mod build;
pub mod demo;
pub mod explain;
pub mod export;
pub mod info;
pub mod render;
pub mod verify;
