//! Still lit pictures: traces the splats of a frame sample by sample, filters, and encodes the
//! picture. Reports what was traced, and what a user should know of it.

use crate::draw::scene::PictureScene;
use crate::io::quantity::grouped;
use crate::light::document::Lights;
use crate::light::lights;
use crate::light::scene::{LitScene, Meshes, holds_light};
use crate::light::settings::{FilterName, LightSettings};
use crate::light::tone::Tones;
use anyhow::Result;
use esker_format::Forest;
use esker_lod::{Counters, light_octree};
use esker_points::Task;
use esker_render::{Frame, PassTimes, Picture, Stats};
use esker_trace::filter::{FilterKind, Settings as FilterSettings};
use esker_trace::{Camera, LitImage, Options, Tracer};
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
    pub scene_bytes: usize,
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

/// Options of the tracer for settings.
pub(crate) fn options(settings: &LightSettings, lights: &Lights) -> Options {
    let kind = match settings.filter {
        FilterName::Guided => FilterKind::Guided,
        FilterName::Nested => FilterKind::Nested,
        FilterName::Bilateral => FilterKind::Bilateral,
        FilterName::Atrous => FilterKind::Atrous,
        FilterName::None => FilterKind::None,
    };
    Options {
        bounces: settings.bounces,
        shadow_samples: settings.shadow_samples,
        seed: settings.seed,
        filter: FilterSettings::of(kind),
        shows_sky: lights.have_sky(),
        ..Options::default()
    }
}

/// The lights of settings.
pub(crate) fn lights_of(settings: &LightSettings) -> Lights {
    settings.lights.clone().unwrap_or_else(lights::defaults)
}

/// Draws a scene lit.
///
/// # Errors
/// If a mesh cannot be read, or `task` is cancelled.
pub fn draw(
    file: &Forest,
    scene: &PictureScene,
    settings: &LightSettings,
    task: &dyn Task,
) -> Result<(Picture, LightReport)> {
    let (draws, octree) = (scene.lit_draws(file), light_octree(file.table(), &scene.selection));
    let frame = &scene.appearance.frame(file, &scene.view, &draws, &octree);
    let classes = scene.classes();
    let lights = lights_of(settings);
    let meshes = Meshes::read(settings, task)?;
    meshes.notes().for_each(|note| task.note(note));
    let start = Instant::now();
    let lit = LitScene::new(frame, &meshes, &lights, &classes, frame.view.eye);
    let build_ms = ms(start);
    let (prepared, camera) = (lit.prepared(&lights), Camera::new(frame.view, lit.origin));
    let options = options(settings, &lights);
    let mut tracer = Tracer::new(options);
    let pixels = camera.pixels() as u64;
    task.phase("tracing", Some(pixels * u64::from(settings.samples)), "rays");
    let start = Instant::now();
    for _ in 0..settings.samples {
        let is_whole = tracer.trace(&lit.scene, 1, &prepared, &camera, 1, &|| task.is_cancelled());
        task.check()?;
        debug_assert!(is_whole, "only cancelling stops a trace");
        task.advance(pixels);
    }
    let trace_ms = ms(start);
    let start = Instant::now();
    let image = tracer.resolve();
    let filter_ms = ms(start);
    let (picture, exposure) = picture(&image, frame, settings, lights.have_sky());
    let counts = tracer.stats();
    let share = |of: u64, all: u64| if all > 0 { of as f64 / all as f64 } else { 0.0 };
    let report = LightReport {
        lights: lights.kinds(),
        samples: settings.samples,
        bounces: settings.bounces,
        shadow_samples: settings.shadow_samples,
        filter: settings.filter.name(),
        seed: settings.seed,
        exposure,
        splats: lit.splats,
        splats_around: scene.selection.counters.surroundings_points,
        splats_max: scene.points_max,
        is_bounded: is_bounded(&scene.selection.counters),
        splats_dropped: lit.scene.dropped(),
        triangles: meshes.triangles(),
        scene_bytes: lit.scene.bytes(),
        rays: counts.rays(),
        self_hits: share(counts.self_hits, counts.bounce_rays),
        escaped: share(counts.escaped, counts.bounce_rays),
        without_guide: share(counts.without_guide, counts.eye_rays),
        build_ms,
        trace_ms,
        filter_ms,
    };
    let stats = Stats {
        points_drawn: lit.splats as u64,
        nodes_drawn: frame.draws.iter().filter(|draw| draw.prefix > 0).count() as u32,
        splats_drawn: lit.scene.splats() as u64,
        splats_dropped: lit.scene.dropped() as u64,
        stages: PassTimes { total_ms: build_ms + trace_ms + filter_ms, ..PassTimes::default() },
        ..picture.stats
    };
    Ok((Picture { stats, ..picture }, report))
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
        "light: {} ({}), {} splats, {} rays, {:.1} % self-hits, {:.1} % escaped, {:.1} % without \
         guide, exposure {:.3}; ms: build {:.0}, trace {:.0}, filter {:.0}",
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

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
