//! Writes the sample file of version 2 into `data-format/samples`, and its contents into
//! `expected.json`. For a new version only: the samples of a frozen version are never written
//! again.

#![allow(clippy::unwrap_used, reason = "run by hand")]

#[path = "../tests/describe/mod.rs"]
mod describe;
#[path = "../tests/tree/mod.rs"]
mod tree;

use describe::{describe, folder};
use esker_format::{EskerFile, Metadata, PageLayout, PagePoints};
use esker_points::{AttrType, Attribute, Schema};
use serde_json::Value;
use std::collections::BTreeMap;

/// Points on a slope, with values that are partly smooth and partly noise; the last `coincident`
/// coincide.
fn points_of(metadata: &Metadata, count: usize, coincident: usize) -> PagePoints {
    let layout: PageLayout = metadata.layout();
    let schema = &metadata.schema;
    let classes = metadata.classes.len();
    let mut points =
        PagePoints { columns: vec![Vec::new(); schema.attributes.len()], ..PagePoints::default() };
    for i in 0..count as u64 {
        let noise = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 20;
        let place = if i + coincident as u64 >= count as u64 { 0 } else { noise };
        let (x, y) = ((place % 120_000) as u32, (place / 7 % 90_000) as u32);
        points.positions.push([(1 << 31) + x, (1 << 31) - 45_000 + y, (1 << 31) + (x + y) / 8]);
        points.radius_codes.push(120 + (noise % 9) as u8);
        let class = (noise as usize / 3) % classes;
        if classes > 1 {
            points.classes.push(class as u16);
        }
        if metadata.normals.is_estimated() {
            points.normals.push([(noise % 2000) as i16 - 1000, (x / 100) as i16]);
        }
        for (a, attribute) in schema.attributes.iter().enumerate() {
            let value = match (a as u64 + noise % 2) % 4 {
                0 => (noise % 5).to_le_bytes(),
                _ if attribute.ty == AttrType::F32 => {
                    u64::from((x as f32 / 7.0).to_bits()).to_le_bytes()
                }
                _ if attribute.ty == AttrType::F64 => (3e8 + f64::from(x) / 64.0).to_le_bytes(),
                1 if a % 3 == 0 => noise.to_le_bytes(),
                _ => (7 + i / 100).to_le_bytes(),
            };
            let value = if attribute.name.starts_with("one") { [7; 8] } else { value };
            let value = if layout.has_attribute(class, a) { value } else { [0; 8] };
            points.columns[a].extend_from_slice(&value[..attribute.ty.size()]);
        }
    }
    points
}

/// Attributes of every type, five classes of points, exact normals.
fn all_kinds() -> Metadata {
    use AttrType::{F32, I8, I16, I32, I64, U8, U32, U64};
    let (schema, mut classes) = tree::mixed_schema();
    let more = [
        ("a", I8),
        ("b", I32),
        ("c", I64),
        ("d", U32),
        ("e", U64),
        ("f", F32),
        ("g", I16),
        ("one", U8),
    ];
    let more = more.map(|(name, ty)| Attribute::new(name, ty));
    let all = Schema::new([schema.attributes.clone(), more.to_vec()].concat());
    for class in &mut classes {
        let old = class.present.iter().map(|&a| schema.attributes[usize::from(a)].key());
        let mut present: Vec<u16> = old
            .chain(more.iter().map(Attribute::key))
            .map(|(name, ty)| all.find_typed(name, ty).unwrap() as u16)
            .collect();
        present.sort_unstable();
        class.present = present;
    }
    tree::metadata(all, classes)
}

fn main() {
    let folder = folder();
    let list = folder.join("expected.json");
    let mut expected: BTreeMap<String, Value> =
        serde_json::from_str(&std::fs::read_to_string(&list).unwrap()).unwrap();
    let name = "degrees.esker";
    let metadata = tree::in_degrees(all_kinds());
    tree::write(&folder.join(name), &metadata, &points_of(&metadata, 400, 100), 100);
    expected.insert(name.into(), describe(&EskerFile::open(&folder.join(name)).unwrap()));
    let text = serde_json::to_string_pretty(&expected).unwrap() + "\n";
    std::fs::write(list, text).unwrap();
}
