//! Text of a report on an `.esker` file or a scan ([`super::info`]): lines of a word and what it
//! stands for.

use super::info::{AttributeInfo, FileInfo, InfoReport, OctreeInfo, ScanInfo, SourceReport};
use crate::io::quantity::{grouped, readable_bytes};

/// Most characters of a coordinate reference system in a text.
const CRS_CHARS_MAX: usize = 200;

/// Text of a report.
pub fn text(report: &InfoReport) -> String {
    match report {
        InfoReport::File(file) => file.lines().join("\n"),
        InfoReport::Scan(scan) => scan.lines().join("\n"),
    }
}

impl ScanInfo {
    fn lines(&self) -> Vec<String> {
        let state = if self.octree.is_some() { "drawn without building" } else { "not yet built" };
        let mut lines = vec![format!("{}: a scan ({}), {state}", self.scan, self.format)];
        lines.extend(place_lines(self.points, self.bounds, self.scale, self.offset));
        lines.extend(crs_lines(self.unit.as_deref(), self.crs.as_deref()));
        lines.push(attributes_line(self.attributes.iter()));
        lines.extend(self.colour_bits.map(|bits| format!("colours      {bits} bits")));
        lines.extend(self.octree.as_ref().map(|octree| {
            let OctreeInfo { edge, spacing, levels, voxels, has_more, .. } = octree;
            let more = if *has_more { ", and more in other pages" } else { "" };
            format!(
                "octree       {} voxels with points on {levels} levels{more}; edge {edge}, spacing {spacing}",
                grouped(*voxels)
            )
        }));
        lines.extend(self.notes.iter().map(|note| format!("note         {note}")));
        lines
    }
}

impl FileInfo {
    fn lines(&self) -> Vec<String> {
        let mut lines = place_lines(self.points, self.bounds, self.scale, self.offset);
        lines.extend(self.factor.map(|factor| {
            let [x, y, z] = factor.map(|metres| format!("{metres:.3}"));
            format!("lengths      in metres: {x} a unit of x, {y} of y, {z} of z")
        }));
        lines.extend(crs_lines(self.unit.as_deref(), self.crs.as_deref()));
        lines.push(attributes_line(self.attributes.iter().map(|a| &a.attribute)));
        lines.extend(self.node_lines());
        lines.extend(self.byte_lines());
        if self.set_aside > 0 {
            let points = grouped(self.set_aside);
            lines.push(format!("set aside    {points} points far from nearly all others"));
        }
        for tree in self.trees.iter().filter(|_| self.trees.len() > 1) {
            let (points, nodes) = (grouped(tree.points), grouped(tree.nodes));
            lines.push(format!("tree         {}, {points} points in {nodes} nodes", tree.path));
        }
        lines.extend(self.sources.iter().flat_map(SourceReport::lines));
        lines
    }

    fn node_lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "nodes        {} of at most {} points; {:.0} % full on average, {:.0} % under a sixteenth",
            grouped(self.nodes as u64),
            self.node_capacity,
            self.node_fill_mean * 100.0,
            self.small_nodes_share * 100.0
        )];
        for depth in &self.depths {
            lines.push(format!(
                "  depth {} {:>9} nodes {:>15} points",
                depth.depth,
                grouped(depth.nodes),
                grouped(depth.points)
            ));
        }
        lines
    }

    fn byte_lines(&self) -> [String; 3] {
        let each = &self.bytes_a_point;
        let planes = each.planes.iter();
        let planes: Vec<_> = planes.map(|p| format!("{} {:.2}", p.plane, p.bytes)).collect();
        [
            format!(
                "bytes        {}; a point {:.1} hot, {:.1} residual, {:.1} cold",
                readable_bytes(self.bytes),
                each.hot,
                each.residual,
                each.cold,
            ),
            format!(
                "structure    {} in memory, {} a node; {} in the file",
                readable_bytes(self.structure_bytes as u64),
                self.table_bytes_a_node,
                readable_bytes(self.table_bytes)
            ),
            format!("planes       {} (bytes a point; {})", planes.join(", "), self.compress),
        ]
    }
}

impl SourceReport {
    fn lines(&self) -> Vec<String> {
        let colours = self.colour_bits.map_or(String::new(), |b| format!(", {b}-bit colours"));
        let times = self.gps_times.map_or(String::new(), |times| format!(", GPS times: {times}"));
        let points = grouped(self.points);
        let mut lines = vec![format!(
            "source       {} ({}), {points} points{colours}{times}",
            self.path, self.format
        )];
        lines.extend(self.notes.iter().map(|note| format!("  note       {note}")));
        lines
    }
}

/// Lines on the number and the coordinates of points.
fn place_lines(
    points: u64,
    bounds: Option<[[f64; 3]; 2]>,
    scale: [f64; 3],
    offset: [f64; 3],
) -> Vec<String> {
    let mut lines = vec![format!("points       {}", grouped(points))];
    lines.extend(
        bounds.map(|[low, high]| format!("bounds       {} to {}", vector(low), vector(high))),
    );
    lines.push(format!("step         {}  offset {}", vector(scale), vector(offset)));
    lines
}

/// Lines on the coordinate reference system.
fn crs_lines(unit: Option<&str>, crs: Option<&str>) -> Vec<String> {
    let one_line = |crs: &str| {
        let words: Vec<_> = crs.split_whitespace().collect();
        words.join(" ").chars().take(CRS_CHARS_MAX).collect::<String>()
    };
    let unit = Some(format!("unit         {}", unit.unwrap_or("not stated")));
    let crs = crs.map(|crs| format!("crs          {}", one_line(crs)));
    unit.into_iter().chain(crs).collect()
}

fn attributes_line<'a>(attributes: impl Iterator<Item = &'a AttributeInfo>) -> String {
    let names: Vec<_> = attributes.map(|a| format!("{}:{}", a.name, a.ty)).collect();
    format!("attributes   {}", names.join(" "))
}

/// Numbers as in JSON: the shortest digits that give the same value.
fn vector(numbers: [f64; 3]) -> String {
    serde_json::json!(numbers).to_string()
}
