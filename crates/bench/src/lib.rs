//! Benchmarks as calls. A benchmark takes a request, runs what the programs run, through the same
//! calls, and returns a report: a serialisable type for machines, and a function `text` that writes
//! it for people.

pub mod build;
pub mod draw;
pub mod error_time;
pub mod leave_out;
mod pass_times;
mod quantile;
pub mod render;
pub mod size;
pub mod splats;
pub mod stability;
pub mod stream;
#[cfg(feature = "light")]
pub mod trace;

/// Name of each benchmark, and what it does.
pub const BENCHMARKS: &[(&str, &str)] = &[
    (
        "build",
        "builds scans, beside a rival program: seconds, CPU time, memory, scratch space, bytes written",
    ),
    ("decode", "reads scans and discards their points: the least time that building can take"),
    (
        "stream",
        "flies a camera through a scan: nodes, points, times, bytes and memory against the budgets",
    ),
    (
        "draw",
        "draws points that are in memory: million points a second, and the share of memory bandwidth",
    ),
    (
        "render",
        "draws models whole, by every method and backend: table 1 of marroquim2007, beside plain copies",
    ),
    (
        "leave-out",
        "draws a scene with and without each thing that it can do without: bytes and times",
    ),
    (
        "error-time",
        "draws scans by every method and setting: error of the picture against the time of a frame",
    ),
    (
        "stability",
        "changes scans as must not change pictures, and makes conditions worse until bounds break",
    ),
    (
        "size",
        "draws a scene from smaller planes: error of picture, positions, colours and normals, against bytes",
    ),
    #[cfg(feature = "light")]
    (
        "trace",
        "traces light in meshes and scans: tables 1 and 2 and figures of bauszat2011, errors of filters",
    ),
];
