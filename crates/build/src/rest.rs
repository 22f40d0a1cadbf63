//! The points that thinning may still pick, along the Morton curve: how far each is from the picked ones, and
//! which of them are near a place. Points of an octree cell stand together, so a table from cells to runs finds
//! neighbours; distances are in space.

use std::ops::Range;

/// Points of a block.
const LANES: usize = 4;
/// The edge of the cells by which neighbours are found is at least so many radii, and less than twice as many.
const EDGE_RADII: f64 = 1.5;

/// Four points in a cache line, over which the innermost loop of a build runs.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
struct Block {
    q: [[i32; LANES]; 3],
    nearest2: [f32; LANES],
}

/// No points: what is at distance 0 is never picked.
const EMPTY: Block = Block { q: [[0; LANES]; 3], nearest2: [0.0; LANES] };

impl Block {
    /// Differences are exact, and the rounding of their squares, the same everywhere, moves a radius by a ten
    /// millionth.
    #[inline]
    fn tell(&mut self, p: [i32; 3]) {
        for lane in 0..LANES {
            let d = |axis: usize| self.q[axis][lane].wrapping_sub(p[axis]) as f32;
            let (x, y, z) = (d(0), d(1), d(2));
            let d2 = x * x + y * y + z * z;
            let nearest2 = self.nearest2[lane];
            self.nearest2[lane] = if d2 < nearest2 { d2 } else { nearest2 };
        }
    }
}

/// Points in blocks, and where those of each cell stand.
#[derive(Default)]
pub struct Rest {
    blocks: Vec<Block>,
    /// Which candidate each is.
    pub candidate: Vec<u32>,
    cells: Cells,
    /// Log2 of the edge of the cells.
    log2: u32,
}

/// Log2 of the edge of the cells, in steps, by which neighbours within a radius are found.
pub fn cell_log2(radius: f64) -> u32 {
    ((radius * EDGE_RADII).log2().ceil().max(0.0) as u32).min(31)
}

impl Rest {
    /// Takes other points: candidates in order, with the squares of their distances to the nearest picked one.
    pub fn refill(&mut self, q: &[[i32; 3]], points: impl Iterator<Item = (u32, f32)>, log2: u32) {
        self.log2 = log2;
        self.candidate.clear();
        self.blocks.clear();
        for (candidate, nearest2) in points {
            let lane = self.candidate.len() % LANES;
            if lane == 0 {
                self.blocks.push(EMPTY);
            }
            if let Some(block) = self.blocks.last_mut() {
                let p = q[candidate as usize];
                (0..3).for_each(|axis| block.q[axis][lane] = p[axis]);
                block.nearest2[lane] = nearest2;
            }
            self.candidate.push(candidate);
        }
        self.cells.fill(self.candidate.iter().map(|&c| q[c as usize].map(|c| c >> log2)));
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.candidate.len()
    }

    /// Square of the distance to the nearest picked point, where that is within the radius of the last telling;
    /// else any that is not.
    #[inline]
    pub fn nearest2(&self, i: usize) -> f32 {
        self.blocks[i / LANES].nearest2[i % LANES]
    }

    /// The first point from `i` on which is so far from picked ones.
    #[inline]
    pub fn next_from(&self, i: usize, least2: f32) -> Option<usize> {
        let (mut block, mut lane) = (i / LANES, i % LANES);
        while let Some(b) = self.blocks.get(block) {
            for l in lane..LANES {
                if b.nearest2[l] >= least2 {
                    return Some(block * LANES + l);
                }
            }
            (block, lane) = (block + 1, 0);
        }
        None
    }

    /// Tells all points within a radius, itself among them, that one is picked.
    #[inline]
    pub fn tell(&mut self, p: [i32; 3], reach: i32) {
        let low = p.map(|c| c.saturating_sub(reach) >> self.log2);
        let high = p.map(|c| c.saturating_add(reach) >> self.log2);
        let reach2 = reach as f32 * reach as f32;
        // Square of the distance to a cell along an axis.
        let gap2 = |axis: usize, cell: i32| {
            let within = i64::from(p[axis]) - (i64::from(cell) << self.log2);
            let beyond = within.wrapping_neg().max(within - (1 << self.log2)).max(0) as f32;
            beyond * beyond
        };
        for z in low[2]..=high[2] {
            let gap2_z = gap2(2, z);
            for y in low[1]..=high[1] {
                let gap2_yz = gap2_z + gap2(1, y);
                for x in low[0]..=high[0] {
                    if gap2_yz + gap2(0, x) > reach2 {
                        continue;
                    }
                    if let Some(run) = self.cells.find([x, y, z]) {
                        self.blocks[run].iter_mut().for_each(|block| block.tell(p));
                    }
                }
            }
        }
    }
}

/// Which blocks hold the points of each cell: a table with open addressing.
#[derive(Default)]
struct Cells {
    slots: Vec<Slot>,
    shift: u32,
    runs: Vec<Slot>,
}

/// A cell's key, and its blocks; the end is 0 where there is none.
type Slot = (u64, u32, u32);

impl Cells {
    /// From the cell of each point; equal ones stand together.
    fn fill(&mut self, cells: impl Iterator<Item = [i32; 3]>) {
        self.runs.clear();
        let mut last = None;
        for (i, cell) in cells.enumerate() {
            let block = (i / LANES) as u32;
            match self.runs.last_mut() {
                Some(run) if last == Some(cell) => run.2 = block + 1,
                _ => self.runs.push((key(cell), block, block + 1)),
            }
            last = Some(cell);
        }
        let size = (self.runs.len() * 2).next_power_of_two().max(2);
        self.shift = 64 - size.ilog2();
        self.slots.clear();
        self.slots.resize(size, (0, 0, 0));
        for &run in &self.runs {
            let mut at = (run.0 >> self.shift) as usize;
            while self.slots[at].2 > 0 {
                at = (at + 1) & (size - 1);
            }
            self.slots[at] = run;
        }
    }

    #[inline]
    fn find(&self, cell: [i32; 3]) -> Option<Range<usize>> {
        let key = key(cell);
        let mut at = (key >> self.shift) as usize;
        loop {
            match self.slots[at] {
                (_, _, 0) => return None,
                (k, first, end) if k == key => return Some(first as usize..end as usize),
                _ => at = (at + 1) & (self.slots.len() - 1),
            }
        }
    }
}

/// A number for a cell. Should two cells ever share one, points of one of them are told less than they could be.
fn key(cell: [i32; 3]) -> u64 {
    const ODD: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xd1b5_4a32_d192_ed03, 0x8cb9_2ba7_2f3d_8dd7];
    let part = |axis: usize| (cell[axis] as u64).wrapping_mul(ODD[axis]);
    part(0).wrapping_add(part(1)).wrapping_add(part(2))
}
