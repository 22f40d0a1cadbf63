//! A file with the node table of 10^10 points, each node of which has one point: a square of
//! terrain, 16.8 km wide, as a tree of 10 levels and parts of one more, with the spacings that
//! nodes of 24,000 points have.

use esker_format::{
    Codec, FileWriter, Histograms, Metadata, NodeStatistics, Normals, PageLayout, PagePoints,
    Ranges, Statistics, encode_page,
};
use esker_points::node::{NONE, Node};
use esker_points::{
    AttrType, Attribute, Cell, ColourDepth, Lattice, MultisetHash, NodeTable, PointClass, Schema,
};
use std::path::Path;

/// Length of a step, metres.
const STEP: f64 = 0.001;
/// Log2 of the root's edge in steps, and its corner on each axis.
const LOG2: u8 = 24;
const CORNER: u32 = 1 << 31;
/// Least level of all leaves.
const LEVELS: u8 = 9;
/// Points of a node along an edge of its cell.
const ACROSS: f64 = 155.0;

/// Height of the terrain at a place of the square, steps from its corner.
fn height(x: f64, y: f64) -> f64 {
    let waves = (x * 9.0).sin() * (y * 7.0).cos() + 0.3 * (x * 61.0 + y * 43.0).sin();
    (0.02 + 0.004 * waves) * f64::from(1u32 << LOG2)
}

/// World coordinates of a place on the terrain, given as shares of the square.
pub fn place([x, y]: [f64; 2]) -> [f64; 3] {
    let edge = f64::from(1u32 << LOG2);
    [x * edge * STEP, y * edge * STEP, height(x, y) * STEP]
}

/// A node and its only point.
fn node(level: u8, corner: [u32; 3], parent: u32) -> (Node, [u64; 2]) {
    let cell = Cell { corner, log2: LOG2 - level };
    let (edge, root) = (cell.edge() as f64, f64::from(1u32 << LOG2));
    let at = |axis: usize| (f64::from(corner[axis] - CORNER) + edge / 2.0) / root;
    let ground = height(at(0), at(1)) as u32 + CORNER;
    let half = (cell.edge() / 2) as u32;
    let top = corner[2] + (cell.edge() - 1) as u32;
    let point = [corner[0] + half, corner[1] + half, ground.clamp(corner[2], top)];
    let mut node: Node = bytemuck::Zeroable::zeroed();
    (node.corner, node.cell_log2, node.parent, node.box_min) = (corner, cell.log2, parent, point);
    node.shape = 2;
    node.set_levels(&[1]);
    node.contour_centre = [(edge / 2.0 * STEP) as f32; 3];
    node.contour_half = [(edge / 2.0 * STEP * 1.00001) as f32; 3];
    node.contour_rotation = [0, 0, 0, 32767];
    node.spacing = (edge * STEP / ACROSS) as f32;
    let part = |axis: usize| {
        let along = f64::from(point[axis] - corner[axis]) * STEP;
        let (centre, half) =
            (f64::from(node.contour_centre[axis]), f64::from(node.contour_half[axis]));
        ((((along - centre) / (2.0 * half) + 0.5) * 8.0) as u64).min(7)
    };
    let [own, first, second] =
        [part(1) * 8 + part(0), part(0) * 8 + part(2), part(1) * 8 + part(2)].map(|bit| 1 << bit);
    node.occupancy = own;
    (node, [first, second])
}

/// The table in the order of a builder: siblings together, subtrees one after the other.
fn table() -> NodeTable {
    let (root, sides) = node(0, [CORNER; 3], NONE);
    let mut table = NodeTable { sides: vec![sides], ..NodeTable::of_tree(vec![root]) };
    let mut open = vec![(0u32, 0u8)];
    while let Some((index, level)) = open.pop() {
        let record = table.nodes[index as usize];
        let number =
            (record.corner[0] >> record.cell_log2) + 7 * (record.corner[1] >> record.cell_log2);
        if level > LEVELS || level == LEVELS && !number.is_multiple_of(15) {
            continue;
        }
        let half = 1u32 << (record.cell_log2 - 1);
        let first = table.nodes.len() as u32;
        let mut children: Vec<_> = (0..4u32)
            .map(|quarter| {
                let [x, y, z] = record.corner;
                let [x, y] = [x + (quarter & 1) * half, y + (quarter >> 1) * half];
                let root = f64::from(1u32 << LOG2);
                let at = |c: u32| (f64::from(c - CORNER) + f64::from(half) / 2.0) / root;
                let ground = height(at(x), at(y)) as u32 + CORNER;
                node(level + 1, [x, y, if ground >= z + half { z + half } else { z }], index)
            })
            .collect();
        children.sort_by_key(|(child, _)| record.cell().octant(child.corner));
        let above = &mut table.nodes[index as usize];
        (above.first_child, above.child_count) = (first, children.len() as u8);
        table.nodes.extend(children.iter().map(|child| child.0));
        table.sides.extend(children.iter().map(|child| child.1));
        open.extend((first..first + 4).rev().map(|child| (child, level + 1)));
    }
    table
}

/// Writes the file; its number of nodes.
pub fn write(path: &Path) -> usize {
    let attributes = [("intensity", AttrType::U16), ("classification", AttrType::U8)];
    let schema = Schema::new(attributes.map(|(name, ty)| Attribute::new(name, ty)).to_vec());
    let classes = vec![PointClass { present: vec![0, 1], colour_depth: ColourDepth::Sixteen }];
    let layout = PageLayout::new(&schema, &classes);
    let (mut table, mut writer) = (table(), FileWriter::create(path).unwrap());
    let points_of = |node: &Node| PagePoints {
        positions: vec![node.box_min],
        radius_codes: vec![128],
        // Classification, then intensity.
        columns: vec![vec![2], (node.box_min[2] as u16).to_le_bytes().to_vec()],
        ..PagePoints::default()
    };
    let (mut ranges, mut hash) = (Ranges::new(&schema), MultisetHash::default());
    let mut bounds = [[u32::MAX; 3], [0; 3]];
    for node in &mut table.nodes {
        let points = points_of(node);
        let page = encode_page(&layout, node.box_min, node.hot_shift, &points);
        node.page_offset = writer.write_page(&page).unwrap();
        node.page_bytes = page.len() as u32;
        ranges.add(&layout, &points);
        hash += points.hash(&layout);
        let [least, greatest] = bounds;
        bounds = [
            [0, 1, 2].map(|i| least[i].min(node.box_min[i])),
            [0, 1, 2].map(|i| greatest[i].max(node.box_min[i])),
        ];
    }
    let mut histograms = Histograms::new(ranges);
    let own = table.nodes.iter().zip(&table.sides).map(|(node, &sides)| {
        let points = points_of(node);
        histograms.add(&layout, &points);
        NodeStatistics::of(&layout, &points).with_sides(sides)
    });
    let own = own.collect();
    let metadata = Metadata {
        lattice: Lattice { scale: [STEP; 3], ..Lattice::default() },
        set_aside: vec![],
        normals: Normals::None,
        schema: schema.clone(),
        classes,
        bounds: Some(bounds),
        node_capacity: 24_000,
        has_clip_lines: false,
        has_tangents: false,
        palette: None,
        codec: Codec::Fast,
        sources: vec![],
        forest: vec![],
        generator: "tests".into(),
    };
    let statistics = Statistics::assemble(&table, &schema, own, histograms);
    let nodes = table.nodes.len();
    writer.finish(&table, &statistics, &metadata, nodes as u64, hash).unwrap();
    nodes
}
