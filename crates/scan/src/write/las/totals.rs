//! Counts and bounds of the points of a LAS file, and the fields of its header that are filled in
//! from them when all points are written (LAS 1.4 R15, tables 3 to 5).

use super::plan::{is_1_4, minor};
use super::records::raw;
use crate::write::encode::Encoded;
use esker_points::{Grid, Lattice};

/// Sums over the points of a file.
#[derive(Clone, Debug)]
pub struct Totals {
    grid: Grid,
    /// Number of points.
    pub count: u64,
    by_return: [u64; 15],
    bounds: Option<[[u32; 3]; 2]>,
}

impl Totals {
    /// No points, whose coordinates have this scale and offset.
    pub fn new(grid: Grid) -> Self {
        Self { grid, count: 0, by_return: [0; 15], bounds: None }
    }

    /// Adds points; their bytes do not matter.
    pub fn add(&mut self, points: &Encoded) {
        self.count += points.points;
        for (sum, n) in self.by_return.iter_mut().zip(points.by_return) {
            *sum += n;
        }
        self.bounds = self.bounds.into_iter().chain(points.bounds).reduce(joined);
    }

    /// Fills in the header's fields that are known when all points are written.
    pub fn fill(&self, header: &mut [u8], points_start: u32, vlrs: u32, is_legacy: bool) {
        let is_1_4 = is_1_4(header);
        let has_waveforms = minor(header) >= 3 && header.len() >= 235;
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(96, &points_start.to_le_bytes());
        put(100, &vlrs.to_le_bytes());
        // Formats 6 to 10 have no counts of 32 bits.
        let legacy = |n: u64| {
            let fits = is_legacy && self.count <= u64::from(u32::MAX);
            if fits || !is_1_4 { n.min(u64::from(u32::MAX)) as u32 } else { 0 }
        };
        put(107, &legacy(self.count).to_le_bytes());
        for i in 0..5 {
            put(111 + 4 * i, &legacy(self.by_return[i]).to_le_bytes());
        }
        for axis in 0..3 {
            let (scale, offset) = (self.grid.scale[axis], self.grid.offset[axis]);
            put(131 + 8 * axis, &scale.to_le_bytes());
            put(155 + 8 * axis, &offset.to_le_bytes());
            let bound = |end: usize| match self.bounds {
                None => offset,
                Some(bounds) => f64::from(raw(bounds[end][axis])) * scale + offset,
            };
            put(179 + 16 * axis, &bound(1).to_le_bytes());
            put(187 + 16 * axis, &bound(0).to_le_bytes());
        }
        if has_waveforms {
            // Waveform packets are not kept.
            put(227, &0u64.to_le_bytes());
        }
        if is_1_4 {
            put(235, &[0; 12]);
            put(247, &self.count.to_le_bytes());
            for (i, n) in self.by_return.iter().enumerate() {
                put(255 + 8 * i, &n.to_le_bytes());
            }
        }
    }
}

/// The box around two boxes.
pub fn joined(a: [[u32; 3]; 2], b: [[u32; 3]; 2]) -> [[u32; 3]; 2] {
    [[0, 1, 2].map(|i| a[0][i].min(b[0][i])), [0, 1, 2].map(|i| a[1][i].max(b[1][i]))]
}

/// Scale and offset of the integers that [`raw`] makes of lattice coordinates.
pub fn grid(lattice: &Lattice) -> Grid {
    let moved = |i: usize| lattice.shift[i] as f64 * lattice.scale[i] + lattice.offset[i];
    let offset =
        [0, 1, 2].map(|i| if lattice.shift[i] == 0 { lattice.offset[i] } else { moved(i) });
    Grid { scale: lattice.scale, offset }
}
