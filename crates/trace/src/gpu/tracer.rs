//! Accumulates samples of a picture on a GPU and combines them (`bauszat2011`, figure 1). In: a
//! scene in GPU memory, lights, a camera. Out: linear radiance, filtered. Twin:
//! [`crate::Tracer`], with the same numbers for all samples.

use crate::camera::Camera;
use crate::filter::{FilterKind, Settings};
use crate::gpu::filter::{FilterPictures, GuideNoise, LightFilter, PreparedGuides};
use crate::gpu::frame::{Buffers, PART_BYTES, PartBuffers};
use crate::gpu::history::reuse;
use crate::gpu::scene::GpuScene;
use crate::gpu::world::{LightBuffers, Part, Unsupported, World};
use crate::gpu::{Pixels, same_layout, same_values, sources, without_twin};
use crate::image::Image;
use crate::light::PreparedLights;
use crate::paths::{Batches, LitImage, Options, Sampler, Sequence, Stats, sampler_of};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::device::{Counted, readback};
use esker_render::gpu::wgpu::{Buffer, BufferUsages, ComputePass, PollType};
use esker_render::gpu::{Gpu, GpuError, Kernel};
use rayon::prelude::*;
use sources::constants::common_links::{ALBEDO_STEPS, RED_BITS};
use sources::constants::common_tally::{BOUNCE_RAYS, COUNTS, ESCAPED, SELF_HITS};
use sources::constants::common_tally::{SHADOW_RAYS, WITHOUT_GUIDE};
use std::sync::Arc;

/// Pixels on a side of a workgroup.
const GROUP_SIDE: u32 = 8;

/// Most samples of a pixel (`shaders/common/links.wgsl`).
const SAMPLES_MAX: u32 = 1024;

same_values!(common_links == crate::gpu::tracer { SAMPLES_MAX });
without_twin!(common_links { ALBEDO_STEPS, RED_BITS, GREEN_LOW_BITS });
const _: () = assert!(ALBEDO_STEPS as u32 * SAMPLES_MAX < 1 << RED_BITS);

/// Bytes of the counts of rays.
const COUNT_BYTES: u64 = COUNTS as u64 * 8;
const COUNTED: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC);
/// Pixels of a task that makes planes.
const TASK: usize = 1 << 14;

/// Why a picture was not lit.
#[derive(Debug, thiserror::Error)]
pub enum GpuLightError {
    /// The kernels do not draw it; the CPU does.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
    /// The device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// The uniform of the means (`shaders/trace/accumulate.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Means {
    pixels: u32,
    samples: u32,
    diagonal: f32,
    part_pixels: u32,
    first: u32,
    first_place: u32,
    has_past: u32,
    guides_from: f32,
}

same_layout!(Means {
    pixels,
    samples,
    diagonal,
    part_pixels,
    first,
    first_place,
    has_past,
    guides_from
});

/// The uniform of the combination (`shaders/trace/resolve.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Size {
    width: u32,
    height: u32,
    samples: u32,
    first: u32,
    rows: u32,
    first_place: u32,
    unused: [u32; 2],
}

same_layout!(Size { width, height, samples, first, rows, first_place });

/// A progressive path tracer of one picture.
pub struct GpuTracer {
    options: Options,
    kernels: Kernels,
    filter: LightFilter,
    frame: Option<Frame>,
    /// The newest lights in GPU memory.
    lights: Option<(PreparedLights, Arc<LightBuffers>)>,
    /// Noise of the guides of the last picture, for the filter of these settings.
    noise: Option<(Settings, GuideNoise)>,
    /// Bytes of the sums of a part of a picture at most.
    part_bytes: u64,
}

struct Kernels {
    guide: Kernel,
    indirect: Kernel,
    first: Kernel,
    direct: Kernel,
    accumulate: Kernel,
    resolve: Kernel,
    reuse: Kernel,
}

/// A picture in progress.
struct Frame {
    camera: Camera,
    scene_epoch: u64,
    lights: PreparedLights,
    light_buffers: Arc<LightBuffers>,
    world: World,
    diagonal: f32,
    batches: Batches,
    samples: u32,
    buffers: Buffers,
    /// Counts of rays (`shaders/common/tally.wgsl`).
    counts: Counted,
    /// Guides as the filter of these settings takes them, and whether their noise was estimated
    /// from them.
    prepared: Option<(Settings, PreparedGuides, bool)>,
}

impl GpuTracer {
    /// A tracer without samples.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu, options: Options) -> Result<Self, GpuError> {
        let kernel = |source| Kernel::new(gpu, source, "main", &[]);
        let direct = |first| Kernel::new(gpu, sources::TRACE_DIRECT, "main", &[("FIRST", first)]);
        let kernels = Kernels {
            guide: kernel(sources::TRACE_GUIDE)?,
            indirect: kernel(sources::TRACE_INDIRECT)?,
            first: direct(1.0)?,
            direct: direct(0.0)?,
            accumulate: kernel(sources::TRACE_ACCUMULATE)?,
            resolve: kernel(sources::TRACE_RESOLVE)?,
            reuse: kernel(sources::TRACE_REUSE)?,
        };
        let (filter, part_bytes) = (LightFilter::default(), PART_BYTES);
        let (frame, lights, noise) = (None, None, None);
        Ok(Self { options, kernels, filter, frame, lights, noise, part_bytes })
    }

    /// Traces pictures in parts whose sums take at most `part_bytes` bytes, for tests. The picture
    /// is the same.
    pub fn set_part_bytes(&mut self, part_bytes: u64) {
        (self.part_bytes, self.frame) = (part_bytes, None);
    }

    /// Its options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the options. Samples are kept if only the filter changes.
    pub fn set_options(&mut self, options: Options) {
        if !options.keeps_samples_of(&self.options) {
            self.frame = None;
        }
        self.options = options;
    }

    /// Adds `samples` samples to each pixel. If the scene (by its epoch), the lights or the camera
    /// differ from those of the last call, the picture begins afresh; indirect light of the last
    /// picture is used again as by the CPU's tracer. `should_stop` is asked before each sample: if
    /// it returns true, the call returns false, and the next call goes on where this one stopped.
    ///
    /// `lights` and `camera` must be relative to the origin of the scene.
    ///
    /// # Errors
    /// If the kernels do not draw these lights, options or sizes, or memory is refused.
    #[allow(clippy::too_many_arguments, reason = "those of the CPU's tracer, and the device")]
    pub fn trace(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        scene_epoch: u64,
        lights: &PreparedLights,
        camera: &Camera,
        samples: u32,
        should_stop: &dyn Fn() -> bool,
    ) -> Result<bool, GpuLightError> {
        if camera.pixels() == 0 {
            self.frame = None;
            return Ok(true);
        }
        let is_same = self.frame.as_ref().is_some_and(|frame| {
            frame.scene_epoch == scene_epoch && frame.camera == *camera && frame.lights == *lights
        });
        Buffers::check(gpu, camera.pixels())?;
        let had = self.frame.as_ref().filter(|_| is_same).map_or(0, |frame| frame.samples);
        if had.saturating_add(samples) > SAMPLES_MAX {
            return Err(Unsupported::Samples.into());
        }
        if scene.emits() {
            return Err(Unsupported::Emitters.into());
        }
        if !is_same {
            self.begin(gpu, scene, scene_epoch, lights, camera, samples)?;
        }
        let Some(frame) = &mut self.frame else { return Ok(true) };
        for _ in 0..samples {
            if should_stop() {
                return Ok(false);
            }
            frame.add_sample(gpu, &self.kernels, scene, &self.options)?;
        }
        Ok(true)
    }

    /// Begins a picture. If the lights are the same, incident light of a last picture of the same
    /// size is used again where it fits, until there are enough new samples.
    fn begin(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        scene_epoch: u64,
        lights: &PreparedLights,
        camera: &Camera,
        samples: u32,
    ) -> Result<(), GpuLightError> {
        let old = self.frame.take();
        let world = World::new(camera, lights, &self.options)?;
        let batches = batches(&self.options, camera, samples);
        let size = |camera: &Camera| [camera.width, camera.height].map(|side| side as u32);
        let is_used = |old: &Frame| {
            let has_same = old.lights == *lights && size(&old.camera) == size(camera);
            self.options.reprojects && old.samples > 0 && has_same
        };
        let (buffers, last) = match old {
            Some(old) if is_used(&old) => {
                // The mean of its samples, of which only the sums are up to date.
                old.submit_means(gpu, &self.kernels)?;
                let (buffers, last) = Buffers::after(gpu, old.buffers)?;
                (buffers, Some((last, old.camera, old.samples)))
            }
            old => {
                let old = old.map(|old| old.buffers);
                (Buffers::fit(gpu, size(camera), self.part_bytes, old)?, None)
            }
        };
        let light_buffers = self.upload(gpu, lights)?;
        let (camera, lights) = (*camera, lights.clone());
        let diagonal = scene.diagonal();
        let frame = Frame {
            camera,
            scene_epoch,
            lights,
            light_buffers,
            world,
            diagonal,
            batches,
            samples: 0,
            buffers,
            counts: gpu.buffer("counts of rays", COUNT_BYTES, COUNTED)?,
            prepared: None,
        };
        frame.guide(gpu, &self.kernels, scene)?;
        if let Some((last, before, samples)) = last {
            let cameras = [&before, &frame.camera];
            reuse(gpu, &self.kernels.reuse, &last, cameras, samples, &frame.buffers)?;
        }
        self.frame = Some(frame);
        Ok(())
    }

    /// The lights in GPU memory, uploaded if they have changed.
    fn upload(
        &mut self,
        gpu: &Gpu,
        lights: &PreparedLights,
    ) -> Result<Arc<LightBuffers>, GpuError> {
        if let Some((_, buffers)) = self.lights.as_ref().filter(|(known, _)| known == lights) {
            return Ok(Arc::clone(buffers));
        }
        self.lights = None;
        let buffers = Arc::new(LightBuffers::new(gpu, lights)?);
        self.lights = Some((lights.clone(), Arc::clone(&buffers)));
        Ok(buffers)
    }

    /// Waits until all samples are traced.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn wait(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let waited = gpu.device.poll(PollType::wait_indefinitely());
        waited.map_err(|fault| gpu.fault().unwrap_or(GpuError::Lost(fault.to_string())))?;
        gpu.fault().map_or(Ok(()), Err)
    }

    /// Samples of each pixel.
    pub fn samples(&self) -> u32 {
        self.frame.as_ref().map_or(0, |frame| frame.samples)
    }

    /// Counts since the picture was begun, read from the GPU; times are zero.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn stats(&self, gpu: &Gpu) -> Result<Stats, GpuError> {
        let Some(frame) = &self.frame else { return Ok(Stats::default()) };
        let read = readback::read(gpu, &[(&frame.counts, COUNT_BYTES)])?;
        let bytes = read.first().map_or(&[][..], Vec::as_slice).as_chunks::<8>().0;
        let count = |i: u32| bytes.get(i as usize).map_or(0, |&bytes| u64::from_le_bytes(bytes));
        Ok(Stats {
            // The first sample of a pixel is that of its guide.
            eye_rays: frame.pixels() * u64::from(frame.samples.max(1)),
            bounce_rays: count(BOUNCE_RAYS),
            shadow_rays: count(SHADOW_RAYS),
            self_hits: count(SELF_HITS),
            escaped: count(ESCAPED),
            without_guide: count(WITHOUT_GUIDE),
            ..Stats::default()
        })
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.frame = None;
    }

    /// Bytes of GPU memory that the samples take.
    pub fn bytes(&self) -> u64 {
        let lights = self.lights.as_ref().map_or(0, |(_, buffers)| buffers.bytes());
        lights + self.frame.as_ref().map_or(0, |frame| frame.buffers.bytes())
    }

    /// The picture of the samples so far, read from the GPU. Empty before the first call of
    /// [`GpuTracer::trace`].
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn resolve(&mut self, gpu: &Gpu) -> Result<LitImage, GpuError> {
        let Some(frame) = &mut self.frame else { return Ok(LitImage::default()) };
        let settings = &self.options.filter;
        // Pictures of one sample are those of a view that moves: what is known of the last one
        // saves reading guides back.
        let known = self.noise.as_ref().filter(|(of, _)| of == settings && frame.samples == 1);
        let known = known.map(|(_, noise)| *noise);
        let noise = frame.prepare(gpu, &self.kernels, &mut self.filter, settings, known)?;
        self.noise = Some((settings.clone(), noise));
        frame.combine(gpu, &self.kernels, &mut self.filter, &self.options)?;
        frame.read(gpu)
    }

    /// Unfiltered incident indirect light, and 1 where the filter takes it.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn incident(&self, gpu: &Gpu) -> Result<Image<4>, GpuError> {
        self.image(gpu, |frame| &frame.buffers.light)
    }

    /// Guides of the filter: normals scaled to [0, 1], and depth over the diagonal of the scene.
    ///
    /// # Errors
    /// If memory is refused or the device is lost.
    pub fn guides(&self, gpu: &Gpu) -> Result<Image<4>, GpuError> {
        self.image(gpu, |frame| &frame.buffers.guides)
    }

    /// Reads what the filter takes.
    fn image(&self, gpu: &Gpu, of: impl Fn(&Frame) -> &Pixels) -> Result<Image<4>, GpuError> {
        let Some(frame) = &self.frame else { return Ok(Image::default()) };
        frame.submit_means(gpu, &self.kernels)?;
        of(frame).read(gpu)
    }
}

/// Batches of samples, as the CPU's tracer makes them.
fn batches(options: &Options, camera: &Camera, samples: u32) -> Batches {
    let size = [camera.width, camera.height];
    let most = match options.sequence {
        Sequence::ZOrder => Sampler::log2_samples_max(size, options.shadow_log2()),
        Sequence::Independent => 16,
    };
    Batches::new(samples, most)
}

impl Frame {
    fn pixels(&self) -> u64 {
        self.camera.pixels() as u64
    }

    /// Workgroups over some rows.
    fn groups(&self, rows: u32) -> [u32; 3] {
        [(self.camera.width as u32).div_ceil(GROUP_SIDE), rows.div_ceil(GROUP_SIDE), 1]
    }

    /// Runs a kernel of rays over some rows; `buffers` are its bindings beside the scene.
    fn rays(
        &self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        kernel: &Kernel,
        scene: &GpuScene,
        (rows, buffers): (u32, &[(u32, &Buffer)]),
    ) {
        let bound = scene.bindings().into_iter().chain(buffers.iter().copied());
        let bound: Vec<_> = bound.collect();
        kernel.dispatch(pass, &kernel.bind(gpu, &bound), self.groups(rows));
    }

    /// Traces the guides.
    fn guide(&self, gpu: &Gpu, kernels: &Kernels, scene: &GpuScene) -> Result<(), GpuError> {
        for PartBuffers { part, places, .. } in &self.buffers.parts {
            let world = fixed_uniform(gpu, "world", bytes_of(&self.world.in_part(*part)))?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let mut pass = encoder.begin_compute_pass(&Default::default());
            let bound: [(u32, &Buffer); 3] =
                [(3, &world), (4, places), (5, &self.light_buffers.lamps)];
            self.rays(gpu, &mut pass, &kernels.guide, scene, (part.place_rows, &bound));
            drop(pass);
            gpu.queue.submit([encoder.finish()]);
        }
        Ok(())
    }

    /// Adds a sample to all pixels.
    fn add_sample(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        scene: &GpuScene,
        options: &Options,
    ) -> Result<(), GpuError> {
        let index = self.samples;
        let size = [self.camera.width, self.camera.height];
        let (sampler, number) = sampler_of(&self.batches, index, |batch, log2| {
            Sampler::new(options.sequence, options.seed, batch, log2, size)
        });
        // Independent numbers are hashed by the sample's own number.
        let number = if options.sequence == Sequence::Independent { index } else { number };
        if index > 0 {
            self.buffers.add_links(gpu)?;
        }
        let world = self.world.at_sample(&sampler, number, index);
        let Buffers { parts, halves, .. } = &self.buffers;
        for PartBuffers { part, places, sums } in parts {
            let world = fixed_uniform(gpu, "world", bytes_of(&world.in_part(*part)))?;
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let mut pass = encoder.begin_compute_pass(&Default::default());
            let LightBuffers { lamps, sky } = &*self.light_buffers;
            let bound = |sums| -> [(u32, &Buffer); 6] {
                let counts = (8, &*self.counts);
                [(3, &world), (4, places), (5, lamps), (6, sky), (7, sums), counts]
            };
            self.rays(gpu, &mut pass, &kernels.indirect, scene, (part.rows, &bound(halves)));
            let direct = if index == 0 { &kernels.first } else { &kernels.direct };
            self.rays(gpu, &mut pass, direct, scene, (part.rows, &bound(sums)));
            drop(pass);
            gpu.queue.submit([encoder.finish()]);
        }
        self.samples += 1;
        Ok(())
    }

    /// Prepares the guides for the filter, and estimates their noise unless it is known; once for
    /// these settings, but again where it was taken as known. Returns the noise.
    fn prepare(
        &mut self,
        gpu: &Gpu,
        kernels: &Kernels,
        filter: &mut LightFilter,
        settings: &Settings,
        known: Option<GuideNoise>,
    ) -> Result<GuideNoise, GpuError> {
        let prepared = self.prepared.as_ref().filter(|prepared| prepared.0 == *settings);
        let prepared = prepared.filter(|(_, _, is_own)| *is_own || known.is_some());
        if let Some((_, guides, _)) = prepared {
            return Ok(guides.noise());
        }
        self.submit_means(gpu, kernels)?;
        let Buffers { light, guides, filtered, .. } = &self.buffers;
        let pictures = FilterPictures { guides, light, out: filtered };
        let prepared = match known {
            Some(noise) => filter.prepare_known(gpu, &pictures, settings, noise)?,
            None => filter.prepare(gpu, &pictures, settings)?,
        };
        let noise = prepared.noise();
        self.prepared = Some((settings.clone(), prepared, known.is_none()));
        Ok(noise)
    }

    /// Makes the means that the filter takes.
    fn submit_means(&self, gpu: &Gpu, kernels: &Kernels) -> Result<(), GpuError> {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.accumulate(gpu, kernels, &mut encoder.begin_compute_pass(&Default::default()))?;
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Encodes the means that the filter takes.
    fn accumulate(
        &self,
        gpu: &Gpu,
        kernels: &Kernels,
        pass: &mut ComputePass<'_>,
    ) -> Result<(), GpuError> {
        let Buffers { parts, halves, light, guides, past, .. } = &self.buffers;
        let width = self.camera.width as u32;
        for PartBuffers { part, places, .. } in parts {
            let means = Means {
                pixels: self.pixels() as u32,
                samples: self.samples,
                diagonal: self.diagonal.max(f32::MIN_POSITIVE),
                part_pixels: part.rows * width,
                first: part.first * width,
                first_place: part.first_place * width,
                has_past: u32::from(past.is_some()),
                guides_from: self.camera.guides_from(),
            };
            let uniform = fixed_uniform(gpu, "means", bytes_of(&means))?;
            let bound: [(u32, &Buffer); 6] = [
                (0, &uniform),
                (1, places),
                (2, halves),
                (3, &light.buffer),
                (4, &guides.buffer),
                // Any buffer, where there is no past.
                (5, past.as_ref().unwrap_or(halves)),
            ];
            let bind = kernels.accumulate.bind(gpu, &bound);
            kernels.accumulate.dispatch(pass, &bind, groups_of(means.part_pixels.into()));
        }
        Ok(())
    }

    /// Filters indirect light and combines the picture.
    fn combine(
        &self,
        gpu: &Gpu,
        kernels: &Kernels,
        filter: &mut LightFilter,
        options: &Options,
    ) -> Result<(), GpuError> {
        let Buffers { parts, halves, light, guides, filtered, picture, .. } = &self.buffers;
        let pictures = FilterPictures { guides, light, out: filtered };
        let none = PreparedGuides::default();
        let prepared = self.prepared.as_ref().map_or(&none, |prepared| &prepared.1);
        let samples = self.samples.max(1);
        let is_filtered = options.filter.kind != FilterKind::None;
        let mut plan = filter.plan(gpu, &pictures, prepared, samples, &options.filter)?;
        if is_filtered && options.converges && samples > 1 {
            filter.add_converging(gpu, &mut plan, &pictures, halves, samples)?;
        }
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        self.accumulate(gpu, kernels, &mut pass)?;
        plan.run(&mut pass);
        let looked_up = if is_filtered { filtered } else { light };
        let [width, height] = [self.camera.width, self.camera.height].map(|side| side as u32);
        for PartBuffers { part, places, sums } in parts {
            let Part { first, rows, first_place, .. } = *part;
            let samples = self.samples;
            let size = Size { width, height, samples, first, rows, first_place, unused: [0; 2] };
            let uniform = fixed_uniform(gpu, "size", bytes_of(&size))?;
            let bound: [(u32, &Buffer); 5] =
                [(0, &uniform), (1, places), (2, sums), (3, &looked_up.buffer), (4, picture)];
            let bind = kernels.resolve.bind(gpu, &bound);
            kernels.resolve.dispatch(&mut pass, &bind, self.groups(rows));
        }
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Reads the picture.
    fn read(&self, gpu: &Gpu) -> Result<LitImage, GpuError> {
        let read = readback::read(gpu, &[(&self.buffers.picture, self.pixels() * 32)])?;
        let bytes = read.first().map_or(&[][..], Vec::as_slice).as_chunks::<16>().0;
        let (direct, indirect) = bytes.split_at(bytes.len() / 2);
        let [width, height] = [self.camera.width, self.camera.height];
        let value = |pixel: &[u8; 16], c: usize| {
            f32::from_le_bytes(std::array::from_fn(|b| pixel[4 * c + b]))
        };
        // Planes of large pictures are made by all threads: some hundred megabytes a picture.
        let plane = |of: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
            (0..direct.len()).into_par_iter().with_min_len(TASK).map(of).collect()
        };
        let image = |of: &(dyn Fn(usize, usize) -> f32 + Sync)| {
            let planes = std::array::from_fn(|c| plane(&|i| of(i, c)));
            Image { width, height, planes }
        };
        Ok(LitImage {
            radiance: image(&|i, c| value(&direct[i], c) + value(&indirect[i], c)),
            direct: image(&|i, c| value(&direct[i], c)),
            indirect: image(&|i, c| value(&indirect[i], c)),
            depth: plane(&|i| value(&indirect[i], 3)),
            coverage: plane(&|i| value(&direct[i], 3)),
        })
    }
}
