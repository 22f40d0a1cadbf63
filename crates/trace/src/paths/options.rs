//! Settings of the tracer. Those of the filter can change without a new trace.

use super::gloss::Gloss;
use super::sequence::Sequence;
use crate::filter::Settings;

/// How to trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Bounces of indirect light, as in table 1 of `bauszat2011`: with 1, light reaches the eye by
    /// at most one surface between the lights and the visible one. 0 leaves out indirect light, and
    /// the sky with it.
    pub bounces: u32,
    /// Shadow rays to each light of some extent, from each hit of an eye ray. Rounded up to a power
    /// of two, at most 64.
    pub shadow_samples: u32,
    /// How samples of neighbouring pixels relate.
    pub sequence: Sequence,
    /// Seed of all random numbers. The same seed gives the same picture.
    pub seed: u64,
    /// Filter of the indirect light.
    pub filter: Settings,
    /// Whether the filtered picture is mixed with the unfiltered one where samples suffice, so that
    /// it converges to it.
    pub converges: bool,
    /// Glossy reflection of all surfaces; `None` for matte ones.
    pub gloss: Option<Gloss>,
    /// Whether shadows of lights with some extent are filtered too. `bauszat2011` filters no direct
    /// light.
    pub filters_visibility: bool,
    /// Whether the sky is seen where nothing is hit; else such places are black.
    pub shows_sky: bool,
    /// Whether indirect light of the last picture is used again after a move of the camera.
    pub reprojects: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            bounces: 1,
            shadow_samples: 4,
            sequence: Sequence::default(),
            seed: 0,
            filter: Settings::default(),
            converges: true,
            gloss: None,
            filters_visibility: false,
            shows_sky: true,
            reprojects: true,
        }
    }
}

impl Options {
    /// Whether samples traced with `other` are those of these options too.
    pub(crate) fn keeps_samples_of(&self, other: &Self) -> bool {
        let same = |options: &Self| Self {
            filter: Settings::default(),
            converges: true,
            reprojects: true,
            ..options.clone()
        };
        same(self) == same(other)
    }

    /// Binary logarithm of the number of shadow rays.
    pub(crate) fn shadow_log2(&self) -> u32 {
        self.shadow_samples.clamp(1, 64).next_power_of_two().trailing_zeros()
    }
}
