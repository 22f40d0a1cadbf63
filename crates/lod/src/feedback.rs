//! Occlusion by the depth of the last finished frame, in coarse tiles. A box is projected to the
//! picture of that frame: it is hidden if all tiles around it are covered and nearer. Turning the
//! camera costs nothing, since a depth picture holds for all directions from its eye. Moving costs
//! some culling: the box's area in the old picture grows by the greatest parallax of anything
//! there, and nothing is hidden where neighbouring depths differ so much that a gap may have opened
//! between them.

use crate::grid::{DepthGrid, ROUNDING, SIDE};
use crate::occlusion::Occlusion;
use crate::oriented_box::OrientedBox;
use crate::polygon::Polygon;
use crate::project::{Projection, Silhouette};
use crate::view::View;
use glam::DVec2;
use std::sync::Arc;

/// Tiles on a side of the picture.
pub const TILES: usize = SIDE;

/// Distance that a box may be outside of the old picture by rounding alone, pixels.
const ROUNDING_PX: f64 = 1e-3;
/// Widest gap, in pixels of the old picture, that may open between two surfaces at different depths
/// before they no longer hide anything together.
const GAP_MAX_PX: f64 = 1.0;

/// The last tile, for clamping.
const LAST: DVec2 = DVec2::splat(SIDE as f64 - 1.0);
/// Greatest side of a rectangle, in tiles, that is tested tile by tile.
const DIRECT_TILES_MAX: u32 = 8;

/// Eye depths of a tile of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthTile {
    /// Least depth of its pixels; infinite if no pixel is covered.
    pub nearest: f32,
    /// Greatest depth of its pixels; infinite if any pixel is not covered.
    pub farthest: f32,
}

/// Reduces a depth picture (row by row, infinite where nothing is drawn) to [`TILES`] x [`TILES`]
/// tiles, row by row. A tile includes all pixels that it touches, so the picture may be smaller
/// than the grid.
pub fn tiles_of(depth: &[f32], width: usize, height: usize) -> Vec<DepthTile> {
    let nothing = DepthTile { nearest: f32::INFINITY, farthest: f32::INFINITY };
    let mut tiles = vec![nothing; TILES * TILES];
    if width == 0 || height == 0 || depth.len() / width < height {
        return tiles;
    }
    let pixels = |i: usize, side: usize| i * side / TILES..((i + 1) * side).div_ceil(TILES);
    for (i, tile) in tiles.iter_mut().enumerate() {
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        for y in pixels(i / TILES, height) {
            for &d in &depth[y * width..][pixels(i % TILES, width)] {
                // An invalid depth counts as not covered.
                let d = if d > 0.0 { d } else { f32::INFINITY };
                nearest = nearest.min(d);
                farthest = farthest.max(d);
            }
        }
        *tile = DepthTile { nearest, farthest };
    }
    tiles
}

/// Depths of one or more tiles.
#[derive(Clone, Copy, Debug)]
struct DepthRange {
    /// Least depth.
    nearest: f32,
    /// Greatest depth; infinite where something is not covered.
    farthest: f32,
    /// Greatest difference of the inverse depths of a tile and its neighbours: bounds how far
    /// adjacent pixels move apart when the eye moves.
    opening: f32,
}

impl DepthRange {
    const EMPTY: Self = Self { nearest: f32::INFINITY, farthest: 0.0, opening: 0.0 };

    /// The union of two ranges.
    fn join(self, other: Self) -> Self {
        Self {
            nearest: self.nearest.min(other.nearest),
            farthest: self.farthest.max(other.farthest),
            opening: self.opening.max(other.opening),
        }
    }
}

/// Depth of a finished frame, projected to the next view.
#[derive(Clone, Debug)]
pub struct DepthFeedback {
    /// View of that frame.
    old: Projection,
    grid: Arc<DepthGrid>,
    /// Depth ranges of the tiles, and of ever coarser ones.
    ranges: Arc<Vec<Vec<DepthRange>>>,
    /// Margin of its picture, pixels.
    margin_px: f64,
    /// View that boxes are tested for.
    new: Projection,
    /// Greatest motion in the old picture of anything at depth 1 between both views, pixels.
    parallax: f64,
}

impl DepthFeedback {
    /// Makes feedback of the view of a frame and its [`tiles_of`]; `None` if the number of tiles is
    /// wrong.
    pub fn new(view: &View, tiles: &[DepthTile]) -> Option<Self> {
        if tiles.len() != TILES * TILES {
            return None;
        }
        let mut grid = DepthGrid::new(view);
        let depths = tiles.iter().map(|t| t.farthest);
        grid.farthest_mut().iter_mut().zip(depths).for_each(|(to, depth)| *to = depth);
        let old = Projection::of(view);
        let ranges = Arc::new(ranges_of(tiles));
        let (grid, margin_px) = (Arc::new(grid), f64::from(view.margin_px));
        Some(Self { old, grid, ranges, margin_px, new: old, parallax: 0.0 })
    }

    /// Whether that frame was seen from the eye and direction of `view`.
    pub fn is_from(&self, view: &View) -> bool {
        self.old.is_from(view)
    }

    /// The same depths, used for the occlusion of a new view.
    pub fn seen_from(&self, view: &View) -> Self {
        let new = Projection::of(view);
        // A motion by m along the picture shifts by focal * m / depth; one along the view shifts by
        // up to the tangent of the widest angle times that.
        let corner = self.grid.size_px().length() * 0.5;
        let parallax = new.eye().distance(self.old.eye()) * (self.old.focal_px() + corner);
        Self { new, parallax, ..self.clone() }
    }

    /// Least depth of the tile at a position of the shown picture (0 to 1 from its top left corner,
    /// without the margin); `None` if the tile is empty.
    pub fn nearest_at(&self, place: DVec2) -> Option<f64> {
        let shown = self.grid.size_px() - 2.0 * self.margin_px;
        let at = place * shown + self.margin_px;
        let nearest = f64::from(self.range_within(at, at).nearest);
        (nearest > 0.0 && nearest.is_finite()).then_some(nearest)
    }

    /// Projects the part of a box on the new picture to the old one: the corners of its outline
    /// within the new picture, at its nearest and its farthest depth, with their depths in the old
    /// view.
    fn rest_in_old_picture(&self, seen: &Silhouette) -> impl Iterator<Item = (DVec2, f64)> {
        let outline = seen.clipped(DVec2::ZERO, self.new.size_px());
        let ends = [seen.nearest, seen.farthest];
        (0..2 * outline.corners().len()).map(move |i| {
            let corner = self.new.place(outline.corners()[i / 2], ends[i % 2]);
            (self.old.on_picture(corner), self.old.depth(corner))
        })
    }

    /// Whether the part of a box on the new picture is hidden, for a box that reaches beyond it.
    fn hides_rest(&self, b: &OrientedBox) -> bool {
        let Some(seen) = self.new.silhouette(b) else { return false };
        let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
        let mut nearest = f64::INFINITY;
        for (p, depth) in self.rest_in_old_picture(&seen) {
            let is_in_front = depth > self.old.near();
            if !is_in_front || !self.is_on_old_picture([p, p]) || self.grid.shows_at(p, depth) {
                return false;
            }
            bounds = [bounds[0].min(p), bounds[1].max(p)];
            nearest = nearest.min(depth);
        }
        if nearest == f64::INFINITY {
            // The box lies beyond a corner: no part of it is on the picture.
            return true;
        }
        let outline = || Polygon::hull_of(self.rest_in_old_picture(&seen).map(|(p, _)| p));
        self.hides_within(bounds, nearest, outline)
    }

    /// Whether bounds are on the old picture, up to rounding.
    fn is_on_old_picture(&self, [low, high]: [DVec2; 2]) -> bool {
        low.cmpge(DVec2::splat(-ROUNDING_PX)).all()
            && high.cmple(self.grid.size_px() + ROUNDING_PX).all()
    }

    /// Whether the tiles hide what lies behind `nearest` within `bounds` on the old picture and
    /// within `outline`, which is made only if the bounds do not decide.
    fn hides_within(
        &self,
        bounds: [DVec2; 2],
        nearest: f64,
        outline: impl FnOnce() -> Polygon,
    ) -> bool {
        if !self.is_on_old_picture(bounds) {
            return false;
        }
        if self.parallax > 0.0 {
            return self.hides_beside(bounds, nearest);
        }
        let farthest = self.range_within(bounds[0], bounds[1]).farthest;
        f64::from(farthest) < nearest * (1.0 - ROUNDING) || self.grid.hides(&outline(), nearest)
    }

    /// Whether the centre of a box is on the new picture and, on the old one, not behind its tile.
    fn shows_centre(&self, b: &OrientedBox, nearest: f64) -> bool {
        let size = self.new.size_px();
        let on = self.new.on_picture(b.centre);
        let is_on_new = self.new.depth(b.centre) > self.new.near()
            && on.cmpge(DVec2::ZERO).all()
            && on.cmple(size).all();
        is_on_new && self.grid.shows_at(self.old.on_picture(b.centre), nearest)
    }

    /// Whether the tiles around `low` to `high` hide what is behind `nearest` after the eye has
    /// moved.
    fn hides_beside(&self, [low, high]: [DVec2; 2], nearest: f64) -> bool {
        let mut reach = 0.0;
        // Near content moves farther, which makes a larger area relevant, which may have nearer
        // content.
        for _ in 0..4 {
            let (low, high) = (low - reach, high + reach);
            if !self.is_on_old_picture([low, high]) {
                return false;
            }
            let range = self.range_within(low, high);
            if f64::from(range.farthest) >= nearest * (1.0 - ROUNDING) {
                return false;
            }
            let needed = self.parallax * (1.0 / f64::from(range.nearest) - 1.0 / nearest);
            if needed <= reach {
                return self.parallax * f64::from(range.opening) <= GAP_MAX_PX;
            }
            // A little more than needed, so that the next round is mostly the last.
            reach = needed * 1.1;
        }
        false
    }

    /// Depth range of the tiles that a rectangle of the old picture touches, or of slightly more:
    /// large rectangles use coarser tiles.
    fn range_within(&self, low: DVec2, high: DVec2) -> DepthRange {
        let tile = |at: DVec2| (at * self.grid.tiles_per_px()).clamp(DVec2::ZERO, LAST).as_uvec2();
        let (low, high) = (tile(low), tile(high));
        let extent = (high - low).max_element();
        let level = (u32::BITS - (extent / DIRECT_TILES_MAX).leading_zeros()) as usize;
        let level = level.min(self.ranges.len() - 1);
        let side = SIDE >> level;
        let mut range = DepthRange::EMPTY;
        for y in low.y as usize >> level..=high.y as usize >> level {
            for x in low.x as usize >> level..=high.x as usize >> level {
                range = range.join(self.ranges[level][y * side + x]);
            }
        }
        range
    }
}

/// Depth ranges of the tiles, then of 2 x 2 of them, and so on to one for all.
fn ranges_of(tiles: &[DepthTile]) -> Vec<Vec<DepthRange>> {
    let range = |(i, tile): (usize, &DepthTile)| {
        let (x, y) = (i % TILES, i / TILES);
        let [rows, columns] = [y, x].map(|c| c.saturating_sub(1)..(c + 2).min(TILES));
        let (mut nearest, mut farthest) = (tile.nearest, tile.farthest);
        for tile in rows.flat_map(|y| &tiles[y * TILES..][columns.clone()]) {
            (nearest, farthest) = (nearest.min(tile.nearest), farthest.max(tile.farthest));
        }
        let opening = nearest.recip() - farthest.recip();
        // A tile that is not a number hides nothing.
        let farthest = if tile.farthest.is_nan() { f32::INFINITY } else { tile.farthest };
        DepthRange { nearest: tile.nearest, farthest, opening }
    };
    let mut levels = vec![tiles.iter().enumerate().map(range).collect::<Vec<_>>()];
    let mut side = SIDE;
    while side > 1 {
        let finer = &levels[levels.len() - 1];
        let coarser = (0..side * side / 4).map(|i| {
            let at = i / (side / 2) * 2 * side + i % (side / 2) * 2;
            let [a, b, c, d] = [at, at + 1, at + side, at + side + 1].map(|i| finer[i]);
            a.join(b).join(c.join(d))
        });
        let coarser = coarser.collect();
        levels.push(coarser);
        side /= 2;
    }
    levels
}

impl Occlusion for DepthFeedback {
    fn hides(&self, b: &OrientedBox) -> bool {
        let [nearest, _] = self.old.depths(b);
        if nearest <= self.old.near() || self.shows_centre(b, nearest) {
            return false;
        }
        let Some([low, high]) = self.new.bounds(b) else { return false };
        if !(low.cmpge(DVec2::ZERO).all() && high.cmple(self.new.size_px()).all()) {
            return self.hides_rest(b);
        }
        let outline = || self.old.silhouette(b).map_or_else(Polygon::default, |s| *s.polygon());
        self.old.bounds(b).is_some_and(|bounds| self.hides_within(bounds, nearest, outline))
    }
}
