//! Times of the passes on the GPU, by timestamps around them, which are read back a few frames
//! later. A device without timestamps gives no times, and a frame without a free buffer is not
//! timed.

use crate::frame::PassTimes;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::readback::ReadbackRing;
use crate::gpu::device::{Counted, Gpu};
use crate::pass::Pass;
use wgpu::{BufferUsages, CommandEncoder, ComputePass, QuerySet};

/// Spans that a frame can time; later ones are not timed.
const SPANS_MAX: u32 = 96;
/// Bytes of a timestamp.
const STAMP: u64 = 8;

/// Times the passes of frames.
#[derive(Debug, Default)]
pub struct Timing {
    queries: Option<Queries>,
    /// Pass of each span of this frame.
    spans: Vec<Pass>,
    is_open: bool,
    newest: Option<PassTimes>,
}

#[derive(Debug)]
struct Queries {
    set: QuerySet,
    resolved: Counted,
    ring: ReadbackRing<Vec<Pass>>,
    ms_a_tick: f64,
}

impl Timing {
    /// Creates the queries; without timestamps nothing is timed.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        if !gpu.tier.has_timestamps {
            return Ok(Self::default());
        }
        let bytes = u64::from(SPANS_MAX) * 2 * STAMP;
        let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timing"),
            ty: wgpu::QueryType::Timestamp,
            count: SPANS_MAX * 2,
        });
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        let queries = Queries {
            set,
            resolved: gpu.buffer("timestamps", bytes, usage)?,
            ring: ReadbackRing::new(gpu, "timestamps read back", bytes)?,
            ms_a_tick: f64::from(gpu.queue.get_timestamp_period()) * 1e-6,
        };
        Ok(Self { queries: Some(queries), ..Self::default() })
    }

    /// Begins a frame.
    pub fn begin(&mut self) {
        self.spans.clear();
        self.is_open = self.queries.as_ref().is_some_and(|q| q.ring.has_room());
    }

    /// Begins a compute pass whose time is added to that of `pass`.
    pub fn compute<'e>(&mut self, encoder: &'e mut CommandEncoder, pass: Pass) -> ComputePass<'e> {
        let timestamp_writes =
            self.span(pass).map(|(set, begin, end)| wgpu::ComputePassTimestampWrites {
                query_set: set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(end),
            });
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes })
    }

    /// Timestamps of a render pass whose time is added to that of `pass`.
    pub fn render(&mut self, pass: Pass) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        self.span(pass).map(|(set, begin, end)| wgpu::RenderPassTimestampWrites {
            query_set: set,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(end),
        })
    }

    fn span(&mut self, pass: Pass) -> Option<(&QuerySet, u32, u32)> {
        let queries = self.queries.as_ref().filter(|_| self.is_open)?;
        let index = self.spans.len() as u32;
        if index >= SPANS_MAX {
            return None;
        }
        self.spans.push(pass);
        Some((&queries.set, index * 2, index * 2 + 1))
    }

    /// Ends a frame, after its last pass and before its submission.
    pub fn end(&mut self, encoder: &mut CommandEncoder) {
        let count = self.spans.len() as u32 * 2;
        if let Some(queries) = self.queries.as_mut().filter(|_| self.is_open && count > 0) {
            encoder.resolve_query_set(&queries.set, 0..count, &queries.resolved, 0);
            let spans = std::mem::take(&mut self.spans);
            queries.ring.copy(encoder, &queries.resolved, u64::from(count) * STAMP, spans);
        }
        self.is_open = false;
    }

    /// To be called after the submission of the frame.
    pub fn submitted(&mut self) {
        if let Some(queries) = &mut self.queries {
            queries.ring.submitted();
        }
    }

    /// Times of the newest frame whose timestamps have arrived. The caller has polled the device.
    pub fn newest(&mut self) -> Option<PassTimes> {
        if let Some(queries) = &mut self.queries
            && let Some((spans, bytes)) = queries.ring.newest()
        {
            self.newest = Some(stages(&spans, &bytes, queries.ms_a_tick));
        }
        self.newest
    }
}

fn stages(spans: &[Pass], bytes: &[u8], ms_a_tick: f64) -> PassTimes {
    let mut stages = PassTimes::default();
    let (mut first, mut last) = (u64::MAX, 0);
    for (&pass, stamps) in spans.iter().zip(bytes.as_chunks::<16>().0) {
        let [begin, end] = bytemuck::cast::<[u8; 16], [u64; 2]>(*stamps);
        // The clocks of some drivers step back between passes; such a span counts as zero.
        stages.add(pass, end.saturating_sub(begin) as f64 * ms_a_tick);
        (first, last) = (first.min(begin), last.max(end));
    }
    stages.total_ms = last.saturating_sub(first) as f64 * ms_a_tick;
    stages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_one_pass_add_up_and_clocks_that_step_back_count_as_nothing() {
        let stamps = [10u64, 20, 20, 50, 60, 40];
        let all = stages(&[Pass::Pull, Pass::Pull, Pass::Push], bytemuck::bytes_of(&stamps), 0.5);
        assert_eq!((all.ms(Pass::Pull), all.ms(Pass::Push), all.total_ms), (20.0, 0.0, 20.0));
    }
}
