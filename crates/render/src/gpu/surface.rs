//! From a filled level 0 of the pyramid to the picture, on the GPU: pull, push, fill_holes, silhouette, shade, antialias. Kernels are
//! made when a scene first needs them, and bound once; a frame then only runs their dispatches.

use crate::gpu::device::dispatch::{Dispatch, Groups};
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Beside, Kernel};
use crate::gpu::device::shader::sources;
use crate::gpu::device::timing::Timing;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::memory::pyramid::{GpuLevel, GpuPyramid};
use crate::gpu::passes::antialias::Antialias;
use crate::gpu::passes::fill_holes::FillHoles;
use crate::gpu::passes::pull::Pull;
use crate::gpu::passes::push::Push;
use crate::gpu::passes::shade::Shade;
use crate::gpu::passes::silhouette::{Silhouette, Turns};
use crate::gpu::passes::smooth_depth::SmoothDepth;
use crate::pass::Pass;
use crate::picture::pyramid::Planes;
use crate::plan::FramePlan;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::thread;
use wgpu::{BufferUsages, CommandEncoder};

/// The passes, and the memory that they keep from frame to frame.
#[derive(Default)]
pub struct Surface {
    /// By the planes that pixels carry.
    kernels: HashMap<Planes, Kernels>,
    bound: Option<Bound>,
}

/// What a scene needs whose pixels carry some planes.
struct Kernels {
    edges: Kernel,
    pull: Pull,
    push: Push,
    fill_holes: FillHoles,
    silhouette: Silhouette,
    smooth_depth: Option<SmoothDepth>,
    shade: Shade,
    antialias: Antialias,
}

/// What a frame's plan leaves open to the passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choices {
    /// The planes that pixels carry: no others than the pyramid has room for.
    pub planes: Planes,
    /// Whether there are highlights.
    pub shines: bool,
    /// Whether pixels that push leaves as they are are smoothed.
    pub smooths: bool,
}

/// Dispatches over one pyramid and picture.
struct Bound {
    /// What they are bound to: the uniform, a plane of the pyramid, one of the picture.
    to: [wgpu::Buffer; 3],
    /// By what was chosen; points that begin to crowd while a camera moves cost no memory, nor bindings twice.
    stages: Vec<(Choices, Vec<Stage>)>,
    /// Bind groups keep memory alive; this counts it, and tests look at it.
    scratch: Scratch,
}

/// A run of dispatches that is timed and tested by itself.
#[derive(Debug)]
pub struct Stage {
    /// Its name: that of its twin.
    pub name: &'static str,
    /// What its time counts for.
    pub pass: Pass,
    dispatches: Vec<Dispatch>,
}

impl Stage {
    /// Adds it to the commands of a frame.
    pub fn encode(&self, encoder: &mut CommandEncoder, timing: &mut Timing) {
        let mut pass = timing.compute(encoder, self.pass);
        self.dispatches.iter().for_each(|d| d.run(&mut pass));
    }
}

/// What the passes after push work on.
pub struct Target<'a> {
    /// The frame's uniform.
    pub uniform: &'a wgpu::Buffer,
    /// The pyramid, pushed.
    pub pyramid: &'a GpuPyramid,
    /// The picture.
    pub picture: &'a GpuPicture,
    /// Bits of `shaders/common/marks.wgsl`, a word a pixel.
    pub marks: &'a Counted,
    /// Depth after fill_holes, `f32` a pixel; [`crate::gpu::passes::silhouette`] makes the picture's from it. Then it is free for depth
    /// smoothed along rows, and then for [`Target::shaded`].
    pub depth: &'a Counted,
    /// Whose attributes each pixel shows, a word a pixel (`shaders/common/source.wgsl`).
    pub sources: &'a Counted,
    /// Sources between two halves of a turn; then smooth depth.
    pub spare: &'a Counted,
    /// Colours before they are softened, sRGB bytes, a word a pixel.
    pub shaded: &'a Counted,
    /// What the turns of silhouette keep.
    pub turns: &'a Turns,
    /// The structure `SmoothDepth` of `shaders/common/smoothing.wgsl`.
    pub smoothing: &'a Counted,
}

impl<'a> Target<'a> {
    /// The picture's level.
    pub fn base(&self) -> &'a GpuLevel {
        &self.pyramid.levels[0]
    }

    /// A kernel over the picture that has the uniform at binding 0 and these after it.
    pub(crate) fn dispatch(&self, gpu: &Gpu, kernel: &Kernel, buffers: &[&Counted]) -> Dispatch {
        let size = [self.picture.width, self.picture.height];
        Dispatch::over(gpu, kernel, size, &self.resources(buffers))
    }

    /// The same, one group.
    pub(crate) fn one_group(&self, gpu: &Gpu, kernel: &Kernel, buffers: &[&Counted]) -> Dispatch {
        Dispatch::new(gpu, kernel, Groups::Fixed([1, 1]), &self.resources(buffers))
    }

    pub(crate) fn resources<'b>(
        &'b self,
        buffers: &[&'b Counted],
    ) -> Vec<(u32, wgpu::BindingResource<'b>)> {
        let all = std::iter::once(self.uniform).chain(buffers.iter().map(|b| &***b));
        (0..).zip(all.map(wgpu::Buffer::as_entire_binding)).collect()
    }
}

/// Memory of the passes: four planes, used again and again.
struct Scratch {
    marks: Counted,
    sources: Counted,
    spare: Counted,
    /// Depth after fill_holes, then rows, then colours.
    work: Counted,
    turns: Turns,
    smoothing: Counted,
}

impl Scratch {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let plane =
            |label| gpu.buffer(label, pixels * 4, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        Ok(Self {
            marks: plane("surface marks")?,
            sources: plane("surface sources")?,
            spare: plane("surface spare")?,
            work: plane("surface work")?,
            turns: Turns::new(gpu, size)?,
            smoothing: gpu.buffer(
                "smoothing",
                16,
                BufferUsages::STORAGE | BufferUsages::UNIFORM,
            )?,
        })
    }

    fn target<'a>(
        &'a self,
        uniform: &'a wgpu::Buffer,
        pyramid: &'a GpuPyramid,
        picture: &'a GpuPicture,
    ) -> Target<'a> {
        let Self { marks, sources, spare, work, turns, smoothing } = self;
        let (depth, shaded) = (work, work);
        Target { uniform, pyramid, picture, marks, depth, sources, spare, shaded, turns, smoothing }
    }
}

impl Kernels {
    fn new(gpu: &Gpu, planes: Planes) -> Result<Self, GpuError> {
        let has_normals = planes == Planes::Normals;
        thread::scope(|scope| {
            let silhouette = Beside::begin(scope, || Silhouette::new(gpu, has_normals))?;
            let fill_holes = Beside::begin(scope, || FillHoles::new(gpu, planes))?;
            let push = Beside::begin(scope, || Push::new(gpu, planes))?;
            let shade = Beside::begin(scope, || {
                Ok((Shade::new(gpu, has_normals)?, Antialias::new(gpu, has_normals)?))
            })?;
            let smooth_depth = Beside::begin(scope, || {
                if has_normals { Ok(None) } else { SmoothDepth::new(gpu).map(Some) }
            })?;
            let edges = Kernel::new(gpu, sources::EWA_EDGES, "main", &[])?;
            let pull = Pull::new(gpu, planes)?;
            let (shade, antialias) = shade.get()?;
            Ok(Self {
                edges,
                pull,
                push: push.get()?,
                fill_holes: fill_holes.get()?,
                silhouette: silhouette.get()?,
                smooth_depth: smooth_depth.get()?,
                shade,
                antialias,
            })
        })
    }

    fn stages(
        &mut self,
        gpu: &Gpu,
        target: &Target<'_>,
        Choices { shines, smooths, .. }: Choices,
    ) -> Result<Vec<Stage>, GpuError> {
        let stage = |name, pass, dispatches| Stage { name, pass, dispatches };
        let uniform = target.uniform;
        let marks = [&target.picture.depth, target.marks, target.sources];
        let push = self.push.dispatches(gpu, uniform, target.pyramid, smooths)?;
        let mut stages = vec![
            // After EWA splatting, which has filled level 0 and the picture's depth.
            stage("edges", Pass::Blend, vec![target.dispatch(gpu, &self.edges, &marks)]),
            stage("pull", Pass::Pull, self.pull.dispatches(gpu, uniform, target.pyramid)),
            stage("push", Pass::Push, push),
            stage("fill_holes", Pass::FillHoles, self.fill_holes.dispatches(gpu, target)),
            stage("silhouette", Pass::Silhouette, self.silhouette.dispatches(gpu, target)),
        ];
        let smooth_depth = self.smooth_depth.iter();
        stages.extend(
            smooth_depth
                .map(|r| stage("smooth_depth", Pass::SmoothDepth, r.dispatches(gpu, target))),
        );
        stages.push(stage("shade", Pass::Shade, self.shade.dispatches(gpu, target, shines)?));
        stages.push(stage("antialias", Pass::Antialias, self.antialias.dispatches(gpu, target)));
        Ok(stages)
    }

    fn all(&mut self) -> impl Iterator<Item = &mut Kernel> {
        let Self { edges, pull, push, fill_holes, silhouette, smooth_depth, shade, antialias } =
            self;
        let some = [pull.kernels(), push.kernels(), fill_holes.kernels(), silhouette.kernels()];
        let smooth_depth = smooth_depth.iter_mut().flat_map(SmoothDepth::kernels);
        some.into_iter()
            .flatten()
            .chain([edges])
            .chain(shade.kernels())
            .chain(antialias.kernels())
            .chain(smooth_depth)
    }
}

impl Surface {
    /// Adds the passes to the commands of a frame: level 0 of `pyramid` is filled, `picture` has its size, and
    /// `uniform` holds the frame ([`crate::gpu::memory::frame::FrameUniform`]).
    ///
    /// # Errors
    /// Where a shader or memory is refused.
    #[allow(clippy::too_many_arguments, reason = "what a pass reads is named, one by one")]
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        plan: &FramePlan,
        uniform: &wgpu::Buffer,
        pyramid: &GpuPyramid,
        picture: &GpuPicture,
        timing: &mut Timing,
    ) -> Result<(), GpuError> {
        let (planes, shines, smooths) = (plan.planes(), plan.shines, plan.smooths);
        let choices = Choices { planes, shines, smooths };
        let stages = self.stages(gpu, uniform, pyramid, picture, choices)?;
        for stage in stages.iter().filter(|stage| plan.passes.contains(&stage.pass)) {
            stage.encode(encoder, timing);
        }
        Ok(())
    }

    /// The passes one by one, of which [`Surface::encode`] runs those of a plan.
    ///
    /// # Errors
    /// Where a shader or memory is refused.
    pub fn stages(
        &mut self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        pyramid: &GpuPyramid,
        picture: &GpuPicture,
        choices: Choices,
    ) -> Result<&[Stage], GpuError> {
        let to = [uniform, &pyramid.levels[0].front, &*picture.rgba].map(Clone::clone);
        if self.bound.as_ref().is_none_or(|bound| bound.to != to) {
            // The old memory goes first, so that never both are there.
            self.release();
            let scratch = Scratch::new(gpu, [picture.width, picture.height])?;
            self.bound = Some(Bound { to, stages: Vec::new(), scratch });
        }
        let Some(Bound { stages, scratch, .. }) = &mut self.bound else { return Ok(&[]) };
        let known = stages.iter().position(|(chosen, _)| *chosen == choices);
        let at = match known {
            Some(at) => at,
            None => {
                let kernels = match self.kernels.entry(choices.planes) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(place) => place.insert(Kernels::new(gpu, choices.planes)?),
                };
                let target = scratch.target(uniform, pyramid, picture);
                stages.push((choices, kernels.stages(gpu, &target, choices)?));
                stages.len() - 1
            }
        };
        Ok(&stages[at].1)
    }

    /// Whose attributes each pixel shows, as silhouette has found in the last frame (`shaders/common/source.wgsl`).
    pub fn sources(&self) -> Option<&wgpu::Buffer> {
        self.bound.as_ref().map(|b| &*b.scratch.sources)
    }

    /// Depths after fill_holes, while nothing that comes after it has run.
    pub fn filled(&self) -> Option<&wgpu::Buffer> {
        self.bound.as_ref().map(|b| &*b.scratch.work)
    }

    /// Lets go of the pyramid and the picture that it was used with last, before others take their place.
    pub fn release(&mut self) {
        self.bound = None;
    }

    /// Makes kernels anew whose shaders have changed on the disk (debug runs only). Whether any has.
    ///
    /// # Errors
    /// Where a changed shader does not build; its kernel is as it was.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let mut is_changed = false;
        for kernel in self.kernels.values_mut().flat_map(Kernels::all) {
            is_changed |= kernel.reload(gpu)?;
        }
        if is_changed {
            self.release();
        }
        Ok(is_changed)
    }
}
