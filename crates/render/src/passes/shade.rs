//! Shade (`marroquim2007`, section 3.4): deferred Phong lighting of the filled picture, with the
//! interpolated normals, or with normals from the smoothed depth where the cloud has none
//! ([`crate::passes::smooth_depth`]). In linear light; the result is encoded as sRGB.
//!
//! The lights move with the viewer: a key light from the upper left, a soft light from the eye, and
//! an ambient hemisphere, brighter above. Pixels behind their surroundings are darkened, which sets
//! surfaces off from each other (eye-dome lighting, `boucheny2009`).

use crate::frame::{Background, Picture};
use crate::inputs::camera::Camera;
use crate::inputs::colour::words;
use crate::passes::antialias::{are_creases, is_crease};
use crate::passes::resolve::backdrop;
use crate::passes::smooth_depth::{DepthImage, SmoothDepthScratch, Surroundings};
use crate::picture::marks::Marks;
use crate::picture::surface::{Surface, SurfaceRow};
use crate::simd::values::{EIGHT, Values, bits, dot, load, only};
use fearless_simd::{ExtractToken, Level, Select, Simd, SimdMask, dispatch, f32x8, mask32x8};
use glam::Vec3;
use rayon::prelude::*;

/// Direction to the key light, view space, unit length.
pub(crate) const KEY: Vec3 = Vec3::new(-0.42, 0.60, 0.6808);
/// Shares of the lights. Key, eye and the brighter ambient add up to a little over one.
pub(crate) const KEY_SHARE: f32 = 0.62;
pub(crate) const EYE_SHARE: f32 = 0.16;
pub(crate) const SKY_SHARE: f32 = 0.30;
pub(crate) const GROUND_SHARE: f32 = 0.12;
/// Strength of the highlight; its Phong exponent is 24.
pub(crate) const SHINE: f32 = 0.10;
/// Greatest darkness of a pixel behind its surroundings (as an exponent), and slope up to which
/// nothing darkens. With normals only surfaces behind an edge are darkened, whatever their slope
/// ([`Surroundings::sunken`]), and none of splats; without normals depth alone shows the shape
/// ([`Surroundings::behind`]).
pub(crate) const EDGE: (f32, f32) = (1.0, 4.0);
pub(crate) const DOME: (f32, f32) = (2.0, 0.5);

/// What [`shade`] returns.
pub struct Shaded {
    /// Pixels that show a surface.
    pub covered: u64,
    /// Pixels beside which the surface bends sharply.
    pub creases: Marks,
}

/// Lights a surface, whose depth image `picture` has already, and writes its colours, with
/// highlights if it `shines`. A surface without normals takes those of `smooth`, which
/// [`crate::passes::smooth_depth::smooth_depth`] filled.
pub fn shade(
    camera: &Camera,
    surface: &impl Surface,
    background: Background,
    shines: bool,
    smooth: &SmoothDepthScratch,
    picture: &mut Picture,
) -> Shaded {
    if shines {
        shade_as::<true, _>(camera, surface, background, smooth, picture)
    } else {
        shade_as::<false, _>(camera, surface, background, smooth, picture)
    }
}

/// [`shade`] compiled with highlights or without.
fn shade_as<const SHINES: bool, S: Surface>(
    camera: &Camera,
    surface: &S,
    background: Background,
    smooth: &SmoothDepthScratch,
    picture: &mut Picture,
) -> Shaded {
    let [width, height] = surface.size();
    let raw = DepthImage::new(camera, &picture.depth, None);
    let shape = if surface.has_normals() { raw } else { smooth.image(camera) };
    let nothing = vec![f32::INFINITY; width];
    let rows = picture.rgba.par_chunks_mut(width * 4).with_min_len(4).enumerate();
    let found = rows.map(|(y, row)| {
        let around = shape.surroundings(y, &nothing);
        let mut row = Row {
            camera,
            surface,
            depth: raw.depth,
            backdrop: backdrop(background, camera.backdrop_row(y)),
            y,
            covered: 0,
            creases: Vec::new(),
            out: row.as_chunks_mut().0,
        };
        let pixels = surface.row(y);
        dispatch!(Level::new(), simd => row.shade::<_, SHINES>(simd, &pixels, &around));
        (row.covered, row.creases)
    });
    let found: Vec<_> = found.collect();
    let covered = found.iter().map(|(count, _)| count).sum();
    let mut creases = Marks::new(width, height);
    found.iter().flat_map(|(_, pixels)| pixels).for_each(|&pixel| creases.set(pixel));
    Shaded { covered, creases }
}

/// A row of the picture that is being shaded.
struct Row<'a, S> {
    camera: &'a Camera,
    surface: &'a S,
    /// Depth of the whole picture; infinite where it is empty.
    depth: &'a [f32],
    backdrop: [u8; 4],
    y: usize,
    covered: u64,
    creases: Vec<usize>,
    out: &'a mut [[u8; 4]],
}

/// Light on eight pixels.
struct Light<S: Simd> {
    /// Factor of the colours.
    factor: f32x8<S>,
    /// Highlight, which is added to the colours.
    shine: f32x8<S>,
}

impl<T: Surface> Row<'_, T> {
    #[inline(always)]
    fn shade<S: Simd, const SHINES: bool>(
        &mut self,
        simd: S,
        pixels: &impl SurfaceRow,
        around: &Surroundings<'_>,
    ) {
        let [width, _] = self.surface.size();
        let depths = &self.depth[self.y * width..][..width];
        let nothing = simd.splat_f32x8(f32::INFINITY);
        for (first, run) in (0..).step_by(EIGHT).zip(depths.chunks(EIGHT)) {
            let depth = match run.first_chunk() {
                Some(eight) => load(simd, eight),
                None => load(simd, &filled(run)),
            };
            let is_valid = depth.cmplt(nothing);
            if !is_valid.any_true() {
                self.out[first..first + run.len()].fill(self.backdrop);
                continue;
            }
            let to_eye = self.to_eye::<S, SHINES>(simd, first);
            let (normal, dark) = if self.surface.has_normals() {
                let normals = pixels.normals(simd, first);
                let (normal, is_bare) = self.normals(normals, first, is_valid, to_eye);
                let mut dark = simd.splat_f32x8(0.0);
                if self.surface.darkens_edges() {
                    dark = around.sunken(simd, first, EDGE.1) * EDGE.0;
                }
                if is_bare.any_true() {
                    // Depth alone shows the shape of what has no normal.
                    let behind = around.behind(simd, first, DOME.1) * DOME.0;
                    dark = is_bare.select(behind, dark);
                }
                (normal, dark)
            } else {
                (around.normals(simd, first), around.behind(simd, first, DOME.1) * DOME.0)
            };
            let light = light::<S, SHINES>(normal, to_eye, dark);
            self.paint(pixels.tints(simd, first), first, is_valid, &light);
        }
    }

    /// Directions from the surface to the eye at eight pixels. Without highlights this is the view
    /// axis, along which the soft light from the eye then falls.
    #[inline(always)]
    fn to_eye<S: Simd, const SHINES: bool>(&self, simd: S, x: usize) -> [f32x8<S>; 3] {
        if SHINES {
            return self.camera.to_eye(simd, x, self.y);
        }
        let (zero, one) = (simd.splat_f32x8(0.0), simd.splat_f32x8(1.0));
        [zero, zero, one]
    }

    /// Unit normals of eight pixels, and which of them have none, and face the eye. Given are the
    /// interpolated normals of these pixels, and of
    /// those to the right and below. Appends the creases beside them to `creases`.
    #[inline(always)]
    fn normals<S: Simd>(
        &mut self,
        [here, right, below]: [[f32x8<S>; 3]; 3],
        x: usize,
        is_valid: mask32x8<S>,
        to_eye: [f32x8<S>; 3],
    ) -> ([f32x8<S>; 3], mask32x8<S>) {
        let [width, _] = self.surface.size();
        let may_bend = (are_creases(here, right) | are_creases(here, below)) & is_valid;
        if may_bend.any_true() {
            for k in lanes_of(may_bend) {
                if self.is_bent(x + k) {
                    self.creases.push(self.y * width + x + k);
                }
            }
        }
        let per_length = 1.0 / dot(here, here).sqrt();
        let normal = [here[0] * per_length, here[1] * per_length, here[2] * per_length];
        // Equal to `Vec3::try_normalize`; points without a normal are few.
        let has_length = per_length.cmplt(per_length.like(f32::INFINITY))
            & per_length.like(0.0).cmplt(per_length);
        let is_lacking = is_valid & !has_length;
        if is_lacking.any_true() {
            return self.with_normals_around(x, is_lacking, normal, to_eye);
        }
        (normal, is_lacking)
    }

    /// Replaces lacking normals by those of pixels around, or by the direction to the eye if there
    /// are none: those pixels are returned as well.
    #[inline(always)]
    fn with_normals_around<S: Simd>(
        &self,
        x: usize,
        is_lacking: mask32x8<S>,
        normal: [f32x8<S>; 3],
        to_eye: [f32x8<S>; 3],
    ) -> ([f32x8<S>; 3], mask32x8<S>) {
        let simd = is_lacking.token();
        let mut normal = normal.map(|part| *part);
        let mut bare = [0.0; EIGHT];
        for k in lanes_of(is_lacking) {
            let found = self.surface.normal_around(x + k, self.y);
            let is_found = found != Vec3::ZERO;
            bare[k] = if is_found { 0.0 } else { 1.0 };
            (0..3).for_each(|i| normal[i][k] = if is_found { found[i] } else { to_eye[i][k] });
        }
        let bare = load(simd, &bare);
        (normal.map(|part| load(simd, &part)), bare.like(0.0).cmplt(bare))
    }

    /// Writes eight pixels, with the background where there is no surface.
    #[inline(always)]
    fn paint<S: Simd>(
        &mut self,
        [r, g, b]: [f32x8<S>; 3],
        x: usize,
        is_valid: mask32x8<S>,
        light: &Light<S>,
    ) {
        let lit = words([
            r.mul_add(light.factor, light.shine),
            g.mul_add(light.factor, light.shine),
            b.mul_add(light.factor, light.shine),
        ]);
        let backdrop = r.token().splat_u32x8(u32::from_le_bytes(self.backdrop));
        let words = <[u32; EIGHT]>::from(is_valid.select(lit, backdrop));
        let shown = words.map(u32::to_le_bytes);
        let room = &mut self.out[x..];
        match room.first_chunk_mut() {
            Some(out) => *out = shown,
            None => write_last(shown, room),
        }
        self.covered += u64::from(bits(is_valid).count_ones());
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

/// Phong lighting of one colour, linear light: what [`shade`] computes of a pixel before it darkens
/// what lies behind its surroundings. Directions are in view space, of unit length.
pub fn phong(colour: Vec3, normal: Vec3, to_eye: Vec3, shines: bool) -> Vec3 {
    let facing = normal.dot(KEY);
    let ambient = GROUND_SHARE + (SKY_SHARE - GROUND_SHARE) * (0.5 + 0.5 * normal.y);
    let towards = normal.dot(to_eye);
    let lit = colour * (ambient + KEY_SHARE * facing.max(0.0) + EYE_SHARE * towards.max(0.0));
    if !shines || facing <= 0.0 {
        return lit;
    }
    let mirrored = (2.0 * facing * towards - KEY.dot(to_eye)).max(0.0);
    lit + SHINE * mirrored.powi(24)
}

/// Phong lighting of eight pixels, darkened.
#[inline(always)]
fn light<S: Simd, const SHINES: bool>(
    normal: [f32x8<S>; 3],
    to_eye: [f32x8<S>; 3],
    dark: f32x8<S>,
) -> Light<S> {
    let like = |value: f32| dark.like(value);
    let zero = like(0.0);
    let facing = dot(normal, KEY.to_array().map(like));
    // From below to above.
    let ambient = normal[1]
        .mul_add(like((SKY_SHARE - GROUND_SHARE) / 2.0), like((SKY_SHARE + GROUND_SHARE) / 2.0));
    let towards = dot(normal, to_eye);
    let lit = facing.max(zero).mul_add(like(KEY_SHARE), ambient);
    let lit = towards.max(zero).mul_add(like(EYE_SHARE), lit);
    let bright = darken(dark);
    let mut shine = zero;
    if SHINES {
        // The mirror direction of the key light, seen from the eye.
        let s1 = (facing * 2.0).mul_add(towards, -dot(KEY.to_array().map(like), to_eye)).max(zero);
        // To the power of 24.
        let s2 = s1 * s1;
        let s4 = s2 * s2;
        let s8 = s4 * s4;
        shine = only(zero.cmplt(facing), s8 * s8 * s8) * (bright * SHINE);
    }
    Light { factor: lit * bright, shine }
}

/// Writes fewer than eight pixels. A function of its own, or both copies would have a variable
/// length.
#[inline(never)]
fn write_last(shown: [[u8; 4]; EIGHT], room: &mut [[u8; 4]]) {
    room.copy_from_slice(&shown[..room.len()]);
}

/// Depths of fewer than eight pixels, filled up with infinity.
#[inline(never)]
fn filled(depth: &[f32]) -> [f32; EIGHT] {
    let mut eight = [f32::INFINITY; EIGHT];
    eight[..depth.len()].copy_from_slice(depth);
    eight
}

/// Indices of the lanes in which a mask is set.
#[inline(always)]
fn lanes_of<S: Simd>(mask: mask32x8<S>) -> impl Iterator<Item = usize> {
    (0..EIGHT).filter(move |&k| mask.test(k))
}

/// Approximates `exp(-x)` for x from 0, several times as fast.
#[inline(always)]
fn darken<S: Simd>(x: f32x8<S>) -> f32x8<S> {
    1.0 / (x * (x * 0.5 + 1.0) + 1.0)
}
