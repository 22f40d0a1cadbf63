//! The report of the benchmark of streaming. A run is measured in a child process, which prints its
//! report as JSON; the parent reads it back by the same types, so that a missing field is an error.

use crate::pass_times;
use crate::stream::line::LineReport;
use crate::stream::request::Settings;
use esker_render::PassTimes;
use serde::{Deserialize, Deserializer, Serialize};

/// Report of one run, or of several.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum StreamReport {
    /// The only run.
    One(Box<StreamRun>),
    /// All runs, in the order of the inputs.
    Several {
        /// A report each.
        runs: Vec<StreamRun>,
    },
}

impl StreamReport {
    /// Whether a run took more memory than its budgets.
    pub fn is_over_budget(&self) -> bool {
        self.runs().iter().any(|run| run.budget_exceeded)
    }

    /// All runs.
    pub(super) fn runs(&self) -> &[StreamRun] {
        match self {
            Self::One(run) => std::slice::from_ref(run),
            Self::Several { runs } => runs,
        }
    }
}

/// Report of one file flown through with one set of settings; `bench/README.md` explains it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct StreamRun {
    /// Name of the input.
    pub file: String,
    /// Points of the file and of all files that it names.
    pub points: u64,
    /// Number of these files.
    pub trees: usize,
    /// Nodes of all trees.
    pub nodes: usize,
    /// Greatest number of points of a node.
    pub node_capacity: u32,
    /// Bytes of the node table in memory.
    pub structure_bytes: u64,
    /// Bytes of the node table for each node.
    pub table_bytes_a_node: usize,
    /// Bytes of all files.
    pub file_bytes: u64,
    /// `gpu` or `cpu`.
    pub backend: String,
    /// Name of the GPU, if it draws.
    #[serde(deserialize_with = "present")]
    pub adapter: Option<String>,
    /// Path of the GPU from points to pixels; `cpu` without one.
    pub gpu_path: String,
    /// Why the CPU draws, if that was chosen by the program.
    #[serde(deserialize_with = "present")]
    pub backend_note: Option<String>,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Settings of streaming.
    pub settings: Settings,
    /// Whether hidden nodes were left out.
    pub depth_test: bool,
    /// Whether the cache was emptied before each flight.
    pub cold: bool,
    /// Greatest resident set of the process.
    pub peak_rss_bytes: u64,
    /// Resident set before the file was opened.
    pub empty_rss_bytes: u64,
    /// Growth of the resident set by opening the device.
    pub driver_rss_bytes: u64,
    /// Budget of main memory.
    pub budget_ram_bytes: u64,
    /// Greatest use of drawing memory; on a GPU of all its buffers.
    pub peak_gpu_bytes: u64,
    /// Bytes of GPU buffers other than node planes, at the end.
    #[serde(deserialize_with = "present")]
    pub fixed_gpu_bytes: Option<u64>,
    /// Budget of drawing memory.
    pub budget_gpu_bytes: u64,
    /// Whether a budget was exceeded.
    pub budget_exceeded: bool,
    /// Waits of the render thread, of both flights.
    pub render_stalls: u64,
    /// Frames of the flight with the depth test, as all figures below.
    pub frames: usize,
    /// Median time of frames.
    pub frame_ms_p50: f64,
    /// Time that 99 % of frames do not exceed.
    pub frame_ms_p99: f64,
    /// Time of the longest frame.
    pub frame_ms_max: f64,
    /// Median time of choices.
    pub lod_ms_p50: f64,
    /// Time that 99 % of choices do not exceed.
    pub lod_ms_p99: f64,
    /// Time of the longest choice.
    pub lod_ms_max: f64,
    /// Share of frames within 100 ms.
    pub frames_within_100_ms: f64,
    /// Share of choices within 100 ms.
    pub lod_within_100_ms: f64,
    /// Bytes read from the files.
    pub read_bytes: u64,
    /// Bytes of these that were requested.
    pub useful_bytes: u64,
    /// Number of reads.
    pub reads: u64,
    /// `read_bytes` over the time in which requests were waiting or in flight.
    pub flight_bytes_per_s: f64,
    /// Nodes that were loaded.
    pub nodes_loaded: u64,
    /// Nodes that lost their slots to others.
    pub nodes_evicted: u64,
    /// Requests that were out of view before they were read.
    pub requests_dropped: u64,
    /// Nodes that could not be read.
    pub nodes_failed: u64,
    /// The last fault of reading.
    #[serde(deserialize_with = "present")]
    pub fault: Option<String>,
    /// Figures of each view.
    pub views: Vec<ViewReport>,
    /// The way to each view but the first.
    pub transitions: Vec<TransitionReport>,
    /// Rate of a plain sequential read.
    pub sequential_bytes_per_s: f64,
    /// The loading's `streamed_bytes_per_s`.
    pub read_bytes_per_s: f64,
    /// The first view of a file at an address, if its line was given.
    #[serde(deserialize_with = "present")]
    pub line: Option<LineReport>,
    /// Loading of one view, beside plain reads.
    pub loading: LoadingReport,
}

/// A view of the path, drawn with the depth test and without it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ViewReport {
    /// Figures of the flight with the depth test.
    #[serde(flatten)]
    pub figures: ViewFigures,
    /// Figures of the flight without it, if that was measured.
    #[serde(deserialize_with = "present")]
    pub without_depth_test: Option<ViewFigures>,
}

/// Figures of a view, as in table 3 of `kanzok2015`.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ViewFigures {
    /// Name of the view.
    pub name: String,
    /// Nodes drawn once the view was complete.
    pub nodes: u64,
    /// Points drawn once the view was complete.
    pub points: u64,
    /// Median time of the LOD thread's choices, milliseconds.
    pub lod_ms: f64,
    /// Median time of drawing, milliseconds.
    pub render_ms: f64,
    /// Median time of each pass: by the GPU's clock if a GPU draws.
    #[serde(serialize_with = "pass_times::with_all", deserialize_with = "pass_times::from_all")]
    pub passes_ms: PassTimes,
    /// Time from the arrival at the view until everything that it needs was drawn, milliseconds.
    pub complete_ms: f64,
    /// Whether the view became complete.
    #[serde(rename = "complete")]
    pub is_complete: bool,
    /// Median time of whole frames, milliseconds.
    pub frame_ms: f64,
    /// Frames a second, by the median frame.
    pub fps: f64,
    /// Nodes that were hidden, with their subtrees or by themselves.
    pub nodes_occluded: u64,
    /// Bytes of drawing memory in slots.
    pub resident_bytes: u64,
}

/// The way to a view.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TransitionReport {
    /// Name of the view that it leads to.
    pub to: String,
    /// Number of frames.
    pub frames: usize,
    /// Points of a frame, on average.
    pub points: f64,
    /// Bytes read on the way.
    pub read_bytes: u64,
    /// Median time of its frames, milliseconds.
    pub frame_ms_p50: f64,
    /// Time that 99 % of its frames do not exceed, milliseconds.
    pub frame_ms_p99: f64,
    /// Time of the longest frame, milliseconds.
    pub frame_ms_max: f64,
}

/// Loading of one view without drawing, beside plain reads of the same ranges of the file.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LoadingReport {
    /// Name of the view.
    pub view: String,
    /// Bytes of the ranges.
    pub bytes: u64,
    /// Loadings whose median is reported.
    pub runs: usize,
    /// Rate of the streamer.
    pub streamed_bytes_per_s: f64,
    /// Rate of plain reads.
    pub plain_bytes_per_s: f64,
    /// Median of streamed rate over plain rate.
    pub ratio: f64,
    /// Whether the file was removed from the system's cache before.
    pub from_cold: bool,
}

/// Reads a field that may be null but not absent: serde takes an absent `Option` for `None`.
fn present<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Option<T>, D::Error> {
    Option::deserialize(from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn run() -> Value {
        let view = ViewReport {
            without_depth_test: Some(ViewFigures::default()),
            ..ViewReport::default()
        };
        let transitions = vec![TransitionReport::default()];
        let run = StreamRun {
            views: vec![view],
            transitions,
            line: Some(LineReport::default()),
            ..StreamRun::default()
        };
        serde_json::to_value(StreamReport::One(Box::new(run))).unwrap()
    }

    /// Asserts that no field of the object at `pointer` can be left out of a run.
    fn refuses_missing_fields(pointer: &str) {
        let object = run().pointer(pointer).unwrap().clone();
        for (name, _) in object.as_object().unwrap() {
            let mut cut = run();
            cut.pointer_mut(pointer).unwrap().as_object_mut().unwrap().remove(name);
            let error = serde_json::from_value::<StreamRun>(cut).unwrap_err().to_string();
            assert!(error.contains(&format!("`{name}`")), "without {pointer} {name}: {error}");
        }
    }

    #[test]
    fn a_report_with_a_missing_field_is_refused_by_name() {
        for pointer in [
            "",
            "/views/0",
            "/views/0/passes_ms",
            "/views/0/without_depth_test",
            "/transitions/0",
            "/line",
            "/loading",
        ] {
            refuses_missing_fields(pointer);
        }
    }

    #[test]
    fn a_run_read_back_is_written_the_same() {
        let back: StreamRun = serde_json::from_value(run()).unwrap();
        assert_eq!(serde_json::to_value(back).unwrap(), run());
    }
}
