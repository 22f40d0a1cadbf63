//! Contents of a file as JSON, which the samples of every version are compared by.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_format::{EskerFile, PagePoints, PlaneKind};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Folder of the samples.
pub fn folder() -> PathBuf {
    PathBuf::from("../../data-format/samples")
}

pub fn describe(file: &EskerFile) -> Value {
    let (footer, metadata, layout) = (file.footer(), file.metadata(), file.layout());
    let mut encodings = BTreeSet::new();
    let mut normals = Vec::new();
    let mut each = Vec::new();
    for node in 0..footer.nodes as u32 {
        let page = file.read_page(node).unwrap();
        encodings.extend(page.directory().entries.iter().map(|e| e.encoding.number()));
        normals.extend(page.plane(PlaneKind::Normal).unwrap().unwrap_or_default());
        let points = page.points().unwrap();
        each.push(json!({
            "points": points.len(),
            "continuation": file.node(node).unwrap().is_continuation(),
            "first": point(file, &points, 0),
            "last": point(file, &points, points.len() - 1),
        }));
    }
    let attributes = layout.schema().attributes.iter();
    let forest = metadata.forest.iter();
    let mut described = json!({
        "points": footer.points,
        "multiset_hash": footer.hash.to_string(),
        "footer_hash": format!("{:032x}", footer.name_hash()),
        "compress": metadata.codec.name(),
        "normals": metadata.normals.name(),
        "normals_crc": crc32fast::hash(&normals),
        "attributes": attributes.map(|a| format!("{}:{}", a.name, a.ty.name())).collect::<Vec<_>>(),
        "classes": layout.classes().len(),
        "planes": layout.planes().iter().map(|p| p.kind.name()).collect::<Vec<_>>(),
        "encodings": encodings,
        "forest": forest.map(|t| json!([t.path, format!("{:032x}", t.footer_hash)])).collect::<Vec<_>>(),
        "verbatim": file.verbatim(0).unwrap(),
        "nodes": each,
    });
    // Version 1 has no factors.
    if footer.version > 1 {
        described["factor"] = json!(metadata.lattice.factor);
    }
    described
}

/// Coordinates, class, and the raw values of the attributes, in hexadecimal digits.
fn point(file: &EskerFile, points: &PagePoints, i: usize) -> Value {
    let attributes = file.layout().schema().attributes.iter().zip(&points.columns);
    let value = |size: usize, column: &[u8]| -> String {
        column[i * size..][..size].iter().map(|b| format!("{b:02x}")).collect()
    };
    let values: Vec<_> = attributes.map(|(a, column)| value(a.ty.size(), column)).collect();
    json!([points.positions[i], points.radius_codes[i], points.class(i), values.join(" ")])
}
