//! Writes the sample files of the format's version into `data-format/samples`, and their contents
//! as `expected.json`. For a new version only: the samples of a frozen version are never written
//! again.

#![allow(clippy::unwrap_used, reason = "run by hand")]

#[path = "../tests/describe/mod.rs"]
mod describe;
#[path = "../tests/tree/mod.rs"]
mod tree;

use describe::{describe, folder};
use esker_format::{Codec, EskerFile, Metadata, Normals, PageLayout, PagePoints, TreeRef};
use esker_points::{AttrType, Attribute, ColourDepth, PointClass, Schema};
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

fn plain(list: &[(&str, AttrType)], codec: Codec) -> Metadata {
    let schema = Schema::new(list.iter().map(|&(n, t)| Attribute::new(n, t)).collect());
    let present = (0..schema.attributes.len() as u16).collect();
    let class = PointClass { present, colour_depth: ColourDepth::Sixteen };
    Metadata { codec, ..tree::metadata(schema, vec![class]) }
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
    use AttrType::{F64, I16, U8, U16};
    let las = [
        ("intensity", U16),
        ("returns", U8),
        ("classification", U8),
        ("scan_angle", I16),
        ("gps_time", F64),
        ("red", U16),
        ("green", U16),
        ("blue", U16),
    ];
    let small = Metadata { normals: Normals::Estimated, ..plain(&las, Codec::Small) };
    let first = plain(&las[..3], Codec::None);
    let second = plain(&las[..5], Codec::Fast);
    let folder = folder();
    std::fs::create_dir_all(&folder).unwrap();
    let mut expected = BTreeMap::new();
    let mut write = |name: &str, metadata: &Metadata, count, coincident, capacity| {
        let path = folder.join(name);
        tree::write(&path, metadata, &points_of(metadata, count, coincident), capacity);
        let file = EskerFile::open(&path).unwrap();
        expected.insert(name.to_string(), describe(&file));
        file.footer().name_hash()
    };
    write("all-kinds.esker", &all_kinds(), 900, 250, 100);
    write("small.esker", &small, 1000, 0, 400);
    write("empty.esker", &plain(&las, Codec::Fast), 0, 0, 100);
    let footer_hash = write("forest-first.esker", &first, 200, 0, 100);
    let forest = vec![TreeRef { path: "forest-first.esker".into(), footer_hash }];
    write("forest-second.esker", &Metadata { forest, ..second }, 300, 0, 150);
    let text = serde_json::to_string_pretty(&expected).unwrap() + "\n";
    std::fs::write(folder.join("expected.json"), text).unwrap();
}
