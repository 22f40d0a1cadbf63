//! Memory of the GPU: the pool of node planes, uploads, tables of the cut, the pyramid, uniforms of
//! a frame.

pub(crate) mod colour;
pub mod cut;
pub mod fetch;
pub mod frame;
pub mod hits;
pub mod lookup;
pub(crate) mod octree;
pub mod picture;
pub(crate) mod pool;
pub mod pyramid;
pub mod runs;
pub mod table;
pub mod upload;
