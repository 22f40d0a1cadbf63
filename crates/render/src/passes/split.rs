//! Split (method *auto*): parts the points that won a pixel into surfaces, which the following
//! passes fill, and dots, which [`crate::passes::overlay`] draws over them. A point is a dot if its
//! neighbours are farther from it on the picture than the gap that a surface is drawn across. How
//! far that is depends on what is known of its shape: far with a normal, which tells where the
//! surface goes on; near for a point without a normal among points with normals, whose
//! neighbourhood is a line or a volume.

use crate::inputs::lookup::{Lookup, NO_NORMAL, normal_code};
use crate::passes::project::{EMPTY, unpack};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Greatest distance of points of a surface on the picture, pixels: with a normal; without a normal
/// among points with normals; where no point has a normal.
pub(crate) const SURFACE_PX: [f32; 3] = [64.0, 6.0, 32.0];
/// Pixels that are parted in one job.
const JOB: usize = 1 << 12;

/// Moves the points that are dots from `target` to the frame buffer `dots`, which gets the same
/// size. Returns their number.
pub(crate) fn split(
    lookup: &Lookup<'_>,
    has_normals: bool,
    target: &[AtomicU64],
    dots: &mut Vec<AtomicU64>,
) -> u64 {
    dots.resize_with(target.len(), || AtomicU64::new(EMPTY));
    let parts = target.par_chunks(JOB).zip(dots.par_chunks_mut(JOB));
    let moved = parts.map(|(target, dots)| {
        let mut count = 0;
        for (value, dot) in target.iter().zip(dots) {
            let point = value.load(Relaxed);
            let is_dot = point != EMPTY && is_dot(lookup, has_normals, point);
            *dot.get_mut() = if is_dot { point } else { EMPTY };
            if is_dot {
                value.store(EMPTY, Relaxed);
                count += 1;
            }
        }
        count
    });
    moved.sum()
}

/// Whether the point of a pixel is drawn as a dot.
fn is_dot(lookup: &Lookup<'_>, has_normals: bool, value: u64) -> bool {
    let (depth, point) = unpack(value);
    let (draw, index) = lookup.list.find(point);
    let (offset, code) = lookup.draws[draw].positions.offset(index);
    let normals = lookup.frame.draws[draw].normal;
    let normal = || normals.and_then(|plane| normal_code(plane, index)).unwrap_or(NO_NORMAL);
    let most = match has_normals {
        false => SURFACE_PX[2],
        true if normal() == NO_NORMAL => SURFACE_PX[1],
        true => SURFACE_PX[0],
    };
    lookup.radius(draw, offset, code) * lookup.camera.focal_px > most * depth
}
