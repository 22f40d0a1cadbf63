//! EWA splatting (zwicker2004) against plain `f64` references: exact shapes, no holes, no moiré,
//! and valid pictures of extreme splats.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "ewa/bare.rs"]
mod bare;
#[path = "ewa/clip.rs"]
mod clip;
#[path = "ewa/device.rs"]
mod device;
#[path = "ewa/exact.rs"]
mod exact;
mod gpu;
#[path = "ewa/holes.rs"]
mod holes;
#[path = "ewa/horizon.rs"]
mod horizon;
#[path = "ewa/numerics.rs"]
mod numerics;
#[path = "ewa/passes.rs"]
mod passes;
#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;
#[path = "ewa/shape.rs"]
mod shape;
