//! Filters of indirect light on the GPU. In: light and guides of the pixels. Out: the filtered
//! light. Twins: the files of `src/filter` of the same names.

mod bands;
mod boxes;
mod choice;
mod converge;
mod guided;
mod nested;
mod plan;
mod taps;

pub(crate) use choice::GuideNoise;
pub use choice::{LightFilter, PreparedGuides};
pub use guided::{Guided, GuidedSettings};
pub use plan::FilterPlan;

use crate::gpu::Pixels;

/// What a filter reads and writes: pictures of one size.
#[derive(Clone, Copy, Debug)]
pub struct FilterPictures<'a> {
    /// Normal (0 to 1) and depth over a constant of the scene.
    pub guides: &'a Pixels,
    /// Light, and 1 where there is a surface, else 0.
    pub light: &'a Pixels,
    /// Filtered light.
    pub out: &'a Pixels,
}
