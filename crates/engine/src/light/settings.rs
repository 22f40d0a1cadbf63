//! Settings of lit pictures: lights, numbers of rays, filter and exposure. Plain data that command
//! lines and the window change, and sessions compare. Albedo is the colours of the picture.

#[cfg(feature = "light")]
pub use crate::light::document::Lights;
use std::path::PathBuf;

/// Lights of a program that was built without them.
#[cfg(not(feature = "light"))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lights;

/// How a picture is lit.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSettings {
    /// The lights; none for the sun in the south-west and a clear sky.
    pub lights: Option<Lights>,
    /// Rays through a pixel, at least 1.
    pub samples: u32,
    /// Times that light is reflected between surfaces before it reaches the seen one; 0 for direct
    /// light alone.
    pub bounces: u32,
    /// Rays to each light of finite size for each ray through a pixel, at least 1.
    pub shadow_samples: u32,
    /// Filter of indirect light.
    pub filter: FilterName,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Factor from light to the picture, where 1 is white; chosen by the picture if there is none.
    pub exposure: Option<f64>,
    /// Files of triangle meshes that stand in the scan, in its coordinates.
    pub meshes: Vec<PathBuf>,
}

impl Default for LightSettings {
    fn default() -> Self {
        Self {
            lights: None,
            samples: 4,
            bounces: 1,
            shadow_samples: 4,
            filter: FilterName::Nested,
            seed: 0,
            exposure: None,
            meshes: Vec::new(),
        }
    }
}

/// Filter of indirect light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterName {
    /// The guided image filter of the paper (`bauszat2011`, 3.3).
    Guided,
    /// Guided filters of two radii, mixed by their agreement.
    Nested,
    /// Cross-bilateral filter.
    Bilateral,
    /// A-trous wavelet filter.
    Atrous,
    /// No filter.
    None,
}

/// Each filter with its name and a description, in the order of help texts.
pub const FILTERS: [(FilterName, &str, &str); 5] = [
    (FilterName::Guided, "guided", "Guided image filter by normals and depth"),
    (FilterName::Nested, "nested", "Guided filters of two radii, mixed where they agree"),
    (FilterName::Bilateral, "bilateral", "Cross-bilateral filter, for comparison"),
    (FilterName::Atrous, "atrous", "A-trous wavelet filter, for comparison"),
    (FilterName::None, "none", "No filter: unbiased, and noisy"),
];

/// The filter called `name`, if there is one.
pub fn filter_of_name(name: &str) -> Option<FilterName> {
    FILTERS.iter().find(|(_, own, _)| *own == name).map(|&(filter, ..)| filter)
}

impl FilterName {
    /// Name of the filter.
    pub fn name(self) -> &'static str {
        FILTERS.iter().find(|(own, ..)| *own == self).map_or("none", |(_, name, _)| name)
    }
}
