//! Input of the filters: planes of guides and of the picture with zeros where a pixel is left out,
//! and a mask of the pixels that count. Planes are borrowed where all pixels count.

use super::Guides;
use crate::Image;
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;
use std::borrow::Cow;

/// Greatest radiance that counts: above any light, and low enough that no sum or coefficient
/// overflows 32-bit floats. Also refuses NaN.
pub(crate) const VALUE_MAX: f32 = 1e18;
/// Greatest guide that counts. Guides are of the order of one.
const GUIDE_MAX: f32 = 1e4;

/// Planes ready to be summed.
pub(crate) struct Input<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Guides, zero where a pixel is left out.
    pub guides: Vec<Cow<'a, [f32]>>,
    /// Picture, zero where a pixel is left out.
    pub signals: Vec<Cow<'a, [f32]>>,
    /// One where a pixel counts, else zero.
    pub mask: Cow<'a, [f32]>,
    /// Number of pixels with a hit but with values that are not finite or beyond any light.
    pub invalid: usize,
}

impl<'a> Input<'a> {
    /// Prepares a picture and its guides. Planes that are shorter than the picture count as misses
    /// where they end.
    pub fn new(noisy: &'a Image<3>, guides: &'a Guides) -> Self {
        let (width, height) = (noisy.width, noisy.height);
        let len = width * height;
        let mut mask = vec![0.0; len];
        let row = width.max(1);
        let rows = mask
            .par_chunks_mut(row)
            .enumerate()
            .map(|(y, mask)| dispatch!(Level::new(), _ => mark_row(noisy, guides, y * row, mask)));
        let [hits, valid] = rows.reduce(|| [0; 2], |[a, b], [c, d]| [a + c, b + d]);
        let masked = |plane: &'a Vec<f32>| -> Cow<'a, [f32]> {
            if valid == len && plane.len() >= len {
                return Cow::Borrowed(&plane[..len]);
            }
            let values = plane.par_iter().zip(&mask);
            Cow::Owned(values.map(|(&v, &m)| if m != 0.0 { v } else { 0.0 }).collect())
        };
        let signals = noisy.planes.iter().map(masked).collect();
        let guides = guides.planes.iter().map(masked).collect();
        Self { width, height, guides, signals, mask: Cow::Owned(mask), invalid: hits - valid }
    }

    /// The same input with one more signal, which is zero where a pixel is left out.
    pub fn with_signal<'b>(&'b self, signal: &'b [f32]) -> Input<'b> {
        let signals = self.signals.iter().map(AsRef::as_ref).chain([signal]);
        Input {
            width: self.width,
            height: self.height,
            guides: self.guides.iter().map(|plane| Cow::Borrowed(plane.as_ref())).collect(),
            signals: signals.map(Cow::Borrowed).collect(),
            mask: Cow::Borrowed(self.mask.as_ref()),
            invalid: self.invalid,
        }
    }

    /// The first three signals.
    pub fn colours(&self) -> [&[f32]; 3] {
        [0, 1, 2].map(|c| &*self.signals[c])
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Puts the values of the picture back where pixels were left out; zero if not finite.
    pub fn pass_misses(&self, noisy: &Image<3>, filtered: &mut Image<3>) {
        for (from, to) in noisy.planes.iter().zip(&mut filtered.planes) {
            for ((to, &from), _) in
                to.iter_mut().zip(from).zip(&*self.mask).filter(|&(_, &mask)| mask == 0.0)
            {
                *to = if from.is_finite() { from } else { 0.0 };
            }
        }
    }
}

/// Marks the pixels of a row that count. Returns the number of hits, and of those that count.
#[inline(always)]
fn mark_row(noisy: &Image<3>, guides: &Guides, start: usize, mask: &mut [f32]) -> [usize; 2] {
    let end = start + mask.len();
    let hits = guides.is_hit.get(start..end).unwrap_or(&[]);
    for (mask, &is_hit) in mask.iter_mut().zip(hits) {
        *mask = f32::from(u8::from(is_hit));
    }
    let hits = mask.iter().sum::<f32>();
    let limits = [(&noisy.planes[..], VALUE_MAX), (&guides.planes[..], GUIDE_MAX)];
    for (planes, limit) in limits {
        for plane in planes {
            let Some(row) = plane.get(start..end) else {
                mask.fill(0.0);
                continue;
            };
            for (mask, value) in mask.iter_mut().zip(row) {
                *mask = if value.abs() <= limit { *mask } else { 0.0 };
            }
        }
    }
    // Exact: a row has fewer pixels than floats have whole numbers.
    [hits as usize, mask.iter().sum::<f32>() as usize]
}
