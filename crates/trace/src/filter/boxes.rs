//! Means over square windows of any number of values a pixel, for windows clipped at the border and
//! pixels that are left out. Sums run in 64 bits along rows, then along columns.

use rayon::prelude::*;

/// Where windows lie.
#[derive(Clone, Copy)]
pub(crate) struct Boxes<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// One where a pixel counts, else zero.
    pub mask: &'a [f32],
    /// Pixels from the centre of a window to its border.
    pub radius: usize,
}

impl Boxes<'_> {
    /// Means of the values of the pixels that count, and their number; zero where there are none.
    pub fn means<const N: usize>(
        &self,
        value: impl Fn(usize) -> [f64; N] + Sync,
    ) -> Vec<([f64; N], f64)> {
        let width = self.width.max(1);
        let mut sums = vec![([0.0; N], 0.0); self.mask.len()];
        sums.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            let at = |x: usize| {
                let (i, mask) = (y * width + x, self.mask[y * width + x]);
                (if mask == 0.0 { [0.0; N] } else { value(i) }, f64::from(mask))
            };
            let mut sum = ([0.0; N], 0.0);
            (0..self.radius.min(width)).for_each(|x| add(&mut sum, at(x), 1.0));
            for (x, out) in out.iter_mut().enumerate() {
                if x + self.radius < width {
                    add(&mut sum, at(x + self.radius), 1.0);
                }
                if x > self.radius {
                    add(&mut sum, at(x - self.radius - 1), -1.0);
                }
                *out = sum;
            }
        });
        let mut means = vec![([0.0; N], 0.0); self.mask.len()];
        // The bands do not depend on the number of threads, hence the sums do not.
        let band = (4 * self.radius).max(64);
        means.par_chunks_mut(width * band).enumerate().for_each(|(b, out)| {
            self.mean_band(&sums, b * band, out);
        });
        means
    }

    /// Means of a band of rows from `top` on, from the sums along rows.
    fn mean_band<const N: usize>(
        &self,
        sums: &[([f64; N], f64)],
        top: usize,
        out: &mut [([f64; N], f64)],
    ) {
        let (width, height) = (self.width, sums.len() / self.width);
        let row = |y: usize| &sums[y * width..(y + 1) * width];
        let mut columns = vec![([0.0; N], 0.0); width];
        let add_row = |columns: &mut Vec<_>, y: usize, sign: f64| {
            columns.iter_mut().zip(row(y)).for_each(|(column, &sum)| add(column, sum, sign));
        };
        for y in top.saturating_sub(self.radius + 1)..(top + self.radius).min(height) {
            add_row(&mut columns, y, 1.0);
        }
        for (y, out) in (top..).zip(out.chunks_mut(width)) {
            if y + self.radius < height {
                add_row(&mut columns, y + self.radius, 1.0);
            }
            if y > self.radius {
                add_row(&mut columns, y - self.radius - 1, -1.0);
            }
            for (out, &(sum, count)) in out.iter_mut().zip(&columns) {
                *out = (sum.map(|sum| if count > 0.5 { sum / count } else { 0.0 }), count);
            }
        }
    }
}

/// Adds `value` times `sign` to a sum.
fn add<const N: usize>(sum: &mut ([f64; N], f64), value: ([f64; N], f64), sign: f64) {
    for (sum, value) in sum.0.iter_mut().zip(value.0) {
        *sum += sign * value;
    }
    sum.1 += sign * value.1;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_equal_those_of_each_window() {
        for (width, height, radius) in [(9, 300, 3), (1, 1, 4), (40, 7, 60), (5, 90, 0)] {
            let value = |i: usize| (i * 37 % 101) as f64;
            let mask: Vec<f32> =
                (0..width * height).map(|i| f32::from(u8::from(i % 7 != 3))).collect();
            let boxes = Boxes { width, mask: &mask, radius };
            let means = boxes.means(|i| [value(i)]);
            for (i, &([mean], count)) in means.iter().enumerate() {
                let near = |c: usize, d: usize| c.abs_diff(d) <= radius;
                let pixels: Vec<usize> = (0..width * height)
                    .filter(|&j| near(i % width, j % width) && near(i / width, j / width))
                    .filter(|&j| mask[j] != 0.0)
                    .collect();
                let sum: f64 = pixels.iter().map(|&j| value(j)).sum();
                let expected = sum / pixels.len().max(1) as f64;
                assert_eq!(count, pixels.len() as f64);
                assert!((mean - expected).abs() < 1e-12 * expected.max(1.0), "{mean} {expected}");
            }
        }
    }
}
