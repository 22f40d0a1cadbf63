//! Coarse grid of the farthest depths of a picture, [`SIDE`] x [`SIDE`] as in kanzok2015, section
//! 3.2.1, and its test: whether everything that an outline touches is nearer than the outlined box.

use crate::polygon::Polygon;
use crate::raster::Rows;
use crate::view::View;
use glam::DVec2;

/// Tiles on a side.
pub(crate) const SIDE: usize = 128;

/// Relative error of depths: they are stored as `f32`.
pub(crate) const ROUNDING: f64 = 1e-5;

/// Greatest eye depths of the tiles of a view's picture, row by row; infinite where something
/// deeper may be visible.
#[derive(Clone, Debug)]
pub(crate) struct DepthGrid {
    tiles_per_px: DVec2,
    size_px: DVec2,
    farthest: Vec<f32>,
}

impl DepthGrid {
    /// A grid for a view, which hides nothing.
    pub(crate) fn new(view: &View) -> Self {
        let size_px = DVec2::new(f64::from(view.width), f64::from(view.height));
        Self {
            tiles_per_px: SIDE as f64 / size_px,
            size_px,
            farthest: vec![f32::INFINITY; SIDE * SIDE],
        }
    }

    /// Tiles a pixel, horizontally and vertically.
    pub(crate) fn tiles_per_px(&self) -> DVec2 {
        self.tiles_per_px
    }

    /// Width and height of the picture, pixels.
    pub(crate) fn size_px(&self) -> DVec2 {
        self.size_px
    }

    /// Mutable depths of the tiles.
    pub(crate) fn farthest_mut(&mut self) -> &mut [f32] {
        &mut self.farthest
    }

    /// Whether the tile at a pixel is infinite or not nearer than `nearest`; false outside of the
    /// picture. Decides most visible boxes by one tile.
    pub(crate) fn shows_at(&self, px: DVec2, nearest: f64) -> bool {
        let tile = px * self.tiles_per_px;
        let is_on_picture =
            tile.cmpge(DVec2::ZERO).all() && tile.cmplt(DVec2::splat(SIDE as f64)).all();
        is_on_picture
            && f64::from(self.farthest[tile.y as usize * SIDE + tile.x as usize]) >= nearest
    }

    /// Whether a box with this outline (pixels), not nearer than `nearest`, lies behind all tiles
    /// that it touches. False for an outline that touches none.
    pub(crate) fn hides(&self, outline: &Polygon, nearest: f64) -> bool {
        let clipped = outline.clipped(DVec2::ZERO, self.size_px);
        let outline = clipped.as_ref().unwrap_or(outline);
        let nearest = (nearest * (1.0 - ROUNDING)) as f32;
        let mut rows = Rows::<SIDE>::new();
        rows.touch(outline.corners(), self.tiles_per_px);
        let mut any = false;
        for (row, tiles) in rows.touched() {
            any |= !tiles.is_empty();
            // Negated so that a tile that is not a number hides nothing.
            if !self.farthest[row * SIDE..][tiles].iter().all(|&f| f < nearest) {
                return false;
            }
        }
        any
    }
}
