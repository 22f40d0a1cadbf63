//! A simple builder of small trees for the tests: a node takes the first points that reach it, the
//! rest goes to the octants below. Also random schemas, classes and points.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(dead_code, reason = "each test file uses its own part")]

use esker_format::{
    Codec, CrsRecord, FileWriter, Histograms, Metadata, NodeStatistics, Normals, PageLayout,
    PagePoints, PartSizes, Ranges, SetAside, SourceRecord, Statistics, encode_page,
};
use esker_points::lattice::GridKind;
use esker_points::node::{NONE, Node, SHAPE_CONTINUATION};
use esker_points::quant::hot_shift;
use esker_points::{
    AttrType, Attribute, Cell, ColourDepth, Grid, InputGrid, Lattice, MultisetHash, NodeTable,
    PointClass, Schema,
};
use proptest::prelude::*;
use std::path::Path;

pub fn metadata(schema: Schema, classes: Vec<PointClass>) -> Metadata {
    let grid = Grid { scale: [0.01, 0.02, 0.001], offset: [500_000.0, 0.1, -3.25] };
    let source = SourceRecord {
        path: "scans/hill \"nord\".laz".into(),
        format: "LAZ 1.4, point format 6".into(),
        grid: InputGrid {
            name: "scans/hill".into(),
            kind: GridKind::Integer,
            grid,
            bounds: Some([[f64::NAN, -0.0, 1e-300], [f64::INFINITY, 0.1 + 0.2, 1.0]]),
        },
        points: 7,
        refused: [("coordinate is not a number".to_string(), 3)].into(),
        rounding_error_max: 0.1 + 0.2,
        colour_depth: Some(ColourDepth::Sixteen),
        colour_depth_forced: true,
        class: 0,
        crs: Some(CrsRecord { text: "PROJCS[\"é\"]".into(), unit: None }),
        notes: vec!["waveform packets are not kept".into()],
        verbatim: vec![("header".into(), vec![1, 2, 3]), ("vlr".into(), vec![0; 70])],
    };
    Metadata {
        lattice: Lattice {
            scale: grid.scale,
            offset: grid.offset,
            shift: [0, -5, 1 << 40],
            ..Lattice::default()
        },
        set_aside: vec![],
        normals: schema.normals().map_or(Normals::None, |_| Normals::Source),
        schema,
        classes,
        bounds: None,
        node_capacity: 64,
        has_clip_lines: false,
        has_tangents: false,
        palette: None,
        codec: Codec::Fast,
        sources: vec![source.clone(), SourceRecord { verbatim: vec![], ..source }],
        forest: vec![],
        generator: "tests".into(),
    }
}

/// The metadata with a lattice in degrees: the file is of version 2.
pub fn in_degrees(metadata: Metadata) -> Metadata {
    let scale = [1e-7, 1e-7, 0.001];
    let factor = [75_840.123_456_789, 111_176.3, 1.0];
    Metadata { lattice: Lattice { scale, factor, ..metadata.lattice }, ..metadata }
}

pub fn take(points: &PagePoints, layout: &PageLayout, indices: &[usize]) -> PagePoints {
    let sizes = layout.schema().attributes.iter().map(|a| a.ty.size());
    PagePoints {
        positions: indices.iter().map(|&i| points.positions[i]).collect(),
        radius_codes: indices.iter().map(|&i| points.radius_codes[i]).collect(),
        classes: if points.classes.is_empty() {
            vec![]
        } else {
            indices.iter().map(|&i| points.classes[i]).collect()
        },
        normals: points
            .normals
            .first()
            .map_or(vec![], |_| indices.iter().map(|&i| points.normals[i]).collect()),
        clip_lines: points
            .clip_lines
            .first()
            .map_or(vec![], |_| indices.iter().map(|&i| points.clip_lines[i]).collect()),
        tangents: points
            .tangents
            .first()
            .map_or(vec![], |_| indices.iter().map(|&i| points.tangents[i]).collect()),
        columns: sizes
            .zip(&points.columns)
            .map(|(s, c)| indices.iter().flat_map(|&i| c[i * s..][..s].to_vec()).collect())
            .collect(),
    }
}

fn bounds(points: &PagePoints, indices: &[usize]) -> ([u32; 3], [u32; 3]) {
    let axis = |i: usize| indices.iter().map(move |&p| points.positions[p][i]);
    ([0, 1, 2].map(|i| axis(i).min().unwrap_or(0)), [0, 1, 2].map(|i| axis(i).max().unwrap_or(0)))
}

/// Nodes of a tree and the indices of the points of each.
pub fn build_tree(
    points: &PagePoints,
    lattice: &Lattice,
    capacity: usize,
) -> (NodeTable, Vec<Vec<usize>>) {
    let mut nodes: Vec<Node> = Vec::new();
    let mut waiting: Vec<Vec<usize>> = Vec::new();
    let (mut own, mut sides) = (Vec::new(), Vec::new());
    if !points.is_empty() {
        let all: Vec<usize> = (0..points.len()).collect();
        let (min, max) = bounds(points, &all);
        nodes.push(record(Cell::enclosing(min, max), NONE));
        waiting.push(all);
    }
    let mut index = 0;
    while index < nodes.len() {
        let mut mine = std::mem::take(&mut waiting[index]);
        let rest = mine.split_off(mine.len().min(capacity));
        let cell = nodes[index].cell();
        let first_child = nodes.len();
        if cell.log2 == 0 && !rest.is_empty() {
            let mut child = record(cell, index as u32);
            child.shape |= SHAPE_CONTINUATION;
            nodes.push(child);
            waiting.push(rest);
        } else {
            for octant in 0..8 {
                let part: Vec<usize> = rest
                    .iter()
                    .copied()
                    .filter(|&p| cell.octant(points.positions[p]) == octant)
                    .collect();
                if !part.is_empty() {
                    let (min, max) = bounds(points, &part);
                    nodes.push(record(Cell::enclosing(min, max), index as u32));
                    waiting.push(part);
                }
            }
        }
        let (min, max) = bounds(points, &mine);
        let node = &mut nodes[index];
        node.set_levels(&[mine.len() / 3, mine.len() - mine.len() / 3]);
        node.box_min = min;
        node.hot_shift = hot_shift((0..3).map(|i| max[i] - min[i]).max().unwrap_or(0));
        for i in 0..3 {
            let at = |c: u32| f64::from(c - node.corner[i]) * lattice.metric().scale[i];
            node.contour_centre[i] = ((at(min[i]) + at(max[i])) / 2.0) as f32;
            node.contour_half[i] = ((at(max[i]) - at(min[i])) / 2.0 * 1.00001) as f32;
        }
        let masks = mine.iter().fold([0; 3], |masks, &p| {
            let bits = occupancy(node, lattice, points.positions[p]);
            [0, 1, 2].map(|i| masks[i] | bits[i])
        });
        node.occupancy = masks[0];
        sides.push([masks[1], masks[2]]);
        if first_child < nodes.len() {
            nodes[index].first_child = first_child as u32;
            nodes[index].child_count = (nodes.len() - first_child) as u8;
        }
        own.push(mine);
        index += 1;
    }
    (NodeTable { sides, ..NodeTable::of_tree(nodes) }, own)
}

/// Occupancy masks for contours along the lattice's axes.
fn occupancy(node: &Node, lattice: &Lattice, p: [u32; 3]) -> [u64; 3] {
    let part = |i: usize| {
        let at = f64::from(p[i] - node.corner[i]) * lattice.metric().scale[i];
        let (centre, half) = (f64::from(node.contour_centre[i]), f64::from(node.contour_half[i]));
        // A half of zero gives NaN, which becomes part 0.
        ((((at - centre) / (2.0 * half) + 0.5) * 8.0) as u64).min(7)
    };
    [part(1) * 8 + part(0), part(0) * 8 + part(2), part(1) * 8 + part(2)].map(|bit| 1 << bit)
}

fn record(cell: Cell, parent: u32) -> Node {
    let mut node: Node = bytemuck::Zeroable::zeroed();
    node.corner = cell.corner;
    node.cell_log2 = cell.log2;
    node.parent = parent;
    node.contour_rotation = [0, 0, 0, 32767];
    node.spacing = 0.5;
    node
}

/// Writes a file of these points, with its pages in random order. Returns the table.
pub fn write(path: &Path, metadata: &Metadata, points: &PagePoints, capacity: usize) -> NodeTable {
    write_parts(path, metadata, (points, capacity), PartSizes::default())
}

/// [`write`] with a node table that can be read in parts of these sizes.
pub fn write_parts(
    path: &Path,
    metadata: &Metadata,
    (points, capacity): (&PagePoints, usize),
    sizes: PartSizes,
) -> NodeTable {
    let layout = metadata.layout();
    let (mut table, own) = build_tree(points, &metadata.lattice, capacity);
    let mut writer = FileWriter::create(path).unwrap();
    writer.set_part_sizes(sizes);
    let parts: Vec<_> = own.iter().map(|o| take(points, &layout, o)).collect();
    for index in (0..parts.len()).rev() {
        let node = &mut table.nodes[index];
        let page = encode_page(&layout, node.box_min, node.hot_shift, &parts[index]);
        node.page_offset = writer.write_page(&page).unwrap();
        node.page_bytes = page.len() as u32;
    }
    let mut ranges = Ranges::new(&metadata.schema);
    parts.iter().for_each(|p| ranges.add(&layout, p));
    let mut histograms = Histograms::new(ranges);
    let mut hash = MultisetHash::default();
    for part in &parts {
        histograms.add(&layout, part);
        hash += part.hash(&layout);
    }
    let each = parts.iter().zip(&table.sides);
    let each = each.map(|(p, &sides)| NodeStatistics::of(&layout, p).with_sides(sides)).collect();
    let statistics = Statistics::assemble(&table, &metadata.schema, each, histograms);
    let corner = |f: fn(u32, u32) -> u32| {
        [0, 1, 2].map(|i| points.positions.iter().map(|p| p[i]).reduce(f).unwrap_or(0))
    };
    let bounds = (!points.is_empty()).then(|| [corner(u32::min), corner(u32::max)]);
    let metadata = &Metadata { bounds, ..metadata.clone() };
    let bytes = writer.finish(&table, &statistics, metadata, points.len() as u64, hash).unwrap();
    assert_eq!(bytes, std::fs::metadata(path).unwrap().len());
    table
}

/// Attributes that have planes of their own kind, several classes of points, and plain attributes.
pub fn mixed_schema() -> (Schema, Vec<PointClass>) {
    use AttrType::{F32, F64, I16, U8, U16};
    let list = [
        ("red", U16),
        ("green", U16),
        ("blue", U16),
        ("red", U8),
        ("green", U8),
        ("blue", U8),
        ("nx", F32),
        ("ny", F32),
        ("nz", F32),
        ("intensity", U16),
        ("classification", U8),
        ("gps_time", F64),
        ("scan_angle", I16),
    ];
    let schema = Schema::new(list.map(|(n, t)| Attribute::new(n, t)).to_vec());
    let class = |keys: &[(&str, AttrType)], colour_depth| {
        let mut present: Vec<u16> =
            keys.iter().map(|&(n, t)| schema.find_typed(n, t).unwrap() as u16).collect();
        present.sort_unstable();
        PointClass { present, colour_depth }
    };
    let classes = vec![
        class(&list[..3], ColourDepth::Sixteen),
        class(&list[3..11], ColourDepth::Eight),
        class(&list[..3], ColourDepth::Eight),
        class(&list[9..], ColourDepth::Sixteen),
        class(&[], ColourDepth::Sixteen),
    ];
    (schema, classes)
}

pub fn schemas() -> impl Strategy<Value = (Schema, Vec<PointClass>)> {
    use AttrType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    let pool = [
        ("red", U16),
        ("green", U16),
        ("blue", U16),
        ("red", U8),
        ("green", U8),
        ("blue", U8),
        ("nx", F32),
        ("ny", F32),
        ("nz", F32),
        ("intensity", U16),
        ("intensity", F32),
        ("classification", U8),
        ("gps_time", F64),
        ("a", I8),
        ("b", I16),
        ("c", I32),
        ("d", I64),
        ("e", U32),
        ("f", U64),
    ];
    let picks = (any::<[bool; 4]>(), prop::collection::vec(any::<bool>(), pool.len()));
    let classes = prop::collection::vec((any::<[bool; 32]>(), any::<bool>(), any::<bool>()), 1..4);
    (picks, classes).prop_map(move |((groups, single), classes)| {
        let wanted = |i: usize| match i {
            0..3 => groups[0] || single[i],
            3..6 => groups[1] || single[i],
            6..9 => groups[2] || single[i],
            _ => single[i],
        };
        let list = (0..pool.len()).filter(|&i| wanted(i));
        let schema = Schema::new(list.map(|i| Attribute::new(pool[i].0, pool[i].1)).collect());
        let present = |bits: &[bool; 32], all: bool| {
            (0..schema.attributes.len() as u16).filter(|&a| all || bits[usize::from(a)]).collect()
        };
        let depth = |eight| if eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        let classes = classes
            .iter()
            .map(|(bits, all, eight)| PointClass {
                present: present(bits, *all),
                colour_depth: depth(*eight),
            })
            .collect();
        (schema, classes)
    })
}

/// An origin of normals that suits any schema; `None` for the schema's default.
pub fn normals() -> impl Strategy<Value = Option<Normals>> {
    let any = [Normals::None, Normals::Estimated, Normals::Oriented];
    prop::option::of(prop::sample::select(any.to_vec()))
}

pub fn codecs() -> impl Strategy<Value = Codec> {
    prop::sample::select(vec![Codec::None, Codec::Fast, Codec::Small])
}

/// Points with arbitrary values in everything that they have. `spread` bits of coordinates differ.
pub fn points_of(
    schema: &Schema,
    classes: &[PointClass],
    count: usize,
    spread: u32,
    seed: u64,
) -> PagePoints {
    let mut state = seed | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    };
    let base = [0, 1, 2].map(|_| random() as u32);
    let layout = PageLayout::new(schema, classes);
    let mut points =
        PagePoints { columns: vec![Vec::new(); schema.attributes.len()], ..PagePoints::default() };
    for _ in 0..count {
        let mask = ((1u64 << spread) - 1) as u32;
        points.positions.push(base.map(|b| b ^ (random() as u32 & mask)));
        points.radius_codes.push(random() as u8);
        let class = random() as usize % classes.len();
        if classes.len() > 1 {
            points.classes.push(class as u16);
        }
        for (a, attribute) in schema.attributes.iter().enumerate() {
            // Some attributes are constant, so that both encodings occur.
            let value = if (seed >> (a % 48)) & 3 == 0 { seed } else { random() << 40 | random() };
            let value = if layout.has_attribute(class, a) { value } else { 0 };
            points.columns[a].extend_from_slice(&value.to_le_bytes()[..attribute.ty.size()]);
        }
    }
    points
}

/// Classes whose records have every kind of length that the hash distinguishes: 13 to 260 bytes.
pub fn long_schema() -> (Schema, Vec<PointClass>) {
    let list = (0..31).map(|i| Attribute::new(format!("a{i:02}"), AttrType::U64));
    let schema = Schema::new(list.chain([Attribute::new("b", AttrType::U8)]).collect());
    let classes =
        [0..0u16, 31..32, 0..1, 0..2, 0..4, 0..6, 0..10, 0..14, 0..15, 0..20, 0..28, 0..29, 0..31];
    let class = |present: std::ops::Range<u16>| PointClass {
        present: present.collect(),
        colour_depth: ColourDepth::Sixteen,
    };
    (schema, classes.map(class).to_vec())
}

/// Points beside the tree, of all sources.
pub fn set_aside(metadata: &Metadata) -> Vec<SetAside> {
    let point = |(i, source): (usize, &SourceRecord)| {
        let present = &metadata.classes[usize::from(source.class)].present;
        let sizes = present.iter().map(|&a| metadata.schema.attributes[usize::from(a)].ty.size());
        let values = (0..sizes.sum::<usize>()).map(|byte| byte as u8 ^ 0xa5).collect();
        SetAside { source: i as u32, place: [1e10 / 3.0, -0.0, 5e-324], values }
    };
    metadata.sources.iter().enumerate().map(point).collect()
}
