//! Points while they are moved about: rows, partitions, sorting, scratch files, the journal of a
//! build.

pub(crate) mod borders;
pub(crate) mod coincident;
pub(crate) mod journal;
pub(crate) mod journal_record;
pub(crate) mod partition;
pub(crate) mod row;
pub(crate) mod scratch;
pub(crate) mod sort;
pub(crate) mod store;
