//! What the camera needs from the depths of a picture: the depth under the pointer, and the
//! distance of the scene.

use esker_engine::calls::pick::shown_depth;
use glam::DVec2;

/// Depths of a picture, row by row; infinite in empty pixels.
#[derive(Clone, Copy, Debug)]
pub struct Depths<'a> {
    /// Width of the picture, pixels.
    pub width: usize,
    /// Eye depths, the file's unit.
    pub depth: &'a [f32],
}

/// Samples on each side of the picture from which the distance of the scene is estimated.
const SAMPLES: usize = 24;

impl Depths<'_> {
    fn height(&self) -> usize {
        self.depth.len().checked_div(self.width).unwrap_or(0)
    }

    fn at(&self, x: i64, y: i64) -> Option<f64> {
        let (width, height) = (self.width as i64, self.height() as i64);
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return None;
        }
        let depth = f64::from(self.depth[(y * width + x) as usize]);
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }

    /// Depth at a position of the picture (0 to 1 from its top left corner); in an empty pixel the
    /// least depth in the smallest square around it that has any.
    pub fn near(&self, at: DVec2) -> Option<f64> {
        let place = [at.x * self.width as f64, at.y * self.height() as f64];
        shown_depth(self.depth, self.width as u32, place.map(|side| side as u32))
    }

    /// Depth of the pixel at a position of the picture.
    pub fn exactly(&self, at: DVec2) -> Option<f64> {
        self.at((at.x * self.width as f64) as i64, (at.y * self.height() as f64) as i64)
    }
}

/// Estimates the distance of the scene from depths of its picture: their lower quartile, so that
/// near objects count more than the horizon. `None` if all samples are empty.
pub fn typical(at: impl Fn(DVec2) -> Option<f64>) -> Option<f64> {
    let middle = |cell: usize| (cell as f64 + 0.5) / SAMPLES as f64;
    let cells =
        (0..SAMPLES * SAMPLES).map(|i| DVec2::new(middle(i % SAMPLES), middle(i / SAMPLES)));
    let mut depths: Vec<f64> = cells.filter_map(at).collect();
    depths.sort_by(f64::total_cmp);
    depths.get(depths.len() / 4).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pointer_picks_the_nearest_depth_close_to_it() {
        let mut depth = vec![f32::INFINITY; 100 * 50];
        depth[20 * 100 + 30] = 7.0;
        depth[20 * 100 + 32] = 5.0;
        let depths = Depths { width: 100, depth: &depth };
        let at = |x: f64, y: f64| depths.near(DVec2::new((x + 0.5) / 100.0, (y + 0.5) / 50.0));
        assert_eq!(at(30.0, 20.0), Some(7.0), "the pixel itself has a depth");
        assert_eq!(at(31.0, 20.0), Some(5.0), "of two equally close, the one of least depth");
        assert_eq!(at(30.0, 26.0), Some(5.0), "both lie in the same square");
        assert_eq!(at(90.0, 40.0), None);
        assert_eq!(Depths { width: 0, depth: &[] }.near(DVec2::ONE), None);
    }

    #[test]
    fn the_distance_of_the_scene_is_the_lower_quartile_of_depths() {
        let depth: Vec<f32> =
            (0..100 * 100).map(|i| if i < 5000 { 1000.0 } else { 10.0 }).collect();
        let depths = Depths { width: 100, depth: &depth };
        assert_eq!(typical(|at| depths.exactly(at)), Some(10.0));
        assert_eq!(typical(|_| None), None);
    }
}
