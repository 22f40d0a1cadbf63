//! Traced light where it is known: scenes and pictures of a value of an axis, and how far light is
//! off there. [`paths`] traces, [`filters`] filters, [`pictures`] has what is filtered, and
//! [`regression`] the guided filter in 64 bits.

pub(super) mod filters;
pub(super) mod paths;
mod pictures;
mod regression;
