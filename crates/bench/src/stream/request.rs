//! What the benchmark of streaming measures: files and scans, and how each is flown through.

use esker_engine::draw::session::{self, Options};
use esker_engine::machine::backend::DrawWith;
use esker_stream::Priority;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Files to measure, and how often.
#[derive(Clone, Debug)]
pub struct StreamBenchRequest {
    /// `.esker` files and scans.
    pub inputs: Vec<PathBuf>,
    /// How each of them is flown through.
    pub flight: FlightRequest,
    /// Whether each file is measured with the settings of the paper as well.
    pub paper_too: bool,
    /// Node capacities that scans are built with; that of `build` if the list is empty.
    pub capacities: Vec<u32>,
    /// How scans are built.
    pub build: esker_builder::Options,
    /// The `esker` program, which is started again for each run.
    pub program: PathBuf,
}

/// What is known of the line to a server.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Its rate, millions of bits a second.
    pub mbit_s: f64,
    /// Time from a request to its answer, milliseconds.
    pub round_trip_ms: f64,
}

/// How one file is flown through.
#[derive(Clone, Debug)]
pub struct FlightRequest {
    /// The camera's path; derived from the scan by default.
    pub path: Option<PathBuf>,
    /// What draws.
    pub with: DrawWith,
    /// Bytes of drawing memory; on a GPU those of all its buffers.
    pub budget_gpu_bytes: u64,
    /// Bytes of main memory.
    pub budget_ram_bytes: u64,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Whether hidden nodes are left out; if so, a flight that draws them is measured as well.
    pub occlusion: bool,
    /// Whether the file is removed from the system's cache before each flight.
    pub cold: bool,
    /// Settings of streaming.
    pub settings: Settings,
    /// Whether full planes are read although the file has compact ones.
    pub full: bool,
    /// Folder for a picture of each view.
    pub pictures: Option<PathBuf>,
    /// The line to the server of a file at an address; its first view is then measured beside what
    /// the line allows.
    pub line: Option<Line>,
    /// Threads that draw; 0 stands for one a core.
    pub threads: usize,
}

/// How much is lent, cached and read at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Settings {
    /// Esker's defaults.
    #[default]
    Own,
    /// `kanzok2015`, sections 3.2.3 to 3.2.5: five buffers in flight, one loader thread, the
    /// nearest node first, a cache of 2,000 nodes.
    Paper,
}

impl Settings {
    /// Name of the settings on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Paper => "paper",
        }
    }
}

impl FlightRequest {
    /// Options of the sessions that fly.
    pub(super) fn options(&self) -> Options {
        let own = Options {
            backend: self.with.backend,
            gpu: self.with.gpu,
            settings: session::Settings {
                budget_gpu_bytes: self.budget_gpu_bytes,
                budget_ram_bytes: self.budget_ram_bytes,
                occlusion: self.occlusion,
                full: self.full,
                ..session::Settings::default()
            },
            size: self.size,
            ..Options::default()
        };
        match self.settings {
            Settings::Own => own,
            Settings::Paper => Options {
                runs: Some(5),
                loaders: 1,
                priority: Priority::Distance,
                nodes_max: 2_000,
                ..own
            },
        }
    }
}
