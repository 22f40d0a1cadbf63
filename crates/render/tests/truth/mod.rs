//! Errors and flicker of pictures of sampled analytic scenes. Tests and the example
//! `surface_quality` measure pictures by them.
#![allow(dead_code, reason = "not every user needs all of it")]

pub mod flicker;
pub mod measure;
