//! State of a lit picture of a session, for the window.

/// State of a lit picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LitStatus {
    /// Samples a pixel that the picture has; 0 for a coarse one.
    pub samples: u32,
    /// Samples a pixel of a finished picture.
    pub samples_final: u32,
    /// Splats of the scene.
    pub splats: usize,
    /// Most splats within the memory budget.
    pub splats_max: u64,
    /// Whether that bound keeps points out of the scene.
    pub is_bounded: bool,
    /// Whether the memory budget holds no pictures of the requested size.
    pub is_smaller: bool,
    /// Whether the points have no normals, so that each is lit as if it faced the ray.
    pub lacks_normals: bool,
    /// Bytes of the scene and of the samples.
    pub bytes: usize,
    /// Factor from light to the picture.
    pub exposure: f64,
}
