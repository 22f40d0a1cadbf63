//! Shared by the tests of gather, resolve and tiles: projects a frame on the CPU, and runs the
//! passes on a GPU from the same hits and planes, with the planes of a node spread over small
//! pages.

use crate::scene::Dice;
use esker_lod::{DepthTile, View};
use esker_points::Lattice;
use esker_render::gpu::device::all_interfaces;
use esker_render::gpu::device::readback::read;
use esker_render::gpu::device::timing::Timing;
use esker_render::gpu::memory::frame::FrameUniform;
use esker_render::gpu::memory::lookup::{GpuLookup, WinningPoints};
use esker_render::gpu::memory::picture::GpuPicture;
use esker_render::gpu::memory::pyramid::GpuPyramid;
use esker_render::gpu::memory::table::{CHUNK_POINTS, Chunk, Draw};
use esker_render::gpu::passes::gather::Gather;
use esker_render::gpu::passes::resolve::Resolve;
use esker_render::gpu::passes::tiles::{TILES_BYTES, Tiles, tiles_from};
use esker_render::gpu::{Gpu, GpuRequest, NodePool, PlaneAt, wgpu};
use esker_render::inputs::camera::Camera;
use esker_render::inputs::lookup::{DrawList, Lookup};
use esker_render::passes::fit_planes::FittedPlanes;
use esker_render::passes::gather::gather;
use esker_render::passes::project::{EMPTY, project, unpack};
use esker_render::passes::resolve::resolve;
use esker_render::picture::pyramid::{Level, Planes};
use esker_render::{ColourPlane, DrawNode, Frame, FramePlan, Method, Picture};
use glam::{DVec3, Vec2, Vec4};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use wgpu::BufferUsages;

/// Bytes of a page of planes.
const PAGE_BYTES: u64 = 32 << 10;
/// Pages that planes are spread over.
const PAGES: u64 = 10;

/// Opens two devices for each adapter, one with all its features and one with the minimum that
/// WebGPU guarantees. Prints a note if there is no adapter.
pub fn gpus() -> Vec<Gpu> {
    let request = |backends, is_minimal| GpuRequest {
        backends,
        allow_software: true,
        is_minimal,
        path: None,
    };
    let requests = all_interfaces().iter().flat_map(|&b| [request(b, false), request(b, true)]);
    let gpus: Vec<Gpu> = requests.filter_map(|r| Gpu::open(&r).ok()).collect();
    if gpus.is_empty() {
        eprintln!("no adapter");
    }
    gpus
}

/// A frame after the project pass on the CPU.
pub struct CpuFrame<'a> {
    frame: &'a Frame<'a>,
    camera: Camera,
    list: DrawList,
    target: Vec<AtomicU64>,
    /// Hits (point and bits of depth) with points numbered by chunks, as on the GPU.
    pub hits: Vec<[u32; 2]>,
}

/// Index of the first chunk of each draw.
fn chunks_of(list: &DrawList, draws: usize) -> Vec<u32> {
    let counts = (0..draws).map(|d| (list.len(d) as u32).div_ceil(CHUNK_POINTS));
    let first = counts.scan(0, |next, count| {
        *next += count;
        Some(*next - count)
    });
    first.collect()
}

/// Projects a frame on the CPU.
pub fn project_on_cpu<'a>(frame: &'a Frame<'a>) -> CpuFrame<'a> {
    let camera = Camera::new(frame.view, frame.lattice).unwrap();
    let pixels = (frame.view.width * frame.view.height) as usize;
    let target: Vec<_> = (0..pixels).map(|_| AtomicU64::new(EMPTY)).collect();
    let list = DrawList::new(frame.draws);
    project(frame, &camera, &list, &target);
    let first = chunks_of(&list, frame.draws.len());
    let hits = target
        .iter()
        .map(|value| match value.load(Relaxed) {
            EMPTY => [u32::MAX; 2],
            value => {
                let (depth, point) = unpack(value);
                let (draw, index) = list.find(point);
                [first[draw] * CHUNK_POINTS + index as u32, depth.to_bits()]
            }
        })
        .collect();
    CpuFrame { frame, camera, list, target, hits }
}

impl CpuFrame<'_> {
    /// Gathers on the CPU; returns the number of valid pixels and level 0.
    pub fn gather(&self) -> (u64, Level) {
        let lookup = Lookup::new(self.frame, &self.camera, &self.list);
        let [width, height] = self.camera.size.map(|s| s as usize);
        let planes = FramePlan::new(self.frame).planes();
        let mut pyramid = esker_render::picture::pyramid::Pyramid::default();
        pyramid.fit(width, height, planes);
        let mut base = pyramid.levels.swap_remove(0);
        let mut fitted = FittedPlanes::default();
        let plan = FramePlan::new(self.frame);
        let (shares, levels) = (plan.shares(), plan.plane_levels());
        fitted.fill(&self.target, width, self.camera.focal_px, shares, levels);
        let fitted = (planes == Planes::Fitted).then_some(&fitted);
        (gather(&lookup, &self.target, fitted, &mut base), base)
    }

    /// Resolves on the CPU; returns the number of covered pixels and the picture of points.
    pub fn resolve(&self) -> (u64, Picture) {
        let lookup = Lookup::new(self.frame, &self.camera, &self.list);
        let [width, height] = self.camera.size;
        let mut picture = Picture { width, height, ..Picture::default() };
        picture.rgba.resize(self.target.len() * 4, 0);
        picture.depth.resize(self.target.len(), 0.0);
        let covered = resolve(&lookup, &self.target, self.frame.background, &mut picture);
        (covered, picture)
    }
}

/// Passes on one device.
pub struct GpuPasses {
    pub gpu: Gpu,
    lookup: GpuLookup,
    gather: Gather,
    resolve: Resolve,
    tiles: Tiles,
}

/// Planes and buffers of a frame.
struct Buffers {
    pool: NodePool,
    buffers: [esker_render::gpu::device::Counted; 5],
}

impl GpuPasses {
    pub fn new(gpu: Gpu) -> Self {
        Self {
            lookup: GpuLookup::new(&gpu).unwrap(),
            gather: Gather::default(),
            resolve: Resolve::new(&gpu).unwrap(),
            tiles: Tiles::new(&gpu).unwrap(),
            gpu,
        }
    }

    /// Makes a buffer with these bytes, at least as large as a row of a table, so that it can be
    /// bound.
    fn buffer(&self, bytes: &[u8], usage: BufferUsages) -> esker_render::gpu::device::Counted {
        let usage = usage | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let buffer =
            self.gpu.buffer("test", bytes.len().max(size_of::<Draw>()) as u64, usage).unwrap();
        self.gpu.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Uploads the planes and tables of a frame, and prepares the lookup.
    fn upload(&mut self, frame: &Frame<'_>, hits: &[[u32; 2]]) -> Buffers {
        let camera = Camera::new(frame.view, frame.lattice).unwrap();
        let mut pool = NodePool::with_pages(&self.gpu, PAGES * PAGE_BYTES, PAGE_BYTES);
        let mut ends = vec![0; PAGES as usize];
        let mut dice = Dice(99);
        let mut put = |bytes: &[u8]| {
            let taken = (bytes.len() as u64).next_multiple_of(16).max(16);
            let mut page = dice.bits() % PAGES;
            while ends[page as usize] + taken > PAGE_BYTES {
                page = (page + 1) % PAGES;
            }
            let offset = page * PAGE_BYTES + ends[page as usize];
            ends[page as usize] += taken;
            pool.write(&self.gpu, offset, bytes).unwrap();
            PlaneAt { offset, bytes: bytes.len() as u64 }
        };
        let placed = frame.draws.iter().map(|d| DrawNode {
            node: d.node,
            entry: d.entry,
            prefix: d.prefix,
            above: d.above,
            position: put(d.position),
            residual: d.residual.map(&mut put),
            colour: match d.colour {
                ColourPlane::None => ColourPlane::None,
                ColourPlane::Indexed => ColourPlane::Indexed,
                ColourPlane::Rgba(plane) => ColourPlane::Rgba(put(plane)),
                ColourPlane::Scalar { bytes, ty } => ColourPlane::Scalar { bytes: put(bytes), ty },
            },
            normal: d.normal.map(&mut put),
            clip: d.clip.map(&mut put),
            tangents: d.tangents.map(&mut put),
        });
        let placed: Vec<_> = placed.collect();
        let list = DrawList::new(frame.draws);
        let first = chunks_of(&list, frame.draws.len());
        let mut chunks = Vec::new();
        let rows: Vec<Draw> = placed
            .iter()
            .enumerate()
            .map(|(i, d)| {
                let row = Draw::of(d, &camera, first[i], |plane| pool.place(plane));
                assert_eq!(row.points as usize, list.len(i), "points of draw {i}");
                chunks.extend((0..row.points).step_by(CHUNK_POINTS as usize).map(|first| Chunk {
                    draw: i as u32,
                    first,
                    points: CHUNK_POINTS.min(row.points - first),
                    unused: 0,
                }));
                row
            })
            .collect();
        let uniform = FrameUniform::new(frame, &camera, FramePlan::new(frame).shares());
        let buffers = [
            self.buffer(bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM),
            self.buffer(bytemuck::cast_slice(hits), BufferUsages::STORAGE),
            self.buffer(bytemuck::cast_slice(&rows), BufferUsages::STORAGE),
            self.buffer(bytemuck::cast_slice(&chunks), BufferUsages::STORAGE),
            self.buffer(&[0; 8], BufferUsages::STORAGE),
        ];
        self.lookup.set(&self.gpu, frame).unwrap();
        Buffers { pool, buffers }
    }

    /// Gathers from `hits`; returns level 0 and the number of pixels that a point won.
    pub fn gather(
        &mut self,
        frame: &Frame<'_>,
        hits: &[[u32; 2]],
        pyramid: &GpuPyramid,
    ) -> (Level, u32) {
        let made = self.upload(frame, hits);
        let pages = made.pages();
        let won = made.won(frame, &pages);
        let plan = FramePlan::new(&Frame { method: Method::PullPush, ..*frame });
        let (gpu, lookup, gather) = (&self.gpu, &mut self.lookup, &mut self.gather);
        let size = [frame.view.width, frame.view.height];
        gather.fit_planes.fit(gpu, size, &plan).unwrap();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        gather.fit_planes.encode(gpu, &mut encoder, won.uniform, won.hits, &mut Timing::default());
        gpu.queue.submit([encoder.finish()]);
        run(gpu, |pass| gather.encode(gpu, pass, &plan, lookup, &won, pyramid).unwrap());
        let level = &pyramid.levels[0];
        let planes = [&level.front, &level.tint, &level.depth, &level.plane, &made.buffers[4]];
        let planes = planes.map(|p| (&**p, p.size()));
        let [front, tint, depth, plane, counts] = read(gpu, &planes).unwrap().try_into().unwrap();
        let pixels = hits.len();
        let wide = |bytes: &[u8]| -> Vec<Vec4> {
            let values: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&bytes[..pixels * 16]);
            values.into_iter().map(Vec4::from_array).collect()
        };
        let level = Level {
            width: frame.view.width as usize,
            height: frame.view.height as usize,
            edge_px: 1.0,
            front: wide(&front),
            tint: wide(&tint),
            depth: bytemuck::pod_collect_to_vec(&depth[..pixels * 4]),
            normal: if pyramid.planes == Planes::Normals { wide(&plane) } else { Vec::new() },
            tilt: match pyramid.planes {
                Planes::Fitted => {
                    let pairs: Vec<[f32; 2]> = bytemuck::pod_collect_to_vec(&plane[..pixels * 8]);
                    pairs.into_iter().map(Vec2::from_array).collect()
                }
                Planes::None | Planes::Normals => Vec::new(),
            },
        };
        (level, u32::from_le_bytes([0, 1, 2, 3].map(|i| counts[i])))
    }

    /// Resolves `hits`; returns colours and depths of the picture of points, and the numbers of
    /// pixels won and covered.
    pub fn resolve(
        &mut self,
        frame: &Frame<'_>,
        hits: &[[u32; 2]],
    ) -> (Vec<u8>, Vec<f32>, [u32; 2]) {
        let made = self.upload(frame, hits);
        let pages = made.pages();
        let won = made.won(frame, &pages);
        let gpu = &self.gpu;
        let picture = GpuPicture::new(gpu, [frame.view.width, frame.view.height], 0).unwrap();
        let plan = FramePlan::new(&Frame { method: Method::Points, ..*frame });
        let (lookup, resolve) = (&mut self.lookup, &mut self.resolve);
        run(gpu, |pass| resolve.encode(gpu, pass, &plan, lookup, &won, &picture).unwrap());
        let bytes = hits.len() as u64 * 4;
        let sources = [(&*picture.rgba, bytes), (&*picture.depth, bytes), (&*made.buffers[4], 8)];
        let [rgba, depth, counts] = read(gpu, &sources).unwrap().try_into().unwrap();
        let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&counts);
        (rgba, bytemuck::pod_collect_to_vec(&depth), [counts[0], counts[1]])
    }

    /// Computes the tiles of a depth image.
    pub fn tiles(&mut self, depth: &[f32], width: u32, height: u32) -> Vec<DepthTile> {
        let view = View::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, 1.0, width, height);
        let lattice =
            Lattice { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let scene = crate::Scene { lattice, nodes: Vec::new() };
        let frame = scene.frame(&view, &[]);
        let camera = Camera::new(&view, &lattice).unwrap();
        let uniform = FrameUniform::new(&frame, &camera, FramePlan::new(&frame).shares());
        let uniform = self.buffer(bytemuck::bytes_of(&uniform), BufferUsages::UNIFORM);
        let depth = self.buffer(bytemuck::cast_slice(depth), BufferUsages::STORAGE);
        let (gpu, tiles) = (&self.gpu, &self.tiles);
        run(gpu, |pass| tiles.encode(gpu, pass, &uniform, &depth));
        tiles_from(&read(gpu, &[(tiles.buffer(), TILES_BYTES)]).unwrap()[0])
    }
}

impl Buffers {
    fn pages(&self) -> Vec<(u32, &wgpu::Buffer)> {
        let pages = 0..self.pool.pages();
        pages.filter_map(|i| Some((i as u32, self.pool.page(i)?))).collect()
    }

    fn won<'a>(
        &'a self,
        frame: &Frame<'_>,
        pages: &'a [(u32, &'a wgpu::Buffer)],
    ) -> WinningPoints<'a> {
        let [uniform, hits, draws, chunks, counts] = self.buffers.each_ref();
        let size = [frame.view.width, frame.view.height];
        WinningPoints { uniform, size, hits, draws, chunks, pages, counts }
    }
}

fn run(gpu: &Gpu, passes: impl FnOnce(&mut wgpu::ComputePass<'_>)) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    passes(&mut encoder.begin_compute_pass(&Default::default()));
    gpu.queue.submit([encoder.finish()]);
}
