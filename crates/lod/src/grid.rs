//! A coarse picture of farthest depths, [`SIDE`] x [`SIDE`] (kanzok2015, section 3.2.1, has as many), and
//! the one question asked of it: whether all that an outline touches lies nearer than the outline does.

use crate::polygon::Polygon;
use crate::raster::Rows;
use crate::view::View;
use glam::DVec2;

/// Tiles on a side.
pub const SIDE: usize = 128;

/// What depths may be off by, as a share of them: they are kept as `f32`.
pub(crate) const ROUNDING: f64 = 1e-5;

/// Farthest eye depths of the tiles of a view's picture, row by row; infinite where something deeper
/// may show.
#[derive(Clone, Debug)]
pub struct DepthGrid {
    tiles_per_px: DVec2,
    size_px: DVec2,
    farthest: Vec<f32>,
}

impl DepthGrid {
    /// The grid of a view that hides nothing.
    pub fn new(view: &View) -> Self {
        let size_px = DVec2::new(f64::from(view.width), f64::from(view.height));
        Self {
            tiles_per_px: SIDE as f64 / size_px,
            size_px,
            farthest: vec![f32::INFINITY; SIDE * SIDE],
        }
    }

    /// Tiles that a pixel takes, horizontally and vertically.
    pub fn tiles_per_px(&self) -> DVec2 {
        self.tiles_per_px
    }

    /// The picture's width and height, pixels.
    pub fn size_px(&self) -> DVec2 {
        self.size_px
    }

    /// The farthest depth of each tile.
    pub fn farthest(&self) -> &[f32] {
        &self.farthest
    }

    /// The same, to be set.
    pub fn farthest_mut(&mut self) -> &mut [f32] {
        &mut self.farthest
    }

    /// Whether the tile at a place of the picture (pixels) is infinite or no nearer than `nearest`; false
    /// outside of the picture. Answers for most boxes in sight, of which one place is enough.
    pub(crate) fn shows_at(&self, px: DVec2, nearest: f64) -> bool {
        let tile = px * self.tiles_per_px;
        let is_on_picture =
            tile.cmpge(DVec2::ZERO).all() && tile.cmplt(DVec2::splat(SIDE as f64)).all();
        is_on_picture
            && f64::from(self.farthest[tile.y as usize * SIDE + tile.x as usize]) >= nearest
    }

    /// Whether what has this outline (pixels) and is no nearer than `nearest` lies behind all tiles that
    /// it touches. False for an outline that touches none.
    pub(crate) fn hides(&self, outline: &Polygon, nearest: f64) -> bool {
        let clipped = outline.clipped(DVec2::ZERO, self.size_px);
        let outline = clipped.as_ref().unwrap_or(outline);
        let nearest = (nearest * (1.0 - ROUNDING)) as f32;
        let mut rows = Rows::<SIDE>::new();
        rows.touch(outline.corners(), self.tiles_per_px);
        let mut any = false;
        for (row, tiles) in rows.touched() {
            any |= !tiles.is_empty();
            // Also where one of them is not a number.
            if !self.farthest[row * SIDE..][tiles].iter().all(|&f| f < nearest) {
                return false;
            }
        }
        any
    }
}
