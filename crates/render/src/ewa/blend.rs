//! The three passes of zwicker2004 section 6, tile by tile, so that what they share stays in the cache:
//! visibility (the front's inverse depth, moved back), attributes (sums with weights, over what is not behind
//! that), and normalisation (sums over the sum of weights), into planes that are shaded afterwards.

use super::cover::{Pixels, Window, for_each, for_each_small};
use super::gauss::Falloff;
use super::place::unpacked;
use super::planes::Planes;
use super::splat::Splat;
use super::sums::{Share, Sums, add, advance, front, means, replace};
use super::tiles::{Entry, Run, TILE};
use crate::camera::Camera;
use crate::lanes::{LANES, Lane, counting, only};
use crate::surface::Surface;
use glam::{Vec3, Vec4};
use rayon::prelude::*;

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
    /// The weights.
    pub falloff: Falloff,
    /// How.
    pub passes: Passes,
    /// The frame's camera.
    pub camera: &'a Camera,
}

impl Blend<'_> {
    /// Draws all tiles to `planes` and their depths (infinite where nothing is) to `depth`. Returns the number of
    /// pixels covered.
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
        let (row_len, stride) = (planes.row_len(), planes.stride());
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
                    self.tile::<NORMALS>(row * columns + column, &window, &mut sums);
                    for y in 0..window.height {
                        let depth = &mut depth[y * width + window.left..][..window.width];
                        let planes = &mut planes[y * row_len + window.left..(y + 1) * row_len];
                        covered +=
                            self.normalise::<NORMALS>(&sums, y, &window, (planes, stride), depth);
                    }
                }
                covered
            })
            .sum()
    }

    #[inline(never)]
    fn tile<const NORMALS: bool>(&self, tile: usize, window: &Window, sums: &mut Sums) {
        sums.clear();
        match self.passes {
            Passes::Three => {
                self.visibility(tile, window, sums);
                self.attributes::<true, NORMALS>(tile, window, sums);
            }
            Passes::One => self.attributes::<false, NORMALS>(tile, window, sums),
        }
    }

    /// Gives the splats of a tile in their order.
    #[inline(always)]
    fn for_each(&self, tile: usize, mut work: impl FnMut(&Run, &Splat, &Entry)) {
        for run in self.runs {
            run.of_tile(tile).for_each(|(splat, entry)| work(run, splat, entry));
        }
    }

    /// Pass 1.
    #[inline(never)]
    fn visibility(&self, tile: usize, window: &Window, sums: &mut Sums) {
        let rows = sums.rows();
        let Camera { centre_px, near, .. } = *self.camera;
        self.for_each(tile, |run, splat, entry| {
            // Nothing of a disc is nearer than this.
            let nearest = Vec4::splat(splat.form[5]);
            let back = splat.back;
            let is_by_rays = splat.is_by_rays();
            if entry.is_small {
                return for_each_small(splat, entry, window, |p| {
                    let moved = p.inverse_depth.min(nearest) - back;
                    advance(&mut rows[p.y], p.x, p.inside, moved);
                });
            }
            for_each(splat, entry, run.lines(entry), window, centre_px, near, |p| {
                let moved = if is_by_rays {
                    p.inverse_depth / (p.inverse_depth * -back + 1.0)
                } else {
                    p.inverse_depth.min(nearest) - back
                };
                advance(&mut rows[p.y], p.x, p.inside, moved);
            });
        });
    }

    /// Pass 2; or the only one, where a splat in front takes the pixel.
    #[inline(never)]
    fn attributes<const BLENDS: bool, const NORMALS: bool>(
        &self,
        tile: usize,
        window: &Window,
        sums: &mut Sums,
    ) {
        let rows = sums.rows();
        let Camera { centre_px, near, .. } = *self.camera;
        self.for_each(tile, |run, splat, entry| {
            let shape = if NORMALS {
                unpacked(splat.normal).to_array()
            } else {
                [f32::from_bits(splat.normal), 0.0, 0.0]
            };
            let share = Share::new(splat.tint, shape);
            let amplitude = if splat.is_by_rays() { 1.0 } else { splat.form[3].abs() };
            let work = |p: Pixels| {
                let row = &mut rows[p.y];
                let front = front(row, p.x);
                let seen = p.inside
                    & if BLENDS {
                        p.inverse_depth.cmpge(front)
                    } else {
                        p.inverse_depth.cmpgt(front)
                    };
                if !seen.any() {
                    return;
                }
                if BLENDS {
                    let weight = only(seen, self.falloff.of(p.squared)) * amplitude;
                    add::<NORMALS>(row, p.x, weight, &share, p.inverse_depth);
                } else {
                    replace(row, p.x, seen, &share, p.inverse_depth);
                }
            };
            if entry.is_small {
                for_each_small(splat, entry, window, work);
            } else {
                for_each(splat, entry, run.lines(entry), window, centre_px, near, work);
            }
        });
    }

    /// Pass 3, of a row, to its part of planes that are so far apart. Returns the number of pixels covered.
    #[inline(never)]
    fn normalise<const NORMALS: bool>(
        &self,
        sums: &Sums,
        y: usize,
        window: &Window,
        (planes, stride): (&mut [f32], usize),
        depths: &mut [f32],
    ) -> u64 {
        let row = sums.row(y);
        let mut covered = 0;
        for x in (0..window.width).step_by(LANES) {
            let ([r, g, b, mut nx, mut ny, mut nz, inverse_depth], is_any) = means(row, x);
            let depth = Vec4::select(is_any, 1.0 / inverse_depth, Vec4::INFINITY);
            if NORMALS {
                let [right, up, back] = self.camera.view_from_world;
                let along = |v: Vec3| nx * v.x + ny * v.y + nz * v.z;
                let mut n = [along(right), along(up), along(back)];
                let squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
                let is_known = squared.cmpge(Vec4::splat(UNKNOWN));
                if !is_known.all() {
                    // It faces the eye.
                    let to_eye = self.rays_back(window, x, y);
                    (0..3).for_each(|i| n[i] = Vec4::select(is_known, n[i], to_eye[i]));
                }
                [nx, ny, nz] = n;
            }
            let all = [r, g, b, nx, ny, nz];
            for (plane, value) in all.into_iter().take(if NORMALS { 6 } else { 4 }).enumerate() {
                value.write_to_slice(&mut planes[plane * stride + x..][..LANES]);
            }
            let own = &mut depths[x..window.width.min(x + LANES)];
            covered += u64::from((is_any.bitmask() & ((1 << own.len()) - 1)).count_ones());
            match own.first_chunk_mut::<LANES>() {
                Some(own) => *own = depth.to_array(),
                None => own.copy_from_slice(&depth.to_array()[..own.len()]),
            }
        }
        covered
    }

    /// Directions from pixels to the eye, right, up and back.
    fn rays_back(&self, window: &Window, x: usize, y: usize) -> [Lane; 3] {
        let [middle_x, middle_y] = self.camera.centre_px;
        let x = -counting((window.left + x) as f32 + 0.5 - middle_x, 1.0);
        let y = Vec4::splat((window.top + y) as f32 + 0.5 - middle_y);
        let z = Vec4::splat(self.camera.focal_px);
        let length = (x * x + y * y + z * z).sqrt();
        [x / length, y / length, z / length]
    }
}
