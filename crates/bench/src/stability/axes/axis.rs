//! What an axis is: a condition with bounds on errors, its values, and the scene of a value.

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
    /// The scene of a value.
    pub scene: fn(f64, &Lab<'_>) -> Result<Scene>,
}
