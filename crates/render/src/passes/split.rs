//! Split (method *auto*): parts the points that won a pixel into surfaces, which the following
//! passes fill, and dots, which [`crate::passes::overlay`] draws over them. A point is a dot if its
//! neighbours are farther from it on the picture than the gap that a surface is drawn across. How
//! far that is depends on what is known of its shape: far with a normal, which tells where the
//! surface goes on; near for a point without a normal among points with normals, whose
//! neighbourhood is a line or a volume.
//!
//! A normal is evidence of a surface only where others agree with it: a few points of a crown or of
//! a facade that hardly a pulse hit lie in a plane by chance. So a point with a normal whose
//! neighbours are far on the picture is a surface only if enough points around it lie near its
//! plane and have its normal ([`SUPPORTERS`]). Those are looked for in a grid of cells, each with
//! its nearest point.

use crate::inputs::lookup::{Lookup, NO_NORMAL, normal_at, normal_code};
use crate::passes::project::{EMPTY, unpack};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Greatest distance of points of a surface on the picture, pixels: with a normal; without a normal
/// among points with normals; where no point has a normal.
pub(crate) const SURFACE_PX: [f32; 3] = [64.0, 6.0, 32.0];
/// Distance of points with a normal on the picture from which they need [`SUPPORTERS`], pixels.
pub(crate) const WIDE_PX: f32 = 8.0;
/// Side of a cell of the grid in which supporters are looked for, pixels: less than their distance,
/// since surfaces seen aslant have several in that.
pub(crate) const CELL_PX: usize = 4;
/// Points that make a surface of a point with a normal. An even sample has about 19 within
/// [`SUPPORT_REACH`], at an edge half of them. With four, walls of a single station open whose
/// points are much farther apart one way than the other (`crates/engine/tests/densities.rs`).
pub(crate) const SUPPORTERS: u32 = 3;
/// Distance up to which points support a surface, over the distance of neighbours.
pub(crate) const SUPPORT_REACH: f32 = 2.5;
/// Greatest distance of a supporter from the plane, over the distance of neighbours.
pub(crate) const SUPPORT_OFF: f32 = 0.4;
/// Least cosine between the normals of supporters.
pub(crate) const SUPPORT_COS: f32 = 0.8;
/// Pixels that are parted in one job.
const JOB: usize = 1 << 12;

/// Moves the points that are dots from `target`, whose rows have `width` pixels, to the frame
/// buffer `dots`, which gets the same size. Returns their number.
pub(crate) fn split(
    lookup: &Lookup<'_>,
    has_normals: bool,
    target: &[AtomicU64],
    width: usize,
    dots: &mut Vec<AtomicU64>,
) -> u64 {
    dots.resize_with(target.len(), || AtomicU64::new(EMPTY));
    let parts = target.par_chunks(JOB).zip(dots.par_chunks_mut(JOB)).enumerate();
    let parted = parts.map(|(job, (target, dots))| {
        let (mut count, mut wide) = (0, Vec::new());
        for (k, (value, dot)) in target.iter().zip(dots).enumerate() {
            let point = value.load(Relaxed);
            let part =
                if point == EMPTY { Part::Surface } else { part(lookup, has_normals, point) };
            *dot.get_mut() = EMPTY;
            match part {
                Part::Surface => {}
                Part::Wide(reach) => wide.push(Wide::new(lookup, job * JOB + k, point, reach)),
                Part::Dot => {
                    *dot.get_mut() = point;
                    value.store(EMPTY, Relaxed);
                    count += 1;
                }
            }
        }
        (count, wide)
    });
    let (counts, wide): (Vec<u64>, Vec<Vec<Wide>>) = parted.unzip();
    let wide: Vec<Wide> = wide.into_iter().flatten().collect();
    let grid = Grid::new(&wide, width, target.len() / width);
    let alone = wide.par_iter().filter(|own| !grid.supports(&wide, own));
    let moved = alone.map(|own| {
        dots[own.pixel].store(target[own.pixel].swap(EMPTY, Relaxed), Relaxed);
        1
    });
    counts.into_iter().sum::<u64>() + moved.sum::<u64>()
}

/// What a point is drawn as.
enum Part {
    Surface,
    /// A surface if others support it: it has a normal, and its neighbours are this far away,
    /// pixels.
    Wide(f32),
    Dot,
}

/// What the point of a pixel is drawn as.
fn part(lookup: &Lookup<'_>, has_normals: bool, value: u64) -> Part {
    let (depth, point) = unpack(value);
    let (draw, index) = lookup.list.find(point);
    let (offset, code) = lookup.draws[draw].positions.offset(index);
    let normals = lookup.frame.draws[draw].normal;
    let normal = || normals.and_then(|plane| normal_code(plane, index)).unwrap_or(NO_NORMAL);
    let apart = lookup.radius(draw, offset, code) * lookup.camera.focal_px;
    if !has_normals {
        return if apart > SURFACE_PX[2] * depth { Part::Dot } else { Part::Surface };
    }
    // Most points are dense, which is decided without their normals.
    if apart <= SURFACE_PX[1] * depth {
        return Part::Surface;
    }
    match normal() {
        NO_NORMAL => Part::Dot,
        _ if apart > SURFACE_PX[0] * depth => Part::Dot,
        _ if apart > WIDE_PX * depth => Part::Wide(apart / depth),
        _ => Part::Surface,
    }
}

/// A point with a normal whose neighbours are far on the picture.
struct Wide {
    pixel: usize,
    /// Bits of its depth.
    depth: u32,
    /// Distance of its neighbours, pixels and the file's unit.
    apart_px: f32,
    apart: f32,
    /// Position relative to the anchor, and normal, along the world's axes.
    place: Vec3,
    normal: Vec3,
}

impl Wide {
    fn new(lookup: &Lookup<'_>, pixel: usize, value: u64, apart_px: f32) -> Self {
        let (depth, point) = unpack(value);
        let (draw, index) = lookup.list.find(point);
        let (positions, place) = lookup.places(draw);
        let (offset, _) = positions.offset(index);
        let normals = lookup.frame.draws[draw].normal;
        Self {
            pixel,
            depth: depth.to_bits(),
            apart_px,
            apart: apart_px * depth / lookup.camera.focal_px,
            place: place.steps_from_anchor(offset) * lookup.camera.step,
            normal: normals.map_or(Vec3::ZERO, |plane| normal_at(plane, index)),
        }
    }

    /// Whether another point lies near this one's plane, within reach, and has its normal.
    fn is_supported_by(&self, other: &Self) -> bool {
        let from = other.place - self.place;
        let (reach, off) = (self.apart * SUPPORT_REACH, self.apart * SUPPORT_OFF);
        from.dot(from) <= reach * reach
            && self.normal.dot(from).abs() <= off
            && self.normal.dot(other.normal).abs() >= SUPPORT_COS
    }
}

/// Cells of [`CELL_PX`] pixels, each with the number of its nearest wide point.
struct Grid {
    columns: usize,
    rows: usize,
    width: usize,
    nearest: Vec<Option<u32>>,
}

impl Grid {
    fn new(wide: &[Wide], width: usize, height: usize) -> Self {
        let [columns, rows] = [width, height].map(|side| side.div_ceil(CELL_PX));
        let mut grid = Self { columns, rows, width, nearest: vec![None; columns * rows] };
        for (number, own) in (0..).zip(wide) {
            let [x, y] = grid.cell(own);
            let cell = &mut grid.nearest[y * columns + x];
            // Of equal depths the first pixel, as on a GPU.
            if cell.is_none_or(|before: u32| own.depth < wide[before as usize].depth) {
                *cell = Some(number);
            }
        }
        grid
    }

    fn cell(&self, own: &Wide) -> [usize; 2] {
        [own.pixel % self.width / CELL_PX, own.pixel / self.width / CELL_PX]
    }

    /// Whether enough points support a surface at `own`, of those that are nearest in their cells:
    /// [`SUPPORTERS`], or fewer by the share of the cells around that lie outside the picture.
    fn supports(&self, wide: &[Wide], own: &Wide) -> bool {
        let steps = (own.apart_px * SUPPORT_REACH / CELL_PX as f32) as usize + 1;
        let [x, y] = self.cell(own);
        let columns = x.saturating_sub(steps)..(x + steps + 1).min(self.columns);
        let rows = y.saturating_sub(steps)..(y + steps + 1).min(self.rows);
        let (inside, all) = (columns.len() * rows.len(), (2 * steps + 1) * (2 * steps + 1));
        let mut count = 0;
        for row in rows {
            for other in self.nearest[row * self.columns..][columns.clone()].iter().flatten() {
                let other = &wide[*other as usize];
                count += usize::from(other.pixel != own.pixel && own.is_supported_by(other));
            }
        }
        count * all >= SUPPORTERS as usize * inside
    }
}
