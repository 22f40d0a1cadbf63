//! Scans of analytic scenes, `truth:NAME`: points on exact surfaces, and exact pictures of them.
//! They have colours and no normals, so that pictures show what a build finds out.

use crate::error_time::perfect::Reference;
use anyhow::{Context, Result, bail};
use esker_engine::cameras::camera::Camera;
use esker_lod::View;
use esker_points::Lattice;
use esker_render::passes::shade::phong;
use esker_render::{Frame, Picture, Renderer};
use esker_truth::dice::Dice;
use esker_truth::image::{linear, srgb};
use esker_truth::sample::{Kind, floor, sample};
use esker_truth::{Shape, Truth, scenes};
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use std::io::Write;
use std::path::Path;

/// What names of analytic scenes begin with.
const PREFIX: &str = "truth:";
/// Distance of points in the middle of the picture, pixels.
const SPACING_PX: f64 = 1.5;
/// Seed of the samples.
const SEED: u64 = 11;
/// Rays along the side of a pixel.
const RAYS: usize = 4;

/// An analytic scene, and its view.
pub(crate) struct Analytic {
    /// Name in reports.
    pub name: &'static str,
    truth: Truth,
    view: View,
}

impl Analytic {
    /// A scene of other surfaces than those that have a name.
    pub fn new(name: &'static str, truth: Truth, view: View) -> Self {
        Self { name, truth, view }
    }

    /// The scene that an input names; `None` if the input is a file.
    ///
    /// # Errors
    /// If there is no scene of that name.
    pub fn named(input: &Path, size: [u32; 2]) -> Result<Option<Self>> {
        let Some(wanted) = input.to_str().and_then(|name| name.strip_prefix(PREFIX)) else {
            return Ok(None);
        };
        let mut all = scenes(size[1]);
        let Some(at) = all.iter().position(|(name, ..)| *name == wanted) else {
            let names: Vec<_> = all.iter().map(|(name, ..)| *name).collect();
            bail!("there is no scene {PREFIX}{wanted}; there are {}", names.join(", "));
        };
        let (name, truth, view) = all.swap_remove(at);
        let [width, height] = size;
        Ok(Some(Self { name, truth, view: View { width, height, ..view } }))
    }

    /// The camera of its view.
    pub fn camera(&self) -> Camera {
        Camera {
            eye: Some(self.view.eye),
            target: Some(self.view.eye + self.view.forward()),
            fovy_deg: Some(self.view.fovy_rad.to_degrees()),
            ..Camera::default()
        }
    }

    /// Samples the surfaces and writes the points as a PLY file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut dice = Dice(SEED);
        let points = match self.truth.parts[..] {
            [(Shape::Floor { z }, paint)] => {
                let bands = floor(&self.view, &paint, z, SPACING_PX, Kind::Poisson, &mut dice);
                bands.into_iter().flat_map(|(_, band)| band.points).collect()
            }
            _ => {
                let spacing = self.view.eye.length() / self.view.focal_px() * SPACING_PX;
                sample(&self.truth, spacing, Kind::Poisson, &mut dice).points
            }
        };
        let fields: String = ["x", "y", "z"].map(|f| format!("property double {f}\n")).concat();
        let colours: String =
            ["red", "green", "blue"].map(|f| format!("property uchar {f}\n")).concat();
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{fields}{colours}end_header\n",
            points.len()
        )
        .into_bytes();
        for point in &points {
            bytes.extend(point.at.to_array().iter().flat_map(|c| c.to_le_bytes()));
            bytes.extend(point.colour);
        }
        let context = || format!("{}: cannot write the points", path.display());
        std::fs::File::create(path)
            .and_then(|mut file| file.write_all(&bytes))
            .with_context(context)
    }

    /// The exact picture of a view, lit as surfaces are, without eye-dome lighting; the background
    /// is that of an empty frame.
    ///
    /// # Errors
    /// If the view makes no valid camera.
    pub fn picture(&self, view: &View) -> Result<Reference> {
        let view = View { near: self.view.near, ..view.with_margin(0) };
        let lattice = Lattice { scale: [1e-3; 3], ..Lattice::default() };
        let empty = Renderer::default().render(&Frame::new(&view, &lattice, &[]))?;
        let [width, height] = [view.width, view.height].map(|side| side as usize);
        let back = |at: usize| *empty.rgba[at * 4..].first_chunk().unwrap_or(&[0; 4]);
        let pixel = |at: usize| {
            let corner = DVec2::new((at % width) as f64, (at / width) as f64);
            let [r, g, b, _] = back(at);
            let behind = linear([r, g, b]);
            let share = 1.0 / (RAYS * RAYS) as f32;
            let mut light = Vec3::ZERO;
            for ray in 0..RAYS * RAYS {
                let part = DVec2::new((ray % RAYS) as f64 + 0.5, (ray / RAYS) as f64 + 0.5);
                light += self.lit(&view, corner + part / RAYS as f64).unwrap_or(behind) * share;
            }
            let [r, g, b] = srgb(light).to_array().map(|value| value.round() as u8);
            let middle = self.truth.hits(view.eye, Truth::ray(&view, corner + 0.5));
            ([r, g, b, 255], middle.first().map_or(f32::INFINITY, |hit| hit.t as f32))
        };
        let pixels: Vec<_> = (0..width * height).into_par_iter().map(pixel).collect();
        Ok(Reference {
            width,
            rgba: pixels.iter().flat_map(|(colour, _)| *colour).collect(),
            depth: pixels.iter().map(|(_, depth)| *depth).collect(),
        })
    }

    /// Light from the surface at a place of the picture.
    fn lit(&self, view: &View, place: DVec2) -> Option<Vec3> {
        let ray = Truth::ray(view, place);
        let hits = self.truth.hits(view.eye, ray);
        let hit = hits.first()?;
        let to_view = view.view_from_world();
        let normal = (to_view * hit.normal).as_vec3();
        let to_eye = (to_view * -ray).normalize_or_zero().as_vec3();
        Some(phong(linear(hit.colour), normal, to_eye, true).clamp(Vec3::ZERO, Vec3::ONE))
    }

    /// Mean angle, degrees, between the normals that a picture of points shows as colours and those
    /// of the surface. Pixels that show another surface than the nearest, and points without a
    /// normal, do not count.
    pub fn normal_error(&self, view: &View, picture: &Picture) -> f64 {
        self.normal_errors(view, picture).0
    }

    /// The same, and the share of the points that have a normal.
    pub fn normal_errors(&self, view: &View, picture: &Picture) -> (f64, f64) {
        let Picture { rgba, depth, .. } = picture;
        let (width, pixel_at_one) = (view.width as usize, 1.0 / view.focal_px());
        let (mut sum, mut all) = ((0.0, 0.0), 0.0);
        for (at, depth) in depth.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
            let place = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
            let hits = self.truth.hits(view.eye, Truth::ray(view, place));
            let depth = f64::from(*depth);
            let Some(hit) =
                hits.first().filter(|hit| (hit.t - depth).abs() < 4.0 * depth * pixel_at_one)
            else {
                continue;
            };
            let [r, g, b, _] = *rgba[at * 4..].first_chunk().unwrap_or(&[0; 4]);
            let drawn = (linear([r, g, b]) * 2.0 - 1.0).as_dvec3();
            all += 1.0;
            // A point without a normal is grey.
            if drawn.length_squared() > 0.5 {
                let cosine = drawn.normalize_or_zero().dot(hit.normal);
                sum.0 += cosine.abs().min(1.0).acos().to_degrees();
                sum.1 += 1.0;
            }
        }
        (sum.0 / f64::max(sum.1, 1.0), sum.1 / f64::max(all, 1.0))
    }
}
