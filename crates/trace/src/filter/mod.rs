//! Filters of indirect light under the guidance of normals and depth: the guided image filter of
//! `bauszat2011` 3.3, its extensions, and the filters that it is compared with. In: a noisy image
//! and the guides of its pixels. Out: the filtered image, of the same mean.

mod atrous;
mod bilateral;
mod boxes;
pub(crate) mod clean;
pub(crate) mod converge;
mod guided;
mod guides;
mod input;
mod moments;
pub(crate) mod nested;
mod settings;
mod solve;
mod taps;
mod windows;

pub use converge::Halves;
pub use guides::{GuideKind, Guides};
pub use settings::{FilterKind, Settings};

use crate::Image;
pub use guided::Workspace;
use guided::{Ridges, regress};
use input::Input;

/// Filters incident indirect light. `samples` is the number of samples a pixel of `noisy`. Pixels
/// that hit nothing or hold values that are not finite are left out of all windows and keep their
/// value, or become zero where it is not finite.
pub fn filter(noisy: &Image<3>, guides: &Guides, samples: u32, settings: &Settings) -> Image<3> {
    filter_in(&mut Workspace::default(), noisy, guides, samples, settings)
}

/// [`filter`] in memory of an earlier picture.
pub fn filter_in(
    workspace: &mut Workspace,
    noisy: &Image<3>,
    guides: &Guides,
    samples: u32,
    settings: &Settings,
) -> Image<3> {
    if settings.kind == FilterKind::None || noisy.is_empty() {
        return noisy.clone();
    }
    let kinds = &guides.kinds[..];
    let mut input = Input::new(noisy, guides);
    if settings.cleans_guides {
        clean::clean(&mut input, kinds);
    }
    let radius = settings.radius(samples);
    let planes = match settings.kind {
        FilterKind::Nested => {
            let ridges = noise_scaled(&input, kinds, settings);
            nested::nested(&input, kinds, &ridges, settings, workspace)
        }
        FilterKind::Bilateral => {
            bilateral::bilateral::<3, false>(&input, input.colours(), kinds, radius, settings)
                .into()
        }
        FilterKind::Atrous => atrous::atrous(&input, kinds, settings),
        FilterKind::Guided | FilterKind::None if settings.is_noise_scaled => {
            regress(&input, radius, &noise_scaled(&input, kinds, settings), workspace)
        }
        FilterKind::Guided | FilterKind::None => {
            regress(&input, radius, &constant(kinds, settings), workspace)
        }
    };
    let mut filtered = image(&input, planes);
    input.pass_misses(noisy, &mut filtered);
    filtered
}

/// Number of pixels with a hit that [`filter`] leaves out because a value is not finite.
pub fn invalid_pixels(noisy: &Image<3>, guides: &Guides) -> usize {
    Input::new(noisy, guides).invalid
}

/// How far normals are off those of a smooth surface, degrees: an estimate that edges and curvature
/// hardly change. From 5 degrees on, normals are filtered before they guide.
pub fn normal_noise_degrees(guides: &Guides) -> f64 {
    // Guides have half the unit of normals.
    let empty = Image::new(guides.width, guides.height);
    let input = Input::new(&empty, guides);
    (2.0 * clean::normal_noise(&input, &guides.kinds)).to_degrees()
}

/// Constant epsilon of each guide.
fn constant(kinds: &[GuideKind], settings: &Settings) -> Ridges {
    let epsilon = kinds.iter().map(|kind| match kind {
        GuideKind::Normal => f64::from(settings.epsilon_normal),
        GuideKind::Depth | GuideKind::Occlusion => f64::from(settings.epsilon_depth),
    });
    Ridges { epsilon: epsilon.collect(), noise: vec![0.0; kinds.len()] }
}

/// Epsilon by the noise of each window, and by the noise of normals.
fn noise_scaled(input: &Input<'_>, kinds: &[GuideKind], settings: &Settings) -> Ridges {
    let noise = kinds.iter().map(|kind| match kind {
        GuideKind::Normal => f64::from(settings.noise_normal),
        GuideKind::Depth => f64::from(settings.noise_depth),
        GuideKind::Occlusion => f64::from(settings.noise_occlusion),
    });
    let variance = clean::normal_noise(input, kinds).powi(2) * clean::COMPONENT_SHARE;
    let epsilon = kinds.iter().map(|kind| match kind {
        GuideKind::Normal => variance,
        GuideKind::Depth | GuideKind::Occlusion => 0.0,
    });
    Ridges { epsilon: epsilon.collect(), noise: noise.collect() }
}

/// The first three planes as an image.
fn image(input: &Input<'_>, mut planes: Vec<Vec<f32>>) -> Image<3> {
    planes.truncate(3);
    let planes = planes.try_into().unwrap_or_default();
    Image { width: input.width, height: input.height, planes }
}
