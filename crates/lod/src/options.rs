//! Inputs of a selection besides the view: budgets, target spacing, and the state of the nodes.

/// Budgets and target spacing of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Greatest number of wanted points.
    pub points_budget: u64,
    /// Greatest number of bytes in the slots of all wanted nodes; `u64::MAX` for no limit.
    pub bytes_budget: u64,
    /// Distance of neighbouring points in the picture that is fine enough, pixels. With 0, every
    /// point of the nodes in view is wanted, including continuations (coincident points).
    pub target_spacing_px: f64,
}

impl Default for Options {
    /// One point a pixel, within the number of points that two cores project in a tenth of a
    /// second.
    fn default() -> Self {
        Self { points_budget: 10_000_000, bytes_budget: u64::MAX, target_spacing_px: 1.0 }
    }
}

/// State of the nodes.
pub trait Residency {
    /// Whether the node's points are resident.
    fn is_resident(&self, node: u32) -> bool;
    /// Bytes that the node takes in memory, resident or not.
    fn slot_bytes(&self, node: u32) -> u64;
    /// Greatest number of the node's own points that a filter leaves, from the first one on.
    fn points_max(&self, _: u32) -> usize {
        usize::MAX
    }
    /// Whether a filter leaves no point of the node and of its subtree.
    fn rejects_subtree(&self, _: u32) -> bool {
        false
    }
}

/// Every node is resident and costs nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct AllResident;

impl Residency for AllResident {
    fn is_resident(&self, _: u32) -> bool {
        true
    }
    fn slot_bytes(&self, _: u32) -> u64 {
        0
    }
}
