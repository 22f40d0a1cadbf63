//! No-data values of extra bytes (LAS 1.4 R15, table 24): the stored value that stands for "no
//! value", as the descriptions of each source state it. Sources may state different ones for
//! attributes of one name and type, of which a file can have only one.

use super::EXTRA_BYTES_MAX;
use super::extra_bytes::{NO_DATA_AT, OPTION_NO_DATA, attributes, describe, descriptions};
use super::header::{Header, f64_at, format_bytes};
use super::vlr::of_blocks;
use esker_points::{AttrType, Attribute};
use std::path::Path;

/// The no-data values of sources.
#[derive(Clone, Debug, Default)]
pub struct NoData(Vec<(Attribute, Vec<Option<Vec<u8>>>)>);

impl NoData {
    /// Adds those of a source, from its blocks kept verbatim.
    pub fn add(&mut self, verbatim: &[(String, Vec<u8>)]) {
        for (attribute, value) in of_source(verbatim) {
            let same = |(known, _): &&mut (Attribute, _)| known.key() == attribute.key();
            match self.0.iter_mut().find(same) {
                Some((_, values)) if values.contains(&value) => {}
                Some((_, values)) => values.push(value),
                None => self.0.push((attribute, vec![value])),
            }
        }
    }

    /// The stored no-data value of an attribute, if all its sources state the same.
    pub(crate) fn of(&self, attribute: &Attribute) -> Option<&[u8]> {
        match self.values(attribute) {
            [one] => one.as_deref(),
            _ => None,
        }
    }

    fn values(&self, attribute: &Attribute) -> &[Option<Vec<u8>>] {
        let found = self.0.iter().find(|(known, _)| known.key() == attribute.key());
        found.map_or(&[], |(_, values)| values)
    }

    /// Attributes for which sources state different values, and these values as stored:
    /// `height (-32768, -1, none)`.
    pub fn conflicts(&self) -> Vec<String> {
        let differ = self.0.iter().filter(|(_, values)| values.len() > 1);
        let all = differ.map(|(attribute, values)| {
            let text = |value: &Option<Vec<u8>>| match value {
                Some(value) => attribute.ty.to_f64(value).to_string(),
                None => "none".into(),
            };
            let values: Vec<String> = values.iter().map(text).collect();
            format!("{} ({})", attribute.name, values.join(", "))
        });
        all.collect()
    }
}

/// The described extra bytes of a source, and the stored no-data value of each.
fn of_source(verbatim: &[(String, Vec<u8>)]) -> Vec<(Attribute, Option<Vec<u8>>)> {
    let block = |name| {
        let found = verbatim.iter().find(|(n, _)| n == name);
        found.map_or(&[][..], |(_, bytes)| bytes.as_slice())
    };
    // The blocks were checked when they were read; here their sizes are not trusted.
    let Ok(header) = Header::parse(block("las header"), u64::MAX, Path::new("")) else {
        return Vec::new();
    };
    let base = format_bytes(header.point_format).unwrap_or(0);
    let extra = header.record_bytes.saturating_sub(base);
    if extra == 0 || extra > EXTRA_BYTES_MAX {
        return Vec::new();
    }
    let (records, _) = of_blocks(&header, block("las vlrs"), block("las evlrs"));
    let known = attributes(&records, extra, &mut Vec::new());
    let mut described: Vec<Attribute> = Vec::new();
    let mut out = Vec::new();
    for description in descriptions(&records) {
        let Ok(own) = describe(description, &described) else { break };
        // Descriptions without bytes in the record are refused as a whole by the reader.
        if described.len() + own.len() > known.len() {
            break;
        }
        for (i, attribute) in own.iter().enumerate().filter(|_| description[2] != 0) {
            let value = (description[3] & OPTION_NO_DATA != 0)
                .then(|| stored(attribute.ty, description, NO_DATA_AT + 8 * i));
            out.push((attribute.clone(), value));
        }
        described.extend(own);
    }
    out
}

/// The value at `at` of a description, which has 8 bytes, in an attribute's type.
fn stored(ty: AttrType, description: &[u8], at: usize) -> Vec<u8> {
    match ty {
        AttrType::F32 => (f64_at(description, at) as f32).to_le_bytes().to_vec(),
        _ => description[at..at + ty.size()].to_vec(),
    }
}
