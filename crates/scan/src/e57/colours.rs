//! Ranges of the colours of an E57 file. Each scan gives its own range, by limits or by value
//! types.

use super::values::{NumberType, real};
use e57::{PointCloud, Record, RecordDataType as Kind, RecordName as Name, RecordValue as Value};
use esker_points::AttrType;

/// Whether a value is a colour.
pub(crate) fn is_colour(name: &Name) -> bool {
    matches!(name, Name::ColorRed | Name::ColorGreen | Name::ColorBlue)
}

/// Black and white of a colour: the scan's limits, else the value's own range; `None` if neither is
/// given.
pub(crate) fn colour_range(cloud: &PointCloud, record: &Record) -> Option<[f64; 2]> {
    let kind = &record.data_type;
    let limits = cloud.color_limits.as_ref().and_then(|l| {
        let [low, high] = match record.name {
            Name::ColorRed => [&l.red_min, &l.red_max],
            Name::ColorGreen => [&l.green_min, &l.green_max],
            _ => [&l.blue_min, &l.blue_max],
        };
        Some([real(low.as_ref()?, kind), real(high.as_ref()?, kind)])
    });
    let own = match *kind {
        Kind::Single { min, max } => min.zip(max).map(|(min, max)| [min.into(), max.into()]),
        Kind::Double { min, max } => min.zip(max).map(|(min, max)| [min, max]),
        // Without explicit bounds, the crate `e57` gives the bounds of the integer type.
        Kind::Integer { min, max } | Kind::ScaledInteger { min, max, .. } => {
            let is_bounded = max.checked_sub(min).is_some_and(|range| range <= u32::MAX.into());
            let ends = [Value::ScaledInteger(min), Value::ScaledInteger(max)];
            is_bounded.then(|| ends.map(|end| real(&end, kind)))
        }
    };
    let is_range = |[low, high]: &[f64; 2]| (high - low).is_finite() && low < high;
    // Limits are often the least and greatest colours that occur; they mean nothing for bytes.
    let own = own.filter(is_range);
    if NumberType::of(kind).ty() == AttrType::U8 { own } else { limits.filter(is_range).or(own) }
}

/// How colours are stored.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Colours {
    /// Unchanged: bytes, or 16 bits from black to white in every scan.
    Whole(AttrType),
    /// Scaled from their range to 16 bits.
    Scaled,
}

impl Colours {
    pub fn of(clouds: &[PointCloud]) -> Self {
        let all = || {
            clouds.iter().flat_map(|cloud| {
                let colours = cloud.prototype.iter().filter(|record| is_colour(&record.name));
                colours.map(move |record| (cloud, record))
            })
        };
        let is_byte = |(_, record): (&PointCloud, &Record)| {
            NumberType::of(&record.data_type).ty() == AttrType::U8
        };
        let is_wide = |(cloud, record): (&PointCloud, &Record)| {
            let is_whole = NumberType::of(&record.data_type).ty() == AttrType::U16;
            is_whole && colour_range(cloud, record) == Some([0.0, f64::from(u16::MAX)])
        };
        if all().all(is_byte) {
            Self::Whole(AttrType::U8)
        } else if all().all(is_wide) {
            Self::Whole(AttrType::U16)
        } else {
            Self::Scaled
        }
    }
}
