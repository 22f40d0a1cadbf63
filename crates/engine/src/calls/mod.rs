//! The calls, a module each. A call returns a report, a struct that serialises to the JSON of the
//! programs; the function `text` beside it (for `info` in `info_text`) writes it for people.

pub mod build;
pub mod conditions;
pub mod demo;
pub mod explain;
pub mod export;
pub mod info;
pub mod info_text;
pub mod job;
pub mod pick;
pub mod preview;
pub mod query;
pub mod render;
pub mod verify;
