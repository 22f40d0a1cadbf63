//! Still lit pictures: traces the splats of a frame sample by sample, filters, and encodes the
//! picture. Reports what was traced, and what a user should know of it.

use crate::draw::scene::PictureScene;
use crate::io::quantity::grouped;
use crate::light::options::{lights_of, options};
use crate::light::scene::{GatheredSplats, Meshes, holds_light};
use crate::light::settings::LightSettings;
use crate::light::tone::Tones;
use crate::light::tracing::{GpuRefusal, Job, Traced, ms};
use anyhow::Result;
use esker_format::Forest;
use esker_lod::{Counters, light_octree};
use esker_points::Task;
use esker_render::gpu::Gpu;
use esker_render::{Frame, PassTimes, Picture, Stats};
use esker_trace::{Camera, LitImage};
use serde::Serialize;
use std::time::Instant;

/// What lighting a picture did.
#[derive(Clone, Debug, Serialize)]
pub struct LightReport {
    /// Kinds of the lights.
    pub lights: Vec<&'static str>,
    /// Rays through a pixel.
    pub samples: u32,
    /// Reflections before the surface that is seen.
    pub bounces: u32,
    /// Rays to each light of finite size, for each ray through a pixel.
    pub shadow_samples: u32,
    /// Filter of indirect light.
    pub filter: &'static str,
    /// Whether soft shadows are filtered.
    pub filters_shadows: bool,
    /// Reflectance and roughness of glossy surfaces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gloss: Option<[f32; 2]>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Factor from light to the picture.
    pub exposure: f64,
    /// Splats that were traced.
    pub splats: usize,
    /// Splats around the picture, among them.
    pub splats_around: u64,
    /// Most splats in the picture within the budgets.
    pub splats_max: u64,
    /// Whether that bound, or the one of what is around the picture, leaves splats out.
    pub is_bounded: bool,
    /// Splats that no ray can meet: without extent, or with invalid values.
    pub splats_dropped: usize,
    /// Triangles of meshes.
    pub triangles: usize,
    /// Bytes of the scene: surfaces and their tree.
    pub scene_bytes: u64,
    /// All rays.
    pub rays: u64,
    /// Share of the rays that bounce which hit the surface that they left.
    pub self_hits: f64,
    /// Share of the rays that bounce which hit nothing: they saw the sky, or leaked between the
    /// points of a closed scene.
    pub escaped: f64,
    /// Share of the rays through pixels that fitted no guide and were traced afresh (`bauszat2011`,
    /// figure 3b).
    pub without_guide: f64,
    /// Making splats and their tree, milliseconds.
    pub build_ms: f64,
    /// Tracing, milliseconds.
    pub trace_ms: f64,
    /// Filtering, milliseconds.
    pub filter_ms: f64,
}

/// Draws a scene lit, on `gpu` if its kernels draw such pictures. Returns also why they do not,
/// where the CPU has drawn although there is a GPU.
///
/// # Errors
/// If a mesh cannot be read, or `task` is cancelled.
pub fn draw(
    file: &Forest,
    scene: &PictureScene,
    settings: &LightSettings,
    gpu: Option<&Gpu>,
    task: &dyn Task,
) -> Result<(Picture, LightReport, Option<String>)> {
    let (draws, octree) = (scene.lit_draws(file), light_octree(file.table(), &scene.selection));
    let frame = &scene.appearance.frame(file, &scene.view, &draws, &octree);
    let settings = &settings.clone().measured(file.lattice());
    let lights = lights_of(settings);
    let meshes = Meshes::read(settings, task)?;
    meshes.notes().for_each(|note| task.note(note));
    let start = Instant::now();
    let splats = GatheredSplats::of(frame, &lights, &scene.classes(), frame.view.eye);
    let gather_ms = ms(start);
    let camera = Camera::new(frame.view, splats.origin);
    let job = Job {
        splats: &splats,
        meshes: &meshes,
        lights: &lights,
        camera,
        options: options(settings, &lights),
        samples: settings.samples,
    };
    let (traced, refusal) = match gpu.map(|gpu| job.on_gpu(gpu, task)) {
        Some(Ok(traced)) => (traced, None),
        Some(Err(GpuRefusal::Cancelled(stopped))) => return Err(stopped.into()),
        Some(Err(GpuRefusal::Because(why))) => (job.on_cpu(task)?, Some(why)),
        None => (job.on_cpu(task)?, None),
    };
    let (picture, exposure) = picture(&traced.image, frame, settings, lights.have_sky());
    let total_ms = gather_ms + traced.times_ms.iter().sum::<f64>();
    let stats = Stats {
        points_drawn: splats.splats.len() as u64,
        nodes_drawn: frame.draws.iter().filter(|draw| draw.prefix > 0).count() as u32,
        splats_drawn: (splats.splats.len() - traced.dropped) as u64,
        splats_dropped: traced.dropped as u64,
        stages: PassTimes { total_ms, ..PassTimes::default() },
        ..picture.stats
    };
    let report = LightReport::new(&job, scene, settings, &traced, exposure, gather_ms);
    Ok((Picture { stats, ..picture }, report, refusal))
}

impl LightReport {
    fn new(
        job: &Job<'_>,
        scene: &PictureScene,
        settings: &LightSettings,
        traced: &Traced,
        exposure: f64,
        gather_ms: f64,
    ) -> Self {
        let share = |of: u64, all: u64| if all > 0 { of as f64 / all as f64 } else { 0.0 };
        let counts = traced.counts;
        let [build_ms, trace_ms, filter_ms] = traced.times_ms;
        Self {
            lights: job.lights.kinds(),
            samples: settings.samples,
            bounces: settings.bounces,
            shadow_samples: settings.shadow_samples,
            filter: settings.filter.name(),
            filters_shadows: settings.filters_shadows && settings.gloss.is_none(),
            gloss: settings.gloss.map(|gloss| [gloss.reflectance, gloss.roughness]),
            seed: settings.seed,
            exposure,
            splats: job.splats.splats.len(),
            splats_around: scene.selection.counters.surroundings_points,
            splats_max: scene.points_max,
            is_bounded: is_bounded(&scene.selection.counters),
            splats_dropped: traced.dropped,
            triangles: job.meshes.triangles(),
            scene_bytes: traced.scene_bytes,
            rays: counts.rays(),
            self_hits: share(counts.self_hits, counts.bounce_rays),
            escaped: share(counts.escaped, counts.bounce_rays),
            without_guide: share(counts.without_guide, counts.eye_rays),
            build_ms: gather_ms + build_ms,
            trace_ms,
            filter_ms,
        }
    }
}

/// The picture of lit pixels, and its exposure.
fn picture(
    image: &LitImage,
    frame: &Frame<'_>,
    settings: &LightSettings,
    shows_sky: bool,
) -> (Picture, f64) {
    let width = image.radiance.width;
    let tones = Tones {
        width,
        radiance: &image.radiance.planes,
        coverage: &image.coverage,
        exposure: 1.0,
        background: (!shows_sky).then_some(frame.background),
    };
    let exposure = settings.exposure.unwrap_or_else(|| tones.chosen_exposure());
    let mut rgba = vec![0; image.radiance.len() * 4];
    Tones { exposure, ..tones }.encode(&mut rgba);
    let covered = image.coverage.iter().filter(|&&covered| covered > 0.0).count() as u64;
    let picture = Picture {
        width: width as u32,
        height: image.radiance.height as u32,
        rgba,
        depth: image.depth.clone(),
        stats: Stats { pixels_projected: covered, pixels_covered: covered, ..Stats::default() },
    };
    (picture, exposure)
}

/// Whether budgets leave points out of the picture or of what lies around it.
pub(crate) fn is_bounded(counters: &Counters) -> bool {
    counters.withheld + counters.shortened + counters.surroundings_withheld > 0
}

/// What a user should know of a lit picture, a line each.
pub(crate) fn notes(scene: &PictureScene, report: &LightReport) -> Vec<&'static str> {
    let by = scene.appearance.colouring.by;
    let notes = [
        (
            !scene.plan.reads_normals,
            "normals: the points have none, and their surfaces are lit roughly (build with \
             --normals estimate)",
        ),
        (
            holds_light(by),
            "albedo: the colours of the scan hold the light of its day, which is \
                           counted twice (--albedo intensity or plain: without it)",
        ),
        (
            report.is_bounded,
            "splats: their bound is reached, farther ones are coarser \
                      (--budget-points, or more memory)",
        ),
        (report.splats_dropped > 0, "splats: some have no extent, and are not lit"),
    ];
    notes.into_iter().filter(|(holds, _)| *holds).map(|(_, note)| note).collect()
}

/// Text of a report.
pub(crate) fn text(report: &LightReport) -> String {
    format!(
        "light: {} ({}), {} splats, {} rays, {:.1} % self-hits, {:.1} % escaped, \
         {:.1} % without guide, exposure {:.3}; ms: build {:.0}, trace {:.0}, filter {:.0}",
        report.lights.join(", "),
        report.filter,
        grouped(report.splats as u64),
        grouped(report.rays),
        report.self_hits * 100.0,
        report.escaped * 100.0,
        report.without_guide * 100.0,
        report.exposure,
        report.build_ms,
        report.trace_ms,
        report.filter_ms,
    )
}
