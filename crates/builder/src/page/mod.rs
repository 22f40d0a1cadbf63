//! Rows of a node as the columns of its page, and the histograms of their values.

pub(crate) mod gather;
pub(crate) mod histograms;
