//! Where points get their colours from: turns the name that the user gives into the renderer's
//! colour map, the plane that it needs, and a legend. Ranges of values come from the user or from
//! the statistics ([`crate::cameras::ranges`]).

use crate::cameras::classes::{ClassCount, occurring};
use crate::cameras::colour_request::ColourRequest;
use crate::cameras::legend::{Legend, LegendEntry, short, srgb};
use crate::cameras::places::central_range;
use crate::cameras::ranges::{self, plane_of};
use crate::cameras::vertical::{AXES, Vertical};
use anyhow::{Context, Result, bail, ensure};
use esker_format::{Forest, ForestFilter, Normals, PlaneKind};
use esker_lod::View;
use esker_points::attribute::names;
use esker_points::codes::LABELS;
use esker_points::filter::Classes;
use esker_points::named::{
    NUMBER_OF_RETURNS, NUMBER_OF_RETURNS_SHIFT, NamedAttribute, Part, RETURN_NUMBER,
    RETURN_NUMBER_MASK,
};
use esker_points::{AttrType, Attribute, Codes, Coding};
use esker_render::inputs::colour::{class_colour, hue};
use esker_render::{Codebook, ColourBy, ColourMap, Gradient};
use std::collections::BTreeSet;

/// Attributes whose values differ between scans; the first one that a file has is used.
pub const SCANS: [&str; 3] = [names::POINT_SOURCE_ID, "scan", "scan_id"];
/// Most sources that a legend names.
const SOURCES_MAX: usize = 64;
/// Return numbers that most scanners record.
const RETURN_NUMBERS: (f64, f64) = (1.0, 5.0);

/// Where the colours of a picture come from.
#[derive(Clone, Debug, PartialEq)]
pub struct Colouring {
    /// How values become colours.
    pub by: ColourBy,
    /// Plane that the frame needs, and the type of its values if they are scalars.
    pub plane: Option<(PlaneKind, Option<AttrType>)>,
    /// How values become codes of a byte when they are loaded; none if they stay as they are.
    pub codes: Option<Codes>,
    /// Meaning of the colours.
    pub legend: Legend,
}

impl Colouring {
    /// Plane that positions come from: compact planes have colours with the positions.
    pub fn positions(&self) -> PlaneKind {
        let plane = self.plane.map(|(kind, _)| kind).filter(|kind| kind.has_positions());
        plane.unwrap_or(PlaneKind::Position)
    }

    /// Colours that need no plane.
    fn plain(by: ColourBy, name: &str) -> Self {
        Self { by, plane: None, codes: None, legend: Legend::named(name) }
    }

    /// Colours of a range of values that need no plane.
    fn mapped(
        by: fn(ColourMap) -> ColourBy,
        name: &str,
        [low, high]: [f64; 2],
        gradient: Gradient,
    ) -> Self {
        let legend =
            Legend { range: Some([low, high]), gradient: Some(gradient), ..Legend::named(name) };
        Self { legend, ..Self::plain(by(ColourMap { low, high, gradient }), name) }
    }

    /// Colours along another gradient.
    ///
    /// # Errors
    /// If the colours are not along a range of values.
    fn along(mut self, gradient: Gradient) -> Result<Self> {
        match &mut self.by {
            ColourBy::Coordinate(_, map) | ColourBy::EyeDepth(map) | ColourBy::Scalar(map) => {
                map.gradient = gradient;
            }
            ColourBy::Codes(Codebook::Along(own)) => *own = gradient,
            _ => bail!(
                "`{}` has no colour map, since its colours are not along a range of values",
                self.legend.name
            ),
        }
        self.legend.gradient = Some(gradient);
        Ok(self)
    }

    /// Whether colours are those of depths.
    pub(crate) fn is_by_depth(&self) -> bool {
        matches!(self.by, ColourBy::EyeDepth(_))
    }

    /// Fits the range of colours by depth to the depths of a box in a view, unless the request
    /// names a range. Other colours stay as they are. Depths of a parallel view count from its eye,
    /// which is its near plane.
    pub(crate) fn seen(self, view: &View, bounds: [[f64; 3]; 2], requested: Option<&str>) -> Self {
        let ColourBy::EyeDepth(map) = self.by else { return self };
        let has_range = |text| ColourRequest::parse(text).is_ok_and(|r| r.has_range());
        let from = view.parallel_at.map_or(0.0, |_| view.near);
        if requested.is_some_and(has_range) {
            let map = ColourMap { low: map.low + from, high: map.high + from, ..map };
            return Self { by: ColourBy::EyeDepth(map), ..self };
        }
        let corners = (0..8).map(|i| [0, 1, 2].map(|axis| bounds[i >> axis & 1][axis]));
        let depths = corners.map(|corner| view.depth(corner.into()).max(view.near));
        let (low, high) =
            depths.fold((f64::INFINITY, 0.0), |(a, b), d| (f64::min(a, d), f64::max(b, d)));
        let by = ColourBy::EyeDepth(ColourMap { low, high, ..map });
        let range = Some([low - from, high - from]);
        Self { by, legend: Legend { range, ..self.legend }, ..self }
    }
}

/// The colouring that `name` requests, with elevations along z. Without a name, the best that the
/// file has: its colours, or plain if the scans have normals, or elevation.
///
/// # Errors
/// If the file has no such attribute, or the range is invalid.
pub fn colouring(file: &Forest, name: Option<&str>, bounds: [[f64; 3]; 2]) -> Result<Colouring> {
    filtered_colouring(file, name, Vertical::default(), bounds, &ForestFilter::default())
}

/// The colouring that `name` requests, with elevations along `vertical` and ranges of the points
/// that `shown` accepts.
///
/// # Errors
/// As for [`colouring`].
pub(crate) fn filtered_colouring(
    file: &Forest,
    name: Option<&str>,
    vertical: Vertical,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<Colouring> {
    let Some(text) = name else {
        return if file.has(PlaneKind::Colour) && has_colours(file)? {
            filtered_colouring(file, Some("rgb"), vertical, bounds, shown)
        } else if file.files().any(|tree| tree.layout().normals() == Normals::Source) {
            filtered_colouring(file, Some("plain"), vertical, bounds, shown)
        } else {
            filtered_colouring(file, Some("elevation"), vertical, bounds, shown)
        };
    };
    let request = ColourRequest::parse(text)?;
    check_name(file, &request, bounds, shown)?;
    let colouring = named_colouring(file, &request, vertical, bounds, shown)?;
    request.gradient.map_or(Ok(colouring.clone()), |gradient| colouring.along(gradient))
}

/// The colouring of a request, with the colour map that suits it.
fn named_colouring(
    file: &Forest,
    request: &ColourRequest<'_>,
    vertical: Vertical,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<Colouring> {
    // Names of attributes alone are case-sensitive.
    let is_attribute = file.schema().find(request.name).is_some();
    let name =
        if is_attribute { request.name.to_owned() } else { request.name.to_ascii_lowercase() };
    let without_range = |colouring| match request.has_range() {
        true => bail!("`{}` has no range of values", request.name),
        false => Ok(colouring),
    };
    match name.as_str() {
        "rgb" | "colour" | "color" if file.has(PlaneKind::Colour) => without_range(Colouring {
            plane: Some((PlaneKind::Colour, None)),
            legend: Legend { note: black_note(file)?, ..Legend::named("rgb") },
            ..Colouring::plain(ColourBy::Rgb, "rgb")
        }),
        "rgb" | "colour" | "color" => {
            bail!("{}: has no colours; try --colour elevation", file.path().display())
        }
        "plain" | "none" => without_range(Colouring::plain(ColourBy::Plain, "plain")),
        "elevation" | "height" => along(file, request, vertical, &vertical.name(), bounds, shown),
        "x" | "y" | "z" if !is_attribute => {
            let axis = AXES.iter().position(|axis| *axis == name).unwrap_or(2);
            let vertical = Vertical { axis, is_down: false };
            along(file, request, vertical, &name, bounds, shown)
        }
        "level" | "cell" | "node" => without_range(Colouring {
            legend: Legend { entries: cell_entries(file, shown)?, ..Legend::named("level") },
            ..Colouring::plain(ColourBy::Cell, "level")
        }),
        "normal" | "normals" if !file.has(PlaneKind::Normal) => {
            bail!(
                "{}: has no normals; build it with --normals fast, or try --colour elevation",
                file.path().display()
            )
        }
        "normal" | "normals" => without_range(Colouring::plain(ColourBy::Normal, "normal")),
        "depth" => {
            let extent = (0..3).map(|i| (bounds[1][i] - bounds[0][i]).powi(2)).sum::<f64>();
            let range = request.range(|| Ok((0.0, extent.sqrt())))?;
            let mut colouring =
                Colouring::mapped(ColourBy::EyeDepth, "depth", range, Gradient::Viridis);
            colouring.legend.is_length = true;
            Ok(colouring)
        }
        _ => AttributeColours::find(file, request, shown)?.colouring(),
    }
}

/// Colours by the coordinate along `vertical`, called `name` in the legend.
fn along(
    file: &Forest,
    request: &ColourRequest<'_>,
    vertical: Vertical,
    name: &str,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<Colouring> {
    // Ranges are of the scan's coordinates, colours of those on the metric lattice.
    let axis = vertical.axis;
    let factor = file.lattice().factor[axis];
    let range = request.range(|| {
        let (low, high) = central_range(file, bounds, shown, axis, ranges::STRAYS)?;
        let [low, high] = vertical.turned([low / factor, high / factor]);
        Ok((low, high))
    })?;
    let [low, high] = vertical.coordinates(range).map(|coordinate| coordinate * factor);
    let gradient = Gradient::Terrain;
    let by = ColourBy::Coordinate(axis, ColourMap { low, high, gradient });
    let legend = Legend { range: Some(range), gradient: Some(gradient), ..Legend::named(name) };
    Ok(Colouring { legend, ..Colouring::plain(by, name) })
}

/// Refuses `NAME:SOMETHING` where NAME is a source of colours and SOMETHING is no range.
fn check_name(
    file: &Forest,
    request: &ColourRequest<'_>,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<()> {
    if let Some((name, end)) = request.name.rsplit_once(':')
        && file.schema().find(request.name).is_none()
        && filtered_colouring(file, Some(name), Vertical::default(), bounds, shown).is_ok()
    {
        let maps = Gradient::ALL.map(Gradient::name).join(", ");
        bail!(
            "`{end}` in `{}` is no range and no colour map; they are given as NAME:MIN..MAX:MAP, \
             and the maps are {maps}",
            request.name
        );
    }
    Ok(())
}

/// Note on colours that are all black.
fn black_note(file: &Forest) -> Result<Option<&'static str>> {
    Ok((!has_colours(file)?).then_some("all of them are black"))
}

/// Names of all sources of colours of a file: general ones, then its attributes.
pub fn choices(file: &Forest) -> Vec<String> {
    let own = [("rgb", PlaneKind::Colour), ("normal", PlaneKind::Normal)];
    let own = own.into_iter().filter(|&(_, kind)| file.has(kind)).map(|(name, _)| name);
    let all = own.chain(["elevation", "depth", "level", "plain"]).map(str::to_owned);
    let attributes = file.schema().attributes.iter().enumerate();
    let attributes = attributes.filter(|&(i, a)| file.has(plane_of(&a.name, a.ty, i)));
    // Two numbers share the byte of returns.
    let attributes = attributes.flat_map(|(_, a)| match a.key() {
        (names::RETURNS, AttrType::U8) => {
            vec![RETURN_NUMBER.to_owned(), NUMBER_OF_RETURNS.to_owned()]
        }
        (name, _) => vec![name.to_owned()],
    });
    all.chain(attributes).collect()
}

/// Sources of colours that show something: those of [`choices`] without colours that are all black
/// and attributes that are zero everywhere.
///
/// # Errors
/// If statistics cannot be read.
pub fn offered(file: &Forest) -> Result<Vec<String>> {
    let mut all = choices(file);
    if !has_colours(file)? {
        all.retain(|name| name != "rgb");
    }
    for (index, attribute) in file.schema().attributes.iter().enumerate() {
        if matches!(ranges::whole(file, index)?, None | Some((0.0, 0.0))) {
            let is_returns = attribute.name == names::RETURNS;
            let parts = [RETURN_NUMBER, NUMBER_OF_RETURNS];
            let is_it =
                |name: &str| name == attribute.key().0 || is_returns && parts.contains(&name);
            all.retain(|name| !is_it(name));
        }
    }
    Ok(all)
}

/// Whether any colour differs from black: many LAS files have fields of colours with zeros in them.
fn has_colours(file: &Forest) -> Result<bool> {
    let colours = [names::RED, names::GREEN, names::BLUE];
    for file in file.files() {
        let histograms = file.histograms()?;
        let attributes = file.metadata().schema.attributes.iter().enumerate();
        let mut indices = attributes.filter(|(_, a)| colours.contains(&a.name.as_str()));
        if indices.any(|(i, _)| histograms.ranges().of(i).1 > 0.0) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Plane whose values differ between scans, and how they become codes.
///
/// # Errors
/// If no attribute differs between scans.
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
            "{path}: exposure compensation needs the scan of each point: {}; the file has none of these attributes",
            SCANS.join(" or ")
        )
    })
}

/// Whether all points are known to be of one scan, by the attribute of [`scans`].
///
/// # Errors
/// If statistics cannot be read, or as for [`scans`].
pub fn is_one_scan(file: &Forest) -> Result<bool> {
    let (kind, _) = scans(file)?;
    let mut files = file.files();
    let (Some(only), None) = (files.next(), files.next()) else { return Ok(false) };
    // Points of other classes may lack the attribute.
    if only.metadata().classes.len() > 1 {
        return Ok(false);
    }
    let attributes = only.metadata().schema.attributes.iter().enumerate();
    let mut indices = attributes.filter(|&(i, a)| plane_of(&a.name, a.ty, i) == kind);
    let Some((index, _)) = indices.next() else { return Ok(false) };
    let (least, greatest) = only.histograms()?.ranges().of(index);
    Ok(least == greatest)
}

/// An attribute that colours are requested from.
pub(super) struct AttributeColours<'a> {
    file: &'a Forest,
    request: &'a ColourRequest<'a>,
    shown: &'a ForestFilter,
    /// Its index in the schema of the forest.
    pub(super) index: usize,
    attribute: &'a Attribute,
    /// Plane of its values.
    pub(super) kind: PlaneKind,
    /// Whether the number of a return is requested.
    is_return_number: bool,
    /// Whether the number of returns is requested.
    is_return_count: bool,
    /// Least and greatest value of all points.
    range: Option<(f64, f64)>,
    note: Option<&'static str>,
}

impl<'a> AttributeColours<'a> {
    /// Finds an attribute that gives colours: by its exact name, in any case, or by its short name.
    pub(super) fn find(
        file: &'a Forest,
        request: &'a ColourRequest<'a>,
        shown: &'a ForestFilter,
    ) -> Result<Self> {
        let found = Self::find_any(file, request, shown)?;
        let (path, name) = (file.path().display(), &found.attribute.name);
        ensure!(file.has(found.kind), "{path}: `{name}` is a part of the colour; use --colour rgb");
        Ok(found)
    }

    /// Finds an attribute as [`AttributeColours::find`], also a part of the colour.
    pub(super) fn find_any(
        file: &'a Forest,
        request: &'a ColourRequest<'a>,
        shown: &'a ForestFilter,
    ) -> Result<Self> {
        let schema = file.schema();
        let Some(NamedAttribute { index, part }) = schema.find_named(request.name) else {
            let (path, known) = (file.path().display(), choices(file).join(", "));
            bail!("{path}: has no attribute `{}`; it has {known}", request.name);
        };
        let attribute = &schema.attributes[index];
        let (name, ty) = (attribute.name.as_str(), attribute.ty);
        let kind = plane_of(name, ty, index);
        let range = ranges::whole(file, index)?;
        let note = match range {
            Some((0.0, 0.0)) => Some("all values are zero"),
            None if file.points() > 0 => Some("no value is a number"),
            _ => None,
        };
        Ok(Self {
            file,
            request,
            shown,
            index,
            attribute,
            kind,
            is_return_number: part == Part::ReturnNumber,
            is_return_count: part == Part::ReturnCount,
            range,
            note,
        })
    }

    /// Whether its values have colours of their own, unless a range is requested.
    pub(super) fn has_labels(&self) -> bool {
        let name = self.attribute.name.as_str();
        let is_byte = self.attribute.ty == AttrType::U8;
        name == names::POINT_SOURCE_ID
            || is_byte && (name == names::CLASSIFICATION || name == names::RETURNS)
    }

    /// The part of bytes of returns that is requested; `None` for other attributes.
    pub(super) fn returns(&self) -> Option<Part> {
        let part = match (self.is_return_number, self.is_return_count) {
            (true, _) => Part::ReturnNumber,
            (_, true) => Part::ReturnCount,
            _ => Part::Whole,
        };
        (part != Part::Whole && self.attribute.ty == AttrType::U8).then_some(part)
    }

    /// Factor and offset from stored to shown values: the user sees extra bytes of LAS scaled.
    fn shown_scale(&self) -> (f64, f64) {
        match self.file.schema().shown_scale(self.index) {
            0.0 => (1.0, self.attribute.offset),
            scale => (scale, self.attribute.offset),
        }
    }

    /// The value that the user sees.
    pub(super) fn shown_value(&self, stored: f64) -> f64 {
        let (scale, offset) = self.shown_scale();
        stored * scale + offset
    }

    fn colouring(&self) -> Result<Colouring> {
        if let Some(colouring) = self.labels()? {
            return Ok(colouring);
        }
        if self.is_return_number && self.attribute.ty == AttrType::U8 {
            return self.mapped_return_numbers();
        }
        self.mapped()
    }

    /// Colours of their own for classes, returns and sources; `None` if values are mapped along a
    /// range.
    fn labels(&self) -> Result<Option<Colouring>> {
        let (name, has_range) = (self.attribute.name.as_str(), self.request.has_range());
        let is_byte = self.attribute.ty == AttrType::U8;
        if is_byte && !has_range && name == names::CLASSIFICATION {
            let coding = Coding::Bits { shift: 0, mask: u8::MAX };
            let entries = class_entries(self.file, self.shown)?;
            return Ok(Some(self.coded(Codebook::Classes, coding, entries)));
        }
        if is_byte && !has_range && name == names::RETURNS && self.is_return_number {
            let coding = Coding::Bits { shift: 0, mask: RETURN_NUMBER_MASK };
            return Ok(Some(self.labelled("return", coding)?));
        }
        if is_byte && name == names::RETURNS && self.is_return_count {
            ensure!(!has_range, "`{NUMBER_OF_RETURNS}` has no range of values");
            let coding = Coding::Bits { shift: NUMBER_OF_RETURNS_SHIFT, mask: RETURN_NUMBER_MASK };
            return Ok(Some(self.labelled("returns", coding)?));
        }
        if name == names::POINT_SOURCE_ID && !has_range {
            return self.sources().map(Some);
        }
        Ok(None)
    }

    /// Colours by sources, each with an entry in the legend.
    fn sources(&self) -> Result<Colouring> {
        let (mut values, mut are_all) = ranges::whole_numbers_of(self.file, self.index)?;
        are_all &= values.len() <= SOURCES_MAX;
        values.truncate(SOURCES_MAX);
        let entry = |value: u32| {
            let rgb = srgb(hue(value % LABELS as u32));
            LegendEntry { value, name: "source".to_owned(), rgb }
        };
        let entries = values.into_iter().map(entry).collect();
        let mut colouring = self.coded(Codebook::Labels, Coding::Labels, entries);
        colouring.legend.range = self.range.map(<[f64; 2]>::from);
        if !are_all && self.note.is_none() {
            colouring.legend.note = Some("there are further sources");
        }
        Ok(colouring)
    }

    /// Colours by labels of the bytes that occur.
    fn labelled(&self, what: &str, coding: Coding) -> Result<Colouring> {
        let values = ranges::bytes_of(self.file, self.index)?;
        Ok(self.coded(Codebook::Labels, coding, label_entries(what, &values, coding)))
    }

    /// Colours by codes of a byte.
    fn coded(&self, book: Codebook, coding: Coding, entries: Vec<LegendEntry>) -> Colouring {
        Colouring {
            by: ColourBy::Codes(book),
            plane: Some((self.kind, Some(AttrType::U8))),
            codes: Some(Codes { ty: self.attribute.ty, coding }),
            legend: Legend { entries, note: self.note, ..Legend::named(self.request.name) },
        }
    }

    /// Numbers of returns along a range.
    fn mapped_return_numbers(&self) -> Result<Colouring> {
        let [low, high] = self.request.range(|| Ok(RETURN_NUMBERS))?;
        let gradient = Gradient::Viridis;
        let coding = Coding::BitsAlong { mask: RETURN_NUMBER_MASK, low, high };
        let legend = Legend {
            range: Some([low, high]),
            gradient: Some(gradient),
            note: self.note,
            ..Legend::named(RETURN_NUMBER)
        };
        Ok(Colouring { legend, ..self.coded(Codebook::Along(gradient), coding, Vec::new()) })
    }

    /// Values along a range.
    fn mapped(&self) -> Result<Colouring> {
        let (scale, offset) = self.shown_scale();
        let range = self.request.range(|| {
            let (low, high) = ranges::of_attribute(self.file, self.index, self.shown)?;
            Ok((self.shown_value(low), self.shown_value(high)))
        })?;
        let [low, high] = range.map(|value| (value - offset) / scale);
        let is_intensity = self.kind == PlaneKind::Intensity;
        let gradient = if is_intensity { Gradient::Grey } else { Gradient::Viridis };
        let legend = Legend {
            range: Some(range),
            gradient: Some(gradient),
            note: self.note,
            ..Legend::named(&self.attribute.name)
        };
        if is_intensity {
            // A hot plane is drawn from as it is stored.
            let by = ColourBy::Scalar(ColourMap { low, high, gradient });
            let plane = Some((self.kind, Some(self.attribute.ty)));
            return Ok(Colouring { by, plane, codes: None, legend });
        }
        let coding = Coding::Along { low, high };
        Ok(Colouring { legend, ..self.coded(Codebook::Along(gradient), coding, Vec::new()) })
    }
}

/// Edges of the cells of nodes that `shown` accepts, the largest first, in the scan's unit.
///
/// # Errors
/// If the whole node table cannot be read.
fn cell_entries(file: &Forest, shown: &ForestFilter) -> Result<Vec<LegendEntry>> {
    if file.is_partial() {
        let whole = file.whole()?;
        return cell_entries(&whole, &shown.of_other(&whole)?);
    }
    let nodes = (0u32..).zip(&file.table().nodes);
    let kept = nodes.filter(|&(index, _)| shown.points_max(index) > 0);
    let sizes: BTreeSet<u8> = kept.map(|(_, node)| node.cell_log2).collect();
    let entry = |log2: u8| {
        let edge = f64::from(log2).exp2() * file.metric().scale[0];
        let rgb = srgb(hue(u32::from(log2)));
        LegendEntry { value: log2.into(), name: format!("edge {}", short(edge)), rgb }
    };
    Ok(sizes.into_iter().rev().map(entry).collect())
}

/// Labels of bytes.
fn label_entries(what: &str, values: &[u8], coding: Coding) -> Vec<LegendEntry> {
    let labels: BTreeSet<u8> = Codes { ty: AttrType::U8, coding }.of(values).into_iter().collect();
    let entry = |value: u8| {
        let rgb = srgb(hue(u32::from(value)));
        LegendEntry { value: value.into(), name: what.to_owned(), rgb }
    };
    labels.into_iter().map(entry).collect()
}

/// Classes of the points in nodes that `shown` accepts.
fn class_entries(forest: &Forest, shown: &ForestFilter) -> Result<Vec<LegendEntry>> {
    if forest.is_partial() && shown.is_filtered() {
        let whole = forest.whole()?;
        return class_entries(&whole, &shown.of_other(&whole)?);
    }
    let (mut bits, mut first) = ([0u64; 4], 0);
    for file in forest.files() {
        if file.is_growing() || file.is_partial() {
            // Nodes whose points are not known may have any class of the file.
            for ClassCount { class, .. } in occurring(forest)? {
                bits[usize::from(class >> 6)] |= 1 << (class & 63);
            }
            continue;
        }
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
        LegendEntry { value: class.into(), name, rgb: srgb(class_colour(class)) }
    };
    Ok((0..=u8::MAX).filter(occurs).map(entry).collect())
}
