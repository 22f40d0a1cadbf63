//! Error against run time: draws a scan by every method and with every setting that trades quality
//! for time, and compares each picture with one of all points at twice the resolution.
//!
//! [`settings`] lists what is varied; [`mod@reference`] and [`analytic`] make what pictures are
//! compared with, [`perfect`]; [`compare`] has the errors, [`measure`] runs the rounds, [`report`]
//! finds the settings of least error at their time, and [`page`] writes the page about a scan.
//! [`streaming`] measures the error of frames while a file is loaded, [`lit`] that of traced light.

pub(crate) mod analytic;
mod budgets;
mod columns;
pub(crate) mod compare;
mod lit;
mod measure;
mod page;
pub(crate) mod perfect;
mod plot;
mod reference;
mod report;
mod row;
mod settings;
mod streaming;

pub use measure::{ErrorTimeRequest, measure};
pub use report::{ErrorTimeReport, text};
