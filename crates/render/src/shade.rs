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
use crate::relief::{DepthImage, ReliefScratch, Surroundings};
use crate::resolve::backdrop;
use crate::soften::{are_creases, is_crease};
use crate::surface::Surface;
use crate::values::{EIGHT, Values, dot, only};
use fearless_simd::{Level, Simd, SimdMask, dispatch, f32x8, mask32x8};
use glam::Vec3;
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

/// Lights a surface, whose depth image the picture has already, and writes its colours.
pub fn shade(
    camera: &Camera,
    surface: &impl Surface,
    background: Background,
    shines: bool,
    scratch: &mut ReliefScratch,
    picture: &mut Picture,
) -> Shaded {
    if shines {
        shade_as::<true, _>(camera, surface, background, scratch, picture)
    } else {
        shade_as::<false, _>(camera, surface, background, scratch, picture)
    }
}

/// As [`shade`], with highlights or without.
fn shade_as<const SHINES: bool, S: Surface>(
    camera: &Camera,
    surface: &S,
    background: Background,
    scratch: &mut ReliefScratch,
    picture: &mut Picture,
) -> Shaded {
    let [width, height] = surface.size();
    let is_bare = !surface.has_normals();
    let raw = DepthImage {
        width,
        depth: &picture.depth,
        focal_px: camera.focal_px,
        centre_px: camera.centre_px,
        // What smooths and tells slopes.
        radius_px: if is_bare { mean_radius_px(surface, &picture.depth) } else { 0.0 },
    };
    let relief = if is_bare { raw.smoothed(scratch) } else { raw };
    let nothing = vec![f32::INFINITY; width];
    let encoder = Encoder::get();
    let rows = picture.rgba.par_chunks_mut(width * 4).with_min_len(4).enumerate();
    let found = rows.map(|(y, row)| {
        let around = relief.surroundings(y, &nothing);
        let mut row = Row {
            camera,
            surface,
            depth: raw.depth,
            backdrop: backdrop(background, y, height),
            y,
            covered: 0,
            creases: Vec::new(),
            encoder,
            out: row.as_chunks_mut().0,
        };
        dispatch!(Level::new(), simd => row.shade::<_, SHINES>(simd, &around));
        (row.covered, row.creases)
    });
    let found: Vec<_> = found.collect();
    let covered = found.iter().map(|(count, _)| count).sum();
    let creases = found.into_iter().flat_map(|(_, creases)| creases).collect();
    Shaded { covered, creases }
}

/// A row of the picture that is shaded.
struct Row<'a, S> {
    camera: &'a Camera,
    surface: &'a S,
    /// Of the whole picture; infinite where it shows nothing.
    depth: &'a [f32],
    backdrop: [u8; 4],
    y: usize,
    covered: u64,
    creases: Vec<usize>,
    encoder: Encoder,
    out: &'a mut [[u8; 4]],
}

/// How eight pixels are lit.
struct Light<S: Simd> {
    /// What a colour is multiplied by.
    factor: f32x8<S>,
    /// What is added to it.
    shine: f32x8<S>,
}

impl<T: Surface> Row<'_, T> {
    #[inline(always)]
    fn shade<S: Simd, const SHINES: bool>(&mut self, simd: S, around: &Surroundings<'_>) {
        let [width, _] = self.surface.size();
        let depths = &self.depth[self.y * width..][..width];
        let nothing = simd.splat_f32x8(f32::INFINITY);
        for (first, run) in (0..).step_by(EIGHT).zip(depths.chunks(EIGHT)) {
            let depth = match run.first_chunk() {
                Some(eight) => simd.load_array_ref_f32x8(eight),
                None => simd.load_array_f32x8(filled(run)),
            };
            let is_valid = depth.cmplt(nothing);
            if !is_valid.any_true() {
                self.out[first..first + run.len()].fill(self.backdrop);
                continue;
            }
            let light = if self.surface.has_normals() {
                let normal = self.normals(simd, first, is_valid);
                let dark = around.sunken(simd, first, EDGE.1) * EDGE.0;
                self.light::<S, SHINES>(simd, first, normal, dark)
            } else {
                let normal = around.normals(simd, first);
                let dark = around.behind(simd, first, DOME.1) * DOME.0;
                self.light::<S, SHINES>(simd, first, normal, dark)
            };
            self.paint(simd, first, is_valid, &light);
        }
    }

    /// The interpolated normals of eight pixels, unit length; notes creases beside them.
    #[inline(always)]
    fn normals<S: Simd>(&mut self, simd: S, x: usize, is_valid: mask32x8<S>) -> [f32x8<S>; 3] {
        let [width, _] = self.surface.size();
        let [here, right, below] = self.surface.normals(simd, x, self.y);
        let may_bend = (are_creases(here, right) | are_creases(here, below)) & is_valid;
        if may_bend.any_true() {
            for k in lanes_of(may_bend) {
                if self.is_bent(x + k) {
                    self.creases.push(self.y * width + x + k);
                }
            }
        }
        let per_length = 1.0 / dot(here, here).sqrt();
        let mut normal = [here[0] * per_length, here[1] * per_length, here[2] * per_length];
        // As `Vec3::try_normalize` has it; points without a normal are few.
        let has_length = per_length.cmplt(per_length.like(f32::INFINITY))
            & per_length.like(0.0).cmplt(per_length);
        let is_lacking = is_valid & !has_length;
        if is_lacking.any_true() {
            for k in lanes_of(is_lacking) {
                let found = self.surface.normal_around(x + k, self.y);
                (0..3).for_each(|i| normal[i][k] = found[i]);
            }
        }
        normal
    }

    /// Phong lighting of eight pixels, darkened.
    #[inline(always)]
    fn light<S: Simd, const SHINES: bool>(
        &self,
        simd: S,
        x: usize,
        normal: [f32x8<S>; 3],
        dark: f32x8<S>,
    ) -> Light<S> {
        let zero = simd.splat_f32x8(0.0);
        // Without highlights the eye's soft light comes along the axis.
        let mut to_eye = [zero, zero, simd.splat_f32x8(1.0)];
        if SHINES {
            let columns = simd.load_array_f32x8([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
            let right = columns + (x as f32 + 0.5 - self.camera.centre_px[0]);
            let up = self.camera.centre_px[1] - self.y as f32 - 0.5;
            let focal = simd.splat_f32x8(self.camera.focal_px);
            let ray = [-right, simd.splat_f32x8(-up), focal];
            let per_length = 1.0 / dot(ray, ray).sqrt();
            to_eye = [ray[0] * per_length, ray[1] * per_length, ray[2] * per_length];
        }
        // A pixel without a normal, nor any above it, faces the eye.
        let is_none = dot(normal, normal).cmpeq(zero);
        let [nx, ny, nz] = normal;
        let normal = [
            f32x8::select(is_none, to_eye[0], nx),
            f32x8::select(is_none, to_eye[1], ny),
            f32x8::select(is_none, to_eye[2], nz),
        ];
        let [nx, ny, nz] = normal;
        let facing = nx * KEY.x + ny * KEY.y + nz * KEY.z;
        let ambient = (ny * 0.5 + 0.5) * (SKY_SHARE - GROUND_SHARE) + GROUND_SHARE;
        let towards = dot(normal, to_eye);
        let diffuse = facing.max(zero) * KEY_SHARE + towards.max(zero) * EYE_SHARE;
        let bright = darken(dark);
        let mut shine = zero;
        if SHINES {
            let twice = facing * 2.0;
            let mirrored = [nx * twice - KEY.x, ny * twice - KEY.y, nz * twice - KEY.z];
            // To the power of 24.
            let s1 = dot(mirrored, to_eye).max(zero);
            let s2 = s1 * s1;
            let s4 = s2 * s2;
            let s8 = s4 * s4;
            shine = only(zero.cmplt(facing), s8 * s8 * s8) * SHINE * bright;
        }
        Light { factor: (ambient + diffuse) * bright, shine }
    }

    /// Writes eight pixels; the backdrop where there is no surface.
    #[inline(always)]
    fn paint<S: Simd>(&mut self, simd: S, x: usize, is_valid: mask32x8<S>, light: &Light<S>) {
        let encoder = self.encoder;
        let [r, g, b] = self.surface.tints(simd, x, self.y);
        let r = Encoder::entries(r * light.factor + light.shine);
        let g = Encoder::entries(g * light.factor + light.shine);
        let b = Encoder::entries(b * light.factor + light.shine);
        let mut lit = [[0; 4]; EIGHT];
        for k in 0..EIGHT {
            // As one word, which is written at once.
            let (r, g, b) = (encoder.byte(r[k]), encoder.byte(g[k]), encoder.byte(b[k]));
            let rgb = u32::from(r) | u32::from(g) << 8 | u32::from(b) << 16;
            lit[k] = (rgb | 255 << 24).to_le_bytes();
        }
        match self.out[x..].first_chunk_mut() {
            Some(out) if is_valid.all_true() => {
                *out = lit;
                self.covered += EIGHT as u64;
            }
            _ => {
                for (k, out) in self.out[x..].iter_mut().take(EIGHT).enumerate() {
                    let is_valid = is_valid[k] != 0;
                    *out = if is_valid { lit[k] } else { self.backdrop };
                    self.covered += u64::from(is_valid);
                }
            }
        }
    }

    /// Whether the surface bends sharply to the right or below.
    #[inline]
    fn is_bent(&self, x: usize) -> bool {
        let [width, height] = self.surface.size();
        let here = self.surface.normal(x, self.y);
        let bent = |x: usize, y: usize| {
            x < width
                && y < height
                && is_crease(here, self.surface.normal(x, y))
                && self.depth[y * width + x] < f32::INFINITY
        };
        bent(x + 1, self.y) || bent(x, self.y + 1)
    }
}

/// Depths of fewer than eight pixels; infinite where there is none.
#[inline(never)]
fn filled(depth: &[f32]) -> [f32; EIGHT] {
    let mut eight = [f32::INFINITY; EIGHT];
    eight[..depth.len()].copy_from_slice(depth);
    eight
}

/// The pixels that a mask names.
#[inline(always)]
fn lanes_of<S: Simd>(mask: mask32x8<S>) -> impl Iterator<Item = usize> {
    (0..EIGHT).filter(move |&k| mask[k] != 0)
}

/// Mean radius over a sample of the pixels covered.
fn mean_radius_px(surface: &impl Surface, depth: &[f32]) -> f32 {
    /// A prime, so that the sample runs across columns.
    const EVERY: usize = 61;
    let [width, _] = surface.size();
    let covered = (0..depth.len()).step_by(EVERY).filter(|&i| depth[i] < f32::INFINITY);
    let (sum, count) = covered.fold((0.0, 0.0), |(sum, count), i| {
        (sum + surface.radius_px(i % width, i / width).min(width as f32), count + 1.0)
    });
    if count > 0.0 { sum / count } else { 0.0 }
}

/// About `exp(-x)` for x from 0; several times as fast.
#[inline(always)]
fn darken<S: Simd>(x: f32x8<S>) -> f32x8<S> {
    1.0 / (x * (x * 0.5 + 1.0) + 1.0)
}
