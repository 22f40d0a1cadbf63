//! GPS times of inputs can be counted from different beginnings (seconds of a week, or adjusted
//! standard time). They are kept unchanged, each with its source's global encoding, but cannot be
//! compared; a note says so.

use esker_scan::las::GpsTimes;

/// A note on the first two sources, by path, whose GPS times cannot be compared.
pub fn note_different(
    sources: impl IntoIterator<Item = (String, Option<GpsTimes>)>,
) -> Option<String> {
    let mut known = sources.into_iter().filter_map(|(path, times)| Some((path, times?)));
    let (first, times) = known.next()?;
    let (other, other_times) = known.find(|(_, other)| *other != times)?;
    Some(format!(
        "{first} and {other} count GPS times from different beginnings ({} and {}): values are as they were, and don't compare",
        times.name(),
        other_times.name()
    ))
}
