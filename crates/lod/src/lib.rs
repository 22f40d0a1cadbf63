//! Chooses what to draw for a view: frustum and occlusion culling, prefixes, budgets. Pure
//! functions without threads, files or GPU. [`View`] and a node table go in, a [`Selection`]
//! (nodes, prefixes, counters) comes out, to which [`surround`] adds what light needs; the
//! [`CompactOctree`] of a selection gives the renderer the spacing of the drawn points at each
//! place. Reasons are in `docs/design/choosing-and-streaming.md`.

mod closed;
mod crowding;
mod depth;
mod feedback;
mod frustum;
mod grid;
mod occlusion;
mod octree;
mod options;
mod oriented_box;
mod parts;
mod polygon;
mod prefix;
mod project;
mod raster;
mod residual;
mod select;
mod selection;
mod subtree;
mod surroundings;
mod view;

pub use crowding::{CROWDED_PX, crowding};
pub use depth::SoftwareDepth;
pub use feedback::{DepthFeedback, DepthTile, TILES, tiles_of};
pub use frustum::Frustum;
pub use occlusion::{Occlusion, Visible};
pub use octree::CompactOctree;
pub use options::{AllResident, Options, Residency};
pub use oriented_box::OrientedBox;
pub use prefix::share_above;
pub use project::{Projection, Silhouette};
pub use residual::needs_residual;
pub use select::select;
pub use selection::{Counters, Drawn, Lacking, Missing, Selection};
pub use surroundings::{Surroundings, light_octree, surround};
pub use view::{View, Window};
