//! What the benchmark of building measures.

use crate::build::rival::Rival;
use std::ffi::OsString;
use std::path::PathBuf;

/// Scans to build, and with what.
#[derive(Clone, Debug)]
pub struct BuildBenchRequest {
    /// Scans; each is built by itself.
    pub inputs: Vec<PathBuf>,
    /// The rival, if there is one.
    pub rival: Option<Rival>,
    /// Runs whose median is reported.
    pub runs: usize,
    /// Folder for all outputs and scratch files; the system's by default.
    pub folder: Option<PathBuf>,
    /// Further arguments of `esker build`.
    pub build_arguments: Vec<OsString>,
    /// Further arguments of `esker bench decode`.
    pub decode_arguments: Vec<OsString>,
    /// The `esker` program, which is started again for each measurement.
    pub esker: PathBuf,
}
