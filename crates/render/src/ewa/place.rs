//! From points to splats, four at a time, sorted into tiles of the picture. Runs of points are placed in parallel; each
//! keeps its own splats, in the order of its points, and for each tile the list of those that touch it. A tile goes
//! through the runs in their order: the same sums, and so the same bits, for any number of threads.

use super::clip::{Clipping, Lines, WIDER};
use super::real::dot;
use super::shape::{Codes, Shapes, WIDEST};
use super::splat::{Disc, Ellipses, Lens, Placed, across};
use super::tiles::{RUN_POINTS, Run, Tiles};
use crate::camera::{Camera, NodePlace, Positions, SHIFT_MAX};
use crate::colour::{ColourBy, linear};
use crate::frame::{ColourPlane, DrawNode, Frame};
use crate::gather::Lookup;
use crate::lanes::{LANES, Lane, Mask, directions, only};
use crate::project::{DrawList, NO_NORMAL, is_hidden, normal_code};
use esker_points::quant::{HOT_POSITION_BYTES, RADIUS_AT};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Runs that the points of a small cloud make, so that no thread waits long for another's last one; longer ones than
/// this, since every tile goes through all runs.
const RUNS: usize = 32;
const RUN_POINTS_MIN: usize = 1 << 12;
/// Points whose places are worked out at once: arithmetic without branches.
const BLOCK: usize = 64;

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
    /// What the codes of shapes stand for.
    pub shapes: &'a Codes,
    /// How splats are clipped, where they are.
    pub clipping: Option<Clipping<'a>>,
}

/// Points of a node one after another, attribute by attribute.
struct Block {
    /// The first one's place in the node.
    start: usize,
    count: usize,
    /// In the node's box, steps.
    offsets: [[u32; BLOCK]; 3],
    /// Against the eye, steps.
    steps: [[f32; BLOCK]; 3],
    /// Of the cutoff; what is no number is hidden.
    radii: [f32; BLOCK],
}

impl Placing<'_> {
    /// Places all points. `runs` are used again.
    pub fn place(&self, tiles: Tiles, runs: &mut Vec<Run>) {
        let draws = 0..self.frame.draws.len();
        let points = draws.clone().map(|d| self.list.len(d)).sum::<usize>();
        let run_points = (points / RUNS).clamp(RUN_POINTS_MIN, RUN_POINTS);
        let jobs: Vec<(usize, usize)> = draws
            .flat_map(|d| (0..self.list.len(d)).step_by(run_points).map(move |first| (d, first)))
            .collect();
        runs.resize_with(jobs.len(), Run::default);
        runs.par_iter_mut().zip(jobs).for_each(|(run, (draw, first))| {
            run.clear(tiles);
            let points = first..(first + run_points).min(self.list.len(draw));
            let clips = self.clipping.is_some() && self.frame.draws[draw].clip.is_some();
            let shapes = self.frame.draws[draw].tangents.is_some();
            match (self.has_normals, clips, shapes) {
                (true, true, true) => self.place_run::<true, true, true>(draw, points, run),
                (true, true, false) => self.place_run::<true, true, false>(draw, points, run),
                (true, false, true) => self.place_run::<true, false, true>(draw, points, run),
                (true, false, false) => self.place_run::<true, false, false>(draw, points, run),
                (false, ..) => self.place_run::<false, false, false>(draw, points, run),
            }
            run.sort();
        });
    }

    fn place_run<const NORMALS: bool, const CLIPS: bool, const SHAPES: bool>(
        &self,
        draw: usize,
        points: std::ops::Range<usize>,
        run: &mut Run,
    ) {
        let node = &self.frame.draws[draw];
        let positions = Positions::of(node);
        let place = self.camera.place(node.node, positions.is_exact());
        let mut block = Block::new();
        for start in points.clone().step_by(BLOCK) {
            (block.start, block.count) = (start, BLOCK.min(points.end - start));
            positions.offsets(start, &mut block.offsets);
            block.see(&place);
            for k in 0..block.count {
                let code = node.position[(start + k) * HOT_POSITION_BYTES + RADIUS_AT];
                let radius = self.lookup.radius(draw, block.offset(k), code);
                block.radii[k] = radius * self.radius_factor;
            }
            if self.frame.hides_points {
                for k in 0..block.count {
                    if is_hidden(node.position, start + k) {
                        block.radii[k] = f32::NAN;
                    }
                }
            }
            for first in (0..block.count).step_by(LANES) {
                self.place_four::<NORMALS, CLIPS, SHAPES>(draw, &block, first, run);
            }
        }
    }

    /// Places four points of a block.
    #[inline(always)]
    fn place_four<const NORMALS: bool, const CLIPS: bool, const SHAPES: bool>(
        &self,
        draw: usize,
        block: &Block,
        first: usize,
        run: &mut Run,
    ) {
        let node = &self.frame.draws[draw];
        let step = self.camera.step.to_array();
        let at = |axis: usize| Vec4::from_slice(&block.steps[axis][first..]) * step[axis];
        let centre = self.in_view([at(0), at(1), at(2)]);
        let mut radius = Vec4::from_slice(&block.radii[first..]);
        let reach = if SHAPES { radius * WIDEST } else { radius };
        let mut shows = self.may_show(centre, reach).bitmask();
        shows &= (1 << (block.count - first).min(LANES)) - 1;
        if shows == 0 {
            return;
        }
        let index = |k: usize| block.start + first + k;
        let (mut normal, mut codes) = ([Vec4::ZERO; 3], [0; LANES]);
        let mut facing = normal;
        if NORMALS {
            let mut stored = [NO_NORMAL; LANES];
            for (k, stored) in stored.iter_mut().enumerate() {
                let code = node.normal.and_then(|plane| normal_code(plane, index(k)));
                *stored = code.unwrap_or(NO_NORMAL);
            }
            let world = unit(directions(stored));
            normal = self.in_view(world);
            let looks_away = dot(normal, centre).cmpgt(Vec4::ZERO);
            if self.frame.cull_back_faces {
                shows &= !looks_away.bitmask();
                if shows == 0 {
                    return;
                }
            }
            let mut towards = world;
            for c in &mut towards {
                *c = Vec4::select(looks_away, -*c, *c);
            }
            codes = packed(towards);
            facing = normal;
        }
        // Without a normal a splat faces the eye.
        let has_normal = dot(facing, facing).cmpgt(Vec4::ZERO);
        if !has_normal.all() {
            let to_eye = unit(centre);
            let or_eye = |i: usize| Vec4::select(has_normal, facing[i], to_eye[i]);
            facing = [or_eye(0), or_eye(1), or_eye(2)];
        }
        let mut lines: [Option<Lines>; LANES] = [None; LANES];
        let mut factor = Vec4::splat(self.radius_factor);
        if CLIPS {
            for (k, lines) in lines.iter_mut().enumerate().filter(|(k, _)| shows >> k & 1 == 1) {
                let of = |v: [Lane; 3]| Vec3::new(v[0][k], v[1][k], v[2][k]);
                let offset = block.offset(first + k);
                *lines = self.lines(node, index(k), offset, of(centre), of(normal));
                if lines.is_some() {
                    radius[k] *= WIDER;
                    factor[k] *= WIDER;
                }
            }
        }
        let mut tangents = across(facing);
        for along in tangents.iter_mut().flatten() {
            *along *= radius;
        }
        if SHAPES && let Some(plane) = node.tangents {
            let codes = [0, 1, 2, 3].map(|k| Shapes::code(plane, index(k)));
            let shapes = self.shapes(codes, node.node.spacing);
            let along = self.in_view(shapes.along);
            tangents = shapes.tangents(along, facing, radius, factor, tangents);
        }
        let placed = Ellipses::new(&self.lens, centre, tangents, radius);
        shows &= placed.shows;
        let drawn = placed.drawn();
        while shows != 0 {
            let k = shows.trailing_zeros() as usize;
            shows &= shows - 1;
            let (mut splat, bounds) = if drawn >> k & 1 == 1 {
                placed.get(k)
            } else if placed.ellipses >> k & 1 == 1 {
                run.dropped += 1;
                continue;
            } else {
                let of = |v: [Lane; 3]| Vec3::new(v[0][k], v[1][k], v[2][k]);
                let disc =
                    Disc { centre: of(centre), tangents: tangents.map(of), radius: radius[k] };
                match disc.by_rays(&self.lens) {
                    Placed::Drawn(splat, bounds) => (splat, bounds),
                    Placed::Dropped => {
                        run.dropped += 1;
                        continue;
                    }
                    Placed::Outside => continue,
                }
            };
            let mut kept = None;
            if CLIPS && let Some(lines) = lines[k] {
                match lines.within(bounds, self.camera.centre_px) {
                    Some(lines) => kept = lines,
                    // All of it lies beyond its lines.
                    None => continue,
                }
            }
            let depth = centre[2][k];
            splat.tint = self.tint(draw, index(k), block, first + k, depth);
            splat.normal = if NORMALS {
                codes[k]
            } else {
                (radius[k] * self.lens.focal_px / depth.max(self.lens.near)).to_bits()
            };
            run.push(splat, bounds, kept);
        }
    }

    /// Colour of a point, linear light.
    #[inline(always)]
    fn tint(&self, draw: usize, index: usize, block: &Block, k: usize, depth: f32) -> [f32; 3] {
        // Most files have such colours.
        if let (ColourBy::Rgb, ColourPlane::Rgba(plane)) =
            (self.frame.colour, self.frame.draws[draw].colour)
            && let Some(b) = plane.get(index * 4..index * 4 + 4)
        {
            return linear([b[0], b[1], b[2]]).to_array();
        }
        self.lookup.colour(draw, index, block.offset(k), depth).to_array()
    }

    /// The shapes of codes, of points of a node of this spacing.
    #[inline(always)]
    fn shapes(&self, codes: [[u8; 4]; LANES], spacing: f32) -> Shapes {
        Shapes::of(codes, spacing, self.shapes)
    }

    /// Directions of the world right, down and away from the eye.
    #[inline(always)]
    fn in_view(&self, world: [Lane; 3]) -> [Lane; 3] {
        let along = |v: Vec3| world[0] * v.x + world[1] * v.y + world[2] * v.z;
        let [right, up, back] = self.camera.view_from_world;
        [along(right), -along(up), -along(back)]
    }

    /// The clip lines of a point.
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

    /// Whether balls touch the cone of what is in view. Generous by a pixel or so for the low-pass.
    #[inline(always)]
    fn may_show(&self, centre: [Lane; 3], radius: Lane) -> Mask {
        let half = self.lens.size * 0.5 + 4.0;
        let focal = self.lens.focal_px;
        let within = |at: Lane, half: f32| {
            let reach = radius * (focal * focal + half * half).sqrt();
            (at.abs() * focal - centre[2] * half).cmple(reach)
        };
        let is_before = (centre[2] + radius).cmpge(Vec4::splat(self.lens.near));
        is_before & within(centre[0], half.x) & within(centre[1], half.y)
    }
}

impl Block {
    fn new() -> Self {
        let (offsets, steps) = ([[0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        Self { start: 0, count: 0, offsets, steps, radii: [0.0; BLOCK] }
    }

    #[inline(always)]
    fn offset(&self, k: usize) -> [u32; 3] {
        // Not by `map` over the arrays, which copies them.
        let k = k % BLOCK;
        [self.offsets[0][k], self.offsets[1][k], self.offsets[2][k]]
    }

    /// Works out the places against the eye.
    #[inline(always)]
    fn see(&mut self, place: &NodePlace) {
        for (axis, (steps, offsets)) in self.steps.iter_mut().zip(&self.offsets).enumerate() {
            for (step, &offset) in steps.iter_mut().zip(offsets) {
                *step = place.axis_steps(axis, offset);
            }
        }
    }
}

/// The same of unit length; zero where there is none.
#[inline(always)]
fn unit(v: [Lane; 3]) -> [Lane; 3] {
    let length = dot(v, v).sqrt();
    let has_length = length.cmpgt(Vec4::ZERO);
    let [x, y, z] = v;
    [only(has_length, x / length), only(has_length, y / length), only(has_length, z / length)]
}

/// Greatest code of a normal's part: ten bits each, with a sign.
const PART_MAX: f32 = 511.0;

/// Parts of unit vectors, whose last bits are their codes: numbers this large have no parts, so that they are rounded.
#[inline(always)]
fn part(c: Lane) -> Lane {
    const WHOLE: f32 = 8_388_608.0;
    c * PART_MAX + 512.0 + WHOLE
}

/// Unit vectors, or zeros, in 30 bits each: quick to take out again, which is done for every tile.
#[inline(always)]
fn packed(n: [Lane; 3]) -> [u32; LANES] {
    let [x, y, z] = n;
    let (x, y, z) = (part(x).to_array(), part(y).to_array(), part(z).to_array());
    // No closures: they were calls.
    let mut codes = [0; LANES];
    for k in 0..LANES {
        let [x, y, z] = [x[k].to_bits() & 0x3ff, y[k].to_bits() & 0x3ff, z[k].to_bits() & 0x3ff];
        codes[k] = x | y << 10 | z << 20;
    }
    codes
}

/// The vector of [`packed`], of about unit length.
#[inline(always)]
pub fn unpacked(code: u32) -> Vec3 {
    let part = |shift: u32| (code >> shift & 0x3ff) as f32 - 512.0;
    Vec3::new(part(0), part(10), part(20)) * (1.0 / PART_MAX)
}
