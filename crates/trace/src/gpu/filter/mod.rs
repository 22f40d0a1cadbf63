//! Filters of indirect light on the GPU. In: light and guides of the pixels. Out: the filtered
//! light. Twins: the files of `src/filter` of the same names.

mod bands;
mod guided;

pub use guided::{FilterPictures, Guided, GuidedPlan, GuidedSettings};
