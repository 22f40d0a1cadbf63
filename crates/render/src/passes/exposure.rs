//! Exposure: removes differences of exposure between scans that cover the same surface. One point
//! wins a pixel, so that pixels of either scan are mixed at random where two scans overlap.
//! preiner2012, which kanzok2015 (section 3.2.4) follows for illumination, blends all splats of a
//! surface, and fine detail with them. Here a pixel is multiplied by the mean of its surroundings
//! over all scans divided by the mean over its own scan: scans meet in the middle, and the texture
//! stays as fine as it is.
//!
//! Surroundings are cells of the picture and of depth, nearly cubes (the bilateral grid of
//! chen2007), with a slot for each scan: nothing is compensated across an edge of depth. Sums are
//! of integer steps, so that the order of addition does not matter.

use crate::frame::ColourPlane;
use crate::passes::gather::Lookup;
use crate::passes::project::{EMPTY, unpack};
use crate::picture::pyramid::{Level, for_each_row};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Side of a cell, pixels. Smaller cells take texture for exposure, larger ones miss changes within
/// a scan.
pub(crate) const CELL_PX: usize = 32;
/// Bits of a depth below those that number its slice: eight slices double the depth, which is about
/// the width of a cell.
pub(crate) const SLICE_BITS: u32 = 20;
/// Number of slices: depths that differ by a factor of 16 share one.
pub(crate) const SLICES: usize = 32;
/// Slots of a cell: the first is for all scans, the others for one scan each, by its number modulo
/// their count.
pub(crate) const SLOTS: usize = 16;
/// Steps of a summand from 0 to 1: sums of a cell are integers that `f32` holds exactly.
pub(crate) const STEPS: f32 = 16_383.0;
/// Greatest factor of a colour, and its inverse the least: larger differences are not exposure.
pub(crate) const GAIN_MAX: f32 = 2.0;
/// Added to means before they are divided, so that nearly black colours get no gain.
pub(crate) const DARK: f32 = 1e-3;

/// Sums of the cells of a picture. Memory is kept from frame to frame.
#[derive(Debug, Default)]
pub struct ExposureGrid {
    /// Red, green, blue and the number of pixels; slot by slot, slice by slice, cell by cell.
    cells: Vec<Vec4>,
    /// Slot of the scan of each pixel.
    slots: Vec<u8>,
}

impl ExposureGrid {
    /// Compensates the exposure of the pixels of `base`, whose points are in `target`.
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
                let cell = &mut cells[slots_at(i % width / CELL_PX, slice)..][..SLOTS];
                let value = in_steps(base.tint[pixel].truncate());
                cell[0] += value;
                cell[usize::from(*slot)] += value;
            }
        });
        let (cells, slots) = (&self.cells, &self.slots);
        for_each_row(base, |row| {
            let (upper, down) = halfway(row.y);
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

/// Slot of the scan of the point that won a pixel.
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

/// Index of a cell's first slot in its row of cells.
fn slots_at(column: usize, slice: usize) -> usize {
    (column * SLICES + slice % SLICES) * SLOTS
}

/// Colour in integer steps, and a count of one pixel. NaN is 0.
fn in_steps(colour: Vec3) -> Vec4 {
    let steps = |c: f32| (c.clamp(0.0, 1.0) * STEPS + 0.5) as u32 as f32;
    Vec4::new(steps(colour.x), steps(colour.y), steps(colour.z), 1.0)
}

/// The two cells between whose centres a pixel is: one plus the index of the first, and the weight
/// of the second.
fn halfway(pixel: usize) -> (usize, f32) {
    let at = pixel + CELL_PX / 2;
    (at / CELL_PX, ((at % CELL_PX) as f32 + 0.5) / CELL_PX as f32)
}

/// Interpolated sums around a pixel: over all scans, and over the scan of `slot`. `rows` are the
/// rows of cells above and below, with their weights.
fn surroundings(
    rows: [(Option<&[Vec4]>, f32); 2],
    columns: usize,
    x: usize,
    depth: f32,
    slot: usize,
) -> [Vec4; 2] {
    const SLICE: u32 = 1 << SLICE_BITS;
    let (left, right) = halfway(x);
    // Interpolates as [`halfway`] does.
    let behind = depth.to_bits() + SLICE / 2;
    let deeper = (behind % SLICE) as f32 / SLICE as f32;
    let slices = (behind / SLICE) as usize;
    let [mut all, mut own] = [Vec4::ZERO; 2];
    for (row, share) in rows {
        let Some(row) = row else { continue };
        for (column, across) in [(left, 1.0 - right), (left + 1, right)] {
            let Some(column) = column.checked_sub(1).filter(|&c| c < columns) else { continue };
            for (slice, along) in [(slices.wrapping_sub(1), 1.0 - deeper), (slices, deeper)] {
                let cell = &row[slots_at(column, slice)..][..SLOTS];
                let share = share * across * along;
                all += cell[0] * share;
                own += cell[slot % SLOTS] * share;
            }
        }
    }
    [all, own]
}

/// Factor of a colour, from the sums over all scans and over its own.
fn gain([all, own]: [Vec4; 2]) -> Vec3 {
    let mean = |sum: Vec4| sum.truncate() / (sum.w * STEPS) + DARK;
    (mean(all) / mean(own)).clamp(Vec3::splat(1.0 / GAIN_MAX), Vec3::splat(GAIN_MAX))
}
