//! Paths: guide rays, indirect and direct light, lookup, accumulation (`bauszat2011`, 3.1 and 3.2).

pub(crate) mod band;
mod batches;
pub(crate) mod direct;
mod directions;
mod frame;
mod gloss;
mod guide;
pub(crate) mod history;
pub(crate) mod indirect;
pub(crate) mod lookup;
mod options;
mod resolve;
mod sequence;
mod stats;
mod surface;
mod surfaces;

pub(crate) use band::sampler_of;
pub(crate) use batches::Batches;
pub(crate) use frame::Frame;
pub use gloss::Gloss;
pub use options::Options;
pub use resolve::LitImage;
pub(crate) use sequence::Sampler;
pub use sequence::Sequence;
pub use stats::Stats;
pub use surfaces::Surfaces;
