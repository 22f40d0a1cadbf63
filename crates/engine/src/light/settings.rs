//! Settings of lit pictures: lights, numbers of rays, filter and exposure. Plain data that command
//! lines and the window change, and sessions compare. Albedo is the colours of the picture.

#[cfg(feature = "light")]
pub use crate::light::document::Lights;
use esker_points::Lattice;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

/// Numbers of rays through a pixel.
pub const SAMPLES: RangeInclusive<i64> = 1..=65_536;
/// Numbers of reflections.
pub const BOUNCES: RangeInclusive<i64> = 0..=64;
/// Numbers of rays to a light of finite size.
pub const SHADOW_SAMPLES: RangeInclusive<i64> = 1..=1024;

/// Lights of a program that was built without them.
#[cfg(not(feature = "light"))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lights;

/// Samples a pixel of a finished picture of a session. The error of filtered light hardly falls
/// beyond.
pub const SAMPLES_FINAL: u32 = 64;

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
    /// Whether the shadows of lights of finite size are filtered too; those of glossy surfaces are
    /// not.
    pub filters_shadows: bool,
    /// Gloss of all surfaces; none for matte ones.
    pub gloss: Option<Gloss>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Factor from light to the picture, where 1 is white; chosen by the picture if there is none.
    pub exposure: Option<f64>,
    /// Files of triangle meshes that stand in the scan, in its coordinates.
    pub meshes: Vec<PathBuf>,
    /// Units of length per unit of the scan's coordinates, in which lights and meshes have their
    /// places; what draws the scan sets them.
    pub factor: [f64; 3],
}

impl LightSettings {
    /// The settings for a scan with this lattice.
    #[must_use]
    pub fn measured(self, lattice: &Lattice) -> Self {
        Self { factor: lattice.factor, ..self }
    }
}

impl Default for LightSettings {
    fn default() -> Self {
        Self {
            lights: None,
            samples: 4,
            bounces: 1,
            shadow_samples: 4,
            filter: FilterName::Nested,
            filters_shadows: false,
            gloss: None,
            seed: 0,
            exposure: None,
            meshes: Vec::new(),
            factor: [1.0; 3],
        }
    }
}

/// Gloss of surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// Share of light that surfaces mirror at right angles, 0 to 1.
    pub reflectance: f32,
    /// Roughness, 0.05 (polished) to 1.
    pub roughness: f32,
}

impl Default for Gloss {
    /// Varnish that is a little worn.
    fn default() -> Self {
        Self { reflectance: 0.04, roughness: 0.3 }
    }
}

impl FromStr for Gloss {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let values: Option<Vec<f32>> =
            text.split(',').map(|word| word.trim().parse().ok()).collect();
        let default = Self::default();
        let gloss = match values.as_deref() {
            Some(&[reflectance]) => Self { reflectance, ..default },
            Some(&[reflectance, roughness]) => Self { reflectance, roughness },
            _ => return Err(format!("`{text}` is not {GLOSS_FORM}")),
        };
        let is_within = (0.0..=1.0).contains(&gloss.reflectance)
            && (ROUGHNESS_MIN..=1.0).contains(&gloss.roughness);
        if is_within { Ok(gloss) } else { Err(format!("`{text}` is not {GLOSS_FORM}")) }
    }
}

/// Least roughness.
pub const ROUGHNESS_MIN: f32 = 0.05;
const GLOSS_FORM: &str =
    "REFLECTANCE[,ROUGHNESS], 0 to 1 and 0.05 to 1, such as 0.04,0.3 for worn varnish";

/// Filter of indirect light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterName {
    /// The guided image filter of the paper (`bauszat2011`, 3.3).
    Guided,
    /// Guided filters of two radii and a finer cross-bilateral one, each by the light that it adds.
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
    (
        FilterName::Nested,
        "nested",
        "Guided filters of two radii, and a finer one where light exceeds noise",
    ),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gloss_is_parsed_and_an_error_shows_its_form() {
        assert_eq!("0.04".parse(), Ok(Gloss::default()));
        assert_eq!("0.5, 0.05".parse(), Ok(Gloss { reflectance: 0.5, roughness: 0.05 }));
        for text in ["", "shiny", "2", "-0.1", "nan", "0.5,0.01", "0.5,nan", "0.1,0.2,0.3"] {
            let fault = text.parse::<Gloss>().unwrap_err();
            assert!(fault.contains("REFLECTANCE[,ROUGHNESS]"), "{text}: {fault}");
        }
    }
}
