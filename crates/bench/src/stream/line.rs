//! Time until a view of a file at an address is complete, beside what the line to the server
//! allows: the bytes that the view needs over its rate, or a round trip for each level of the tree,
//! because a node is requested when its parent is there.

use crate::stream::disk;
use crate::stream::request::{FlightRequest, Line};
use anyhow::{Result, ensure};
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::path::Path;
use esker_engine::draw::session::Session;
use esker_format::Forest;
use esker_points::node::NONE;
use esker_stream::Cut;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Round trips before the roots can be requested: the first block, then the node table.
const TRIPS_TO_OPEN: u32 = 2;

/// Time after which the view is given up.
const PATIENCE: Duration = Duration::from_secs(600);

/// How long the first view took.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LineReport {
    /// Rate of the line, millions of bits a second, as it was given.
    pub mbit_s: f64,
    /// Round trip, milliseconds, as it was given.
    pub round_trip_ms: f64,
    /// Name of the view.
    pub view: String,
    /// Time until the file was open, milliseconds.
    pub open_ms: f64,
    /// Time from before that until the view was complete, milliseconds.
    pub complete_ms: f64,
    /// Whether it became complete.
    #[serde(rename = "complete")]
    pub is_complete: bool,
    /// Bytes that the view needs: planes of its nodes, and the sections of the file.
    pub needed_bytes: u64,
    /// Bytes that came.
    pub received_bytes: u64,
    /// Requests that were made.
    pub requests: u64,
    /// Levels of the tree in the view, roots included.
    pub levels: u32,
    /// The needed bytes over the rate, milliseconds.
    pub transfer_ms: f64,
    /// Round trips of the levels and of opening, milliseconds.
    pub trips_ms: f64,
    /// `complete_ms` over the larger of the two.
    pub ratio: f64,
}

/// Opens a file and loads the first view of the path, without drawing.
///
/// # Errors
/// If the file or the path cannot be read.
pub(super) fn measure(
    file_path: &std::path::Path,
    request: &FlightRequest,
    line: Line,
) -> Result<LineReport> {
    let start = Instant::now();
    let file = Arc::new(Forest::open(file_path)?);
    let open_ms = start.elapsed().as_secs_f64() * 1e3;
    // A path that is derived from the scan begins with its overview, and reads pages for the rest.
    let (name, view) = match &request.path {
        Some(path) => {
            let mut path = Path::read(path, &file, request.size)?;
            ensure!(!path.views.is_empty(), "the path has no view");
            let first = path.views.remove(0);
            (first.name, first.view)
        }
        None => ("overview".into(), Camera::of_benchmarks(info::bounds(&file), request.size)),
    };
    let mut options = request.options();
    options.backend = esker_engine::machine::backend::Backend::Cpu;
    let mut session = Session::open(Arc::clone(&file), options)?;
    let loading = Instant::now();
    let cut = session.settle(&view, PATIENCE)?;
    let is_complete = cut.settled && loading.elapsed() < PATIENCE;
    let complete_ms = start.elapsed().as_secs_f64() * 1e3;
    let [requests, received_bytes] = file.traffic().unwrap_or_default();
    let (needed_bytes, levels) = needs(&file, &cut);
    let transfer_ms = needed_bytes as f64 * 8.0 / (line.mbit_s * 1e3);
    let trips_ms = f64::from(levels + TRIPS_TO_OPEN) * line.round_trip_ms;
    Ok(LineReport {
        mbit_s: line.mbit_s,
        round_trip_ms: line.round_trip_ms,
        view: name,
        open_ms,
        complete_ms,
        is_complete,
        needed_bytes,
        received_bytes,
        requests,
        levels,
        transfer_ms,
        trips_ms,
        ratio: complete_ms / transfer_ms.max(trips_ms).max(1e-9),
    })
}

/// Bytes that a cut needs of a file, and the levels of its nodes.
fn needs(file: &Forest, cut: &Cut) -> (u64, u32) {
    let planes: u64 = disk::ranges_of_all(file, cut).iter().map(|r| r.end - r.start).sum();
    let sections = |file: &esker_format::EskerFile| {
        file.footer().file_bytes.saturating_sub(file.footer().table.offset)
    };
    let depth = |mut node: u32| {
        let mut levels = 1;
        while file.record(node).parent != NONE {
            node = file.record(node).parent;
            levels += 1;
        }
        levels
    };
    let levels = cut.nodes.iter().map(|drawn| depth(drawn.node)).max().unwrap_or(0);
    (planes + file.files().map(sections).sum::<u64>(), levels)
}
