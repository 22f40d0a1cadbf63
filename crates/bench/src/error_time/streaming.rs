//! Error while a file streams: from cold at a view, and along a path, the error of the shown frame
//! against the finished one, over wall time. The area under the curve compares orders of loading.

use crate::quantile::quantile;
use anyhow::{Context, Result};
use esker_engine::Method;
use esker_engine::cameras::path::Path;
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::Backend;
use esker_engine::machine::system;
use esker_format::Forest;
use esker_lod::View;
use esker_points::Task;
use esker_stream::Priority;
use esker_truth::flip::mean_flip;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Orders of loading that are compared: esker's own, and that of `kanzok2015`, section 3.2.2.
const PRIORITIES: [(Priority, &str); 2] =
    [(Priority::ErrorPerByte, "error per byte"), (Priority::Distance, "distance")];
/// Loads of each view by each order, in turn.
const ROUNDS: usize = 3;
/// Views of the path from the overview on, at most.
const VIEWS_MAX: usize = 3;
/// Frames of a load that are kept, and of those, frames that are compared.
const FRAMES_MAX: usize = 256;
const COMPARED: usize = 16;
/// Time after which a load is given up.
const PATIENCE: Duration = Duration::from_secs(60);
/// Duration of the way from each view to the next, and interval of the frames that are compared.
const TRAVEL: Duration = Duration::from_secs(1);
const EVERY: Duration = Duration::from_millis(125);

/// What is loaded.
#[derive(Clone, Copy, Debug)]
pub(super) struct LoadRequest {
    /// Width and height of pictures, pixels.
    pub size: [u32; 2],
    /// Most bytes read a second; `None` for what the disk gives.
    pub read_bytes_a_second: Option<u64>,
}

/// Loads of a view, or flights along a path, by an order of loading.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Load {
    pub file: String,
    /// Name of the view, or `path`.
    pub view: String,
    pub priority: &'static str,
    /// Most bytes that were read a second; none for what the disk gave.
    pub read_bytes_a_second: Option<u64>,
    /// Median time until nothing more was loaded; of a path, its duration.
    pub complete_ms: f64,
    /// Bytes that were read, median.
    pub read_bytes: u64,
    /// Area under the curve, milliseconds of a picture that is wholly wrong: median and quartiles
    /// of the rounds.
    pub area_ms: f64,
    pub area_quartiles_ms: [f64; 2],
    /// Milliseconds and FLIP of the frames of the last round.
    pub curve: Vec<[f64; 2]>,
}

/// What one round measured.
struct Round {
    complete_ms: f64,
    read_bytes: u64,
    curve: Vec<[f64; 2]>,
}

impl Round {
    /// Area under the curve, from the first frame on.
    fn area_ms(&self) -> f64 {
        let pieces = self.curve.windows(2).map(|pair| {
            let [from, to] = [pair[0], pair[1]];
            (to[0] - from[0]) * (from[1] + to[1]) / 2.0
        });
        pieces.sum()
    }
}

/// Loads views of a file from an empty cache and flies from each to the next, by each order in
/// turn, with the pictures and the rate of reading of `request`.
///
/// # Errors
/// If the file cannot be read, a frame cannot be drawn, or `task` is cancelled.
pub(super) fn measure(
    name: &str,
    file: &Arc<Forest>,
    request: &LoadRequest,
    task: &dyn Task,
) -> Result<Vec<Load>> {
    let path = Path::of(file, request.size);
    let mut loads = Vec::new();
    for stop in path.views.iter().take(VIEWS_MAX) {
        loads.extend(rounds((name, &stop.name), request, |priority| {
            task.check()?;
            load(file, request, &stop.view, priority)
        })?);
    }
    if path.views.len() > 1 {
        loads.extend(rounds((name, "path"), request, |priority| {
            task.check()?;
            fly(file, request, &path, priority)
        })?);
    }
    Ok(loads)
}

/// Runs `round` for each order in turn.
fn rounds(
    (file, view): (&str, &str),
    request: &LoadRequest,
    mut round: impl FnMut(Priority) -> Result<Round>,
) -> Result<Vec<Load>> {
    let mut all = PRIORITIES.map(|_| Vec::new());
    for _ in 0..ROUNDS {
        for ((priority, _), own) in PRIORITIES.into_iter().zip(&mut all) {
            own.push(round(priority)?);
        }
    }
    let read_bytes_a_second = request.read_bytes_a_second;
    let of = |((_, priority), own): ((Priority, &'static str), &Vec<Round>)| {
        let areas: Vec<f64> = own.iter().map(Round::area_ms).collect();
        let median =
            |value: fn(&Round) -> f64| quantile(&own.iter().map(value).collect::<Vec<_>>(), 0.5);
        Load {
            file: file.into(),
            view: view.into(),
            priority,
            read_bytes_a_second,
            complete_ms: median(|round| round.complete_ms),
            read_bytes: median(|round| round.read_bytes as f64) as u64,
            area_ms: quantile(&areas, 0.5),
            area_quartiles_ms: [quantile(&areas, 0.25), quantile(&areas, 0.75)],
            curve: own.last().map(|round| round.curve.clone()).unwrap_or_default(),
        }
    };
    Ok(PRIORITIES.into_iter().zip(&all).map(of).collect())
}

/// Opens a session with an empty cache.
fn open(file: &Arc<Forest>, request: &LoadRequest, priority: Priority) -> Result<Session> {
    for path in file.files().map(|file| file.path()) {
        let context = || format!("{}: cannot drop it from the cache", path.display());
        system::forget(&std::fs::File::open(path).with_context(context)?).with_context(context)?;
    }
    let settings = Settings { method: Method::PullPush, ..Settings::default() };
    let options = Options {
        settings,
        backend: Backend::Cpu,
        size: request.size,
        priority,
        read_bytes_a_second: request.read_bytes_a_second,
        ..Options::default()
    };
    Session::open(Arc::clone(file), options)
}

/// Loads a view from cold.
fn load(
    file: &Arc<Forest>,
    request: &LoadRequest,
    view: &View,
    priority: Priority,
) -> Result<Round> {
    let start = Instant::now();
    let mut session = open(file, request, priority)?;
    let mut frames: Vec<(f64, Vec<u8>)> = Vec::new();
    loop {
        let is_final = session.frame(view)?.is_final;
        let at_ms = start.elapsed().as_secs_f64() * 1e3;
        if frames.len() < FRAMES_MAX || is_final {
            frames.push((at_ms, session.picture()?.rgba));
        }
        if is_final || start.elapsed() > PATIENCE {
            break;
        }
    }
    let complete_ms = frames.last().map_or(0.0, |(at_ms, _)| *at_ms);
    let finished = frames.last().map(|(_, rgba)| rgba.clone()).unwrap_or_default();
    let step = frames.len().div_ceil(COMPARED).max(1);
    let last = frames.len().saturating_sub(1);
    let kept = frames.iter().enumerate().filter(|(i, _)| i % step == 0 || *i == last);
    let error = |(_, (at_ms, rgba)): (usize, &(f64, Vec<u8>))| {
        [*at_ms, mean_flip(rgba, &finished, request.size[0] as usize)]
    };
    let curve = kept.map(error).collect();
    Ok(Round { complete_ms, read_bytes: session.status().read_bytes, curve })
}

/// Flies from view to view from cold, and afterwards finishes the frames that were shown.
fn fly(
    file: &Arc<Forest>,
    request: &LoadRequest,
    path: &Path,
    priority: Priority,
) -> Result<Round> {
    let mut session = open(file, request, priority)?;
    let ways = path.views.len().min(VIEWS_MAX) - 1;
    let whole = TRAVEL * ways as u32;
    let start = Instant::now();
    let mut shown: Vec<(f64, View, Vec<u8>)> = Vec::new();
    while start.elapsed() < whole {
        let along = start.elapsed().as_secs_f64() / TRAVEL.as_secs_f64();
        let to = (along as usize).min(ways - 1) + 1;
        let view = path.between(to, (along - (to - 1) as f64).min(1.0));
        session.frame(&view)?;
        let at = start.elapsed();
        if at >= EVERY * shown.len() as u32 {
            shown.push((at.as_secs_f64() * 1e3, view, session.picture()?.rgba));
        }
    }
    let read_bytes = session.status().read_bytes;
    let mut curve = Vec::new();
    for (at_ms, view, rgba) in shown {
        let patience = Instant::now();
        while !session.frame(&view)?.is_final && patience.elapsed() < PATIENCE {}
        let finished = session.picture()?.rgba;
        curve.push([at_ms, mean_flip(&rgba, &finished, request.size[0] as usize)]);
    }
    Ok(Round { complete_ms: whole.as_secs_f64() * 1e3, read_bytes, curve })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_is_that_of_trapezoids() {
        let curve = vec![[10.0, 0.4], [20.0, 0.2], [40.0, 0.0]];
        let round = Round { complete_ms: 40.0, read_bytes: 0, curve };
        assert!((round.area_ms() - 5.0).abs() < 1e-12);
    }
}
