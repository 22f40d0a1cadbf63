//! Writes a small .esker file: a hilly surface in an octree whose nodes take the first of shuffled
//! points, so that each has an even sample. With colours, intensities, normals, and a cold
//! attribute.

use bytemuck::Zeroable;
use esker_format::{
    Codec, EskerFile, FileWriter, Histograms, Metadata, NodeStatistics, PagePoints, Ranges,
    Statistics, encode_page,
};
use esker_points::node::NONE;
use esker_points::quant::hot_shift;
use esker_points::{
    AttrType, Attribute, Cell, ColourDepth, Lattice, MultisetHash, Node, NodeTable, PointClass,
    Schema,
};
use std::io::Read;

/// Edge of the hills, in steps of a millimetre: a kilometre, so that large nodes drop bits.
const EDGE: u32 = 1 << 20;

fn schema() -> Schema {
    use AttrType::{F32, F64, U16};
    let list = [
        ("red", U16),
        ("green", U16),
        ("blue", U16),
        ("nx", F32),
        ("ny", F32),
        ("nz", F32),
        ("intensity", U16),
        ("gps_time", F64),
    ];
    Schema::new(list.map(|(name, ty)| Attribute::new(name, ty)).to_vec())
}

fn metadata(schema: Schema) -> Metadata {
    let present = (0..schema.attributes.len() as u16).collect();
    Metadata {
        lattice: Lattice {
            scale: [0.001; 3],
            offset: [5e5, 5e6, 100.0],
            shift: [0; 3],
            ..Lattice::default()
        },
        schema,
        classes: vec![PointClass { present, colour_depth: ColourDepth::Sixteen }],
        bounds: None,
        node_capacity: 1000,
        sources: vec![],
        normals: esker_format::Normals::Source,
        has_clip_lines: false,
        has_tangents: false,
        palette: None,
        codec: Codec::Fast,
        set_aside: vec![],
        forest: vec![],
        generator: "tests".into(),
    }
}

/// The bytes of a file of `points` points, at most `capacity` in a node.
pub fn file(points: usize, capacity: usize) -> Vec<u8> {
    file_of(schema(), 7, points, capacity)
}

/// The bytes of a file of other points, which have no colours and an additional attribute.
pub fn bare_file(seed: u64, points: usize, capacity: usize) -> Vec<u8> {
    let mut attributes = schema().attributes;
    attributes.retain(|a| !["red", "green", "blue"].contains(&a.name.as_str()));
    attributes.push(Attribute::new("a_number", AttrType::F64));
    file_of(Schema::new(attributes), seed, points, capacity)
}

fn file_of(schema: Schema, seed: u64, points: usize, capacity: usize) -> Vec<u8> {
    let metadata = metadata(schema);
    let layout = metadata.layout();
    let mut random = super::Random(seed);
    let base = 1u32 << 31;
    let positions: Vec<[u32; 3]> = (0..points)
        .map(|_| {
            let (x, y) = (random.below(EDGE), random.below(EDGE));
            let wave = |c: u32, n: f64| (f64::from(c) / f64::from(EDGE) * n).sin();
            let z = (wave(x, 9.0) + wave(y, 7.0) + 2.0) * 4e4 + random.unit() * 500.0;
            [base + x, base + y, base + z as u32]
        })
        .collect();
    let (mut table, own) = build_tree(&positions, capacity);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hills.esker");
    let mut writer = FileWriter::create(&path).unwrap();
    let mut parts = Vec::new();
    for (node, own) in table.nodes.iter_mut().zip(&own) {
        let part = part(&metadata.schema, &positions, own);
        let page = encode_page(&layout, node.box_min, node.hot_shift, &part);
        node.page_offset = writer.write_page(&page).unwrap();
        node.page_bytes = page.len() as u32;
        parts.push(part);
    }
    let mut ranges = Ranges::new(&metadata.schema);
    parts.iter().for_each(|p| ranges.add(&layout, p));
    let mut histograms = Histograms::new(ranges);
    let mut hash = MultisetHash::default();
    for part in &parts {
        histograms.add(&layout, part);
        hash += part.hash(&layout);
    }
    let each = parts.iter().map(|p| NodeStatistics::of(&layout, p)).collect();
    let statistics = Statistics::assemble(&table, &metadata.schema, each, histograms);
    let fold = |f: fn(u32, u32) -> u32| {
        [0, 1, 2].map(|i| positions.iter().map(|p| p[i]).reduce(f).unwrap())
    };
    let metadata = Metadata { bounds: Some([fold(u32::min), fold(u32::max)]), ..metadata };
    writer.finish(&table, &statistics, &metadata, points as u64, hash).unwrap();
    assert!(EskerFile::open(&path).is_ok());
    let mut bytes = Vec::new();
    std::fs::File::open(&path).unwrap().read_to_end(&mut bytes).unwrap();
    bytes
}

/// Nodes, parents first, and the indices of the points of each.
fn build_tree(positions: &[[u32; 3]], capacity: usize) -> (NodeTable, Vec<Vec<usize>>) {
    let mut nodes = vec![record(positions, &(0..positions.len()).collect::<Vec<_>>(), NONE)];
    let mut waiting = vec![(0..positions.len()).collect::<Vec<_>>()];
    let mut own = Vec::new();
    while own.len() < nodes.len() {
        let index = own.len();
        let mut mine = std::mem::take(&mut waiting[index]);
        let rest = mine.split_off(mine.len().min(capacity));
        let cell = nodes[index].cell();
        let first_child = nodes.len();
        for octant in 0..8 {
            let inside = |p: &usize| cell.octant(positions[*p]) == octant;
            let part: Vec<usize> = rest.iter().copied().filter(inside).collect();
            if !part.is_empty() {
                nodes.push(record(positions, &part, index as u32));
                waiting.push(part);
            }
        }
        if first_child < nodes.len() {
            nodes[index].first_child = first_child as u32;
            nodes[index].child_count = (nodes.len() - first_child) as u8;
        }
        bound(&mut nodes[index], positions, &mine);
        own.push(mine);
    }
    (NodeTable::of_tree(nodes), own)
}

fn corners(positions: &[[u32; 3]], of: &[usize]) -> [[u32; 3]; 2] {
    let fold = |f: fn(u32, u32) -> u32| {
        [0, 1, 2].map(|i| of.iter().map(|&p| positions[p][i]).reduce(f).unwrap())
    };
    [fold(u32::min), fold(u32::max)]
}

fn record(positions: &[[u32; 3]], subtree: &[usize], parent: u32) -> Node {
    let [min, max] = corners(positions, subtree);
    let cell = Cell::enclosing(min, max);
    let mut node = Node::zeroed();
    (node.corner, node.cell_log2, node.parent) = (cell.corner, cell.log2, parent);
    node.shape = 2;
    node
}

fn bound(node: &mut Node, positions: &[[u32; 3]], own: &[usize]) {
    let [min, max] = corners(positions, own);
    node.set_levels(&[own.len() / 4, own.len() - own.len() / 4]);
    node.box_min = min;
    node.hot_shift = hot_shift((0..3).map(|i| max[i] - min[i]).max().unwrap());
    for i in 0..3 {
        let (low, high) = (f64::from(min[i] - node.corner[i]), f64::from(max[i] - node.corner[i]));
        node.contour_centre[i] = ((low + high) * 0.5 * 0.001) as f32;
        // Grown by the rounding error of f32.
        node.contour_half[i] = ((high - low) * 0.5 * 0.001) as f32 + 0.01;
    }
    node.contour_rotation = [0, 0, 0, 32767];
    for &p in own {
        let part = |i: usize| {
            let at = f64::from(positions[p][i] - node.corner[i]) * 0.001;
            let (centre, half) =
                (f64::from(node.contour_centre[i]), f64::from(node.contour_half[i]));
            ((((at - centre) / (2.0 * half) + 0.5) * 8.0) as u64).min(7)
        };
        node.occupancy |= 1 << (part(1) * 8 + part(0));
    }
    let area = f64::from(max[0] - min[0]) * f64::from(max[1] - min[1]) * 1e-6;
    node.spacing = (area / own.len() as f64).sqrt() as f32;
}

fn part(schema: &Schema, positions: &[[u32; 3]], own: &[usize]) -> PagePoints {
    let column = |attribute: &Attribute| {
        let mut column = Vec::new();
        for &p in own {
            let value = (p as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let bytes = match attribute.ty {
                AttrType::F32 => {
                    (((value >> 40) as f32 / 2f32.powi(24)) - 0.5).to_le_bytes().to_vec()
                }
                AttrType::F64 => (p as f64 * 0.25).to_le_bytes().to_vec(),
                _ => value.to_le_bytes()[6..].to_vec(),
            };
            column.extend_from_slice(&bytes);
        }
        column
    };
    PagePoints {
        positions: own.iter().map(|&p| positions[p]).collect(),
        radius_codes: own.iter().map(|&p| p as u8).collect(),
        classes: vec![],
        normals: vec![],
        clip_lines: vec![],
        tangents: vec![],
        columns: schema.attributes.iter().map(column).collect(),
    }
}
