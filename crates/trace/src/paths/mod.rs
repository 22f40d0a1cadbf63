//! Paths: guide rays, indirect and direct light, lookup, accumulation (`bauszat2011`, 3.1 and 3.2).

pub(crate) mod directions;
mod gloss;
mod options;
mod sequence;
mod stats;
mod surfaces;

pub use gloss::Gloss;
pub use options::Options;
pub use sequence::Sequence;
pub use stats::Stats;
pub use surfaces::Surfaces;
