//! The three passes of zwicker2004 section 6, tile by tile, so that what they share stays in the cache:
//! visibility (the front's inverse depth, moved back), attributes (sums with weights, over what is not behind
//! that), and normalisation (sums over the sum of weights), into level 0 of the pyramid, which is shaded
//! afterwards. Rows of an ellipse are walked between its two crossings, four pixels at a time.

use super::clip::{Lines, WHOLE};
use super::gauss::falloff;
use super::place::{Run, TILE, unpacked};
use super::splat::{Splat, WIDENED};
use crate::camera::Camera;
use crate::pyramid::{INVALID, Level};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;
use std::ops::Range;

/// Pixels worked on at once.
const LANES: usize = 4;
/// Pixels of a tile's row in its buffers: what is worked on at once may end past the tile.
const STRIDE: usize = TILE + LANES;
/// Offsets of pixels worked on at once.
const LANE: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

/// Square of the length under which a sum of normals has no direction.
const UNKNOWN: f32 = 1e-8;

/// How splats are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Passes {
    /// The nearest splat shows, without blending (the paper's table 1).
    One,
    /// Visibility, attributes, normalisation.
    #[default]
    Three,
}

/// What all tiles are drawn with.
#[derive(Clone, Copy, Debug)]
pub struct Blend<'a> {
    /// The splats.
    pub runs: &'a [Run],
    /// Half the square of the cutoff.
    pub half_cutoff: f32,
    /// How.
    pub passes: Passes,
    /// The frame's camera.
    pub camera: &'a Camera,
    /// Whether the cloud has normals.
    pub has_normals: bool,
}

/// A tile's sums.
struct Sums {
    /// The front's inverse depth, moved back; 0 where nothing is.
    front: Vec<f32>,
    /// Red, green, blue and the weight; normal (or radius) and inverse depth. All times the weight.
    sums: Vec<[Vec4; 2]>,
}

/// The part of the picture that a tile is.
struct Window {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Blend<'_> {
    /// Draws all tiles to `base` and its depths (infinite where nothing is) to `depth`. Returns the number of
    /// pixels covered.
    pub fn draw(&self, base: &mut Level, depth: &mut [f32]) -> u64 {
        let (width, height) = (base.width, base.height);
        let has_normals = self.has_normals;
        let band = width * TILE;
        let Level { front, tint, depth: base_depth, normal, .. } = base;
        let mut normals: Vec<&mut [Vec4]> = normal.chunks_mut(band).collect();
        normals.resize_with(height.div_ceil(TILE), Default::default);
        front
            .par_chunks_mut(band)
            .zip(tint.par_chunks_mut(band))
            .zip(base_depth.par_chunks_mut(band))
            .zip(depth.par_chunks_mut(band))
            .zip(normals)
            .enumerate()
            .map(|(row, ((((front, tint), base_depth), depth), normal))| {
                let mut sums = Sums {
                    front: vec![0.0; STRIDE * TILE],
                    sums: vec![[Vec4::ZERO; 2]; STRIDE * TILE],
                };
                let mut covered = 0;
                for column in 0..width.div_ceil(TILE) {
                    let window = Window {
                        left: column * TILE,
                        top: row * TILE,
                        width: TILE.min(width - column * TILE),
                        height: TILE.min(height - row * TILE),
                    };
                    let tile = row * width.div_ceil(TILE) + column;
                    self.tile(tile, &window, &mut sums);
                    for y in 0..window.height {
                        for x in 0..window.width {
                            let at = y * width + window.left + x;
                            let place = [window.left + x, window.top + y];
                            let sums = &sums.sums[y * STRIDE + x];
                            let Some(pixel) = self.normalised(sums, place) else {
                                (front[at], depth[at]) = (INVALID, f32::INFINITY);
                                continue;
                            };
                            front[at] = Vec4::new(pixel.depth, pixel.depth, 0.0, 0.0);
                            tint[at] = pixel.tint;
                            (base_depth[at], depth[at]) = (pixel.depth, pixel.depth);
                            if has_normals {
                                normal[at] = pixel.normal;
                            }
                            covered += 1;
                        }
                    }
                }
                covered
            })
            .sum()
    }

    fn tile(&self, tile: usize, window: &Window, sums: &mut Sums) {
        sums.front.fill(0.0);
        sums.sums.fill([Vec4::ZERO; 2]);
        match self.passes {
            Passes::Three => {
                self.for_each(tile, |splat, lines| self.visibility(splat, lines, window, sums));
                self.for_each(tile, |splat, lines| {
                    self.attributes::<true>(splat, lines, window, sums);
                });
            }
            Passes::One => self.for_each(tile, |splat, lines| {
                self.attributes::<false>(splat, lines, window, sums);
            }),
        }
    }

    /// Gives the splats of a tile in their order, with the lines of those that are clipped.
    #[inline(always)]
    fn for_each(&self, tile: usize, mut work: impl FnMut(&Splat, Option<&Lines>)) {
        for run in self.runs {
            if run.clips() {
                let both = run.of_tile(tile).zip(run.lines_of_tile(tile));
                both.for_each(|(splat, lines)| {
                    work(splat, Some(lines).filter(|l| l.kept != WHOLE));
                });
            } else {
                run.of_tile(tile).for_each(|splat| work(splat, None));
            }
        }
    }

    /// Gives the pixels of a tile that are inside a splat and that its lines keep.
    #[inline(always)]
    fn for_each_kept(
        &self,
        splat: &Splat,
        lines: Option<&Lines>,
        window: &Window,
        mut work: impl FnMut(usize, Pixels),
    ) {
        let near = self.camera.near;
        let Some(lines) = lines else { return for_each_run(splat, window, near, work) };
        let [cx, cy] = self.camera.centre_px;
        for_each_run(splat, window, near, |at, mut pixels| {
            let (x, y) = (window.left + at % STRIDE, window.top + at / STRIDE);
            // The same for all splats on a pixel.
            let x = LANE + (x as f32 + 0.5) - cx;
            pixels.inside *= lines.inside(x, y as f32 + 0.5 - cy);
            work(at, pixels);
        });
    }

    /// Pass 1.
    fn visibility(&self, splat: &Splat, lines: Option<&Lines>, window: &Window, sums: &mut Sums) {
        // Nothing of a disc is nearer than this.
        let nearest = Vec4::splat(splat.form[5]);
        self.for_each_kept(splat, lines, window, |at, pixels| {
            let moved = if splat.is_by_rays() {
                pixels.inverse_depth / (pixels.inverse_depth * -splat.back + 1.0)
            } else {
                pixels.inverse_depth.min(nearest) - splat.back
            };
            let moved = (moved * pixels.inside).to_array();
            for (front, moved) in sums.front[at..at + LANES].iter_mut().zip(moved) {
                *front = front.max(moved);
            }
        });
    }

    /// Pass 2; or the only one, where a splat in front takes the pixel.
    fn attributes<const BLENDS: bool>(
        &self,
        splat: &Splat,
        lines: Option<&Lines>,
        window: &Window,
        sums: &mut Sums,
    ) {
        let tint = Vec3::from_array(splat.tint).extend(1.0);
        let shape = if self.has_normals {
            unpacked(splat.normal).extend(1.0)
        } else {
            Vec4::new(f32::from_bits(splat.normal), 0.0, 0.0, 1.0)
        };
        let amplitude = if splat.is_by_rays() { 1.0 } else { splat.form[3].abs() };
        self.for_each_kept(splat, lines, window, |at, pixels| {
            let front = Vec4::from_slice(&sums.front[at..at + LANES]);
            let seen = if BLENDS {
                pixels.inverse_depth.cmpge(front)
            } else {
                pixels.inverse_depth.cmpgt(front)
            };
            if !seen.any() {
                return;
            }
            let weight = falloff(pixels.squared * self.half_cutoff) * (pixels.inside * amplitude);
            let weight = Vec4::select(seen, weight, Vec4::ZERO).to_array();
            let z = pixels.inverse_depth.to_array();
            let sums_here = &mut sums.sums[at..at + LANES];
            for (k, [a, b]) in sums_here.iter_mut().enumerate() {
                let shape = Vec4::new(shape.x, shape.y, shape.z, z[k]);
                if BLENDS {
                    // Without a branch: what is not seen adds nothing.
                    *a += tint * weight[k];
                    *b += shape * weight[k];
                } else if weight[k] > 0.0 {
                    (*a, *b) = (tint, shape);
                    sums.front[at + k] = z[k];
                }
            }
        });
    }

    /// Pass 3.
    fn normalised(&self, [a, b]: &[Vec4; 2], place: [usize; 2]) -> Option<Pixel> {
        (a.w > 0.0).then(|| {
            let share = 1.0 / a.w;
            let normal = if self.has_normals {
                let mut n = self.camera.to_view(b.truncate() * share);
                if n.length_squared() < UNKNOWN {
                    // None is known: it faces the eye.
                    let [x, y] = place.map(|c| c as f32 + 0.5);
                    let [middle_x, middle_y] = self.camera.centre_px;
                    let to_eye = Vec3::new(middle_x - x, y - middle_y, self.camera.focal_px);
                    n = to_eye.normalize_or(Vec3::Z);
                }
                n.extend(n.z)
            } else {
                Vec4::ZERO
            };
            let radius_px = if self.has_normals { 1.0 } else { b.x * share };
            let tint = (a.truncate() * share).extend(radius_px);
            Pixel { depth: 1.0 / (b.w * share), tint, normal }
        })
    }
}

struct Pixel {
    depth: f32,
    tint: Vec4,
    normal: Vec4,
}

/// Neighbouring pixels of a row under a splat.
struct Pixels {
    /// 1 for those that are inside, else 0.
    inside: Vec4,
    /// Square of the place in the splat, 1 at the cutoff.
    squared: Vec4,
    /// Positive, finite.
    inverse_depth: Vec4,
}

/// Gives the pixels of a tile that are inside a splat, up to four at a time with the place of the first in the
/// tile's buffers.
#[inline(always)]
fn for_each_run(splat: &Splat, window: &Window, near: f32, mut work: impl FnMut(usize, Pixels)) {
    if splat.is_by_rays() {
        for_each_run_by_rays(splat, window, near, work);
        return;
    }
    let [mx, my] = splat.origin;
    let [across, shear, along, amplitude, least, greatest] = splat.form;
    let [z, z_x, z_y] = splat.inverse_depth;
    // The exact Gaussian of an ellipse: section 4.4's conic is that of the plane times the square of the inverse
    // depth, so what a weight lacks to the cutoff goes by that.
    let mend = if amplitude < 0.0 { least * greatest } else { 0.0 };
    let (half_width, half_height) = (1.0 / across, 1.0 / along);
    let skew = shear * half_width;
    let (far, near) = (Vec4::splat(least * WIDENED), Vec4::splat(greatest / WIDENED));
    for y in rows(my, half_height, window) {
        let dy = (window.top + y) as f32 + 0.5 - my;
        let v = along * dy;
        let half = (1.0 - v * v).max(0.0).sqrt() * half_width;
        let middle = mx + skew * dy;
        let columns = cells(middle - half, middle + half, window.left, window.width);
        for x in columns.clone().step_by(LANES) {
            let dx = LANE + ((window.left + x) as f32 + 0.5 - mx);
            let u = dx * across - shear * dy;
            let plane = dx * z_x + (z + z_y * dy);
            let inverse_depth = plane.clamp(far, near);
            let mut squared = u * u + v * v;
            if mend > 0.0 {
                let z = plane.clamp(Vec4::splat(least), Vec4::splat(greatest));
                let lacking = (Vec4::ONE - squared) * mend / (z * z);
                squared = (Vec4::ONE - lacking).max(Vec4::ZERO);
            }
            let inside = INSIDE[(columns.end - x).min(LANES)];
            work(y * STRIDE + x, Pixels { inside, squared: squared.min(Vec4::ONE), inverse_depth });
        }
    }
}

/// Lanes that are inside, by their number.
const INSIDE: [Vec4; LANES + 1] = [
    Vec4::ZERO,
    Vec4::new(1.0, 0.0, 0.0, 0.0),
    Vec4::new(1.0, 1.0, 0.0, 0.0),
    Vec4::new(1.0, 1.0, 1.0, 0.0),
    Vec4::ONE,
];

/// The same where each pixel's ray meets the plane.
fn for_each_run_by_rays(
    splat: &Splat,
    window: &Window,
    near: f32,
    mut work: impl FnMut(usize, Pixels),
) {
    let [ux, uy, u0, vx, vy, v0] = splat.form;
    let [z, z_x, z_y] = splat.inverse_depth;
    let greatest = 1.0 / near;
    let from =
        Vec2::new(window.left as f32, window.top as f32) + 0.5 - Vec2::from_array(splat.origin);
    for y in 0..window.height {
        let dy = from.y + y as f32;
        for x in (0..window.width).step_by(LANES) {
            let dx = LANE + (from.x + x as f32);
            let inverse_depth = dx * z_x + (z + z_y * dy);
            let u = (dx * ux + (u0 + uy * dy)) / inverse_depth;
            let v = (dx * vx + (v0 + vy * dy)) / inverse_depth;
            let squared = u * u + v * v;
            // What is not a number is outside.
            let meets = inverse_depth.cmpgt(Vec4::ZERO)
                & inverse_depth.cmple(Vec4::splat(greatest))
                & squared.cmplt(Vec4::ONE);
            if !meets.any() {
                continue;
            }
            let inside = Vec4::select(meets, INSIDE[(window.width - x).min(LANES)], Vec4::ZERO);
            let squared = Vec4::select(meets, squared, Vec4::ONE);
            let inverse_depth = Vec4::select(meets, inverse_depth, Vec4::splat(greatest));
            work(y * STRIDE + x, Pixels { inside, squared, inverse_depth });
        }
    }
}

/// Rows of a window whose middles are within `half` of `middle`.
#[inline(always)]
fn rows(middle: f32, half: f32, window: &Window) -> Range<usize> {
    cells(middle - half, middle + half, window.top, window.height)
}

/// Cells from `first` on, of at most `count`, whose middles lie between two places; counted from `first`.
#[inline(always)]
fn cells(low: f32, high: f32, first: usize, count: usize) -> Range<usize> {
    // `as` rounds down, saturates, and takes what is not a number for 0.
    let past = |place: f32| (place + 0.5 - first as f32).clamp(0.0, count as f32) as usize;
    past(low)..past(high)
}
