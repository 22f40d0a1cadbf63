//! From points to splats, sorted into tiles of the picture. Runs of points are placed in parallel; each keeps
//! its own splats, in the order of its points, and for each tile the list of those that touch it. A tile goes
//! through the runs in their order: the same sums, and so the same bits, for any number of threads.

use super::clip::{Clipping, Lines, WIDER};
use super::splat::{Box4, Disc, Lens, Placed, Splat};
use crate::camera::{Camera, NodePlace, Positions, SHIFT_MAX};
use crate::frame::{DrawNode, Frame};
use crate::gather::Lookup;
use crate::project::{DrawList, is_hidden};
use glam::Vec3;
use rayon::prelude::*;

/// Pixels on a side of a tile: its sums stay in the nearest cache.
pub const TILE: usize = 32;
/// Points that a run has.
const RUN_POINTS: usize = 1 << 14;
/// Points whose places are worked out at once: arithmetic without branches.
const BLOCK: usize = 64;

/// Tiles of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tiles {
    /// Tiles in a row.
    pub columns: usize,
    /// Rows of tiles.
    pub rows: usize,
}

impl Tiles {
    /// Of a picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }
}

/// The splats of a run of points, by tiles.
#[derive(Debug, Default)]
pub struct Run {
    /// The splats, in the order of their points.
    pub splats: Vec<Splat>,
    boxes: Vec<Box4>,
    /// For each tile its first entry, and one past the last of all.
    starts: Vec<u32>,
    /// Splats by tile.
    entries: Vec<u32>,
    /// What of each splat is kept; empty where no splat of the run is clipped.
    lines: Vec<Lines>,
    /// Splats that could not be evaluated.
    pub dropped: u64,
}

impl Run {
    /// The splats that touch a tile, in their order.
    pub fn of_tile(&self, tile: usize) -> impl Iterator<Item = &Splat> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        self.entries[range].iter().map(|&i| &self.splats[i as usize])
    }

    /// The lines of these splats, in the same order; none where no splat of the run is clipped.
    pub fn lines_of_tile(&self, tile: usize) -> impl Iterator<Item = &Lines> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        self.entries[range].iter().map_while(|&i| self.lines.get(i as usize))
    }

    /// Whether splats of the run are clipped.
    pub fn clips(&self) -> bool {
        !self.lines.is_empty()
    }

    /// Adds what is kept of the newest splat.
    fn clip(&mut self, lines: Option<Lines>) {
        if lines.is_some() || self.clips() {
            self.lines.resize(self.splats.len() - 1, Lines::default());
            self.lines.push(lines.unwrap_or_default());
        }
    }

    fn clear(&mut self) {
        self.splats.clear();
        self.boxes.clear();
        self.lines.clear();
        self.dropped = 0;
    }

    /// Sorts the splats into tiles, by counting.
    fn sort(&mut self, tiles: Tiles) {
        let Self { boxes, starts, entries, .. } = self;
        starts.clear();
        starts.resize(tiles.columns * tiles.rows + 1, 0);
        let touched = |b: &Box4| {
            let [left, past_x, top, past_y] = b.map(usize::from);
            let (columns, rows) =
                (left / TILE..=(past_x - 1) / TILE, top / TILE..=(past_y - 1) / TILE);
            rows.flat_map(move |y| columns.clone().map(move |x| y * tiles.columns + x))
        };
        for b in boxes.iter() {
            touched(b).for_each(|tile| starts[tile] += 1);
        }
        // Ends of all tiles; filled from behind, they become their starts.
        let mut end = 0;
        for start in starts.iter_mut() {
            end += *start;
            *start = end;
        }
        entries.resize(end as usize, 0);
        for (i, b) in boxes.iter().enumerate().rev() {
            for tile in touched(b) {
                starts[tile] -= 1;
                entries[starts[tile] as usize] = i as u32;
            }
        }
    }
}

/// What points are made into splats with.
pub struct Placing<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// Its camera.
    pub camera: &'a Camera,
    /// Its points.
    pub list: &'a DrawList,
    /// Their attributes.
    pub lookup: &'a Lookup<'a>,
    /// The camera for splats.
    pub lens: Lens,
    /// Cutoff radii over stored ones.
    pub radius_factor: f32,
    /// Whether the cloud has normals.
    pub has_normals: bool,
    /// How splats are clipped, where they are.
    pub clipping: Option<Clipping<'a>>,
}

impl Placing<'_> {
    /// Places all points. `runs` are used again.
    pub fn place(&self, tiles: Tiles, runs: &mut Vec<Run>) {
        let jobs: Vec<(usize, usize)> = (0..self.frame.draws.len())
            .flat_map(|d| (0..self.list.len(d)).step_by(RUN_POINTS).map(move |first| (d, first)))
            .collect();
        runs.resize_with(jobs.len(), Run::default);
        runs.par_iter_mut().zip(jobs).for_each(|(run, (draw, first))| {
            run.clear();
            self.place_run(draw, first..(first + RUN_POINTS).min(self.list.len(draw)), run);
            run.sort(tiles);
        });
    }

    fn place_run(&self, draw: usize, points: std::ops::Range<usize>, run: &mut Run) {
        let node = &self.frame.draws[draw];
        let positions = Positions::of(node);
        let place = self.camera.place(node.node, positions.is_exact());
        let mut offsets = [[0; 3]; BLOCK];
        let mut codes = [0; BLOCK];
        for start in points.clone().step_by(BLOCK) {
            let count = BLOCK.min(points.end - start);
            for k in 0..count {
                (offsets[k], codes[k]) = positions.offset(start + k);
            }
            let centres = centres(self.camera, &place, &offsets);
            for k in 0..count {
                if self.frame.hides_points && is_hidden(node.position, start + k) {
                    continue;
                }
                let radius = self.lookup.radius(draw, offsets[k], codes[k]) * self.radius_factor;
                if !self.may_show(centres[k], radius) {
                    continue;
                }
                let Some((normal, code)) = self.normal(node, start + k, centres[k]) else {
                    continue;
                };
                let lines = self.lines(node, start + k, offsets[k], centres[k], normal);
                let radius = if lines.is_some() { radius * WIDER } else { radius };
                match Disc::round(centres[k], normal, radius).place(&self.lens) {
                    Placed::Drawn(mut splat, bounds) => {
                        let kept = lines.map(|l| l.within(bounds, self.camera.centre_px));
                        // All of it lies beyond its lines.
                        let Some(lines) = kept.unwrap_or(Some(None)) else { continue };
                        let depth = centres[k].z;
                        let tint = self.lookup.colour(draw, start + k, offsets[k], depth);
                        splat.tint = tint.to_array();
                        splat.normal = if self.has_normals {
                            code
                        } else {
                            (radius * self.lens.focal_px / depth.max(self.lens.near)).to_bits()
                        };
                        run.splats.push(splat);
                        run.boxes.push(bounds);
                        run.clip(lines);
                    }
                    Placed::Outside => {}
                    Placed::Dropped => run.dropped += 1,
                }
            }
        }
    }

    /// The clip lines of a point.
    #[inline(always)]
    fn lines(
        &self,
        draw: &DrawNode<'_>,
        index: usize,
        offset: [u32; 3],
        centre: Vec3,
        normal: Vec3,
    ) -> Option<Lines> {
        let (clipping, plane) = (self.clipping.as_ref()?, draw.clip?);
        let (node, shift) = (draw.node, draw.node.hot_shift.min(SHIFT_MAX));
        let hot = [0, 1, 2].map(|i| node.box_min[i].wrapping_add(offset[i] >> shift << shift));
        clipping.lines(plane, index, hot, centre, normal)
    }

    /// Whether a ball touches the cone of what is in view. Generous by a pixel or so for the low-pass.
    #[inline(always)]
    fn may_show(&self, centre: Vec3, radius: f32) -> bool {
        let half = self.lens.size * 0.5 + 4.0;
        let focal = self.lens.focal_px;
        let beyond = |at: f32, half: f32| {
            at.abs() * focal - half * centre.z <= radius * (focal * focal + half * half).sqrt()
        };
        centre.z + radius >= self.lens.near && beyond(centre.x, half.x) && beyond(centre.y, half.y)
    }

    /// A point's normal, right, down and away from the eye, turned to it; and its code. `None` where the point
    /// is a back face.
    #[inline(always)]
    fn normal(&self, node: &DrawNode<'_>, index: usize, centre: Vec3) -> Option<(Vec3, u32)> {
        let plane = node.normal.filter(|_| self.has_normals);
        let Some(bytes) = plane.and_then(|p| p.get(index * 4..index * 4 + 4)) else {
            return Some((Vec3::ZERO, packed(Vec3::ZERO)));
        };
        let code = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let code = [code as i16, (code >> 16) as i16];
        let world = Vec3::from_array(esker_points::quant::oct_decode(code));
        let view = self.camera.to_view(world);
        let view = Vec3::new(view.x, -view.y, -view.z);
        let looks_away = view.dot(centre) > 0.0;
        if looks_away && self.frame.cull_back_faces {
            return None;
        }
        Some((view, packed(if looks_away { -world } else { world })))
    }
}

/// Greatest code of a normal's part: ten bits each, with a sign.
const PART_MAX: f32 = 511.0;

/// A unit vector, or zero, in 30 bits: quick to take out again, which is done for every tile.
#[inline(always)]
pub fn packed(n: Vec3) -> u32 {
    let [x, y, z] = (n * PART_MAX + 512.5).to_array().map(|c| c as u32 & 0x3ff);
    x | y << 10 | z << 20
}

/// The vector of [`packed`], of about unit length.
#[inline(always)]
pub fn unpacked(code: u32) -> Vec3 {
    let part = |shift: u32| (code >> shift & 0x3ff) as f32 - 512.0;
    Vec3::new(part(0), part(10), part(20)) * (1.0 / PART_MAX)
}

/// Points right, down and away from the eye. Straight arithmetic over arrays: it becomes SIMD.
#[inline(always)]
fn centres(camera: &Camera, place: &NodePlace, offsets: &[[u32; 3]; BLOCK]) -> [Vec3; BLOCK] {
    let [right, up, back] = camera.view_from_world;
    let mut centres = [Vec3::ZERO; BLOCK];
    for (centre, offset) in centres.iter_mut().zip(offsets) {
        let p = place.steps_from_eye(*offset) * camera.step;
        *centre = Vec3::new(right.dot(p), -up.dot(p), -back.dot(p));
    }
    centres
}
