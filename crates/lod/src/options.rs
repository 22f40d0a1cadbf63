//! What a choice of nodes goes by beside the view: what it may cost, how fine it shall be, what is at hand.

/// What a view may cost and how fine it shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Points wanted at most; never passed.
    pub points_budget: u64,
    /// Bytes of the slots of all wanted nodes at most; never passed. `u64::MAX` is no bound.
    pub bytes_budget: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels. 0 asks for every
    /// point of the nodes in view, continuations (coincident points) included.
    pub target_spacing_px: f64,
}

impl Default for Options {
    /// A point a pixel, within what two cores project in a tenth of a second.
    fn default() -> Self {
        Self { points_budget: 10_000_000, bytes_budget: u64::MAX, target_spacing_px: 1.0 }
    }
}

/// What the caller knows of the nodes.
pub trait Residency {
    /// Whether its points are at hand.
    fn is_resident(&self, node: u32) -> bool;
    /// Bytes that it takes in memory, resident or not.
    fn slot_bytes(&self, node: u32) -> u64;
    /// How many of its own points may be shown, from the first on: what a filter leaves.
    fn points_max(&self, _: u32) -> usize {
        usize::MAX
    }
    /// Whether no point of it or below it may be shown.
    fn is_barren(&self, _: u32) -> bool {
        false
    }
}

/// Everything is at hand and costs nothing.
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
