//! The plan of a frame: which passes it takes, from what the scene has and the view asks (DESIGN section 8).
//! What a scene does not need is left out: without normals no normal is read, carried or tested. Both
//! renderers follow it.

use crate::frame::{Frame, Method, Stages};

/// A pass, or passes that are timed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pass {
    /// Points to single pixels.
    Project,
    /// Attributes of the pixels won, to the pyramid.
    Gather,
    /// Averaging upwards.
    Pull,
    /// Filling downwards.
    Push,
    /// Closing gaps and trimming outlines.
    Mend,
    /// Lighting and encoding.
    Shade,
    /// Antialiasing.
    Soften,
    /// Attributes of the pixels won, straight to the picture.
    Resolve,
}

/// What a frame takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FramePlan {
    /// Its passes in their order.
    pub passes: &'static [Pass],
    /// Whether pixels carry normals on their way to the picture.
    pub carries_normals: bool,
    /// Whether points are dropped by their normals while projecting.
    pub culls_back_faces: bool,
}

impl FramePlan {
    /// The plan of a frame, wherever its planes lie.
    pub fn new<P>(frame: &Frame<'_, P>) -> Self {
        use Pass::{Gather, Mend, Project, Pull, Push, Resolve, Shade, Soften};
        let has_normals = frame.draws.iter().any(|d| d.normal.is_some());
        let passes: &[Pass] = match frame.method {
            Method::Points => &[Project, Resolve],
            Method::PullPush => &[Project, Gather, Pull, Push, Mend, Shade, Soften],
        };
        Self {
            passes,
            carries_normals: has_normals && frame.method == Method::PullPush,
            culls_back_faces: has_normals && frame.cull_back_faces,
        }
    }
}

impl Stages {
    /// Adds to the time of a pass. The total is not touched.
    pub fn add(&mut self, pass: Pass, ms: f64) {
        *match pass {
            Pass::Project => &mut self.project_ms,
            Pass::Gather => &mut self.gather_ms,
            Pass::Pull => &mut self.pull_ms,
            Pass::Push => &mut self.push_ms,
            Pass::Mend => &mut self.mend_ms,
            Pass::Shade | Pass::Resolve => &mut self.shade_ms,
            Pass::Soften => &mut self.soften_ms,
        } += ms;
    }
}
