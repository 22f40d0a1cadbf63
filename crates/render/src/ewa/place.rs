//! From points to splats, eight at a time, sorted into tiles of the picture. Runs of points are placed in parallel; each
//! keeps its own splats, in the order of its points, and for each tile the list of those that touch it. A tile goes
//! through the runs in their order: the same sums, and so the same bits, for any number of threads.

use crate::ewa::clip::{Clipping, Lines, WIDER};
use crate::ewa::ellipses::Ellipses;
use crate::ewa::shape::{Codes, Shapes, WIDEST, shape_code};
use crate::ewa::splat::{Box4, Disc, Dye, Lens, Placed, across};
use crate::ewa::tiles::{RUN_POINTS, Run, Tiles};
use crate::frame::{ColourPlane, DrawNode, Frame};
use crate::inputs::camera::{Camera, NodePlace, Positions, SHIFT_MAX};
use crate::inputs::colour::{ColourBy, linear};
use crate::inputs::lookup::{DrawList, Lookup, NO_NORMAL, is_hidden, normal_code};
use crate::simd::values::{EIGHT, Values, WHOLE, bits, directions, dot, load, only};
use esker_points::Node;
use esker_points::quant::{HOT_POSITION_BYTES, RADIUS_AT};
use fearless_simd::{Bytes, Level, Simd, SimdMask, dispatch, f32x8, mask32x8, u32x8};
use glam::Vec3;
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
    /// The colour of all points of the node, where they have but one.
    only_tint: Option<[f32; 3]>,
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
            dispatch!(Level::new(), simd => match (self.has_normals, clips, shapes) {
                (true, true, true) => self.place_run::<_, true, true, true>(simd, draw, points, run),
                (true, true, false) => self.place_run::<_, true, true, false>(simd, draw, points, run),
                (true, false, true) => self.place_run::<_, true, false, true>(simd, draw, points, run),
                (true, false, false) => self.place_run::<_, true, false, false>(simd, draw, points, run),
                (false, ..) => self.place_run::<_, false, false, false>(simd, draw, points, run),
            });
            run.sort();
        });
    }

    #[inline(always)]
    fn place_run<S: Simd, const NORMALS: bool, const CLIPS: bool, const SHAPES: bool>(
        &self,
        simd: S,
        draw: usize,
        points: std::ops::Range<usize>,
        run: &mut Run,
    ) {
        let node = &self.frame.draws[draw];
        let positions = Positions::of(node);
        let place = self.camera.place(node.node, positions.is_exact());
        let mut block = Block::new();
        let radii = self.lookup.radii(draw).map(|radii| radii.map(|r| r * self.radius_factor));
        block.only_tint = self.lookup.only_colour(draw).map(|colour| colour.to_array());
        for start in points.clone().step_by(BLOCK) {
            (block.start, block.count) = (start, BLOCK.min(points.end - start));
            positions.offsets(start, &mut block.offsets);
            block.see(&place);
            let hot = node.position[start * HOT_POSITION_BYTES..].as_chunks().0;
            let codes = hot.iter().map(|hot: &[u8; HOT_POSITION_BYTES]| hot[RADIUS_AT]);
            for (k, code) in codes.take(block.count).enumerate() {
                block.radii[k] = match &radii {
                    Some(radii) => radii[usize::from(code)],
                    None => self.lookup.radius(draw, block.offset(k), code) * self.radius_factor,
                };
            }
            if self.frame.hides_points {
                for k in 0..block.count {
                    if is_hidden(node.position, start + k) {
                        block.radii[k] = f32::NAN;
                    }
                }
            }
            for first in (0..block.count).step_by(EIGHT) {
                self.place_eight::<_, NORMALS, CLIPS, SHAPES>(simd, draw, &block, first, run);
            }
        }
    }

    /// Places eight points of a block.
    #[inline(always)]
    fn place_eight<S: Simd, const NORMALS: bool, const CLIPS: bool, const SHAPES: bool>(
        &self,
        simd: S,
        draw: usize,
        block: &Block,
        first: usize,
        run: &mut Run,
    ) {
        let node = &self.frame.draws[draw];
        let step = self.camera.step;
        let [x, y, z] = &block.steps;
        let world = [
            eight(simd, x, first) * step.x,
            eight(simd, y, first) * step.y,
            eight(simd, z, first) * step.z,
        ];
        let centre = self.in_view(world);
        let mut radius = eight(simd, &block.radii, first);
        let reach = if SHAPES { radius * WIDEST } else { radius };
        let mut shows = bits(self.may_show(centre, reach));
        shows &= (1 << (block.count - first).min(EIGHT)) - 1;
        if shows == 0 {
            return;
        }
        let index = |k: usize| block.start + first + k;
        let zero = simd.splat_f32x8(0.0);
        let (mut normal, mut codes) = ([zero; 3], [0; EIGHT]);
        let mut facing = normal;
        if NORMALS {
            let (mut x, mut y) = ([0.0; EIGHT], [0.0; EIGHT]);
            for k in 0..EIGHT {
                let code = node.normal.and_then(|plane| normal_code(plane, index(k)));
                let [code_x, code_y] = code.unwrap_or(NO_NORMAL);
                (x[k], y[k]) = (f32::from(code_x), f32::from(code_y));
            }
            let world = unit(directions(load(simd, &x), load(simd, &y)));
            normal = self.in_view(world);
            let looks_away = zero.cmplt(dot(normal, centre));
            if self.frame.cull_back_faces {
                shows &= !bits(looks_away);
                if shows == 0 {
                    return;
                }
            }
            let mut towards = world;
            for c in &mut towards {
                *c = Values::select(looks_away, -*c, *c);
            }
            codes = packed(towards);
            facing = normal;
        }
        // Without a normal a splat faces the eye.
        let has_normal = zero.cmplt(dot(facing, facing));
        if !has_normal.all_true() {
            let to_eye = unit(centre);
            for (own, to_eye) in facing.iter_mut().zip(to_eye) {
                *own = Values::select(has_normal, *own, to_eye);
            }
        }
        let mut lines: [Option<Lines>; EIGHT] = [None; EIGHT];
        let mut factor = simd.splat_f32x8(self.radius_factor);
        if CLIPS {
            let (mut radii, mut factors) = (*radius, *factor);
            for (k, lines) in lines.iter_mut().enumerate().filter(|(k, _)| shows >> k & 1 == 1) {
                let (centre, normal) = (one_of(&centre, k), one_of(&normal, k));
                *lines = self.lines(node, index(k), block.offset(first + k), centre, normal);
                if lines.is_some() {
                    radii[k] *= WIDER;
                    factors[k] *= WIDER;
                }
            }
            (radius, factor) = (load(simd, &radii), load(simd, &factors));
        }
        // No loop, which went through memory.
        let [a, b] = across(facing);
        let mut tangents = [
            [a[0] * radius, a[1] * radius, a[2] * radius],
            [b[0] * radius, b[1] * radius, b[2] * radius],
        ];
        if SHAPES && let Some(plane) = node.tangents {
            let mut codes = [[0; 4]; EIGHT];
            for (k, code) in codes.iter_mut().enumerate() {
                *code = shape_code(plane, index(k));
            }
            let shapes = Shapes::of(simd, &codes, node.node.spacing, self.shapes);
            let along = self.in_view(shapes.along);
            tangents = shapes.tangents(along, facing, radius, factor, tangents);
        }
        if CLIPS {
            for (k, lines) in lines.iter_mut().enumerate() {
                let own = [centre, normal, tangents[0], tangents[1]].map(|v| one_of(&v, k));
                let offset = block.offset(first + k);
                *lines = lines.map(|lines| self.ended(lines, node, index(k), offset, own));
            }
        }
        let placed = Ellipses::new(&self.lens, run.columns(), centre, tangents, radius);
        shows &= placed.shows;
        let dye = |k: usize| {
            let depth = centre[2][k];
            let normal = if NORMALS {
                codes[k]
            } else {
                (radius[k] * self.lens.focal_px / depth.max(self.lens.near)).to_bits()
            };
            Dye { tint: self.tint(draw, index(k), block, first + k, depth), normal }
        };
        let mut drawn = shows & placed.drawn();
        let mut kept: [Option<Lines>; EIGHT] = [None; EIGHT];
        if CLIPS {
            for (k, kept) in kept.iter_mut().enumerate().filter(|(k, _)| lines[*k].is_some()) {
                match self.kept::<CLIPS>(lines[k].as_ref(), placed.bounds(k)) {
                    Some(own) => *kept = own,
                    None => drawn &= !(1 << k),
                }
            }
        }
        placed.write(drawn, run.room());
        let mut others = shows & !placed.drawn();
        while drawn != 0 {
            let k = drawn.trailing_zeros() as usize;
            drawn &= drawn - 1;
            match placed.part(k) {
                Some((tile, part)) if !CLIPS || kept[k].is_none() => {
                    run.take_single(dye(k), tile, part);
                }
                _ => run.take(dye(k), placed.bounds(k), kept[k]),
            }
        }
        while others != 0 {
            let k = others.trailing_zeros() as usize;
            others &= others - 1;
            if placed.ellipses >> k & 1 == 1 {
                run.dropped += 1;
                continue;
            }
            let tangents = [one_of(&tangents[0], k), one_of(&tangents[1], k)];
            let disc = Disc { centre: one_of(&centre, k), tangents, radius: radius[k] };
            match disc.by_rays(&self.lens) {
                Placed::Drawn(splat, bounds) => {
                    if let Some(kept) = self.kept::<CLIPS>(lines[k].as_ref(), bounds) {
                        run.room()[0] = splat;
                        run.take(dye(k), bounds, kept);
                    }
                }
                Placed::Dropped => run.dropped += 1,
                Placed::Outside => {}
            }
        }
    }

    /// What lines keep of a splat in a box; `None` where all of it lies beyond them.
    #[inline(always)]
    fn kept<const CLIPS: bool>(
        &self,
        lines: Option<&Lines>,
        bounds: Box4,
    ) -> Option<Option<Lines>> {
        match lines {
            Some(lines) if CLIPS => lines.within(bounds, self.camera.centre_px),
            _ => Some(None),
        }
    }

    /// Colour of a point, linear light.
    #[inline(always)]
    fn tint(&self, draw: usize, index: usize, block: &Block, k: usize, depth: f32) -> [f32; 3] {
        if let Some(only) = block.only_tint {
            return only;
        }
        // Most files have such colours.
        if let (ColourBy::Rgb, ColourPlane::Rgba(plane)) =
            (self.frame.colour, self.frame.draws[draw].colour)
            && let Some(b) = plane.get(index * 4..index * 4 + 4)
        {
            return linear([b[0], b[1], b[2]]).to_array();
        }
        self.lookup.colour(draw, index, block.offset(k), depth).to_array()
    }

    /// Directions of the world right, down and away from the eye.
    #[inline(always)]
    fn in_view<V: Values>(&self, world: [V; 3]) -> [V; 3] {
        let [right, up, back] = self.camera.view_from_world;
        [along(world, right), -along(world, up), -along(world, back)]
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
        clipping.lines(plane, index, hot(draw.node, offset), centre, normal)
    }

    /// The lines of a point of this centre, normal and tangents, ended where it is seen flat.
    fn ended(
        &self,
        lines: Lines,
        draw: &DrawNode<'_>,
        index: usize,
        offset: [u32; 3],
        own: [Vec3; 4],
    ) -> Lines {
        match (&self.clipping, draw.clip) {
            (Some(clipping), Some(plane)) => {
                clipping.ended(lines, plane, index, hot(draw.node, offset), own)
            }
            _ => lines,
        }
    }

    /// Whether balls touch the cone of what is in view. Generous by a pixel or so for the low-pass.
    #[inline(always)]
    fn may_show<S: Simd>(&self, centre: [f32x8<S>; 3], radius: f32x8<S>) -> mask32x8<S> {
        let half = self.lens.size * 0.5 + 4.0;
        let focal = self.lens.focal_px;
        let [x, y, depth] = centre;
        let is_before = depth.like(self.lens.near).cmple(depth + radius);
        is_before
            & (Values::abs(x) * focal - depth * half.x).cmple(radius * reach(focal, half.x))
            & (Values::abs(y) * focal - depth * half.y).cmple(radius * reach(focal, half.y))
    }
}

/// A point's place on the lattice without its dropped bits.
#[inline]
fn hot(node: &Node, offset: [u32; 3]) -> [u32; 3] {
    let shift = node.hot_shift.min(SHIFT_MAX);
    [0, 1, 2].map(|i| node.box_min[i].wrapping_add(offset[i] >> shift << shift))
}

/// How far a ball reaches past the picture's side, over its radius.
fn reach(focal: f32, half: f32) -> f32 {
    (focal * focal + half * half).sqrt()
}

/// Eight values of a block from `first` on.
#[inline(always)]
fn eight<S: Simd>(simd: S, values: &[f32; BLOCK], first: usize) -> f32x8<S> {
    let values = values[first % BLOCK..].first_chunk();
    load(simd, &values.copied().unwrap_or([f32::NAN; EIGHT]))
}

/// One of eight vectors.
#[inline(always)]
fn one_of<S: Simd>(vectors: &[f32x8<S>; 3], k: usize) -> Vec3 {
    Vec3::new(vectors[0][k], vectors[1][k], vectors[2][k])
}

/// Vectors along one.
#[inline(always)]
pub fn along<V: Values>(world: [V; 3], way: Vec3) -> V {
    let [x, y, z] = way.to_array();
    dot(world, [world[0].like(x), world[0].like(y), world[0].like(z)])
}

impl Block {
    fn new() -> Self {
        let (offsets, steps) = ([[0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        Self { start: 0, count: 0, offsets, steps, radii: [0.0; BLOCK], only_tint: None }
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
fn unit<V: Values>(v: [V; 3]) -> [V; 3] {
    let length = dot(v, v).sqrt();
    let has_length = length.like(0.0).cmplt(length);
    let [x, y, z] = v;
    [only(has_length, x / length), only(has_length, y / length), only(has_length, z / length)]
}

/// Greatest code of a normal's part: ten bits each, with a sign.
pub const PART_MAX: f32 = 511.0;

/// Parts of unit vectors, whose last bits are their codes.
#[inline(always)]
fn part<S: Simd>(c: f32x8<S>) -> [f32; EIGHT] {
    *(c * PART_MAX + 512.0 + WHOLE)
}

/// Unit vectors, or zeros, in 30 bits each: quick to take out again, which is done for every tile.
#[inline(always)]
fn packed<S: Simd>(n: [f32x8<S>; 3]) -> [u32; EIGHT] {
    let [x, y, z] = [part(n[0]), part(n[1]), part(n[2])];
    // No closures: they were calls.
    let mut codes = [0; EIGHT];
    for k in 0..EIGHT {
        let [x, y, z] = [x[k].to_bits() & 0x3ff, y[k].to_bits() & 0x3ff, z[k].to_bits() & 0x3ff];
        codes[k] = x | y << 10 | z << 20;
    }
    codes
}

/// The vector of [`packed`], times [`PART_MAX`]; each of its parts eight times.
#[inline(always)]
pub fn unpacked<S: Simd>(simd: S, code: u32) -> [f32x8<S>; 3] {
    let code = simd.splat_u32x8(code);
    // As floats that have no parts.
    let part =
        |bits: u32x8<S>| ((bits & 0x3ff) | WHOLE.to_bits()).bitcast::<f32x8<S>>() - (WHOLE + 512.0);
    [part(code), part(code >> 10), part(code >> 20)]
}
