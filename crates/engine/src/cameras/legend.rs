//! The legend of a picture: what its colours mean, as text and for reports and windows.

use esker_render::inputs::colour::{Encoder, MapTable};
use esker_render::{ColourMap, Gradient};
use serde::{Serialize, Serializer};

/// Share of a range's extent by which the extent of its printed ends may differ.
const EXTENT_ERROR: f64 = 0.01;

/// What the colours of a picture mean.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Legend {
    /// Name of the attribute, or of another source of colours.
    pub name: String,
    /// Values of the first and the last colour; none if colours are not a range.
    pub range: Option<[f64; 2]>,
    /// Colours of the range.
    #[serde(rename = "palette", serialize_with = "serialize_name")]
    pub gradient: Option<Gradient>,
    /// Values with colours of their own.
    pub entries: Vec<LegendEntry>,
    /// Whether values are lengths in the unit of the file's horizontal coordinates; heights may
    /// have another unit.
    #[serde(skip)]
    pub is_length: bool,
    /// Why the colours may show little.
    pub note: Option<&'static str>,
}

/// A value with a colour of its own.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LegendEntry {
    /// The value.
    pub value: u32,
    /// What it means.
    pub name: String,
    /// Its colour, sRGB.
    pub rgb: [u8; 3],
}

impl Legend {
    pub(crate) fn named(name: &str) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// Ends of the range as text.
    pub fn range_text(&self) -> Option<[String; 2]> {
        self.range.map(ends)
    }

    /// `count` colours from the first value to the last, sRGB; empty without a gradient.
    pub fn bar(&self, count: usize) -> Vec<[u8; 3]> {
        let Some(gradient) = self.gradient else { return Vec::new() };
        let last = count.saturating_sub(1).max(1) as f64;
        let table = MapTable::new(&ColourMap { low: 0.0, high: last, gradient });
        (0..count).map(|i| srgb(table.at(i as f64))).collect()
    }

    /// The legend as a line of text.
    pub fn text(&self) -> String {
        let mut text = self.name.clone();
        if let Some([low, high]) = self.range_text() {
            text += &format!(" {low} .. {high}");
        }
        if let Some(gradient) = self.gradient {
            text += &format!(" ({})", gradient.name());
        }
        let entries: Vec<_> = self.entries.iter().map(LegendEntry::text).collect();
        if !entries.is_empty() {
            text += &format!(": {}", entries.join(", "));
        }
        if let Some(note) = self.note {
            text += &format!("; {note}");
        }
        text
    }
}

impl LegendEntry {
    fn text(&self) -> String {
        let [r, g, b] = self.rgb;
        format!("{} {} #{r:02x}{g:02x}{b:02x}", self.value, self.name)
    }
}

// Takes a reference to the field, as serde requires.
#[allow(clippy::ref_option, reason = "the signature is serde's")]
fn serialize_name<S: Serializer>(gradient: &Option<Gradient>, to: S) -> Result<S::Ok, S::Error> {
    gradient.map(Gradient::name).serialize(to)
}

/// Bytes of a linear colour in sRGB.
pub(crate) fn srgb(linear: glam::Vec3) -> [u8; 3] {
    Encoder::get().bytes(linear)
}

/// A number with no more digits than a legend needs.
pub(crate) fn short(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e15).contains(&value.abs()) {
        return format!("{value:.3e}");
    }
    let text = if value.abs() >= 1e7 { format!("{value:.1}") } else { format!("{value:.3}") };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Ends of a range, with enough digits to show its extent.
fn ends([low, high]: [f64; 2]) -> [String; 2] {
    let extent = high - low;
    let texts = [low, high].map(short);
    let printed = [0, 1].map(|i| texts[i].parse::<f64>().unwrap_or(f64::NAN));
    let is_exact = ((printed[1] - printed[0]) - extent).abs() <= extent.abs() * EXTENT_ERROR;
    if is_exact || !extent.is_finite() || printed.iter().any(|end| !end.is_finite()) {
        return texts;
    }
    let decimals = (2.0 - extent.abs().log10()).ceil().clamp(0.0, 17.0) as usize;
    [low, high].map(|end| format!("{end:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_legend_is_a_line_of_text() {
        let range = Legend {
            range: Some([1.5, 250.0]),
            gradient: Some(Gradient::Viridis),
            ..Legend::named("gps_time")
        };
        assert_eq!(range.text(), "gps_time 1.5 .. 250 (viridis)");
        let wide = Legend { range: Some([-1e-5, f64::MAX]), ..Legend::named("odd") };
        assert_eq!(wide.text(), "odd -1.000e-5 .. 1.798e308");
        let times = Legend { range: Some([3e8, 3e8 + 5e-5]), ..Legend::named("gps_time") };
        assert_eq!(times.text(), "gps_time 300000000.0000000 .. 300000000.0000500");
        let ids = Legend { range: Some([1e18, 1e18 + 4096.0]), ..Legend::named("id") };
        assert_eq!(ids.text(), "id 1000000000000000000 .. 1000000000000004096");
        let empty = Legend { note: Some("all values are zero"), ..Legend::named("nir") };
        assert_eq!(empty.text(), "nir; all values are zero");
        let ground = LegendEntry { value: 2, name: "ground".into(), rgb: [168, 124, 82] };
        let classes = Legend { entries: vec![ground], ..Legend::named("classification") };
        assert_eq!(classes.text(), "classification: 2 ground #a87c52");
    }
}
