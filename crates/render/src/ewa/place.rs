//! Pass `place` of EWA splatting (`zwicker2004`, sections 4 and 5): makes splats of points, eight
//! at a time, and sorts them into tiles of the picture. Runs of points, which are parts of nodes or
//! several nodes, are placed in parallel. Each run keeps its own splats, in the order of its
//! points, and for each tile the list of those that touch it. A tile goes through the runs in their
//! order, so that its sums have the same bits for any number of threads.

use crate::ewa::clip::{Clipping, EDGE_GROWTH, Lines, WIDER};
use crate::ewa::ellipses::Ellipses;
use crate::ewa::normals::{normals_or_to_eye, packed_towards_eye, unit};
use crate::ewa::shape::{ShapeTable, Shapes, WIDEST, shape_code};
use crate::ewa::splat::{
    BACK, Box4, Disc, Lens, Placement, SplatAttributes, across, widened_normal,
};
use crate::ewa::tiles::{RUN_POINTS, SplatRun, Tiles};
use crate::frame::{ColourPlane, DrawNode, Frame};
use crate::inputs::camera::{Camera, NodePlace, Positions, SHIFT_MAX};
use crate::inputs::colour::{ColourBy, linear};
use crate::inputs::lookup::{DrawList, Lookup, NO_NORMAL, is_hidden, normal_code};
use crate::passes::fit_planes::FittedPlanes;
use crate::passes::gather::DOT_RADIUS_PX;
use crate::passes::tangent::SLOPE_MAX;
use crate::simd::values::{EIGHT, Values, bits, directions, dot, load};
use esker_points::quant::{HOT_POSITION_BYTES, RADIUS_AT};
use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Number of runs that a small cloud is divided into, so that no thread waits long for the last run
/// of another one. Runs are not shorter than `RUN_POINTS_MIN`, since every tile goes through all
/// runs.
const RUNS: usize = 32;
const RUN_POINTS_MIN: usize = 1 << 12;
/// Points whose positions are computed together, by loops without branches.
const BLOCK: usize = 64;

/// Makes splats of the points of a frame.
pub struct Placer<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// Camera of the frame.
    pub camera: &'a Camera,
    /// Points to draw.
    pub list: &'a DrawList,
    /// Attributes of the points.
    pub lookup: &'a Lookup<'a>,
    /// Projection of splats.
    pub lens: Lens,
    /// Cutoff radius over the stored radius.
    pub radius_factor: f32,
    /// Whether the cloud has normals.
    pub has_normals: bool,
    /// Planes fitted to the picture, for clouds without normals.
    pub fitted: Option<&'a FittedPlanes>,
    /// Values of the codes of shapes.
    pub shapes: &'a ShapeTable,
    /// Computes clip lines, if splats are clipped.
    pub clipping: Option<Clipping<'a>>,
}

/// Divides the points of nodes with `lengths` points into runs: consecutive nodes, or parts of
/// them, so that the memory of runs does not depend on the number of nodes.
fn divide(lengths: &[usize]) -> Vec<Vec<(usize, Range<usize>)>> {
    let points = lengths.iter().sum::<usize>();
    let run_points = (points / RUNS).clamp(RUN_POINTS_MIN, RUN_POINTS);
    let mut runs: Vec<Vec<_>> = Vec::new();
    let mut room = 0;
    for (draw, &length) in lengths.iter().enumerate() {
        let mut first = 0;
        while first < length {
            if room == 0 {
                runs.push(Vec::new());
                room = run_points;
            }
            let part = first..length.min(first + room);
            (first, room) = (part.end, room - part.len());
            if let Some(run) = runs.last_mut() {
                run.push((draw, part));
            }
        }
    }
    runs
}

/// Up to [`BLOCK`] consecutive points of a node, one array an attribute.
struct PointBlock {
    /// Index of the first point in the node.
    start: usize,
    count: usize,
    /// Positions in the box of the node, steps.
    offsets: [[u32; BLOCK]; 3],
    /// Positions relative to the eye, steps.
    steps: [[f32; BLOCK]; 3],
    /// Cutoff radii; NaN hides a point.
    radii: [f32; BLOCK],
    /// Colour of all points of the node, if they have the same one.
    only_tint: Option<[f32; 3]>,
}

/// Eight points of a block.
#[derive(Clone, Copy)]
struct EightPoints<'a> {
    /// Index of the node in the frame.
    draw: usize,
    node: &'a DrawNode<'a>,
    block: &'a PointBlock,
    /// Index of the first point in the block.
    first: usize,
}

/// Eight discs or ellipses in space, right, down and depth from the eye.
struct EightDiscs<S: Simd> {
    centre: [f32x8<S>; 3],
    /// From the centre to the cutoff.
    tangents: [[f32x8<S>; 3]; 2],
    /// Cutoff radius.
    radius: f32x8<S>,
    /// World normals, turned to the eye ([`packed`]); unused for clouds without normals.
    normals: [u32; EIGHT],
    /// Clip lines.
    lines: [Option<Lines>; EIGHT],
}

impl Placer<'_> {
    /// Places all points in `runs`, whose memory is reused.
    pub fn place(&self, tiles: Tiles, runs: &mut Vec<SplatRun>) {
        let lengths: Vec<usize> = (0..self.frame.draws.len()).map(|d| self.list.len(d)).collect();
        let jobs = divide(&lengths);
        runs.resize_with(jobs.len(), SplatRun::default);
        runs.par_iter_mut().zip(jobs).for_each(|(run, parts)| {
            run.clear(tiles);
            for (draw, points) in parts {
                self.place_part(draw, points, run);
            }
            run.sort();
        });
    }

    /// Adds `points` of the node `draw` to a run.
    fn place_part(&self, draw: usize, points: Range<usize>, run: &mut SplatRun) {
        let node = &self.frame.draws[draw];
        let clips = self.clipping.is_some() && node.clip.is_some();
        let shapes = node.tangents.is_some();
        dispatch!(Level::new(), simd => match (self.has_normals, clips, shapes) {
            (true, true, true) => self.place_run::<_, true, true, true>(simd, draw, points, run),
            (true, true, false) => self.place_run::<_, true, true, false>(simd, draw, points, run),
            (true, false, true) => self.place_run::<_, true, false, true>(simd, draw, points, run),
            (true, false, false) => self.place_run::<_, true, false, false>(simd, draw, points, run),
            (false, ..) => self.place_run::<_, false, false, false>(simd, draw, points, run),
        });
    }

    /// [`Placer::place_part`] for nodes of one kind.
    #[inline(always)]
    fn place_run<S: Simd, const NORMALS: bool, const CLIPS: bool, const SHAPES: bool>(
        &self,
        simd: S,
        draw: usize,
        points: Range<usize>,
        run: &mut SplatRun,
    ) {
        let node = &self.frame.draws[draw];
        let positions = Positions::of(node);
        let place = self.camera.place(node.node, positions.is_exact());
        let mut block = PointBlock::new();
        let radii = self.lookup.radii(draw).map(|radii| radii.map(|r| r * self.radius_factor));
        block.only_tint = self.lookup.only_colour(draw).map(|colour| colour.to_array());
        for start in points.clone().step_by(BLOCK) {
            (block.start, block.count) = (start, BLOCK.min(points.end - start));
            positions.offsets(start, &mut block.offsets);
            block.subtract_anchor(&place);
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
                let points = EightPoints { draw, node, block: &block, first };
                self.place_eight::<_, NORMALS, CLIPS, SHAPES>(simd, &points, run);
            }
        }
    }

    /// Places eight points: computes their discs, projects them and stores those that are visible.
    #[inline(always)]
    fn place_eight<S: Simd, const NORMALS: bool, const CLIPS: bool, const SHAPES: bool>(
        &self,
        simd: S,
        points: &EightPoints<'_>,
        run: &mut SplatRun,
    ) {
        let from_anchor = self.centres(simd, points);
        let centre = self.camera.seen(self.in_view(from_anchor));
        let ahead = self.camera.to_anchor().to_array();
        let from_eye = [0, 1, 2].map(|axis| from_anchor[axis] + ahead[axis]);
        let mut radius = eight(simd, &points.block.radii, points.first);
        let reach = if SHAPES { radius * WIDEST } else { radius };
        let mut shows = bits(self.may_show(centre, reach));
        shows &= points.mask();
        if shows == 0 {
            return;
        }
        let zero = simd.splat_f32x8(0.0);
        let (mut normal, mut normals) = ([zero; 3], [0; EIGHT]);
        if NORMALS {
            let world = world_normals(simd, points);
            normal = self.in_view(world);
            if self.frame.cull_back_faces {
                shows &= !bits(zero.cmplt(dot(normal, centre)));
                if shows == 0 {
                    return;
                }
            }
            normals = packed_towards_eye(world, from_eye, self.frame.has_fronts);
            let is_dot = dot(normal, normal).cmpeq(zero);
            let most = centre[2] * (DOT_RADIUS_PX / self.lens.focal_px);
            radius = f32x8::select(is_dot, Values::min(radius, most), radius);
        }
        let mut growth = [zero; 2];
        if let Some(fitted) = self.fitted.filter(|_| !NORMALS) {
            growth = self.growth(simd, fitted, centre, radius, shows);
            normal = widened_normal(self.lens.focal_px, centre, growth);
        }
        let facing = normals_or_to_eye(simd, normal, centre);
        let mut lines: [Option<Lines>; EIGHT] = [None; EIGHT];
        let mut factor = simd.splat_f32x8(self.radius_factor);
        if CLIPS {
            let sizes = [radius, factor];
            (lines, [radius, factor]) =
                self.clip_lines(simd, points, shows, [centre, normal], sizes);
        }
        let tangents = self.tangents::<_, SHAPES>(simd, points, facing, radius, factor);
        if CLIPS {
            self.end_lines(points, &mut lines, [centre, normal, tangents[0], tangents[1]]);
        }
        let ellipses = Ellipses::new(&self.lens, run.columns(), centre, tangents, radius, growth);
        shows &= ellipses.shows;
        let discs = EightDiscs { centre, tangents, radius, normals, lines };
        let drawn = shows & ellipses.drawn();
        let others = shows & !ellipses.drawn();
        self.store_ellipses::<_, NORMALS, CLIPS>(points, &discs, &ellipses, drawn, run);
        self.store_by_rays::<_, NORMALS, CLIPS>(points, &discs, &ellipses, others, run);
    }

    /// Centres of eight discs in the world, relative to the anchor.
    #[inline(always)]
    fn centres<S: Simd>(&self, simd: S, points: &EightPoints<'_>) -> [f32x8<S>; 3] {
        let step = self.camera.step;
        let [x, y, z] = &points.block.steps;
        [
            eight(simd, x, points.first) * step.x,
            eight(simd, y, points.first) * step.y,
            eight(simd, z, points.first) * step.z,
        ]
    }

    /// Relative growth of depth per pixel to the right and downwards on the planes fitted around
    /// the points in `shows`, no steeper than [`SLOPE_MAX`]; zeros where there is no plane.
    #[inline(always)]
    fn growth<S: Simd>(
        &self,
        simd: S,
        fitted: &FittedPlanes,
        centre: [f32x8<S>; 3],
        radius: f32x8<S>,
        shows: u32,
    ) -> [f32x8<S>; 2] {
        let focal_px = self.lens.focal_px;
        let scale = centre[2].like(focal_px) / centre[2];
        let [x, y] = self.lens.placed([centre[0] * scale, centre[1] * scale]);
        let radius_px = radius * scale;
        let (mut right, mut down) = ([0.0; EIGHT], [0.0; EIGHT]);
        for k in (0..EIGHT).filter(|&k| shows >> k & 1 == 1) {
            let place = [x[k], y[k]];
            [right[k], down[k]] = fitted.of_splat(place, centre[2][k], radius[k], radius_px[k]);
        }
        let [right, down] = [load(simd, &right), load(simd, &down)];
        let steepness = (Values::abs(right) + Values::abs(down)) * (focal_px / SLOPE_MAX);
        let followed = right.like(1.0) / Values::max(steepness, right.like(1.0));
        [right * followed, down * followed]
    }

    /// Computes the clip lines of the points in `shows`, and multiplies `radius` and `factor` of
    /// splats with lines by [`WIDER`].
    #[inline(always)]
    fn clip_lines<S: Simd>(
        &self,
        simd: S,
        points: &EightPoints<'_>,
        shows: u32,
        [centre, normal]: [[f32x8<S>; 3]; 2],
        [radius, factor]: [f32x8<S>; 2],
    ) -> ([Option<Lines>; EIGHT], [f32x8<S>; 2]) {
        let mut lines: [Option<Lines>; EIGHT] = [None; EIGHT];
        let (mut radii, mut factors) = (*radius, *factor);
        for (k, lines) in lines.iter_mut().enumerate().filter(|(k, _)| shows >> k & 1 == 1) {
            let (centre, normal) = (one_of(&centre, k), one_of(&normal, k));
            *lines = self.lines(points, k, centre, normal);
            if lines.is_some() {
                radii[k] *= WIDER;
                factors[k] *= WIDER;
            }
        }
        (lines, [load(simd, &radii), load(simd, &factors)])
    }

    /// Tangents of eight discs across `facing`, or of ellipses where the file has their shapes.
    /// `factor` is the cutoff radius over the distance of points.
    #[inline(always)]
    fn tangents<S: Simd, const SHAPES: bool>(
        &self,
        simd: S,
        points: &EightPoints<'_>,
        facing: [f32x8<S>; 3],
        radius: f32x8<S>,
        factor: f32x8<S>,
    ) -> [[f32x8<S>; 3]; 2] {
        // Written out, since a loop would go through memory.
        let [a, b] = across(facing);
        let mut tangents = [
            [a[0] * radius, a[1] * radius, a[2] * radius],
            [b[0] * radius, b[1] * radius, b[2] * radius],
        ];
        if SHAPES && let Some(plane) = points.node.tangents {
            let mut codes = [[0; 4]; EIGHT];
            for (k, code) in codes.iter_mut().enumerate() {
                *code = shape_code(plane, points.index(k));
            }
            let shapes = Shapes::of(simd, &codes, points.node.node.spacing, self.shapes);
            let along = self.in_view(shapes.along);
            tangents = shapes.tangents(along, facing, radius, factor, tangents);
        }
        tangents
    }

    /// Adds the lines that end splats which are seen flat. `discs` are centres, normals and
    /// tangents.
    #[inline(always)]
    fn end_lines<S: Simd>(
        &self,
        points: &EightPoints<'_>,
        lines: &mut [Option<Lines>; EIGHT],
        discs: [[f32x8<S>; 3]; 4],
    ) {
        for (k, lines) in lines.iter_mut().enumerate() {
            let disc = discs.map(|v| one_of(&v, k));
            *lines = lines.map(|lines| self.ended(lines, points, k, disc));
        }
    }

    /// Stores the ellipses in `drawn`.
    #[inline(always)]
    fn store_ellipses<S: Simd, const NORMALS: bool, const CLIPS: bool>(
        &self,
        points: &EightPoints<'_>,
        discs: &EightDiscs<S>,
        ellipses: &Ellipses<S>,
        mut drawn: u32,
        run: &mut SplatRun,
    ) {
        let lines = &discs.lines;
        let mut kept: [Option<Lines>; EIGHT] = [None; EIGHT];
        if CLIPS {
            for (k, kept) in kept.iter_mut().enumerate().filter(|(k, _)| lines[*k].is_some()) {
                match self.lines_within::<_, CLIPS>(discs, k, ellipses.bounds(k)) {
                    Some(own) => *kept = own,
                    None => drawn &= !(1 << k),
                }
            }
        }
        ellipses.write(drawn, run.room());
        while drawn != 0 {
            let k = drawn.trailing_zeros() as usize;
            drawn &= drawn - 1;
            let attributes = self.attributes::<_, NORMALS>(points, discs, k);
            match ellipses.tile_rect(k) {
                Some((tile, rect)) if !CLIPS || kept[k].is_none() => {
                    run.push_single(attributes, tile, rect);
                }
                _ => run.push(attributes, ellipses.bounds(k), kept[k]),
            }
        }
    }

    /// Stores those of `others` that can be evaluated by rays, and counts the dropped ones.
    #[inline(always)]
    fn store_by_rays<S: Simd, const NORMALS: bool, const CLIPS: bool>(
        &self,
        points: &EightPoints<'_>,
        discs: &EightDiscs<S>,
        ellipses: &Ellipses<S>,
        mut others: u32,
        run: &mut SplatRun,
    ) {
        while others != 0 {
            let k = others.trailing_zeros() as usize;
            others &= others - 1;
            if ellipses.ellipses >> k & 1 == 1 {
                run.dropped += 1;
                continue;
            }
            let tangents = [one_of(&discs.tangents[0], k), one_of(&discs.tangents[1], k)];
            let centre = one_of(&discs.centre, k);
            let disc = Disc { centre, tangents, radius: discs.radius[k] };
            match disc.by_rays(&self.lens) {
                Placement::Drawn(splat, bounds) => {
                    if let Some(kept) = self.lines_within::<_, CLIPS>(discs, k, bounds) {
                        run.room()[0] = splat;
                        run.push(self.attributes::<_, NORMALS>(points, discs, k), bounds, kept);
                    }
                }
                Placement::Dropped => run.dropped += 1,
                Placement::Outside => {}
            }
        }
    }

    /// The lines of splat `k` that cut it or make it thin within these bounds ([`Lines::within`]);
    /// `None` if they leave nothing of it.
    #[inline(always)]
    fn lines_within<S: Simd, const CLIPS: bool>(
        &self,
        discs: &EightDiscs<S>,
        k: usize,
        bounds: Box4,
    ) -> Option<Option<Lines>> {
        let Some(lines) = discs.lines[k].filter(|_| CLIPS) else { return Some(None) };
        let thickness_px = self.lens.focal_px * discs.radius[k] / discs.centre[2][k];
        let margin_px = (thickness_px * BACK / EDGE_GROWTH).max(0.0);
        lines.within(bounds, self.camera.centre_px, margin_px)
    }

    /// Colour and normal of a splat, or its radius in clouds without normals.
    #[inline]
    fn attributes<S: Simd, const NORMALS: bool>(
        &self,
        points: &EightPoints<'_>,
        discs: &EightDiscs<S>,
        k: usize,
    ) -> SplatAttributes {
        let depth = discs.centre[2][k];
        let normal = if NORMALS {
            discs.normals[k]
        } else {
            (discs.radius[k] * self.lens.focal_px / depth.max(self.lens.near)).to_bits()
        };
        SplatAttributes { tint: self.tint(points, k, depth), normal }
    }

    /// Colour of a point, linear light.
    #[inline(always)]
    fn tint(&self, points: &EightPoints<'_>, k: usize, depth: f32) -> [f32; 3] {
        if let Some(only) = points.block.only_tint {
            return only;
        }
        let index = points.index(k);
        // The common case.
        if let (ColourBy::Rgb, ColourPlane::Rgba(plane)) = (self.frame.colour, points.node.colour)
            && let Some(b) = plane.get(index * 4..index * 4 + 4)
        {
            return linear([b[0], b[1], b[2]]).to_array();
        }
        self.lookup.colour(points.draw, index, points.offset(k), depth).to_array()
    }

    /// Directions of the world, as right, down and away from the eye.
    #[inline(always)]
    fn in_view<V: Values>(&self, world: [V; 3]) -> [V; 3] {
        let [right, up, back] = self.camera.view_from_world;
        [along(world, right), -along(world, up), -along(world, back)]
    }

    /// Clip lines of point `k`.
    fn lines(
        &self,
        points: &EightPoints<'_>,
        k: usize,
        centre: Vec3,
        normal: Vec3,
    ) -> Option<Lines> {
        let (clipping, plane) = (self.clipping.as_ref()?, points.node.clip?);
        clipping.lines(plane, points.index(k), points.hot(k), centre, normal)
    }

    /// Clip lines of point `k` with the line that ends a splat which is seen flat. `disc` is its
    /// centre, normal and tangents.
    fn ended(&self, lines: Lines, points: &EightPoints<'_>, k: usize, disc: [Vec3; 4]) -> Lines {
        match (&self.clipping, points.node.clip) {
            (Some(clipping), Some(plane)) => {
                clipping.ended(lines, plane, points.index(k), points.hot(k), disc)
            }
            _ => lines,
        }
    }

    /// Whether spheres touch the view frustum, which is a few pixels wider for the low-pass.
    #[inline(always)]
    fn may_show<S: Simd>(&self, centre: [f32x8<S>; 3], radius: f32x8<S>) -> mask32x8<S> {
        let Lens { focal_px, centre_px, size, near, .. } = self.lens;
        let [x, y, depth] = centre;
        let is_within = |at: f32x8<S>, side_px: f32| {
            (at * focal_px - depth * side_px).cmple(radius * reach(focal_px, side_px))
        };
        let (before, after) = (centre_px + 4.0, size - centre_px + 4.0);
        depth.like(near).cmple(depth + radius)
            & is_within(x, after.x)
            & is_within(-x, before.x)
            & is_within(y, after.y)
            & is_within(-y, before.y)
    }
}

impl EightPoints<'_> {
    /// Bit mask of the points that the block has.
    #[inline(always)]
    fn mask(&self) -> u32 {
        (1 << (self.block.count - self.first).min(EIGHT)) - 1
    }

    /// Index of point `k` in the node.
    #[inline(always)]
    fn index(&self, k: usize) -> usize {
        self.block.start + self.first + k
    }

    /// Position of point `k` in the box of the node, steps.
    #[inline(always)]
    fn offset(&self, k: usize) -> [u32; 3] {
        self.block.offset(self.first + k)
    }

    /// Position of point `k` on the lattice, without the bits that hot positions drop.
    #[inline]
    fn hot(&self, k: usize) -> [u32; 3] {
        let (node, offset) = (self.node.node, self.offset(k));
        let shift = node.hot_shift.min(SHIFT_MAX);
        [0, 1, 2].map(|i| node.box_min[i].wrapping_add(offset[i] >> shift << shift))
    }
}

/// Distance from a side plane of the frustum at which a sphere touches it, over its radius and in
/// the units of [`Placer::may_show`]. The plane is `side_px` from the centre of the picture.
fn reach(focal_px: f32, side_px: f32) -> f32 {
    (focal_px * focal_px + side_px * side_px).sqrt()
}

/// Loads eight values of a block from `first` on.
#[inline(always)]
fn eight<S: Simd>(simd: S, values: &[f32; BLOCK], first: usize) -> f32x8<S> {
    let values = values[first % BLOCK..].first_chunk();
    load(simd, &values.copied().unwrap_or([f32::NAN; EIGHT]))
}

/// Vector `k` of eight.
#[inline(always)]
fn one_of<S: Simd>(vectors: &[f32x8<S>; 3], k: usize) -> Vec3 {
    Vec3::new(vectors[0][k], vectors[1][k], vectors[2][k])
}

/// Components of vectors along `way`.
#[inline(always)]
pub fn along<V: Values>(world: [V; 3], way: Vec3) -> V {
    let [x, y, z] = way.to_array();
    dot(world, [world[0].like(x), world[0].like(y), world[0].like(z)])
}

impl PointBlock {
    fn new() -> Self {
        let (offsets, steps) = ([[0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        Self { start: 0, count: 0, offsets, steps, radii: [0.0; BLOCK], only_tint: None }
    }

    /// Position of point `k` in the box of the node, steps.
    #[inline(always)]
    fn offset(&self, k: usize) -> [u32; 3] {
        // Not by `map` over the arrays, which copies them.
        let k = k % BLOCK;
        [self.offsets[0][k], self.offsets[1][k], self.offsets[2][k]]
    }

    /// Computes the positions relative to the anchor.
    #[inline(always)]
    fn subtract_anchor(&mut self, place: &NodePlace) {
        for (axis, (steps, offsets)) in self.steps.iter_mut().zip(&self.offsets).enumerate() {
            for (step, &offset) in steps.iter_mut().zip(offsets) {
                *step = place.axis_steps(axis, offset);
            }
        }
    }
}

/// World normals of eight points, of unit length; zeros for points without normals.
#[inline(always)]
fn world_normals<S: Simd>(simd: S, points: &EightPoints<'_>) -> [f32x8<S>; 3] {
    let (mut x, mut y) = ([0.0; EIGHT], [0.0; EIGHT]);
    for k in 0..EIGHT {
        let code = points.node.normal.and_then(|plane| normal_code(plane, points.index(k)));
        let [code_x, code_y] = code.unwrap_or(NO_NORMAL);
        (x[k], y[k]) = (f32::from(code_x), f32::from(code_y));
    }
    unit(directions(load(simd, &x), load(simd, &y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All points, in order, in runs of the same size: a million nodes of few points make no more
    /// runs than one node does.
    #[test]
    fn runs_depend_on_points_and_not_on_nodes() {
        for lengths in [vec![3; 1 << 20], vec![3 << 20], vec![0, 70_000, 1, 0, 5], vec![], vec![0]]
        {
            let points = lengths.iter().sum::<usize>();
            let runs = divide(&lengths);
            assert!(runs.len() <= points.div_ceil(RUN_POINTS_MIN), "{} runs", runs.len());
            assert!(
                runs.iter().all(|run| run.iter().map(|p| p.1.len()).sum::<usize>() <= RUN_POINTS)
            );
            let mut ends = vec![0; lengths.len()];
            let mut last = 0;
            for (draw, part) in runs.into_iter().flatten() {
                assert!(draw >= last && part.start == ends[draw]);
                (last, ends[draw]) = (draw, part.end);
            }
            assert_eq!(ends, lengths);
        }
    }
}
