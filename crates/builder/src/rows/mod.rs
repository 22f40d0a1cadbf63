//! Points as rows, from decoding to sampling: partition, sorting, scratch files, and the journal.

pub(crate) mod borders;
pub(crate) mod coincident;
pub(crate) mod corners;
pub(crate) mod journal;
pub(crate) mod journal_record;
pub(crate) mod partition;
pub(crate) mod row;
pub(crate) mod scratch;
pub(crate) mod sort;
pub(crate) mod store;
