//! Meshes the zero surface of a function by surface nets (Gibson 1998): one vertex in each cell
//! whose corners differ in sign, at the mean of the crossings of its edges, and one quad for each
//! edge that the surface crosses. The surface is closed, with normals towards positive values.

use crate::mesh::triangles::{TriangleMesh, dot, sub};
use rayon::prelude::*;

/// A grid of cubic cells.
#[derive(Clone, Copy, Debug)]
pub struct Cells {
    /// First corner; the function is positive on the whole border.
    pub low: [f64; 3],
    /// Side of a cell.
    pub side: f64,
    /// Cells along each axis.
    pub count: [usize; 3],
}

impl Cells {
    /// Cells of this side that cover a box.
    pub fn covering(low: [f64; 3], high: [f64; 3], side: f64) -> Self {
        let count = [0, 1, 2].map(|a| libm::ceil((high[a] - low[a]) / side) as usize + 1);
        Self { low, side, count }
    }

    fn place(&self, at: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|a| self.low[a] + self.side * at[a])
    }
}

/// No vertex in a cell.
const NONE: u32 = u32::MAX;

/// Meshes the surface where `value` is zero, with about this number of triangles, by cells whose
/// side is found from a coarse mesh.
pub fn mesh_of(
    [low, high]: [[f64; 3]; 2],
    triangles: u64,
    value: impl Fn([f64; 3]) -> f64 + Sync,
) -> TriangleMesh {
    let longest = (0..3).fold(0.0f64, |m, a| m.max(high[a] - low[a]));
    // The number goes with the inverse square of the side, once cells resolve the shape.
    let coarse = longest / 120.0;
    let count = mesh(Cells::covering(low, high, coarse), &value).triangles.len();
    let side = coarse * (count as f64 / triangles as f64).sqrt();
    mesh(Cells::covering(low, high, side), &value)
}

/// Cells of a coarse block, along each axis.
const BLOCK: usize = 4;
/// Distance from the surface up to which a block is evaluated in full, in its diagonals: one would
/// do for exact distances, and the function need only be near them.
const NEAR: f64 = 1.25;

/// Coarse blocks of a grid: where the surface may pass, and the sign of the others.
struct Blocks {
    count: [usize; 3],
    /// Value at the middle of each block.
    values: Vec<f64>,
    is_near: Vec<bool>,
}

impl Blocks {
    fn new(cells: &Cells, value: &(impl Fn([f64; 3]) -> f64 + Sync)) -> Self {
        let count = cells.count.map(|n| n / BLOCK + 1);
        let [nx, ny, nz] = count;
        let middle = |b: usize| {
            let at = [b % nx, b / nx % ny, b / (nx * ny)];
            value(cells.place(at.map(|c| (c * BLOCK) as f64 + 0.5 * BLOCK as f64)))
        };
        let values: Vec<f64> = (0..nx * ny * nz).into_par_iter().map(middle).collect();
        let near = NEAR * 0.5 * 3f64.sqrt() * BLOCK as f64 * cells.side;
        let mut is_near = vec![false; values.len()];
        for (b, _) in values.iter().enumerate().filter(|(_, v)| v.abs() < near) {
            // Neighbours as well: a corner on the border of a block belongs to all around it.
            let span = |c: usize, n: usize| c.saturating_sub(1)..(c + 2).min(n);
            for k in span(b / (nx * ny), nz) {
                for j in span(b / nx % ny, ny) {
                    is_near[(k * ny + j) * nx..][span(b % nx, nx)].fill(true);
                }
            }
        }
        Self { count, values, is_near }
    }

    /// Value at the middle of the block of a corner; `None` if the surface may pass there.
    fn far(&self, at: [usize; 3]) -> Option<f64> {
        let [i, j, k] = at.map(|c| c / BLOCK);
        let block = (k * self.count[1] + j) * self.count[0] + i;
        (!self.is_near[block]).then(|| self.values[block])
    }
}

/// Meshes the surface where `value` is zero.
pub fn mesh(cells: Cells, value: &(impl Fn([f64; 3]) -> f64 + Sync)) -> TriangleMesh {
    let [nx, ny, nz] = cells.count;
    let blocks = &Blocks::new(&cells, value);
    let layer = |k: usize| -> Vec<f64> {
        let row = |j: usize| {
            let place = move |i: usize| cells.place([i as f64, j as f64, k as f64]);
            (0..=nx).map(move |i| blocks.far([i, j, k]).unwrap_or_else(|| value(place(i))))
        };
        (0..=ny).into_par_iter().flat_map_iter(row).collect()
    };
    let mut out = TriangleMesh::default();
    let mut below = layer(0);
    let mut vertices_below = vec![NONE; nx * ny];
    for k in 0..nz {
        let above = layer(k + 1);
        let vertices = place_vertices(&cells, k, [&below, &above], &mut out);
        connect(&cells, [&below, &above], [&vertices_below, &vertices], &mut out);
        (below, vertices_below) = (above, vertices);
    }
    out
}

/// Places the vertices of a layer of cells.
fn place_vertices(
    cells: &Cells,
    k: usize,
    values: [&[f64]; 2],
    out: &mut TriangleMesh,
) -> Vec<u32> {
    let [nx, ny, _] = cells.count;
    let mut vertices = vec![NONE; nx * ny];
    for j in 0..ny {
        for i in 0..nx {
            let corner = |c: usize| values[c >> 2][(j + (c >> 1 & 1)) * (nx + 1) + i + (c & 1)];
            let inside = (0..8).filter(|&c| corner(c) < 0.0).count();
            if inside == 0 || inside == 8 {
                continue;
            }
            let (mut sum, mut crossings) = ([0.0; 3], 0.0);
            for axis in 0..3 {
                for a in (0..8).filter(|a| a >> axis & 1 == 0) {
                    let (va, vb) = (corner(a), corner(a | 1 << axis));
                    if (va < 0.0) != (vb < 0.0) {
                        let along = va / (va - vb);
                        for (b, sum) in sum.iter_mut().enumerate() {
                            *sum += if b == axis { along } else { (a >> b & 1) as f64 };
                        }
                        crossings += 1.0;
                    }
                }
            }
            let base = [i, j, k].map(|c| c as f64);
            let at = [0, 1, 2].map(|a| base[a] + sum[a] / crossings);
            vertices[j * nx + i] = out.positions.len() as u32;
            out.positions.push(cells.place(at));
        }
    }
    vertices
}

/// Adds a quad for each crossed edge of which all four cells are known: edges in the lower corner
/// layer, and upright ones between both.
fn connect(
    cells: &Cells,
    [low, high]: [&[f64]; 2],
    [before, here]: [&[u32]; 2],
    out: &mut TriangleMesh,
) {
    let [nx, ny, _] = cells.count;
    for j in 0..ny {
        for i in 0..nx {
            let at = j * (nx + 1) + i;
            let inside = low[at] < 0.0;
            let cell = |layer: &[u32], i: usize, j: usize| layer[j * nx + i];
            if j > 0 && inside != (low[at + 1] < 0.0) {
                let around = [
                    cell(before, i, j - 1),
                    cell(before, i, j),
                    cell(here, i, j),
                    cell(here, i, j - 1),
                ];
                quad(around, inside, out);
            }
            if i > 0 && inside != (low[at + nx + 1] < 0.0) {
                let around = [
                    cell(before, i - 1, j),
                    cell(here, i - 1, j),
                    cell(here, i, j),
                    cell(before, i, j),
                ];
                quad(around, inside, out);
            }
            if i > 0 && j > 0 && inside != (high[at] < 0.0) {
                let around = [
                    cell(here, i - 1, j - 1),
                    cell(here, i, j - 1),
                    cell(here, i, j),
                    cell(here, i - 1, j),
                ];
                quad(around, inside, out);
            }
        }
    }
}

/// Adds a quad, counter-clockwise seen along the edge backwards, cut along its shorter diagonal.
fn quad(mut around: [u32; 4], inside_first: bool, out: &mut TriangleMesh) {
    if !inside_first {
        around.reverse();
    }
    let [a, b, c, d] = around;
    let length = |p: u32, q: u32| {
        let d = sub(out.positions[p as usize], out.positions[q as usize]);
        dot(d, d)
    };
    if length(a, c) <= length(b, d) {
        out.triangles.extend([[a, b, c], [a, c, d]]);
    } else {
        out.triangles.extend([[a, b, d], [b, c, d]]);
    }
}
