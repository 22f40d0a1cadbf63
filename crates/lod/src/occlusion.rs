//! Interface of occlusion tests, and the test of loaders for what a view may show.

use crate::frustum::Frustum;
use crate::oriented_box::OrientedBox;
use crate::view::View;
use std::sync::Arc;

/// Tests boxes for occlusion.
pub trait Occlusion: Send + Sync {
    /// Whether nothing inside of the box can be seen. False if that is not certain.
    fn hides(&self, contour: &OrientedBox) -> bool;
}

/// Hides what any of its members hides.
impl Occlusion for Vec<Arc<dyn Occlusion>> {
    fn hides(&self, contour: &OrientedBox) -> bool {
        self.iter().any(|o| o.hides(contour))
    }
}

/// What a view may show: the test that loader threads repeat before they read (kanzok2015, section
/// 3.2.3). Cheap to copy.
#[derive(Clone)]
pub struct Visible {
    frustum: Frustum,
    occlusion: Option<Arc<dyn Occlusion>>,
}

impl Visible {
    /// Test for `view`, without the boxes that `occlusion` hides.
    pub fn new(view: &View, occlusion: Option<Arc<dyn Occlusion>>) -> Self {
        Self { frustum: Frustum::of(view), occlusion }
    }

    /// Whether some point of the box may be seen; never false if one is.
    pub fn may_show(&self, b: &OrientedBox) -> bool {
        self.frustum.touches(b) && !self.occlusion.as_ref().is_some_and(|o| o.hides(b))
    }
}

impl std::fmt::Debug for Visible {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Visible").field("frustum", &self.frustum).finish_non_exhaustive()
    }
}
