//! What an axis is: a condition with bounds on errors, its values, and what a value is measured on.

use crate::stability::axes::scenes::Scene;
use crate::stability::lab::Lab;
use anyhow::Result;
use esker_engine::calls::conditions::rated::Condition;

/// An axis.
pub(in crate::stability) struct Axis {
    /// Its name, which is also that of a part of the benchmark, and what is bounded.
    pub condition: &'static Condition,
    /// Values, from easy to hard.
    pub values: &'static [f64],
    /// What a value is measured on.
    pub subject: Subject,
}

/// What a value of an axis is measured on.
pub(in crate::stability) enum Subject {
    /// Pictures of the scan of a value.
    Scan(fn(f64, &Lab<'_>) -> Result<Scene>),
    /// Traced light of a value: the measures, in the order of the gauges.
    #[cfg(feature = "light")]
    Light(fn(f64) -> Vec<f64>),
    /// Nothing, as the program is built without the feature `light`.
    #[cfg(not(feature = "light"))]
    LeftOut,
}
