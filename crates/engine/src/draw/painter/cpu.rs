//! Drawing on the CPU: runs and drawing memory are plain memory, and the renderer works in the
//! current rayon pool.

use super::{FrameInput, GpuBytes, Image, Painter, report_complete};
use crate::draw::method::Method;
use crate::draw::slots::DrawingMemory;
use crate::draw::staging::{Landed, PlainRun, Staging};
use crate::light::progressive::CpuProgressive;
use crate::light::status::LitStatus;
use anyhow::{Context, Result};
use esker_format::Forest;
use esker_lod::{DepthFeedback, View, tiles_of};
use esker_render::{Picture, Renderer, Stats};
use esker_stream::{Shown, StreamError, Streamer};
use std::sync::Arc;

/// The CPU renderer and its memory.
pub(crate) struct CpuPainter {
    landing: Arc<Staging<PlainRun>>,
    landed: Vec<Landed<PlainRun>>,
    memory: DrawingMemory,
    drawing_bytes: u64,
    renderer: Renderer,
    picture: Picture,
    /// View of the picture, until its depth is taken.
    drawn: Option<View>,
    /// Drawer of lit frames, once there is one.
    lit: Option<CpuProgressive>,
}

impl CpuPainter {
    /// A painter with `drawing_bytes` of drawing memory and `runs` runs of staging.
    pub(crate) fn new(drawing_bytes: u64, runs: usize) -> Self {
        Self {
            landing: Arc::new(Staging::new(PlainRun::runs(runs.max(1)))),
            landed: Vec::new(),
            memory: DrawingMemory::new(drawing_bytes),
            drawing_bytes,
            renderer: Renderer::default(),
            picture: Picture::default(),
            drawn: None,
            lit: None,
        }
    }
}

impl Painter for CpuPainter {
    fn start(
        &self,
        file: Arc<Forest>,
        options: esker_stream::Options,
        shown: Shown,
    ) -> Result<Streamer, StreamError> {
        let (drawing_bytes, page_bytes) = (self.drawing_bytes, self.memory.page_bytes());
        let options = esker_stream::Options { drawing_bytes, page_bytes, ..options };
        Streamer::start(file, self.landing.clone(), options, shown)
    }

    fn bytes_within(&self, budget_gpu_bytes: u64) -> Option<u64> {
        Some(budget_gpu_bytes)
    }

    fn resize(&mut self, drawing_bytes: u64) {
        self.drawing_bytes = drawing_bytes;
        self.memory.resize(drawing_bytes);
    }

    fn free_beyond(&mut self, bytes: u64) {
        self.memory.free_beyond(bytes);
    }

    fn drain(&mut self, bytes_max: usize) {
        self.landed.extend(self.landing.take_up_to(bytes_max));
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

    fn report_uploaded(&mut self, uploaded: &mut dyn FnMut(u64)) {
        for (run, transfers) in self.landed.drain(..) {
            report_complete(&transfers, uploaded);
            self.landing.free(run, transfers);
        }
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }

    fn draw(&mut self, input: &FrameInput<'_>) -> Result<()> {
        let FrameInput { file, view, cut, appearance, light, splats_max } = *input;
        let memory = &self.memory;
        let around = cut.surroundings.as_ref();
        let mut draws = input.draws(|slot| memory.read(slot));
        draws.extend(input.draws_around(|slot| memory.read(slot)));
        let octree = around.map_or(&cut.octree, |around| &around.octree);
        let frame = appearance.frame(file, view, &draws, octree);
        if appearance.method == Method::Lit {
            let lit = match &mut self.lit {
                Some(lit) => lit,
                empty => empty.insert(CpuProgressive::on_cpu(light, splats_max)?),
            };
            let classes = input.classes(|slot| memory.read(slot));
            lit.draw(&frame, &classes[..], cut.epoch, light, &mut self.picture)?;
            // Nodes that are hidden still cast light and shadows.
            self.drawn = None;
            return Ok(());
        }
        self.lit = None;
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

    fn light(&self) -> Option<LitStatus> {
        self.lit.as_ref().map(CpuProgressive::status)
    }

    fn is_converged(&self) -> bool {
        self.lit.as_ref().is_none_or(CpuProgressive::is_converged)
    }

    fn gpu_bytes(&self) -> Option<GpuBytes> {
        None
    }

    fn close(&self) {
        self.landing.close();
    }
}
