//! A margin around pictures of filled surfaces. At the border of a picture pixels lack the
//! neighbours that filling, smoothing and trimming use. If the scene goes on beyond the border, the
//! passes therefore work on a larger picture, which is cropped afterwards.

use crate::frame::Picture;
use esker_lod::{View, Window};
use glam::DVec3;
use rayon::prelude::*;

/// Width of the margin on each side, pixels, in all of Esker's pictures of filled surfaces. With
/// it, less than 1 % of the border differs from what a larger picture shows there
/// (`tests/margin.rs`; `docs/design/surfaces.md`).
pub const MARGIN_PX: u32 = 16;

/// Pixels drawn around a window: at least so many, and so many times the greatest distance of
/// points. Passes read pixels up to that distance.
const WINDOW_MARGIN_PX: u32 = 64;
const WINDOW_MARGIN_SPACINGS: f64 = 16.0;
/// The same where depths are smoothed, since that is as wide as the discs in the tiles around are
/// ([`crate::picture::radii`]).
const SMOOTH_WINDOW_MARGIN_PX: u32 = 192;
/// Windows with their margin begin at multiples of this many pixels, so that pixels of the pyramid
/// up to this size, and the squares of fitted planes and of exposure, are those of the whole. Gaps
/// between points that are farther apart are filled from larger pixels of the pyramid.
const WINDOW_STEP_PX: u32 = 64;
const WINDOW_STEP_SPACINGS: f64 = 4.0;

/// Rows of a picture that a job copies.
const ROWS: usize = 32;

/// Whether points within `bounds` (least and greatest coordinates, world) may lie beyond the
/// picture of `view` or before its near plane.
pub fn goes_beyond(view: &View, bounds: [[f64; 3]; 2]) -> bool {
    (0..8).any(|corner| {
        let at = |axis: usize| bounds[corner >> axis & 1][axis];
        let place = view.project(DVec3::new(at(0), at(1), at(2)));
        place.is_none_or(|place| !view.is_on_picture(place))
    })
}

/// The part of the picture of `view` to draw for the part `shown` of it, of which both count from
/// the first pixel of the margin: with what passes need around it, as far as the picture goes.
/// `smooths_depth` says whether depths are smoothed, and `sparsest_px` how far apart points are at
/// most, pixels, if passes look as far as that.
pub fn window_around(view: &View, shown: Window, smooths_depth: bool, sparsest_px: f64) -> Window {
    let least_px = if smooths_depth { SMOOTH_WINDOW_MARGIN_PX } else { WINDOW_MARGIN_PX };
    // An infinite distance is that of a node around the eye: all of the picture is drawn.
    let margin_px = least_px.max((sparsest_px * WINDOW_MARGIN_SPACINGS).ceil() as u32);
    let step = sparsest_px * WINDOW_STEP_SPACINGS;
    let step_px = (step.min(f64::from(1 << 30)) as u32).next_power_of_two().max(WINDOW_STEP_PX);
    let ends = |first: u32, count: u32, side: u32| {
        let low = first.saturating_sub(margin_px) / step_px * step_px;
        [low, first.saturating_add(count).saturating_add(margin_px).min(side)]
    };
    let [left, right] = ends(shown.x, shown.width, view.width);
    let [top, bottom] = ends(shown.y, shown.height, view.height);
    Window { x: left, y: top, width: right - left, height: bottom - top }
}

/// Copies `wide` without a margin of `margin_px` pixels to `picture`. Returns the number of its
/// pixels that show a surface; the caller sets its other counts and its times.
pub fn crop(wide: &Picture, margin_px: u32, picture: &mut Picture) -> u64 {
    let [width, height] = [wide.width, wide.height].map(|side| side - 2 * margin_px);
    crop_to(wide, Window { x: margin_px, y: margin_px, width, height }, picture)
}

/// Copies a part of `wide` to `picture`, otherwise as [`crop`].
pub fn crop_to(wide: &Picture, part: Window, picture: &mut Picture) -> u64 {
    (picture.width, picture.height) = (part.width, part.height);
    let [left, top, width, height] = [part.x, part.y, part.width, part.height].map(|n| n as usize);
    picture.rgba.resize(width * height * 4, 0);
    picture.depth.resize(width * height, 0.0);
    let wide_width = wide.width as usize;
    let colours = wide.rgba.as_chunks::<4>().0;
    let rgba = picture.rgba.as_chunks_mut::<4>().0.par_chunks_mut(width);
    let rows = rgba.zip(picture.depth.par_chunks_mut(width)).with_min_len(ROWS).enumerate();
    let covered = rows.map(|(y, (rgba, depth))| {
        let from = (y + top) * wide_width + left;
        rgba.copy_from_slice(&colours[from..][..width]);
        depth.copy_from_slice(&wide.depth[from..][..width]);
        depth.iter().map(|&d| u64::from(d < f32::INFINITY)).sum::<u64>()
    });
    covered.sum()
}
