//! Shade (marroquim2007 section 3.4): deferred Phong lighting of the filled picture, with the
//! interpolated normals; where the cloud has none, with normals from the reconstructed depth
//! ([`crate::relief`]). In linear light; the result is encoded as sRGB.
//!
//! The light stands with the viewer: a key light from the upper left, a soft one from the eye, and an
//! ambient half-sphere, brighter above. Pixels behind their surroundings are darkened, which sets
//! surfaces off against each other.

use crate::camera::Camera;
use crate::colour::Encoder;
use crate::frame::{Background, Picture};
use crate::pyramid::{Level, Pyramid};
use crate::relief::{DepthImage, ReliefScratch};
use crate::resolve::backdrop;
use crate::soften::is_crease;
use glam::Vec3;
use rayon::prelude::*;

/// Direction to the key light, view space, unit length.
const KEY: Vec3 = Vec3::new(-0.42, 0.60, 0.6808);
/// Shares of the lights. Key, eye and the brighter ambient add up to a little over one.
const KEY_SHARE: f32 = 0.62;
const EYE_SHARE: f32 = 0.16;
const SKY_SHARE: f32 = 0.30;
const GROUND_SHARE: f32 = 0.12;
/// The highlight: its strength and Phong's exponent.
const SHINE: f32 = 0.10;
const SHINE_POWER: i32 = 24;
/// How dark the farthest behind is (as an exponent), and up to which slope nothing darkens. With normals
/// only what lies behind an edge is set off, whatever its slope; without them the depth alone has to tell
/// the shape.
const EDGE: (f32, f32) = (1.2, 4.0);
const DOME: (f32, f32) = (2.0, 0.5);

/// What shading found.
pub struct Shaded {
    /// Pixels that show a surface.
    pub covered: u64,
    /// Pixels beside which the surface bends sharply, in their order.
    pub creases: Vec<usize>,
}

/// Lights level 0, whose depth image the picture has already, and writes its colours.
pub fn shade(
    camera: &Camera,
    pyramid: &Pyramid,
    background: Background,
    shines: bool,
    scratch: &mut ReliefScratch,
    picture: &mut Picture,
) -> Shaded {
    if shines {
        shade_as::<true>(camera, pyramid, background, scratch, picture)
    } else {
        shade_as::<false>(camera, pyramid, background, scratch, picture)
    }
}

/// As [`shade`], with highlights or without.
fn shade_as<const SHINES: bool>(
    camera: &Camera,
    pyramid: &Pyramid,
    background: Background,
    scratch: &mut ReliefScratch,
    picture: &mut Picture,
) -> Shaded {
    let base = &pyramid.levels[0];
    let width = base.width;
    let has_normals = !base.normal.is_empty();
    let focal_px = camera.focal_px;
    let raw = DepthImage {
        width,
        depth: &picture.depth,
        focal_px,
        centre_px: camera.centre_px,
        radius_px: mean_radius_px(base),
    };
    let relief = if has_normals { raw } else { raw.smoothed(scratch) };
    let nothing = vec![f32::INFINITY; width];
    let dark = if has_normals { EDGE.0 } else { DOME.0 };
    let encoder = Encoder::get();
    let rows = picture.rgba.par_chunks_mut(width * 4).enumerate();
    let found = rows.map(|(y, row)| {
        let backdrop = backdrop(background, y, base.height);
        let around = relief.surroundings(y, &nothing);
        let (mut count, mut creases) = (0, Vec::new());
        for (x, out) in row.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let pixel = y * width + x;
            if !base.is_valid(pixel) {
                *out = backdrop;
                continue;
            }
            // Without highlights the eye's soft light comes along the axis.
            let to_eye = if SHINES {
                let ray = Vec3::new(
                    x as f32 + 0.5 - camera.centre_px[0],
                    camera.centre_px[1] - y as f32 - 0.5,
                    -focal_px,
                );
                -ray.normalize_or(Vec3::NEG_Z)
            } else {
                Vec3::Z
            };
            let normal = if has_normals {
                normal_at(pyramid, x, y).unwrap_or(to_eye)
            } else {
                around.normal(x)
            };
            let behind =
                if has_normals { around.sunken(x, EDGE.1) } else { around.behind(x, DOME.1) };
            let light = darken(dark * behind);
            let c = phong::<SHINES>(base.tint[pixel].truncate(), normal, to_eye) * light;
            let [r, g, b] = encoder.bytes(c);
            *out = [r, g, b, 255];
            count += 1;
            if has_normals && is_bent(base, x, pixel) {
                creases.push(pixel);
            }
        }
        (count, creases)
    });
    let found: Vec<_> = found.collect();
    let covered = found.iter().map(|(count, _)| count).sum();
    let creases = found.into_iter().flat_map(|(_, creases)| creases).collect();
    Shaded { covered, creases }
}

/// Whether the surface bends sharply to the right or below.
#[inline]
fn is_bent(base: &Level, x: usize, pixel: usize) -> bool {
    let normal = |p: usize| base.normal[p].truncate();
    let bent =
        |p: usize| p < base.normal.len() && is_crease(normal(pixel), normal(p)) && base.is_valid(p);
    (x + 1 < base.width && bent(pixel + 1)) || bent(pixel + base.width)
}

/// The interpolated normal; of a point that has none in a cloud that has them, the normal of its
/// surroundings: that of the finest coarser pixel with one.
fn normal_at(pyramid: &Pyramid, x: usize, y: usize) -> Option<Vec3> {
    pyramid.levels.iter().enumerate().find_map(|(i, level)| {
        let pixel = (y >> i) * level.width + (x >> i);
        let normal = level.normal[pixel].truncate();
        if level.is_valid(pixel) { normal.try_normalize() } else { None }
    })
}

/// Mean radius over a sample of the pixels covered.
fn mean_radius_px(base: &Level) -> f32 {
    /// A prime, so that the sample runs across columns.
    const EVERY: usize = 61;
    let covered = (0..base.front.len()).step_by(EVERY).filter(|&i| base.is_valid(i));
    let (sum, count) = covered.fold((0.0, 0.0), |(sum, count), i| {
        (sum + base.tint[i].w.min(base.width as f32), count + 1.0)
    });
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Phong lighting of a colour (linear light).
#[inline]
fn phong<const SHINES: bool>(colour: Vec3, normal: Vec3, to_eye: Vec3) -> Vec3 {
    let facing = normal.dot(KEY);
    let ambient = GROUND_SHARE + (SKY_SHARE - GROUND_SHARE) * (0.5 + 0.5 * normal.y);
    let diffuse = KEY_SHARE * facing.max(0.0) + EYE_SHARE * normal.dot(to_eye).max(0.0);
    if !SHINES {
        return colour * (ambient + diffuse);
    }
    let mirrored = normal * (2.0 * facing) - KEY;
    let shine = if facing > 0.0 { mirrored.dot(to_eye).max(0.0).powi(SHINE_POWER) } else { 0.0 };
    colour * (ambient + diffuse) + Vec3::splat(SHINE * shine)
}

/// About `exp(-x)` for x from 0; several times as fast.
#[inline]
fn darken(x: f32) -> f32 {
    1.0 / (1.0 + x * (1.0 + x * 0.5))
}
