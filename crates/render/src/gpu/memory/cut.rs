//! The cut in GPU memory: tables of its nodes and of their chunks, and lists of chunks whose planes
//! are in the same pages, so that each combination of pages takes one dispatch. The tables are
//! written in every frame, to buffers that stay and grow by doubling.

use crate::frame::Frame;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::table::{CHUNK_POINTS, Chunk, Draw, NO_PAGE, PlaneAt};
use crate::inputs::camera::Camera;
use crate::inputs::thinning::Thinning;
use crate::plan::FramePlan;
use std::collections::BTreeSet;
use std::ops::Range;
use wgpu::BufferUsages;

/// Chunks of a frame at most: points have numbers of 32 bits, and all ones means no point.
const CHUNKS_MAX: u32 = u32::MAX / CHUNK_POINTS;
/// Lists of chunks begin at multiples of this number of words: the alignment of bound ranges, 256
/// bytes.
const WORK_STEP: usize = 64;
/// Bytes of a table at least.
const TABLE_BYTES_MIN: u64 = 1 << 14;

/// Pages of the planes of a chunk; [`NO_PAGE`] for planes that it does not need.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pages {
    /// Page of the positions.
    pub position: u32,
    /// Page of the residual bits.
    pub residual: u32,
    /// Page of the normals, if points are culled by them or averaged.
    pub normal: u32,
    /// Page of the colours, if points are averaged.
    pub colour: u32,
}

/// Chunks whose planes are in the same pages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Work {
    /// Pages of the planes.
    pub pages: Pages,
    /// Range of the chunks in [`GpuCut::list`], words.
    pub range: Range<u32>,
}

/// Tables of a frame.
#[derive(Debug)]
pub struct GpuCut {
    /// Rows of [`GpuCut::draws`].
    pub rows: Vec<Draw>,
    /// Chunks by their pages.
    pub work: Vec<Work>,
    /// Number of points drawn.
    pub points: u64,
    chunk_rows: Vec<Chunk>,
    list: Vec<u32>,
    by_pages: Vec<(Pages, u32)>,
    draws: Counted,
    chunks: Counted,
    list_buffer: Counted,
}

impl GpuCut {
    /// Creates empty tables.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            rows: Vec::new(),
            work: Vec::new(),
            points: 0,
            chunk_rows: Vec::new(),
            list: Vec::new(),
            by_pages: Vec::new(),
            draws: table(gpu, "draws", TABLE_BYTES_MIN)?,
            chunks: table(gpu, "chunks", TABLE_BYTES_MIN)?,
            list_buffer: table(gpu, "work", TABLE_BYTES_MIN)?,
        })
    }

    /// Table of nodes, a [`Draw`] each. Nodes without points are left out.
    pub fn draws(&self) -> &wgpu::Buffer {
        &self.draws
    }

    /// Table of chunks, a [`Chunk`] each.
    pub fn chunks(&self) -> &wgpu::Buffer {
        &self.chunks
    }

    /// Number of chunks.
    pub fn chunk_count(&self) -> u32 {
        self.chunk_rows.len() as u32
    }

    /// Numbers of chunks, in the ranges of [`GpuCut::work`].
    pub fn list(&self) -> &wgpu::Buffer {
        &self.list_buffer
    }

    /// Pages of the planes of this cut; `read` selects positions with residual bits, colours and
    /// normals.
    pub fn pages<'p>(&self, pool: &'p NodePool, read: [bool; 3]) -> Vec<(u32, &'p wgpu::Buffer)> {
        let [geometry, colours, normals] = read;
        let of = |row: &Draw| {
            [
                (geometry, row.position_page),
                (geometry, row.residual_page),
                (colours, row.colour_page),
                (normals, row.normal_page),
            ]
        };
        let wanted = self.rows.iter().flat_map(of).filter(|&(is_read, _)| is_read);
        let numbers: BTreeSet<u32> = wanted.map(|(_, page)| page).collect();
        numbers.into_iter().filter_map(|n| Some((n, pool.page(n as usize)?))).collect()
    }

    /// Pages of the clip lines.
    pub fn clip_pages<'p>(&self, pool: &'p NodePool) -> Vec<(u32, &'p wgpu::Buffer)> {
        self.pages_of(pool, |row| row.clip_page)
    }

    /// Pages of the shapes of splats.
    pub fn tangent_pages<'p>(&self, pool: &'p NodePool) -> Vec<(u32, &'p wgpu::Buffer)> {
        self.pages_of(pool, |row| row.tangent_page)
    }

    fn pages_of<'p>(
        &self,
        pool: &'p NodePool,
        page: impl Fn(&Draw) -> u32,
    ) -> Vec<(u32, &'p wgpu::Buffer)> {
        let numbers: BTreeSet<u32> = self.rows.iter().map(page).collect();
        numbers.into_iter().filter_map(|n| Some((n, pool.page(n as usize)?))).collect()
    }

    /// Row of a point number in [`GpuCut::rows`], and index of the point in its node.
    pub fn find(&self, point: u32) -> Option<(usize, u32)> {
        let chunk = self.chunk_rows.get((point / CHUNK_POINTS) as usize)?;
        Some((chunk.draw as usize, chunk.first + point % CHUNK_POINTS))
    }

    /// Bindings of `shaders/common/points.wgsl` for the chunks of `work`, then `more`; `None` if a
    /// page does not exist. Planes that are not needed get the page of the positions.
    pub fn bind(
        &self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        uniform: &wgpu::Buffer,
        work: &Work,
        pool: &NodePool,
        more: &[&wgpu::Buffer],
    ) -> Option<wgpu::BindGroup> {
        let page = |page: u32| if page == NO_PAGE { work.pages.position } else { page };
        let page = |of: u32| pool.page(page(of) as usize);
        let bytes = |words: u32| u64::from(words) * size_of::<u32>() as u64;
        let list = wgpu::BufferBinding {
            buffer: &self.list_buffer,
            offset: bytes(work.range.start),
            size: wgpu::BufferSize::new(bytes(work.range.len() as u32)),
        };
        let buffers = [
            uniform.as_entire_binding(),
            self.draws.as_entire_binding(),
            self.chunks.as_entire_binding(),
            wgpu::BindingResource::Buffer(list),
            page(work.pages.position)?.as_entire_binding(),
            page(work.pages.residual)?.as_entire_binding(),
            page(work.pages.normal)?.as_entire_binding(),
        ];
        let all = buffers.into_iter().chain(more.iter().map(|b| b.as_entire_binding()));
        let entries: Vec<_> = (0..)
            .zip(all)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let label = Some("points");
        Some(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label,
            layout,
            entries: &entries,
        }))
    }

    /// The page of the colours of `work`, or that of the positions if they are not needed.
    pub fn colours<'p>(&self, work: &Work, pool: &'p NodePool) -> Option<&'p wgpu::Buffer> {
        let Pages { colour, position, .. } = work.pages;
        pool.page(if colour == NO_PAGE { position } else { colour } as usize)
    }

    /// Fills the tables from the nodes of a frame; they are uploaded with the next submission.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn fill(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_, PlaneAt>,
        camera: &Camera,
        plan: &FramePlan,
        pool: &NodePool,
    ) -> Result<(), GpuError> {
        let reads = plan.averages_read();
        self.rows.clear();
        self.chunk_rows.clear();
        self.by_pages.clear();
        self.points = 0;
        for draw in frame.draws {
            let first_chunk = self.chunk_rows.len() as u32;
            let mut row = Draw::of(draw, camera, first_chunk, |plane| pool.place(plane));
            if let Some(thinning) = Thinning::of(frame, draw) {
                row = row.thinned(&thinning);
            }
            // Positions are read in pairs of words.
            let is_whole = row.position_word.is_multiple_of(2);
            let room = (CHUNKS_MAX - first_chunk) * CHUNK_POINTS;
            row.points = if is_whole { row.points.min(room) } else { 0 };
            if row.points == 0 {
                continue;
            }
            let pages = Pages {
                position: row.position_page,
                residual: row.residual_page,
                normal: if plan.culls_back_faces || reads[1] { row.normal_page } else { NO_PAGE },
                colour: if reads[0] { row.colour_page } else { NO_PAGE },
            };
            let index = self.rows.len() as u32;
            let chunks = (0..row.points).step_by(CHUNK_POINTS as usize).map(|first| Chunk {
                draw: index,
                first,
                points: CHUNK_POINTS.min(row.points - first),
                unused: 0,
            });
            self.chunk_rows.extend(chunks);
            self.by_pages.push((pages, index));
            self.points += u64::from(row.points);
            self.rows.push(row);
        }
        self.group();
        self.upload(gpu)
    }

    /// Groups the chunks by their pages.
    fn group(&mut self) {
        self.by_pages.sort_unstable();
        self.list.clear();
        self.work.clear();
        for nodes in self.by_pages.chunk_by(|a, b| a.0 == b.0) {
            self.list.resize(self.list.len().next_multiple_of(WORK_STEP), 0);
            let start = self.list.len() as u32;
            for &(_, index) in nodes {
                let row = &self.rows[index as usize];
                self.list.extend((row.chunk..).take(row.points.div_ceil(CHUNK_POINTS) as usize));
            }
            let range = start..self.list.len() as u32;
            self.work.push(Work { pages: nodes[0].0, range });
        }
    }

    fn upload(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        upload(gpu, &mut self.draws, "draws", bytemuck::cast_slice(&self.rows))?;
        upload(gpu, &mut self.chunks, "chunks", bytemuck::cast_slice(&self.chunk_rows))?;
        upload(gpu, &mut self.list_buffer, "work", bytemuck::cast_slice(&self.list))
    }
}

fn table(gpu: &Gpu, label: &str, bytes: u64) -> Result<Counted, GpuError> {
    gpu.buffer(label, bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST)
}

fn upload(gpu: &Gpu, to: &mut Counted, label: &str, bytes: &[u8]) -> Result<(), GpuError> {
    let needed = bytes.len() as u64;
    if needed > to.size() {
        *to = table(gpu, label, needed.next_power_of_two())?;
    }
    if needed > 0 {
        gpu.queue.write_buffer(to, 0, bytes);
    }
    Ok(())
}
