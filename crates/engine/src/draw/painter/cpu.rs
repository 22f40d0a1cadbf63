//! Drawing on the CPU: runs of plain memory, drawing memory of plain pages, and the renderer in the
//! current rayon pool.

use super::{GpuBytes, Image, Painter, Scene};
use crate::draw::frame::draw_node;
use crate::draw::slots::DrawingMemory;
use crate::draw::staging::{Landed, PlainRun, RUN_BYTES, Staging};
use anyhow::{Context, Result};
use esker_format::Forest;
use esker_lod::{DepthFeedback, View, tiles_of};
use esker_render::{Picture, Renderer, Stats};
use esker_stream::{Needs, StreamError, Streamer};
use std::sync::Arc;

/// The CPU renderer and its memory.
pub(crate) struct CpuPainter {
    landing: Arc<Staging<PlainRun>>,
    landed: Vec<Landed<PlainRun>>,
    memory: DrawingMemory,
    drawing_bytes: u64,
    renderer: Renderer,
    picture: Picture,
    /// Of the picture, until its depth was asked for.
    drawn: Option<View>,
}

impl CpuPainter {
    /// With so many bytes of drawing memory and runs of staging.
    pub(crate) fn new(drawing_bytes: u64, runs: usize) -> Self {
        Self {
            landing: Arc::new(Staging::new(PlainRun::runs(runs.max(1)))),
            landed: Vec::new(),
            memory: DrawingMemory::new(drawing_bytes),
            drawing_bytes,
            renderer: Renderer::default(),
            picture: Picture::default(),
            drawn: None,
        }
    }
}

impl Painter for CpuPainter {
    fn start(
        &self,
        file: Arc<Forest>,
        options: esker_stream::Options,
        needs: Needs,
    ) -> Result<Streamer, StreamError> {
        let (drawing_bytes, page_bytes) = (self.drawing_bytes, self.memory.page_bytes());
        let options = esker_stream::Options { drawing_bytes, page_bytes, ..options };
        Streamer::start(file, self.landing.clone(), options, needs)
    }

    fn drain(&mut self, bytes_max: usize) {
        let runs = (bytes_max / RUN_BYTES).max(1);
        self.landed.extend(std::iter::from_fn(|| self.landing.take()).take(runs));
    }

    fn upload(&mut self) -> Result<u64> {
        let mut uploaded_bytes = 0;
        for (run, transfers) in &self.landed {
            for t in transfers {
                let bytes = run.bytes(t);
                self.memory.write(t.slot, t.slot_offset, bytes)?;
                uploaded_bytes += bytes.len() as u64;
            }
        }
        Ok(uploaded_bytes)
    }

    fn tell(&mut self, uploaded: &mut dyn FnMut(u64)) {
        for (run, transfers) in self.landed.drain(..) {
            transfers.iter().filter_map(|t| t.request).for_each(&mut *uploaded);
            self.landing.free(run, transfers);
        }
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }

    fn draw(&mut self, scene: &Scene<'_>) -> Result<()> {
        let Scene { file, view, cut, look } = *scene;
        let memory = &self.memory;
        let draws: Vec<_> = cut
            .nodes
            .iter()
            .enumerate()
            .map(|(entry, n)| {
                let node = &file.table().nodes[n.node as usize];
                let plane = |kind| n.slot(kind).map(|slot| memory.read(slot));
                draw_node(node, entry, n.prefix, &look.colouring, plane)
            })
            .collect();
        let frame = look.frame(file, view, &draws, &cut.octree);
        self.renderer.render_into(&frame, &mut self.picture)?;
        self.drawn = Some(*view);
        Ok(())
    }

    fn image(&self) -> Option<Image<'_>> {
        (!self.picture.rgba.is_empty()).then_some(Image::Memory(&self.picture))
    }

    fn stats(&self) -> Stats {
        self.picture.stats
    }

    fn feedback(&mut self) -> Option<DepthFeedback> {
        let view = self.drawn.take()?;
        let (view, picture) = match self.renderer.with_margin() {
            Some(wide) => (view, wide),
            None => (view.with_margin(0), &self.picture),
        };
        let [width, height] = [picture.width as usize, picture.height as usize];
        DepthFeedback::new(&view, &tiles_of(&picture.depth, width, height))
    }

    fn feedback_frames(&self) -> u32 {
        0
    }

    fn picture(&mut self) -> Result<Picture> {
        let picture = self.image().and_then(Image::in_memory).cloned();
        picture.context("no frame has been drawn")
    }

    fn gpu_bytes(&self) -> Option<GpuBytes> {
        None
    }

    fn close(&self) {
        self.landing.close();
    }
}
