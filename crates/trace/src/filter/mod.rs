//! Filters of indirect light under the guidance of normals and depth: the guided image filter of
//! `bauszat2011` 3.3, its extensions, and the filters that it is compared with. In: a noisy image
//! and the guides of its pixels. Out: the filtered image, of the same mean.

mod guided;
mod guides;
mod input;
mod moments;
mod settings;
mod solve;
mod windows;

pub use guides::{GuideKind, Guides};
pub use settings::{FilterKind, Settings};

use crate::Image;
use guided::{Ridges, regress};
use input::Input;

/// Filters incident indirect light. `samples` is the number of samples a pixel of `noisy`. Pixels
/// that hit nothing or hold values that are not finite are left out of all windows and keep their
/// value, or become zero where it is not finite.
pub fn filter(noisy: &Image<3>, guides: &Guides, samples: u32, settings: &Settings) -> Image<3> {
    let input = Input::new(noisy, guides);
    let radius = settings.radius(samples);
    let mut filtered = match settings.kind {
        FilterKind::None => noisy.clone(),
        _ => image(&input, regress(&input, radius, &ridges(guides, settings))),
    };
    input.pass_misses(noisy, &mut filtered);
    filtered
}

/// Number of pixels with a hit that [`filter`] leaves out because a value is not finite.
pub fn invalid_pixels(noisy: &Image<3>, guides: &Guides) -> usize {
    Input::new(noisy, guides).invalid
}

/// Epsilon of each guide.
fn ridges(guides: &Guides, settings: &Settings) -> Ridges {
    let epsilon = |kind: &GuideKind| match kind {
        GuideKind::Normal => f64::from(settings.epsilon_normal),
        GuideKind::Depth | GuideKind::Occlusion => f64::from(settings.epsilon_depth),
    };
    let epsilon: Vec<f64> = guides.kinds.iter().map(epsilon).collect();
    Ridges { noise: vec![0.0; epsilon.len()], epsilon }
}

/// The first three planes as an image.
fn image(input: &Input<'_>, mut planes: Vec<Vec<f32>>) -> Image<3> {
    planes.truncate(3);
    let planes = planes.try_into().unwrap_or_default();
    Image { width: input.width, height: input.height, planes }
}
