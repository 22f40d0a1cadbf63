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
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Direction to the key light, view space, unit length.
const KEY: Vec3 = Vec3::new(-0.42, 0.60, 0.6808);
/// Shares of the lights. Key, eye and the brighter ambient add up to a little over one.
const KEY_SHARE: f32 = 0.62;
const EYE_SHARE: f32 = 0.16;
const SKY_SHARE: f32 = 0.30;
const GROUND_SHARE: f32 = 0.12;
/// The strength of the highlight; Phong's exponent is 24.
const SHINE: f32 = 0.10;
/// How dark the farthest behind is (as an exponent), and up to which slope nothing darkens. With normals
/// only what lies behind an edge is set off, whatever its slope; without them the depth alone has to tell
/// the shape.
const EDGE: (f32, f32) = (1.0, 4.0);
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

/// As [`shade`], with highlights or without. By blocks of pixels: what is looked up is scattered into flat
/// arrays, and what is computed of them is straight arithmetic, which becomes SIMD.
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
    let raw = DepthImage {
        width,
        depth: &picture.depth,
        focal_px: camera.focal_px,
        centre_px: camera.centre_px,
        radius_px: mean_radius_px(base),
    };
    let relief = if has_normals { raw } else { raw.smoothed(scratch) };
    let nothing = vec![f32::INFINITY; width];
    let encoder = Encoder::get();
    let rows = picture.rgba.par_chunks_mut(width * 4).enumerate();
    let found = rows.map(|(y, row)| {
        let backdrop = backdrop(background, y, base.height);
        let around = relief.surroundings(y, &nothing);
        let (mut count, mut creases) = (0, Vec::new());
        for (first, out) in (0..).step_by(BLOCK).zip(row.as_chunks_mut::<4>().0.chunks_mut(BLOCK)) {
            let pixels = y * width + first..y * width + first + out.len();
            if base.front[pixels.clone()].iter().all(|f| f.x == f32::INFINITY) {
                out.fill(backdrop);
                continue;
            }
            let mut block = Block::default();
            if has_normals {
                block.take_normals(pyramid, first, y, out.len());
                around.sunken(first, EDGE.1, &mut block.dark[..out.len()]);
            } else {
                for (k, _) in pixels.clone().enumerate().filter(|&(_, p)| base.is_valid(p)) {
                    block.set_normal(k, around.normal(first + k));
                    block.dark[k] = around.behind(first + k, DOME.1);
                }
            }
            let dark = if has_normals { EDGE.0 } else { DOME.0 };
            block.light::<SHINES>(camera, first, y, dark);
            for ((k, out), pixel) in out.iter_mut().enumerate().zip(pixels) {
                if !base.is_valid(pixel) {
                    *out = backdrop;
                    continue;
                }
                let c = base.tint[pixel].truncate() * block.light[k] + Vec3::splat(block.shine[k]);
                let [r, g, b] = encoder.bytes(c);
                *out = [r, g, b, 255];
                count += 1;
                if block.may_bend[k] && is_bent(base, first + k, pixel) {
                    creases.push(pixel);
                }
            }
        }
        (count, creases)
    });
    let found: Vec<_> = found.collect();
    let covered = found.iter().map(|(count, _)| count).sum();
    let creases = found.into_iter().flat_map(|(_, creases)| creases).collect();
    Shaded { covered, creases }
}

/// Pixels that are lit together.
const BLOCK: usize = 32;

/// What lights a run of pixels: normals in view space, how dark each is, and what comes of it.
struct Block {
    normal: [[f32; BLOCK]; 3],
    dark: [f32; BLOCK],
    /// What a colour is multiplied by.
    light: [f32; BLOCK],
    /// What is added to it.
    shine: [f32; BLOCK],
    /// Whether the normal to the right or below makes a crease, if there is a surface.
    may_bend: [bool; BLOCK],
}

impl Default for Block {
    fn default() -> Self {
        let zero = [0.0; BLOCK];
        let normal = [zero, zero, [1.0; BLOCK]];
        Self { normal, dark: zero, light: zero, shine: zero, may_bend: [false; BLOCK] }
    }
}

impl Block {
    fn set_normal(&mut self, k: usize, normal: Vec3) {
        for (axis, c) in self.normal.iter_mut().zip(normal.to_array()) {
            axis[k] = c;
        }
    }

    /// The interpolated normals of a run of `count` pixels, unit length.
    fn take_normals(&mut self, pyramid: &Pyramid, first: usize, y: usize, count: usize) {
        let base = &pyramid.levels[0];
        let pixels = y * base.width + first..y * base.width + first + count;
        flat(&base.normal[pixels.clone()], &mut self.normal);
        for beside in [pixels.start + 1, pixels.start + base.width] {
            let mut normals = [[0.0; BLOCK]; 3];
            let end = (beside + count).min(base.normal.len());
            flat(&base.normal[beside.min(end)..end], &mut normals);
            let at = |of: &[[f32; BLOCK]; 3], k: usize| Vec3::new(of[0][k], of[1][k], of[2][k]);
            for k in 0..BLOCK {
                self.may_bend[k] |= is_crease(at(&self.normal, k), at(&normals, k));
            }
        }
        let [xs, ys, zs] = &mut self.normal;
        let mut per_length = [0.0; BLOCK];
        for k in 0..BLOCK {
            per_length[k] = 1.0 / (xs[k] * xs[k] + ys[k] * ys[k] + zs[k] * zs[k]).sqrt();
        }
        for k in 0..BLOCK {
            xs[k] *= per_length[k];
            ys[k] *= per_length[k];
            zs[k] *= per_length[k];
        }
        for (k, pixel) in pixels.enumerate() {
            // As `Vec3::try_normalize` has it; points without a normal are few.
            if !(per_length[k].is_finite() && per_length[k] > 0.0) && base.is_valid(pixel) {
                let found = normal_at(pyramid, first + k, y);
                self.set_normal(k, found.unwrap_or(NO_NORMAL));
            }
        }
    }

    /// Phong lighting, darkened.
    fn light<const SHINES: bool>(&mut self, camera: &Camera, first: usize, y: usize, dark: f32) {
        let [xs, ys, zs] = &self.normal;
        let up = camera.centre_px[1] - y as f32 - 0.5;
        for k in 0..BLOCK {
            let normal = Vec3::new(xs[k], ys[k], zs[k]);
            // Without highlights the eye's soft light comes along the axis.
            let mut to_eye = Vec3::Z;
            if SHINES {
                let right = (first + k) as f32 + 0.5 - camera.centre_px[0];
                let ray = Vec3::new(-right, -up, camera.focal_px);
                to_eye = ray * (1.0 / ray.length());
            }
            // A pixel without a normal, nor any above it, faces the eye.
            let normal = if normal == NO_NORMAL { to_eye } else { normal };
            let facing = normal.dot(KEY);
            let ambient = GROUND_SHARE + (SKY_SHARE - GROUND_SHARE) * (0.5 + 0.5 * normal.y);
            let diffuse = KEY_SHARE * facing.max(0.0) + EYE_SHARE * normal.dot(to_eye).max(0.0);
            let bright = darken(dark * self.dark[k]);
            self.light[k] = (ambient + diffuse) * bright;
            if SHINES {
                let mirrored = normal * (2.0 * facing) - KEY;
                // To the power of 24.
                let s1 = mirrored.dot(to_eye).max(0.0);
                let s2 = s1 * s1;
                let s4 = s2 * s2;
                let s8 = s4 * s4;
                let shine = if facing > 0.0 { s8 * s8 * s8 } else { 0.0 };
                self.shine[k] = SHINE * shine * bright;
            }
        }
    }
}

/// A run of normals, axis by axis.
fn flat(normals: &[Vec4], out: &mut [[f32; BLOCK]; 3]) {
    let [xs, ys, zs] = out;
    for (((x, y), z), normal) in xs.iter_mut().zip(ys).zip(zs).zip(normals) {
        (*x, *y, *z) = (normal.x, normal.y, normal.z);
    }
}

/// Stands for no normal at all.
const NO_NORMAL: Vec3 = Vec3::ZERO;

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

/// About `exp(-x)` for x from 0; several times as fast.
#[inline]
fn darken(x: f32) -> f32 {
    1.0 / (1.0 + x * (1.0 + x * 0.5))
}
