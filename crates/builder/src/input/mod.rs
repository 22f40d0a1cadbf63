//! From scans to rows: opens the inputs, chooses lattice, schema and classes, decodes each
//! input once.

pub(crate) mod attribute_types;
pub(crate) mod attribute_units;
pub(crate) mod crs;
pub(crate) mod degrees;
pub(crate) mod esker_source;
pub(crate) mod gps_times;
pub(crate) mod guesses;
pub(crate) mod identity;
pub(crate) mod intake;
pub(crate) mod known;
pub(crate) mod outside;
pub(crate) mod plan;
pub(crate) mod taking;
