//! Windows of still pictures: a part of the picture that is drawn without the rest. Nodes are
//! chosen for the whole picture, so that pictures of its parts fit together. The part is drawn with
//! what the passes need around it, and then cropped.

use crate::draw::method::Method;
use anyhow::{Result, ensure};
use esker_lod::{View, Window};
use esker_render::Picture;
use esker_render::picture::margin::{crop_to, window_around};

/// The view that draws the part `window` of a picture of `size` pixels, and the place of the part
/// in what it draws. `view` is that of the whole picture; `has_normals` says whether points have
/// normals, and `sparsest_px` how far apart they are on it at most.
///
/// # Errors
/// If the window is not within the picture.
pub(crate) fn windowed(
    view: View,
    window: Option<Window>,
    size: [u32; 2],
    method: Method,
    (has_normals, sparsest_px): (bool, f64),
) -> Result<(View, Option<Window>)> {
    let Some(shown) = window else { return Ok((view, None)) };
    check(shown, size)?;
    let margin = view.margin_px;
    let shown = Window { x: shown.x + margin, y: shown.y + margin, ..shown };
    // Only passes that fill gaps or fit planes read pixels farther away the farther points are
    // apart.
    let passes_px = match method {
        Method::Points => 0.0,
        Method::Ewa if has_normals => 0.0,
        _ => sparsest_px,
    };
    let smooths_depth = !has_normals && method != Method::Points;
    let drawn = window_around(&view, shown, smooths_depth, passes_px);
    let within = Window { x: shown.x - drawn.x, y: shown.y - drawn.y, ..shown };
    Ok((View { window: Some(drawn), ..view }, Some(within)))
}

/// Refuses a window that is not within a picture of `size` pixels.
pub(crate) fn check(window: Window, [width, height]: [u32; 2]) -> Result<()> {
    let fits = |first: u32, count: u32, side: u32| {
        count > 0 && first.checked_add(count).is_some_and(|end| end <= side)
    };
    let Window { x, y, width: w, height: h } = window;
    ensure!(
        fits(x, w, width) && fits(y, h, height),
        "the window {x},{y},{w},{h} is not within the picture of {width}x{height} pixels"
    );
    Ok(())
}

/// The part `within` of a drawn picture.
pub(crate) fn cropped(drawn: Picture, within: Option<Window>) -> Picture {
    let Some(within) = within else { return drawn };
    let mut picture = Picture { stats: drawn.stats, ..Picture::default() };
    picture.stats.pixels_covered = crop_to(&drawn, within, &mut picture);
    picture
}
