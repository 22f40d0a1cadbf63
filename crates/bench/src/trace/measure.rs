//! Runs the benchmark of light: makes each scene and its references, traces pictures by bounces,
//! samples and sequences, filters them, and compares them with the references.

use super::error::Reference;
use super::estimate::{Effort, Estimate};
use super::figures::Figures;
use super::filters::{Filter, compared, of_channels, swept, timed};
use super::references::Store;
use super::report::{Part, SceneRow, TraceBenchReport, TraceRow, Weights};
use super::scans::OpenScan;
use super::scene::TraceScene;
use super::scenes::{defaults, make};
use super::{limits, moving, scans};
use crate::quantile::quantile;
use anyhow::Result;
use esker_engine::machine::pool;
use esker_points::Task;
use esker_trace::filter::{FilterKind, Halves, Settings, filter};
use esker_trace::{Image, Sequence, Stats};
use std::path::PathBuf;
use std::time::Instant;

/// Bounces and samples of table 1 of `bauszat2011`.
const TABLE_1: [[u32; 2]; 3] = [[1, 1], [1, 4], [2, 4]];
/// Bounces of figure 8.
const BOUNCES: u32 = 2;
/// Samples of figure 8.
const SAMPLES: [u32; 2] = [1, 4];
/// Sequences and their names.
const SEQUENCES: [(Sequence, &str); 2] =
    [(Sequence::Independent, "independent"), (Sequence::ZOrder, "z-order")];
/// Seed of the pictures that are judged.
const SEED: u64 = 1;
/// Greatest number of samples of the plot of convergence, and of a quick one.
const CONVERGENCE_MAX: u32 = 64;
const QUICK_CONVERGENCE_MAX: u32 = 8;
/// Samples of the scene of limits: what the filter blurs comes back with samples.
const LIMITS_SAMPLES: [u32; 2] = [1, 64];
/// Times that a filter of table 2 runs; the median is reported.
const RUNS: usize = 3;

/// Scenes, pictures and references to measure.
#[derive(Clone, Debug)]
pub struct TraceBenchRequest {
    /// Names of scenes; all by default.
    pub scenes: Vec<String>,
    /// What is measured, whatever else is requested. If it is empty, all is, but sweeps only if the
    /// run is not quick, and scenes of their own only if all scenes are measured or it is quick.
    pub parts: Vec<Part>,
    /// Width and height of pictures, pixels.
    pub size: [u32; 2],
    /// Whether scenes have fewer surfaces, and fewer samples are taken, so that a run takes
    /// minutes.
    pub is_quick: bool,
    /// Folder of figures; none are written without one.
    pub out: Option<PathBuf>,
    /// Folder of references.
    pub references: PathBuf,
    /// Samples of each of the two references.
    pub reference_samples: u32,
    /// Whether references are made again.
    pub rebuilds: bool,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

/// Measures light.
///
/// # Errors
/// If a scene is unknown or cannot be made, files cannot be read or written, or `task` is
/// cancelled.
pub fn measure(request: &TraceBenchRequest, task: &dyn Task) -> Result<TraceBenchReport> {
    let names = if request.scenes.is_empty() { defaults() } else { request.scenes.clone() };
    pool::run(request.threads, || {
        let mut run = Run {
            request,
            task,
            report: TraceBenchReport {
                threads: rayon::current_num_threads(),
                size: request.size,
                reference_samples: request.reference_samples,
                reference_bounces: BOUNCES,
                scenes: Vec::new(),
                rows: Vec::new(),
                moving: Vec::new(),
                figures: Vec::new(),
            },
            figures: request.out.as_deref().map(Figures::new).transpose()?,
        };
        let is_of_scenes = |part: &Part| ![Part::Limits, Part::Moving].contains(part);
        let has_scenes = request.parts.is_empty() || request.parts.iter().any(is_of_scenes);
        for (i, name) in names.iter().enumerate().filter(|_| has_scenes) {
            let (scene, scan) = make(name, request.size, request.is_quick, task)?;
            run.scene(&scene, i == 0)?;
            run.surroundings(&scene, scan.as_ref())?;
        }
        let is_whole = request.scenes.is_empty() || request.is_quick;
        if run.has(Part::Limits, is_whole) {
            run.limits()?;
        }
        if run.has(Part::Moving, is_whole) {
            run.moving()?;
        }
        run.report.figures = run.figures.map(|figures| figures.written).unwrap_or_default();
        Ok(run.report)
    })
}

struct Run<'a> {
    request: &'a TraceBenchRequest,
    task: &'a dyn Task,
    report: TraceBenchReport,
    figures: Option<Figures>,
}

impl Run<'_> {
    /// Measures a scene; times of filters and convergence on the first one alone.
    fn scene(&mut self, scene: &TraceScene, is_first: bool) -> Result<()> {
        let reference = self.store().reference(scene, BOUNCES, None, self.task)?;
        if self.has(Part::Frames, true) {
            self.frames(scene)?;
        }
        self.errors(scene, &reference, is_first)?;
        if is_first && self.has(Part::Convergence, true) {
            self.convergence(scene, &reference)?;
        }
        Ok(())
    }

    /// Whether a part is measured: `by_default` if none is named.
    fn has(&self, part: Part, by_default: bool) -> bool {
        let parts = &self.request.parts;
        if parts.is_empty() { by_default } else { parts.contains(&part) }
    }

    fn store(&self) -> Store {
        Store {
            folder: self.request.references.clone(),
            samples: self.request.reference_samples,
            rebuilds: self.request.rebuilds,
        }
    }

    /// What the surroundings of a picture of a scan add to its light.
    fn surroundings(&mut self, scene: &TraceScene, scan: Option<&OpenScan>) -> Result<()> {
        let Some(scan) = scan else { return Ok(()) };
        self.phase(scene, "surroundings");
        let added = scans::surroundings(scene, scan, self.task)?;
        self.report.scenes.iter_mut().filter(|row| row.scene == scene.name).for_each(|row| {
            row.surroundings = added;
        });
        Ok(())
    }

    fn phase(&self, scene: &TraceScene, part: &str) {
        self.task.phase(&format!("{part} of {}", scene.name), None, "pictures");
    }

    /// Table 1: whole frames with the default filter.
    fn frames(&mut self, scene: &TraceScene) -> Result<()> {
        self.phase(scene, "frames");
        for [bounces, samples] in TABLE_1 {
            let effort =
                Effort { bounces, samples, sequence: Sequence::ZOrder, seed: SEED, gloss: None };
            let mut estimate = Estimate::new(scene, effort, self.task)?;
            let (_, filter_ms) = estimate.lit(Settings::default());
            let row = row(Part::Frames, scene, effort, &Settings::default(), "nested");
            self.report.rows.push(TraceRow { filter_ms, ..row }.with_times(&estimate));
        }
        Ok(())
    }

    /// Figure 8: error of each filter by samples and sequences. Figures show one sample along the
    /// Z-order.
    fn errors(&mut self, scene: &TraceScene, reference: &Reference, is_first: bool) -> Result<()> {
        for (sequence, _) in SEQUENCES {
            for samples in SAMPLES {
                self.phase(scene, "errors");
                let effort =
                    Effort { bounces: BOUNCES, samples, sequence, seed: SEED, gloss: None };
                let mut estimate = Estimate::new(scene, effort, self.task)?;
                if self.has(Part::Errors, true) {
                    for f in compared() {
                        self.error(Part::Errors, scene, effort, &estimate, &f, reference)?;
                    }
                }
                let is_swept = self.has(Part::Sweep, !self.request.is_quick);
                if sequence == Sequence::ZOrder && is_swept {
                    self.sweep(scene, effort, &estimate, reference)?;
                }
                if (sequence, samples) == (Sequence::ZOrder, 1) {
                    self.report.scenes.push(scene_row(scene, &estimate.stats));
                    if let Some(figures) = &mut self.figures {
                        figures.of_scene(scene, &mut estimate, reference)?;
                    }
                    if is_first && self.has(Part::Filters, true) {
                        self.times(scene, effort, &estimate)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Least error of each baseline over other weights than its own.
    fn sweep(
        &mut self,
        scene: &TraceScene,
        effort: Effort,
        estimate: &Estimate,
        reference: &Reference,
    ) -> Result<()> {
        let first = self.report.rows.len();
        for f in swept() {
            self.error(Part::Sweep, scene, effort, estimate, &f, reference)?;
        }
        let mut all = self.report.rows.split_off(first);
        let error = |row: &TraceRow| row.mse.unwrap_or(f64::INFINITY);
        all.sort_by(|a, b| error(a).total_cmp(&error(b)));
        let least = |is_bilateral: bool| {
            all.iter().find(|row| (row.filter == "bilateral") == is_bilateral).cloned()
        };
        self.report.rows.extend([least(true), least(false)].into_iter().flatten());
        Ok(())
    }

    /// Adds the error of one filter, and returns its picture.
    fn error(
        &mut self,
        part: Part,
        scene: &TraceScene,
        effort: Effort,
        estimate: &Estimate,
        f: &Filter,
        reference: &Reference,
    ) -> Result<Image<3>> {
        self.task.check()?;
        let start = Instant::now();
        let image = filter(&estimate.incident, &estimate.guides, effort.samples, &f.settings);
        let filter_ms = start.elapsed().as_secs_f64() * 1e3;
        let row = row(part, scene, effort, &f.settings, f.name);
        let row = TraceRow { filter_ms, ..row }.with_times(estimate);
        self.report.rows.push(row.with_error(reference.error(&image)));
        Ok(image)
    }

    /// What the filter blurs, with few samples and with more.
    fn limits(&mut self) -> Result<()> {
        let scene = &limits::scene(self.request.size);
        let gloss = Some(limits::GLOSS);
        let reference = self.store().reference(scene, BOUNCES, gloss, self.task)?;
        let mut images = Vec::new();
        for samples in LIMITS_SAMPLES {
            self.phase(scene, "limits");
            let sequence = Sequence::ZOrder;
            let effort = Effort { bounces: BOUNCES, samples, sequence, seed: SEED, gloss };
            let estimate = Estimate::new(scene, effort, self.task)?;
            for (kind, name) in [(FilterKind::None, "none"), (FilterKind::Nested, "nested")] {
                let f = Filter { name, settings: Settings::of(kind) };
                let image = self.error(Part::Limits, scene, effort, &estimate, &f, &reference)?;
                images.extend((samples == 1).then_some(image));
            }
            if samples > 1 {
                let image = mixed(scene, effort, self.task)?;
                let settings = Settings::of(FilterKind::Nested);
                let row = row(Part::Limits, scene, effort, &settings, "nested-mixed");
                let row = row.with_times(&estimate).with_error(reference.error(&image));
                self.report.rows.push(row);
                images.push(image);
            }
        }
        match &mut self.figures {
            Some(figures) => figures.limits(scene, &images, &reference),
            None => Ok(()),
        }
    }

    /// A lamp, an object and a mesh that move.
    fn moving(&mut self) -> Result<()> {
        let size = self.request.size.map(|side| side.div_ceil(2));
        let (rows, tile) = moving::measure(size, self.task)?;
        self.report.moving = rows;
        match &mut self.figures {
            Some(figures) => figures.write_named("moving", &tile),
            None => Ok(()),
        }
    }

    /// Table 2: median times of filters.
    fn times(&mut self, scene: &TraceScene, effort: Effort, estimate: &Estimate) -> Result<()> {
        for t in timed() {
            let guides = of_channels(&estimate.guides, t.channels);
            let mut times = Vec::with_capacity(RUNS);
            for _ in 0..RUNS {
                self.task.check()?;
                let start = Instant::now();
                filter(&estimate.incident, &guides, effort.samples, &t.filter.settings);
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            let row = row(Part::Filters, scene, effort, &t.filter.settings, t.filter.name);
            let (filter_ms, channels) = (quantile(&times, 0.5), t.channels);
            let row = TraceRow { filter_ms, channels, ..row };
            self.report.rows.push(row.with_times(estimate));
        }
        Ok(())
    }

    /// Error against samples, unfiltered and by the extended filter, for both sequences.
    fn convergence(&mut self, scene: &TraceScene, reference: &Reference) -> Result<()> {
        let most = match self.request.is_quick {
            true => QUICK_CONVERGENCE_MAX,
            false => CONVERGENCE_MAX,
        };
        let counts = (0..).map(|power| 1 << power).take_while(|&samples| samples <= most);
        for samples in counts {
            for (sequence, _) in SEQUENCES {
                self.phase(scene, "convergence");
                let seed = SEED + 1;
                let effort = Effort { bounces: BOUNCES, samples, sequence, seed, gloss: None };
                let estimate = Estimate::new(scene, effort, self.task)?;
                let mut push = |image: &Image<3>, settings: &Settings, name| {
                    let row = row(Part::Convergence, scene, effort, settings, name);
                    let row = row.with_times(&estimate).with_error(reference.error(image));
                    self.report.rows.push(row);
                };
                for (kind, name) in [(FilterKind::None, "none"), (FilterKind::Nested, "nested")] {
                    let settings = Settings::of(kind);
                    let image = filter(&estimate.incident, &estimate.guides, samples, &settings);
                    push(&image, &settings, name);
                }
                if samples > 1 && sequence == Sequence::ZOrder {
                    let image = mixed(scene, effort, self.task)?;
                    push(&image, &Settings::of(FilterKind::Nested), "nested-mixed");
                }
            }
        }
        match &mut self.figures {
            Some(figures) => figures.convergence(scene, &self.report.rows),
            None => Ok(()),
        }
    }
}

/// The filtered picture mixed with the mean of its samples by the agreement of two halves, so that
/// it converges to the mean. Each half has its own seed.
fn mixed(scene: &TraceScene, effort: Effort, task: &dyn Task) -> Result<Image<3>> {
    let half = |seed: u64| {
        let effort = Effort { samples: effort.samples / 2, seed, ..effort };
        Estimate::new(scene, effort, task)
    };
    let (a, b) = (half(SEED + 2)?, half(SEED + 3)?);
    let halves = Halves { a: a.incident, b: b.incident };
    let settings = Settings::of(FilterKind::Nested);
    let filtered = filter(&halves.mean(), &a.guides, effort.samples, &settings);
    Ok(halves.mix(&filtered, &a.guides.is_hit))
}

fn scene_row(scene: &TraceScene, stats: &Stats) -> SceneRow {
    let share = |rays: u64| rays as f64 / (stats.bounce_rays as f64).max(1.0);
    SceneRow {
        scene: scene.name.clone(),
        is_scan: scene.is_scan,
        surfaces: scene.surfaces,
        build_ms: scene.build_ms,
        self_hits: share(stats.self_hits),
        escaped: share(stats.escaped),
        surroundings: None,
    }
}

/// A row without times and errors.
fn row(
    part: Part,
    scene: &TraceScene,
    effort: Effort,
    settings: &Settings,
    filter: &'static str,
) -> TraceRow {
    let sequence = SEQUENCES.iter().find(|(sequence, _)| *sequence == effort.sequence);
    TraceRow {
        part,
        scene: scene.name.clone(),
        backend: "cpu",
        bounces: effort.bounces,
        samples: effort.samples,
        sequence: sequence.map_or("", |(_, name)| name),
        filter,
        radius: settings.radius,
        iterations: (settings.kind == FilterKind::Atrous).then_some(settings.iterations),
        weights: (part == Part::Sweep).then(|| Weights {
            normal: settings.sigma_normal,
            depth: settings.sigma_depth,
            colour: Some(settings.sigma_colour).filter(|colour| colour.is_finite()),
        }),
        channels: 4,
        mse: None,
        p999: None,
        worst: None,
        mean_ratio: None,
        trace_ms: 0.0,
        filter_ms: 0.0,
        total_ms: 0.0,
        mrays_per_s: 0.0,
    }
}

impl TraceRow {
    /// The same row with the times of a picture; that of the filter stays.
    fn with_times(mut self, estimate: &Estimate) -> Self {
        self.trace_ms = estimate.trace_ms;
        self.total_ms = estimate.trace_ms + self.filter_ms;
        self.mrays_per_s = estimate.stats.rays() as f64 / estimate.trace_ms.max(1e-9) * 1e-3;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::report::text;
    use esker_points::task::Silent;
    use std::path::Path;

    fn run(folder: &Path) -> TraceBenchReport {
        run_parts(folder, Vec::new())
    }

    fn run_parts(folder: &Path, parts: Vec<Part>) -> TraceBenchReport {
        let request = TraceBenchRequest {
            scenes: vec!["hall".into()],
            parts,
            size: [40, 30],
            is_quick: true,
            out: Some(folder.join("figures")),
            references: folder.join("references"),
            reference_samples: 4,
            rebuilds: false,
            threads: 0,
        };
        measure(&request, &Silent).unwrap()
    }

    #[test]
    fn named_parts_alone_are_measured() {
        let folder = tempfile::tempdir().unwrap();
        let parts = |names: &[&str]| names.iter().map(|name| Part::parse(name).unwrap()).collect();
        let report = run_parts(folder.path(), parts(&["moving"]));
        assert!(report.rows.is_empty() && report.scenes.is_empty() && report.moving.len() == 4);
        let report = run_parts(folder.path(), parts(&["frames", "sweep"]));
        let of = |part| report.rows.iter().filter(move |row| row.part == part).count();
        assert_eq!((of(Part::Frames), of(Part::Sweep)), (TABLE_1.len(), 4));
        assert_eq!((report.rows.len(), report.moving.len()), (TABLE_1.len() + 4, 0));
        assert!(Part::parse("error").unwrap_err().contains("errors, sweep"));
    }

    #[test]
    fn a_second_run_reads_the_references_and_gives_the_same_errors() {
        let folder = tempfile::tempdir().unwrap();
        let (first, second) = (run(folder.path()), run(folder.path()));
        let files = std::fs::read_dir(folder.path().join("references")).unwrap().count();
        // Of the hall, and of the scene of limits.
        assert_eq!(files, 6);
        let errors = |report: &TraceBenchReport| -> Vec<Option<f64>> {
            report.rows.iter().flat_map(|row| [row.mse, row.worst]).collect()
        };
        assert_eq!(errors(&first), errors(&second));
        assert_eq!(first.figures.len(), 8);
        assert!(first.figures.iter().all(|path| path.is_file()));
        let of = |part| first.rows.iter().filter(move |row| row.part == part);
        assert_eq!(of(Part::Frames).count(), TABLE_1.len());
        assert_eq!(of(Part::Filters).count(), timed().len());
        assert_eq!(of(Part::Errors).count(), compared().len() * 4);
        assert_eq!(of(Part::Limits).count(), 5);
        assert_eq!(first.moving.len(), 4);
        assert!(of(Part::Errors).all(|row| row.mse.is_some_and(f64::is_finite)));
        assert!(first.rows.iter().all(|row| row.trace_ms > 0.0 && row.mrays_per_s > 0.0));
        assert!(text(&first).contains("figure 8") && text(&first).contains("guided r24"));
    }
}
