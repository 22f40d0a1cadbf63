//! Images beside the colours of a still picture: the normals of what it shows, and the points in
//! its pixels. They follow from the depths of the picture, whatever drew it, and from the points
//! that were chosen for it.

use crate::draw::scene::{PictureRequest, PictureScene};
use anyhow::Result;
use esker_format::Forest;
use esker_lod::{CompactOctree, View, Window};
use esker_render::{Picture, nearest_points};
use glam::DVec3;
use rayon::prelude::*;

/// Images that are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerChoice {
    /// Normals.
    pub normals: bool,
    /// Points.
    pub points: bool,
}

/// Pixel without a point.
pub const NO_POINT: [u32; 2] = [u32::MAX; 2];

/// Images beside the colours, a value a pixel, the top row first; empty if they are not wanted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Unit normal of the shown surface, on the side of the eye, on the axes of the file (in metres
    /// where these are degrees): that of the plane through neighbouring pixels of about its depth.
    /// It looks to the eye where a pixel has no such neighbours, and is not a number where nothing
    /// is drawn.
    pub normals: Vec<[f32; 3]>,
    /// Node and index in it of the nearest point that falls on the pixel and is not behind the
    /// shown surface; [`NO_POINT`] where there is none, as between the points of a surface.
    pub points: Vec<[u32; 2]>,
}

/// Distance behind the shown surface at which a point still belongs to it, widths of a pixel.
const BEHIND_PX: f64 = 2.0;

impl Layers {
    /// Images of a picture of `scene`, which is cropped to the requested window.
    ///
    /// # Errors
    /// If the camera is not usable.
    pub(crate) fn of(
        file: &Forest,
        request: &PictureRequest,
        scene: &PictureScene,
        octree: &CompactOctree,
        picture: &Picture,
        wanted: LayerChoice,
    ) -> Result<Self> {
        let [width, height] = request.size;
        let window = request.window.unwrap_or(Window { x: 0, y: 0, width, height });
        let lens = Lens::new(&scene.view.with_margin(0), window);
        let mut layers = Self::default();
        if wanted.normals {
            layers.normals = lens.normals(picture);
        }
        if wanted.points {
            let draws = scene.draws(file);
            let frame = scene.appearance.frame(file, &scene.view, &draws, octree);
            let nearest = nearest_points(&frame)?;
            let drawn_width = scene.view.window.map_or(request.size[0], |drawn| drawn.width);
            let [left, top] = scene.window.map_or([0, 0], |shown| [shown.x, shown.y]);
            let pixels = (0..picture.depth.len()).map(|pixel| {
                let [x, y] = [pixel as u32 % picture.width, pixel as u32 / picture.width];
                let at = (y + top) as usize * drawn_width as usize + (x + left) as usize;
                let shown = f64::from(picture.depth[pixel]);
                let found = nearest.get(at).copied().flatten().filter(|point| {
                    f64::from(point.depth) <= shown + BEHIND_PX * lens.pixel(shown)
                });
                found.map_or(NO_POINT, |found| {
                    [scene.selection.drawn[found.draw].node, found.point as u32]
                })
            });
            layers.points = pixels.collect();
        }
        Ok(layers)
    }
}

/// The camera of a picture, from pixels and depths to places.
struct Lens {
    view: View,
    window: Window,
    focal_px: f64,
}

impl Lens {
    fn new(view: &View, window: Window) -> Self {
        let view = View { window: None, ..*view };
        Self { view, window, focal_px: view.focal_px() }
    }

    /// Width of a pixel at an eye depth, the unit of the file.
    fn pixel(&self, depth: f64) -> f64 {
        self.view.parallel_at.unwrap_or(depth) / self.focal_px
    }

    /// Place in view space of the centre of a pixel at a depth.
    fn place(&self, x: i64, y: i64, depth: f64) -> DVec3 {
        let (width, height) = (f64::from(self.view.width), f64::from(self.view.height));
        let pixel = self.pixel(depth);
        let right = (x as f64 + 0.5 + f64::from(self.window.x) - width * 0.5) * pixel;
        let down = (y as f64 + 0.5 + f64::from(self.window.y) - height * 0.5) * pixel;
        DVec3::new(right, -down, -depth)
    }

    fn normals(&self, picture: &Picture) -> Vec<[f32; 3]> {
        let width = picture.width as usize;
        let rows = picture.depth.par_chunks(width.max(1)).enumerate();
        let rows = rows.flat_map_iter(|(y, row)| {
            (0..row.len()).map(move |x| self.normal(picture, x as i64, y as i64))
        });
        rows.collect()
    }

    fn normal(&self, picture: &Picture, x: i64, y: i64) -> [f32; 3] {
        let (width, height) = (i64::from(picture.width), i64::from(picture.height));
        let place = |x: i64, y: i64| {
            let is_within = (0..width).contains(&x) && (0..height).contains(&y);
            let depth = is_within.then(|| f64::from(picture.depth[(y * width + x) as usize]));
            depth.filter(|d| d.is_finite() && *d > 0.0).map(|depth| self.place(x, y, depth))
        };
        let Some(centre) = place(x, y) else { return [f32::NAN; 3] };
        // Of two neighbours the one of nearer depth is more likely of the same surface.
        let along = |dx: i64, dy: i64| {
            let ahead = place(x + dx, y + dy).map(|p| p - centre);
            let behind = place(x - dx, y - dy).map(|p| centre - p);
            let all = [ahead, behind].into_iter().flatten();
            all.min_by(|a, b| a.z.abs().total_cmp(&b.z.abs()))
        };
        let (Some(right), Some(down)) = (along(1, 0), along(0, 1)) else {
            return self.view.world_from_view.mul_vec3(DVec3::Z).as_vec3().to_array();
        };
        let normal = down.cross(right).normalize_or_zero();
        // The eye is at the origin of view space, or far behind it.
        let to_eye = if self.view.parallel_at.is_some() { DVec3::Z } else { -centre };
        let normal = if normal.dot(to_eye) < 0.0 { -normal } else { normal };
        self.view.world_from_view.mul_vec3(normal).as_vec3().to_array()
    }
}
