//! The drawing rate of the CPU renderer's projection, and the bandwidth of main memory as plain copies by all
//! threads reach it.

use super::{Covered, Times};
use crate::draw::cloud::Cloud;
use anyhow::Result;
use esker_points::Node;
use esker_render::inputs::camera::Camera;
use esker_render::inputs::lookup::DrawList;
use esker_render::passes::project::{EMPTY, project};
use esker_render::{Background, ColourBy, ColourPlane, DrawNode, Frame, Method};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Bytes of each of the two buffers of a copy: more than caches hold.
const COPY_BYTES: usize = 128 << 20;
/// Bytes that a thread copies at once.
const COPY_PIECE: usize = 1 << 20;
/// Copies that the median is taken of.
const COPIES: usize = 5;

/// Bytes a second, read and written, of copying a large buffer on all threads: a median.
pub fn copy_rate() -> f64 {
    let source = vec![1u8; COPY_BYTES];
    let mut target = vec![0u8; COPY_BYTES];
    let mut rate = || {
        let start = Instant::now();
        let pieces = target.par_chunks_mut(COPY_PIECE).zip(source.par_chunks(COPY_PIECE));
        pieces.for_each(|(to, from)| to.copy_from_slice(from));
        std::hint::black_box(&mut target);
        2.0 * COPY_BYTES as f64 / start.elapsed().as_secs_f64().max(1e-9)
    };
    // The first one pays for fresh memory.
    rate();
    let rates: Vec<f64> = (0..COPIES).map(|_| rate()).collect();
    crate::flight::quantile(&rates, 0.5)
}

/// A cloud in main memory, and a picture.
pub struct OnCpu<'a> {
    cloud: &'a Cloud<'a>,
    nodes: Vec<(Node, Vec<u8>)>,
    size: [u32; 2],
    pixels: Vec<AtomicU64>,
}

impl<'a> OnCpu<'a> {
    /// Of no node yet.
    pub fn new(cloud: &'a Cloud<'a>) -> Self {
        Self { cloud, nodes: Vec::new(), size: [0; 2], pixels: Vec::new() }
    }

    /// Takes a node more.
    pub fn push(&mut self, node: Node, plane: Vec<u8>) {
        self.nodes.push((node, plane));
    }

    /// Takes the size of the picture.
    pub fn fit(&mut self, size: [u32; 2]) {
        self.size = size;
        self.pixels.resize_with(size[0] as usize * size[1] as usize, || AtomicU64::new(EMPTY));
    }

    /// Draws all points once.
    ///
    /// # Errors
    /// Where the view is no usable camera.
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

    /// Pixels that the last frame drew points on.
    pub fn covered(&self) -> Covered {
        Some(self.pixels.iter().filter(|p| p.load(Relaxed) != EMPTY).count() as u64)
    }
}

/// A node whole, with nothing but its positions.
pub fn draw_of<P>(node: &Node, position: P) -> DrawNode<'_, P> {
    DrawNode {
        node,
        entry: 0,
        prefix: node.points(),
        position,
        residual: None,
        colour: ColourPlane::None,
        normal: None,
        clip: None,
        tangents: None,
    }
}

/// A frame of single points.
pub fn frame_of<'a, P>(
    view: &'a esker_lod::View,
    lattice: &'a esker_points::Lattice,
    draws: &'a [DrawNode<'a, P>],
) -> Frame<'a, P> {
    Frame {
        view,
        lattice,
        draws,
        octree: None,
        method: Method::Points,
        colour: ColourBy::Plain,
        cull_back_faces: false,
        hides_points: false,
        shines: true,
        skips_push: true,
        averages: true,
        smooths: true,
        fits_planes: true,
        evens_exposure: false,
        background: Background::default(),
    }
}
