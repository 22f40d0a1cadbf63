//! Selects the points that represent a cell: thinning, spacing, radii, order and shape of the
//! points of a node.

pub(crate) mod arranged;
pub(crate) mod boxes;
pub(crate) mod candidates;
pub(crate) mod cell;
pub(crate) mod choose;
pub(crate) mod compact;
pub(crate) mod contour;
#[cfg(test)]
pub(crate) mod effort;
pub(crate) mod fringe;
pub(crate) mod marks;
pub(crate) mod nearby;
pub(crate) mod order;
pub(crate) mod pending;
pub(crate) mod shape;
pub(crate) mod spacing;
pub(crate) mod sparse;
pub(crate) mod thin;
pub(crate) mod tiles;
pub(crate) mod turns;
pub(crate) mod uneven;
pub(crate) mod unevenness;
pub(crate) mod unpicked;
pub(crate) mod wires;
