//! Names of the passes and the order in which a frame runs them. The head of the crate has a table
//! of their files, shaders and papers; [`crate::FramePlan`] chooses those that a frame runs.

/// A pass of the renderers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pass {
    /// Projects points to single pixels.
    Project,
    /// Parts the points of surfaces from those that are drawn as dots.
    Split,
    /// Fits planes to the depths of clouds without normals.
    FitPlanes,
    /// Gathers the attributes of visible points into level 0 of the pyramid.
    Gather,
    /// Averages the points that share a pixel.
    Average,
    /// Removes differences of exposure between scans.
    Exposure,
    /// Averages upwards in the pyramid.
    Pull,
    /// Fills pixels downwards in the pyramid.
    Push,
    /// Fills small holes through which a farther surface shows.
    FillHoles,
    /// Trims silhouettes back to the samples.
    Silhouette,
    /// Projects points to splats and sorts them into tiles of the picture.
    Place,
    /// Blends the splats of each tile: visibility, attributes, normalisation.
    Blend,
    /// Smooths the depths of clouds without normals, which shading derives normals from.
    SmoothDepth,
    /// Lights the surface and encodes its colours.
    Shade,
    /// Antialiases silhouettes and creases.
    Antialias,
    /// Draws points as dots of more than a pixel.
    Grow,
    /// Draws dots over a finished surface, where they are nearer.
    Overlay,
    /// Writes the colours of visible points straight to the picture.
    Resolve,
    /// Darkens what lies behind its surroundings.
    EyeDome,
}

impl Pass {
    /// All passes, in the order in which a frame runs them.
    pub const ALL: [Self; 19] = [
        Self::Project,
        Self::Split,
        Self::FitPlanes,
        Self::Gather,
        Self::Average,
        Self::Exposure,
        Self::Pull,
        Self::Push,
        Self::FillHoles,
        Self::Silhouette,
        Self::Place,
        Self::Blend,
        Self::SmoothDepth,
        Self::Shade,
        Self::Antialias,
        Self::Grow,
        Self::Overlay,
        Self::Resolve,
        Self::EyeDome,
    ];

    /// Whether frames are complete without the pass, though perhaps other ones.
    pub fn is_optional(self) -> bool {
        !matches!(
            self,
            Self::Project | Self::Gather | Self::Place | Self::Blend | Self::Shade | Self::Resolve
        )
    }

    /// Whether the pass of surfaces works on the depth image that push leaves.
    pub(crate) fn follows_push(self) -> bool {
        matches!(self, Self::FillHoles | Self::Silhouette | Self::SmoothDepth | Self::Shade)
    }

    /// Name of the pass, the same in shaders, JSON and documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::Project => "project",
            Self::Split => "split",
            Self::FitPlanes => "fit_planes",
            Self::Gather => "gather",
            Self::Average => "average",
            Self::Exposure => "exposure",
            Self::Pull => "pull",
            Self::Push => "push",
            Self::FillHoles => "fill_holes",
            Self::Silhouette => "silhouette",
            Self::Place => "place",
            Self::Blend => "blend",
            Self::SmoothDepth => "smooth_depth",
            Self::Shade => "shade",
            Self::Antialias => "antialias",
            Self::Grow => "grow",
            Self::Overlay => "overlay",
            Self::Resolve => "resolve",
            Self::EyeDome => "eye_dome",
        }
    }
}

/// A set of passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassSet(u32);

impl PassSet {
    /// The set of `passes`.
    pub const fn of(passes: &[Pass]) -> Self {
        let (mut bits, mut i) = (0, 0);
        while i < passes.len() {
            bits |= 1 << passes[i] as u32;
            i += 1;
        }
        Self(bits)
    }

    /// Whether the set has `pass`.
    pub const fn has(self, pass: Pass) -> bool {
        self.0 >> pass as u32 & 1 == 1
    }
}

/// Passes of a frame that are chosen otherwise than by its plan: for measurements and tests of what
/// passes change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassChoice {
    /// Passes that are left out, if they are optional. Pull goes with push, and split, grow and
    /// overlay go together among surfaces.
    pub skipped: PassSet,
    /// Passes that run although the plan knows that they change nothing.
    pub forced: PassSet,
}
