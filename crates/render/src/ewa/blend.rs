//! Pass `blend` of EWA splatting: the three passes of `zwicker2004`, section 6, tile by tile, so
//! that the buffers of a tile stay in the cache. Visibility finds the inverse depth of the front,
//! moved back; attributes are summed with their weights over the splats that are not behind it;
//! normalisation divides by the sum of weights. The means go to planes that are shaded afterwards.

use crate::ewa::clip::{EDGE_GROWTH, EDGE_PX};
use crate::ewa::cover::{Pixels, Window, for_each, for_each_small};
use crate::ewa::gauss::Falloff;
use crate::ewa::normals::{CODE_MAX, unpacked};
use crate::ewa::place::along;
use crate::ewa::planes::Planes;
use crate::ewa::splat::{Splat, SplatAttributes};
use crate::ewa::sums::{
    INVERSE_DEPTH, PAIRS, Rows, SHAPE, Share, Sums, TINT, WEIGHT, add, advance, front, replace,
};
use crate::ewa::tiles::{SplatRun, TILE, TileEntry};
use crate::inputs::camera::Camera;
use crate::picture::surface::Surface;
use crate::simd::values::{EIGHT, Values, dot, only};
use fearless_simd::{ExtractToken, Level, Simd, SimdMask, dispatch, f32x8};
use rayon::prelude::*;

/// Squared length below which a sum of normals has no direction.
const UNKNOWN: f32 = 1e-8;

/// Number of passes in which splats are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Passes {
    /// One pass: the nearest splat shows, without blending (table 1 of the paper).
    One,
    /// Three passes: visibility, attributes, normalisation.
    #[default]
    Three,
}

/// Draws the splats of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Blend<'a> {
    /// The splats.
    pub runs: &'a [SplatRun],
    /// Weights of the kernel.
    pub falloff: Falloff,
    /// Number of passes.
    pub passes: Passes,
    /// Camera of the frame.
    pub camera: &'a Camera,
}

/// Rows of the picture that a row of tiles is written to.
struct Picture<'a> {
    planes: &'a mut [[f32; EIGHT]],
    /// Length of a row of `planes`.
    row_len: usize,
    /// Planes of eight pixels.
    count: usize,
    depth: &'a mut [f32],
    /// Length of a row of `depth`.
    width: usize,
}

/// Inverse depth of a splat with clip lines, moved back by the thickness of its surface at a sharp
/// edge ([`EDGE_PX`]).
#[inline(always)]
fn thin<S: Simd>(p: &Pixels<S>, per_focal: f32) -> f32x8<S> {
    p.inverse_depth / ((p.from_edge * EDGE_GROWTH + EDGE_PX) * per_focal + 1.0)
}

impl Blend<'_> {
    /// Draws all tiles to `planes`, and their depths to `depth`, infinite where there is no splat.
    /// Returns the number of pixels covered.
    pub fn draw(&self, planes: &mut Planes, depth: &mut [f32]) -> u64 {
        if planes.has_normals() {
            self.draw_tiles::<true>(planes, depth)
        } else {
            self.draw_tiles::<false>(planes, depth)
        }
    }

    fn draw_tiles<const NORMALS: bool>(&self, planes: &mut Planes, depth: &mut [f32]) -> u64 {
        let [width, height] = planes.size();
        let columns = width.div_ceil(TILE);
        let (row_len, count) = (planes.row_len(), planes.planes());
        planes
            .rows_mut()
            .par_chunks_mut(row_len * TILE)
            .zip(depth.par_chunks_mut(width * TILE))
            .enumerate()
            .map(|(row, (planes, depth))| {
                let mut sums = Sums::default();
                let mut covered = 0;
                for column in 0..columns {
                    let window = Window::new([column * TILE, row * TILE], [width, height]);
                    let into =
                        Picture { planes: &mut *planes, row_len, count, depth: &mut *depth, width };
                    covered += dispatch!(Level::new(), simd => {
                        self.tile::<_, NORMALS>(simd, row * columns + column, &window, &mut sums);
                        self.normalise::<_, NORMALS>(simd, &sums, &window, into)
                    });
                }
                covered
            })
            .sum()
    }

    /// Draws the splats of a tile to its sums.
    #[inline(always)]
    fn tile<S: Simd, const NORMALS: bool>(
        &self,
        simd: S,
        tile: usize,
        window: &Window,
        sums: &mut Sums,
    ) {
        sums.clear();
        match self.passes {
            Passes::Three => {
                self.visibility(simd, tile, window, sums);
                self.attributes::<_, true, NORMALS>(simd, tile, window, sums);
            }
            Passes::One => self.attributes::<_, false, NORMALS>(simd, tile, window, sums),
        }
    }

    /// Calls `work` with the splats of a tile in their order.
    #[inline(always)]
    fn for_each(&self, tile: usize, mut work: impl FnMut(&SplatRun, &Splat, &TileEntry)) {
        for run in self.runs {
            // A loop, since another closure would be compiled for the baseline processor.
            for (splat, entry) in run.of_tile(tile) {
                work(run, splat, entry);
            }
        }
    }

    /// Calls `work` with the pixels of a splat that is not small. A function of its own keeps the
    /// fast path short.
    #[inline(always)]
    fn for_each_large<S: Simd, const NEAREST: bool>(
        &self,
        simd: S,
        (run, splat, entry): (&SplatRun, &Splat, &TileEntry),
        window: &Window,
        sums: &mut [Rows; PAIRS],
        work: impl FnMut(&mut Rows, Pixels<S>),
    ) {
        let Camera { centre_px, near, .. } = *self.camera;
        simd.vectorize(
            #[inline(always)]
            || {
                let own = (splat, &entry.rect, run.lines(entry));
                for_each::<_, NEAREST>(simd, own, window, (centre_px, near), sums, work);
            },
        );
    }

    /// Pass 1: finds the front.
    #[inline(always)]
    fn visibility<S: Simd>(&self, simd: S, tile: usize, window: &Window, sums: &mut Sums) {
        let per_focal = 1.0 / self.camera.focal_px;
        let pairs = sums.pairs();
        self.for_each(
            tile,
            #[inline(always)]
            |run, splat, entry| {
                if entry.rect.is_small {
                    return for_each_small::<_, true>(
                        simd,
                        splat,
                        &entry.rect,
                        window,
                        pairs,
                        #[inline(always)]
                        |rows, p| advance(rows, p.x, p.inside, p.inverse_depth - splat.back),
                    );
                }
                let is_by_rays = splat.is_by_rays();
                let has_lines = run.lines(entry).is_some();
                self.for_each_large::<_, true>(
                    simd,
                    (run, splat, entry),
                    window,
                    pairs,
                    #[inline(always)]
                    |rows, p| {
                        let moved = if is_by_rays {
                            p.inverse_depth / (p.inverse_depth * -splat.back + 1.0)
                        } else {
                            p.inverse_depth - splat.back
                        };
                        let at_edge = if has_lines { thin(&p, per_focal) } else { moved };
                        advance(rows, p.x, p.inside, Values::max(moved, at_edge));
                    },
                );
            },
        );
    }

    /// Pass 2: sums the attributes (`BLENDS`). As the only pass it keeps those of the nearest
    /// splat.
    #[inline(always)]
    fn attributes<S: Simd, const BLENDS: bool, const NORMALS: bool>(
        &self,
        simd: S,
        tile: usize,
        window: &Window,
        sums: &mut Sums,
    ) {
        let pairs = sums.pairs();
        self.for_each(
            tile,
            #[inline(always)]
            |run, splat, entry| {
                let SplatAttributes { tint, normal } = splat.attributes;
                let shape = if NORMALS {
                    unpacked(simd, normal)
                } else {
                    let zero = simd.splat_f32x8(0.0);
                    [simd.splat_f32x8(f32::from_bits(normal)), zero, zero]
                };
                if entry.rect.is_small {
                    let share = Share { tint, shape, amplitude: splat.form[3] };
                    return for_each_small::<_, false>(
                        simd,
                        splat,
                        &entry.rect,
                        window,
                        pairs,
                        #[inline(always)]
                        |rows, p| self.share::<_, BLENDS, NORMALS>(rows, &p, &share),
                    );
                }
                let amplitude = if splat.is_by_rays() { 1.0 } else { splat.form[3].abs() };
                let share = Share { tint, shape, amplitude };
                self.for_each_large::<_, false>(
                    simd,
                    (run, splat, entry),
                    window,
                    pairs,
                    #[inline(always)]
                    |rows, p| self.share::<_, BLENDS, NORMALS>(rows, &p, &share),
                );
            },
        );
    }

    /// Adds a splat to the pixels in which it is visible.
    #[inline(always)]
    fn share<S: Simd, const BLENDS: bool, const NORMALS: bool>(
        &self,
        rows: &mut Rows,
        p: &Pixels<S>,
        share: &Share<S>,
    ) {
        let front = front(p.squared.token(), rows, p.x);
        let is_near =
            if BLENDS { front.cmple(p.inverse_depth) } else { front.cmplt(p.inverse_depth) };
        let seen = p.inside & is_near;
        if !seen.any_true() {
            return;
        }
        if BLENDS {
            let weight = only(seen, self.falloff.of(p.squared)) * share.amplitude;
            add::<_, NORMALS>(rows, p.x, weight, share, p.inverse_depth);
        } else {
            replace(rows, p.x, seen, share, p.inverse_depth);
        }
    }

    /// Pass 3: writes the means of a tile. Returns the number of pixels covered.
    #[inline(always)]
    fn normalise<S: Simd, const NORMALS: bool>(
        &self,
        simd: S,
        sums: &Sums,
        window: &Window,
        into: Picture<'_>,
    ) -> u64 {
        let [right, up, back] = self.camera.view_from_world;
        let (zero, one) = (simd.splat_f32x8(0.0), simd.splat_f32x8(1.0));
        let mut covered = 0;
        for y in 0..window.height {
            let row = sums.row(y);
            let first = y * into.row_len + window.left / EIGHT * into.count;
            let depths = &mut into.depth[y * into.width + window.left..][..window.width];
            for x in (0..window.width).step_by(EIGHT) {
                let weight = row.sum(simd, WEIGHT, x);
                let is_any = zero.cmplt(weight);
                let share = only(is_any, one / weight);
                let at = first + x / EIGHT * into.count;
                let planes = &mut into.planes[at..at + if NORMALS { 6 } else { 4 }];
                planes[0] = *(row.sum(simd, TINT, x) * share);
                planes[1] = *(row.sum(simd, TINT + 1, x) * share);
                planes[2] = *(row.sum(simd, TINT + 2, x) * share);
                if NORMALS {
                    let share = share * (1.0 / CODE_MAX);
                    let nx = row.sum(simd, SHAPE, x) * share;
                    let ny = row.sum(simd, SHAPE + 1, x) * share;
                    let nz = row.sum(simd, SHAPE + 2, x) * share;
                    let n = [nx, ny, nz];
                    let mut n = [along(n, right), along(n, up), along(n, back)];
                    let is_unknown = dot(n, n).cmplt(simd.splat_f32x8(UNKNOWN));
                    if is_unknown.any_true() {
                        // Pixels without a direction face the eye.
                        let to_eye = self.camera.to_eye(simd, window.left + x, window.top + y);
                        for i in 0..3 {
                            n[i] = f32x8::select(is_unknown, to_eye[i], n[i]);
                        }
                    }
                    for i in 0..3 {
                        planes[3 + i] = *n[i];
                    }
                } else {
                    planes[3] = *(row.sum(simd, SHAPE, x) * share);
                }
                let depth = one / (row.sum(simd, INVERSE_DEPTH, x) * share);
                let depth = f32x8::select(is_any, depth, simd.splat_f32x8(f32::INFINITY));
                match depths[x..].first_chunk_mut::<EIGHT>() {
                    Some(own) if is_any.all_true() => {
                        *own = *depth;
                        covered += EIGHT as u64;
                    }
                    _ => {
                        for (k, own) in depths[x..].iter_mut().take(EIGHT).enumerate() {
                            *own = depth[k];
                            covered += u64::from(*own < f32::INFINITY);
                        }
                    }
                }
            }
        }
        covered
    }
}
