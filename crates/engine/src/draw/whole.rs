//! Still pictures on a GPU: uploads planes that were read completely one after another, draws them,
//! and reads the picture back.

use crate::draw::frame::draw_node;
use crate::draw::scene::PictureScene;
use esker_format::{Forest, PlaneKind, Planes};
use esker_lod::CompactOctree;
use esker_render::gpu::{Gpu, GpuError, GpuRenderer, NodePool, PlaneAt};
use esker_render::{Frame, Picture, Stats};
use std::collections::HashMap;

/// Alignment of planes: what GPUs require of ranges that are bound.
const ALIGNMENT: u64 = 256;
/// Bytes that are uploaded before they are submitted: the queue keeps a copy of them until then.
const SENT_MAX: u64 = 64 << 20;

/// Places of planes in drawing memory.
#[derive(Default)]
struct Places {
    /// Place of a plane by index in the selection and kind.
    at: HashMap<(usize, PlaneKind), PlaneAt>,
    end: u64,
}

/// A scene in the memory of a GPU.
pub struct GpuScene {
    renderer: GpuRenderer,
    pool: NodePool,
    places: Places,
}

impl GpuScene {
    /// Uploads the planes of a scene.
    ///
    /// # Errors
    /// If the GPU has too little memory, refuses a shader, or fails.
    pub fn new(gpu: &Gpu, scene: &PictureScene) -> Result<Self, GpuError> {
        let renderer = GpuRenderer::new(gpu)?;
        let places = Places::of(scene, gpu.tier.page_bytes_max)?;
        let mut pool = NodePool::new(gpu, places.end);
        let mut sent = 0;
        for ((index, kind), at) in &places.at {
            let bytes = bytes_of(&scene.planes[*index], *kind);
            pool.write(gpu, at.offset, bytes)?;
            sent += at.bytes;
            if sent > SENT_MAX {
                gpu.queue.submit([]);
                sent = 0;
            }
        }
        Ok(Self { renderer, pool, places })
    }

    /// Submits a frame, after `change` has modified it.
    ///
    /// # Errors
    /// If the GPU has too little memory, or fails.
    pub fn draw(
        &mut self,
        file: &Forest,
        scene: &PictureScene,
        octree: &CompactOctree,
        change: impl Fn(&mut Frame<'_, PlaneAt>),
    ) -> Result<(), GpuError> {
        let nodes = scene.selection.drawn.iter().enumerate();
        let draws: Vec<_> = nodes
            .map(|(entry, drawn)| {
                let at = |kind| self.places.at.get(&(entry, kind)).copied();
                let colouring = &scene.appearance.colouring;
                draw_node(file.table(), drawn.node, entry, drawn.prefix, colouring, at)
            })
            .collect();
        let mut frame = scene.appearance.frame(file, &scene.view, &draws, octree);
        change(&mut frame);
        self.renderer.render(&frame, &self.pool)
    }

    /// Picture of the last frame; waits for it.
    ///
    /// # Errors
    /// If the GPU fails.
    pub fn picture(&mut self) -> Result<Picture, GpuError> {
        self.renderer.read()
    }

    /// Statistics of the last finished frame.
    pub fn stats(&mut self) -> Option<Stats> {
        self.renderer.stats()
    }
}

/// Draws a scene.
///
/// # Errors
/// If the GPU has too little memory, or fails.
pub fn draw(
    gpu: &Gpu,
    file: &Forest,
    scene: &PictureScene,
    octree: &CompactOctree,
) -> Result<Picture, GpuError> {
    let mut gpu_scene = GpuScene::new(gpu, scene)?;
    gpu_scene.draw(file, scene, octree, |_| ())?;
    gpu_scene.picture()
}

fn bytes_of(planes: &Planes, kind: PlaneKind) -> &[u8] {
    planes.get(kind).unwrap_or_default()
}

impl Places {
    /// Places planes one after another; none crosses the border of a page.
    fn of(scene: &PictureScene, page_bytes: u64) -> Result<Self, GpuError> {
        let mut places = Self::default();
        for (index, planes) in scene.planes.iter().enumerate() {
            for &kind in scene.kinds.iter().filter(|&&kind| planes.get(kind).is_some()) {
                let bytes = bytes_of(planes, kind).len() as u64;
                if bytes > page_bytes {
                    return Err(GpuError::Memory { what: "a plane of a node".into(), bytes });
                }
                let rest = page_bytes - places.end % page_bytes;
                let offset = if bytes > rest { places.end + rest } else { places.end };
                places.at.insert((index, kind), PlaneAt { offset, bytes });
                places.end = (offset + bytes).next_multiple_of(ALIGNMENT);
            }
        }
        Ok(places)
    }
}
