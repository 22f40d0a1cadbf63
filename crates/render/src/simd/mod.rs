//! Arithmetic on registers of one, four and eight floats.

pub(crate) mod lanes;
pub(crate) mod values;
