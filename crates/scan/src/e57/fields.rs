//! What the scans of an E57 file tell of a point, and what becomes of it: the place, where that is
//! valid, in the file's coordinates; and attributes, one list for all scans.

use super::colours::{Colours, colour_range, is_colour};
use super::grid::grid;
use super::packets::bits;
use super::pose::Pose;
use super::values::{Known, is_plain, put, real};
use crate::text::naming::{COLUMNS_MAX, NAME_BYTES_MAX, axis, named, schema_of, usual};
use e57::{PointCloud, Record, RecordDataType as Kind, RecordName as Name, RecordValue as Value};
use esker_points::attribute::names;
use esker_points::{AttrType, Cancelled, Grid, Schema, Task};
use std::collections::HashMap;
use std::sync::Arc;

/// Why it is not decided.
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

/// What is taken of the points of one scan.
#[derive(Clone, Debug)]
pub(crate) struct Taken {
    pub place: Place,
    /// Which value tells whether the place is one.
    state: Option<usize>,
    pub pose: Pose,
    /// Steps by which its integers are moved on [`Fields::grid`].
    pub shift: [i64; 3],
    /// The columns of the schema that it has, and what each is made of.
    parts: Vec<(usize, Part)>,
}

/// What a place is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Place {
    Cartesian([usize; 3]),
    /// Range, azimuth, elevation.
    Spherical([usize; 3]),
}

/// What an attribute is made of.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// This value.
    Value(usize),
    /// A colour that lies between two values.
    Colour { value: usize, range: [f64; 2] },
    /// One of three values that are turned with the scan.
    Normal { values: [usize; 3], axis: usize },
    /// The scan's number, from 1.
    Scan,
}

/// What is taken of all scans.
#[derive(Debug)]
pub(crate) struct Fields {
    pub schema: Arc<Schema>,
    pub scans: Vec<Taken>,
    /// The grid of all coordinates, where they are integers on one and no scan is turned.
    pub grid: Option<Grid>,
    /// Whether colours are shares of their range, of 16 bits.
    pub are_shares: bool,
    /// What is left out or changed, a line each.
    pub notes: Vec<String>,
}

/// A value of a point as a file names it: which of those of this name.
type Key = (Name, usize);

/// What is known of the values of all scans under a key.
struct Found {
    key: Key,
    kind: Known,
    /// How many scans have it.
    scans: usize,
}

/// What becomes of a point's place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Placed {
    At([f64; 3]),
    /// Nothing came back from that direction.
    NoReturn,
    NotFinite,
}

impl Taken {
    /// The place of a point.
    pub fn place(&self, cloud: &PointCloud, values: &[Value]) -> Placed {
        let real = |i: usize| real(&values[i], &cloud.prototype[i].data_type);
        if !self.is_return(cloud, values) {
            return Placed::NoReturn;
        }
        let own = match self.place {
            Place::Cartesian(xyz) => xyz.map(real),
            Place::Spherical(values) => {
                let [range, azimuth, elevation] = values.map(real);
                // The same on every machine, unlike the system's.
                let flat = range * libm::cos(elevation);
                [flat * libm::cos(azimuth), flat * libm::sin(azimuth), range * libm::sin(elevation)]
            }
        };
        let world = self.pose.placed(own);
        if world.iter().all(|c| c.is_finite()) { Placed::At(world) } else { Placed::NotFinite }
    }

    /// Whether something came back: 1 stands for a direction alone, 2 for nothing.
    pub fn is_return(&self, cloud: &PointCloud, values: &[Value]) -> bool {
        self.state.is_none_or(|i| real(&values[i], &cloud.prototype[i].data_type) == 0.0)
    }

    /// The integers of a point on [`Fields::grid`], where there is one; `None` where they are
    /// beyond what they may be.
    pub fn raw(&self, values: &[Value]) -> Option<[i32; 3]> {
        let Place::Cartesian(xyz) = self.place else { return None };
        let mut raw = [0; 3];
        for (axis, i) in xyz.into_iter().enumerate() {
            let Value::ScaledInteger(n) = values[i] else { return None };
            raw[axis] = n.checked_add(self.shift[axis])?.try_into().ok()?;
        }
        Some(raw)
    }

    /// Appends a point's attributes to their columns; those that the scan lacks are 0.
    pub fn put(
        &self,
        (scan, cloud): (usize, &PointCloud),
        values: &[Value],
        schema: &Schema,
        columns: &mut [Vec<u8>],
    ) {
        let real = |i: usize| real(&values[i], &cloud.prototype[i].data_type);
        for &(column, part) in &self.parts {
            let (ty, column) = (schema.attributes[column].ty, &mut columns[column]);
            match part {
                Part::Scan => put(scan as f64 + 1.0, ty, column),
                Part::Value(i) => match (&values[i], &cloud.prototype[i].data_type) {
                    // 64 bits are more than a double has.
                    (Value::Integer(n) | Value::ScaledInteger(n), kind)
                        if ty == AttrType::I64 && is_plain(kind) =>
                    {
                        column.extend_from_slice(&n.to_le_bytes());
                    }
                    _ => put(real(i), ty, column),
                },
                Part::Colour { value, range: [low, high] } => {
                    let share = ((real(value) - low) / (high - low)).clamp(0.0, 1.0);
                    put((share * f64::from(u16::MAX)).round(), ty, column);
                }
                Part::Normal { values, axis } => {
                    put(self.pose.turned(values.map(real))[axis], ty, column);
                }
            }
        }
        if self.parts.len() < columns.len() {
            let points = columns.iter().zip(&schema.attributes).map(|(c, a)| c.len() / a.ty.size());
            let points = points.max().unwrap_or(0);
            for (column, attribute) in columns.iter_mut().zip(&schema.attributes) {
                column.resize(points * attribute.ty.size(), 0);
            }
        }
    }
}

/// What a value is called in Esker.
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

/// Whether it is a part of the place.
fn is_place(name: &Name) -> bool {
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

/// The values of a scan that are no part of its place, with their keys.
fn keyed(cloud: &PointCloud) -> impl Iterator<Item = (usize, Key)> {
    let mut seen = HashMap::new();
    cloud.prototype.iter().enumerate().filter_map(move |(i, record)| {
        let nth = seen.entry(record.name.clone()).and_modify(|n| *n += 1).or_insert(0);
        (!is_place(&record.name)).then(|| (i, (record.name.clone(), *nth)))
    })
}

impl Fields {
    /// Decides what is taken of these scans.
    ///
    /// # Errors
    /// Where a scan has no place, or one that is none, or there are too many values: which, and
    /// why.
    pub fn new(clouds: &[PointCloud], task: &dyn Task) -> Result<Self, FieldsError> {
        let colours = Colours::of(clouds);
        // In the order in which they come.
        let (mut found, mut at): (Vec<Found>, HashMap<Key, usize>) = Default::default();
        for cloud in clouds {
            task.check()?;
            if cloud.prototype.len() > COLUMNS_MAX {
                return Err(format!("has more than {COLUMNS_MAX} values a point").into());
            }
            for (i, key) in keyed(cloud) {
                let kind = Known::of(&cloud.prototype[i].data_type);
                let index = *at.entry(key.clone()).or_insert(found.len());
                match found.get_mut(index) {
                    Some(known) => {
                        (known.kind, known.scans) = (known.kind.with(kind), known.scans + 1);
                    }
                    None => found.push(Found { key, kind, scans: 1 }),
                }
            }
            if found.len() > COLUMNS_MAX {
                return Err(format!("has scans of more than {COLUMNS_MAX} different values").into());
            }
        }
        let mut attributes: Vec<(String, AttrType)> = Vec::with_capacity(found.len() + 1);
        for Found { key: (name, _), kind, .. } in &found {
            let ty = match colours {
                Colours::Whole(ty) if is_colour(name) => ty,
                Colours::Shares if is_colour(name) => AttrType::U16,
                _ => kind.ty(),
            };
            let name = name_of(name);
            if name.len() > NAME_BYTES_MAX {
                return Err(format!("a value's name is longer than {NAME_BYTES_MAX} bytes").into());
            }
            attributes.push((name, ty));
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
            let mut parts: Vec<(usize, Part)> = first.iter().map(|&c| (c, Part::Scan)).collect();
            for (i, key) in keyed(cloud) {
                if let Some(&index) = at.get(&key) {
                    parts.push((columns[index], part(cloud, i, colours)));
                }
            }
            let taken = taken(cloud, parts);
            scans.push(taken.map_err(|why| format!("scan {number} {why}"))?);
        }
        let are_shares = colours == Colours::Shares;
        let mut notes = Vec::new();
        for (Found { scans, .. }, (name, _)) in found.iter().zip(&attributes[first.len()..]) {
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
        if are_shares {
            notes.push("colours are kept in steps of 1/65,535 of their range".into());
            let lacks_range = |cloud: &PointCloud| {
                let mut colours = cloud.prototype.iter().filter(|r| is_colour(&r.name));
                colours.any(|record| colour_range(cloud, record).is_none())
            };
            if clouds.iter().any(lacks_range) {
                notes.push(
                    "colours tell no range: 0 to 255 of integers, 0 to 1 of others is taken".into(),
                );
            }
        }
        let cartesian = |place| match place {
            Place::Cartesian(xyz) => Some(xyz),
            Place::Spherical(_) => None,
        };
        let places: Vec<_> = scans.iter().map(|scan| (cartesian(scan.place), scan.pose)).collect();
        let grid = grid(clouds, &places).map(|(grid, shifts)| {
            scans.iter_mut().zip(shifts).for_each(|(scan, shift)| scan.shift = shift);
            grid
        });
        Ok(Self { schema, scans, grid, are_shares, notes })
    }
}

/// What an attribute is made of that a value of a scan becomes.
fn part(cloud: &PointCloud, value: usize, colours: Colours) -> Part {
    let record = &cloud.prototype[value];
    if is_colour(&record.name) && colours == Colours::Shares {
        let range = colour_range(cloud, record).unwrap_or(match record.data_type {
            Kind::Integer { .. } | Kind::ScaledInteger { .. } => [0.0, 255.0],
            _ => [0.0, 1.0],
        });
        return Part::Colour { value, range };
    }
    let normals = [names::NX, names::NY, names::NZ];
    let at = |name: &str| cloud.prototype.iter().position(|r| name_of(&r.name) == name);
    match normals.iter().position(|n| *n == name_of(&record.name)) {
        Some(axis) => match normals.map(at) {
            [Some(x), Some(y), Some(z)] => Part::Normal { values: [x, y, z], axis },
            _ => Part::Value(value),
        },
        None => Part::Value(value),
    }
}

fn taken(cloud: &PointCloud, parts: Vec<(usize, Part)>) -> Result<Taken, &'static str> {
    let cartesian = [Name::CartesianX, Name::CartesianY, Name::CartesianZ];
    let spherical = [Name::SphericalRange, Name::SphericalAzimuth, Name::SphericalElevation];
    let (place, state) = if let Some(xyz) = find_all(cloud, cartesian) {
        (Place::Cartesian(xyz), Name::CartesianInvalidState)
    } else if let Some(values) = find_all(cloud, spherical) {
        (Place::Spherical(values), Name::SphericalInvalidState)
    } else if cloud.records == 0 {
        (Place::Cartesian([0; 3]), Name::CartesianInvalidState)
    } else {
        return Err("has neither x, y and z nor range, azimuth and elevation: no points");
    };
    // Where all values are constants their number is said nowhere in the data.
    let varies = |record: &Record| bits(&record.data_type) > 0;
    if cloud.records > 0 && !cloud.prototype.iter().any(varies) {
        return Err("has points that are all the same by its header; it is damaged");
    }
    let pose = Pose::of(cloud).ok_or("has a pose that is no rotation and place; it is damaged")?;
    Ok(Taken { place, state: find(cloud, &state), pose, shift: [0; 3], parts })
}
