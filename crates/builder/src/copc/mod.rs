//! Opens COPC files as trees, without conversion: voxels become nodes ([`table`]), and the page of
//! a node is made of its chunk when it is read ([`page`]). Pages of the hierarchy are read when
//! what is below them is wanted. See `docs/design/copc.md`.

mod cache;
mod page;
mod table;

use crate::calls::metadata::CopcMetadata;
use crate::error::BuildError;
use crate::input::degrees;
use crate::page::histograms::Counts;
use crate::rows::row::RowLayout;
use crate::sample::cell::Context;
use cache::{Cache, Made};
use esker_format::growing::{Growing, Outline};
use esker_format::{
    EskerFile, Histograms, NodeStatistics, PageLayout, PagePoints, Ranges, Statistics,
    encode_raw_page,
};
use esker_points::read_at::{self, ReadAt};
use esker_points::{ColourDepth, Lattice, NodeTable, PointClass};
use esker_scan::las::copc::CopcFile;
use esker_scan::{Geographic, OpenOptions, ScanError};
use page::{MadeNode, Pages};
use rayon::prelude::*;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use table::{Stands, VoxelTable};

/// Most bytes of pages that are kept, by default.
pub const CACHE_BYTES: u64 = 128 << 20;
/// Points over the edge of a voxel, where a file does not state its spacing.
const POINTS_ACROSS: f64 = 128.0;
/// Longest edge of a cube, in the file's unit, and least.
const EDGES: Range<f64> = 1e-20..1e20;

/// A COPC file whose chunks become pages.
struct CopcTree {
    file: CopcFile,
    pages: Pages,
    state: RwLock<State>,
    cache: Cache,
    histograms: Histograms,
    /// Page of a node without points.
    empty_page: Vec<u8>,
}

/// What changes while the tree is read.
struct State {
    table: VoxelTable,
    /// Number of changes.
    version: u64,
    /// Statistics of the nodes; `None` as long as their points are not known.
    statistics: Vec<Option<NodeStatistics>>,
}

/// Whether a file is COPC, by its first bytes.
///
/// # Errors
/// If it cannot be read.
pub fn is_copc(path: &Path) -> io::Result<bool> {
    use std::io::Read;
    let mut head = Vec::new();
    read_at::Input::open(path)?.take(512).read_to_end(&mut head)?;
    Ok(esker_scan::las::copc::recognises(&head))
}

/// Opens a COPC file. Reads its header, the root's page of its hierarchy and its first chunk. At
/// most `cache_bytes` of pages are kept in memory beside those that are made.
///
/// # Errors
/// If it cannot be read, is damaged, or its octree is not one that can be drawn.
pub fn open(path: &Path, options: &OpenOptions, cache_bytes: u64) -> Result<EskerFile, BuildError> {
    let source = read_at::open(path).map_err(|e| ScanError::io(path, e))?;
    let file = CopcFile::open(path, source, options)?;
    let damaged = |what: String| BuildError::from(ScanError::damaged(path, what));
    let lattice = lattice_of(&file).map_err(damaged)?;
    let schema = file.info().schema.clone();
    let present = (0..schema.attributes.len() as u16).collect();
    let depth = file.info().colour_depth.unwrap_or(ColourDepth::Sixteen);
    let mut class = PointClass { present, colour_depth: depth };
    let layout = PageLayout::new(&schema, std::slice::from_ref(&class));
    let edge = 2.0 * file.cube().1;
    let stated = file.spacing();
    let spacing = if EDGES.contains(&stated) { stated } else { edge / POINTS_ACROSS };
    let mut table = VoxelTable::new(lattice.metric().scale, spacing * lattice.factor[0]);
    table.add(None, &file.page(file.root_page())?, &layout).map_err(damaged)?;

    // The first points tell the depth of colours and the ranges of values.
    let first = table.chunks.first().map(|chunk| (chunk.key, chunk.place, chunk.points));
    let mut points = None;
    if let Some((_, place, count)) = first {
        let decoded = file.decode(&file.chunk(place)?, count)?;
        let is_free = options.colour_depth.is_none() && file.info().colour_depth.is_some();
        if is_free && (1..=255).contains(&decoded.colour_max) {
            class.colour_depth = ColourDepth::Eight;
        }
        points = Some(decoded);
    }
    let classes = vec![class];
    let layout = PageLayout::new(&schema, &classes);
    let mut ranges = Ranges::new(&schema);
    for (a, attribute) in schema.attributes.iter().enumerate() {
        let values = points.as_ref().map_or(&[][..], |points| &points.columns[a]);
        ranges.add_column(a, attribute.ty, values);
    }
    let mut histograms = Histograms::new(ranges.clone());
    let context = Context {
        rows: RowLayout::new(&schema, &classes),
        pages: layout.clone(),
        wires: None,
        scale: lattice.metric().scale,
        clips: None,
        capacity: table::NODE_POINTS_MAX,
        points: file.points(),
        counts: Counts::new(ranges),
    };
    let grid = file.info().grid.grid;
    let to_file = (0..schema.attributes.len()).collect();
    let pages = Pages { context, schema, to_file, grid, lattice };
    let mut made = None;
    if let (Some((key, ..)), Some(points)) = (first, points) {
        let nodes = pages.make(key, points, None).map_err(damaged)?;
        nodes.iter().for_each(|node| node.count(&layout, &mut histograms));
        made = Some(nodes);
    }
    let of = CopcMetadata { lattice, classes: &classes, info: file.info(), points: file.points() };
    let metadata = of.metadata();
    let (points, file_bytes) = (file.points(), file.info().bytes);
    let statistics = vec![None; table.stands.len()];
    let tree = CopcTree {
        file,
        pages,
        state: RwLock::new(State { table, version: 0, statistics }),
        cache: Cache::new(cache_bytes),
        histograms,
        empty_page: encode_raw_page(&layout, [0; 3], 0, &PagePoints::empty(&layout)),
    };
    if let Some(nodes) = made {
        tree.cache.with(0, || tree.take(0, nodes)).map_err(|e| ScanError::io(path, e))?;
    }
    Ok(EskerFile::growing(path, Outline { metadata, points, file_bytes }, Arc::new(tree)))
}

/// The lattice of 2^32 steps across the cube of a file.
fn lattice_of(file: &CopcFile) -> Result<Lattice, String> {
    let (offset, half_edge) = file.cube();
    if !EDGES.contains(&(2.0 * half_edge)) || offset.iter().any(|c| c.abs() > EDGES.end) {
        return Err(format!(
            "the cube of its octree has an edge of {:e}, which no scan has: it is damaged",
            2.0 * half_edge
        ));
    }
    let info = file.info();
    let system = info.crs.as_ref().and_then(|crs| Geographic::of(&crs.text, crs.unit.as_deref()));
    let factor = system.map_or([1.0; 3], |system| degrees::factor(&system, info.grid.bounds));
    let scale = [half_edge / 2f64.powi(31); 3];
    Ok(Lattice { scale, offset, shift: [0; 3], factor })
}

impl CopcTree {
    fn state(&self) -> RwLockReadGuard<'_, State> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn state_mut(&self) -> RwLockWriteGuard<'_, State> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// The pages of a chunk, from the cache or made.
    fn made(&self, chunk: u32) -> io::Result<Arc<Made>> {
        self.cache.with(chunk, || {
            let (key, place, points, above) = {
                let table = &self.state().table;
                let of = &table.chunks[chunk as usize];
                let above = of.key.level.checked_sub(1).map(|level| table.spacing_at(level));
                (of.key, of.place, of.points, above)
            };
            let bytes = self.file.chunk(place).map_err(plain)?;
            let points = self.file.decode(&bytes, points).map_err(plain)?;
            let nodes = self.pages.make(key, points, above).map_err(io::Error::other)?;
            self.take(chunk, nodes)
        })
    }

    /// Patches the records of the nodes of a chunk.
    fn take(&self, chunk: u32, nodes: Vec<MadeNode>) -> io::Result<Made> {
        let mut state = self.state_mut();
        let State { table, version, statistics } = &mut *state;
        let indices = table.chunks[chunk as usize].nodes.clone();
        let is_known = indices.iter().all(|&i| statistics[i as usize].is_some());
        let mut made = Made::default();
        for (index, node) in indices.into_iter().zip(nodes) {
            let MadeNode { page, own, record: new, sides, statistics: of, .. } = node;
            let at = index as usize;
            if page.len() as u64 != u64::from(table.nodes.nodes[at].page_bytes) {
                return Err(io::Error::other("a page has not the size that was planned"));
            }
            if !is_known {
                let nodes = Arc::make_mut(&mut table.nodes);
                let record = &mut nodes.nodes[at];
                let links = record.shape & esker_points::node::SHAPE_CONTINUATION;
                record.shape = new.shape | links;
                record.spacing = new.spacing;
                (record.level_count, record.level_counts) = (new.level_count, new.level_counts);
                (record.contour_centre, record.contour_half) =
                    (new.contour_centre, new.contour_half);
                (record.contour_rotation, record.occupancy) = (new.contour_rotation, new.occupancy);
                nodes.sides[at] = sides;
                statistics[at] = Some(of);
            }
            made.add(index, page, own);
        }
        *version += u64::from(!is_known);
        Ok(made)
    }

    /// Reads the page of the hierarchy that a node stands for.
    fn open_link(&self, node: u32) -> io::Result<()> {
        let stands = self.state().table.stands.get(node as usize).copied();
        let Some(Stands::Page(_, place)) = stands else { return Ok(()) };
        let entries = self.file.page(place).map_err(plain)?;
        let mut state = self.state_mut();
        let State { table, version, statistics } = &mut *state;
        let layout = &self.pages.context.pages;
        // A page with a fault must leave no half of itself behind.
        let mut grown = table.clone();
        grown.add(Some(node), &entries, layout).map_err(io::Error::other)?;
        *table = grown;
        statistics.resize_with(table.stands.len(), || None);
        *version += 1;
        Ok(())
    }

    /// The chunk that a node belongs to, if it has points.
    fn chunk_of(&self, node: u32) -> Option<u32> {
        match self.state().table.stands.get(node as usize) {
            Some(Stands::Chunk(chunk)) => Some(*chunk),
            _ => None,
        }
    }

    /// Nodes whose pages lie in a range of bytes: chunk, node, and offset of the page. Pages
    /// without points are of no chunk.
    fn pages_in(&self, range: Range<u64>) -> Vec<(Option<u32>, u32, u64)> {
        let table = &self.state().table;
        let of = |(offset, node): (u64, u32)| match table.stands[node as usize] {
            Stands::Chunk(chunk) if table.nodes.nodes[node as usize].page_offset == offset => {
                (Some(chunk), node, offset)
            }
            _ => (None, node, offset),
        };
        table.pages_in(range).map(of).collect()
    }
}

impl Growing for CopcTree {
    fn table(&self, known: Option<u64>) -> Option<(u64, Arc<NodeTable>)> {
        let state = self.state();
        (known != Some(state.version)).then(|| (state.version, state.table.nodes.clone()))
    }

    fn complete(&self, nodes: &[u32]) -> io::Result<()> {
        let (mut chunks, mut links) = (Vec::new(), Vec::new());
        {
            let state = self.state();
            for &node in nodes {
                match state.table.stands.get(node as usize) {
                    Some(Stands::Page(..)) => links.push(node),
                    Some(Stands::Chunk(chunk)) if state.statistics[node as usize].is_none() => {
                        chunks.push(*chunk);
                    }
                    _ => {}
                }
            }
            chunks.sort_unstable();
            chunks.dedup();
            let place = |&chunk: &u32| state.table.chunks[chunk as usize].place;
            self.file.will_read(&chunks.iter().map(place).collect::<Vec<_>>());
        }
        links.par_iter().try_for_each(|&link| self.open_link(link))?;
        chunks.par_iter().try_for_each(|&chunk| self.made(chunk).map(drop))
    }

    fn kept_bytes_max(&self) -> u64 {
        self.cache.bytes_max()
    }

    fn own_positions(&self, node: u32) -> io::Result<Vec<[i32; 3]>> {
        let Some(chunk) = self.chunk_of(node) else { return Ok(Vec::new()) };
        Ok(self.made(chunk)?.own(node).to_vec())
    }

    fn own_lattice(&self) -> Lattice {
        let grid = self.pages.grid;
        let factor = self.pages.lattice.factor;
        Lattice { scale: grid.scale, offset: grid.offset, shift: [0; 3], factor }
    }

    fn is_changed(&self) -> io::Result<bool> {
        self.file.is_changed()
    }

    fn statistics(&self, table: &NodeTable) -> Statistics {
        let state = self.state();
        let schema = &self.pages.schema;
        let unknown = NodeStatistics::unknown(schema);
        let of = |at: usize| {
            let known = state.statistics.get(at).and_then(Option::as_ref);
            known.unwrap_or(&unknown).clone()
        };
        let own = (0..table.nodes.len()).map(of).collect();
        Statistics::assemble(table, schema, own, self.histograms.clone())
    }
}

impl ReadAt for CopcTree {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        let end = offset.saturating_add(buf.len() as u64);
        // Bytes between pages are never used.
        let mut filled = offset;
        for (chunk, node, start) in self.pages_in(offset..end) {
            let made = chunk.map(|chunk| self.made(chunk)).transpose()?;
            let page = made.as_ref().map_or(&self.empty_page[..], |made| made.page(node));
            let (from, to) = (start.max(offset), (start + page.len() as u64).min(end));
            if from < to {
                let own = &page[(from - start) as usize..(to - start) as usize];
                buf[(from - offset) as usize..(to - offset) as usize].copy_from_slice(own);
                filled = to;
            }
        }
        if filled < end {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(())
    }

    fn bytes(&self) -> io::Result<u64> {
        Ok(self.file.info().bytes)
    }

    fn will_read(&self, ranges: &[Range<u64>]) {
        let mut chunks: Vec<u32> = ranges
            .iter()
            .flat_map(|r| self.pages_in(r.clone()))
            .filter_map(|page| page.0)
            .collect();
        chunks.sort_unstable();
        chunks.dedup();
        chunks.retain(|&chunk| !self.cache.has(chunk));
        let state = self.state();
        let place = |&chunk: &u32| state.table.chunks[chunk as usize].place;
        self.file.will_read(&chunks.iter().map(place).collect::<Vec<_>>());
    }

    fn interrupt(&self) {
        self.file.interrupt();
    }

    fn traffic(&self) -> Option<[u64; 2]> {
        self.file.traffic()
    }

    fn readers(&self) -> Option<usize> {
        // Decoding takes longer than reading: a thread a core, or as many as hide round trips.
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Some(self.file.readers().unwrap_or(0).max(cores))
    }
}

/// An error of the reader without the name of the file, which the caller adds.
fn plain(error: ScanError) -> io::Error {
    match error {
        ScanError::Io { source, .. } => source,
        ScanError::Damaged { what, .. } | ScanError::Unsupported { what, .. } => {
            io::Error::other(what)
        }
        other => io::Error::other(other.to_string()),
    }
}
