//! Eye-dome lighting (`boucheny2009`, section 3): a pixel is the darker the farther it lies behind
//! the pixels around it. It needs depths only, and shows the shape of points without normals.

use crate::frame::Picture;
use crate::passes::project::EMPTY;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Offsets of the pixels around, to the right and down: a circle of 1.4 to 2 pixels.
pub(crate) const AROUND: [[i32; 2]; 8] =
    [[2, 0], [-2, 0], [0, 2], [0, -2], [1, 1], [1, -1], [-1, 1], [-1, -1]];
/// Darkening by a mean of one power of two in depth, at a strength of one, as a natural logarithm.
pub(crate) const DARKENING: f32 = 50.0;
/// Least brightness, so that outlines keep their colours.
pub(crate) const BRIGHTNESS_MIN: f32 = 0.15;

/// Darkens the colours of a picture by its depths, only at the pixels of `dots` if there are some.
/// Does not depend on the unit of depths.
pub(crate) fn eye_dome(picture: &mut Picture, strength: f32, dots: Option<&[AtomicU64]>) {
    let (width, height) = (picture.width as i32, picture.height as i32);
    let depth = &picture.depth;
    let at = |x: i32, y: i32| {
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        if inside { depth[(y * width + x) as usize] } else { f32::INFINITY }
    };
    let rows = picture.rgba.par_chunks_mut(picture.width as usize * 4).enumerate();
    rows.for_each(|(y, row)| {
        let y = y as i32;
        for (x, pixel) in (0i32..).zip(row.as_chunks_mut::<4>().0) {
            let own = at(x, y);
            let is_dot =
                |dots: &[AtomicU64]| dots[(y * width) as usize + x as usize].load(Relaxed) != EMPTY;
            if own == f32::INFINITY || !dots.is_none_or(is_dot) {
                continue;
            }
            // Nothing, which is infinitely far, is not in front.
            let behind =
                AROUND.map(|[right, down]| (own / at(x + right, y + down)).max(1.0).log2());
            let mean = behind.iter().sum::<f32>() / AROUND.len() as f32;
            let brightness = (-DARKENING * strength * mean).exp().max(BRIGHTNESS_MIN);
            for c in &mut pixel[..3] {
                *c = (f32::from(*c) * brightness + 0.5) as u8;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of white pixels with these depths.
    fn lit(depth: impl Fn(u32, u32) -> f32, strength: f32) -> Vec<u8> {
        const SIDE: u32 = 16;
        let depth: Vec<f32> = (0..SIDE * SIDE).map(|i| depth(i % SIDE, i / SIDE)).collect();
        let rgba = vec![255; depth.len() * 4];
        let mut picture = Picture { width: SIDE, height: SIDE, rgba, depth, ..Picture::default() };
        eye_dome(&mut picture, strength, None);
        picture.rgba.iter().step_by(4).copied().collect()
    }

    #[test]
    fn only_what_lies_behind_its_surroundings_is_dark() {
        assert!(lit(|_, _| 7.0, 1.0).iter().all(|&v| v == 255));
        // A near square on a far wall: the wall is dark around it, and the square is not.
        let is_near = |x: u32, y: u32| (6..10).contains(&x) && (6..10).contains(&y);
        let picture = lit(|x, y| if is_near(x, y) { 5.0 } else { 10.0 }, 1.0);
        for (i, &value) in (0u32..).zip(&picture) {
            let (x, y) = (i % 16, i / 16);
            let is_front = |[right, down]: &[i32; 2]| {
                is_near(x.saturating_add_signed(*right), y.saturating_add_signed(*down))
            };
            assert_eq!(value < 255, !is_near(x, y) && AROUND.iter().any(is_front), "{x} {y}");
        }
    }

    #[test]
    fn the_unit_of_depths_and_emptiness_do_not_matter() {
        let slope = |unit: f32| lit(|x, y| (3.0 + (x * y) as f32 * 0.01) * unit, 0.7);
        assert_eq!(slope(1.0), slope(1024.0));
        assert_eq!(slope(1.0), slope(2f32.powi(-40)));
        let edge = |x: u32, _| if x < 8 { f32::INFINITY } else { 4.0 };
        assert!(lit(edge, 1.0).iter().all(|&v| v == 255));
    }
}
