//! Windows of eight pixels of a row with their neighbours. Beyond its border the picture is
//! continued with its border pixels.

use crate::simd::values::{EIGHT, load};
use fearless_simd::{Simd, f32x8};

/// `R` rows of an image around row `y`.
#[inline(always)]
pub fn rows_around<T, const R: usize>(image: &[T], width: usize, y: usize) -> [&[T]; R] {
    let last = image.len() / width - 1;
    std::array::from_fn(|i| {
        let y = (y + i).saturating_sub(R / 2).min(last);
        &image[y * width..(y + 1) * width]
    })
}

/// Eight pixels of each row from column `x` on, with `(N - 8) / 2` neighbours on either side.
/// `space` is filled for windows that cross the border.
#[inline(always)]
pub fn windows<'a, T: Copy, const R: usize, const N: usize>(
    rows: [&'a [T]; R],
    x: usize,
    space: &'a mut [[T; N]; R],
) -> [&'a [T; N]; R] {
    let beside = (N - EIGHT) / 2;
    if let Some(first) = x.checked_sub(beside)
        && rows.iter().all(|row| first + N <= row.len())
    {
        let never = &space[0];
        return rows.map(|row| row[first..].first_chunk().unwrap_or(never));
    }
    for (space, row) in space.iter_mut().zip(rows) {
        *space = std::array::from_fn(|i| row[(x + i).saturating_sub(beside).min(row.len() - 1)]);
    }
    space.each_ref()
}

/// Eight pixels of a window from index `from` on.
#[inline(always)]
pub fn eight<S: Simd, const N: usize>(simd: S, window: &[f32; N], from: usize) -> f32x8<S> {
    load(simd, window[from..].first_chunk().unwrap_or(&[0.0; EIGHT]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_go_on_as_at_the_border() {
        for [width, height] in [[1, 1], [5, 3], [8, 2], [31, 4]] {
            let image: Vec<f32> = (0..width * height).map(|i| i as f32).collect();
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let mut space = [[0.0; EIGHT + 4]; 5];
                let seen = windows(rows_around(&image, width, y), x, &mut space);
                for (i, row) in seen.into_iter().enumerate() {
                    let y = (y + i).saturating_sub(2).min(height - 1);
                    for (k, value) in row.iter().enumerate() {
                        let x = (x + k).saturating_sub(2).min(width - 1);
                        assert_eq!(*value, image[y * width + x]);
                    }
                }
            }
        }
    }
}
