//! Fits planes to surfaces without normals, from a frame buffer of depths, so that depths can be
//! moved along them ([`crate::passes::tangent`]) as along those of normals. Without planes, depth
//! intervals have to be long to meet on a slope, and a surface up to two radii behind another shows
//! through (`docs/design/surfaces.md`).
//!
//! Each square of 4 x 4 pixels keeps its nearest point, which is in the front surface. Of the
//! planes through that point and two of its neighbours, and the plane that faces the viewer, the
//! one with the least sum of distances to the eight neighbours is taken. The mean distance says how
//! far the plane is to be trusted: neighbours on a wall lie on its plane, those at an edge or in
//! leaves do not. The less a plane is trusted, the less it tilts and the longer the depth interval
//! is.
//!
//! For pull-push no plane is fitted to discs wider than a square: where points are that few, planes
//! would change with a single point of a hidden surface, or of a node that arrives. Splats have
//! their own depths, so that a plane only tilts those that lie on it: they also get planes of wider
//! squares, in which the nearest points of the narrow ones are joined.

use crate::passes::project::{EMPTY, unpack};
use crate::simd::values::{EIGHT, Values, load, only};
use fearless_simd::{Level as Simd, Simd as Token, dispatch};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Side of a square, pixels, and greatest radius of the discs that planes are fitted for.
pub const SQUARE_PX: usize = 4;
/// Length of the depth interval over the drawn radius where no plane is fitted: a disc of unknown
/// tilt reaches far back. With one, floors seen at a grazing angle break into steps.
pub const BARE_REACH: f32 = 2.0;
/// Greatest distance of a neighbour from a plane that counts, as a slope across the width of a
/// square.
pub(crate) const OFF_MAX: f32 = 1.0;
/// Most neighbours within the picture without a point: no plane is fitted to thin or ending
/// surfaces.
pub(crate) const MISSING_MAX: f32 = 1.0;
/// Levels of squares for splats, each of twice the width of the level before.
pub(crate) const LEVELS: usize = 6;
/// Least width of a square over the radius of a splat that gets its plane: so few squares of a
/// surface have no point.
pub(crate) const SIDE_MIN: f32 = 1.5;
/// Least width of such a square, pixels: across narrower ones, slopes are those of pixels that
/// points were rounded to.
pub(crate) const SIDE_MIN_PX: f32 = 8.0;
/// Least slope of planes of wider squares than a splat needs. They stand in for planes that cannot
/// be trusted because points were rounded to pixels, which counts on steep planes only.
pub(crate) const STEEP: f32 = 4.0;
/// Levels that are looked at for the plane of a splat, from the narrowest that is wide enough on.
pub(crate) const LEVELS_MAX: usize = 2;
/// Greatest distance along the line of sight, over its radius, of a splat from the plane that it
/// gets: others belong to another surface.
pub(crate) const OFF_PLANE_MAX: f32 = 3.0;
/// Least 1 / depth in the middle of a square over that of its nearest point, for splats.
pub(crate) const NEARER_MIN: f32 = 0.1;
/// Least area between two neighbours, over that of a square: no plane is fitted to points on a
/// line.
pub(crate) const AREA_MIN: f32 = 0.2;
/// Least improvement of the sum of distances by another plane, over the greatest distance that
/// counts: less is rounding.
pub(crate) const BETTER: f32 = 1e-3;
/// Marks squares outside the picture in `near`, which otherwise holds 1 / depth.
const OUTSIDE: f32 = -1.0;
/// Greatest relative difference of a neighbour's 1 / depth, so that all values stay finite.
pub(crate) const NEARER_MAX: f32 = 1e6;
/// Neighbours of a square: those at its sides, in a circle, then those at its corners.
const AROUND: [[isize; 2]; 8] =
    [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]];

/// How far planes are trusted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trust {
    /// Length of the depth interval across a plane on which all neighbours lie, over the drawn
    /// radius.
    pub(crate) reach: f32,
    /// Mean distances from a plane, over the greatest that counts, up to which it is trusted fully,
    /// and from which it is not trusted.
    pub(crate) distance: [f32; 2],
    /// Share of planes in tilts and intervals, 0 to 1.
    pub(crate) fitting: f32,
}

/// Trust where points lie apart. Intervals are shorter than a stored radius, since fitted planes
/// are rough.
pub(crate) const APART: Trust = Trust { reach: 0.8, distance: [0.2, 0.4], fitting: 1.0 };
/// Trust where points crowd. Colours are averages of all points in the interval there: short
/// intervals make scans flicker. Planes are trusted less than where points lie apart, or more
/// pixels depend on hidden nodes (`crates/engine/tests/occlusion.rs`).
pub(crate) const CROWDED: Trust = Trust { reach: BARE_REACH, distance: [0.18, 0.35], fitting: 1.0 };

/// Trust in a view of this crowding; planes take part by the share `fitting`.
fn trust(crowding: f32, fitting: f32) -> Trust {
    let mix = |apart: f32, crowded: f32| apart * (1.0 - crowding) + crowded * crowding;
    Trust {
        reach: mix(APART.reach, CROWDED.reach),
        distance: [0, 1].map(|i| mix(APART.distance[i], CROWDED.distance[i])),
        fitting,
    }
}

/// A plane fitted to a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedPlane {
    /// Relative growth of depth per pixel to the right and downwards: at the nearest point of the
    /// square, and for wide squares, which only splats use, in their middle.
    pub growth: [f32; 2],
    /// Length of the depth interval across the plane, over the drawn radius.
    pub reach: f32,
    /// 1 / depth of the plane in the middle of its square; zero without a plane.
    pub nearness: f32,
}

impl FittedPlane {
    /// Stands for a surface that no plane was fitted to.
    pub const NONE: Self = Self { growth: [0.0; 2], reach: BARE_REACH, nearness: 0.0 };
}

/// Planes fitted to a picture, level by level. Memory is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct FittedPlanes {
    focal_px: f32,
    levels: Vec<Squares>,
}

/// Planes of squares of one width. The arrays of squares have a border of one square that lies
/// outside the picture.
#[derive(Clone, Debug, Default)]
struct Squares {
    /// Width of a square, pixels.
    side: usize,
    width: usize,
    height: usize,
    /// Squares per row of the arrays.
    stride: usize,
    /// 1 / depth of the nearest point; zero if the square has none, [`OUTSIDE`] outside the
    /// picture.
    near: Vec<f32>,
    /// Pixel of the nearest point.
    x: Vec<f32>,
    y: Vec<f32>,
    /// Fitted planes row by row, without the border.
    fitted: Vec<FittedPlane>,
}

impl FittedPlanes {
    /// Fits a plane to each square of a frame buffer `width` pixels wide. `shares` are
    /// [`crate::FramePlan::crowding`], with which depth intervals stay long, and
    /// [`crate::FramePlan::fitting`]; `levels` is [`crate::FramePlan::plane_levels`].
    pub fn fill(
        &mut self,
        target: &[AtomicU64],
        width: usize,
        focal_px: f32,
        shares: [f32; 2],
        levels: usize,
    ) {
        let height = target.len() / width.max(1);
        self.focal_px = focal_px;
        self.levels.resize_with(levels, Squares::default);
        let trust = trust(shares[0], shares[1]);
        let Some((finest, coarser)) = self.levels.split_first_mut() else { return };
        finest.resize(SQUARE_PX, [width, height]);
        finest.collect_nearest(target, width, height);
        finest.fit(focal_px, trust);
        for (level, squares) in (1..).zip(coarser) {
            squares.resize(SQUARE_PX << level, [width, height]);
            squares.join_nearest(finest);
            squares.fit(focal_px, trust);
        }
    }

    /// The plane fitted around a pixel that shows a disc of radius `radius_px`.
    #[inline(always)]
    pub fn at(&self, x: usize, y: usize, radius_px: f32) -> FittedPlane {
        match self.levels.first() {
            Some(finest) if radius_px <= SQUARE_PX as f32 => finest.at(x, y),
            _ => FittedPlane::NONE,
        }
    }

    /// Relative growth of depth per pixel to the right and downwards on the plane of a splat at
    /// this place of the picture, whose radius is `radius_px` there and `radius` in space; zeros if
    /// it has none.
    #[inline]
    pub fn of_splat(&self, place: [f32; 2], depth: f32, radius: f32, radius_px: f32) -> [f32; 2] {
        let least = (radius_px * SIDE_MIN).max(SIDE_MIN_PX);
        let wide = self.levels.iter().filter(|squares| least <= squares.side as f32);
        let planes = wide.take(LEVELS_MAX).map(|squares| squares.near(place)).enumerate();
        // Differences of 1 / depth times the depth are differences of depth over it.
        let is_on = |near: f32| (near * depth - 1.0).abs() * depth <= radius * OFF_PLANE_MAX;
        let is_steep =
            |[right, down]: [f32; 2]| STEEP <= (right.abs() + down.abs()) * self.focal_px;
        let mut on = planes.filter(|&(wider, (growth, near))| {
            0.0 < near && is_on(near) && (wider == 0 || is_steep(growth))
        });
        on.next().map_or([0.0; 2], |(_, (growth, _))| growth)
    }
}

impl Squares {
    /// Makes room for squares of this width.
    fn resize(&mut self, side: usize, [width, height]: [usize; 2]) {
        self.side = side;
        (self.width, self.height) = (width.div_ceil(side), height.div_ceil(side));
        self.stride = self.width.next_multiple_of(EIGHT) + 2;
        let squares = self.stride * (self.height + 2);
        self.near.clear();
        self.near.resize(squares, OUTSIDE);
        self.x.resize(squares, 0.0);
        self.y.resize(squares, 0.0);
        self.fitted.resize(self.width * self.height, FittedPlane::NONE);
    }

    /// The plane fitted around a pixel.
    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> FittedPlane {
        self.fitted[y / self.side * self.width + x / self.side]
    }

    /// Rows of the arrays that hold squares of the picture.
    fn rows(&mut self) -> impl IndexedParallelIterator<Item = [&mut [f32]; 3]> {
        let Self { stride, height, near, x, y, .. } = self;
        let rows = |plane| <[f32]>::par_chunks_mut(plane, *stride).skip(1).take(*height);
        let planes = rows(near).zip(rows(x)).zip(rows(y));
        planes.map(|((near, x), y)| [near, x, y]).with_min_len(4)
    }

    /// Relative growth of depth on the plane around a place of the picture, and 1 / depth on it
    /// there, which is not positive without a plane.
    #[inline(always)]
    fn near(&self, place: [f32; 2]) -> ([f32; 2], f32) {
        // Squares at the border have few neighbours: the planes beside them are taken, also for
        // places beyond the border. `as` saturates, and turns NaN into 0.
        let side = self.side as f32;
        let square = |at: f32, count: usize| {
            let last = count.saturating_sub(2);
            ((at / side) as usize).max(1).min(last)
        };
        let (x, y) = (square(place[0], self.width), square(place[1], self.height));
        let FittedPlane { growth, nearness, .. } = self.fitted[y * self.width + x];
        let from = |at: f32, square: usize| at - (square as f32 + 0.5) * side;
        let [dx, dy] = [from(place[0], x), from(place[1], y)];
        let nearer = 1.0 - (growth[0] * dx + growth[1] * dy);
        (growth.map(|growth| growth / nearer), nearness * nearer)
    }

    /// Stores the nearest point of each square of a frame buffer.
    fn collect_nearest(&mut self, target: &[AtomicU64], width: usize, height: usize) {
        let (side, squares) = (self.side, self.width);
        self.rows().enumerate().for_each(|(row, [nears, xs, ys])| {
            nears[1..=squares].fill(0.0);
            for y in row * side..height.min((row + 1) * side) {
                for (square, run) in target[y * width..][..width].chunks(side).enumerate() {
                    let values = run.iter().map(|value| value.load(Relaxed)).enumerate();
                    let Some((k, value)) = values.min_by_key(|(_, value)| value >> 32) else {
                        continue;
                    };
                    let near = 1.0 / unpack(value).0;
                    if value != EMPTY && near > nears[square + 1] {
                        nears[square + 1] = near;
                        xs[square + 1] = (square * side + k) as f32;
                        ys[square + 1] = y as f32;
                    }
                }
            }
        });
    }

    /// Stores the nearest point of each square from those of the squares of the finest level.
    fn join_nearest(&mut self, finest: &Self) {
        let (joined, squares) = (self.side / finest.side, self.width);
        self.rows().enumerate().for_each(|(row, [nears, xs, ys])| {
            nears[1..=squares].fill(0.0);
            for y in row * joined..finest.height.min((row + 1) * joined) {
                let first = (y + 1) * finest.stride + 1;
                for x in 0..finest.width {
                    let (from, to) = (first + x, x / joined + 1);
                    if finest.near[from] > nears[to] {
                        nears[to] = finest.near[from];
                        (xs[to], ys[to]) = (finest.x[from], finest.y[from]);
                    }
                }
            }
        });
    }

    /// Fits the planes, in parallel by rows.
    fn fit(&mut self, focal_px: f32, trust: Trust) {
        let mut fitted = std::mem::take(&mut self.fitted);
        let rows = fitted.par_chunks_mut(self.width).enumerate().with_min_len(4);
        rows.for_each(|(row, fitted)| {
            dispatch!(Simd::new(), simd => self.fit_row(simd, focal_px, trust, row, fitted));
        });
        self.fitted = fitted;
    }

    #[inline(always)]
    fn fit_row<S: Token>(
        &self,
        simd: S,
        focal_px: f32,
        trust: Trust,
        row: usize,
        fitted: &mut [FittedPlane],
    ) {
        for (block, fitted) in fitted.chunks_mut(EIGHT).enumerate() {
            let middle = (row + 1) * self.stride + block * EIGHT + 1;
            let eight = |plane: &[f32], at: usize| match plane[at..].first_chunk() {
                Some(values) => load(simd, values),
                None => simd.splat_f32x8(OUTSIDE),
            };
            let near = eight(&self.near, middle);
            let zero = near.like(0.0);
            if !simd.any_true_mask32x8(zero.cmplt(near)) {
                fitted.fill(FittedPlane::NONE);
                continue;
            }
            let (x, y) = (eight(&self.x, middle), eight(&self.y, middle));
            let mut around = [Neighbour {
                x: zero,
                y: zero,
                nearer: zero,
                is_there: zero.cmplt(zero),
                is_missing: zero.cmplt(zero),
            }; 8];
            for (neighbour, [right, down]) in around.iter_mut().zip(AROUND) {
                let at = middle.wrapping_add_signed(down * self.stride as isize + right);
                let beside = eight(&self.near, at);
                *neighbour = Neighbour {
                    x: eight(&self.x, at) - x,
                    y: eight(&self.y, at) - y,
                    nearer: (beside / near - 1.0).min(near.like(NEARER_MAX)),
                    is_there: zero.cmplt(beside),
                    is_missing: beside.cmpeq(zero),
                };
            }
            let side = self.side as f32;
            let (growth, reach) = fit_plane(&around, side, focal_px, trust);
            let middle = [load(simd, &MIDDLES) + (block * EIGHT) as f32, zero + row as f32 + 0.5];
            let [dx, dy] = [middle[0] * side - x - 0.5, middle[1] * side - y - 0.5];
            let nearer = near.like(1.0) - (growth[0] * dx + growth[1] * dy);
            let is_tilted = zero.cmplt(Values::abs(growth[0]) + Values::abs(growth[1]));
            let nearness = only(is_tilted & near.like(NEARER_MIN).cmplt(nearer), near * nearer);
            // Depth grows by the same length, which is relative to the depth in the middle.
            let over = if self.side > SQUARE_PX { near.like(1.0) / nearer } else { near.like(1.0) };
            let growth = [growth[0] * over, growth[1] * over];
            let [right, down] = growth.map(<[f32; EIGHT]>::from);
            let (reach, nearness) = (<[f32; EIGHT]>::from(reach), <[f32; EIGHT]>::from(nearness));
            for (k, plane) in fitted.iter_mut().enumerate() {
                let (growth, reach, nearness) = ([right[k], down[k]], reach[k], nearness[k]);
                *plane = FittedPlane { growth, reach, nearness };
            }
        }
    }
}

/// Middles of eight squares in a row, in squares.
const MIDDLES: [f32; EIGHT] = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5];

/// The nearest point of a neighbouring square.
#[derive(Clone, Copy)]
struct Neighbour<V: Values> {
    /// Vector to it from the square's own point, pixels.
    x: V,
    y: V,
    /// 1 / depth there over that here, minus one: linear on a plane.
    nearer: V,
    /// Whether the neighbour has a point, and whether it is in the picture but has none.
    is_there: V::Mask,
    is_missing: V::Mask,
}

/// Relative growth of depth and reach of the plane that fits the neighbours of a point best.
#[inline(always)]
fn fit_plane<V: Values>(
    around: &[Neighbour<V>; 8],
    side_px: f32,
    focal_px: f32,
    trust: Trust,
) -> ([V; 2], V) {
    let zero = around[0].x.like(0.0);
    let most = zero.like(OFF_MAX * side_px / focal_px);
    let distance_sum = |right: V, down: V| {
        let mut sum = zero;
        for n in around {
            let distance = (right * n.x + down * n.y - n.nearer).abs().min(most);
            sum = sum + only(n.is_there, distance);
        }
        sum
    };
    let (mut right, mut down) = (zero, zero);
    let mut distance = distance_sum(zero, zero);
    for k in 0..4 {
        let (a, b) = (&around[k], &around[(k + 1) % 4]);
        let area = a.x * b.y - a.y * b.x;
        let over = zero.like(1.0) / area;
        let steeper =
            [(a.nearer * b.y - b.nearer * a.y) * over, (a.x * b.nearer - b.x * a.nearer) * over];
        let own = distance_sum(steeper[0], steeper[1]);
        let is_wide = zero.like(AREA_MIN * side_px * side_px).cmple(area.abs());
        let is_better = a.is_there & b.is_there & is_wide & (own + most * BETTER).cmplt(distance);
        right = V::select(is_better, steeper[0], right);
        down = V::select(is_better, steeper[1], down);
        distance = V::select(is_better, own, distance);
    }
    let (mut count, mut missing) = (zero, zero);
    for neighbour in around {
        count = count + only(neighbour.is_there, zero.like(1.0));
        missing = missing + only(neighbour.is_missing, zero.like(1.0));
    }
    let mean = distance / (count * most).max(zero.like(f32::MIN_POSITIVE));
    let [wholly, none] = trust.distance;
    let mistrust = ((mean - wholly) * (1.0 / (none - wholly))).max(zero).min(zero.like(1.0));
    let mistrust = mistrust * trust.fitting + (1.0 - trust.fitting);
    let reach = mistrust * (BARE_REACH - trust.reach) + trust.reach;
    let is_fitted = missing.cmple(zero.like(MISSING_MAX));
    let share = only(is_fitted, zero.like(1.0) - mistrust);
    ([-right * share, -down * share], V::select(is_fitted, reach, zero.like(BARE_REACH)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    const WIDTH: usize = 203;
    const HEIGHT: usize = 117;
    const FOCAL_PX: f32 = 150.0;

    /// A frame buffer in which `share` percent of the pixels have the depth that `depth` gives.
    fn target(share: u64, depth: impl Fn(usize, usize) -> f32) -> Vec<AtomicU64> {
        let mut state = 7u64;
        let all = (0..WIDTH * HEIGHT).map(|i| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let value = u64::from(depth(i % WIDTH, i / WIDTH).to_bits()) << 32 | i as u64;
            AtomicU64::new(if (state >> 33) % 100 < share { value } else { EMPTY })
        });
        all.collect()
    }

    fn fit(target: &[AtomicU64]) -> FittedPlanes {
        let mut fitted = FittedPlanes::default();
        // Fits another picture first: its planes must not remain.
        fitted.fill(
            &self::target(90, |x, y| (x + y + 1) as f32),
            WIDTH,
            FOCAL_PX,
            [1.0; 2],
            LEVELS,
        );
        fitted.fill(target, WIDTH, FOCAL_PX, [0.0, 1.0], LEVELS);
        fitted
    }

    /// Pixels that points won, at least `margin` from the border, with their depths.
    fn won(target: &[AtomicU64], margin: usize) -> impl Iterator<Item = (usize, usize, f32)> {
        let is_inside = move |x: usize, y: usize| {
            (margin..WIDTH - margin).contains(&x) && (margin..HEIGHT - margin).contains(&y)
        };
        let won = target.iter().enumerate().filter_map(|(i, value)| match value.load(Relaxed) {
            EMPTY => None,
            value => Some((i % WIDTH, i / WIDTH, unpack(value).0)),
        });
        won.filter(move |&(x, y, _)| is_inside(x, y))
    }

    #[test]
    fn planes_are_fitted_exactly_at_any_slope_and_trusted() {
        for [right, down] in [[0.0, 0.0], [1e-3, -2e-3], [-2e-3, 0.0], [3e-3, 3e-3]] {
            // 1 / depth is linear in the picture.
            let near =
                |x: usize, y: usize| 0.8 + right * (x as f64 - 100.0) + down * (y as f64 - 50.0);
            let target = target(40, |x, y| (1.0 / near(x, y)) as f32);
            let fitted = fit(&target);
            for radius_px in [1.0, 4.0] {
                let mut count = 0;
                for (x, y, _) in won(&target, 32) {
                    let plane = fitted.at(x, y, radius_px);
                    let fitted = &fitted.levels[0];
                    let at = (y / SQUARE_PX + 1) * fitted.stride + x / SQUARE_PX + 1;
                    let own = near(fitted.x[at] as usize, fitted.y[at] as usize);
                    let truth = [right, down].map(|steeper| (-steeper / own) as f32);
                    for (growth, truth) in plane.growth.into_iter().zip(truth) {
                        assert!(
                            (growth - truth).abs() < 2e-5,
                            "{plane:?}, {truth:?}, {radius_px} px"
                        );
                    }
                    assert!((plane.reach - APART.reach).abs() < 0.01, "{plane:?}");
                    count += 1;
                }
                assert!(count > 500);
            }
        }
    }

    #[test]
    fn splats_of_all_sizes_get_the_plane_that_they_lie_on() {
        let near = |x: f32, y: f32| 0.8 + 5e-4 * (x - 100.0) - 1e-3 * (y - 50.0);
        // Half of the points lie far behind the plane.
        let is_hidden = |x: usize, y: usize| (x + y).is_multiple_of(2);
        let target = target(40, |x, y| {
            let depth = 1.0 / near(x as f32 + 0.5, y as f32 + 0.5);
            if is_hidden(x, y) { depth * 3.0 } else { depth }
        });
        let fitted = fit(&target);
        for radius_px in [0.1, 3.0, 5.0, 8.0, 15.0, 40.0] {
            for (x, y, depth) in won(&target, 0) {
                let place = [x as f32 + 0.5, y as f32 + 0.5];
                let radius = radius_px * depth / FOCAL_PX;
                let growth = fitted.of_splat(place, depth, radius, radius_px);
                let truth = [-5e-4, 1e-3].map(|steeper| steeper / near(place[0], place[1]));
                let truth = if is_hidden(x, y) { [0.0; 2] } else { truth };
                let off = (0..2).map(|i| (growth[i] - truth[i]).abs()).fold(0.0, f32::max);
                assert!(off < 2e-5, "{radius_px} px: {growth:?} {truth:?} at {x}, {y}");
            }
        }
    }

    #[test]
    fn unrelated_depths_keep_long_intervals() {
        // Leaves: depths unrelated to each other.
        let leaves = target(60, |x, y| 1.0 + ((x * 7919 + y * 104_729) % 101) as f32 * 0.05);
        let fitted = fit(&leaves);
        let reaches: Vec<_> = won(&leaves, 8).map(|(x, y, _)| fitted.at(x, y, 2.0).reach).collect();
        let long = reaches.iter().filter(|reach| **reach > 1.6).count();
        assert!(long * 10 > reaches.len() * 9, "{long} of {}", reaches.len());
        // A single point, and discs wider than a square.
        let alone = target(100, |_, _| 1.0);
        alone.iter().enumerate().for_each(|(i, value)| {
            if i != 5 * WIDTH + 9 {
                value.store(EMPTY, Relaxed);
            }
        });
        assert_eq!(fit(&alone).at(9, 5, 2.0), FittedPlane::NONE);
        assert_eq!(fit(&leaves).at(9, 5, 4.1), FittedPlane::NONE);
        assert_eq!(fit(&leaves).at(9, 5, f32::NAN), FittedPlane::NONE);
    }

    #[test]
    fn the_plane_of_a_wall_beside_another_is_fitted_to_its_own_points() {
        let target = target(50, |x, _| if x < 100 { 1.0 } else { 1.4 });
        let fitted = fit(&target);
        for (x, y, _) in won(&target, 8) {
            let plane = fitted.at(x, y, 3.0);
            assert!(plane.growth.iter().all(|g| g.abs() < 1e-6), "{x}, {y}: {plane:?}");
        }
    }

    #[test]
    fn planes_are_finite_for_any_depths() {
        const DEPTHS: [f32; 6] = [1e-30, 1e30, 1.0, 1.0, 3e38, 1e-38];
        let target = target(70, |x, y| DEPTHS[(x * 31 + y * 17 + x * y) % 6]);
        let fitted = fit(&target);
        for (x, y, _) in won(&target, 0) {
            for radius_px in [0.0, 4.0, 20.0, 128.0, 1e30] {
                let FittedPlane { growth, reach, .. } = fitted.at(x, y, radius_px);
                assert!(growth.iter().all(|g| g.is_finite()), "{growth:?}");
                assert!((APART.reach..=BARE_REACH).contains(&reach), "{reach}");
            }
        }
    }
}
