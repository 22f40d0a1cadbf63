//! The projection of the CPU renderer over points in main memory, and the bandwidth of that memory
//! that plain copies by all threads reach.

use crate::draw::cloud::Cloud;
use crate::draw::frame::{Covered, Times, draw_of, frame_of};
use crate::quantile::quantile;
use anyhow::Result;
use esker_points::Node;
use esker_render::inputs::camera::Camera;
use esker_render::inputs::lookup::DrawList;
use esker_render::passes::project::{EMPTY, project};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Bytes of each of the two buffers of a copy, more than fits in caches.
const COPY_BYTES: usize = 128 << 20;
/// Bytes of a copy by one thread.
const COPY_PIECE: usize = 1 << 20;
/// Copies whose median is returned.
const COPIES: usize = 5;

/// Copies a large buffer on all threads. Returns the median rate: bytes a second, read and written.
pub(super) fn copy_rate() -> f64 {
    let source = vec![1u8; COPY_BYTES];
    let mut target = vec![0u8; COPY_BYTES];
    let mut rate = || {
        let start = Instant::now();
        let pieces = target.par_chunks_mut(COPY_PIECE).zip(source.par_chunks(COPY_PIECE));
        pieces.for_each(|(to, from)| to.copy_from_slice(from));
        std::hint::black_box(&mut target);
        2.0 * COPY_BYTES as f64 / start.elapsed().as_secs_f64().max(1e-9)
    };
    // The first copy is slower: its pages are new.
    rate();
    let rates: Vec<f64> = (0..COPIES).map(|_| rate()).collect();
    quantile(&rates, 0.5)
}

/// A cloud in main memory, and a frame buffer.
pub(super) struct OnCpu<'a> {
    cloud: &'a Cloud<'a>,
    nodes: Vec<(Node, Vec<u8>)>,
    size: [u32; 2],
    pixels: Vec<AtomicU64>,
}

impl<'a> OnCpu<'a> {
    /// Makes a cloud without nodes.
    pub fn new(cloud: &'a Cloud<'a>) -> Self {
        Self { cloud, nodes: Vec::new(), size: [0; 2], pixels: Vec::new() }
    }

    /// Appends a node.
    pub fn push(&mut self, node: Node, plane: Vec<u8>) {
        self.nodes.push((node, plane));
    }

    /// Sets the size of the picture.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.size = size;
        self.pixels.resize_with(size[0] as usize * size[1] as usize, || AtomicU64::new(EMPTY));
    }

    /// Draws all points once.
    ///
    /// # Errors
    /// If the view makes no valid camera.
    pub fn frame(&mut self) -> Result<Times> {
        let (view, lattice) = (self.cloud.view(self.size), self.cloud.lattice());
        let draws: Vec<_> =
            self.nodes.iter().map(|(node, plane)| draw_of(node, &plane[..])).collect();
        let frame = frame_of(&view, &lattice, &draws);
        let camera = Camera::new(&view, &lattice)?;
        let start = Instant::now();
        project(&frame, &camera, &DrawList::new(&draws), &self.pixels);
        Ok(Times { wall_ms: start.elapsed().as_secs_f64() * 1e3, gpu_ms: None })
    }

    /// Counts the pixels that the last frame drew points to.
    pub fn covered(&self) -> Covered {
        Some(self.pixels.iter().filter(|p| p.load(Relaxed) != EMPTY).count() as u64)
    }
}
