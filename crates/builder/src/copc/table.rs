//! The node table of a COPC octree: a node for each voxel, on a lattice of 2^32 steps across the
//! cube, so that voxels are cells. In: pages of the hierarchy; out: records with what is known of a
//! voxel before its chunk is decoded. Nodes keep their indices: those of later pages come behind.

use esker_format::PageLayout;
use esker_format::footer::HEADER_BYTES;
use esker_points::node::{NONE, SHAPE_CONTINUATION, pack_rotation};
use esker_points::{Cell, Node, NodeTable};
use esker_scan::las::copc::{Entry, Place};
use esker_scan::write::las::copc::VoxelKey;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Greatest number of points of a node; the points of larger chunks are divided among nodes that
/// continue each other.
pub const NODE_POINTS_MAX: usize = 1 << 18;
/// Log2 of the lattice steps across the cube.
const CUBE_LOG2: u32 = 32;

/// A chunk, and the nodes that hold its points.
#[derive(Clone, Debug)]
pub struct Chunk {
    /// Its voxel.
    pub key: VoxelKey,
    /// Its bytes in the file.
    pub place: Place,
    /// Number of its points, at least 1.
    pub points: u32,
    /// Its nodes, each continuing the one before.
    pub nodes: Vec<u32>,
}

/// What a node stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stands {
    /// Points of a chunk, by its index.
    Chunk(u32),
    /// A voxel and all below it, whose entries are in this page.
    Page(VoxelKey, Place),
    /// A voxel without points of its own.
    Nothing,
}

/// The voxels whose pages were read.
#[derive(Clone, Debug)]
pub struct VoxelTable {
    /// Their nodes.
    pub nodes: Arc<NodeTable>,
    /// What each node stands for.
    pub stands: Vec<Stands>,
    /// All chunks.
    pub chunks: Vec<Chunk>,
    /// Offset of the page of each node, ascending, and the node. Nodes that stand for more of the
    /// tree first have a page without points.
    places: Vec<(u64, u32)>,
    /// Offset behind the last page.
    end: u64,
    /// Length of a lattice step on each axis, as lengths are measured.
    scale: [f64; 3],
    /// Spacing of the root, as lengths are measured.
    spacing: f64,
}

/// The cell of a voxel.
pub fn cell_of(key: VoxelKey) -> Cell {
    let log2 = CUBE_LOG2 - key.level;
    // The root's place is 0, so that no shift drops a bit.
    let corner = key.place.map(|at| u32::try_from(u64::from(at) << log2).unwrap_or(0));
    Cell { corner, log2: log2 as u8 }
}

/// Number of bits that hot positions in a voxel drop.
pub fn hot_shift_of(cell: &Cell) -> u8 {
    cell.log2.saturating_sub(16)
}

impl VoxelTable {
    /// A table without voxels. `scale` has the length of a lattice step on each axis, `spacing` is
    /// that of the root, both as lengths are measured
    /// ([`Lattice::metric`](esker_points::Lattice::metric)).
    pub fn new(scale: [f64; 3], spacing: f64) -> Self {
        Self {
            nodes: Arc::default(),
            stands: Vec::new(),
            chunks: Vec::new(),
            places: Vec::new(),
            end: HEADER_BYTES as u64,
            scale,
            spacing,
        }
    }

    /// Spacing of the voxels of a level, as far as it is known without their points.
    pub fn spacing_at(&self, level: u32) -> f64 {
        self.spacing / 2f64.powi(level as i32)
    }

    /// Adds the voxels of a page: the root's, or one that the node `link` stands for.
    ///
    /// # Errors
    /// What is wrong with the page.
    pub fn add(
        &mut self,
        link: Option<u32>,
        entries: &[(VoxelKey, Entry)],
        layout: &PageLayout,
    ) -> Result<(), String> {
        let top = match link.map(|link| self.stands[link as usize]) {
            Some(Stands::Page(key, _)) => key,
            Some(_) => return Ok(()),
            None => VoxelKey::default(),
        };
        let mut left: BTreeMap<VoxelKey, Entry> = entries.iter().copied().collect();
        if left.len() < entries.len() {
            return Err("a page of its hierarchy names a voxel twice".into());
        }
        match left.get(&top) {
            Some(Entry::Chunk(..)) => {}
            _ => return Err("a page of its hierarchy lacks the voxel that it is of".into()),
        }
        if self.stands.len() + 2 * entries.len() > NONE as usize / 2 {
            return Err("it has too many voxels: build it instead".into());
        }
        let index = link.unwrap_or_else(|| self.push(top, NONE));
        let mut open = VecDeque::from([(top, index)]);
        while let Some((key, index)) = open.pop_front() {
            let Some(entry) = left.remove(&key) else { continue };
            let last = match entry {
                Entry::Page(place) => {
                    self.stands[index as usize] = Stands::Page(key, place);
                    self.set_page(index, layout);
                    continue;
                }
                Entry::Chunk(_, 0) => {
                    self.stands[index as usize] = Stands::Nothing;
                    self.set_page(index, layout);
                    index
                }
                Entry::Chunk(place, points) => self.set_chunk(key, index, (place, points), layout),
            };
            let below = octants(key).into_iter().flatten().filter(|child| left.contains_key(child));
            let first = self.stands.len() as u32;
            for child in below {
                let index = self.push(child, last);
                open.push_back((child, index));
            }
            let count = self.stands.len() as u32 - first;
            let record = &mut Arc::make_mut(&mut self.nodes).nodes[last as usize];
            record.child_count = count as u8;
            record.first_child = if count > 0 { first } else { 0 };
        }
        match left.first_key_value() {
            None => Ok(()),
            Some((VoxelKey { level, place: [x, y, z] }, _)) => Err(format!(
                "its hierarchy has the voxel {level}-{x}-{y}-{z}, but none above it: build it instead"
            )),
        }
    }

    /// Gives a node the points of a chunk, as many as it holds, and the rest to nodes behind it.
    /// Returns the last one.
    fn set_chunk(
        &mut self,
        key: VoxelKey,
        index: u32,
        (place, points): (Place, u32),
        layout: &PageLayout,
    ) -> u32 {
        let (chunk, spacing) = (self.chunks.len() as u32, self.spacing_at(key.level));
        let mut nodes = vec![index];
        let sizes = part_sizes(points as usize);
        for (part, &size) in sizes.iter().enumerate() {
            let index = if part == 0 { index } else { self.push(key, nodes[part - 1]) };
            if part > 0 {
                let above = nodes[part - 1] as usize;
                nodes.push(index);
                let table = &mut Arc::make_mut(&mut self.nodes).nodes;
                (table[above].first_child, table[above].child_count) = (index, 1);
                table[index as usize].shape |= SHAPE_CONTINUATION;
            }
            self.stands[index as usize] = Stands::Chunk(chunk);
            let table = Arc::make_mut(&mut self.nodes);
            let record = &mut table.nodes[index as usize];
            record.set_levels(&[size]);
            record.spacing = spacing as f32;
            record.occupancy = u64::MAX;
            table.sides[index as usize] = [u64::MAX; 2];
            self.set_page(index, layout);
        }
        let last = nodes[nodes.len() - 1];
        self.chunks.push(Chunk { key, place, points, nodes });
        last
    }

    /// Gives the page of a node its place, behind all others.
    fn set_page(&mut self, index: u32, layout: &PageLayout) {
        let record = &mut Arc::make_mut(&mut self.nodes).nodes[index as usize];
        let bytes = layout.raw_page_bytes(record.points(), record.hot_shift);
        (record.page_offset, record.page_bytes) = (self.end, bytes as u32);
        self.places.push((self.end, index));
        self.end += bytes;
    }

    /// Adds a node without points: nothing in its cell is in view, and what is below it is looked
    /// for where the spacing of the node above is too wide.
    fn push(&mut self, key: VoxelKey, parent: u32) -> u32 {
        let cell = cell_of(key);
        let mut record: Node = bytemuck::Zeroable::zeroed();
        (record.corner, record.cell_log2, record.parent) = (cell.corner, cell.log2, parent);
        (record.box_min, record.hot_shift) = (cell.corner, hot_shift_of(&cell));
        record.shape = 2;
        record.spacing = self.spacing_at(key.level.saturating_sub(1)) as f32;
        // Voxels are no cubes where lengths are scaled; a cube around one holds it.
        let half = self.scale.map(|step| cell.edge() as f64 * step / 2.0);
        let longest = half.iter().fold(0.0, |all: f64, &half| all.max(half));
        record.contour_centre = half.map(|half| half as f32);
        record.contour_half = [(longest * (1.0 + 1e-6)) as f32; 3];
        let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        record.contour_rotation = pack_rotation(upright).0;
        let table = Arc::make_mut(&mut self.nodes);
        table.nodes.push(record);
        table.sides.push([0; 2]);
        self.stands.push(Stands::Nothing);
        self.stands.len() as u32 - 1
    }

    /// Offsets and nodes of the pages that lie in a range of bytes, at least in part, in order.
    pub fn pages_in(&self, range: std::ops::Range<u64>) -> impl Iterator<Item = (u64, u32)> + '_ {
        let first = self.places.partition_point(|(offset, _)| *offset <= range.start).max(1) - 1;
        let places = self.places.get(first..).unwrap_or_default().iter();
        places.take_while(move |(offset, _)| *offset < range.end).copied()
    }
}

/// The octants of a voxel, in Morton order; none below the lowest level.
fn octants(key: VoxelKey) -> Option<[VoxelKey; 8]> {
    let level = key.level + 1;
    let of = |octant: u32| {
        let bit = |axis: usize| key.place[axis] << 1 | (octant >> axis & 1);
        VoxelKey { level, place: [0, 1, 2].map(bit) }
    };
    (level <= VoxelKey::LEVEL_MAX).then(|| [0, 1, 2, 3, 4, 5, 6, 7].map(of))
}

/// Number of points of each node of a chunk: as equal as possible.
pub fn part_sizes(points: usize) -> Vec<usize> {
    let count = points.div_ceil(NODE_POINTS_MAX).max(1);
    let start = |part: usize| (part * points).div_ceil(count);
    (0..count).map(|part| start(part + 1) - start(part)).collect()
}
