//! What to draw for a view: frustum, prefixes, budget; pure, without threads, files or GPU.
//! [`View`] and a node table go in, a [`Selection`] (nodes, prefixes, counters) comes out; the
//! [`CompactOctree`] of a selection tells the renderer how densely each place is drawn.

pub mod closed;
pub mod depth;
pub mod feedback;
pub mod frustum;
pub mod grid;
pub mod occlusion;
pub mod octree;
pub mod options;
pub mod oriented_box;
pub mod parts;
mod polygon;
pub mod prefix;
pub mod project;
pub mod raster;
pub mod residual;
pub mod select;
pub mod selection;
pub mod view;

pub use depth::SoftwareDepth;
pub use feedback::{DepthFeedback, DepthTile, tiles_of};
pub use frustum::Frustum;
pub use occlusion::{Occlusion, Visible};
pub use octree::CompactOctree;
pub use options::{AllResident, Options, Residency};
pub use oriented_box::OrientedBox;
pub use project::{Projection, Silhouette};
pub use residual::needs_residual;
pub use select::select;
pub use selection::{Counters, Drawn, Missing, Selection};
pub use view::View;
