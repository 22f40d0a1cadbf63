//! What chunks need of each other to estimate normals, edges and shapes
//! (`docs/design/building.md`): the positions near the faces of each chunk's cell, with the normals
//! that sources give. They are copied to scratch before the first chunk is built,
//! since rows are freed chunk by chunk. The halo of a chunk is the copied positions of other chunks
//! within reach of its cell.

use crate::attributes::blocks::{self, Blocks};
use crate::attributes::density::{Densities, Density, Distances, excess_bits};
use crate::attributes::normals::{Bounds, UNKNOWN, estimate, stored, turned_to};
use crate::attributes::sharp::{Edge, Points, detect};
use crate::attributes::tangents::shapes;
use crate::error::BuildError;
use crate::rows::partition::Bucket;
use crate::rows::row::{RowLayout, position};
use crate::rows::scratch::{Extent, Map, Scratch};
use esker_points::tangents::Shape;
use esker_points::{Cell, Grain, quant};
use rayon::prelude::*;

/// Rows that one task reads, and tasks whose positions are written together.
const TASK_ROWS: usize = 1 << 14;
const GROUP_TASKS: usize = 64;
/// Log2 of the edge of a bucket over that of the cells in which its points are counted at first.
const DIVIDED_LOG2: u8 = 4;
/// Bytes of a stored position, and of the normal behind it if sources give normals.
const POSITION_BYTES: usize = 12;
const NORMAL_BYTES: usize = 4;
/// Least cosine of the angle between a point's normal and that of the place where it lies, for an
/// edge found there to apply to it: 15 degrees, below which two planes are the same.
const SAME: f32 = 0.966;

/// The borders of all chunks.
pub struct Borders {
    bounds: Bounds,
    /// Limits of blocks, if normals are estimated from these.
    pub blocks: Option<Blocks>,
    rows: RowLayout,
    /// Whether sharp edges are detected too.
    finds_edges: bool,
    /// Whether the shapes of splats are estimated too.
    pub finds_shapes: bool,
    /// Cells of chunks, and the places of the positions near their faces.
    cells: Vec<(Cell, Vec<Extent>)>,
}

/// What is estimated for points: codes of normals, and edges and shapes if chosen.
struct Surfaces {
    codes: Vec<[i16; 2]>,
    edges: Vec<Option<Edge>>,
    shapes: Vec<Shape>,
}

/// What is estimated for coincident points.
#[derive(Clone, Copy, Debug)]
pub struct StackSurface {
    /// Code of the normal of those for which sources give none.
    code: [i16; 2],
    edge: Option<Edge>,
    shape: Option<Shape>,
}

/// The smallest cell of consecutive buckets in Morton order, at least one. It holds no points of
/// other buckets.
pub fn cell_of(buckets: &[Bucket]) -> Cell {
    let last = &buckets[buckets.len() - 1];
    Cell::enclosing(buckets[0].cell.corner, last.cell.last())
}

/// Estimates how far points are apart on a lattice with these steps.
///
/// # Errors
/// If scratch space fails.
pub fn distances(
    buckets: &[Bucket],
    stride: usize,
    scale: [f64; 3],
    scratch: &mut Scratch,
) -> Result<Distances, BuildError> {
    Ok(densities(buckets, stride, scale, scratch)?.distances())
}

/// Counts points by cell on a lattice with these steps.
///
/// # Errors
/// If scratch space fails.
pub fn densities(
    buckets: &[Bucket],
    stride: usize,
    scale: [f64; 3],
    scratch: &mut Scratch,
) -> Result<Densities, BuildError> {
    let excess = excess_bits(scale);
    let cubic = density(buckets, stride, excess, scratch)?;
    let by_steps = match excess {
        [0, 0, 0] => None,
        _ => Some(density(buckets, stride, [0; 3], scratch)?),
    };
    Ok(Densities { cubic, by_steps })
}

/// Counts points by cell; `excess` bits of their coordinates are left out.
fn density(
    buckets: &[Bucket],
    stride: usize,
    excess: [u32; 3],
    scratch: &mut Scratch,
) -> Result<Density, BuildError> {
    let is_stored = buckets.iter().any(|b| !b.extents.is_empty());
    let map = if is_stored { Some(scratch.map()?) } else { None };
    let of_bucket = |b: &Bucket, log2| {
        let runs = b.runs(map.as_ref(), stride);
        let rows = runs.into_iter().flat_map(|r| r.chunks_exact(stride)).map(position);
        Density::of(rows.map(|p| [0, 1, 2].map(|i| p[i] >> excess[i])), log2)
    };
    // Most of the work would be to double cells that begin as single steps.
    let mut edges: Vec<u8> = buckets.iter().map(|b| b.cell.log2).collect();
    edges.sort_unstable();
    let mut least = edges.get(edges.len() / 2).map_or(0, |edge| edge.saturating_sub(DIVIDED_LOG2));
    loop {
        let densities = buckets.par_iter().map(|bucket| of_bucket(bucket, least));
        let density = densities.reduce(Density::default, Density::merged);
        if least == 0 || density.is_above(least) {
            return Ok(density);
        }
        least = least.saturating_sub(DIVIDED_LOG2);
    }
}

impl Borders {
    /// No borders yet. Rows must have room for normals.
    pub fn new(bounds: Bounds, rows: RowLayout, finds_edges: bool) -> Self {
        Self { bounds, blocks: None, rows, finds_edges, finds_shapes: false, cells: Vec::new() }
    }

    /// Cells of chunks, and the places of the positions near their faces.
    pub fn cells(&self) -> &[(Cell, Vec<Extent>)] {
        &self.cells
    }

    /// Adds borders that an earlier build has stored.
    pub fn restore(&mut self, cells: Vec<(Cell, Vec<Extent>)>) {
        self.cells.extend(cells);
    }

    /// Bytes of a stored point of rows with this layout.
    pub fn point_bytes(rows: &RowLayout) -> usize {
        POSITION_BYTES + if rows.has_given_normals() { NORMAL_BYTES } else { 0 }
    }

    /// Stores the positions near the faces of the cell of a chunk.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn add(&mut self, buckets: &[Bucket], scratch: &mut Scratch) -> Result<(), BuildError> {
        let cell = cell_of(buckets);
        let steps = self.blocks.map_or(self.bounds.steps(), |blocks| blocks.steps());
        let last = cell.last();
        let near_a_face = move |p: &[u32; 3]| {
            (0..3).any(|i| p[i] - cell.corner[i] < steps[i] || last[i] - p[i] < steps[i])
        };
        let stride = self.rows.bytes();
        let is_stored = buckets.iter().any(|b| !b.extents.is_empty());
        let map = if is_stored { Some(scratch.map()?) } else { None };
        let runs: Vec<&[u8]> = buckets.iter().flat_map(|b| b.runs(map.as_ref(), stride)).collect();
        let extents = self.store(&runs, &near_a_face, scratch)?;
        self.cells.push((cell, extents));
        Ok(())
    }

    /// Stores positions of a cell beside a part of the tree, `part`, that are within reach of it:
    /// another job builds the cell. `runs` are some or all of its rows.
    ///
    /// # Errors
    /// If scratch space fails.
    pub fn add_beside(
        &mut self,
        part: &Cell,
        cell: Cell,
        runs: &[&[u8]],
        scratch: &mut Scratch,
    ) -> Result<(), BuildError> {
        let [low, high] = self.around(part);
        let within = move |p: &[u32; 3]| (0..3).all(|i| low[i] <= p[i] && p[i] <= high[i]);
        let extents = self.store(runs, &within, scratch)?;
        self.cells.push((cell, extents));
        Ok(())
    }

    /// Copies positions of rows to scratch, with the normals that sources give: those for which
    /// `is_wanted` is true.
    fn store(
        &self,
        runs: &[&[u8]],
        is_wanted: &(impl Fn(&[u32; 3]) -> bool + Sync),
        scratch: &mut Scratch,
    ) -> Result<Vec<Extent>, BuildError> {
        let stride = self.rows.bytes();
        let tasks: Vec<&[u8]> = runs.iter().flat_map(|r| r.chunks(TASK_ROWS * stride)).collect();
        let mut extents = Vec::new();
        for group in tasks.chunks(GROUP_TASKS) {
            let near = |rows: &&[u8]| {
                let rows = rows.chunks_exact(stride).filter(|row| is_wanted(&position(row)));
                let mut near: Vec<([u32; 3], Option<[i16; 2]>)> =
                    rows.map(|row| (position(row), self.rows.given_normal(row))).collect();
                near.dedup();
                let mut bytes = Vec::with_capacity(near.len() * Self::point_bytes(&self.rows));
                for (position, normal) in near {
                    bytes.extend(position.iter().flat_map(|c| c.to_le_bytes()));
                    bytes.extend(normal.iter().flatten().flat_map(|c| c.to_le_bytes()));
                }
                bytes
            };
            let near: Vec<Vec<u8>> = group.par_iter().map(near).collect();
            let near = near.concat();
            if !near.is_empty() {
                extents.push(scratch.append(&near)?);
            }
        }
        Ok(extents)
    }

    /// Least and greatest position within reach of `cell`.
    pub fn around(&self, cell: &Cell) -> [[u32; 3]; 2] {
        let around = |blocks: Blocks| blocks.around(cell);
        self.blocks.map_or_else(|| self.bounds.around(cell), around)
    }

    /// Removes the border of a cell and returns its place. The others keep their order, which is
    /// that of the points of halos.
    pub fn remove(&mut self, cell: &Cell) -> Vec<Extent> {
        let at = self.cells.iter().position(|(other, _)| other == cell);
        at.map_or_else(Vec::new, |at| self.cells.remove(at).1)
    }

    /// Estimates normals, and clip lines and shapes if chosen, of the sorted rows of a chunk, which
    /// are all points of `cell`.
    pub fn estimate(&self, cell: &Cell, rows: &mut [u8], scratch: &Map) {
        let stride = self.rows.bytes();
        let own: Vec<[u32; 3]> = rows.par_chunks_exact(stride).map(position).collect();
        let given: Vec<[i16; 2]> =
            rows.par_chunks_exact(stride).filter_map(|row| self.rows.given_normal(row)).collect();
        let Surfaces { codes, edges, shapes } = self.surfaces(cell, (&own, &given), scratch);
        let rows = rows.par_chunks_exact_mut(stride).zip(codes).enumerate();
        rows.with_min_len(TASK_ROWS).for_each(|(i, (row, code))| {
            self.set(row, code, edges.get(i).copied().flatten().as_ref(), shapes.get(i));
        });
    }

    /// Estimates what [`Self::estimate`] does for points that all lie at the corner of `cell`;
    /// `runs` are their rows, in any order.
    pub fn estimate_stack(&self, cell: &Cell, runs: &[&[u8]], scratch: &Map) -> StackSurface {
        let rows = runs.par_iter().flat_map(|run| run.par_chunks_exact(self.rows.bytes()));
        let given = |row: &[u8]| self.rows.given_normal(row).unwrap_or(UNKNOWN);
        // Of the normals that sources give, the greatest counts as that of the place, and that of
        // the last row for the shape.
        let ends = self.rows.has_given_normals().then(|| {
            let greatest = rows.clone().map(given).max().unwrap_or(UNKNOWN);
            let last = rows.clone().max().map_or(UNKNOWN, given);
            let some_lack_it = rows.clone().any(|row| given(row) == UNKNOWN);
            (some_lack_it.then_some(UNKNOWN), [greatest, last])
        });
        let given: Vec<[i16; 2]> =
            ends.into_iter().flat_map(|(lacking, ends)| lacking.into_iter().chain(ends)).collect();
        let own = vec![cell.corner; given.len().max(1)];
        let found = self.surfaces(cell, (&own, &given), scratch);
        StackSurface {
            code: found.codes.first().copied().unwrap_or(UNKNOWN),
            edge: found.edges.first().copied().flatten(),
            shape: found.shapes.last().copied(),
        }
    }

    /// Sets what was estimated for a stack in one of its rows.
    pub fn set_of_stack(&self, row: &mut [u8], stack: &StackSurface) {
        let given = self.rows.given_normal(row).filter(|&given| given != UNKNOWN);
        self.set(row, given.unwrap_or(stack.code), stack.edge.as_ref(), stack.shape.as_ref());
    }

    /// Estimates normals, edges and shapes at the positions `own` of a chunk, with the normals that
    /// sources give, if any do.
    fn surfaces(
        &self,
        cell: &Cell,
        (own, given): (&[[u32; 3]], &[[i16; 2]]),
        scratch: &Map,
    ) -> Surfaces {
        let (halo, given_of_halo) = self.halo(cell, scratch);
        let (codes, edges) = if self.finds_edges {
            let own = Points { positions: own, normals: given };
            detect(own, Points { positions: &halo, normals: &given_of_halo }, &self.bounds)
        } else if given.is_empty() || given.contains(&UNKNOWN) {
            let estimated = self.normals(own, &halo).into_iter().enumerate();
            let code = |(i, code)| match given.get(i) {
                Some(&given) if given != UNKNOWN => given,
                _ => code,
            };
            (estimated.map(code).collect(), Vec::new())
        } else {
            (given.to_vec(), Vec::new())
        };
        let edge = |i: usize| edges.get(i).copied().flatten();
        let normal = |(i, &code)| edge(i).map_or(stored(code), |edge: Edge| edge.normal);
        let shapes = if self.finds_shapes {
            let normals: Vec<[i16; 2]> = codes.iter().enumerate().map(normal).collect();
            shapes(own, &halo, &self.bounds, &normals)
        } else {
            Vec::new()
        };
        Surfaces { codes, edges, shapes }
    }

    /// Codes of the normals of `own` points beside those of the halo.
    fn normals(&self, own: &[[u32; 3]], halo: &[[u32; 3]]) -> Vec<[i16; 2]> {
        match &self.blocks {
            Some(blocks) => blocks::estimate(own, halo, blocks),
            None => estimate(own, halo, &self.bounds),
        }
    }

    /// Sets what was estimated for a row.
    fn set(&self, row: &mut [u8], code: [i16; 2], edge: Option<&Edge>, shape: Option<&Shape>) {
        if let Some(shape) = shape {
            self.rows.set_shape(row, shape);
        }
        self.set_normal(row, edge.map_or(code, |edge| edge.normal));
        let Some(edge) = edge else { return };
        let drawn = self.rows.given_normal(row).or(self.rows.normal(row)).unwrap_or(UNKNOWN);
        let [drawn, found] = [drawn, edge.normal].map(quant::oct_decode);
        let cosine = drawn[0] * found[0] + drawn[1] * found[1] + drawn[2] * found[2];
        // Which side is kept is relative to the normal that is drawn.
        if cosine.abs() < SAME {
            return;
        }
        let clip = if cosine < 0.0 { edge.clip.turned() } else { edge.clip };
        self.rows.set_clip_lines(row, clip.words(position(row), Grain::new(self.bounds.scale)));
    }

    /// Sets the normal of a row, flipped towards the scanner if the row has the direction to it.
    fn set_normal(&self, row: &mut [u8], code: [i16; 2]) {
        let towards = self.rows.normal(row).unwrap_or_default();
        // Estimated normals point upwards, the direction of a row without a scanner.
        let is_upwards = towards == [0; 2];
        let turned = || turned_to(code, quant::oct_decode(towards));
        self.rows.set_normal(row, if is_upwards { code } else { turned() });
    }

    /// Stored positions of other chunks within reach of `cell`, and the normals that sources give
    /// them, if any do; some occur more than once.
    fn halo(&self, cell: &Cell, scratch: &Map) -> (Vec<[u32; 3]>, Vec<[i16; 2]>) {
        let [low, high] = self.around(cell);
        let meets =
            |other: &Cell| (0..3).all(|i| other.corner[i] <= high[i] && low[i] <= other.last()[i]);
        let is_other = |other: &Cell| !other.contains(cell.corner) && meets(other);
        let extents: Vec<Extent> = self
            .cells
            .iter()
            .filter(|(other, _)| is_other(other))
            .flat_map(|(_, extents)| extents.iter().copied())
            .collect();
        let within = |p: &[u32; 3]| (0..3).all(|i| low[i] <= p[i] && p[i] <= high[i]);
        let part = |bytes: &[u8]| {
            let (mut positions, mut normals) = (Vec::new(), Vec::new());
            for point in bytes.chunks_exact(Self::point_bytes(&self.rows)) {
                let (at, normal) = (position(point), &point[POSITION_BYTES..]);
                if within(&at) {
                    positions.push(at);
                    let half = |at: usize| i16::from_le_bytes([normal[at], normal[at + 1]]);
                    normals.extend((!normal.is_empty()).then(|| [half(0), half(2)]));
                }
            }
            (positions, normals)
        };
        let parts: Vec<_> = extents.par_iter().filter_map(|e| e.of(scratch)).map(part).collect();
        let (positions, normals): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        (positions.concat(), normals.concat())
    }
}
