//! Every adapter of the machine, each path on it; and scenes laid into drawing memory, in pages so
//! small that the planes of a node lie in several.
#![allow(dead_code, reason = "not every test uses all of it")]
#![allow(clippy::unwrap_used, reason = "tests may panic")]

pub mod flip;

use esker_render::gpu::device::all_interfaces;
use esker_render::gpu::{Gpu, GpuRequest, NodePool, PlaneAt, ProjectPath};
use esker_render::{ColourPlane, DrawNode, Frame};

/// A device for each adapter and path, also with the least that WebGPU promises; says so where
/// there is none.
pub fn gpus() -> Vec<Gpu> {
    open(&[Some(ProjectPath::Atomics), Some(ProjectPath::Primitives), None])
}

/// One device for each path of an adapter, the one of point primitives with the least that WebGPU
/// promises: for tests whose many kernels take software drivers seconds to compile.
pub fn few_gpus() -> Vec<Gpu> {
    open(&[Some(ProjectPath::Atomics), None])
}

/// Devices by these paths; the least that there is where none is named.
fn open(paths: &[Option<ProjectPath>]) -> Vec<Gpu> {
    let requests = all_interfaces().iter().flat_map(|&backends| {
        paths.iter().map(move |&path| GpuRequest {
            backends,
            allow_software: true,
            path,
            is_minimal: path.is_none(),
        })
    });
    let gpus: Vec<_> = requests.filter_map(|r| Gpu::open(&r).ok()).collect();
    if gpus.is_empty() {
        eprintln!("no adapter");
    }
    gpus
}

/// Name of a device and its path, for messages.
pub fn name(gpu: &Gpu) -> String {
    format!("{}, {:?}", gpu.name, gpu.tier.path)
}

/// Nodes whose planes lie in drawing memory.
pub struct Laid<'a> {
    pub pool: NodePool,
    pub draws: Vec<DrawNode<'a, PlaneAt>>,
}

/// Lays the planes of nodes into pages of at most so many bytes: all positions, then all residuals
/// and so on.
pub fn lay<'a>(gpu: &Gpu, draws: &[DrawNode<'a>], page_bytes: u64) -> Laid<'a> {
    let mut pool = NodePool::with_pages(gpu, 1 << 30, page_bytes);
    let mut next = 0;
    let mut put = |bytes: &[u8]| {
        let (page, size) = (pool.page_bytes(), bytes.len() as u64);
        if next % page + size.next_multiple_of(4) > page {
            next = next.next_multiple_of(page);
        }
        let at = PlaneAt { offset: next, bytes: size };
        pool.write(gpu, at.offset, bytes).unwrap();
        next = (next + size).next_multiple_of(256);
        at
    };
    let positions: Vec<_> = draws.iter().map(|d| put(d.position)).collect();
    let residuals: Vec<_> = draws.iter().map(|d| d.residual.map(&mut put)).collect();
    let normals: Vec<_> = draws.iter().map(|d| d.normal.map(&mut put)).collect();
    let clips: Vec<_> = draws.iter().map(|d| d.clip.map(&mut put)).collect();
    let tangents: Vec<_> = draws.iter().map(|d| d.tangents.map(&mut put)).collect();
    let colours: Vec<_> = draws
        .iter()
        .map(|d| match d.colour {
            ColourPlane::None => ColourPlane::None,
            ColourPlane::Indexed => ColourPlane::Indexed,
            ColourPlane::Rgba(bytes) => ColourPlane::Rgba(put(bytes)),
            ColourPlane::Scalar { bytes, ty } => ColourPlane::Scalar { bytes: put(bytes), ty },
        })
        .collect();
    let draws = draws
        .iter()
        .enumerate()
        .map(|(i, d)| DrawNode {
            node: d.node,
            entry: d.entry,
            prefix: d.prefix,
            position: positions[i],
            residual: residuals[i],
            colour: colours[i],
            normal: normals[i],
            clip: clips[i],
            tangents: tangents[i],
        })
        .collect();
    Laid { pool, draws }
}

/// The frame with its planes in drawing memory.
pub fn laid_frame<'a>(frame: &Frame<'a>, draws: &'a [DrawNode<'a, PlaneAt>]) -> Frame<'a, PlaneAt> {
    frame.with_draws(draws)
}
