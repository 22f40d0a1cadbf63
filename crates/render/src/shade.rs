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
use crate::lanes::{LANES, Lane, Mask, counting, only, valid};
use crate::relief::{DepthImage, ReliefScratch, Surroundings};
use crate::resolve::backdrop;
use crate::soften::{are_creases, is_crease};
use crate::surface::Surface;
use fearless_simd::{Level as Simd, dispatch};
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
        dispatch!(Simd::new(), _ => row.shade::<SHINES>(&around));
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

/// How four pixels are lit.
struct Light {
    /// What a colour is multiplied by.
    factor: Lane,
    /// What is added to it.
    shine: Lane,
}

impl<S: Surface> Row<'_, S> {
    #[inline(always)]
    fn shade<const SHINES: bool>(&mut self, around: &Surroundings<'_>) {
        let [width, _] = self.surface.size();
        let depths = &self.depth[self.y * width..][..width];
        for (first, depth) in (0..).step_by(LANES).zip(depths.chunks(LANES)) {
            let is_valid = valid(match depth.first_chunk() {
                Some(&four) => Vec4::from_array(four),
                None => filled(depth),
            });
            if !is_valid.any() {
                self.out[first..first + depth.len()].fill(self.backdrop);
                continue;
            }
            let light = if !self.surface.has_normals() {
                let (mut normal, mut dark) = ([Vec4::ZERO; 3], Vec4::ZERO);
                for k in (0..depth.len()).filter(|&k| is_valid.test(k)) {
                    let found = around.normal(first + k);
                    (0..3).for_each(|i| normal[i][k] = found[i]);
                    dark[k] = around.behind(first + k, DOME.1);
                }
                self.light::<SHINES>(first, normal, dark * DOME.0)
            } else {
                let normal = self.normals(first, is_valid);
                self.light::<SHINES>(first, normal, around.sunken(first, EDGE.1) * EDGE.0)
            };
            self.paint(first, is_valid, &light);
        }
    }

    /// The interpolated normals of four pixels, unit length; notes creases beside them.
    #[inline(always)]
    fn normals(&mut self, x: usize, is_valid: Mask) -> [Lane; 3] {
        let [width, _] = self.surface.size();
        let end = width - x;
        let here = self.surface.normals(x, self.y);
        let beside = [self.surface.normals(x + 1, self.y), self.surface.normals(x, self.y + 1)];
        let may_bend = are_creases(here, beside[0]) | are_creases(here, beside[1]);
        let may_bend = (may_bend & is_valid).bitmask();
        if may_bend != 0 {
            for k in (0..LANES.min(end)).filter(|k| may_bend >> k & 1 == 1) {
                if self.is_bent(x + k) {
                    self.creases.push(self.y * width + x + k);
                }
            }
        }
        let squared = dot(here, here);
        let per_length = 1.0 / squared.sqrt();
        let mut normal = [here[0] * per_length, here[1] * per_length, here[2] * per_length];
        // As `Vec3::try_normalize` has it; points without a normal are few.
        let has_length = valid(per_length) & per_length.cmpgt(Vec4::ZERO);
        let lacking = (is_valid & !has_length).bitmask();
        for k in (0..LANES.min(end)).filter(|k| lacking >> k & 1 == 1) {
            let found = self.surface.normal_around(x + k, self.y);
            (0..3).for_each(|i| normal[i][k] = found[i]);
        }
        normal
    }

    /// Phong lighting of four pixels, darkened.
    #[inline(always)]
    fn light<const SHINES: bool>(&self, x: usize, normal: [Lane; 3], dark: Lane) -> Light {
        let key = [Vec4::splat(KEY.x), Vec4::splat(KEY.y), Vec4::splat(KEY.z)];
        // Without highlights the eye's soft light comes along the axis.
        let mut to_eye = [Vec4::ZERO, Vec4::ZERO, Vec4::ONE];
        if SHINES {
            let right = counting(x as f32 + 0.5 - self.camera.centre_px[0], 1.0);
            let up = self.camera.centre_px[1] - self.y as f32 - 0.5;
            let ray = [-right, Vec4::splat(-up), Vec4::splat(self.camera.focal_px)];
            let per_length = 1.0 / dot(ray, ray).sqrt();
            to_eye = [ray[0] * per_length, ray[1] * per_length, ray[2] * per_length];
        }
        // A pixel without a normal, nor any above it, faces the eye.
        let is_none = dot(normal, normal).cmpeq(Vec4::ZERO);
        let or_eye = |i: usize| Vec4::select(is_none, to_eye[i], normal[i]);
        let normal = [or_eye(0), or_eye(1), or_eye(2)];
        let facing = dot(normal, key);
        let ambient = (normal[1] * 0.5 + 0.5) * (SKY_SHARE - GROUND_SHARE) + GROUND_SHARE;
        let towards = dot(normal, to_eye);
        let diffuse = facing.max(Vec4::ZERO) * KEY_SHARE + towards.max(Vec4::ZERO) * EYE_SHARE;
        let bright = darken(dark);
        let mut shine = Vec4::ZERO;
        if SHINES {
            let mirror = |i: usize| normal[i] * (facing * 2.0) - key[i];
            let mirrored = [mirror(0), mirror(1), mirror(2)];
            // To the power of 24.
            let s1 = dot(mirrored, to_eye).max(Vec4::ZERO);
            let s2 = s1 * s1;
            let s4 = s2 * s2;
            let s8 = s4 * s4;
            shine = only(facing.cmpgt(Vec4::ZERO), s8 * s8 * s8) * SHINE * bright;
        }
        Light { factor: (ambient + diffuse) * bright, shine }
    }

    /// Writes four pixels; the backdrop where there is no surface.
    #[inline(always)]
    fn paint(&mut self, x: usize, is_valid: Mask, light: &Light) {
        let encoder = self.encoder;
        let count = LANES.min(self.surface.size()[0] - x);
        let [r, g, b] = self.surface.tints(x, self.y);
        let entries = |c: Lane| Encoder::entries(c * light.factor + light.shine);
        let (r, g, b) = (entries(r), entries(g), entries(b));
        let bits = is_valid.bitmask();
        self.covered += u64::from(bits.count_ones());
        for (k, out) in self.out[x..x + count].iter_mut().enumerate() {
            let lit = [encoder.byte(r[k]), encoder.byte(g[k]), encoder.byte(b[k]), 255];
            *out = if bits >> k & 1 == 1 { lit } else { self.backdrop };
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

/// Depths of fewer than four pixels; infinite where there is none.
#[inline(never)]
fn filled(depth: &[f32]) -> Lane {
    let mut four = [f32::INFINITY; LANES];
    four[..depth.len()].copy_from_slice(depth);
    Vec4::from_array(four)
}

#[inline(always)]
fn dot(a: [Lane; 3], b: [Lane; 3]) -> Lane {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
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
fn darken(x: Lane) -> Lane {
    1.0 / (x * (x * 0.5 + 1.0) + 1.0)
}
