//! The benchmark of streaming (`kanzok2015`, section 4): flies a camera along a path through
//! `.esker` files and scans, and reports nodes, points, times, bytes and memory against the
//! budgets. From a request (`request`) to runs in processes of their own (`process`, `run`), to a
//! report (`report`) and a table (`table`).

mod disk;
mod flight;
mod line;
mod process;
mod report;
mod request;
mod run;
mod table;

pub use process::measure;
pub use report::StreamReport;
pub use request::{FlightRequest, Line, Settings, StreamBenchRequest};
pub use table::text;
