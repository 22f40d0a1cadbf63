//! Errors of a drawn picture against the perfect picture of an analytic scene: colour, depth,
//! normals, holes, hidden surfaces that show through, outlines.

#![allow(clippy::unwrap_used, reason = "tests may panic")]

use crate::scene::Scene;
use esker_lod::View;
use esker_render::inputs::camera::Camera;
use esker_render::passes::fill_holes;
use esker_render::passes::pull;
use esker_render::passes::push;
use esker_render::passes::silhouette;
use esker_render::passes::smooth_depth::{DepthImage, SmoothDepthScratch};
use esker_render::passes::tangent::Lens;
use esker_render::picture::edges;
use esker_render::picture::margin::MARGIN_PX;
use esker_render::picture::pyramid::{Level, Pyramid};
use esker_render::picture::radii::Radii;
use esker_render::{Background, Frame, FramePlan, Picture, Renderer};
use esker_truth::dice::Dice;
use esker_truth::image::{Image, srgb};
use esker_truth::sample::{Kind, ScenePoint, floor, sample};
use esker_truth::{Shape, Truth};
use fearless_simd::{Level as Simd, dispatch};
use glam::{DVec3, Vec3};

/// Sampled points as scenes that are drawn in one frame.
pub struct Cloud {
    pub scenes: Vec<Scene>,
    /// Whether points that share a pixel are averaged, other pixels are smoothed, and planes are
    /// fitted if there are no normals.
    pub averages: bool,
}

impl Cloud {
    pub fn new(points: &[ScenePoint], spacing: f64, radius: f64) -> Self {
        let scenes = vec![Scene::new(points, 1e-6, spacing, radius, 1 << 15)];
        Self { scenes, averages: true }
    }

    /// Samples a scene with `density` points a pixel at its middle. Floors are sampled in bands of
    /// distance.
    pub fn of(truth: &Truth, view: &View, density: f64, kind: Kind, dice: &mut Dice) -> Self {
        if let [(Shape::Floor { z }, paint)] = truth.parts[..] {
            let bands = floor(view, &paint, z, 1.0 / density.sqrt(), kind, dice);
            let scenes = bands
                .iter()
                .map(|(spacing, s)| Scene::new(&s.points, 1e-6, *spacing, s.radius, 1 << 15));
            return Self { scenes: scenes.collect(), averages: true };
        }
        let spacing = view.eye.length() / view.focal_px() / density.sqrt();
        let s = sample(truth, spacing, kind, dice);
        Self::new(&s.points, spacing, s.radius)
    }

    /// Draws the cloud with a margin, and keeps the level and depths before shading.
    pub fn draw(&self, view: &View, has_normals: bool) -> Drawn {
        self.draw_with(view, has_normals, self.averages, pull_push)
    }

    /// Draws the level and depths with the published passes, whose depth intervals are as long as
    /// the drawn radius (twice as long without normals) and are not moved along planes. The picture
    /// is that of [`Cloud::draw`].
    pub fn draw_published(&self, view: &View, has_normals: bool) -> Drawn {
        self.draw_with(view, has_normals, false, |pyramid, _| {
            let base = &mut pyramid.levels[0];
            for i in 0..base.front.len() {
                let (front, radius_px) = (base.front[i], base.tint[i].w - 0.35);
                let reach = if has_normals { 1.0 } else { 2.0 };
                base.front[i].y = front.x * (1.0 + reach * radius_px / pyramid.lens.focal_px);
            }
            // At an infinite focal length, moving along planes leaves depths unchanged.
            let lens = std::mem::replace(
                &mut pyramid.lens,
                Lens { focal_px: f32::MAX, ..Lens::default() },
            );
            pull_push(pyramid, false);
            pyramid.lens = lens;
        })
    }

    /// Version of [`Cloud::draw`] that fits planes to depths if `fits_planes` is true and fills the
    /// pyramid by `fill`, whose second argument says whether pixels are smoothed.
    pub fn draw_with(
        &self,
        view: &View,
        has_normals: bool,
        fits_planes: bool,
        fill: impl Fn(&mut Pyramid, bool),
    ) -> Drawn {
        let draws: Vec<_> =
            self.scenes.iter().flat_map(|s| s.draws(true, true, has_normals)).collect();
        let wide = view.with_margin(MARGIN_PX);
        let mut frame = self.scenes[0].frame(&wide, &draws);
        frame.background = Background::Plain([0; 4]);
        (frame.averages, frame.smooths, frame.fits_planes) =
            (self.averages, self.averages, fits_planes);
        let picture = Renderer::default().render(&frame).unwrap();
        let smooths = FramePlan::new(&frame).smooths;
        let (level, depth) = last_level(&frame, |pyramid| fill(pyramid, smooths));
        let depth = inner(&depth, level.width);
        Drawn { view: *view, picture, level: inner_level(level), depth }
    }
}

/// Runs pull and push. With `smooths`, push smooths the pixels that stay.
pub fn pull_push(pyramid: &mut Pyramid, smooths: bool) {
    pull::pull(pyramid);
    push::push_with(pyramid, f32::from(smooths), &mut []);
}

/// The values of `plane` inside the margin; its rows are `wide_width` long.
fn inner<T: Copy>(plane: &[T], wide_width: usize) -> Vec<T> {
    const MARGIN: usize = MARGIN_PX as usize;
    let rows = plane.len() / wide_width;
    let kept = plane.chunks(wide_width).take(rows.saturating_sub(MARGIN)).skip(MARGIN);
    kept.flat_map(|row| row[MARGIN..wide_width - MARGIN].iter().copied()).collect()
}

fn inner_level(level: Level) -> Level {
    let Level { width, height, edge_px, front, tint, depth, normal, tilt } = level;
    let (front, tint) = (inner(&front, width), inner(&tint, width));
    let (depth, normal, tilt) = (inner(&depth, width), inner(&normal, width), inner(&tilt, width));
    let [width, height] = [width, height].map(|s| s - 2 * MARGIN_PX as usize);
    Level { width, height, edge_px, front, tint, depth, normal, tilt }
}

/// Draws level 0 and the depth image, up to the pass before shading.
pub fn last_level(frame: &Frame<'_>, fill: impl Fn(&mut Pyramid)) -> (Level, Vec<f32>) {
    let camera = Camera::new(frame.view, frame.lattice).unwrap();
    let mut pyramid = Pyramid::default();
    Renderer::default().base_level(frame, &mut pyramid).unwrap();
    fill(&mut pyramid);
    let mut base = pyramid.levels.swap_remove(0);
    let mut depth = vec![0.0; base.front.len()];
    base.depth_image(&Lens::new(&camera), &mut depth);
    let found = edges::edges(&depth, base.width, 2.0 / camera.focal_px);
    fill_holes::fill_holes(&mut base, &mut depth, camera.focal_px);
    silhouette::trim(&mut base, &mut depth, &found, camera.focal_px);
    (base, depth)
}

/// A picture, and the level and depths that it was shaded from.
pub struct Drawn {
    pub view: View,
    pub picture: Picture,
    pub level: Level,
    pub depth: Vec<f32>,
}

/// Errors of a picture against the perfect one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// Root mean square, sRGB, 0 to 255.
    pub colour: f64,
    /// Mean, in widths of a pixel at that depth.
    pub depth_px: f64,
    /// Mean, degrees.
    pub normal_deg: f64,
    /// Number of empty pixels in the interior of surfaces.
    pub holes: usize,
    /// Number of pixels that show a hidden surface.
    pub bleeding: usize,
    /// Mean displacement of outlines outwards, pixels.
    pub swell_px: f64,
    /// Root mean square error of alpha at outlines.
    pub alpha: f64,
    /// Number of pixels that show a surface in both pictures.
    pub pixels: usize,
}

impl Drawn {
    /// Normals in view space: those of the points, else those estimated from smoothed depths.
    pub fn normals(&self) -> Vec<DVec3> {
        let (width, count) = (self.level.width, self.depth.len());
        if !self.level.normal.is_empty() {
            let own = |i: usize| self.level.normal[i].truncate().normalize_or_zero().as_dvec3();
            return (0..count).map(own).collect();
        }
        let middle = [self.view.width, self.view.height].map(|s| s as f32 / 2.0);
        let radii: Vec<f32> =
            (0..count).filter(|&i| self.level.is_valid(i)).map(|i| self.level.tint[i].w).collect();
        let radius_px = radii.iter().sum::<f32>() / radii.len().max(1) as f32;
        let (depth, focal_px) = (&self.depth[..], self.view.focal_px() as f32);
        let radii = Radii::even([width, count / width], radius_px);
        let radii = Some(&radii);
        let image = DepthImage { width, depth, focal_px, centre_px: middle, radii };
        let mut scratch = SmoothDepthScratch::default();
        let smooth = image.smoothed(&mut scratch);
        let nothing = vec![f32::INFINITY; width];
        let mut normals = Vec::with_capacity(count);
        for y in 0..count / width {
            let row = smooth.surroundings(y, &nothing);
            for first in (0..width).step_by(8) {
                let [x, y, z]: [[f32; 8]; 3] = dispatch!(Simd::new(), simd => {
                    let [x, y, z] = row.normals(simd, first);
                    [*x, *y, *z]
                });
                let normal = |k: usize| Vec3::new(x[k], y[k], z[k]).as_dvec3();
                normals.extend((0..8.min(width - first)).map(normal));
            }
        }
        normals
    }

    /// Counts empty pixels that are not connected, through empty pixels, to a pixel that the
    /// surfaces do not fully cover.
    pub fn holes(&self, truth: &Image) -> usize {
        let width = self.level.width;
        let height = self.depth.len() / width;
        let empty = |i: usize| self.depth[i] == f32::INFINITY;
        let mut open = vec![false; self.depth.len()];
        let mut queue: Vec<usize> =
            (0..open.len()).filter(|&i| empty(i) && truth.coverage[i] < 1.0).collect();
        queue.iter().for_each(|&i| open[i] = true);
        while let Some(i) = queue.pop() {
            let (x, y) = (i % width, i / width);
            let beside = [
                (x > 0, i.wrapping_sub(1)),
                (x + 1 < width, i + 1),
                (y > 0, i.wrapping_sub(width)),
                (y + 1 < height, i + width),
            ];
            for (_, n) in beside.into_iter().filter(|(there, _)| *there) {
                if empty(n) && !open[n] {
                    open[n] = true;
                    queue.push(n);
                }
            }
        }
        (0..open.len()).filter(|&i| empty(i) && !open[i]).count()
    }

    /// Counts interior pixels that show the surface behind the true one.
    pub fn bleeding(&self, truth: &Image) -> usize {
        (0..self.depth.len()).filter(|&i| self.bleeds(truth, i)).count()
    }

    /// Whether pixel `i` is in the interior of a surface and shows one behind it.
    pub fn bleeds(&self, truth: &Image, i: usize) -> bool {
        let Some(seen) = truth.pixels[i].filter(|_| truth.is_inside(i, 2)) else { return false };
        let depth = f64::from(self.depth[i]);
        depth.is_finite() && depth > (seen.depth + seen.behind.min(seen.depth * 2.0)) * 0.5
    }

    pub fn errors(&self, truth: &Image) -> Errors {
        let mut out = Errors {
            holes: self.holes(truth),
            bleeding: self.bleeding(truth),
            ..Errors::default()
        };
        let normals = self.normals();
        let (mut colour, mut depth, mut normal, mut count) = (0.0, 0.0, 0.0, 0.0);
        let (mut swell, mut alpha, mut rim, mut outline) = (0.0, 0.0, 0.0, 0.0);
        for (i, towards) in normals.iter().enumerate() {
            let share = f64::from(self.picture.rgba[i * 4 + 3]) / 255.0;
            let inside = truth.is_inside(i, 1);
            if !inside {
                let is_outline = truth.coverage[i] > 0.0 && truth.coverage[i] < 1.0;
                outline += f64::from(u8::from(is_outline));
                swell += share - truth.coverage[i];
                if is_outline || share != truth.coverage[i] {
                    alpha += (share - truth.coverage[i]).powi(2);
                    rim += 1.0;
                }
            }
            let (Some(seen), true) = (truth.pixels[i], self.depth[i].is_finite()) else { continue };
            out.pixels += 1;
            if !inside {
                continue;
            }
            let got = self.level.tint[i].truncate();
            colour += f64::from((srgb(got) - srgb(seen.colour)).length_squared()) / 3.0;
            let pixel = seen.depth / self.view.focal_px();
            depth += ((f64::from(self.depth[i]) - seen.depth) / pixel).abs();
            normal += towards.dot(seen.normal).clamp(-1.0, 1.0).acos().to_degrees();
            count += 1.0;
        }
        let count = if count > 0.0 { count } else { 1.0 };
        out.colour = (colour / count).sqrt();
        out.depth_px = depth / count;
        out.normal_deg = normal / count;
        out.swell_px = if outline > 0.0 { swell / outline } else { 0.0 };
        out.alpha = if rim > 0.0 { f64::sqrt(alpha / rim) } else { 0.0 };
        out
    }
}
