//! Converts between extra bytes of point records and attributes. Descriptions of the extra-bytes
//! VLR (LAS 1.4 R15, table 24, and the arrays that R15 deprecates) become attributes; undescribed
//! bytes become one `u8` attribute each, so that no byte of a record is lost.

use super::header::f64_at;
use super::vlr::{Records, text};
use esker_points::{AttrType, Attribute, attribute::names};

/// Size of a description, in bytes.
pub const DESCRIPTION_BYTES: usize = 192;
/// Option bit: a value that stands for "no data" is given.
pub const OPTION_NO_DATA: u8 = 1;
/// Offset of that value.
pub const NO_DATA_AT: usize = 40;
const OPTION_SCALE: u8 = 1 << 3;
const OPTION_OFFSET: u8 = 1 << 4;

/// Size of a name, in bytes.
pub const NAME_BYTES: usize = 32;
/// Names that mean LAS fields, or similar ones, everywhere in Esker. An extra dimension with such a
/// name gets a suffix, because its meaning may differ.
const RESERVED: [&str; 24] = [
    names::INTENSITY,
    names::RETURNS,
    names::FLAGS,
    names::CLASSIFICATION,
    names::USER_DATA,
    names::SCAN_ANGLE_RANK,
    names::SCAN_ANGLE,
    names::POINT_SOURCE_ID,
    names::GPS_TIME,
    names::RED,
    names::GREEN,
    names::BLUE,
    names::NIR,
    names::WAVE_DESCRIPTOR,
    names::WAVE_OFFSET,
    names::WAVE_SIZE,
    names::WAVE_RETURN_POINT,
    names::WAVE_X_T,
    names::WAVE_Y_T,
    names::WAVE_Z_T,
    names::NX,
    names::NY,
    names::NZ,
    "extra_bytes",
];

/// The attributes of the `extra` bytes after the format's own fields, in the record's order and
/// without gaps. Malformed descriptions fall back to raw bytes with a note.
pub fn attributes(records: &Records, extra: usize, notes: &mut Vec<String>) -> Vec<Attribute> {
    let mut described = Vec::new();
    let mut bytes = 0;
    for vlr in records.all("LASF_Spec", 4) {
        if vlr.data.len() % DESCRIPTION_BYTES != 0 {
            notes.push(format!(
                "the extra-bytes VLR has {} bytes, no multiple of {DESCRIPTION_BYTES}: extra bytes are kept raw",
                vlr.data.len()
            ));
            return raw(0, extra);
        }
        for description in vlr.data.chunks_exact(DESCRIPTION_BYTES) {
            match describe(description, &described) {
                Ok(attributes) => {
                    bytes += attributes.iter().map(|a| a.ty.size()).sum::<usize>();
                    described.extend(attributes);
                }
                Err(what) => {
                    notes.push(format!("{what}: extra bytes are kept raw"));
                    return raw(0, extra);
                }
            }
            // Checked for each description, so that a hostile VLR cannot describe without end.
            if bytes > extra {
                notes.push(format!(
                    "the extra-bytes VLR describes more bytes than the {extra} that the records have: they are kept raw"
                ));
                return raw(0, extra);
            }
        }
    }
    let first = described.iter().filter(|a| a.name.starts_with("extra_bytes[")).count();
    described.extend(raw(first, extra - bytes));
    described
}

fn raw(first: usize, number: usize) -> Vec<Attribute> {
    (first..first + number)
        .map(|i| Attribute::new(format!("extra_bytes[{i}]"), AttrType::U8))
        .collect()
}

/// The attributes of one description: one for a value, several for an array, one per byte for
/// undocumented bytes.
pub fn describe(description: &[u8], before: &[Attribute]) -> Result<Vec<Attribute>, String> {
    let (kind, options) = (description[2], description[3]);
    if kind == 0 {
        if options == 0 {
            return Ok(vec![]);
        }
        let first = before.iter().filter(|a| a.name.starts_with("extra_bytes[")).count();
        return Ok(raw(first, usize::from(options)));
    }
    let (number, ty) = match kind {
        1..=10 => (1, kind),
        11..=20 => (2, kind - 10),
        21..=30 => (3, kind - 20),
        _ => return Err(format!("the extra-bytes VLR has the unknown data type {kind}")),
    };
    let ty = TYPES[usize::from(ty) - 1];
    let base = match text(&description[4..36]) {
        name if name.is_empty() => "unnamed".to_owned(),
        name if ty == AttrType::F32 && number == 1 && normal(&name).is_some() => {
            normal(&name).unwrap_or_default().to_owned()
        }
        name if RESERVED.contains(&name.as_str()) => format!("{name}_extra"),
        name => name,
    };
    let option = |bit: u8, at: usize, default: f64| {
        let value = f64_at(description, at);
        let usable = options & bit != 0 && value.is_finite() && (value != 0.0 || default == 0.0);
        if usable { value } else { default }
    };
    Ok((0..number)
        .map(|i| Attribute {
            name: if number == 1 { base.clone() } else { format!("{base}[{i}]") },
            ty,
            description: text(&description[160..]),
            scale: option(OPTION_SCALE, 112 + 8 * i, 1.0),
            offset: option(OPTION_OFFSET, 136 + 8 * i, 0.0),
        })
        .collect())
}

/// The descriptions in extra-bytes VLRs.
pub fn descriptions(records: &Records) -> impl Iterator<Item = &[u8]> {
    records.all("LASF_Spec", 4).flat_map(|vlr| vlr.data.chunks_exact(DESCRIPTION_BYTES))
}

/// Names that exported extra dimensions avoid, because other programs use them for something else.
/// Normals are exported under other names.
pub fn avoided_names() -> Vec<&'static str> {
    let normals = NORMALS.map(|(_, own)| own);
    let fields = RESERVED.into_iter().filter(|name| !normals.contains(name));
    fields.chain(["x", "y", "z", "X", "Y", "Z", "return_number", "number_of_returns"]).collect()
}

/// Common names of normals in LAS, and the attributes of Esker.
const NORMALS: [(&str, &str); 3] =
    [("NormalX", names::NX), ("NormalY", names::NY), ("NormalZ", names::NZ)];

fn normal(name: &str) -> Option<&'static str> {
    NORMALS.iter().find(|(usual, _)| *usual == name).map(|&(_, own)| own)
}

/// Describes `attributes`, each a value of its own: the inverse of [`attributes`]. If one of the
/// `known` descriptions is equal but for limits, its no-data value is kept; least and greatest
/// values are dropped, because they belong to other points.
pub fn describe_all(attributes: &[Attribute], known: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::with_capacity(attributes.len() * DESCRIPTION_BYTES);
    for a in attributes {
        let mut description = [0; DESCRIPTION_BYTES];
        let mut put = |at: usize, bytes: &[u8], room: usize| {
            let n = bytes.len().min(room);
            description[at..at + n].copy_from_slice(&bytes[..n]);
        };
        let kind = TYPES.iter().position(|&ty| ty == a.ty).map_or(0, |i| i as u8 + 1);
        let scale = if a.scale == 1.0 { 0 } else { OPTION_SCALE };
        let offset = if a.offset == 0.0 { 0 } else { OPTION_OFFSET };
        let is_same =
            |d: &&Vec<u8>| describe(d, &[]).is_ok_and(|described| described == [a.clone()]);
        let has_none = known.iter().find(is_same).filter(|d| d[3] & OPTION_NO_DATA != 0);
        let none = has_none.map_or(0, |_| OPTION_NO_DATA);
        let usual = NORMALS.iter().find(|(_, own)| *own == a.name && a.ty == AttrType::F32);
        put(2, &[kind, none | scale | offset], 2);
        put(4, usual.map_or(a.name.as_str(), |(usual, _)| usual).as_bytes(), NAME_BYTES);
        has_none.iter().for_each(|d| put(NO_DATA_AT, &d[NO_DATA_AT..NO_DATA_AT + 8], 8));
        put(112, &a.scale.to_le_bytes(), if scale > 0 { 8 } else { 0 });
        put(136, &a.offset.to_le_bytes(), if offset > 0 { 8 } else { 0 });
        put(160, a.description.as_bytes(), 32);
        out.extend_from_slice(&description);
    }
    out
}

/// Data types 1 to 10 of the extra-bytes VLR.
const TYPES: [AttrType; 10] = [
    AttrType::U8,
    AttrType::I8,
    AttrType::U16,
    AttrType::I16,
    AttrType::U32,
    AttrType::I32,
    AttrType::U64,
    AttrType::I64,
    AttrType::F32,
    AttrType::F64,
];
