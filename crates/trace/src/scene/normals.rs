//! Normals for splats without one: that of the nearest splat around that has one. A disc without a
//! normal faces each ray, so that it stands out of its surface where that is seen or lit from the
//! side. In: splats. Out: the same ones, few or none without a normal.

use crate::scene::splats::is_fine;
use esker_render::Splat;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};

/// Distance in drawn radii of a splat whose normal is taken: beyond, it may be of another surface.
const REACH: f32 = 2.0;
/// Clouds in which more than one splat in this many has no normal keep them as they are: so many
/// are no exceptions, such as vertices of a mesh that no triangle uses.
const SHARE: usize = 16;
/// Splats of a task.
const TASK: usize = 1 << 14;
/// Cells of a level are cubes with sides of 2 to its power.
const LEVELS: [f32; 2] = [-64.0, 64.0];

/// A cube, by its level and its place.
type Cell = (i32, [i32; 3]);
/// Squared distance and index of a splat.
type Near = (f32, u32);

/// Gives the splats without a normal that of the nearest splat with one.
pub fn adopt_normals(splats: &mut [Splat]) {
    let lacks = |splat: &Splat| splat.normal == [0.0; 3] && is_fine(splat);
    let indices = 0..u32::try_from(splats.len()).unwrap_or(u32::MAX);
    let lacking: Vec<u32> =
        indices.into_par_iter().filter(|&i| lacks(&splats[i as usize])).collect();
    if lacking.is_empty() || lacking.len() > splats.len() / SHARE {
        return;
    }
    let (cells, levels) = cells_around(splats, &lacking);
    let none = || vec![(f32::INFINITY, u32::MAX); lacking.len()];
    let search = |mut nearest: Vec<Near>, (chunk, part): (usize, &[Splat])| {
        for (k, splat) in part.iter().enumerate() {
            if splat.normal == [0.0; 3] || !is_fine(splat) {
                continue;
            }
            let index = (chunk * TASK + k) as u32;
            for level in &levels {
                for &number in cells.get(&cell_of(splat, *level)).into_iter().flatten() {
                    let to = &splats[lacking[number as usize] as usize];
                    let off = Vec3::from_array(splat.centre).distance_squared(to.centre.into());
                    let own = &mut nearest[number as usize];
                    if off < (REACH * to.radius).powi(2) && (off, index) < *own {
                        *own = (off, index);
                    }
                }
            }
        }
        nearest
    };
    let nearer = |mut a: Vec<Near>, b: Vec<Near>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a = if b < *a { b } else { *a });
        a
    };
    let nearest = splats.par_chunks(TASK).enumerate().fold(none, search).reduce(none, nearer);
    for (index, (_, found)) in lacking.into_iter().zip(nearest) {
        if let Some(found) = splats.get(found as usize) {
            splats[index as usize].normal = found.normal;
        }
    }
}

/// The splats that lack a normal, by their numbers, in each cell within their reach; and the levels
/// of these cells.
fn cells_around(splats: &[Splat], lacking: &[u32]) -> (HashMap<Cell, Vec<u32>>, BTreeSet<i32>) {
    let (mut cells, mut levels) = (HashMap::<Cell, Vec<u32>>::new(), BTreeSet::new());
    for (number, &index) in (0..).zip(lacking) {
        let splat = &splats[index as usize];
        let level = (REACH * splat.radius).log2().ceil().clamp(LEVELS[0], LEVELS[1]) as i32;
        let (_, [x, y, z]) = cell_of(splat, level);
        levels.insert(level);
        for k in 0..27 {
            let beside = |at: i32, step: i32| at.saturating_add(step % 3 - 1);
            let cell = (level, [beside(x, k), beside(y, k / 3), beside(z, k / 9)]);
            cells.entry(cell).or_default().push(number);
        }
    }
    (cells, levels)
}

fn cell_of(splat: &Splat, level: i32) -> Cell {
    let side = (level as f32).exp2();
    (level, splat.centre.map(|at| (at / side).floor() as i32))
}
