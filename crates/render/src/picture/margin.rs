//! A margin around pictures of filled surfaces. At the border of a picture pixels lack the
//! neighbours that filling, smoothing and trimming use. If the scene goes on beyond the border, the
//! passes therefore work on a larger picture, which is cropped afterwards.

use crate::frame::Picture;
use esker_lod::View;
use glam::DVec3;
use rayon::prelude::*;

/// Width of the margin on each side, pixels, in all of Esker's pictures of filled surfaces. With
/// it, less than 1 % of the border differs from what a larger picture shows there
/// (`tests/margin.rs`; `docs/design/surfaces.md`).
pub const MARGIN_PX: u32 = 16;

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

/// Copies `wide` without a margin of `margin_px` pixels to `picture`. Returns the number of its
/// pixels that show a surface; the caller sets its other counts and its times.
pub fn crop(wide: &Picture, margin_px: u32, picture: &mut Picture) -> u64 {
    (picture.width, picture.height) = (wide.width - 2 * margin_px, wide.height - 2 * margin_px);
    let [width, height, margin] = [picture.width, picture.height, margin_px].map(|n| n as usize);
    picture.rgba.resize(width * height * 4, 0);
    picture.depth.resize(width * height, 0.0);
    let wide_width = wide.width as usize;
    let colours = wide.rgba.as_chunks::<4>().0;
    let rgba = picture.rgba.as_chunks_mut::<4>().0.par_chunks_mut(width);
    let rows = rgba.zip(picture.depth.par_chunks_mut(width)).with_min_len(ROWS).enumerate();
    let covered = rows.map(|(y, (rgba, depth))| {
        let from = (y + margin) * wide_width + margin;
        rgba.copy_from_slice(&colours[from..][..width]);
        depth.copy_from_slice(&wide.depth[from..][..width]);
        depth.iter().map(|&d| u64::from(d < f32::INFINITY)).sum::<u64>()
    });
    covered.sum()
}
