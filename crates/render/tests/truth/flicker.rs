//! Flicker: the change of a picture from frame to frame of a slow camera path, less the change of
//! the perfect picture.

use super::measure::Cloud;
use esker_lod::View;
use esker_truth::Truth;
use esker_truth::image::{Image, srgb};
use glam::{DMat3, DVec3, Vec3};

/// Camera path around the vertical axis through the origin. From each of the `frames` views to the
/// next, a point on the unit sphere moves by `step_px` in the picture.
pub fn orbit(view: &View, frames: usize, step_px: f64) -> Vec<View> {
    let distance = view.eye.length();
    let angle = step_px * (distance - 1.0) / view.focal_px();
    let turned = |k: usize| {
        let turn = DMat3::from_rotation_z(angle * k as f64);
        View { eye: turn * view.eye, world_from_view: turn * view.world_from_view, ..*view }
    };
    (0..frames).map(turned).collect()
}

/// Root mean square errors of changes, over pixels that show a surface in both frames of a pair.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flicker {
    /// sRGB before lighting, 0 to 255.
    pub colour: f64,
    /// In widths of a pixel.
    pub depth_px: f64,
    /// Degrees.
    pub normal_deg: f64,
}

/// Values of a pixel, drawn or true.
#[derive(Clone, Copy)]
struct PixelValues {
    colour: Vec3,
    depth_px: f64,
    normal: DVec3,
}

impl PixelValues {
    fn minus(self, other: Self) -> Self {
        Self {
            colour: self.colour - other.colour,
            depth_px: self.depth_px - other.depth_px,
            normal: self.normal - other.normal,
        }
    }
}

/// Measures the flicker of `cloud` along `path` against the scene that it was sampled from.
pub fn flicker(cloud: &Cloud, truth: &Truth, path: &[View], has_normals: bool) -> Flicker {
    let mut before: Option<Vec<Option<[PixelValues; 2]>>> = None;
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for view in path {
        let pixel = view.eye.length() / view.focal_px();
        let image = Image::new(truth, view);
        let drawn = cloud.draw(view, has_normals);
        let normals = drawn.normals();
        let values = (0..drawn.depth.len()).map(|p| {
            let seen =
                image.pixels[p].filter(|_| image.is_inside(p, 1) && drawn.depth[p].is_finite())?;
            let wanted = PixelValues {
                colour: srgb(seen.colour),
                depth_px: seen.depth / pixel,
                normal: seen.normal,
            };
            let got = PixelValues {
                colour: srgb(drawn.level.tint[p].truncate()),
                depth_px: f64::from(drawn.depth[p]) / pixel,
                normal: normals[p],
            };
            Some([wanted, got])
        });
        let now: Vec<_> = values.collect();
        for (before, now) in before.iter().flatten().zip(&now) {
            let (Some([wanted, got]), Some([wants, gets])) = (before, now) else { continue };
            let off = gets.minus(*got).minus(wants.minus(*wanted));
            sum[0] += f64::from(off.colour.length_squared()) / 3.0;
            sum[1] += off.depth_px.powi(2);
            sum[2] += off.normal.length_squared();
            count += 1.0;
        }
        before = Some(now);
    }
    let [colour, depth_px, normal] = sum.map(|s: f64| (s / f64::max(count, 1.0)).sqrt());
    Flicker { colour, depth_px, normal_deg: normal.to_degrees() }
}
