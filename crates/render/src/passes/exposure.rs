//! Even: takes differences of exposure from scans that cover the same surface. One point wins a pixel, so that where two
//! scans overlap, pixels of either lie side by side at random. Preiner et al. (Auto Splats, 2012), after whom kanzok2015
//! (section 3.2.4) evens_exposure out illumination, blend all splats of a surface, and what is fine with them. Here a pixel is
//! multiplied by what its surroundings have in all scans over what they have in the pixel's own: scans meet in the middle,
//! and the texture stays as fine as it is.
//!
//! Surroundings are cells of the picture and of depth, nearly cubes (the grid of Chen, Paris and Durand, Real-time
//! edge-aware image processing with the bilateral grid, 2007), and a slot of each cell is a scan's: across an edge of depth nothing is
//! evened. Sums are of whole steps, so that the order of adding changes nothing.

use crate::frame::ColourPlane;
use crate::inputs::lookup::Lookup;
use crate::passes::project::{EMPTY, unpack};
use crate::picture::pyramid::{Level, for_each_row};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Pixels on a side of a cell. Smaller ones take texture for exposure, larger ones miss what changes within a scan.
pub(crate) const CELL_PX: usize = 32;
/// Bits of a depth below those that number its slice: eight slices double it, about what a cell is wide.
const SLICE_BITS: u32 = 20;
/// Slices that are told apart: depths that differ by a multiple of 16 times share one.
pub(crate) const SLICES: usize = 32;
/// Slots of a cell: the first is of all scans, the others are a scan's each, by its number modulo theirs.
pub(crate) const SLOTS: usize = 16;
/// What is summed lies between 0 and so many steps: sums of a cell are whole numbers that `f32` has.
const STEPS: f32 = 16_383.0;
/// Colours are multiplied by so much at most, or its inverse: a difference beyond that is none of exposure.
const GAIN_MAX: f32 = 2.0;
/// Added to means before they are divided: of what is nearly black there is no gain.
const DARK: f32 = 1e-3;

/// What is added up for the cells of a picture. Memory is kept from frame to frame.
#[derive(Debug, Default)]
pub struct ExposureGrid {
    /// Red, green, blue and the number of pixels; slot by slot, slice by slice, cell by cell.
    cells: Vec<Vec4>,
    /// The slot of each pixel's scan.
    slots: Vec<u8>,
}

impl ExposureGrid {
    /// Evens the pixels of `base`, whose points `target` names.
    pub fn run(&mut self, lookup: &Lookup<'_>, target: &[AtomicU64], base: &mut Level) {
        let (width, columns) = (base.width, base.width.div_ceil(CELL_PX));
        let row_of_cells = columns * SLICES * SLOTS;
        self.cells.resize(row_of_cells * base.height.div_ceil(CELL_PX), Vec4::ZERO);
        self.slots.resize(base.front.len(), 0);
        let bands = self.cells.par_chunks_mut(row_of_cells);
        let bands = bands.zip(self.slots.par_chunks_mut(CELL_PX * width));
        bands.enumerate().for_each(|(band, (cells, slots))| {
            cells.fill(Vec4::ZERO);
            let first = band * CELL_PX * width;
            for (i, slot) in slots.iter_mut().enumerate() {
                let pixel = first + i;
                if !base.is_valid(pixel) {
                    continue;
                }
                *slot = slot_of(lookup, target[pixel].load(Relaxed));
                let slice = (base.depth[pixel].to_bits() >> SLICE_BITS) as usize;
                let cell = &mut cells[slots_index(i % width / CELL_PX, slice)..][..SLOTS];
                let value = quantised(base.tint[pixel].truncate());
                cell[0] += value;
                cell[usize::from(*slot)] += value;
            }
        });
        let (cells, slots) = (&self.cells, &self.slots);
        for_each_row(base, |row| {
            let (upper, down) = between_cells(row.y);
            let rows = [(upper, 1.0 - down), (upper + 1, down)].map(|(at, share)| {
                let band = at.checked_sub(1).and_then(|at| cells.chunks(row_of_cells).nth(at));
                (band, share)
            });
            for (x, slot) in slots[row.y * width..][..width].iter().enumerate() {
                if row.front[x].x < f32::INFINITY {
                    let around = surroundings(rows, columns, x, row.depth[x], usize::from(*slot));
                    let gain = gain(around);
                    row.tint[x] *= gain.extend(1.0);
                }
            }
        });
    }
}

/// The slot of the scan of the point that won a pixel.
fn slot_of(lookup: &Lookup<'_>, value: u64) -> u8 {
    if value == EMPTY {
        return 1;
    }
    let (draw, index) = lookup.list.find(unpack(value).1);
    let scan = match lookup.frame.draws[draw].colour {
        ColourPlane::Rgba(plane) => plane.get(index * 4 + 3).copied().unwrap_or(0),
        _ => 0,
    };
    1 + scan % (SLOTS - 1) as u8
}

/// Where a cell's slots begin in its row of cells.
fn slots_index(column: usize, slice: usize) -> usize {
    (column * SLICES + slice % SLICES) * SLOTS
}

/// A colour in whole steps, and one pixel. What is no number is 0.
fn quantised(colour: Vec3) -> Vec4 {
    let steps = |c: f32| (c.clamp(0.0, 1.0) * STEPS + 0.5) as u32 as f32;
    Vec4::new(steps(colour.x), steps(colour.y), steps(colour.z), 1.0)
}

/// Between the middles of which two cells a pixel lies: one more than the number of the first, and the share of the second.
fn between_cells(pixel: usize) -> (usize, f32) {
    let at = pixel + CELL_PX / 2;
    (at / CELL_PX, ((at % CELL_PX) as f32 + 0.5) / CELL_PX as f32)
}

/// Sums around a pixel: of all scans, and of that with a slot. `rows` are the rows of cells above and below, with their shares.
fn surroundings(
    rows: [(Option<&[Vec4]>, f32); 2],
    columns: usize,
    x: usize,
    depth: f32,
    slot: usize,
) -> [Vec4; 2] {
    const SLICE: u32 = 1 << SLICE_BITS;
    let (left, right) = between_cells(x);
    // As `halfway` has it.
    let behind = depth.to_bits() + SLICE / 2;
    let deeper = (behind % SLICE) as f32 / SLICE as f32;
    let slices = (behind / SLICE) as usize;
    let [mut all, mut own] = [Vec4::ZERO; 2];
    for (row, share) in rows {
        let Some(row) = row else { continue };
        for (column, across) in [(left, 1.0 - right), (left + 1, right)] {
            let Some(column) = column.checked_sub(1).filter(|&c| c < columns) else { continue };
            for (slice, along) in [(slices.wrapping_sub(1), 1.0 - deeper), (slices, deeper)] {
                let cell = &row[slots_index(column, slice)..][..SLOTS];
                let share = share * across * along;
                all += cell[0] * share;
                own += cell[slot % SLOTS] * share;
            }
        }
    }
    [all, own]
}

/// What a colour is to be multiplied by, from sums over all scans and over its own.
fn gain([all, own]: [Vec4; 2]) -> Vec3 {
    let mean = |sum: Vec4| sum.truncate() / (sum.w * STEPS) + DARK;
    (mean(all) / mean(own)).clamp(Vec3::splat(1.0 / GAIN_MAX), Vec3::splat(GAIN_MAX))
}
