//! Glossy reflection above the Lambert term.

/// A glossy coat of all surfaces: a GGX lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// Share of light that is reflected at normal incidence, 0 to 1; 0.04 for plastic and varnish.
    pub reflectance: f32,
    /// Roughness, 0.05 (polished) to 1; the width of the lobe is its square (Burley 2012).
    pub roughness: f32,
}
