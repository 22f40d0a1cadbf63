//! Exposure: removes differences of exposure between scans of the same surface (`kanzok2015`,
//! section 3.2.4). Where two scans overlap, it is chance which scan a pixel shows. Blending all
//! splats of a surface (`preiner2012`) would blur texture. Here the colour of a pixel is multiplied
//! by the mean colour of all scans around it over the mean of its own scan: scans meet in the
//! middle, and texture stays sharp.
//!
//! Means are taken in cells of the picture and of depth, nearly cubes (a bilateral grid,
//! `chen2007`), with a slot for each scan, so nothing is equalised across an edge of depth. Sums
//! are whole numbers, so the order of adding does not matter.

use crate::frame::ColourPlane;
use crate::inputs::lookup::Lookup;
use crate::passes::project::{EMPTY, unpack};
use crate::picture::pyramid::{Level, for_each_row};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Side of a cell, pixels. Smaller cells take texture for exposure, larger ones miss changes within
/// a scan.
pub(crate) const CELL_PX: usize = 32;
/// Bits of a depth below those that number its slice: eight slices double the depth, so a slice is
/// about as deep as a cell is wide.
pub(crate) const SLICE_BITS: u32 = 20;
/// Slices per column of cells: depths that differ by a factor of 16, or a power of it, share one.
pub(crate) const SLICES: usize = 32;
/// Slots of a cell: the first for all scans, the others for one scan each, by its number modulo
/// theirs.
pub(crate) const SLOTS: usize = 16;
/// Steps that values from 0 to 1 are quantised to before they are summed: sums of a cell are whole
/// numbers that `f32` represents.
pub(crate) const STEPS: f32 = 16_383.0;
/// Greatest factor that colours are multiplied by, and inverse of the least: greater differences
/// are not due to exposure.
pub(crate) const GAIN_MAX: f32 = 2.0;
/// Added to means before they are divided, so that nearly black colours get no gain.
pub(crate) const DARK: f32 = 1e-3;

/// Sums for the cells of a picture. Memory is kept from frame to frame.
#[derive(Debug, Default)]
pub struct ExposureGrid {
    /// Red, green, blue and the number of pixels; slot by slot, slice by slice, cell by cell.
    cells: Vec<Vec4>,
    /// Slot of each pixel's scan.
    slots: Vec<u8>,
}

impl ExposureGrid {
    /// Equalises the exposure of the pixels of `base`, whose points are those of the frame buffer
    /// `target`.
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

/// Index of the first slot of a cell in its row of cells.
fn slots_index(column: usize, slice: usize) -> usize {
    (column * SLICES + slice % SLICES) * SLOTS
}

/// A colour quantised to whole steps, and a count of one pixel. NaN becomes 0.
fn quantised(colour: Vec3) -> Vec4 {
    let steps = |c: f32| (c.clamp(0.0, 1.0) * STEPS + 0.5) as u32 as f32;
    Vec4::new(steps(colour.x), steps(colour.y), steps(colour.z), 1.0)
}

/// The two neighbouring cells between whose centres a pixel lies: the number of the first plus one,
/// and the share of the second.
fn between_cells(pixel: usize) -> (usize, f32) {
    let at = pixel + CELL_PX / 2;
    (at / CELL_PX, ((at % CELL_PX) as f32 + 0.5) / CELL_PX as f32)
}

/// Interpolated sums around a pixel: over all scans, and over the scan of `slot`. `rows` are the
/// rows of cells above and below with their shares.
fn surroundings(
    rows: [(Option<&[Vec4]>, f32); 2],
    columns: usize,
    x: usize,
    depth: f32,
    slot: usize,
) -> [Vec4; 2] {
    const SLICE: u32 = 1 << SLICE_BITS;
    let (left, right) = between_cells(x);
    // Half a slice further, as `between_cells` does in the picture.
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

/// Factor for a colour, from the sums over all scans and over its own.
fn gain([all, own]: [Vec4; 2]) -> Vec3 {
    let mean = |sum: Vec4| sum.truncate() / (sum.w * STEPS) + DARK;
    (mean(all) / mean(own)).clamp(Vec3::splat(1.0 / GAIN_MAX), Vec3::splat(GAIN_MAX))
}
