//! Stability: how far a build and its pictures can be trusted when a scan or a view gets difficult.
//!
//! [`relations`] changes a scan in ways that must not change its picture: unit, place, step,
//! format, order, threads. [`axes`] makes analytic scenes worse along one condition at a time until
//! a bound breaks, as ASTM E3125 has rated and limiting conditions. [`stiffness`] fits exponents to
//! the times of builds. [`cloud`] has scans in memory, [`lab`] builds and draws them, `light`
//! traces scenes whose light is known, [`report`] has the verdicts.

mod axes;
mod cloud;
mod lab;
#[cfg(feature = "light")]
mod light;
mod measure;
mod relations;
mod report;
mod stiffness;

pub use measure::{StabilityRequest, measure};
pub use report::{StabilityReport, failure, markdown, text};
