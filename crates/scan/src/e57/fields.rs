//! What the scans of an E57 file tell of a point, and what becomes of it: the place, where that is valid, in the file's
//! coordinates; and attributes, one list for all scans.

use crate::text::naming::{axis, named, schema_of, usual};
use e57::{PointCloud, Record, RecordDataType as Kind, RecordName as Name, RecordValue as Value};
use esker_points::attribute::names;
use esker_points::{AttrType, Grid, Schema};
use std::sync::Arc;

/// Where a scan stands and how it is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Columns of the rotation.
    columns: [[f64; 3]; 3],
    pub at: [f64; 3],
    is_turned: bool,
}

/// What is taken of the points of one scan.
#[derive(Clone, Debug)]
pub(crate) struct Taken {
    place: Place,
    /// Which value tells whether the place is one.
    state: Option<usize>,
    pub pose: Pose,
    /// Of each attribute of the schema what it is made of, where the scan has it.
    attributes: Vec<Option<Part>>,
}

#[derive(Clone, Copy, Debug)]
enum Place {
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
    /// What is left out or changed, a line each.
    pub notes: Vec<String>,
}

impl Pose {
    const NONE: Self = Self {
        columns: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        at: [0.0; 3],
        is_turned: false,
    };

    /// That of a scan; `None` where it is no rotation, or no place.
    fn of(cloud: &PointCloud) -> Option<Self> {
        let Some(pose) = &cloud.transform else { return Some(Self::NONE) };
        let (q, t) = (&pose.rotation, &pose.translation);
        let length = (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z).sqrt();
        let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(|c| c / length);
        let columns = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let at = [t.x, t.y, t.z];
        let is_sound = columns.iter().flatten().chain(&at).all(|c| c.is_finite());
        let is_turned = [x, y, z] != [0.0; 3];
        is_sound.then_some(Self { columns, at, is_turned })
    }

    /// A direction in the file's coordinates.
    fn turned(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = self.columns;
        if !self.is_turned {
            return [x, y, z];
        }
        [0, 1, 2].map(|i| x * a[i] + y * b[i] + z * c[i])
    }

    /// A place in the file's coordinates.
    fn placed(&self, place: [f64; 3]) -> [f64; 3] {
        let turned = self.turned(place);
        [0, 1, 2].map(|i| turned[i] + self.at[i])
    }
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

    /// The integers of a point on [`Fields::grid`], where there is one; `None` where they are beyond what they may be.
    pub fn raw(&self, values: &[Value]) -> Option<[i32; 3]> {
        let Place::Cartesian(xyz) = self.place else { return None };
        let [x, y, z] = xyz.map(|i| match values[i] {
            Value::ScaledInteger(n) => i32::try_from(n).ok(),
            _ => None,
        });
        Some([x?, y?, z?])
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
        for ((part, attribute), column) in
            self.attributes.iter().zip(&schema.attributes).zip(columns)
        {
            let ty = attribute.ty;
            match *part {
                None => column.resize(column.len() + ty.size(), 0),
                Some(Part::Scan) => put(scan as f64 + 1.0, ty, column),
                Some(Part::Value(i)) => match values[i] {
                    // 64 bits are more than a double has.
                    Value::Integer(n) if matches!(ty, AttrType::I64 | AttrType::U64) => {
                        column.extend_from_slice(&n.to_le_bytes());
                    }
                    _ => put(real(i), ty, column),
                },
                Some(Part::Colour { value, range: [low, high] }) => {
                    let share = ((real(value) - low) / (high - low)).clamp(0.0, 1.0);
                    put((share * f64::from(u16::MAX)).round(), ty, column);
                }
                Some(Part::Normal { values, axis }) => {
                    put(self.pose.turned(values.map(real))[axis], ty, column);
                }
            }
        }
    }
}

/// The number that a value stands for.
fn real(value: &Value, kind: &Kind) -> f64 {
    match (value, kind) {
        (Value::Single(v), _) => f64::from(*v),
        (Value::Double(v), _) => *v,
        (Value::ScaledInteger(n), Kind::ScaledInteger { scale, offset, .. }) => {
            *n as f64 * scale + offset
        }
        (Value::Integer(n) | Value::ScaledInteger(n), _) => *n as f64,
    }
}

/// Appends a number as this type; `as` saturates.
fn put(v: f64, ty: AttrType, out: &mut Vec<u8>) {
    match ty {
        AttrType::U8 => out.extend((v as u8).to_le_bytes()),
        AttrType::I8 => out.extend((v as i8).to_le_bytes()),
        AttrType::U16 => out.extend((v as u16).to_le_bytes()),
        AttrType::I16 => out.extend((v as i16).to_le_bytes()),
        AttrType::U32 => out.extend((v as u32).to_le_bytes()),
        AttrType::I32 => out.extend((v as i32).to_le_bytes()),
        AttrType::U64 => out.extend((v as u64).to_le_bytes()),
        AttrType::I64 => out.extend((v as i64).to_le_bytes()),
        AttrType::F32 => out.extend((v as f32).to_le_bytes()),
        AttrType::F64 => out.extend(v.to_le_bytes()),
    }
}

/// The narrowest type of all values of a kind.
fn type_of(kind: &Kind) -> AttrType {
    match *kind {
        Kind::Single { .. } => AttrType::F32,
        Kind::Double { .. } => AttrType::F64,
        Kind::ScaledInteger { scale, offset, .. } if [scale, offset] != [1.0, 0.0] => AttrType::F64,
        Kind::Integer { min, max } | Kind::ScaledInteger { min, max, .. } => {
            let within = |low: i64, high: i64| low <= min && max <= high;
            if within(0, u8::MAX.into()) {
                AttrType::U8
            } else if within(i8::MIN.into(), i8::MAX.into()) {
                AttrType::I8
            } else if within(0, u16::MAX.into()) {
                AttrType::U16
            } else if within(i16::MIN.into(), i16::MAX.into()) {
                AttrType::I16
            } else if within(0, u32::MAX.into()) {
                AttrType::U32
            } else if within(i32::MIN.into(), i32::MAX.into()) {
                AttrType::I32
            } else {
                AttrType::I64
            }
        }
    }
}

/// A type that holds what both do.
fn common(a: AttrType, b: AttrType) -> AttrType {
    if a == b { a } else { AttrType::F64 }
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

/// Whether a colour is a whole number of 16 bits at most: else it is a share of its range.
fn is_whole_colour(kind: &Kind) -> bool {
    matches!(type_of(kind), AttrType::U8 | AttrType::U16)
}

/// The range of a colour: that of the scan's limits, else that of the value itself.
fn colour_range(cloud: &PointCloud, record: &Record) -> Option<[f64; 2]> {
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
        Kind::Single { min, max } => [min.unwrap_or(0.0).into(), max.unwrap_or(1.0).into()],
        Kind::Double { min, max } => [min.unwrap_or(0.0), max.unwrap_or(1.0)],
        Kind::Integer { min, max } => [min as f64, max as f64],
        Kind::ScaledInteger { min, max, scale, offset } => {
            [min as f64 * scale + offset, max as f64 * scale + offset]
        }
    };
    limits.into_iter().chain([own]).find(|[low, high]| (high - low).is_finite() && low < high)
}

impl Fields {
    /// Decides what is taken of these scans.
    ///
    /// # Errors
    /// Where a scan has no place, or one that is none: which, and why.
    pub fn new(clouds: &[PointCloud]) -> Result<Self, String> {
        let mut notes = Vec::new();
        // Names in the order in which they come, with the types of all scans' values.
        let mut found: Vec<(String, AttrType)> = Vec::new();
        let mut add = |name: String, ty: AttrType| match found.iter_mut().find(|f| f.0 == name) {
            Some((_, before)) => *before = common(*before, ty),
            None => found.push((name, ty)),
        };
        for cloud in clouds {
            for record in cloud.prototype.iter().filter(|record| !is_place(&record.name)) {
                let ty = match record.name {
                    Name::ColorRed | Name::ColorGreen | Name::ColorBlue => colour_type(clouds),
                    _ => type_of(&record.data_type),
                };
                add(name_of(&record.name), ty);
            }
        }
        let has_scans = clouds.len() > 1;
        if has_scans {
            found.push((names::POINT_SOURCE_ID.into(), AttrType::U16));
        }
        let plain: Vec<(&str, AttrType)> = found.iter().map(|(n, ty)| (n.as_str(), *ty)).collect();
        let (schema, columns) = schema_of(named(&plain));
        let mut scans = Vec::with_capacity(clouds.len());
        for (number, cloud) in (1..).zip(clouds) {
            let mut attributes = vec![None; found.len()];
            for ((name, _), &column) in found.iter().zip(&columns) {
                let is_scan = has_scans && name == names::POINT_SOURCE_ID;
                attributes[column] =
                    if is_scan { Some(Part::Scan) } else { part(cloud, name, clouds) };
                if attributes[column].is_none() {
                    notes.push(format!("scan {number} has no {name}: it is 0 there"));
                }
            }
            scans.push(taken(cloud, attributes).map_err(|why| format!("scan {number} {why}"))?);
            if cloud.has_cartesian() && cloud.has_spherical() {
                notes.push(format!("the spherical coordinates of scan {number} are left out"));
            }
        }
        if clouds.iter().any(PointCloud::has_color)
            && colour_type(clouds) == AttrType::U16
            && !are_whole_colours(clouds)
        {
            notes.push("colours are kept in steps of 1/65,535 of their range".into());
        }
        let grid = grid(clouds, &scans);
        Ok(Self { schema, scans, grid, notes })
    }
}

/// The grid that all coordinates are integers on, if they are.
fn grid(clouds: &[PointCloud], scans: &[Taken]) -> Option<Grid> {
    let of = |(cloud, taken): (&PointCloud, &Taken)| {
        let Place::Cartesian(xyz) = taken.place else { return None };
        let mut grid = Grid { scale: [1.0; 3], offset: taken.pose.at };
        for (axis, i) in xyz.into_iter().enumerate() {
            let Kind::ScaledInteger { min, max, scale, offset } = cloud.prototype[i].data_type
            else {
                return None;
            };
            let is_narrow = i32::try_from(min).is_ok() && i32::try_from(max).is_ok();
            let is_sound = scale.is_normal() && scale > 0.0 && offset.is_finite();
            if !is_narrow || !is_sound || taken.pose.is_turned {
                return None;
            }
            grid.scale[axis] = scale;
            grid.offset[axis] += offset;
        }
        Some(grid)
    };
    let mut grids = clouds.iter().zip(scans).filter(|(cloud, _)| cloud.records > 0).map(of);
    let first = grids.next()??;
    grids.all(|grid| grid == Some(first)).then_some(first)
}

fn are_whole_colours(clouds: &[PointCloud]) -> bool {
    colours(clouds).all(|record| is_whole_colour(&record.data_type))
}

fn colours(clouds: &[PointCloud]) -> impl Iterator<Item = &Record> {
    let is_colour =
        |r: &&Record| matches!(r.name, Name::ColorRed | Name::ColorGreen | Name::ColorBlue);
    clouds.iter().flat_map(|cloud| &cloud.prototype).filter(is_colour)
}

/// The type of all colours.
fn colour_type(clouds: &[PointCloud]) -> AttrType {
    let is_byte = |record: &Record| type_of(&record.data_type) == AttrType::U8;
    if colours(clouds).all(is_byte) { AttrType::U8 } else { AttrType::U16 }
}

/// What an attribute of this name is made of in a scan.
fn part(cloud: &PointCloud, name: &str, clouds: &[PointCloud]) -> Option<Part> {
    let at = |name: &str| cloud.prototype.iter().position(|r| name_of(&r.name) == name);
    let value = at(name)?;
    let normals = [names::NX, names::NY, names::NZ];
    let record = &cloud.prototype[value];
    Some(match record.name {
        Name::ColorRed | Name::ColorGreen | Name::ColorBlue if !are_whole_colours(clouds) => {
            Part::Colour { value, range: colour_range(cloud, record).unwrap_or([0.0, 1.0]) }
        }
        _ => match (normals.iter().position(|n| *n == name), normals.map(at)) {
            (Some(axis), [Some(x), Some(y), Some(z)]) => Part::Normal { values: [x, y, z], axis },
            _ => Part::Value(value),
        },
    })
}

fn taken(cloud: &PointCloud, attributes: Vec<Option<Part>>) -> Result<Taken, &'static str> {
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
    let varies = |record: &Record| match record.data_type {
        Kind::Single { .. } | Kind::Double { .. } => true,
        Kind::Integer { min, max } | Kind::ScaledInteger { min, max, .. } => min < max,
    };
    if cloud.records > 0 && !cloud.prototype.iter().any(varies) {
        return Err("has points that are all the same by its header; it is damaged");
    }
    let pose = Pose::of(cloud).ok_or("has a pose that is no rotation and place; it is damaged")?;
    Ok(Taken { place, state: find(cloud, &state), pose, attributes })
}
