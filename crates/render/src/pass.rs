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
