//! Draws a picture some times on the CPU and measures its frames: for the model of the machine
//! ([`crate::draw::calibration`]), and to correct it for a view ([`crate::draw::choice`]).

use crate::draw::pace::Load;
use crate::draw::scene::{PictureRequest, PictureScene, completed};
use crate::machine::system;
use anyhow::Result;
use esker_format::Forest;
use esker_lod::CompactOctree;
use esker_points::Task;
use esker_render::{Picture, Renderer};
use std::time::Instant;

/// Frames of a picture that were measured.
#[derive(Clone, Debug)]
pub(crate) struct Measured {
    /// What each has.
    pub load: Load,
    /// CPU time of each, milliseconds, least first; wall time where the system does not tell.
    pub cpu_ms: Vec<f64>,
    /// Greatest CPU time of one over its wall time. Whatever else the machine does only lowers it.
    pub parallel: f64,
}

/// Draws `frames` frames of a picture after one that is not measured: memory is new to it.
///
/// # Errors
/// If planes cannot be read, the view makes no valid camera, or `task` is cancelled.
pub(crate) fn measured(
    file: &Forest,
    request: &PictureRequest,
    frames: usize,
    task: &dyn Task,
) -> Result<Measured> {
    let grown = completed(file, request, task)?;
    let file = grown.as_ref().unwrap_or(file);
    let scene = PictureScene::read(file, request, task)?;
    let selection = &scene.selection;
    let octree = CompactOctree::with_hidden(file.table(), &selection.drawn, &selection.hidden);
    let draws = scene.draws(file);
    let frame = scene.appearance.frame(file, &scene.view, &draws, &octree);
    let (mut renderer, mut picture) = (Renderer::default(), Picture::default());
    renderer.render_into(&frame, &mut picture)?;
    let (mut cpu_ms, mut parallel) = (Vec::new(), 0.0f64);
    for _ in 0..frames {
        task.check()?;
        let (start, before) = (Instant::now(), system::cpu_ms());
        renderer.render_into(&frame, &mut picture)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let own_ms = system::cpu_ms().zip(before).map_or(wall_ms, |(now, then)| now - then);
        parallel = parallel.max(own_ms / wall_ms.max(1e-6));
        cpu_ms.push(own_ms);
    }
    cpu_ms.sort_by(f64::total_cmp);
    let pixels = f64::from(scene.view.width) * f64::from(scene.view.height);
    let shown = f64::from(picture.width) * f64::from(picture.height);
    let covered = picture.stats.pixels_covered as f64 / shown.max(1.0) * pixels;
    let load = Load { points: picture.stats.points_drawn as f64, pixels, covered };
    Ok(Measured { load, cpu_ms, parallel })
}
