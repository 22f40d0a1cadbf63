//! Devices for all adapters of the machine and all paths of the project pass; and uploads of scenes
//! to drawing memory, in pages so small that the planes of a node lie in several.
#![allow(dead_code, reason = "not every test uses all of it")]
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_render::gpu::device::all_interfaces;
use esker_render::gpu::{Gpu, GpuRequest, NodePool, PlaneAt, ProjectPath};
use esker_render::{ColourPlane, DrawNode, Frame};

/// Opens a device for each adapter and path, and one with the minimum that WebGPU guarantees.
/// Prints a note if there is no adapter.
pub fn gpus() -> Vec<Gpu> {
    open(&[Some(ProjectPath::Atomics), Some(ProjectPath::Primitives), None])
}

/// Opens one device for each path of an adapter; the one of point primitives has the minimum that
/// WebGPU guarantees. For tests with many kernels, which software drivers take seconds to compile.
pub fn few_gpus() -> Vec<Gpu> {
    open(&[Some(ProjectPath::Atomics), None])
}

/// Opens a device for each adapter and path; `None` asks for the minimum that WebGPU guarantees.
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

/// Drawing memory and the nodes whose planes are in it.
pub struct Uploaded<'a> {
    pub pool: NodePool,
    pub draws: Vec<DrawNode<'a, PlaneAt>>,
}

/// Uploads the planes of nodes to pages of at most `page_bytes`: all positions, then all residuals
/// and so on.
pub fn upload<'a>(gpu: &Gpu, draws: &[DrawNode<'a>], page_bytes: u64) -> Uploaded<'a> {
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
            above: d.above,
            position: positions[i],
            residual: residuals[i],
            colour: colours[i],
            normal: normals[i],
            clip: clips[i],
            tangents: tangents[i],
        })
        .collect();
    Uploaded { pool, draws }
}

/// The frame with planes in drawing memory instead of slices.
pub fn uploaded_frame<'a>(
    frame: &Frame<'a>,
    draws: &'a [DrawNode<'a, PlaneAt>],
) -> Frame<'a, PlaneAt> {
    frame.with_draws(draws)
}
