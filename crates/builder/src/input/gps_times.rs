//! GPS times of inputs that are counted from different beginnings, seconds of a week and adjusted
//! standard ones, are kept as they are, each with its source's global encoding; but they don't
//! compare, which is told.

use esker_scan::las::GpsTimes;

/// A line about the first two sources, by path, whose GPS times don't compare.
pub fn mixed(sources: impl IntoIterator<Item = (String, Option<GpsTimes>)>) -> Option<String> {
    let mut told = sources.into_iter().filter_map(|(path, times)| Some((path, times?)));
    let (first, times) = told.next()?;
    let (other, other_times) = told.find(|(_, other)| *other != times)?;
    Some(format!(
        "{first} and {other} count GPS times from different beginnings ({} and {}): values are as they were, and don't compare",
        times.name(),
        other_times.name()
    ))
}
