//! What a session draws with: memory that planes land in, and the renderer that draws them. One on
//! the CPU and one on a GPU; the session keeps the order of a frame (drain, cut, upload, draw), a
//! painter does each step.

mod cpu;
mod gpu;

pub(crate) use cpu::CpuPainter;
pub(crate) use gpu::GpuPainter;

use crate::draw::frame::Look;
use anyhow::Result;
use esker_format::Forest;
use esker_lod::{DepthFeedback, View};
use esker_render::gpu::wgpu;
use esker_render::{Picture, Stats};
use esker_stream::{Cut, Needs, StreamError, Streamer};
use std::sync::Arc;

/// A drawn picture, where it lies.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// In main memory.
    Memory(&'a Picture),
    /// On the GPU: rgba8unorm, sRGB bytes, straight alpha. The commands that draw it are submitted.
    Texture(&'a wgpu::TextureView),
}

impl<'a> Image<'a> {
    /// The picture, where it lies in main memory.
    pub fn in_memory(self) -> Option<&'a Picture> {
        match self {
            Self::Memory(picture) => Some(picture),
            Self::Texture(_) => None,
        }
    }
}

/// Bytes of GPU buffers, as counted at the allocator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuBytes {
    /// Of all that live.
    pub bytes: u64,
    /// The most that lived at once.
    pub peak_bytes: u64,
    /// Those that are no node planes: upload runs, frame buffer, pyramid, picture, tables.
    pub fixed_bytes: u64,
}

/// What is drawn, and how.
#[derive(Clone, Copy)]
pub(crate) struct Scene<'a> {
    pub(crate) file: &'a Forest,
    pub(crate) view: &'a View,
    pub(crate) cut: &'a Cut,
    pub(crate) look: &'a Look,
}

/// Memory for planes and a renderer. All but what loaders do in the landing is done by the render
/// thread.
pub(crate) trait Painter: Send {
    /// Starts streaming into its memory. `options` say neither how much there is of it nor in what
    /// pages.
    fn start(
        &self,
        file: Arc<Forest>,
        options: esker_stream::Options,
        needs: Needs,
    ) -> Result<Streamer, StreamError>;

    /// Takes landed runs of at most so many bytes, and one where there is any. Never waits.
    fn drain(&mut self, bytes_max: usize);

    /// Copies what was drained to its slots; the bytes.
    fn upload(&mut self) -> Result<u64>;

    /// Tells of the requests that were uploaded, and frees their runs. Never waits.
    fn tell(&mut self, uploaded: &mut dyn FnMut(u64));

    /// Ends a frame in which nothing is drawn.
    fn flush(&mut self) -> Result<()>;

    /// Draws.
    fn draw(&mut self, scene: &Scene<'_>) -> Result<()>;

    /// The picture of the last frame; `None` before there is one.
    fn image(&self) -> Option<Image<'_>>;

    /// What the newest finished frame did.
    fn stats(&self) -> Stats;

    /// The depth of the newest finished frame, if it has not been asked for before.
    fn feedback(&mut self) -> Option<DepthFeedback>;

    /// In how many frames the depth of one comes back, at most: 0 where at once.
    fn feedback_frames(&self) -> u32;

    /// The picture of the last frame in main memory; waits for it.
    fn picture(&mut self) -> Result<Picture>;

    /// Bytes of GPU buffers; `None` where there are none.
    fn gpu_bytes(&self) -> Option<GpuBytes>;

    /// What is wrong with a shader that has changed on the disk; the one before goes on.
    fn shader_fault(&self) -> Option<&str> {
        None
    }

    /// Lends no memory any more.
    fn close(&self);
}
