//! Buffers of a picture in progress: what the guide rays see, sums of light, and what the filter
//! and the picture take. What takes most bytes a pixel lies in parts of some rows, so that pictures
//! of any size fit in storage bindings, and no dispatch is long.

use crate::gpu::Pixels;
use crate::gpu::world::{Part, Unsupported};
use esker_render::gpu::device::{BINDING_BYTES_MAX, Counted};
use esker_render::gpu::wgpu::{Buffer, BufferUsages};
use esker_render::gpu::{Gpu, GpuError};

/// Bytes of a `vec4<f32>`.
const FOUR: u64 = 16;
/// `vec4<f32>` of the place of a pixel.
const PLACE: u64 = 3;
/// Four words of the sums of a pixel: direct light, indirect light that is not looked up, and, from
/// the second sample on, the albedo that looks up each of the nine pixels around, two words each
/// (`shaders/common/links.wgsl`).
const SUMS: u64 = 2;
const LINKS: u64 = 5;
/// `vec4<f32>` a pixel of the buffers that hold whole pictures: two halves, two kinds of light.
const WHOLE: u64 = 2;
/// Bytes of the sums of a part at most.
pub(crate) const PART_BYTES: u64 = BINDING_BYTES_MAX;
/// Parts have a multiple of this number of rows: the side of a workgroup.
const ROWS_STEP: u32 = 8;

/// Buffers of a picture.
#[derive(Debug)]
pub(crate) struct Buffers {
    /// Parts of the picture, from its top.
    pub(crate) parts: Vec<PartBuffers>,
    /// Incident indirect light of even and odd samples.
    pub(crate) halves: Counted,
    /// Whether sums have room for lookups.
    has_links: bool,
    /// Mean incident indirect light.
    pub(crate) light: Pixels,
    pub(crate) guides: Pixels,
    pub(crate) filtered: Pixels,
    /// Direct and indirect light (`shaders/trace/resolve.wgsl`).
    pub(crate) picture: Counted,
    /// Light of the last picture, and the number of samples that it stands for; none if no picture
    /// of this size came before.
    pub(crate) past: Option<Counted>,
}

/// What a new picture takes of the last one.
pub(crate) struct Last {
    /// Parts with their places.
    pub(crate) parts: Vec<(Part, Counted)>,
    /// Mean incident light.
    pub(crate) light: Buffer,
    /// What it used of the picture before it.
    pub(crate) past: Option<Counted>,
}

/// Buffers of a part.
#[derive(Debug)]
pub(crate) struct PartBuffers {
    pub(crate) part: Part,
    /// What the guide rays of its pixels see, and of the rows above and below
    /// (`shaders/common/places.wgsl`).
    pub(crate) places: Counted,
    /// Direct light, and which indirect light is looked up (`shaders/trace/direct.wgsl`).
    pub(crate) sums: Counted,
}

impl Buffers {
    /// Buffers for a picture of a size whose sums are zero, in parts whose sums take at most
    /// `part_bytes`: those of an old picture of that size, or else new ones.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn fit(
        gpu: &Gpu,
        [width, height]: [u32; 2],
        part_bytes: u64,
        old: Option<Self>,
    ) -> Result<Self, GpuError> {
        let same = old.filter(|old| [old.light.width, old.light.height] == [width, height]);
        let Some(old) = same else { return Self::new(gpu, width, height, part_bytes) };
        old.clear(gpu);
        Ok(Self { past: None, ..old })
    }

    /// The same for a picture that uses light of the old one again: gives its places and light.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn after(gpu: &Gpu, mut old: Self) -> Result<(Self, Last), GpuError> {
        let past = gpu.buffer("past light", old.light.buffer.size(), USAGE)?;
        let mut last = Last {
            parts: Vec::new(),
            light: Buffer::clone(&old.light.buffer),
            past: old.past.replace(past),
        };
        for part in &mut old.parts {
            let places = gpu.buffer("places", part.places.size(), USAGE)?;
            last.parts.push((part.part, std::mem::replace(&mut part.places, places)));
        }
        old.clear(gpu);
        Ok((old, last))
    }

    /// Clears what samples are added to.
    fn clear(&self, gpu: &Gpu) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let sums = self.parts.iter().map(|part| &part.sums);
        for buffer in sums.chain([&self.halves]).chain(&self.past) {
            encoder.clear_buffer(buffer, 0, None);
        }
        gpu.queue.submit([encoder.finish()]);
    }

    fn new(gpu: &Gpu, width: u32, height: u32, part_bytes: u64) -> Result<Self, GpuError> {
        let pixels = u64::from(width) * u64::from(height);
        let whole = |label| gpu.buffer(label, pixels * WHOLE * FOUR, USAGE);
        let image = |label| Pixels::new(gpu, label, width, height);
        let of_part = |part: Part| {
            let buffer = |label, rows: u32, fours: u64| {
                gpu.buffer(label, u64::from(rows) * u64::from(width) * fours * FOUR, USAGE)
            };
            let places = buffer("places", part.place_rows, PLACE)?;
            Ok(PartBuffers { part, places, sums: buffer("sums", part.rows, SUMS)? })
        };
        let made = parts(width, height, part_bytes).into_iter().map(of_part);
        Ok(Self {
            parts: made.collect::<Result<_, GpuError>>()?,
            halves: whole("halves")?,
            has_links: false,
            light: image("incident light")?,
            guides: image("guides")?,
            filtered: image("filtered light")?,
            picture: whole("lit picture")?,
            past: None,
        })
    }

    /// Refuses pictures whose buffers of all pixels exceed a binding.
    pub(crate) fn check(gpu: &Gpu, pixels: usize) -> Result<(), Unsupported> {
        let fits = pixels as u64 * WHOLE * FOUR <= gpu.tier.binding_bytes_max;
        if fits { Ok(()) } else { Err(Unsupported::Size) }
    }

    /// Makes room for lookups, which the second sample begins.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add_links(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.has_links {
            return Ok(());
        }
        for part in &mut self.parts {
            let bytes = part.sums.size();
            let pixels = u64::from(part.part.rows) * u64::from(self.light.width);
            let sums = gpu.buffer("sums", pixels * (SUMS + LINKS) * FOUR, USAGE)?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&part.sums, 0, &sums, 0, bytes);
            gpu.queue.submit([encoder.finish()]);
            part.sums = sums;
        }
        self.has_links = true;
        Ok(())
    }

    /// Bytes of all.
    pub(crate) fn bytes(&self) -> u64 {
        let images = [&self.light, &self.guides, &self.filtered].map(|image| image.buffer.size());
        let parts = self.parts.iter().flat_map(|part| [part.places.size(), part.sums.size()]);
        let kept = self.past.iter().chain([&self.halves, &self.picture]);
        images.into_iter().chain(parts).chain(kept.map(|buffer| buffer.size())).sum()
    }
}

/// Parts of a picture whose sums take at most `part_bytes` each, but for single rows of workgroups.
fn parts(width: u32, height: u32, part_bytes: u64) -> Vec<Part> {
    let row_bytes = u64::from(width.max(1)) * (SUMS + LINKS) * FOUR;
    let rows = (part_bytes / row_bytes).min(u64::from(height)) as u32;
    // One part of all rows needs no whole workgroups.
    let step = if rows >= height { height } else { (rows - rows % ROWS_STEP).max(ROWS_STEP) };
    let part = |first: u32| {
        let end = (first + step).min(height);
        let first_place = first.saturating_sub(1);
        let place_rows = (end + 1).min(height) - first_place;
        Part { first, rows: end - first, first_place, place_rows }
    };
    (0..height).step_by(step.max(1) as usize).map(part).collect()
}

const USAGE: BufferUsages =
    BufferUsages::STORAGE.union(BufferUsages::COPY_SRC).union(BufferUsages::COPY_DST);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_a_picture_once_with_the_places_around_them() {
        for (width, height, bytes) in
            [(1920, 1080, PART_BYTES), (3840, 2160, PART_BYTES), (40, 30, 1)]
        {
            let all = parts(width, height, bytes);
            let mut next = 0;
            for part in &all {
                assert_eq!(part.first, next);
                next += part.rows;
                assert_eq!(part.first_place, part.first.saturating_sub(1));
                assert_eq!(part.first_place + part.place_rows, (next + 1).min(height));
                let sums = u64::from(part.rows) * u64::from(width) * 112;
                assert!(sums <= bytes || part.rows <= ROWS_STEP);
            }
            assert!(next == height && all.len() > 1);
        }
        assert_eq!(parts(7, 5, PART_BYTES).len(), 1);
        assert_eq!(parts(7, 0, PART_BYTES).len(), 0);
    }
}
