//! Maps the values of the scans of an E57 file to points: positions in the file's coordinates, if
//! they are valid, and one list of attributes for all scans.

use super::colours::{Colours, colour_range, is_colour};
use super::grid::grid;
use super::packets::bits;
use super::values::{NumberType, is_plain, real};
use crate::fields::recipe::put;
use crate::pose::{Pose, odd_length};
use crate::text::naming::{COLUMNS_MAX, NAME_BYTES_MAX, axis, named, schema_of, usual};
use e57::{PointCloud, Record, RecordDataType as Kind, RecordName as Name, RecordValue as Value};
use esker_points::attribute::names;
use esker_points::{AttrType, Cancelled, Grid, Schema, Task};
use std::collections::HashMap;
use std::sync::Arc;

/// Why fields could not be mapped.
pub(crate) enum FieldsError {
    /// What is wrong with the file.
    Damaged(String),
    Cancelled(Cancelled),
}

impl From<String> for FieldsError {
    fn from(what: String) -> Self {
        Self::Damaged(what)
    }
}

impl From<Cancelled> for FieldsError {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

/// Where the points of one scan come from.
#[derive(Clone, Debug)]
pub(crate) struct ScanFields {
    pub coordinates: Coordinates,
    /// Index of the value that says whether the position is valid.
    state: Option<usize>,
    pub pose: Pose,
    /// Steps by which the scan's integers are moved on [`Fields::grid`].
    pub shift: [i64; 3],
    /// Columns of the schema that the scan has, and the source of each.
    attributes: Vec<(usize, AttributeSource)>,
}

/// Indices of the values that make a position.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Coordinates {
    Cartesian([usize; 3]),
    /// Range, azimuth, elevation.
    Spherical([usize; 3]),
}

/// Source of an attribute.
#[derive(Clone, Copy, Debug)]
enum AttributeSource {
    /// The value of this index.
    Value(usize),
    /// A colour that is scaled from `range` (black, white) to 16 bits; it `is_assumed` where the
    /// file gives none for fractions.
    Colour { value: usize, range: [f64; 2], is_assumed: bool },
    /// The index of a return, from 0, and the number of returns, in one byte as in LAS.
    Returns { index: usize, count: usize },
    /// One of three values that are turned with the scan.
    Normal { values: [usize; 3], axis: usize },
    /// The scan's number, from 1.
    Scan,
}

/// Where the points of all scans come from.
#[derive(Debug)]
pub(crate) struct Fields {
    pub schema: Arc<Schema>,
    pub scans: Vec<ScanFields>,
    /// The grid of all coordinates, if they are integers on one grid and no scan is turned.
    pub grid: Option<Grid>,
    /// Whether colours are scaled from their range to 16 bits.
    pub are_scaled: bool,
    /// What is left out or changed, a line each.
    pub notes: Vec<String>,
}

/// Name of a value in the file, and its index among values of that name.
type Key = (Name, usize);

/// Summary of the values of all scans that have the same key.
struct FieldSummary {
    key: Key,
    kind: NumberType,
    /// Number of scans that have it.
    scans: usize,
}

/// Position of a point, or why it has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Position {
    At([f64; 3]),
    /// The scanner got no return from this direction.
    NoReturn,
    NotFinite,
}

impl ScanFields {
    /// Computes the position of a point from its values.
    pub fn position(&self, cloud: &PointCloud, values: &[Value]) -> Position {
        let real = |i: usize| real(&values[i], &cloud.prototype[i].data_type);
        if !self.is_return(cloud, values) {
            return Position::NoReturn;
        }
        let own = match self.coordinates {
            Coordinates::Cartesian(xyz) => xyz.map(real),
            Coordinates::Spherical(values) => {
                let [range, azimuth, elevation] = values.map(real);
                // The crate `libm` gives the same result on every machine, unlike the system's
                // functions.
                let flat = range * libm::cos(elevation);
                [flat * libm::cos(azimuth), flat * libm::sin(azimuth), range * libm::sin(elevation)]
            }
        };
        let world = self.pose.placed(own);
        if world.iter().all(|c| c.is_finite()) { Position::At(world) } else { Position::NotFinite }
    }

    /// Whether the scanner got a return: state 1 is a direction without range, state 2 is invalid.
    pub fn is_return(&self, cloud: &PointCloud, values: &[Value]) -> bool {
        self.state.is_none_or(|i| real(&values[i], &cloud.prototype[i].data_type) == 0.0)
    }

    /// The integers of a point on [`Fields::grid`]; `None` without such a grid or if they exceed 32
    /// bits.
    pub fn raw(&self, values: &[Value]) -> Option<[i32; 3]> {
        let Coordinates::Cartesian(xyz) = self.coordinates else { return None };
        let mut raw = [0; 3];
        for (axis, i) in xyz.into_iter().enumerate() {
            let Value::ScaledInteger(n) = values[i] else { return None };
            raw[axis] = n.checked_add(self.shift[axis])?.try_into().ok()?;
        }
        Some(raw)
    }

    /// Appends a point's attributes to `columns`; attributes that the scan lacks are 0.
    pub fn put(
        &self,
        (scan, cloud): (usize, &PointCloud),
        values: &[Value],
        schema: &Schema,
        columns: &mut [Vec<u8>],
    ) {
        let real = |i: usize| real(&values[i], &cloud.prototype[i].data_type);
        for &(column, source) in &self.attributes {
            let (ty, column) = (schema.attributes[column].ty, &mut columns[column]);
            match source {
                AttributeSource::Scan => put(scan as f64 + 1.0, ty, column),
                AttributeSource::Value(i) => match (&values[i], &cloud.prototype[i].data_type) {
                    // 64-bit integers do not fit a double.
                    (Value::Integer(n) | Value::ScaledInteger(n), kind)
                        if ty == AttrType::I64 && is_plain(kind) =>
                    {
                        column.extend_from_slice(&n.to_le_bytes());
                    }
                    _ => put(real(i), ty, column),
                },
                AttributeSource::Returns { index, count } => {
                    column.push(((real(index) as u8).min(14) + 1) | (real(count) as u8) << 4);
                }
                AttributeSource::Colour { value, range: [low, high], .. } => {
                    let fraction = ((real(value) - low) / (high - low)).clamp(0.0, 1.0);
                    put((fraction * f64::from(u16::MAX)).round(), ty, column);
                }
                AttributeSource::Normal { values, axis } => {
                    put(self.pose.turned(values.map(real))[axis], ty, column);
                }
            }
        }
        if self.attributes.len() < columns.len() {
            let points = columns.iter().zip(&schema.attributes).map(|(c, a)| c.len() / a.ty.size());
            let points = points.max().unwrap_or(0);
            for (column, attribute) in columns.iter_mut().zip(&schema.attributes) {
                column.resize(points * attribute.ty.size(), 0);
            }
        }
    }
}

/// Name of the attribute made from a value.
fn name_of(name: &Name) -> String {
    match name {
        Name::Intensity => names::INTENSITY.into(),
        Name::ColorRed => names::RED.into(),
        Name::ColorGreen => names::GREEN.into(),
        Name::ColorBlue => names::BLUE.into(),
        Name::IsIntensityInvalid => "is_intensity_invalid".into(),
        Name::IsColorInvalid => "is_color_invalid".into(),
        Name::IsTimeStampInvalid => "is_time_stamp_invalid".into(),
        Name::RowIndex => "row_index".into(),
        Name::ColumnIndex => "column_index".into(),
        Name::ReturnCount => "return_count".into(),
        Name::ReturnIndex => "return_index".into(),
        Name::TimeStamp => "time_stamp".into(),
        Name::Unknown { name, .. } => match usual(name) {
            Some(usual @ (names::NX | names::NY | names::NZ)) => usual.into(),
            _ if axis(name).is_none() => name.clone(),
            _ => format!("{name}_"),
        },
        _ => String::new(),
    }
}

/// Whether a value is a part of the position.
fn is_of_position(name: &Name) -> bool {
    matches!(
        name,
        Name::CartesianX
            | Name::CartesianY
            | Name::CartesianZ
            | Name::CartesianInvalidState
            | Name::SphericalRange
            | Name::SphericalAzimuth
            | Name::SphericalElevation
            | Name::SphericalInvalidState
    )
}

fn find(cloud: &PointCloud, name: &Name) -> Option<usize> {
    cloud.prototype.iter().position(|record| record.name == *name)
}

fn find_all(cloud: &PointCloud, names: [Name; 3]) -> Option<[usize; 3]> {
    let [a, b, c] = names.map(|name| find(cloud, &name));
    Some([a?, b?, c?])
}

/// The values of a scan that are not part of its position, with their indices and keys.
fn keyed(cloud: &PointCloud) -> impl Iterator<Item = (usize, Key)> {
    let mut seen = HashMap::new();
    cloud.prototype.iter().enumerate().filter_map(move |(i, record)| {
        let nth = seen.entry(record.name.clone()).and_modify(|n| *n += 1).or_insert(0);
        (!is_of_position(&record.name)).then(|| (i, (record.name.clone(), *nth)))
    })
}

/// The values of all scans in the order of their first appearance, and the index of each.
fn summaries(
    clouds: &[PointCloud],
    task: &dyn Task,
) -> Result<(Vec<FieldSummary>, HashMap<Key, usize>), FieldsError> {
    let (mut found, mut at): (Vec<FieldSummary>, HashMap<Key, usize>) = Default::default();
    for cloud in clouds {
        task.check()?;
        if cloud.prototype.len() > COLUMNS_MAX {
            return Err(format!("has more than {COLUMNS_MAX} values a point").into());
        }
        for (i, key) in keyed(cloud) {
            let kind = NumberType::of(&cloud.prototype[i].data_type);
            let index = *at.entry(key.clone()).or_insert(found.len());
            match found.get_mut(index) {
                Some(known) => {
                    (known.kind, known.scans) = (known.kind.with(kind), known.scans + 1);
                }
                None => found.push(FieldSummary { key, kind, scans: 1 }),
            }
        }
        if found.len() > COLUMNS_MAX {
            return Err(format!("has scans of more than {COLUMNS_MAX} different values").into());
        }
    }
    Ok((found, at))
}

impl Fields {
    /// Maps the values of these scans.
    ///
    /// # Errors
    /// If a scan has no coordinates, or if there are too many values; the error says which and why.
    pub fn new(clouds: &[PointCloud], task: &dyn Task) -> Result<Self, FieldsError> {
        let colours = Colours::of(clouds);
        let (found, at) = summaries(clouds, task)?;
        let mut attributes: Vec<(String, AttrType)> = Vec::with_capacity(found.len() + 1);
        for FieldSummary { key: (name, _), kind, .. } in &found {
            let ty = match colours {
                Colours::Whole(ty) if is_colour(name) => ty,
                Colours::Scaled if is_colour(name) => AttrType::U16,
                _ => kind.ty(),
            };
            let name = name_of(name);
            if name.len() > NAME_BYTES_MAX {
                return Err(format!("a value's name is longer than {NAME_BYTES_MAX} bytes").into());
            }
            attributes.push((name, ty));
        }
        let are_returns = returns_fit(&found, clouds);
        if let Some(index) = found.iter().position(|f| are_returns && f.key == RETURN_INDEX) {
            attributes[index] = (names::RETURNS.into(), AttrType::U8);
        }
        let has_scans = clouds.len() > 1;
        if has_scans {
            // First, so that it keeps its name.
            attributes.insert(0, (names::POINT_SOURCE_ID.into(), AttrType::U16));
        }
        let plain: Vec<(&str, AttrType)> =
            attributes.iter().map(|(name, ty)| (name.as_str(), *ty)).collect();
        let (schema, columns) = schema_of(named(&plain));
        let (first, columns) = columns.split_at(usize::from(has_scans));
        let mut scans = Vec::with_capacity(clouds.len());
        for (number, cloud) in (1..).zip(clouds) {
            task.check()?;
            let mut sources: Vec<(usize, AttributeSource)> =
                first.iter().map(|&c| (c, AttributeSource::Scan)).collect();
            for (i, key) in keyed(cloud) {
                if let Some(&index) = at.get(&key) {
                    let count = find(cloud, &Name::ReturnCount);
                    let source = match count.filter(|_| are_returns && key == RETURN_INDEX) {
                        Some(count) => AttributeSource::Returns { index: i, count },
                        None => source_of(cloud, i, colours),
                    };
                    sources.push((columns[index], source));
                }
            }
            let fields = scan_fields(cloud, sources);
            scans.push(fields.map_err(|why| format!("scan {number} {why}"))?);
        }
        let are_scaled = colours == Colours::Scaled;
        let mut notes = pose_notes(clouds);
        for (FieldSummary { scans, .. }, (name, _)) in found.iter().zip(&attributes[first.len()..])
        {
            if *scans < clouds.len() {
                let lacking = clouds.len() - scans;
                notes.push(format!(
                    "{lacking} of {} scans have no {name}: it is 0 there",
                    clouds.len()
                ));
            }
        }
        if clouds.iter().any(|cloud| cloud.has_cartesian() && cloud.has_spherical()) {
            notes.push("spherical coordinates beside others are left out".into());
        }
        if are_scaled {
            notes.push("colours are kept in steps of 1/65,535 of their range".into());
            let lacks_range = |cloud: &PointCloud| {
                let mut colours = cloud.prototype.iter().filter(|r| is_colour(&r.name));
                colours.any(|record| colour_range(cloud, record).is_none())
            };
            if clouds.iter().any(lacks_range) {
                notes.push(
                    "colours have no range in the file: 0 to 255 is assumed for integers, 0 to 1 for others".into(),
                );
            }
        }
        let cartesian = |coordinates| match coordinates {
            Coordinates::Cartesian(xyz) => Some(xyz),
            Coordinates::Spherical(_) => None,
        };
        let places: Vec<_> =
            scans.iter().map(|scan| (cartesian(scan.coordinates), scan.pose)).collect();
        let grid = grid(clouds, &places).map(|(grid, shifts)| {
            scans.iter_mut().zip(shifts).for_each(|(scan, shift)| scan.shift = shift);
            grid
        });
        Ok(Self { schema, scans, grid, are_scaled, notes })
    }

    /// Whether all coordinates are singles as the file has them: Cartesian and not transformed.
    pub fn are_single(&self, clouds: &[PointCloud]) -> bool {
        self.scans.iter().zip(clouds).filter(|(_, cloud)| cloud.records > 0).all(|(scan, cloud)| {
            let Coordinates::Cartesian(xyz) = scan.coordinates else { return false };
            let is_single =
                |&i: &usize| matches!(cloud.prototype[i].data_type, Kind::Single { .. });
            scan.pose == Pose::NONE && xyz.iter().all(is_single)
        })
    }
}

impl ScanFields {
    /// The greatest of the colours of a point whose range is assumed.
    pub fn assumed_colour(&self, cloud: &PointCloud, values: &[Value]) -> f64 {
        let assumed = self.attributes.iter().filter_map(|(_, source)| match source {
            AttributeSource::Colour { value, is_assumed: true, .. } => Some(*value),
            _ => None,
        });
        let colours = assumed.map(|i| real(&values[i], &cloud.prototype[i].data_type));
        colours.fold(0.0, f64::max)
    }
}

impl Fields {
    /// Whether the range of colours is assumed, and their values should be looked at.
    pub fn assumes_colours(&self) -> bool {
        let mut all = self.scans.iter().flat_map(|scan| &scan.attributes);
        all.any(|(_, source)| matches!(source, AttributeSource::Colour { is_assumed: true, .. }))
    }

    /// Takes the range of colours without one from the greatest of them.
    pub fn assume_colours(&mut self, greatest: f64) {
        let Some(white) = [1.0, 255.0, 65_535.0].into_iter().find(|top| greatest <= top * 1.001)
        else {
            return;
        };
        if white == 1.0 {
            return;
        }
        self.notes
            .push(format!("colours without a range reach {greatest}: {white} is taken for white"));
        for (_, source) in self.scans.iter_mut().flat_map(|scan| &mut scan.attributes) {
            if let AttributeSource::Colour { range, is_assumed: true, .. } = source {
                *range = [0.0, white];
            }
        }
    }
}

/// Key of the index of a return.
const RETURN_INDEX: Key = (Name::ReturnIndex, 0);

/// Whether indices and numbers of returns fit the four bits each that LAS has.
fn returns_fit(found: &[FieldSummary], clouds: &[PointCloud]) -> bool {
    let fits = |name: Name, most: i64| {
        let summary = found.iter().find(|f| f.key == (name.clone(), 0));
        summary.is_some_and(
            |f| matches!(f.kind, NumberType::Integers { min: 0.., max } if max <= most),
        )
    };
    let has = |cloud: &PointCloud, name| find(cloud, &name).is_some();
    let are_paired =
        clouds.iter().all(|cloud| has(cloud, Name::ReturnIndex) == has(cloud, Name::ReturnCount));
    fits(Name::ReturnIndex, 14) && fits(Name::ReturnCount, 15) && are_paired
}

/// The pose of a scan, and what was wrong with it: a rotation that is none is left out, and so is a
/// position that is not finite.
fn pose_of(cloud: &PointCloud) -> (Pose, Option<&'static str>) {
    let Some(transform) = &cloud.transform else { return (Pose::NONE, None) };
    let (q, at) = (&transform.rotation, &transform.translation);
    let (q, at) = ([q.w, q.x, q.y, q.z], [at.x, at.y, at.z]);
    if let Some(pose) = Pose::new(q, at) {
        return (pose, None);
    }
    if at.iter().all(|c| c.is_finite()) {
        return (Pose::moved(at), Some("a pose whose rotation is none: it is kept as not turned"));
    }
    match Pose::new(q, [0.0; 3]) {
        Some(turn) => (turn, Some("a pose whose position is no number: it is kept as not moved")),
        None => (Pose::NONE, Some("a pose that is none: it is kept as not turned and not moved")),
    }
}

/// Notes on the poses that are not used as they are.
fn pose_notes(clouds: &[PointCloud]) -> Vec<String> {
    let faults = (1..).zip(clouds).filter_map(|(number, cloud)| Some((number, pose_of(cloud).1?)));
    let faults = faults.map(|(number, what): (usize, _)| format!("scan {number} has {what}"));
    let odd = (1..).zip(clouds).filter_map(|(number, cloud)| {
        let q = &cloud.transform.as_ref()?.rotation;
        let length = odd_length([q.w, q.x, q.y, q.z])?;
        let what = "its rotation is a quaternion of length";
        Some(format!("scan {number}: {what} {length:.4}, which is scaled to 1"))
    });
    faults.chain(odd.collect::<Vec<String>>()).collect()
}

/// Why no point of a scan can be read; `None` if its header is sound.
pub(crate) fn fault_of(cloud: &PointCloud) -> Option<&'static str> {
    if cloud.prototype.len() > COLUMNS_MAX {
        return Some("has more than 1024 values a point");
    }
    if cloud.prototype.iter().any(|record| name_of(&record.name).len() > NAME_BYTES_MAX) {
        return Some("has a value whose name is longer than 256 bytes");
    }
    scan_fields(cloud, Vec::new()).err()
}

/// The source of the attribute that is made from a value of a scan.
fn source_of(cloud: &PointCloud, value: usize, colours: Colours) -> AttributeSource {
    let record = &cloud.prototype[value];
    if is_colour(&record.name) && colours == Colours::Scaled {
        let is_whole =
            matches!(record.data_type, Kind::Integer { .. } | Kind::ScaledInteger { .. });
        let known = colour_range(cloud, record);
        let range = known.unwrap_or(if is_whole { [0.0, 255.0] } else { [0.0, 1.0] });
        return AttributeSource::Colour { value, range, is_assumed: known.is_none() && !is_whole };
    }
    let normals = [names::NX, names::NY, names::NZ];
    let at = |name: &str| cloud.prototype.iter().position(|r| name_of(&r.name) == name);
    match normals.iter().position(|n| *n == name_of(&record.name)) {
        Some(axis) => match normals.map(at) {
            [Some(x), Some(y), Some(z)] => AttributeSource::Normal { values: [x, y, z], axis },
            _ => AttributeSource::Value(value),
        },
        None => AttributeSource::Value(value),
    }
}

fn scan_fields(
    cloud: &PointCloud,
    attributes: Vec<(usize, AttributeSource)>,
) -> Result<ScanFields, &'static str> {
    let cartesian = [Name::CartesianX, Name::CartesianY, Name::CartesianZ];
    let spherical = [Name::SphericalRange, Name::SphericalAzimuth, Name::SphericalElevation];
    let (coordinates, state) = if let Some(xyz) = find_all(cloud, cartesian) {
        (Coordinates::Cartesian(xyz), Name::CartesianInvalidState)
    } else if let Some(values) = find_all(cloud, spherical) {
        (Coordinates::Spherical(values), Name::SphericalInvalidState)
    } else if cloud.records == 0 {
        (Coordinates::Cartesian([0; 3]), Name::CartesianInvalidState)
    } else {
        return Err("has neither x, y and z nor range, azimuth and elevation: no points");
    };
    // If all values are constants, the data do not give the number of points.
    let varies = |record: &Record| bits(&record.data_type) > 0;
    if cloud.records > 0 && !cloud.prototype.iter().any(varies) {
        return Err("has only constant values by its header; it is damaged");
    }
    let (pose, _) = pose_of(cloud);
    Ok(ScanFields { coordinates, state: find(cloud, &state), pose, shift: [0; 3], attributes })
}
