//! The guided filter in 64 bits, window by window, with covariances about the mean (`bauszat2011`,
//! equations 6 to 9): what the filter is compared with.

use esker_trace::Image;
use esker_trace::filter::Guides;

/// Filtered channels, and the mean light in the windows that cover a pixel, which errors are
/// relative to.
pub(super) struct Filtered {
    pub planes: [Vec<f64>; 3],
    pub light: Vec<f64>,
}

/// Filters a picture all of whose pixels see a surface, with one epsilon for all guides.
pub(super) fn guided(noisy: &Image<3>, guides: &Guides, radius: usize, epsilon: f64) -> Filtered {
    let (w, h, len) = (noisy.width, noisy.height, noisy.len());
    let span = |c: usize, length: usize| c.saturating_sub(radius)..(c + radius + 1).min(length);
    let mut out = Filtered { planes: [(); 3].map(|()| vec![0.0; len]), light: vec![0.0; len] };
    let mut counts = vec![0.0; len];
    for centre in 0..len {
        let pixels: Vec<usize> =
            span(centre / w, h).flat_map(|y| span(centre % w, w).map(move |x| y * w + x)).collect();
        let window = Window::new(guides, &pixels, epsilon);
        for (plane, sums) in noisy.planes.iter().zip(&mut out.planes) {
            let (mean, slopes) = window.fit(plane);
            for (i, own) in pixels.iter().zip(&window.offsets) {
                sums[*i] += mean + own.iter().zip(&slopes).map(|(g, s)| g * s).sum::<f64>();
            }
        }
        let light = |i: &usize| noisy.planes.iter().map(|plane| f64::from(plane[*i])).sum::<f64>();
        let light = pixels.iter().map(light).sum::<f64>() / (3 * pixels.len()) as f64;
        for &i in &pixels {
            out.light[i] += light;
            counts[i] += 1.0;
        }
    }
    for plane in out.planes.iter_mut().chain([&mut out.light]) {
        plane.iter_mut().zip(&counts).for_each(|(sum, count)| *sum /= count);
    }
    out
}

/// Guides of the pixels of a window.
struct Window<'a> {
    pixels: &'a [usize],
    /// Guides of each pixel less their means.
    offsets: Vec<Vec<f64>>,
    /// Covariance of the guides with epsilon on its diagonal.
    matrix: Vec<Vec<f64>>,
}

impl<'a> Window<'a> {
    fn new(guides: &Guides, pixels: &'a [usize], epsilon: f64) -> Self {
        let count = pixels.len() as f64;
        let mean =
            |plane: &Vec<f32>| pixels.iter().map(|&i| f64::from(plane[i])).sum::<f64>() / count;
        let means: Vec<f64> = guides.planes.iter().map(mean).collect();
        let offset = |&i: &usize| -> Vec<f64> {
            guides
                .planes
                .iter()
                .zip(&means)
                .map(|(plane, mean)| f64::from(plane[i]) - mean)
                .collect()
        };
        let offsets: Vec<Vec<f64>> = pixels.iter().map(offset).collect();
        let size = means.len();
        let covariance = |k: usize, l: usize| {
            let sum = offsets.iter().map(|own| own[k] * own[l]).sum::<f64>();
            sum / count + if k == l { epsilon } else { 0.0 }
        };
        let matrix = (0..size).map(|k| (0..size).map(|l| covariance(k, l)).collect()).collect();
        Self { pixels, offsets, matrix }
    }

    /// Mean of a plane, and its slopes along the guides.
    fn fit(&self, plane: &[f32]) -> (f64, Vec<f64>) {
        let count = self.pixels.len() as f64;
        let mean = self.pixels.iter().map(|&i| f64::from(plane[i])).sum::<f64>() / count;
        let right = |k: usize| {
            let pairs = self.pixels.iter().zip(&self.offsets);
            pairs.map(|(&i, own)| own[k] * (f64::from(plane[i]) - mean)).sum::<f64>() / count
        };
        (mean, solve(self.matrix.clone(), (0..self.matrix.len()).map(right).collect()))
    }
}

/// Solves a small system by elimination with pivots.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        let pivot = (i..n).max_by(|&p, &q| a[p][i].abs().total_cmp(&a[q][i].abs())).unwrap_or(i);
        a.swap(i, pivot);
        b.swap(i, pivot);
        for j in i + 1..n {
            let factor = a[j][i] / a[i][i];
            let row = a[i].clone();
            a[j].iter_mut().zip(&row).skip(i).for_each(|(to, from)| *to -= factor * from);
            b[j] -= factor * b[i];
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            b[i] -= a[i][j] * b[j];
        }
        b[i] /= a[i][i];
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_are_solved() {
        let a = vec![vec![0.0, 2.0, 1.0], vec![1.0, -1.0, 0.5], vec![3.0, 0.0, -2.0]];
        let x = [2.0, -1.0, 4.0];
        let b = a.iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect();
        let got = solve(a, b);
        assert!(got.iter().zip(x).all(|(got, x)| (got - x).abs() < 1e-12), "{got:?}");
    }
}
