//! What a file says of itself: counts, bounds, attributes, sources, and how its points lie in the
//! tree.

use crate::io::quantity::{grouped, readable_bytes};
use anyhow::Result;
use esker_format::{Forest, PlaneKind, SourceRecord};
use esker_points::{MultisetHash, Node, NodeTable, Task};
use esker_scan::las::{GpsTimes, gps_times};
use esker_scan::{OpenOptions, SourceInfo};
use serde_json::{Value, json};
use std::path::Path;

/// Notes that are told in a few lines.
const NOTES_MAX: usize = 6;

/// A node with less than this share of the capacity is a small one.
const SMALL_SHARE: f64 = 1.0 / 16.0;

/// World bounds of all points; zeros where there is no point.
pub fn bounds(forest: &Forest) -> [[f64; 3]; 2] {
    forest.bounds().map_or([[0.0; 3]; 2], |b| b.map(|corner| forest.lattice().world(corner)))
}

/// What there is to know of an `.esker` file, or, before building, of a scan.
///
/// # Errors
/// Where it cannot be read.
pub fn info(path: &Path, task: &dyn Task) -> Result<Value> {
    if !crate::io::file::is_esker(path)? {
        let source = esker_scan::open(path, &OpenOptions::default(), task)?;
        return Ok(scan(source.info()));
    }
    let forest = Forest::open(path)?;
    let (table, lattice) = (forest.table(), forest.lattice());
    let records = || forest.files().flat_map(|file| &file.metadata().sources);
    let footers = || forest.files().map(|file| file.footer());
    let capacity = footers().map(|footer| footer.node_capacity).max().unwrap_or(0);
    let first_crs = records().find_map(|s| s.crs.as_ref());
    let mut hash = MultisetHash::default();
    footers().for_each(|footer| hash += footer.hash);
    let attributes: Vec<Value> = forest
        .schema()
        .attributes
        .iter()
        .map(|a| json!({"name": a.name, "type": a.ty.name(), "description": a.description, "scale": a.scale, "offset": a.offset}))
        .collect();
    Ok(json!({
        "points": forest.points(),
        "bounds": forest.bounds().map(|_| bounds(&forest)),
        "scale": lattice.scale,
        "offset": lattice.offset,
        "shift": lattice.shift,
        "rounding_error_max": footers().map(|f| f.rounding_error_max).fold(0.0, f64::max),
        "attributes": attributes,
        "classes": forest.files().map(|file| file.metadata().classes.len()).sum::<usize>(),
        "crs": first_crs.map(|c| &c.text),
        "unit": first_crs.and_then(|c| c.unit.as_ref()),
        "nodes": table.nodes.len(),
        "node_capacity": capacity,
        "node_fill_mean": fill(table, capacity),
        "small_nodes_share": small_share(table, capacity),
        "depths": depths(table),
        "bytes": forest.file_bytes(),
        "bytes_a_point": bytes_a_point(&forest)?,
        "compress": each_once(&forest, |file| file.metadata().codec.name()),
        "normals": each_once(&forest, |file| file.metadata().normals.name()),
        "table_bytes_a_node": table.bytes_a_node(),
        "table_bytes": footers().map(|footer| footer.table.bytes).sum::<u64>(),
        "structure_bytes": table.bytes(),
        "multiset_hash": hash.to_string(),
        "generator": forest.files().next().map(|file| &file.metadata().generator),
        "sources": sources(&forest)?,
        "trees": trees(&forest),
    }))
}

/// The unit of a file's lengths, where one of its sources tells one; none where coordinates are
/// degrees.
pub fn unit(forest: &Forest) -> Option<String> {
    let mut records = forest.files().flat_map(|file| &file.metadata().sources);
    records.find_map(|s| s.crs.as_ref())?.unit.clone().filter(|unit| unit != "degree")
}

/// What reading the sources of a file has left out or found odd: points that were refused, by
/// reason, and the notes, each once and the first of many.
pub fn notes(forest: &Forest) -> Vec<String> {
    let records = || forest.files().flat_map(|file| &file.metadata().sources);
    let mut refused = std::collections::BTreeMap::<&str, u64>::new();
    for (reason, points) in records().flat_map(|s| &s.refused) {
        *refused.entry(reason).or_default() += points;
    }
    let refused = refused
        .into_iter()
        .map(|(reason, points)| format!("left out: {} points: {reason}", grouped(points)));
    let mut all: Vec<String> = refused.collect();
    for note in records().flat_map(|s| &s.notes) {
        if !all.contains(note) {
            all.push(note.clone());
        }
    }
    if all.len() > NOTES_MAX {
        let more = all.len() - NOTES_MAX;
        all.truncate(NOTES_MAX);
        all.push(format!("and {more} more, see esker info"));
    }
    all
}

/// The sources of all trees.
fn sources(forest: &Forest) -> Result<Vec<Value>> {
    let mut all = Vec::new();
    for file in forest.files() {
        for (i, record) in file.metadata().sources.iter().enumerate() {
            all.push(source(record, gps_times(&file.verbatim(i)?)));
        }
    }
    Ok(all)
}

fn source(s: &SourceRecord, gps_times: Option<GpsTimes>) -> Value {
    json!({
        "path": s.path, "format": s.format, "points": s.points, "refused": s.refused,
        "rounding_error_max": s.rounding_error_max,
        "colour_bits": s.colour_depth.map(bits), "colour_bits_forced": s.colour_depth_forced,
        "crs": s.crs.as_ref().map(|c| &c.text), "unit": s.crs.as_ref().and_then(|c| c.unit.as_ref()),
        "gps_times": gps_times.map(GpsTimes::name),
        "notes": s.notes,
    })
}

/// The trees of a forest, one a file: the file itself first.
fn trees(forest: &Forest) -> Vec<Value> {
    let tree = |file: &esker_format::EskerFile| {
        let footer = file.footer();
        json!({
            "path": file.path().display().to_string(), "points": footer.points, "nodes": footer.nodes,
            "bytes": footer.file_bytes, "multiset_hash": footer.hash.to_string(),
            "footer_hash": format!("{:032x}", footer.name_hash()),
        })
    };
    forest.files().map(tree).collect()
}

fn bits(depth: esker_points::ColourDepth) -> u32 {
    match depth {
        esker_points::ColourDepth::Eight => 8,
        esker_points::ColourDepth::Sixteen => 16,
    }
}

/// A scan that is not yet built: what its header says, nothing decoded.
fn scan(info: &SourceInfo) -> Value {
    let attributes: Vec<Value> = info
        .schema
        .attributes
        .iter()
        .map(|a| json!({"name": a.name, "type": a.ty.name(), "description": a.description}))
        .collect();
    json!({
        "scan": info.path.display().to_string(),
        "format": info.format,
        "points": info.points_hint,
        "bounds": info.grid.bounds,
        "scale": info.grid.grid.scale,
        "offset": info.grid.grid.offset,
        "attributes": attributes,
        "colour_bits": info.colour_depth.map(bits),
        "crs": info.crs.as_ref().map(|c| &c.text),
        "unit": info.crs.as_ref().and_then(|c| c.unit.as_ref()),
        "gps_times": gps_times(&info.verbatim).map(GpsTimes::name),
        "bytes": info.bytes,
        "notes": info.notes,
    })
}

fn fill(table: &NodeTable, capacity: u32) -> f64 {
    let points: usize = table.nodes.iter().map(Node::points).sum();
    points as f64 / (table.nodes.len().max(1) as f64 * f64::from(capacity.max(1)))
}

fn small_share(table: &NodeTable, capacity: u32) -> f64 {
    let small =
        table.nodes.iter().filter(|n| (n.points() as f64) < f64::from(capacity) * SMALL_SHARE);
    small.count() as f64 / table.nodes.len().max(1) as f64
}

/// Nodes and points at each depth.
fn depths(table: &NodeTable) -> Vec<Value> {
    let mut out: Vec<(u64, u64)> = Vec::new();
    for (node, depth) in table.nodes.iter().zip(table.depths()) {
        let depth = depth as usize;
        if out.len() <= depth {
            out.resize(depth + 1, (0, 0));
        }
        out[depth].0 += 1;
        out[depth].1 += node.points() as u64;
    }
    out.into_iter()
        .enumerate()
        .map(|(depth, (nodes, points))| json!({"depth": depth, "nodes": nodes, "points": points}))
        .collect()
}

/// What the trees of a forest say, each answer once.
fn each_once(forest: &Forest, of: impl Fn(&esker_format::EskerFile) -> &'static str) -> String {
    let mut said: Vec<_> = forest.files().map(of).collect();
    said.sort_unstable();
    said.dedup();
    said.join(", ")
}

/// Bytes a point of hot planes, residuals, and everything else in the pages; and of each plane.
fn bytes_a_point(forest: &Forest) -> Result<Value> {
    let (mut hot, mut residual, mut cold, mut directories) = (0u64, 0u64, 0u64, 0u64);
    let mut planes: Vec<((String, bool, bool), u64)> = Vec::new();
    for file in forest.files() {
        let layout = file.layout();
        directories += (layout.directory_bytes() * file.table().nodes.len()) as u64;
        for (plane, bytes) in layout.planes().iter().zip(file.plane_bytes()?) {
            *match plane.kind {
                PlaneKind::Residual => &mut residual,
                _ if plane.hot => &mut hot,
                _ => &mut cold,
            } += bytes;
            let name = match plane.kind {
                PlaneKind::Attribute(a) => layout.schema().attributes[usize::from(a)].name.clone(),
                kind => kind.name(),
            };
            // An attribute may be called as a plane is.
            let is_attribute = matches!(plane.kind, PlaneKind::Attribute(_));
            let key = (name, plane.hot, is_attribute);
            match planes.iter_mut().find(|p| p.0 == key) {
                Some(known) => known.1 += bytes,
                None => planes.push((key, bytes)),
            }
        }
    }
    let points = forest.points().max(1) as f64;
    let planes: Vec<_> = planes
        .iter()
        .map(|((name, hot, _), bytes)| json!({"plane": name, "hot": hot, "bytes": *bytes as f64 / points}))
        .collect();
    Ok(json!({
        "hot": hot as f64 / points,
        "residual": residual as f64 / points,
        "cold": cold as f64 / points,
        "directories": directories as f64 / points,
        "all": forest.file_bytes() as f64 / points,
        "planes": planes,
    }))
}

/// [`info`] for people.
pub fn text(info: &Value) -> String {
    let mut lines = Vec::new();
    let count = |name: &str| grouped(info[name].as_u64().unwrap_or(0));
    if let Some(scan) = info["scan"].as_str() {
        lines.push(format!(
            "{scan}: a scan ({}), not yet built",
            info["format"].as_str().unwrap_or("?")
        ));
    }
    lines.push(format!("points       {}", count("points")));
    if let Some([low, high]) = info["bounds"].as_array().map(Vec::as_slice) {
        lines.push(format!("bounds       {low} to {high}"));
    }
    lines.push(format!("step         {}  offset {}", info["scale"], info["offset"]));
    if let Some(unit) = info["unit"].as_str() {
        lines.push(format!("unit         {unit}"));
    }
    if let Some(crs) = info["crs"].as_str() {
        lines.push(format!(
            "crs          {}",
            crs.split_whitespace()
                .collect::<Vec<_>>()
                .join(" ")
                .chars()
                .take(200)
                .collect::<String>()
        ));
    }
    let attributes = info["attributes"].as_array().into_iter().flatten();
    let names: Vec<_> = attributes
        .filter_map(|a| Some(format!("{}:{}", a["name"].as_str()?, a["type"].as_str()?)))
        .collect();
    lines.push(format!("attributes   {}", names.join(" ")));
    if info["scan"].is_null() {
        tree_lines(info, &mut lines);
    } else if let Some(bits) = info["colour_bits"].as_u64() {
        lines.push(format!("colours      {bits} bits"));
    }
    for note in info["notes"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        lines.push(format!("note         {note}"));
    }
    lines.join("\n")
}

fn tree_lines(info: &Value, lines: &mut Vec<String>) {
    let percent = |name: &str| info[name].as_f64().unwrap_or(0.0) * 100.0;
    lines.push(format!(
        "nodes        {} of at most {} points; {:.0} % full on average, {:.0} % under a sixteenth",
        grouped(info["nodes"].as_u64().unwrap_or(0)),
        info["node_capacity"],
        percent("node_fill_mean"),
        percent("small_nodes_share")
    ));
    for depth in info["depths"].as_array().into_iter().flatten() {
        let n = |name: &str| grouped(depth[name].as_u64().unwrap_or(0));
        lines.push(format!(
            "  depth {:<4} {:>9} nodes {:>15} points",
            depth["depth"],
            n("nodes"),
            n("points")
        ));
    }
    let each = &info["bytes_a_point"];
    let bytes = |name: &str| each[name].as_f64().unwrap_or(0.0);
    lines.push(format!(
        "bytes        {}; a point {:.1} hot, {:.1} residual, {:.1} cold",
        readable_bytes(info["bytes"].as_u64().unwrap_or(0)),
        bytes("hot"),
        bytes("residual"),
        bytes("cold"),
    ));
    lines.push(format!(
        "structure    {} in memory, {} a node; {} in the file",
        readable_bytes(info["structure_bytes"].as_u64().unwrap_or(0)),
        info["table_bytes_a_node"],
        readable_bytes(info["table_bytes"].as_u64().unwrap_or(0))
    ));
    let planes = each["planes"].as_array().into_iter().flatten();
    let planes: Vec<_> = planes
        .filter_map(|p| Some(format!("{} {:.2}", p["plane"].as_str()?, p["bytes"].as_f64()?)))
        .collect();
    let codec = info["compress"].as_str().unwrap_or("?");
    lines.push(format!("planes       {} (bytes a point; {codec})", planes.join(", ")));
    let trees = info["trees"].as_array().map_or(&[][..], Vec::as_slice);
    for tree in trees.iter().filter(|_| trees.len() > 1) {
        lines.push(format!(
            "tree         {}, {} points in {} nodes",
            tree["path"].as_str().unwrap_or("?"),
            grouped(tree["points"].as_u64().unwrap_or(0)),
            grouped(tree["nodes"].as_u64().unwrap_or(0))
        ));
    }
    for source in info["sources"].as_array().into_iter().flatten() {
        let colours =
            source["colour_bits"].as_u64().map_or(String::new(), |b| format!(", {b}-bit colours"));
        let times = source["gps_times"].as_str();
        let times = times.map_or(String::new(), |times| format!(", GPS times: {times}"));
        lines.push(format!(
            "source       {} ({}), {} points{colours}{times}",
            source["path"].as_str().unwrap_or("?"),
            source["format"].as_str().unwrap_or("?"),
            grouped(source["points"].as_u64().unwrap_or(0))
        ));
        for note in source["notes"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            lines.push(format!("  note       {note}"));
        }
    }
}
