//! Picking as a call: opens a file, or builds scans into one; draws the part of the picture around
//! a pixel on the CPU, for its depth, and returns the point that the pixel shows.

use super::{Picked, REACH_PX, pick, shown_depth};
use crate::draw::empty_picture;
use crate::draw::scene::{PictureRequest, PictureScene, completed, open_in_parts};
use crate::draw::window::cropped;
use crate::io::picture;
use crate::machine::pool;
use anyhow::{Result, ensure};
use esker_format::Forest;
use esker_lod::{CompactOctree, Window};
use esker_points::Task;
use esker_render::Renderer;
use glam::DVec2;
use serde::Serialize;
use std::path::PathBuf;

/// What a pixel shows.
#[derive(Clone, Debug, Serialize)]
pub struct PickReport {
    /// Column and row of the pixel, from 0.
    pub pixel: [u32; 2],
    /// Eye depth that the picture shows there; none if nothing is drawn there.
    pub depth: Option<f64>,
    /// The point; none if there is none near the pixel.
    pub point: Option<Picked>,
}

/// Picks the point that pixel `pixel` (column and row, from 0) of the picture of `inputs` shows.
/// The window of the request is not used, and the CPU draws.
///
/// # Errors
/// If an input cannot be read, the filter leaves no point, or the pixel is not on the picture.
pub fn pick_pixel(
    inputs: &[PathBuf],
    request: &PictureRequest,
    pixel: [u32; 2],
    task: &dyn Task,
) -> Result<PickReport> {
    pool::run(request.threads, || {
        picture::check_size(request.size, request.method)?;
        check_pixel(pixel, request.size)?;
        let (file, _folder) = open_in_parts(inputs, request, task)?;
        pick_in(&file, request, pixel, task)
    })
}

/// [`pick_pixel`] of an open file.
///
/// # Errors
/// As [`pick_pixel`].
pub fn pick_in(
    file: &Forest,
    request: &PictureRequest,
    pixel: [u32; 2],
    task: &dyn Task,
) -> Result<PickReport> {
    check_pixel(pixel, request.size)?;
    let window = around(pixel, request.size);
    let request = PictureRequest { window: Some(window), ..request.clone() };
    let grown = completed(file, &request, task)?;
    let file = grown.as_ref().unwrap_or(file);
    let scene = PictureScene::read(file, &request, task)?;
    let selection = &scene.selection;
    let octree = CompactOctree::with_hidden(file.table(), &selection.drawn, &selection.hidden);
    let draws = scene.draws(file);
    let frame = scene.appearance.frame(file, &scene.view, &draws, &octree);
    let drawn = cropped(Renderer::default().render(&frame)?, scene.window);
    let within = [pixel[0] - window.x, pixel[1] - window.y];
    let depth = shown_depth(&drawn.depth, drawn.width, within);
    let at = DVec2::new(f64::from(pixel[0]), f64::from(pixel[1])) + 0.5;
    let point = match depth {
        Some(depth) => pick(file, &scene.view, at, depth, &scene.appearance.shown)?,
        None => {
            empty_picture::check_wanted(file, &scene.appearance.shown)?;
            None
        }
    };
    Ok(PickReport { pixel, depth, point })
}

/// Refuses a pixel that is not on a picture of this size.
fn check_pixel([x, y]: [u32; 2], [width, height]: [u32; 2]) -> Result<()> {
    ensure!(
        x < width && y < height,
        "pixel {x},{y} is not on the picture, whose last one is {},{}: see --size",
        width.saturating_sub(1),
        height.saturating_sub(1)
    );
    Ok(())
}

/// The part of a picture within reach of a pixel.
fn around(pixel: [u32; 2], size: [u32; 2]) -> Window {
    let reach = REACH_PX as u32;
    let [(x, width), (y, height)] = [0, 1].map(|i| {
        let first = pixel[i].saturating_sub(reach);
        (first, (pixel[i] + reach + 1).min(size[i]) - first)
    });
    Window { x, y, width, height }
}

/// Text of a report.
pub fn text(report: &PickReport) -> String {
    let [x, y] = report.pixel;
    let Some(point) = &report.point else {
        return match report.depth {
            None => format!("nothing is drawn within {REACH_PX} pixels of {x},{y}"),
            Some(_) => format!("no point is near what pixel {x},{y} shows"),
        };
    };
    let rows = point.rows();
    let wide = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let lines = rows.iter().map(|(name, value)| format!("{name:<wide$}  {value}"));
    lines.collect::<Vec<_>>().join("\n")
}
