//! Depths at the centres of pixels. A level holds depths at the centres of ellipses
//! ([`crate::passes::tangent`]); here they are moved along the planes of the pixels to where a
//! depth image has them.

use crate::passes::tangent::Lens;
use crate::picture::pyramid::{FITTED, FLAT, INVALID, Level, NORMALS, Planes, Row, RowMut};
use crate::simd::lanes::{LANES, counting, four, four_planes, four_values, to_centres, valid};
use fearless_simd::{Level as Simd, dispatch};
use glam::Vec4;
use rayon::prelude::*;

impl Level {
    /// Writes the depths at the centres of its pixels to `depth`; infinite where a pixel is
    /// invalid.
    pub fn depth_image(&self, lens: &Lens, depth: &mut [f32]) {
        match self.planes() {
            Planes::None => self.depth_image_of::<FLAT>(lens, depth),
            Planes::Fitted => self.depth_image_of::<FITTED>(lens, depth),
            Planes::Normals => self.depth_image_of::<NORMALS>(lens, depth),
        }
    }

    fn depth_image_of<const PLANE: usize>(&self, lens: &Lens, depth: &mut [f32]) {
        let width = self.width;
        let rows = depth.par_chunks_mut(width).with_min_len(8).enumerate();
        rows.for_each(|(y, out)| {
            let run = y * width..(y + 1) * width;
            let row = Row {
                y,
                front: &self.front[run.clone()],
                tint: &self.tint[run.clone()],
                depth: &self.depth[run.clone()],
                normal: self.normal.get(run.clone()).unwrap_or(&[]),
                tilt: self.tilt.get(run).unwrap_or(&[]),
            };
            dispatch!(Simd::new(), _ => row.depths_at_centres::<PLANE>(lens, self.edge_px, out));
        });
    }
}

impl Row<'_> {
    /// Writes the depths at the centres of its pixels to `out`; infinite where a pixel is invalid.
    #[inline(always)]
    pub fn depths_at_centres<const PLANE: usize>(
        &self,
        lens: &Lens,
        edge_px: f32,
        out: &mut [f32],
    ) {
        for (i, out) in out.chunks_mut(LANES).enumerate() {
            put(self.four_at_centres::<PLANE>(lens, edge_px, i * LANES), out);
        }
    }

    /// Depths at the centres of four pixels from `first` on; infinite beyond the row and where a
    /// pixel is invalid.
    #[inline(always)]
    fn four_at_centres<const PLANE: usize>(
        &self,
        lens: &Lens,
        edge_px: f32,
        first: usize,
    ) -> [f32; LANES] {
        let run = first..self.front.len().min(first + LANES);
        let [least, _, right, down] = four(&self.front[run.clone()], INVALID);
        let is_valid = valid(least);
        if !is_valid.any() {
            return [f32::INFINITY; LANES];
        }
        let mut depth = four_values(&self.depth[run.clone()]);
        if PLANE != FLAT {
            let normals = self.normal.get(run.clone()).unwrap_or_default();
            let tilts = self.tilt.get(run.clone()).unwrap_or_default();
            let plane = four_planes::<PLANE>(normals, tilts);
            let [_, _, _, radius] = four(&self.tint[run], Vec4::ZERO);
            let centre = [
                counting((first as f32 + 0.5) * edge_px, edge_px),
                Vec4::splat((self.y as f32 + 0.5) * edge_px),
            ];
            depth *= to_centres::<PLANE>(lens, centre, [right, down], radius, plane);
        }
        Vec4::select(is_valid, depth, Vec4::INFINITY).to_array()
    }
}

impl RowMut<'_> {
    /// Writes the depths at the centres of eight pixels from `first` on to the image, if there is
    /// one, up to the end of the row.
    #[inline(always)]
    pub fn write_image<const PLANE: usize>(&mut self, lens: &Lens, edge_px: f32, first: usize) {
        let Self { y, front, tint, depth, normal, tilt, image } = self;
        let row = Row { y: *y, front, tint, depth, normal, tilt };
        for first in [first, first + LANES] {
            if let Some(out) = image.get_mut(first..) {
                put(row.four_at_centres::<PLANE>(lens, edge_px, first), out);
            }
        }
    }

    /// Writes infinite depths for eight pixels from `first` on to the image, if there is one.
    #[inline(always)]
    pub fn write_nothing(&mut self, first: usize) {
        if let Some(out) = self.image.get_mut(first..) {
            put([f32::INFINITY; 2 * LANES], out);
        }
    }
}

/// Writes as many of the values as `out` has room for.
#[inline(always)]
fn put<const N: usize>(values: [f32; N], out: &mut [f32]) {
    match out.first_chunk_mut() {
        Some(out) => *out = values,
        None => out.copy_from_slice(&values[..out.len()]),
    }
}
