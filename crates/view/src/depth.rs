//! What a picture's depth tells the camera: how far away the thing under the pointer is, and the
//! scene.

use glam::DVec2;

/// Depths of a picture, row by row; infinite where nothing is.
#[derive(Clone, Copy, Debug)]
pub struct Depths<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Eye depths, the file's unit.
    pub depth: &'a [f32],
}

/// How far from the pointer something may be that is meant by it, pixels.
const REACH_PX: i64 = 12;
/// Samples on a side of the picture that tell how far away the scene is.
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

    /// The depth at a place of the picture (0 to 1 from its top left corner), or of the nearest
    /// thing in the smallest square around it that has any.
    pub fn near(&self, place: DVec2) -> Option<f64> {
        let x = (place.x * self.width as f64) as i64;
        let y = (place.y * self.height() as f64) as i64;
        (0..=REACH_PX).find_map(|r| {
            let ring = (-r..=r).flat_map(|i| [(i, -r), (i, r), (-r, i), (r, i)]);
            ring.filter_map(|(dx, dy)| self.at(x + dx, y + dy)).reduce(f64::min)
        })
    }

    /// The depth at a place of the picture, and no other.
    pub fn exactly(&self, place: DVec2) -> Option<f64> {
        self.at((place.x * self.width as f64) as i64, (place.y * self.height() as f64) as i64)
    }
}

/// How far away a scene is whose picture has these depths: their lower quartile, so that what is
/// near counts more than the horizon. `None` where nothing is seen.
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
    fn the_pointer_means_the_nearest_thing_close_to_it() {
        let mut depth = vec![f32::INFINITY; 100 * 50];
        depth[20 * 100 + 30] = 7.0;
        depth[20 * 100 + 32] = 5.0;
        let depths = Depths { width: 100, depth: &depth };
        let at = |x: f64, y: f64| depths.near(DVec2::new((x + 0.5) / 100.0, (y + 0.5) / 50.0));
        assert_eq!(at(30.0, 20.0), Some(7.0), "what is hit counts");
        assert_eq!(at(31.0, 20.0), Some(5.0), "of two as close, the nearer one");
        assert_eq!(at(30.0, 26.0), Some(5.0), "the squares are of one size");
        assert_eq!(at(90.0, 40.0), None);
        assert_eq!(Depths { width: 0, depth: &[] }.near(DVec2::ONE), None);
    }

    #[test]
    fn the_scene_is_as_far_as_its_near_quarter() {
        let depth: Vec<f32> =
            (0..100 * 100).map(|i| if i < 5000 { 1000.0 } else { 10.0 }).collect();
        let depths = Depths { width: 100, depth: &depth };
        assert_eq!(typical(|at| depths.exactly(at)), Some(10.0));
        assert_eq!(typical(|_| None), None);
    }
}
