//! Errors of a picture against a reference: how different it looks, where surfaces are open or show
//! what lies behind them, and how far off depths are.

use crate::error_time::perfect::Reference;
use esker_render::Picture;
use esker_truth::flip::mean_flip;

/// Greatest difference of a channel that does not count as a change of a pixel.
const CHANGED: u8 = 8;
/// Steps in depth between pixels of one surface, at most, and distance from which a surface lies
/// behind another; both in widths of a pixel at that depth.
const STEP_PX: f32 = 8.0;
const BEHIND_PX: f32 = 16.0;
/// Distance from a step in depth up to which pixels are no interior of a surface, pixels.
const RIM_PX: usize = 2;

/// Errors of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    /// Mean of FLIP (`andersson2020`), 0 to 1.
    pub flip: f64,
    /// Share of the pixels of which a channel is off by more than 8 of 255.
    pub off_share: f64,
    /// Of the pixels in the interior of the reference's surfaces: the share that is empty.
    pub hole_share: f64,
    /// The same: the share that shows what lies behind.
    pub bleeding_share: f64,
    /// Mean error of depths in the interior of surfaces, in widths of a pixel at that depth.
    pub depth_px: f64,
}

/// Compares a picture with a reference of the same size; `focal_px` is the focal length.
pub(crate) fn errors(picture: &Picture, reference: &Reference, focal_px: f64) -> Errors {
    let pixels = reference.depth.len().max(1) as f64;
    let (own, other) = (picture.rgba.as_chunks::<4>().0, reference.rgba.as_chunks::<4>().0);
    let is_off = |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|i| a[i].abs_diff(b[i]) > CHANGED);
    let off = own.iter().zip(other).filter(is_off).count();
    let (mut inside, mut holes, mut bleeding, mut depth, mut shown) = (0, 0, 0, 0.0, 0.0);
    let inner = interior(reference, focal_px as f32);
    for (at, _) in inner.iter().enumerate().filter(|(_, inner)| **inner) {
        inside += 1;
        let wanted = reference.depth[at];
        let off_px = (picture.depth[at] - wanted) * focal_px as f32 / wanted;
        if off_px == f32::INFINITY {
            holes += 1;
        } else if off_px > BEHIND_PX {
            bleeding += 1;
        } else {
            depth += f64::from(off_px.abs());
            shown += 1.0;
        }
    }
    let share = |count: u32| f64::from(count) / f64::from(inside.max(1));
    Errors {
        flip: mean_flip(&picture.rgba, &reference.rgba, reference.width),
        off_share: off as f64 / pixels,
        hole_share: share(holes),
        bleeding_share: share(bleeding),
        depth_px: depth / f64::max(shown, 1.0),
    }
}

/// Which pixels of a reference have one surface all around them.
fn interior(reference: &Reference, focal_px: f32) -> Vec<bool> {
    let (width, depth) = (reference.width, &reference.depth);
    let height = depth.len() / width.max(1);
    let is_step = |a: f32, b: f32| {
        let off = (a - b).abs() * focal_px;
        a == f32::INFINITY || b == f32::INFINITY || off > STEP_PX * a.min(b)
    };
    let mut inner: Vec<bool> = depth.iter().map(|depth| depth.is_finite()).collect();
    for _ in 0..RIM_PX {
        let before = inner.clone();
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let at = y * width + x;
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then_some(at + width),
            ];
            let ends = |other: usize| !before[other] || is_step(depth[at], depth[other]);
            inner[at] &= !beside.into_iter().flatten().any(ends);
        }
    }
    inner
}

/// Root mean square difference, 0 to 255, between the change of a picture from frame to frame and
/// the change of the reference.
pub(super) fn flicker(pictures: [&[u8]; 2], references: [&[u8]; 2]) -> f64 {
    let [before, now] = pictures;
    let [wanted_before, wanted_now] = references;
    let changes = before.iter().zip(now).zip(wanted_before.iter().zip(wanted_now)).enumerate();
    let squares = changes.filter(|(channel, _)| channel % 4 < 3).map(|(_, ((a, b), (c, d)))| {
        let off = (f64::from(*b) - f64::from(*a)) - (f64::from(*d) - f64::from(*c));
        off * off
    });
    (squares.sum::<f64>() / (before.len() as f64 * 0.75).max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 32 x 24 pixels at depth 10 with nothing around it.
    fn wall() -> Reference {
        let (width, height) = (48, 40);
        let is_wall = |at: usize| {
            let (x, y) = (at % width, at / width);
            (8..40).contains(&x) && (8..32).contains(&y)
        };
        let depth = |at| if is_wall(at) { 10.0 } else { f32::INFINITY };
        let rgba = |at| if is_wall(at) { [200, 120, 40, 255] } else { [30, 34, 41, 255] };
        let all = 0..width * height;
        Reference {
            width,
            rgba: all.clone().flat_map(rgba).collect(),
            depth: all.map(depth).collect(),
        }
    }

    fn picture_of(reference: &Reference) -> Picture {
        Picture {
            width: reference.width as u32,
            height: (reference.depth.len() / reference.width) as u32,
            rgba: reference.rgba.clone(),
            depth: reference.depth.clone(),
            ..Picture::default()
        }
    }

    #[test]
    fn a_picture_has_no_error_against_itself() {
        let wall = wall();
        let errors = errors(&picture_of(&wall), &wall, 100.0);
        let Errors { flip, off_share, hole_share, bleeding_share, depth_px } = errors;
        assert_eq!([off_share, hole_share, bleeding_share, depth_px], [0.0; 4]);
        assert!(flip < 1e-6);
    }

    #[test]
    fn holes_and_what_lies_behind_are_counted_inside_surfaces_only() {
        let wall = wall();
        let mut picture = picture_of(&wall);
        let at = |x: usize, y: usize| y * 48 + x;
        // Inside 28 x 20 pixels: one hole, one pixel far behind, one half a pixel's width behind.
        picture.depth[at(20, 20)] = f32::INFINITY;
        picture.depth[at(21, 20)] = 20.0;
        picture.depth[at(22, 20)] = 10.05;
        // At the rim nothing counts.
        picture.depth[at(8, 20)] = f32::INFINITY;
        let errors = errors(&picture, &wall, 100.0);
        assert_eq!(errors.hole_share, 1.0 / 560.0);
        assert_eq!(errors.bleeding_share, 1.0 / 560.0);
        assert!((errors.depth_px - 0.5 / 558.0).abs() < 1e-5, "{}", errors.depth_px);
    }

    #[test]
    fn a_change_that_the_reference_has_is_no_flicker() {
        let (dark, light) = ([10, 10, 10, 255].repeat(4), [13, 13, 13, 255].repeat(4));
        assert_eq!(flicker([&dark, &light], [&dark, &light]), 0.0);
        assert_eq!(flicker([&dark, &light], [&dark, &dark]), 3.0);
    }
}
