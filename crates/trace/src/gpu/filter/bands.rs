//! Bands of rows that the guided filter makes one after the other, so that the moments of a band
//! fit in a storage binding: 31 planes of a picture of 1920 x 1080 would need 257 MB.

use crate::gpu::same_layout;
use bytemuck::{Pod, Zeroable};
use esker_render::gpu::device::BINDING_BYTES_MAX;
use std::ops::Range;

/// Output rows of a band, if their moments fit. More rows take more memory, fewer rows compute
/// more windows twice.
const BAND_ROWS: u32 = 64;

/// The uniform of a band (`shaders/common/band.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct Band {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) radius: i32,
    unused: u32,
    pub(crate) first: u32,
    pub(crate) rows: u32,
    pub(crate) window_first: u32,
    pub(crate) window_rows: u32,
    pub(crate) pixel_first: u32,
    pub(crate) pixel_rows: u32,
    unused_2: u32,
    unused_3: u32,
    pub(crate) epsilon: [f32; 4],
    pub(crate) noise: [f32; 4],
}

same_layout!(Band {
    width,
    height,
    radius,
    first,
    rows,
    window_first,
    window_rows,
    pixel_first,
    pixel_rows,
    epsilon,
    noise,
});

/// Bands of a picture whose `planes` planes of a band fit in a binding, without epsilons. If not
/// even one row fits, bands have one row.
pub(crate) fn bands(width: u32, height: u32, radius: u32, planes: u32) -> Vec<Band> {
    let row_bytes = u64::from(width.max(1)) * u64::from(planes) * 4;
    let fitting = BINDING_BYTES_MAX / row_bytes;
    let halo = 4 * u64::from(radius.min(height));
    let rows = fitting.saturating_sub(halo).clamp(1, u64::from(BAND_ROWS)) as u32;
    let within = |from: u32, to: u32, margin: u32| -> Range<u32> {
        from.saturating_sub(margin)..to.saturating_add(margin).min(height)
    };
    let starts = (0..height).step_by(rows as usize);
    let band = |first: u32| {
        let end = (first + rows).min(height);
        let windows = within(first, end, radius);
        let pixels = within(windows.start, windows.end, radius);
        Band {
            width,
            height,
            radius: radius as i32,
            first,
            rows: end - first,
            window_first: windows.start,
            window_rows: windows.end - windows.start,
            pixel_first: pixels.start,
            pixel_rows: pixels.end - pixels.start,
            ..Band::zeroed()
        }
    };
    starts.map(band).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_a_picture_once_and_fit_in_a_binding() {
        for (width, height, radius) in [(160, 120, 32), (1920, 1080, 32), (3840, 2160, 24)] {
            let all = bands(width, height, radius, 31);
            let mut next = 0;
            for band in &all {
                assert_eq!(band.first, next);
                next += band.rows;
                let bytes = u64::from(band.pixel_rows) * u64::from(width) * 31 * 4;
                assert!(bytes <= BINDING_BYTES_MAX, "{width} x {height}: {bytes}");
                assert_eq!(band.window_first, band.first.saturating_sub(radius));
                assert_eq!(band.pixel_first, band.first.saturating_sub(2 * radius));
                assert!(band.pixel_first + band.pixel_rows <= height);
            }
            assert_eq!(next, height);
        }
    }

    #[test]
    fn a_radius_beyond_the_picture_needs_only_the_picture() {
        let all = bands(7, 5, 1000, 31);
        assert_eq!(all.len(), 1);
        assert_eq!((all[0].pixel_first, all[0].pixel_rows), (0, 5));
    }
}
