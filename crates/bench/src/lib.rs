//! Benchmarks as calls: what they measure is what programs do, through the same calls, and their reports
//! are for machines (JSON) and for people.

pub mod build;
pub mod disk;
pub mod draw;
pub mod flight;
pub mod leave_out;
pub mod process;
pub mod render;
pub mod report;
pub mod size;
pub mod splats;
pub mod stream;

/// The benchmarks that there are, with what each measures.
pub const BENCHMARKS: [(&str, &str); 7] = [
    (
        "build",
        "builds scans, beside a rival program: seconds, CPU time, memory, scratch space, bytes out",
    ),
    ("decode", "reads scans and drops their points: the floor of building"),
    (
        "stream",
        "flies a camera through a scan: nodes, points, times, bytes and memory against the budgets",
    ),
    (
        "draw",
        "draws points that lie in memory: million points a second, and the share of memory bandwidth",
    ),
    (
        "render",
        "draws models whole, by every method and backend: table 1 of marroquim2007, and the floor of copying",
    ),
    (
        "leave-out",
        "draws a scene with and without each thing that it can do without: bytes and times",
    ),
    (
        "size",
        "draws a scene from smaller planes: error of the picture, of places, colours and normals, against bytes",
    ),
];
