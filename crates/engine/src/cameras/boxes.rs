//! Boxes around the points that a picture shows: what cameras are fitted to, and what the depths of
//! parallel views are chosen for. Pictures of whole files and sessions that stream have the same
//! boxes, so that the same camera gives the same view, to the bit.

use crate::calls::info;
use crate::cameras::places::fitted_bounds;
use anyhow::Result;
use esker_format::{Forest, ForestFilter};
use esker_points::Filter;

/// Boxes of the points of a file that are shown, on the metric lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boxes {
    /// Box of all points within the box and the clips of the filter.
    pub all: [[f64; 3]; 2],
    /// Box that cameras without an eye are fitted to: a few points that lie far from all others may
    /// be outside.
    pub fitted: [[f64; 3]; 2],
}

impl Boxes {
    /// The same box for all purposes.
    pub fn equal(bounds: [[f64; 3]; 2]) -> Self {
        Self { all: bounds, fitted: bounds }
    }

    /// Boxes of the points that `shown`, the filter `filter` without the clouds `hidden`, accepts.
    ///
    /// # Errors
    /// If a node cannot be read.
    pub fn of(
        file: &Forest,
        filter: &Filter,
        hidden: &[usize],
        shown: &ForestFilter,
    ) -> Result<Self> {
        let all = Self::all(file, filter, hidden);
        Ok(Self { all, fitted: fitted_bounds(file, all, shown)? })
    }

    /// Box of all points of the clouds that are not `hidden`, within the box and the clips of the
    /// filter; all of their box if these have nothing in common. Reads nothing.
    pub fn all(file: &Forest, filter: &Filter, hidden: &[usize]) -> [[f64; 3]; 2] {
        let [low, high] = info::bounds_without(file, hidden);
        let wanted = filter.extent(file.lattice());
        let [min, max] = [wanted.min, wanted.max].map(|corner| file.lattice().measure(corner));
        let least = [0, 1, 2].map(|i| low[i].max(min[i]));
        let greatest = [0, 1, 2].map(|i| high[i].min(max[i]));
        if (0..3).all(|i| least[i] <= greatest[i]) { [least, greatest] } else { [low, high] }
    }
}
