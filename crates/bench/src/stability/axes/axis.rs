//! What an axis is: values, the scene of a value, and bounds on errors of its pictures.

use crate::stability::axes::scenes::Scene;
use crate::stability::lab::Lab;
use anyhow::Result;

/// An axis.
pub(in crate::stability) struct Axis {
    /// Name in reports, and as a part of the benchmark.
    pub name: &'static str,
    /// Meaning of the values.
    pub value_is: &'static str,
    /// Values, from easy to hard.
    pub values: &'static [f64],
    /// The scene of a value.
    pub scene: fn(f64, &Lab<'_>) -> Result<Scene>,
    /// What is bounded.
    pub gauges: &'static [Gauge],
}

/// A bound on an error of a method.
pub(in crate::stability) struct Gauge {
    pub method: &'static str,
    pub measure: Measure,
    /// Maximum permissible error.
    pub bound: f64,
    /// Value of the axis up to which it must hold.
    pub rated_to: f64,
}

/// An error that is bounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::stability) enum Measure {
    /// Mean of FLIP, 0 to 1.
    Flip,
    /// Share of the interior of surfaces that is empty, or shows what lies behind.
    Holes,
    /// Mean error of depths inside surfaces, widths of a pixel.
    Depth,
    /// Mean error of normals, degrees.
    Normals,
    /// Distance of the middle of what is drawn from the middle of the picture, where the camera
    /// looks, pixels.
    Place,
    /// Share of the pixels that differ between a picture and its two halves.
    Parts,
    /// Width by which things are drawn too wide, in distances of their points.
    Width,
}

impl Measure {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flip => "FLIP",
            Self::Holes => "holes, share",
            Self::Depth => "depth, px",
            Self::Normals => "normals, degrees",
            Self::Place => "place, px",
            Self::Parts => "differing pixels, share",
            Self::Width => "extra width, spacings",
        }
    }
}
