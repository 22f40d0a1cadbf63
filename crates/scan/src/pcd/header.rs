//! Parses the header of a PCD file (Point Cloud Library, versions 0.5 to 0.7), up to and with
//! `DATA`: fields, their sizes, types and counts, the number of points and how they are stored.

use crate::ply::header::{Element, Property, Shape};
use crate::pose::{Pose, odd_length};
use crate::text::naming::{COLUMNS_MAX, NAME_BYTES_MAX};
use crate::text::number::decimals;
use esker_points::AttrType;
use std::io::{BufRead, Read};

/// Greatest size of a header, in bytes.
const HEADER_BYTES_MAX: u64 = 1 << 20;
/// Name of fields that are padding.
const PADDING: &str = "_";
/// Four-byte fields that hold packed colours, and whether they include alpha.
const PACKED: [(&str, bool); 2] = [("rgb", false), ("rgba", true)];

/// How points are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Data {
    /// A line each.
    Ascii,
    /// Records.
    Binary,
    /// Field by field, compressed by LZF.
    Compressed,
}

/// A field of a point: one value or several.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Field {
    pub name: String,
    pub ty: AttrType,
    pub count: usize,
    /// Offset in a record, in bytes.
    pub offset: usize,
}

/// Where a value of a point is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ValueLocation {
    /// Index of its field.
    pub field: usize,
    /// Offset in the field, in bytes.
    pub at: usize,
    /// Size, in bytes.
    pub bytes: usize,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub version: String,
    pub fields: Vec<Field>,
    /// Size of a record, in bytes.
    pub stride: usize,
    pub points: u64,
    /// Rows of a depth image; 1 for unordered points.
    pub rows: u64,
    /// Pose of the sensor; `None` if the header has one that is no pose.
    pub viewpoint: Option<Pose>,
    /// Length of the quaternion of `viewpoint`, if it is not 1.
    pub viewpoint_length: Option<f64>,
    /// Digits after the point that the position of the sensor needs.
    pub viewpoint_decimals: [u32; 3],
    pub data: Data,
    /// The header as in the file, with its last line end.
    pub text: Vec<u8>,
}

impl Field {
    /// Size in a record, in bytes.
    pub fn bytes(&self) -> usize {
        self.ty.size() * self.count
    }

    /// Whether it holds packed colours and, if so, whether they include alpha.
    pub fn packed(&self) -> Option<bool> {
        let is_word = self.bytes() == 4 && self.count == 1;
        PACKED.into_iter().find(|(name, _)| is_word && self.name == *name).map(|(_, alpha)| alpha)
    }

    /// Whether it holds packed colours as singles.
    pub fn is_packed_single(&self) -> bool {
        self.packed().is_some() && self.ty == AttrType::F32
    }

    /// Whether it is padding.
    pub fn is_padding(&self) -> bool {
        self.name == PADDING
    }
}

impl Header {
    /// Reads a header and leaves the stream at the points. The inner error says what is wrong with
    /// it.
    ///
    /// # Errors
    /// The outer error if the stream cannot be read, the inner one if it has no sound header.
    pub fn read(input: &mut impl BufRead) -> std::io::Result<Result<Self, String>> {
        let mut text = Vec::new();
        loop {
            let start = text.len();
            let room = HEADER_BYTES_MAX - start as u64;
            input.by_ref().take(room).read_until(b'\n', &mut text)?;
            let line = text[start..].trim_ascii();
            if line.starts_with(b"DATA") {
                return Ok(Self::parse(text));
            }
            if text.len() == start || !text.ends_with(b"\n") {
                let what = if text.len() as u64 >= HEADER_BYTES_MAX {
                    "the header is longer than 1 MiB"
                } else {
                    "the header has no `DATA`; the file is cut"
                };
                return Ok(Err(what.into()));
            }
        }
    }

    fn parse(text: Vec<u8>) -> Result<Self, String> {
        let lines = String::from_utf8_lossy(&text).into_owned();
        let mut entries: Vec<(&str, Vec<&str>)> = Vec::new();
        for line in lines.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')) {
            let mut words = line.split_ascii_whitespace();
            let Some(name) = words.next() else { continue };
            entries.push((name, words.collect()));
        }
        let find = |name: &str| entries.iter().find(|e| e.0 == name).map(|e| e.1.as_slice());
        let names = find("FIELDS").or(find("COLUMNS")).filter(|names| !names.is_empty());
        let names = names.ok_or("the header has no `FIELDS`")?;
        let column = |name: &str| -> Result<&[&str], String> {
            let words = find(name).ok_or_else(|| format!("the header has no `{name}`"))?;
            if words.len() == names.len() {
                return Ok(words);
            }
            let (n, fields) = (words.len(), names.len());
            Err(format!("`{name}` in the header has {n} entries for {fields} fields"))
        };
        let (sizes, types) = (column("SIZE")?, column("TYPE")?);
        let counts = if find("COUNT").is_some() { Some(column("COUNT")?) } else { None };
        let (mut fields, mut stride, mut values) = (Vec::new(), 0, 0);
        for (i, &name) in names.iter().enumerate() {
            let count = counts.map_or(Some(1), |c| c[i].parse().ok());
            let count: usize = count.ok_or_else(|| wrong("COUNT", counts.map_or("", |c| c[i])))?;
            if count == 0 {
                // A field without values, which drivers of scanners write as padding.
                continue;
            }
            let ty = type_of(types[i], sizes[i]).ok_or_else(|| {
                let (size, ty) = (sizes[i].escape_debug(), types[i].escape_debug());
                format!(
                    "the field `{}` is of type {ty} and size {size}, which are not known",
                    name.escape_debug()
                )
            })?;
            values += count.min(COLUMNS_MAX + 1);
            if values > COLUMNS_MAX {
                return Err(format!("has more than {COLUMNS_MAX} values a point"));
            }
            if name.len() > NAME_BYTES_MAX {
                return Err(format!("a field's name is longer than {NAME_BYTES_MAX} bytes"));
            }
            fields.push(Field { name: name.to_owned(), ty, count, offset: stride });
            stride += ty.size() * count;
        }
        if fields.is_empty() {
            return Err("no field in the header has a value".into());
        }
        let number = |name: &str| {
            let Some(words) = find(name) else { return Ok(None) };
            let word = words.first().copied().unwrap_or_default();
            word.parse::<u64>().map(Some).map_err(|_| wrong(name, word))
        };
        let (width, height) = (number("WIDTH")?, number("HEIGHT")?);
        let cells = width.and_then(|w| w.checked_mul(height.unwrap_or(1)));
        let points = number("POINTS")?
            .or(cells)
            .ok_or("the header does not say how many points there are")?;
        let (viewpoint, viewpoint_length, viewpoint_decimals) =
            find("VIEWPOINT").map_or((Some(Pose::NONE), None, [0; 3]), viewpoint_of);
        let data = match find("DATA").and_then(|words| words.first()).copied() {
            Some("ascii") => Data::Ascii,
            Some("binary") => Data::Binary,
            Some("binary_compressed") => Data::Compressed,
            other => return Err(wrong("DATA", other.unwrap_or_default())),
        };
        let version = find("VERSION").and_then(|words| words.first()).copied().unwrap_or("0.7");
        let version = version.strip_prefix('.').map_or(version.to_owned(), |v| format!("0.{v}"));
        Ok(Self {
            version,
            fields,
            stride,
            points,
            rows: height.unwrap_or(1),
            viewpoint,
            viewpoint_length,
            viewpoint_decimals,
            data,
            text,
        })
    }

    /// The values of a point, as an element of scalars, and the location of each.
    pub fn element(&self) -> (Element, Vec<ValueLocation>) {
        let (mut properties, mut locations) = (Vec::new(), Vec::new());
        let mut take = |name: String, ty: AttrType, field: usize, at: usize| {
            properties.push(Property { name, shape: Shape::Scalar(ty) });
            locations.push(ValueLocation { field, at, bytes: ty.size() });
        };
        for (i, field) in self.fields.iter().enumerate().filter(|(_, f)| !f.is_padding()) {
            if let Some(has_alpha) = field.packed() {
                // Blue is the lowest byte.
                let colours = [("red", 2), ("green", 1), ("blue", 0), ("alpha", 3)];
                for (name, at) in &colours[..if has_alpha { 4 } else { 3 }] {
                    take((*name).into(), AttrType::U8, i, *at);
                }
                continue;
            }
            for k in 0..field.count {
                let name = &field.name;
                let name = if field.count == 1 { name.clone() } else { format!("{name}_{k}") };
                take(name, field.ty, i, k * field.ty.size());
            }
        }
        (Element { name: "point".into(), count: self.points, properties }, locations)
    }
}

/// The pose of the sensor, the length of its quaternion if that is not 1, and the digits after the
/// point of its position: three numbers of the position and four of a quaternion, which the oldest
/// files lack.
fn viewpoint_of(words: &[&str]) -> (Option<Pose>, Option<f64>, [u32; 3]) {
    let digits = [0, 1, 2].map(|i| words.get(i).map_or(0, |word| decimals(word.as_bytes())));
    let numbers: Option<Vec<f64>> = words.iter().map(|word| word.parse().ok()).collect();
    let length = match numbers.as_deref() {
        Some(&[_, _, _, qw, qx, qy, qz]) => odd_length([qw, qx, qy, qz]),
        _ => None,
    };
    let pose = match numbers.as_deref() {
        Some(&[x, y, z]) => Pose::new([1.0, 0.0, 0.0, 0.0], [x, y, z]),
        Some(&[x, y, z, qw, qx, qy, qz]) => Pose::new([qw, qx, qy, qz], [x, y, z]),
        _ => None,
    };
    (pose, length.filter(|_| pose.is_some()), digits)
}

fn wrong(name: &str, word: &str) -> String {
    format!("`{name}` in the header is not understood: `{}`", word.escape_debug())
}

fn type_of(ty: &str, size: &str) -> Option<AttrType> {
    Some(match (ty, size) {
        ("U", "1") => AttrType::U8,
        ("I", "1") => AttrType::I8,
        ("U", "2") => AttrType::U16,
        ("I", "2") => AttrType::I16,
        ("U", "4") => AttrType::U32,
        ("I", "4") => AttrType::I32,
        ("U", "8") => AttrType::U64,
        ("I", "8") => AttrType::I64,
        ("F", "4") => AttrType::F32,
        ("F", "8") => AttrType::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb _ id\nSIZE 4 4 4 4 1 2\n\
        TYPE F F F F U U\nCOUNT 1 1 1 1 3 2\nWIDTH 5\nHEIGHT 2\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 10\nDATA binary\nrest";

    fn read(text: &str) -> Result<Header, String> {
        Header::read(&mut text.as_bytes()).unwrap()
    }

    #[test]
    fn a_header_describes_fields_and_points() {
        let header = read(HEAD).unwrap();
        assert_eq!((header.stride, header.points, header.rows), (23, 10, 2));
        assert_eq!(header.viewpoint, Some(Pose::moved([1.0, 2.0, 3.0])));
        assert_eq!(header.data, Data::Binary);
        assert!(header.text.ends_with(b"binary\n"));
        let (element, locations) = header.element();
        let names: Vec<&str> = element.properties.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["x", "y", "z", "red", "green", "blue", "id_0", "id_1"]);
        assert_eq!(locations[3], ValueLocation { field: 3, at: 2, bytes: 1 });
        assert_eq!(locations[7], ValueLocation { field: 5, at: 2, bytes: 2 });
        let older = HEAD.replace("VERSION 0.7", "VERSION .5").replace("FIELDS", "COLUMNS");
        let older = read(&older.replace("COUNT 1 1 1 1 3 2\n", "").replace("POINTS 10\n", ""));
        let older = older.unwrap();
        assert_eq!((older.version.as_str(), older.points, older.stride), ("0.5", 10, 19));
    }

    #[test]
    fn fields_without_values_are_skipped_and_viewpoints_are_poses() {
        let header = read(&HEAD.replace("COUNT 1 1 1 1 3 2", "COUNT 1 1 1 1 0 0")).unwrap();
        assert_eq!((header.stride, header.fields.len()), (16, 4));
        for (words, want) in [
            ("0 0 0 1 0 0 0", Some(Pose::NONE)),
            ("1 2 3", Some(Pose::moved([1.0, 2.0, 3.0]))),
            ("1 2.25 3 0 0 0 2", Pose::new([0.0, 0.0, 0.0, 1.0], [1.0, 2.25, 3.0])),
            ("0 0 0 0 0 0 0", None),
            ("nan 0 0 1 0 0 0", None),
            ("1 2", None),
        ] {
            let header = read(&HEAD.replace("1 2 3 1 0 0 0", words)).unwrap();
            assert_eq!(header.viewpoint, want, "{words}");
        }
        let header = read(&HEAD.replace("1 2 3 1 0 0 0", "1 2.25 3 1 0 0 0")).unwrap();
        assert_eq!(header.viewpoint_decimals, [0, 2, 0]);
    }

    #[test]
    fn unsound_headers_are_refused_with_the_reason() {
        for (from, to, want) in [
            ("DATA binary\nrest", "", "no `DATA`"),
            ("DATA binary\nrest", "DAT", "no `DATA`"),
            ("DATA binary", "DATA zip", "`DATA` in the header is not understood: `zip`"),
            ("FIELDS", "FELDER", "no `FIELDS`"),
            ("SIZE 4 4 4 4 1 2", "SIZE 4 4", "`SIZE` in the header has 2 entries for 6 fields"),
            ("TYPE F F", "TYPE F Q", "`y` is of type Q and size 4"),
            ("COUNT 1 1", "COUNT 1 -1", "`COUNT` in the header is not understood: `-1`"),
            ("COUNT 1 1", "COUNT 1 99999999999", "more than 1024 values"),
            ("POINTS 10", "POINTS -1", "`POINTS` in the header is not understood"),
        ] {
            let error = read(&HEAD.replace(from, to)).unwrap_err();
            assert!(error.contains(want), "{error} / {want}");
        }
        let without = HEAD.replace("POINTS 10\n", "").replace("WIDTH 5\n", "");
        assert!(read(&without).unwrap_err().contains("how many points"));
    }
}
