//! Result of a selection: the nodes that are drawn, wanted and missing, and counters. Plain data;
//! the same input gives the same result.

/// A node of the cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// Index in the node table.
    pub node: u32,
    /// Number of drawn points, from the first one on: whole strata, at least one point.
    pub prefix: usize,
    /// Typical distance of points in its cell, ancestors' points included, the file's unit; never
    /// more than the parent's.
    pub effective_spacing: f32,
}

/// A node that is wanted and not resident.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missing {
    /// Index in the node table.
    pub node: u32,
    /// Number of wanted points, from the first one on; 0 if none of its own points is in view and
    /// it is wanted for its children.
    pub prefix: usize,
    /// Distance of the eye to its contour, the file's unit: the priority of kanzok2015, section
    /// 3.2.2.
    pub distance: f64,
    /// Distance of points, pixels, of what is drawn in its place without it; infinite if nothing
    /// is.
    pub spacing_px: f64,
    /// Bytes of its slot.
    pub bytes: u64,
}

/// Numbers of nodes in a selection. They are those of the picture, except for `bytes_wanted` and
/// those of the surroundings; `visited` is the sum of `culled`, `occluded`, `contour_culled`,
/// `contour_occluded`, `filtered`, `continuations`, `withheld`, `missing` and `drawn`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Nodes tested.
    pub visited: u64,
    /// Nodes whose whole subtree is outside of the view.
    pub culled: u64,
    /// Nodes whose whole subtree is hidden.
    pub occluded: u64,
    /// Nodes without own points in view; their children were tested.
    pub contour_culled: u64,
    /// Nodes whose own points are all hidden; their children were tested.
    pub contour_occluded: u64,
    /// Nodes of which a filter wants no own point, or no point of the subtree.
    pub filtered: u64,
    /// Nodes left out because each of their points coincides with a drawn one.
    pub continuations: u64,
    /// Nodes left out because not even one of their strata fitted the budgets.
    pub withheld: u64,
    /// Nodes with points in view that are wanted and not drawn, since they or an ancestor are not
    /// resident; drawn ancestors take their place.
    pub missing: u64,
    /// Nodes drawn.
    pub drawn: u64,
    /// Nodes, of those drawn or missing, with fewer points than the view needs, because of the
    /// budget.
    pub shortened: u64,
    /// Sum of drawn points.
    pub points: u64,
    /// Sum of wanted points: of drawn and of missing nodes.
    pub points_wanted: u64,
    /// Bytes of the slots of all wanted nodes.
    pub bytes_wanted: u64,
    /// Nodes drawn in the surroundings of the picture.
    pub surroundings: u64,
    /// Sum of their points.
    pub surroundings_points: u64,
    /// Nodes left out of the surroundings because they did not fit their budgets.
    pub surroundings_withheld: u64,
}

/// The cut of a view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Nodes to draw, coarsest in the picture first; parents come before their children.
    pub drawn: Vec<Drawn>,
    /// Nodes left out because all of their own points are hidden, or beside the picture, though
    /// splats drawn in their cells are not: with the spacings that their cells would have, and
    /// prefixes of 0. [`crate::CompactOctree`] needs them, or those splats would grow.
    pub hidden: Vec<Drawn>,
    /// Nodes around the picture, for light ([`crate::surround`]); parents come before their
    /// children, and none is in `drawn`. Empty without surroundings.
    pub surroundings: Vec<Drawn>,
    /// Nodes that should be resident: all that would be drawn if everything were resident, and
    /// their ancestors, parents first. The roots come first, in view or not, if they fit the
    /// budget. Nodes that only the surroundings want come last.
    pub wanted: Vec<u32>,
    /// Numbers of points of the wanted nodes, in the same order; 0 for nodes that are wanted for
    /// their children.
    pub prefixes: Vec<usize>,
    /// Number of wanted nodes, from the first one, that the picture wants.
    pub wanted_in_picture: usize,
    /// Those of the wanted nodes that are not resident, in the same order.
    pub missing: Vec<Missing>,
    /// Nodes that lack their children, with which another cut might be chosen. Empty for whole
    /// tables.
    pub lacking: Vec<Lacking>,
    /// Counters.
    pub counters: Counters,
}

/// A node whose children are wanted and not in the table
/// ([`esker_points::Node::lacks_children`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lacking {
    /// Index in the node table.
    pub node: u32,
    /// Distance of points in its place without its children, pixels; infinite if it is not known.
    pub spacing_px: f64,
}

/// Share of the greatest spacing from which on nodes are urgent: about a level.
const URGENT_SHARE: f64 = 0.5;

impl Lacking {
    /// Nodes that lack their children and matter most: with these children the budgets may end
    /// before the others. Ascending, each once.
    pub fn urgent(all: &[Self]) -> Vec<u32> {
        let greatest = all.iter().fold(0.0, |greatest: f64, of| greatest.max(of.spacing_px));
        let least = greatest * URGENT_SHARE;
        let urgent = all.iter().filter(|of| of.spacing_px >= least || of.spacing_px.is_nan());
        let mut urgent: Vec<u32> = urgent.map(|of| of.node).collect();
        urgent.sort_unstable();
        urgent.dedup();
        urgent
    }
}
