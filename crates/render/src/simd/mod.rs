//! Registers of floats: one, four or eight at once.

pub(crate) mod lanes;
pub(crate) mod values;
