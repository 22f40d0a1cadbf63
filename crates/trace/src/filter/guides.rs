//! Guides of the filters: what the first ray of each pixel hit, as planes without noise
//! (`bauszat2011` 3.2). Normals are scaled to [0, 1] and depth is divided by a constant of the
//! scene, so that the same settings serve every scene and no frame scales its own guides.

use glam::Vec3;

/// What a plane of the guides holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GuideKind {
    /// A component of the normal, scaled from [-1, 1] to [0, 1].
    Normal,
    /// Distance from the eye over a constant of the scene.
    Depth,
    /// Ambient occlusion, 0 to 1.
    Occlusion,
}

/// Guides of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Guides {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// One, three, four or five planes, row by row.
    pub planes: Vec<Vec<f32>>,
    /// What each plane holds.
    pub kinds: Vec<GuideKind>,
    /// Pixels whose ray hit a surface. The others are in no window and keep their value.
    pub is_hit: Vec<bool>,
}

impl Guides {
    /// Guides of four planes: normals, and distances over `scene_depth`, which is a constant of
    /// the scene such as the diagonal of its box. `surfaces` are the normals and distances that
    /// pixels see, row by row; pixels that hit nothing are `None`.
    pub fn of_surfaces(
        width: usize,
        height: usize,
        surfaces: &[Option<(Vec3, f32)>],
        scene_depth: f32,
    ) -> Self {
        let plane = |value: &dyn Fn(&(Vec3, f32)) -> f32| -> Vec<f32> {
            surfaces.iter().map(|surface| surface.as_ref().map_or(0.0, value)).collect()
        };
        let normal = |axis: usize| plane(&move |&(normal, _)| normal[axis] * 0.5 + 0.5);
        let depth = plane(&|&(_, distance)| distance / scene_depth.max(f32::MIN_POSITIVE));
        let normals = [GuideKind::Normal; 3];
        Self {
            width,
            height,
            planes: vec![normal(0), normal(1), normal(2), depth],
            kinds: normals.into_iter().chain([GuideKind::Depth]).collect(),
            is_hit: surfaces.iter().map(Option::is_some).collect(),
        }
    }

    /// The same guides with ambient occlusion as a last plane.
    pub fn with_occlusion(mut self, occlusion: Vec<f32>) -> Self {
        self.planes.push(occlusion);
        self.kinds.push(GuideKind::Occlusion);
        self
    }

    /// The planes of one kind alone: figure 5 of `bauszat2011` compares depth alone, normals alone
    /// and both.
    pub fn only(&self, kinds: &[GuideKind]) -> Self {
        let kept = |k: &usize| kinds.contains(&self.kinds[*k]);
        let kept: Vec<usize> = (0..self.planes.len()).filter(kept).collect();
        Self {
            width: self.width,
            height: self.height,
            planes: kept.iter().map(|&k| self.planes[k].clone()).collect(),
            kinds: kept.iter().map(|&k| self.kinds[k]).collect(),
            is_hit: self.is_hit.clone(),
        }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// Whether there is no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
