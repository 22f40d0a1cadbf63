//! What a session draws with: memory for planes, and the renderer that draws from it, one on the
//! CPU and one on a GPU. The session keeps the order of a frame (drain, cut, upload, draw); a
//! painter does each step.

mod cpu;
mod gpu;

pub(crate) use cpu::CpuPainter;
pub(crate) use gpu::GpuPainter;

use crate::draw::frame::{Appearance, draw_node};
use crate::light::settings::LightSettings;
use crate::light::status::LitStatus;
use anyhow::Result;
use esker_format::Forest;
use esker_lod::{DepthFeedback, View};
use esker_render::gpu::wgpu;
use esker_render::{DrawNode, Picture, Stats};
use esker_stream::{Cut, CutNode, Shown, Slot, StreamError, Streamer, Transfer};
use std::sync::Arc;

/// A drawn picture.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// A picture in main memory.
    Memory(&'a Picture),
    /// A texture on the GPU: rgba8unorm, sRGB bytes, straight alpha. The commands that draw it are
    /// submitted.
    Texture(&'a wgpu::TextureView),
}

impl<'a> Image<'a> {
    /// The picture, if it is in main memory.
    pub fn in_memory(self) -> Option<&'a Picture> {
        match self {
            Self::Memory(picture) => Some(picture),
            Self::Texture(_) => None,
        }
    }
}

/// Bytes of GPU buffers, counted by the allocator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuBytes {
    /// All buffers.
    pub bytes: u64,
    /// The most bytes at once.
    pub peak_bytes: u64,
    /// Buffers without node planes: upload runs, frame buffer, pyramid, picture, tables.
    pub fixed_bytes: u64,
}

/// What is drawn, and how.
#[derive(Clone, Copy)]
pub(crate) struct FrameInput<'a> {
    pub(crate) file: &'a Forest,
    pub(crate) view: &'a View,
    pub(crate) cut: &'a Cut,
    pub(crate) appearance: &'a Appearance,
    /// How lit pictures are lit.
    pub(crate) light: &'a LightSettings,
    /// Most splats of a lit scene.
    pub(crate) splats_max: u64,
}

impl<'a> FrameInput<'a> {
    /// Nodes of the cut with their planes; `plane` finds a plane by its slot.
    fn draws<P: Default>(&self, plane: impl Fn(Slot) -> P) -> Vec<DrawNode<'a, P>> {
        self.draw_nodes(&self.cut.nodes, 0, plane)
    }

    /// Nodes around the picture with their planes, for light: none unless the session lights. Their
    /// entries follow those of the picture.
    fn draws_around<P: Default>(&self, plane: impl Fn(Slot) -> P) -> Vec<DrawNode<'a, P>> {
        let around = self.cut.surroundings.as_ref().map_or(&[][..], |around| &around.nodes);
        self.draw_nodes(around, self.cut.nodes.len(), plane)
    }

    /// Classes of the points of all nodes, those around the picture last, where lights choose
    /// points by them.
    fn classes<P>(&self, plane: impl Fn(Slot) -> P) -> Vec<Option<P>> {
        let Some(kind) = self.cut.shown.needs.classes else { return Vec::new() };
        self.cut.lit_nodes().map(|node| node.slot(kind).map(&plane)).collect()
    }

    fn draw_nodes<P: Default>(
        &self,
        drawn: &[CutNode],
        first_entry: usize,
        plane: impl Fn(Slot) -> P,
    ) -> Vec<DrawNode<'a, P>> {
        let table = self.file.table();
        let colouring = &self.appearance.colouring;
        let drawn = drawn.iter().enumerate();
        drawn
            .map(|(index, n)| {
                let plane = |kind| n.slot(kind).map(&plane);
                draw_node(table, n.node, first_entry + index, n.prefix, colouring, plane)
            })
            .collect()
    }
}

/// Calls `uploaded` with each request that is complete with these transfers.
fn report_complete(transfers: &[Transfer], uploaded: &mut dyn FnMut(u64)) {
    transfers.iter().filter_map(|t| t.request).for_each(uploaded);
}

/// Memory for planes, and a renderer. Loaders use the landing; only the render thread calls the
/// rest.
pub(crate) trait Painter: Send {
    /// Starts streaming into the memory of the painter, which sets the bytes and pages of
    /// `options`.
    fn start(
        &self,
        file: Arc<Forest>,
        options: esker_stream::Options,
        shown: Shown,
    ) -> Result<Streamer, StreamError>;

    /// Bytes for planes within another budget (`Settings::budget_gpu_bytes`); `None` if drawing
    /// memory cannot be changed so far while it is in use.
    fn bytes_within(&self, budget_gpu_bytes: u64) -> Option<u64>;

    /// Prepares drawing memory for this many bytes for planes, before the streamer is limited to
    /// them.
    fn resize(&mut self, drawing_bytes: u64);

    /// Frees memory for planes from this byte on, which the newest cut does not draw from.
    fn free_beyond(&mut self, bytes: u64);

    /// Takes landed runs of at most `bytes_max` bytes, but one if there is any. Never waits.
    fn drain(&mut self, bytes_max: usize);

    /// Copies drained runs to their slots. Returns the bytes.
    fn upload(&mut self) -> Result<u64>;

    /// Calls `uploaded` with the requests that were uploaded, and frees their runs. Never waits.
    fn report_uploaded(&mut self, uploaded: &mut dyn FnMut(u64));

    /// Ends a frame in which nothing is drawn.
    fn flush(&mut self) -> Result<()>;

    /// Draws a frame.
    fn draw(&mut self, input: &FrameInput<'_>) -> Result<()>;

    /// Picture of the last frame; `None` before the first one.
    fn image(&self) -> Option<Image<'_>>;

    /// Statistics of the last finished frame.
    fn stats(&self) -> Stats;

    /// Depth of the last finished frame, once.
    fn feedback(&mut self) -> Option<DepthFeedback>;

    /// Most frames until the depth of a frame comes back; 0 for at once.
    fn feedback_frames(&self) -> u32;

    /// Picture of the last frame in main memory; waits for it.
    fn picture(&mut self) -> Result<Picture>;

    /// State of the lit picture; `None` if the last one is not lit.
    fn light(&self) -> Option<LitStatus> {
        None
    }

    /// Whether the next picture of what the last one shows would be the same.
    fn is_converged(&self) -> bool {
        true
    }

    /// Bytes of GPU buffers; `None` on the CPU.
    fn gpu_bytes(&self) -> Option<GpuBytes>;

    /// Fault of a shader that has changed on the disk; the old one stays in use.
    fn shader_fault(&self) -> Option<&str> {
        None
    }

    /// Stops lending memory.
    fn close(&self);
}
