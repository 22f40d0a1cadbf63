//! The benchmark of building. In each run all inputs are decoded, built by Esker and built by a
//! rival in turn, each in a process of its own, so that other work of the machine affects all
//! alike. Medians over the runs are reported; a program that fails has a row too.

mod child;
mod decode;
mod measure;
mod program;
mod report;
mod request;
mod rival;

pub use decode::{DecodeReport, decode, decode_text};
pub use measure::measure;
pub use report::{BuildBenchReport, failure, text};
pub use request::BuildBenchRequest;
pub use rival::Rival;
