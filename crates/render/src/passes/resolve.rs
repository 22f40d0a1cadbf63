//! Resolve: writes the colours of the points that won a pixel to the picture, unlit (method
//! *points*); and the background of all methods.

use crate::frame::{Background, Picture};
use crate::inputs::colour::Encoder;
use crate::inputs::lookup::Lookup;
use crate::passes::project::{EMPTY, unpack};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Writes colours and depths of the picture. Returns the number of covered pixels.
pub fn resolve(
    lookup: &Lookup<'_>,
    target: &[AtomicU64],
    background: Background,
    picture: &mut Picture,
) -> u64 {
    let width = picture.width as usize;
    let encoder = Encoder::get();
    let covered = AtomicU64::new(0);
    let rows = picture.rgba.par_chunks_mut(width * 4).zip(picture.depth.par_chunks_mut(width));
    rows.enumerate().for_each(|(y, (rgba, depths))| {
        let behind = backdrop(background, lookup.camera.backdrop_row(y));
        let mut count = 0;
        for (x, out) in rgba.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let value = target[y * width + x].load(Relaxed);
            if value == EMPTY {
                (*out, depths[x]) = (behind, f32::INFINITY);
                continue;
            }
            let (depth, point) = unpack(value);
            let [r, g, b] = encoder.bytes(lookup.colour_of(point, depth));
            (*out, depths[x]) = ([r, g, b, 255], depth);
            count += 1;
        }
        covered.fetch_add(count, Relaxed);
    });
    covered.into_inner()
}

/// Colour of the background in row `y` of `height`.
pub fn backdrop(background: Background, [y, height]: [usize; 2]) -> [u8; 4] {
    match background {
        Background::Plain(c) => c,
        Background::Gradient(top, bottom) => {
            let share = (y as f32 + 0.5) / height as f32;
            let mix = |i: usize| {
                let (a, b) = (f32::from(top[i]), f32::from(bottom[i]));
                (a + (b - a) * share + 0.5) as u8
            };
            [mix(0), mix(1), mix(2), 255]
        }
    }
}
