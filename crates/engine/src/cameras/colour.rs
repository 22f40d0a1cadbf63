//! What gives points their colour: the name that the user gives becomes the renderer's map, the
//! plane that it needs and a legend, with the range of values from the user or from the statistics
//! ([`crate::cameras::ranges`]).

use crate::cameras::ranges;
use anyhow::{Context, Result, bail, ensure};
use esker_format::{Forest, ForestFilter, PlaneKind};
use esker_points::attribute::names;
use esker_points::filter::Classes;
use esker_points::{AttrType, Codes, Coding, Schema};
use esker_render::inputs::colour::{Encoder, MapTable, class_colour, hue};
use esker_render::{Codebook, ColourBy, ColourMap, Palette};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// Where the colours of a picture come from.
#[derive(Clone, Debug, PartialEq)]
pub struct Colouring {
    /// How values become colours.
    pub by: ColourBy,
    /// The plane that the frame needs for it, and the type of its values where they are scalars.
    pub plane: Option<(PlaneKind, Option<AttrType>)>,
    /// How its values become codes of a byte while they are loaded; as they are where not said.
    pub codes: Option<Codes>,
    /// What the colours mean.
    pub legend: Legend,
}

impl Colouring {
    /// The plane that positions come from: colours may come with them.
    pub fn positions(&self) -> PlaneKind {
        let plane = self.plane.map(|(kind, _)| kind).filter(|kind| kind.has_positions());
        plane.unwrap_or(PlaneKind::Position)
    }
}

/// What the colours of a picture mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Legend {
    /// What is shown.
    pub name: String,
    /// Values of the first and the last colour, where there is a range.
    pub range: Option<[f64; 2]>,
    /// The colours of a range.
    pub palette: Option<Palette>,
    /// Numbers, what they mean, and their colours (sRGB).
    pub entries: Vec<(u8, String, [u8; 3])>,
    /// Whether values are lengths in the file's unit, that of its horizontal coordinates: heights
    /// may have another one.
    pub is_length: bool,
    /// Why there may be little to see.
    pub note: Option<&'static str>,
}

impl Legend {
    fn named(name: &str) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// The ends of the range, in words.
    pub fn range_text(&self) -> Option<[String; 2]> {
        self.range.map(ends)
    }

    /// So many colours from the first value to the last, sRGB; none where there is no range of
    /// colours.
    pub fn bar(&self, count: usize) -> Vec<[u8; 3]> {
        let Some(palette) = self.palette else { return Vec::new() };
        let last = count.saturating_sub(1).max(1) as f64;
        let table = MapTable::new(&ColourMap { low: 0.0, high: last, palette });
        (0..count).map(|i| bytes(table.at(i as f64))).collect()
    }

    /// In words.
    pub fn text(&self) -> String {
        let mut text = self.name.clone();
        if let Some([low, high]) = self.range {
            let [low, high] = ends([low, high]);
            text += &format!(" {low} .. {high}");
        }
        if let Some(palette) = self.palette {
            text += &format!(" ({})", palette.name());
        }
        let entries = self.entries.iter();
        let entries: Vec<_> = entries
            .map(|(n, what, [r, g, b])| format!("{n} {what} #{r:02x}{g:02x}{b:02x}"))
            .collect();
        if !entries.is_empty() {
            text += &format!(": {}", entries.join(", "));
        }
        if let Some(note) = self.note {
            text += &format!("; {note}");
        }
        text
    }

    /// For machines.
    pub fn json(&self) -> Value {
        let entries = self.entries.iter();
        let entries: Vec<_> =
            entries.map(|(n, what, rgb)| json!({ "value": n, "name": what, "rgb": rgb })).collect();
        json!({
            "name": self.name, "range": self.range, "palette": self.palette.map(Palette::name),
            "entries": entries, "note": self.note,
        })
    }
}

/// A number with no more digits than a legend needs.
fn short(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e15).contains(&value.abs()) {
        return format!("{value:.3e}");
    }
    let text = if value.abs() >= 1e7 { format!("{value:.1}") } else { format!("{value:.3}") };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// The ends of a range, with as many digits as tell what lies between.
fn ends([low, high]: [f64; 2]) -> [String; 2] {
    let extent = high - low;
    let texts = [low, high].map(short);
    let told = [0, 1].map(|i| texts[i].parse::<f64>().unwrap_or(f64::NAN));
    let is_told = ((told[1] - told[0]) - extent).abs() <= extent.abs() * TOLD;
    if is_told || !extent.is_finite() || told.iter().any(|end| !end.is_finite()) {
        return texts;
    }
    let decimals = (2.0 - extent.abs().log10()).ceil().clamp(0.0, 17.0) as usize;
    [low, high].map(|end| format!("{end:.decimals$}"))
}

/// Share of a range's extent to which its ends tell it.
const TOLD: f64 = 0.01;

/// What the user asks for: `NAME`, or `NAME:MIN..MAX` with either end open.
#[derive(Clone, Debug, PartialEq)]
struct Wish<'a> {
    name: &'a str,
    range: [Option<f64>; 2],
}

impl<'a> Wish<'a> {
    fn parse(text: &'a str) -> Result<Self> {
        let plain = Self { name: text, range: [None; 2] };
        let Some((name, range)) = text.rsplit_once(':') else { return Ok(plain) };
        let Some((low, high)) = range.split_once("..") else { return Ok(plain) };
        let end = |word: &str| -> Result<Option<f64>> {
            if word.trim().is_empty() {
                return Ok(None);
            }
            let value = word.trim().parse().ok().filter(|v: &f64| v.is_finite());
            value.map(Some).with_context(|| {
                format!("`{word}` in `{text}` is no number; a range is given as NAME:MIN..MAX")
            })
        };
        let range = [end(low)?, end(high)?];
        if range[0].is_some() && range[0] == range[1] {
            bail!("the range of `{text}` has no extent; its ends are two numbers");
        }
        Ok(Self { name, range })
    }

    /// The range that is asked for, or else that which `find` gives.
    fn range(&self, find: impl FnOnce() -> Result<(f64, f64)>) -> Result<[f64; 2]> {
        if let [Some(low), Some(high)] = self.range {
            return Ok([low, high]);
        }
        let (low, high) = find()?;
        let range = [self.range[0].unwrap_or(low), self.range[1].unwrap_or(high)];
        let is_beyond = self.has_range() && range[0] > range[1];
        ensure!(
            !is_beyond,
            "all values of `{}` lie beyond that end of the range: they are {} .. {}; give both ends",
            self.name,
            short(low),
            short(high)
        );
        Ok(range)
    }

    fn has_range(&self) -> bool {
        self.range != [None; 2]
    }
}

/// The colouring of this name; the best that the file has where there is none: its colours, else
/// its intensity where it has no normals to be lit by, else elevation.
///
/// # Errors
/// Where the file has no such attribute, or what is asked for is no range.
pub fn colouring(file: &Forest, name: Option<&str>, bounds: [[f64; 3]; 2]) -> Result<Colouring> {
    colouring_of(file, name, bounds, &ForestFilter::default())
}

/// The same, with ranges of the points that are shown.
///
/// # Errors
/// As [`colouring`].
pub fn colouring_of(
    file: &Forest,
    name: Option<&str>,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<Colouring> {
    let Some(text) = name else {
        return if file.has(PlaneKind::Colour) && has_colours(file)? {
            colouring_of(file, Some("rgb"), bounds, shown)
        } else if file.has(PlaneKind::Normal) {
            colouring_of(file, Some("plain"), bounds, shown)
        } else {
            colouring_of(file, Some("elevation"), bounds, shown)
        };
    };
    let wish = Wish::parse(text)?;
    check_end(file, &wish, bounds, shown)?;
    // Capitals make no difference but between attributes.
    let is_attribute = file.schema().find(wish.name).is_some();
    let name = if is_attribute { wish.name.to_owned() } else { wish.name.to_ascii_lowercase() };
    let plain = |by, name| Colouring { by, plane: None, codes: None, legend: Legend::named(name) };
    let mapped = |by: fn(ColourMap) -> ColourBy, name, [low, high]: [f64; 2], palette| {
        let legend =
            Legend { range: Some([low, high]), palette: Some(palette), ..Legend::named(name) };
        Colouring { legend, ..plain(by(ColourMap { low, high, palette }), name) }
    };
    let without_range = |colouring| match wish.has_range() {
        true => bail!("`{}` has no range of values", wish.name),
        false => Ok(colouring),
    };
    match name.as_str() {
        "rgb" | "colour" | "color" if file.has(PlaneKind::Colour) => without_range(Colouring {
            plane: Some((PlaneKind::Colour, None)),
            legend: Legend { note: black(file)?, ..Legend::named("rgb") },
            ..plain(ColourBy::Rgb, "rgb")
        }),
        "rgb" | "colour" | "color" => {
            bail!("{}: has no colours; try --colour elevation", file.path().display())
        }
        "plain" | "none" => without_range(plain(ColourBy::Plain, "plain")),
        "elevation" | "z" | "height" => {
            let range = wish.range(|| ranges::of_heights(file, bounds, shown))?;
            Ok(mapped(ColourBy::Elevation, "elevation", range, Palette::Terrain))
        }
        "level" | "cell" | "node" => without_range(Colouring {
            legend: Legend { entries: cell_entries(file, shown), ..Legend::named("level") },
            ..plain(ColourBy::Cell, "level")
        }),
        "normal" | "normals" if !file.has(PlaneKind::Normal) => {
            bail!(
                "{}: has no normals; build it with --normals estimate, or try --colour elevation",
                file.path().display()
            )
        }
        "normal" | "normals" => without_range(plain(ColourBy::Normal, "normal")),
        "depth" => {
            let extent = (0..3).map(|i| (bounds[1][i] - bounds[0][i]).powi(2)).sum::<f64>();
            let range = wish.range(|| Ok((0.0, extent.sqrt())))?;
            let mut colouring = mapped(ColourBy::EyeDepth, "depth", range, Palette::Viridis);
            colouring.legend.is_length = true;
            Ok(colouring)
        }
        _ => attribute(file, &wish, shown),
    }
}

/// Refuses what is no attribute's name, but one with something behind it that is no range.
fn check_end(
    file: &Forest,
    wish: &Wish<'_>,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<()> {
    if let Some((name, end)) = wish.name.rsplit_once(':')
        && file.schema().find(wish.name).is_none()
        && colouring_of(file, Some(name), bounds, shown).is_ok()
    {
        bail!("`{end}` in `{}` is no range; a range is given as NAME:MIN..MAX", wish.name);
    }
    Ok(())
}

/// What to say of colours that are all black.
fn black(file: &Forest) -> Result<Option<&'static str>> {
    Ok((!has_colours(file)?).then_some("all of them are black"))
}

/// The sizes of cells that occur among what is shown, the largest first, in the scan's unit.
fn cell_entries(file: &Forest, shown: &ForestFilter) -> Vec<(u8, String, [u8; 3])> {
    let nodes = (0u32..).zip(&file.table().nodes);
    let kept = nodes.filter(|&(index, _)| shown.points_max(index) > 0);
    let sizes: BTreeSet<u8> = kept.map(|(_, node)| node.cell_log2).collect();
    let entry = |log2: u8| {
        let edge = f64::from(log2).exp2() * file.lattice().scale[0];
        (log2, format!("edge {}", short(edge)), bytes(hue(u32::from(log2))))
    };
    sizes.into_iter().rev().map(entry).collect()
}

/// What colours can come from, as the user names it: what every file has, then the attributes.
pub fn choices(file: &Forest) -> Vec<String> {
    let own = [("rgb", PlaneKind::Colour), ("normal", PlaneKind::Normal)];
    let own = own.into_iter().filter(|&(_, kind)| file.has(kind)).map(|(name, _)| name);
    let all = own.chain(["elevation", "depth", "level", "plain"]).map(str::to_owned);
    let attributes = file.schema().attributes.iter().enumerate();
    let attributes = attributes.filter(|&(i, a)| file.has(plane_of(&a.name, a.ty, i)));
    // Two numbers share its byte.
    let attributes = attributes.flat_map(|(_, a)| match a.key() {
        (names::RETURNS, AttrType::U8) => {
            vec![RETURN_NUMBER.to_owned(), NUMBER_OF_RETURNS.to_owned()]
        }
        (name, _) => vec![name.to_owned()],
    });
    all.chain(attributes).collect()
}

/// Whether any colour differs from black: many LAS files have the fields and nothing in them.
fn has_colours(file: &Forest) -> Result<bool> {
    let colours = [names::RED, names::GREEN, names::BLUE];
    for file in file.files() {
        let statistics = file.statistics()?;
        let attributes = file.metadata().schema.attributes.iter().enumerate();
        let mut indices = attributes.filter(|(_, a)| colours.contains(&a.name.as_str()));
        if indices.any(|(i, _)| statistics.histograms().ranges().of(i).1 > 0.0) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The plane that tells the points of one scan from those of another, and how its values become
/// codes.
///
/// # Errors
/// Where no attribute does.
pub fn scans(file: &Forest) -> Result<(PlaneKind, Codes)> {
    let schema = file.schema();
    let found = SCANS.iter().find_map(|name| {
        let index = schema.find(name)?;
        let ty = schema.attributes[index].ty;
        let kind = plane_of(name, ty, index);
        file.has(kind).then_some((kind, Codes { ty, coding: Coding::Labels }))
    });
    found.with_context(|| {
        let path = file.path().display();
        format!(
            "{path}: exposures are evened out where {} tells scans apart; it has none of these",
            SCANS.join(" or ")
        )
    })
}

/// Attributes that tell scans apart, the first that a file has.
pub const SCANS: [&str; 3] = [names::POINT_SOURCE_ID, "scan", "scan_id"];
/// The number of a return, which shares its byte with the number of returns.
const RETURN_NUMBER: &str = "return_number";
const RETURN_NUMBER_MASK: u8 = 15;
const NUMBER_OF_RETURNS: &str = "number_of_returns";
const NUMBER_OF_RETURNS_SHIFT: u8 = 4;
/// Those that most scanners tell.
const RETURN_NUMBERS: (f64, f64) = (1.0, 5.0);
/// Short names of attributes.
const SHORT: [(&str, &str); 4] = [
    ("class", names::CLASSIFICATION),
    ("source", names::POINT_SOURCE_ID),
    ("source_id", names::POINT_SOURCE_ID),
    ("time", names::GPS_TIME),
];

/// The plane that an attribute has, where it has one of its own.
pub(crate) fn plane_of(name: &str, ty: AttrType, index: usize) -> PlaneKind {
    if name == names::INTENSITY && ty == AttrType::U16 {
        PlaneKind::Intensity
    } else {
        PlaneKind::Attribute(index as u16)
    }
}

/// The attribute of this name, whatever letters are capitals.
fn find_in_any_case(schema: &Schema, name: &str) -> Option<usize> {
    schema.attributes.iter().position(|a| a.name.eq_ignore_ascii_case(name))
}

fn attribute(file: &Forest, wish: &Wish<'_>, shown: &ForestFilter) -> Result<Colouring> {
    let schema = file.schema();
    let is_number = ["return", RETURN_NUMBER].iter().any(|n| n.eq_ignore_ascii_case(wish.name));
    let is_count = NUMBER_OF_RETURNS.eq_ignore_ascii_case(wish.name);
    let name = if is_number || is_count { names::RETURNS } else { wish.name };
    let full = SHORT
        .iter()
        .find(|(short, _)| short.eq_ignore_ascii_case(name))
        .map_or(name, |(_, full)| full);
    let found = schema.find(name).or_else(|| find_in_any_case(schema, name));
    let Some(index) = found.or_else(|| schema.find(full)) else {
        let (path, known) = (file.path().display(), choices(file).join(", "));
        bail!("{path}: has no attribute `{}`; it has {known}", wish.name);
    };
    let attribute = &schema.attributes[index];
    let (name, ty) = (attribute.name.as_str(), attribute.ty);
    let kind = plane_of(name, ty, index);
    if !file.has(kind) {
        bail!("{}: `{name}` is a part of the colour; use --colour rgb", file.path().display());
    }
    let whole = ranges::whole(file, index)?;
    let note = match whole {
        Some((0.0, 0.0)) => Some("all values are zero"),
        None if file.points() > 0 => Some("no value is a number"),
        _ => None,
    };
    let coded = |book, coding, entries| {
        let legend = Legend { entries, note, ..Legend::named(wish.name) };
        let codes = Some(Codes { ty, coding });
        let plane = Some((kind, Some(AttrType::U8)));
        Ok(Colouring { by: ColourBy::Codes(book), plane, codes, legend })
    };
    if ty == AttrType::U8 && !wish.has_range() {
        if name == names::CLASSIFICATION {
            let whole = Coding::Bits { shift: 0, mask: u8::MAX };
            return coded(Codebook::Classes, whole, class_entries(file, shown)?);
        }
        if name == names::RETURNS && is_number {
            let coding = Coding::Bits { shift: 0, mask: RETURN_NUMBER_MASK };
            let entries = label_entries("return", &ranges::bytes_of(file, index)?, coding);
            return coded(Codebook::Labels, coding, entries);
        }
    }
    if name == names::RETURNS && is_count && ty == AttrType::U8 {
        ensure!(!wish.has_range(), "`{NUMBER_OF_RETURNS}` has no range of values");
        let coding = Coding::Bits { shift: NUMBER_OF_RETURNS_SHIFT, mask: RETURN_NUMBER_MASK };
        let entries = label_entries("returns", &ranges::bytes_of(file, index)?, coding);
        return coded(Codebook::Labels, coding, entries);
    }
    if name == names::POINT_SOURCE_ID && !wish.has_range() {
        let colouring = coded(Codebook::Labels, Coding::Labels, Vec::new())?;
        let legend = Legend { range: whole.map(<[f64; 2]>::from), ..colouring.legend };
        return Ok(Colouring { legend, ..colouring });
    }
    if is_number && ty == AttrType::U8 {
        let range = wish.range(|| Ok(RETURN_NUMBERS))?;
        let [low, high] = range;
        let palette = Palette::Viridis;
        let coding = Coding::BitsAlong { mask: RETURN_NUMBER_MASK, low, high };
        let colouring = coded(Codebook::Along(palette), coding, Vec::new())?;
        let palette = Some(palette);
        let legend = Legend { range: Some(range), palette, note, ..Legend::named(RETURN_NUMBER) };
        return Ok(Colouring { legend, ..colouring });
    }
    // Extra bytes are shown scaled; the plane has what is stored.
    let scale = match schema.shown_scale(index) {
        0.0 => 1.0,
        scale => scale,
    };
    let show = |stored: f64| stored * scale + attribute.offset;
    let range = wish.range(|| {
        let (low, high) = ranges::of_attribute(file, index, shown)?;
        Ok((show(low), show(high)))
    })?;
    let [low, high] = range.map(|value| (value - attribute.offset) / scale);
    let palette = if kind == PlaneKind::Intensity { Palette::Grey } else { Palette::Viridis };
    let legend = Legend { range: Some(range), palette: Some(palette), note, ..Legend::named(name) };
    if kind == PlaneKind::Intensity {
        // A hot plane goes to drawing memory as it is.
        let by = ColourBy::Scalar(ColourMap { low, high, palette });
        return Ok(Colouring { by, plane: Some((kind, Some(ty))), codes: None, legend });
    }
    let colouring = coded(Codebook::Along(palette), Coding::Along { low, high }, Vec::new())?;
    Ok(Colouring { legend, ..colouring })
}

/// The labels that are coded from the bytes that occur.
fn label_entries(what: &str, values: &[u8], coding: Coding) -> Vec<(u8, String, [u8; 3])> {
    let labels: BTreeSet<u8> = Codes { ty: AttrType::U8, coding }.of(values).into_iter().collect();
    let entry = |n: u8| (n, what.to_owned(), bytes(hue(u32::from(n))));
    labels.into_iter().map(entry).collect()
}

fn bytes(linear: glam::Vec3) -> [u8; 3] {
    Encoder::get().bytes(linear)
}

/// The classes that occur among what is shown.
fn class_entries(forest: &Forest, shown: &ForestFilter) -> Result<Vec<(u8, String, [u8; 3])>> {
    let (mut bits, mut first) = ([0u64; 4], 0);
    for file in forest.files() {
        let statistics = file.statistics()?;
        let nodes = file.table().nodes.len() as u32;
        for node in (0..nodes).filter(|node| shown.points_max(first + node) > 0) {
            let own = statistics.own_classes(node).unwrap_or_default();
            bits.iter_mut().zip(own).for_each(|(all, own)| *all |= own);
        }
        first += nodes;
    }
    let occurs = |class: &u8| {
        bits[usize::from(class >> 6)] >> (class & 63) & 1 == 1 && shown.wants_class(*class)
    };
    let entry = |class: u8| {
        let name = Classes::name(class).unwrap_or("class").to_owned();
        (class, name, bytes(class_colour(class)))
    };
    Ok((0..=u8::MAX).filter(occurs).map(entry).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wish_is_a_name_and_perhaps_a_range() {
        let wish = |text| Wish::parse(text).map(|w| (w.name.to_owned(), w.range));
        assert_eq!(wish("intensity").unwrap(), ("intensity".into(), [None; 2]));
        let both = ("gps_time".into(), [Some(-1.5), Some(2e3)]);
        assert_eq!(wish("gps_time:-1.5..2e3").unwrap(), both);
        assert_eq!(wish("z:..7").unwrap(), ("z".into(), [None, Some(7.0)]));
        assert_eq!(wish("z:7..").unwrap(), ("z".into(), [Some(7.0), None]));
        assert_eq!(wish("odd:name").unwrap().0, "odd:name");
        for wrong in ["z:a..7", "z:1..nan"] {
            assert!(wish(wrong).unwrap_err().to_string().contains("MIN..MAX"), "{wrong}");
        }
        assert!(wish("z:5..5").unwrap_err().to_string().contains("no extent"));
    }

    #[test]
    fn a_legend_is_words() {
        let range = Legend {
            range: Some([1.5, 250.0]),
            palette: Some(Palette::Viridis),
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
        let entries = vec![(2, "ground".to_owned(), [168, 124, 82])];
        let classes = Legend { entries, ..Legend::named("classification") };
        assert_eq!(classes.text(), "classification: 2 ground #a87c52");
    }
}
