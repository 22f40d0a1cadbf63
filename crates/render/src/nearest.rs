//! Points in the pixels of a frame: the nearest of those that are projected to each, by the pass
//! `project` alone. Surfaces fill more pixels than points fall on.

use crate::error::RenderError;
use crate::frame::Frame;
use crate::inputs::camera::Camera;
use crate::inputs::lookup::DrawList;
use crate::passes::project::{EMPTY, project, unpack};
use std::sync::atomic::{AtomicU64, Ordering};

/// Point of a frame in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// Index of its node in [`Frame::draws`].
    pub draw: usize,
    /// Its index in the node.
    pub point: usize,
    /// Its eye depth, the unit of the file.
    pub depth: f32,
}

/// The nearest point in each pixel of a frame, without its margin, the top row first; in the
/// current rayon pool.
///
/// # Errors
/// If the size of the view is not supported or its camera is not usable.
pub fn nearest_points(frame: &Frame<'_>) -> Result<Vec<Option<NearestPoint>>, RenderError> {
    let camera = Camera::of(frame)?;
    let [width, height] = camera.size.map(|side| side as usize);
    let margin = camera.margin_px as usize;
    let list = DrawList::new(frame.draws);
    let mut target = Vec::new();
    target.resize_with(width * height, || AtomicU64::new(EMPTY));
    project(frame, &camera, &list, &target);
    let rows = target.chunks(width.max(1)).skip(margin).take(height - 2 * margin);
    let pixels = rows.flat_map(|row| &row[margin..width - margin]);
    let point = |value: &AtomicU64| {
        let value = value.load(Ordering::Relaxed);
        (value != EMPTY).then(|| {
            let (depth, number) = unpack(value);
            let (draw, point) = list.find(number);
            NearestPoint { draw, point, depth }
        })
    };
    Ok(pixels.map(point).collect())
}
