//! The passes from a filled level 0 of the pyramid to the picture: pull, push, fill_holes,
//! silhouette, smooth_depth, shade and antialias. Kernels are built when a scene first needs them,
//! and bound once for each pyramid and picture; a frame then only runs their dispatches.

use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Compilation, Kernel};
use crate::gpu::device::shader::sources;
use crate::gpu::device::timing::Timing;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::picture::GpuPicture;
use crate::gpu::memory::pyramid::GpuPyramid;
use crate::gpu::passes::antialias::Antialias;
use crate::gpu::passes::fill_holes::FillHoles;
use crate::gpu::passes::pull::Pull;
use crate::gpu::passes::push::Push;
use crate::gpu::passes::shade::Shade;
use crate::gpu::passes::silhouette::Silhouette;
use crate::gpu::passes::smooth_depth::SmoothDepth;
use crate::gpu::target::{Radii, SurfaceTarget, Turns};
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

/// Kernels of the scenes whose pixels carry the same planes.
struct Kernels {
    /// Of EWA splatting alone, built when it is first drawn with.
    edges: Option<Kernel>,
    /// Of pull-push alone, built when it is first drawn with.
    filling: Option<Filling>,
    smooth_depth: Option<SmoothDepth>,
    shade: Shade,
    antialias: Antialias,
}

/// Kernels that fill the gaps of level 0 and trim what sticks out.
struct Filling {
    pull: Pull,
    push: Push,
    fill_holes: FillHoles,
    silhouette: Silhouette,
}

/// Variants of the passes, which a frame's plan chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choices {
    /// Planes that pixels carry, for which the pyramid has room.
    pub planes: Planes,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether push smooths the pixels of level 0 that it keeps.
    pub smooths: bool,
    /// Whether pixels with a normal are darkened behind edges.
    pub darkens_edges: bool,
    /// Whether fill_holes closes gaps, beside writing the depth image and its edges.
    pub fills_holes: bool,
    /// Whether splats were blended, so that nothing is filled.
    pub is_splats: bool,
}

/// Dispatches over one pyramid and picture.
struct Bound {
    /// Buffers that identify what is bound: the uniform, a plane of the pyramid, one of the
    /// picture.
    to: [wgpu::Buffer; 3],
    /// PassTimes of each choice so far: when a moving camera alternates between two choices,
    /// neither is bound again.
    stages: Vec<(Choices, Vec<PassDispatches>)>,
    /// Held here so that its bytes are counted, and for tests; bind groups alone would keep it
    /// alive.
    scratch: Scratch,
}

/// Dispatches that are timed and tested together.
#[derive(Debug)]
pub struct PassDispatches {
    /// Name of the CPU pass that it is compared with.
    pub name: &'static str,
    /// Pass that its time is added to.
    pub pass: Pass,
    dispatches: Vec<Dispatch>,
}

impl PassDispatches {
    /// Adds it to the commands of a frame.
    pub fn encode(&self, encoder: &mut CommandEncoder, timing: &mut Timing) {
        let mut pass = timing.compute(encoder, self.pass);
        self.dispatches.iter().for_each(|d| d.run(&mut pass));
    }
}

/// Memory of the passes: planes that several passes share, one after the other.
struct Scratch {
    marks: Counted,
    sources: Counted,
    spare: Counted,
    /// [`SurfaceTarget::depth`] and [`SurfaceTarget::shaded`].
    work: Counted,
    turns: Turns,
    radii: Radii,
}

impl Scratch {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let plane = |label| gpu.buffer(label, pixels * 4, usage);
        Ok(Self {
            marks: plane("surface marks")?,
            sources: plane("surface sources")?,
            spare: plane("surface spare")?,
            work: plane("surface work")?,
            turns: Turns::new(gpu, size)?,
            radii: Radii::new(gpu, size)?,
        })
    }

    /// Copies what a pass that does not run would have written, unchanged.
    fn pass_on(&self, encoder: &mut CommandEncoder, pass: Pass, picture: &GpuPicture) {
        let Self { sources, spare, work, radii, .. } = self;
        let mut copy = |from: &wgpu::Buffer, to: &wgpu::Buffer| {
            encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size());
        };
        match pass {
            Pass::Silhouette => {
                copy(work, &picture.depth);
                encoder.clear_buffer(sources, 0, None);
            }
            Pass::SmoothDepth => {
                copy(&picture.depth, spare);
                encoder.clear_buffer(&radii.corners, 0, None);
            }
            Pass::Antialias => copy(work, &picture.rgba),
            _ => (),
        }
    }

    fn target<'a>(
        &'a self,
        uniform: &'a wgpu::Buffer,
        pyramid: &'a GpuPyramid,
        picture: &'a GpuPicture,
    ) -> SurfaceTarget<'a> {
        let Self { marks, sources, spare, work, turns, radii } = self;
        let (depth, shaded) = (work, work);
        SurfaceTarget {
            uniform,
            pyramid,
            picture,
            marks,
            depth,
            sources,
            spare,
            shaded,
            turns,
            radii,
        }
    }
}

impl Filling {
    fn new(gpu: &Gpu, planes: Planes) -> Result<Self, GpuError> {
        let has_normals = planes == Planes::Normals;
        thread::scope(|scope| {
            let silhouette = Compilation::start(scope, || Silhouette::new(gpu, has_normals))?;
            let fill_holes = Compilation::start(scope, || FillHoles::new(gpu, planes))?;
            let push = Compilation::start(scope, || Push::new(gpu, planes))?;
            Ok(Self {
                pull: Pull::new(gpu, planes)?,
                push: push.finish()?,
                fill_holes: fill_holes.finish()?,
                silhouette: silhouette.finish()?,
            })
        })
    }

    fn stages(
        &mut self,
        gpu: &Gpu,
        target: &SurfaceTarget<'_>,
        Choices { smooths, fills_holes, .. }: Choices,
    ) -> Result<[PassDispatches; 4], GpuError> {
        let (uniform, pyramid) = (target.uniform, target.pyramid);
        let push = self.push.dispatches(gpu, uniform, pyramid, smooths)?;
        let fill_holes = self.fill_holes.dispatches(gpu, target, fills_holes);
        Ok([
            stage("pull", Pass::Pull, self.pull.dispatches(gpu, uniform, pyramid)),
            stage("push", Pass::Push, push),
            stage("fill_holes", Pass::FillHoles, fill_holes),
            stage("silhouette", Pass::Silhouette, self.silhouette.dispatches(gpu, target)),
        ])
    }

    fn kernels(&mut self) -> impl Iterator<Item = &mut Kernel> {
        let Self { pull, push, fill_holes, silhouette } = self;
        let all = [pull.kernels(), push.kernels(), fill_holes.kernels(), silhouette.kernels()];
        all.into_iter().flatten()
    }
}

fn stage(name: &'static str, pass: Pass, dispatches: Vec<Dispatch>) -> PassDispatches {
    PassDispatches { name, pass, dispatches }
}

impl Kernels {
    fn new(gpu: &Gpu, Choices { planes, is_splats, .. }: Choices) -> Result<Self, GpuError> {
        let has_normals = planes == Planes::Normals;
        thread::scope(|scope| {
            let filling = (!is_splats)
                .then(|| Compilation::start(scope, || Filling::new(gpu, planes)))
                .transpose()?;
            let shade = Compilation::start(scope, || {
                Ok((Shade::new(gpu, has_normals)?, Antialias::new(gpu, has_normals)?))
            })?;
            let smooth_depth = if has_normals { None } else { Some(SmoothDepth::new(gpu)?) };
            let (shade, antialias) = shade.finish()?;
            let filling = filling.map(Compilation::finish).transpose()?;
            Ok(Self { edges: None, filling, smooth_depth, shade, antialias })
        })
    }

    fn stages(
        &mut self,
        gpu: &Gpu,
        target: &SurfaceTarget<'_>,
        choices: Choices,
    ) -> Result<Vec<PassDispatches>, GpuError> {
        let mut stages = Vec::new();
        if choices.is_splats {
            // EWA splatting fills level 0 and the picture's depth.
            let edges = match &mut self.edges {
                Some(edges) => edges,
                none => none.insert(Kernel::new(gpu, sources::EWA_EDGES, "main", &[])?),
            };
            let marks = [&target.picture.depth, target.marks, target.sources];
            stages.push(stage("edges", Pass::Blend, vec![target.dispatch(gpu, edges, &marks)]));
        } else {
            let filling = match &mut self.filling {
                Some(filling) => filling,
                none => none.insert(Filling::new(gpu, choices.planes)?),
            };
            stages.extend(filling.stages(gpu, target, choices)?);
        }
        let smooth_depth = self.smooth_depth.iter();
        stages.extend(
            smooth_depth
                .map(|r| stage("smooth_depth", Pass::SmoothDepth, r.dispatches(gpu, target))),
        );
        let Choices { shines, darkens_edges, .. } = choices;
        let shade = self.shade.dispatches(gpu, target, shines, darkens_edges)?;
        stages.push(stage("shade", Pass::Shade, shade));
        stages.push(stage("antialias", Pass::Antialias, self.antialias.dispatches(gpu, target)));
        Ok(stages)
    }

    fn all(&mut self) -> impl Iterator<Item = &mut Kernel> {
        let Self { edges, filling, smooth_depth, shade, antialias } = self;
        let filling = filling.iter_mut().flat_map(Filling::kernels);
        let smooth_depth = smooth_depth.iter_mut().flat_map(SmoothDepth::kernels);
        filling.chain(edges).chain(shade.kernels()).chain(antialias.kernels()).chain(smooth_depth)
    }
}

impl Surface {
    /// Adds the passes of `plan` to the commands of a frame. Level 0 of `pyramid` is filled,
    /// `picture` has its size, and `uniform` holds the [`crate::gpu::memory::frame::FrameUniform`].
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    #[allow(clippy::too_many_arguments, reason = "each input of a pass has its own argument")]
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
        let choices = Choices {
            planes,
            shines,
            smooths,
            darkens_edges: plan.darkens_edges(),
            fills_holes: plan.passes.contains(&Pass::FillHoles),
            is_splats: plan.passes.contains(&Pass::Blend),
        };
        self.stages(gpu, uniform, pyramid, picture, choices)?;
        let Some(Bound { stages, scratch, .. }) = &self.bound else { return Ok(()) };
        let chosen = stages.iter().find(|(chosen, _)| *chosen == choices);
        for stage in chosen.iter().flat_map(|(_, stages)| stages) {
            // The depth image and its edges are always needed.
            if plan.passes.contains(&stage.pass) || stage.pass == Pass::FillHoles {
                stage.encode(encoder, timing);
            } else {
                scratch.pass_on(encoder, stage.pass, picture);
            }
        }
        Ok(())
    }

    /// All passes of a method in their order; [`Surface::encode`] runs those that a plan has.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn stages(
        &mut self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        pyramid: &GpuPyramid,
        picture: &GpuPicture,
        choices: Choices,
    ) -> Result<&[PassDispatches], GpuError> {
        let to = [uniform, &pyramid.levels[0].front, &*picture.rgba].map(Clone::clone);
        if self.bound.as_ref().is_none_or(|bound| bound.to != to) {
            // The old memory is released first, so that both never exist at once.
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
                    Entry::Vacant(place) => place.insert(Kernels::new(gpu, choices)?),
                };
                let target = scratch.target(uniform, pyramid, picture);
                stages.push((choices, kernels.stages(gpu, &target, choices)?));
                stages.len() - 1
            }
        };
        Ok(&stages[at].1)
    }

    /// Source of each pixel in the last frame (`shaders/common/source.wgsl`).
    pub fn sources(&self) -> Option<&wgpu::Buffer> {
        self.bound.as_ref().map(|b| &*b.scratch.sources)
    }

    /// Depths that fill_holes left, until a later pass has run.
    pub fn filled(&self) -> Option<&wgpu::Buffer> {
        self.bound.as_ref().map(|b| &*b.scratch.work)
    }

    /// Releases the pyramid and the picture of the last frame, before others replace them.
    pub fn release(&mut self) {
        self.bound = None;
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only). Whether any has.
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
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
