//! Settings of the filters. The defaults are the same for all scenes.

/// Filter of indirect light, with the names of `--filter`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum FilterKind {
    /// No filter.
    None,
    /// Guided image filter (`bauszat2011` 3.3).
    Guided,
    /// Guided image filter with noise-scaled epsilon at two radii, and a finer cross-bilateral one.
    #[default]
    Nested,
    /// Cross-bilateral filter.
    Bilateral,
    /// A-trous wavelets (`dammertz2010`).
    Atrous,
}

/// How to filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The filter.
    pub kind: FilterKind,
    /// Radius of windows, pixels. `None` takes it from the number of samples, 32 for one and 24
    /// for 16 and more. The nested filter and a-trous have their own.
    pub radius: Option<usize>,
    /// Epsilon of normals that are scaled to [0, 1] (`bauszat2011` 3.3, equation 7).
    pub epsilon_normal: f32,
    /// Epsilon of depth and of the other guides.
    pub epsilon_depth: f32,
    /// Whether epsilon is replaced by the share of noise in the mean of each window. The nested
    /// filter always does this.
    pub is_noise_scaled: bool,
    /// Epsilon of normals of a window whose mean has a variance of its own square, where epsilon is
    /// scaled by noise: the ridge of a regression is the variance of the noise over that of the
    /// slopes. A quarter stands for slopes of twice the mean light over the range of normals.
    pub noise_normal: f32,
    /// The same for depth, whose range in a window is a small part of the range of the scene.
    pub noise_depth: f32,
    /// The same for occlusion.
    pub noise_occlusion: f32,
    /// Whether normals are filtered first where they are off by 5 degrees and more, as those of raw
    /// scans are.
    pub cleans_guides: bool,
    /// Standard deviation of normals below which cross-bilateral weights and those of a-trous are
    /// high. In the unit of the guides, which is half the unit of normals.
    pub sigma_normal: f32,
    /// The same for the distance in depth from the plane through the pixel, and for occlusion.
    pub sigma_depth: f32,
    /// Standard deviation of colour over the mean of the picture for the weights of a-trous;
    /// infinite for none.
    pub sigma_colour: f32,
    /// Passes of a-trous.
    pub iterations: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            kind: FilterKind::Nested,
            radius: None,
            epsilon_normal: 0.01,
            epsilon_depth: 0.02,
            is_noise_scaled: false,
            noise_normal: 0.25,
            noise_depth: 0.0025,
            noise_occlusion: 0.25,
            cleans_guides: true,
            sigma_normal: 0.1,
            sigma_depth: 0.003,
            sigma_colour: f32::INFINITY,
            iterations: 4,
        }
    }
}

impl Settings {
    /// Default settings of a filter. The guided filter is that of `bauszat2011`, which has no
    /// extension.
    pub fn of(kind: FilterKind) -> Self {
        let radius = (kind == FilterKind::Bilateral).then_some(24);
        Self { kind, radius, cleans_guides: kind != FilterKind::Guided, ..Self::default() }
    }

    /// Radius of windows for a number of samples a pixel: noise falls with samples, so that smaller
    /// windows suffice. `bauszat2011` takes 24 to 32 pixels.
    pub fn radius(&self, samples: u32) -> usize {
        let shrunk = 32.0 * f64::from(samples.max(1)).powf(-0.1);
        self.radius.unwrap_or(shrunk.round().clamp(24.0, 32.0) as usize)
    }
}
