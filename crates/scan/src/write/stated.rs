//! What the sources of an export state beside their points: coordinate reference system, epoch of
//! GPS times, no-data values. Text has no place for these and PLY only comments, so notes name what
//! is not written.

use super::encode::Origin;
use super::scaling::Scaling;
use crate::las::{GpsTimes, NoData, gps_times};
use crate::source::Crs;
use esker_points::attribute::names;
use esker_points::{AttrType, Schema};

/// Greatest length of the name of a reference system in a note, in characters.
const NAME_LETTERS: usize = 80;

/// What sources state, added one by one.
#[derive(Default)]
pub struct Stated {
    /// The first coordinate reference system.
    pub crs: Option<Crs>,
    times: Option<GpsTimes>,
    have_other_times: bool,
    no_data: NoData,
}

impl Stated {
    /// Adds what a source states.
    pub fn add(&mut self, origin: &Origin) {
        let is_better = |crs: &&Crs| {
            self.crs.as_ref().is_none_or(|own| own.text.is_empty() && !crs.text.is_empty())
        };
        if let Some(crs) = origin.crs.as_ref().filter(is_better) {
            self.crs = Some(crs.clone());
        }
        if let Some(times) = gps_times(&origin.verbatim) {
            self.have_other_times |= *self.times.get_or_insert(times) != times;
        }
        self.no_data.add(&origin.verbatim);
    }

    /// The epoch of GPS times, if points have such times and the sources agree.
    pub fn times(&self, schema: &Schema) -> Option<GpsTimes> {
        let has_times = schema.find_typed(names::GPS_TIME, AttrType::F64).is_some();
        self.times.filter(|_| has_times && !self.have_other_times)
    }

    /// The stored no-data value of an attribute, if its sources agree.
    pub fn no_data(&self, schema: &Schema, attribute: usize) -> Option<&[u8]> {
        let attribute = &schema.attributes[attribute];
        self.no_data.of(attribute).filter(|value| value.len() == attribute.ty.size())
    }

    /// A note on the reference system, where it is not written; of PLY, which has a comment for
    /// its text, a note on a unit without text.
    pub fn crs_note(&self, is_written: bool) -> Option<String> {
        let crs = self.crs.as_ref()?;
        if crs.text.is_empty() {
            let unit = crs.unit.as_ref()?;
            return Some(format!("this format does not state the unit of length, {unit}"));
        }
        let quoted = crs.text.split('"').nth(1).filter(|_| !crs.text.starts_with("GeoTIFF"));
        let name: String = quoted.unwrap_or(&crs.text).chars().take(NAME_LETTERS).collect();
        (!is_written)
            .then(|| format!("text does not state the coordinate reference system, {name}"))
    }

    /// A note on the epoch of GPS times, unless the format states it.
    pub fn times_note(&self, schema: &Schema, is_written: bool) -> Option<String> {
        schema.find_typed(names::GPS_TIME, AttrType::F64)?;
        let times = self.times?;
        if self.have_other_times {
            let what = "GPS times have different epochs, which this format does not state";
            return Some(what.into());
        }
        let what = match times {
            GpsTimes::Week => "seconds of a week",
            GpsTimes::Adjusted => "adjusted standard time",
        };
        (!is_written).then(|| format!("text does not state that GPS times are {what}"))
    }

    /// Notes on no-data values: `how` they are written, and for which attributes.
    pub fn no_data_notes(&self, schema: &Schema, how: &str) -> Vec<String> {
        let all = (0..schema.attributes.len()).filter_map(|at| {
            let mut text = schema.attributes[at].name.clone().into_bytes();
            let stored = self.no_data(schema, at)?;
            text.extend(b" (");
            Scaling::of(schema, at).text(stored, &mut text);
            text.push(b')');
            Some(String::from_utf8_lossy(&text).into_owned())
        });
        let all: Vec<String> = all.collect();
        let known = (!all.is_empty()).then(|| format!("{how}: {}", all.join(", ")));
        known
            .into_iter()
            .chain(conflict_note(&self.no_data, "they are written as numbers"))
            .collect()
    }
}

/// A note on attributes for which sources state different no-data values.
pub fn conflict_note(no_data: &NoData, what: &str) -> Option<String> {
    let conflicts = no_data.conflicts();
    (!conflicts.is_empty()).then(|| {
        format!("sources state different no-data values, {what}: {}", conflicts.join(", "))
    })
}
