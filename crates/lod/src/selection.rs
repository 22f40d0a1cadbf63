//! What comes of a choice: the nodes that are drawn, those that are wanted, those that are missing, and how it
//! came about. Plain data, the same for the same input.

/// A node of the cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// Index in the node table.
    pub node: u32,
    /// Its first points that are drawn: whole strata, at least one point.
    pub prefix: usize,
    /// Typical distance of points in its cell, these and the ancestors', the file's unit; never more
    /// than the parent's.
    pub effective_spacing: f32,
}

/// A node that is wanted and not resident.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missing {
    /// Index in the node table.
    pub node: u32,
    /// Its first points that are wanted; 0 where none of its own is in view and it is wanted for its
    /// children's sake.
    pub prefix: usize,
    /// Distance of the eye to its contour, the file's unit: the paper's priority (kanzok2015,
    /// section 3.2.2).
    pub distance: f64,
    /// Distance of points, pixels, of what is drawn in its place without it; infinite where that is
    /// nothing.
    pub spacing_px: f64,
    /// Bytes of its slot.
    pub bytes: u64,
}

/// What was looked at, in nodes; `visited` is the sum of `culled`, `occluded`, `contour_culled`,
/// `contour_occluded`, `filtered`, `continuations`, `withheld`, `missing` and `drawn`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Looked at.
    pub visited: u64,
    /// With their whole subtree outside of the view.
    pub culled: u64,
    /// With their whole subtree hidden.
    pub occluded: u64,
    /// With none of their own points in view; their children were looked at all the same.
    pub contour_culled: u64,
    /// With all of their own points hidden; their children were looked at all the same.
    pub contour_occluded: u64,
    /// With no point of their own, or none below them either, that a filter wants.
    pub filtered: u64,
    /// Left out because all of their points lie where one is drawn already.
    pub continuations: u64,
    /// Left out because they, or not one stratum of them, fitted the budgets.
    pub withheld: u64,
    /// With points in view, wanted, and not drawn, since they or one above them are not resident; what
    /// is drawn above them serves.
    pub missing: u64,
    /// Drawn.
    pub drawn: u64,
    /// Of those drawn or missing: with fewer points than the view asks for, because of the budget.
    pub shortened: u64,
    /// Points drawn, in all.
    pub points: u64,
    /// Points wanted, in all: those drawn and those of missing nodes.
    pub points_wanted: u64,
    /// Bytes of the slots of all wanted nodes.
    pub bytes_wanted: u64,
}

/// The cut of a view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// What to draw, the coarsest on the picture first; parents stand before their children.
    pub drawn: Vec<Drawn>,
    /// Nodes that are left out because all of their own points are hidden, though their cells are not:
    /// with the spacings that their cells would have, and prefixes of 0. [`crate::CompactOctree`] wants
    /// them, or points drawn in their cells would grow.
    pub hidden: Vec<Drawn>,
    /// What shall be resident: all that would be drawn were everything resident, and what lies between
    /// those and the roots, parents first. The roots come first, in view or not, where they fit the budget.
    pub wanted: Vec<u32>,
    /// What of that is not resident, in the same order.
    pub missing: Vec<Missing>,
    /// How it came about.
    pub counters: Counters,
}
