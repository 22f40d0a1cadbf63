//! Parses the header of a PLY file (Turk 1994), up to and with `end_header`: encoding, elements and
//! their properties. Every size is checked against a limit before it is used.

use crate::ply::comments::unescaped;
use crate::text::naming::{COLUMNS_MAX, NAME_BYTES_MAX};
use esker_points::AttrType;
use std::io::{BufRead, Read};

/// Greatest size of a header, in bytes.
const HEADER_BYTES_MAX: u64 = 1 << 20;
/// Greatest number of elements; real files have two or three.
const ELEMENTS_MAX: usize = 256;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

impl Encoding {
    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ASCII",
            Self::LittleEndian => "binary little-endian",
            Self::BigEndian => "binary big-endian",
        }
    }
}

/// Values of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// One value.
    Scalar(AttrType),
    /// A count (integer) and as many items.
    List { count: AttrType, item: AttrType },
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Property {
    pub name: String,
    pub shape: Shape,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Size of one element in a binary body, in bytes; `None` if lists make sizes vary.
    pub fn stride(&self) -> Option<u64> {
        let sizes = self.properties.iter().map(|p| match p.shape {
            Shape::Scalar(ty) => Some(ty.size() as u64),
            Shape::List { .. } => None,
        });
        sizes.sum()
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// The header as in the file, with its last line end.
    pub text: Vec<u8>,
}

/// Why a header is refused.
#[derive(Debug)]
pub(crate) enum HeaderError {
    Io(std::io::Error),
    /// What is wrong with the header.
    Damaged(String),
}

impl From<String> for HeaderError {
    fn from(what: String) -> Self {
        Self::Damaged(what)
    }
}

impl Header {
    /// Reads a header and leaves the stream at the body.
    ///
    /// # Errors
    /// If it is no sound PLY header, or too large.
    pub fn read(input: &mut impl BufRead) -> Result<Self, HeaderError> {
        let (mut text, mut encoding, mut elements) = (Vec::new(), None, Vec::new());
        for number in 1u64.. {
            let start = text.len();
            let room = HEADER_BYTES_MAX - start as u64;
            input.by_ref().take(room).read_until(b'\n', &mut text).map_err(HeaderError::Io)?;
            let line = &text[start..];
            if !line.ends_with(b"\n") && !line.starts_with(b"end_header") {
                return Err(HeaderError::Damaged(unfinished(&text)));
            }
            let line = String::from_utf8_lossy(line);
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words[..] {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return Err("the first line is not `ply`".to_owned().into()),
                ["end_header"] => break,
                [] | ["comment" | "obj_info", ..] => {}
                ["format", name, version] => encoding = Some(encoding_of(name, version)?),
                ["element", ref name @ .., count] if !name.is_empty() => {
                    elements.push(element(&name.join(" "), count, elements.len())?);
                }
                ["property", ref rest @ ..] => {
                    let total: usize = elements.iter().map(|e: &Element| e.properties.len()).sum();
                    if total >= COLUMNS_MAX {
                        return Err(format!("has more than {COLUMNS_MAX} properties").into());
                    }
                    let property = property(rest).ok_or_else(|| unknown(number, &line))?;
                    let element = elements.last_mut();
                    element.ok_or_else(|| unknown(number, &line))?.properties.push(property);
                }
                _ => return Err(unknown(number, &line).into()),
            }
        }
        let encoding = encoding.ok_or("the header has no `format` line".to_owned())?;
        Ok(Self { encoding, elements, text })
    }
}

fn unfinished(text: &[u8]) -> String {
    if text.len() as u64 >= HEADER_BYTES_MAX {
        format!("the header is longer than {} MiB", HEADER_BYTES_MAX >> 20)
    } else if text.contains(&b'\r') && !text.contains(&b'\n') {
        "the header's lines end with CR alone; write them with LF or CR LF".into()
    } else {
        "the header has no `end_header`; the file is cut".into()
    }
}

fn unknown(number: u64, line: &str) -> String {
    let shown: String = line.trim().chars().take(60).collect();
    format!("line {number} of the header is not understood: `{}`", shown.escape_debug())
}

fn encoding_of(name: &str, version: &str) -> Result<Encoding, String> {
    if version != "1.0" {
        return Err(format!("PLY version `{}` is not known; 1.0 is", version.escape_debug()));
    }
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::LittleEndian),
        "binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(format!("PLY encoding `{}` is not known", name.escape_debug())),
    }
}

fn element(name: &str, count: &str, elements: usize) -> Result<Element, String> {
    if elements >= ELEMENTS_MAX {
        return Err(format!("has more than {ELEMENTS_MAX} elements"));
    }
    if name.len() > NAME_BYTES_MAX {
        return Err(format!("an element's name is longer than {NAME_BYTES_MAX} bytes"));
    }
    let count = count.parse().map_err(|_| {
        format!("the count of element `{name}` is no number: `{}`", count.escape_debug())
    })?;
    Ok(Element { name: name.to_owned(), count, properties: Vec::new() })
}

fn property(words: &[&str]) -> Option<Property> {
    let (shape, name) = match words {
        ["list", count, item, name @ ..] => {
            let count = type_of(count).filter(|t| !matches!(t, AttrType::F32 | AttrType::F64))?;
            (Shape::List { count, item: type_of(item)? }, name)
        }
        [ty, name @ ..] => (Shape::Scalar(type_of(ty)?), name),
        [] => return None,
    };
    let name = unescaped(&name.join(" "));
    (!name.is_empty() && name.len() <= NAME_BYTES_MAX).then_some(Property { name, shape })
}

/// The types of PLY by both of their names, and 64-bit integers as some programs write them.
fn type_of(word: &str) -> Option<AttrType> {
    Some(match word {
        "char" | "int8" => AttrType::I8,
        "uchar" | "uint8" => AttrType::U8,
        "short" | "int16" => AttrType::I16,
        "ushort" | "uint16" => AttrType::U16,
        "int" | "int32" => AttrType::I32,
        "uint" | "uint32" => AttrType::U32,
        "long" | "int64" => AttrType::I64,
        "ulong" | "uint64" => AttrType::U64,
        "float" | "float32" => AttrType::F32,
        "double" | "float64" => AttrType::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Header, String> {
        Header::read(&mut text.as_bytes()).map_err(|e| match e {
            HeaderError::Damaged(what) => what,
            HeaderError::Io(e) => e.to_string(),
        })
    }

    #[test]
    fn header_variants_are_read() {
        let text = "ply \r\nformat binary_big_endian 1.0\r\ncomment a b\r\nobj_info n\r\n\r\n\
            element vertex 3 \r\nproperty float32 x\r\nproperty uchar scalar a (1)\r\n\
            element face 2\r\nproperty list uint8 int vertex_indices\r\nend_header\r\nBODY";
        let header = read(text).unwrap();
        assert_eq!(header.encoding, Encoding::BigEndian);
        assert_eq!(header.text.len(), text.len() - 4);
        let [vertex, face] = &header.elements[..] else { panic!("{header:?}") };
        assert_eq!((vertex.count, vertex.stride()), (3, Some(5)));
        assert_eq!(vertex.properties[1].name, "scalar a (1)");
        assert_eq!((face.count, face.stride()), (2, None));
    }

    #[test]
    fn unsound_headers_are_refused_with_the_reason() {
        let many = "property float p\n".repeat(COLUMNS_MAX + 1);
        let long = "n".repeat(NAME_BYTES_MAX + 1);
        for (text, want) in [
            ("plyformat ascii 1.0\n", "the first line"),
            ("ply\nformat ascii 1.0\n", "no `end_header`"),
            ("ply\rformat ascii 1.0\rend_header\r", "CR alone"),
            ("ply\nend_header\n", "no `format`"),
            ("ply\nformat ascii 2.0\n", "version `2.0`"),
            ("ply\nformat utf8 1.0\n", "encoding `utf8`"),
            ("ply\nproperty float x\n", "line 2"),
            ("ply\nelement vertex -3\n", "count of element `vertex`"),
            ("ply\nelement vertex 99999999999999999999\n", "count of element `vertex`"),
            ("ply\nelement vertex 3\nproperty half x\n", "line 3"),
            ("ply\nelement vertex 3\nproperty list float int x\n", "line 3"),
            (&format!("ply\nelement vertex 3\n{many}"), "more than 1024 properties"),
            (&format!("ply\nelement vertex 3\nproperty float {long}\n"), "line 3"),
            (&format!("ply\nelement {long} 3\n"), "longer than 256"),
            (&format!("ply\ncomment {}", "c".repeat(1 << 21)), "longer than 1 MiB"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(want), "{error} / {want}");
        }
    }
}
