//! The software depth buffer: what the nodes of a cut hide of a view (kanzok2015, sections 3.2.1 and
//! 3.2.2; DESIGN, section 7).

use crate::occlusion::Occlusion;
use crate::oriented_box::OrientedBox;
use crate::select::Drawn;
use crate::view::View;
use esker_points::{Lattice, NodeTable};

/// Depth of what certainly covers the view.
#[derive(Clone, Debug)]
pub struct SoftwareDepth;

impl SoftwareDepth {
    /// What `drawn` hides of `view`: resident nodes, for instance those of the last cut.
    pub fn new(_table: &NodeTable, _lattice: &Lattice, _view: &View, _drawn: &[Drawn]) -> Self {
        Self
    }
}

impl Occlusion for SoftwareDepth {
    fn hides(&self, _: &OrientedBox) -> bool {
        false
    }
}
