//! Runs the rounds: in each, all settings draw one alignment of the view in turn, so that what else
//! the machine does falls on all of them alike.

use crate::error_time::analytic::Analytic;
use crate::error_time::budgets::budgets;
use crate::error_time::compare::{Errors, errors, flicker};
#[cfg(feature = "light")]
use crate::error_time::lit;
use crate::error_time::lit::LitRow;
use crate::error_time::page::{self, Crops};
use crate::error_time::perfect::Reference;
use crate::error_time::reference::{ALIGNMENTS, Common, ReferenceScene, aligned};
use crate::error_time::report::{BUDGETS_MS, ErrorTimeReport, Scan, advice, mark_front};
use crate::error_time::row::{Build, Row};
use crate::error_time::settings::{PACED, Setting, builds, common, of_build, of_file};
use crate::error_time::streaming;
use crate::pass_times;
use crate::quantile::quantile;
use crate::render::scene::{Changes, ResidentScene};
use anyhow::{Context, Result, ensure};
use esker_engine::Method;
use esker_engine::calls::conditions;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::enlarge::enlarged;
use esker_engine::draw::method::method_of_name;
use esker_engine::draw::scene::{PictureRequest, open};
use esker_engine::draw::{calibration, choice};
use esker_engine::io::file::is_esker;
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::{pool, system};
use esker_format::{Forest, PlaneKind};
use esker_lod::View;
use esker_points::Task;
use esker_render::gpu::Gpu;
use esker_render::{PassTimes, Picture};
use esker_truth::flip::mean_flip;
use glam::DMat3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Frames of the path on which flicker is measured.
const PATH_FRAMES: usize = 30;
/// Angle between its frames over that of a pixel.
const PATH_STEP_PX: f64 = 0.5;

/// Files, pictures and devices to measure.
#[derive(Clone, Debug)]
pub struct ErrorTimeRequest {
    /// `.esker` files, scans, or analytic scenes such as `truth:sphere`; options of the build are
    /// not compared for `.esker` files.
    pub files: Vec<PathBuf>,
    /// Width and height of the shown picture, pixels.
    pub size: [u32; 2],
    /// The camera.
    pub camera: Camera,
    /// Source of colours; none for the best that the file has.
    pub colour_by: Option<String>,
    /// Crosses settings, instead of varying one at a time.
    pub is_full: bool,
    /// Choice of the GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
    /// Most bytes read a second while streaming is measured; `None` for what the disk gives.
    pub read_bytes_a_second: Option<u64>,
    /// Folder for a page about each scan.
    pub out: Option<PathBuf>,
}

/// Measures error against run time.
///
/// # Errors
/// If a file cannot be read, a required GPU is missing or fails, a page cannot be written, or
/// `task` is cancelled.
pub fn measure(request: &ErrorTimeRequest, task: &dyn Task) -> Result<ErrorTimeReport> {
    let (gpu, drawer) = request.with.choose(None)?;
    let base = PictureRequest {
        size: request.size,
        camera: request.camera,
        colour_by: request.colour_by.clone(),
        ..PictureRequest::default()
    };
    if let Some(folder) = &request.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot make the folder", folder.display()))?;
    }
    pool::run(request.threads, || {
        let mut report = ErrorTimeReport {
            adapter: gpu.as_ref().map(|gpu| gpu.name.clone()),
            note: drawer.note,
            threads: rayon::current_num_threads(),
            waited: None,
            size: request.size,
            scans: Vec::new(),
            rows: Vec::new(),
            lit: Vec::new(),
            budgets: Vec::new(),
            streaming: Vec::new(),
        };
        let before = (system::waited_for_cores_ms(), system::cpu_ms());
        for path in &request.files {
            let mut measured = Measured::new(path, request.is_full, &base, gpu.as_ref(), task)?;
            // Scans of the same name in different folders keep rows and pages of their own.
            let alike = |scan: &Scan| scan.name == measured.name;
            match report.scans.iter().filter(|scan| alike(scan)).count() {
                0 => {}
                before => measured.file = format!("{}-{}", measured.name, before + 1),
            }
            let (mut scan, mut rows) = measured.run(task)?;
            mark_front(&mut rows);
            scan.advice = advice(&rows);
            task.phase(&format!("{}: streaming", scan.file), None, "frames");
            let file = &measured.files[0].file;
            let (size, read_bytes_a_second) = (request.size, request.read_bytes_a_second);
            let loaded = streaming::LoadRequest { size, read_bytes_a_second };
            let loads = streaming::measure(&scan.file, file, &loaded, task)?;
            let lit = measured.lit(request.is_full, task)?;
            if let Some(folder) = &request.out {
                let crops = measured.crops(&rows, task)?;
                page::write(folder, &scan, (&rows, &lit), &loads, &crops)?;
            }
            report.budgets.extend(budgets(&rows));
            report.lit.extend(lit);
            report.streaming.extend(loads);
            report.scans.push(scan);
            report.rows.extend(rows);
        }
        let since = |now: Option<f64>, then: Option<f64>| Some(now? - then?);
        let waited_ms = since(system::waited_for_cores_ms(), before.0);
        let cpu_ms = since(system::cpu_ms(), before.1);
        report.waited = waited_ms.zip(cpu_ms).map(|(waited, cpu)| waited / cpu.max(1e-6));
        Ok(report)
    })
}

/// A file that is measured, and the forms in which it was built.
struct Measured<'a> {
    /// Name of the scan, and the same with a number if another one has it.
    name: String,
    file: String,
    /// The scene, if its surfaces are known.
    analytic: Option<Analytic>,
    base: PictureRequest,
    gpu: Option<&'a Gpu>,
    files: Vec<Built>,
    /// Settings, each with the file that it draws.
    variants: Vec<(usize, Setting)>,
}

/// A file, and how it was built.
struct Built {
    file: Arc<Forest>,
    build: Option<Build>,
    _folder: Option<tempfile::TempDir>,
}

/// What the rounds add up for a setting.
#[derive(Default)]
struct Sums {
    points: u64,
    frames: Vec<PassTimes>,
    cpu_ms: Vec<f64>,
    errors: Vec<Errors>,
    own_flip: Vec<f64>,
    flicker: Option<f64>,
}

impl<'a> Measured<'a> {
    /// Opens or builds a file, and lists its settings.
    fn new(
        input: &Path,
        is_full: bool,
        base: &PictureRequest,
        gpu: Option<&'a Gpu>,
        task: &dyn Task,
    ) -> Result<Self> {
        let analytic = Analytic::named(input, base.size)?;
        let folder = tempfile::tempdir()?;
        let (mut path, mut base) = (input.to_owned(), base.clone());
        let mut name =
            input.file_stem().unwrap_or(input.as_os_str()).to_string_lossy().into_owned();
        if let Some(scene) = &analytic {
            (name, base.camera) = (scene.name.into(), scene.camera());
            path = folder.path().join("points.ply");
            scene.write(&path)?;
        }
        let is_scan = !is_esker(&path)?;
        let mut files = vec![Built::new(&path, "", &base, is_scan, task)?];
        let file = &files[0].file;
        ensure!(file.points() > 0, "{}: there are no points to draw", input.display());
        let has = (file.has(PlaneKind::Normal), file.has(PlaneKind::Compact), gpu.is_some());
        let settings = of_file(file.points(), has, is_full);
        let mut variants: Vec<_> = settings.into_iter().map(|setting| (0, setting)).collect();
        let pace = calibration::pace(task)?;
        for name in PACED {
            let method = method_of_name(name).unwrap_or_default();
            let request = PictureRequest { method, ..base.clone() };
            for budget_ms in BUDGETS_MS {
                let chosen = choice::paced(file, &request, &pace, budget_ms, task)?;
                variants.push((0, Setting::paced(&chosen, name, budget_ms)));
            }
        }
        if is_scan {
            for (options, build) in builds(&base.build) {
                let base = PictureRequest { build, ..base.clone() };
                let own = of_build(options).into_iter().map(|setting| (files.len(), setting));
                variants.extend(own);
                files.push(Built::new(&path, options, &base, true, task)?);
            }
        }
        Ok(Self { file: name.clone(), name, analytic, base, gpu, files, variants })
    }

    /// What pictures are compared with.
    fn common(&self, task: &dyn Task) -> Result<Common<'_>> {
        let Some(scene) = &self.analytic else {
            let scene = ReferenceScene::new(
                &self.files[0].file,
                &common(),
                self.base.size,
                &self.base,
                task,
            )?;
            return Ok(Common::Points(Box::new(scene)));
        };
        let shown = self.scene(0, &common(), task)?.picture.view.with_margin(0);
        Ok(Common::Exact(scene, shown))
    }

    /// Runs all rounds.
    fn run(&self, task: &dyn Task) -> Result<(Scan, Vec<Row>)> {
        let file = &self.files[0].file;
        let mut sums: Vec<Sums> = self.variants.iter().map(|_| Sums::default()).collect();
        let mut common = self.common(task)?;
        let focal_px = common.focal_px();
        task.phase(&self.name, Some((ALIGNMENTS.len() * self.variants.len()) as u64), "frames");
        let mut floor = Vec::new();
        for shift_px in ALIGNMENTS {
            let reference = common.draw(shift_px, |view| view)?;
            floor.push(self.floor(&mut common, shift_px, &reference, focal_px)?);
            let mut own: Vec<(Setting, Reference)> = Vec::new();
            for ((index, setting), sums) in self.variants.iter().zip(&mut sums) {
                task.check()?;
                let picture = self.timed(*index, setting, shift_px, sums, task)?;
                let family = setting.family();
                if !own.iter().any(|(known, _)| *known == family) {
                    let mut scene =
                        ReferenceScene::new(file, &family, self.base.size, &self.base, task)?;
                    own.push((family.clone(), scene.draw(shift_px, |view| view)?));
                }
                let own = own.iter().find(|(known, _)| *known == family);
                sums.errors.push(errors(&picture, &reference, focal_px));
                let flip = |own: &Reference| mean_flip(&picture.rgba, &own.rgba, own.width);
                sums.own_flip.extend(own.map(|(_, own)| flip(own)));
                task.advance(1);
            }
        }
        self.flickers(&mut common, &mut sums, task)?;
        let normals = self.normal_errors(task)?;
        let scan = Scan {
            name: self.name.clone(),
            file: self.file.clone(),
            points: file.points(),
            reference_points: common.points(),
            floor_flip: mean(&floor.iter().map(|e| e.flip).collect::<Vec<_>>()),
            floor_off_share: mean(&floor.iter().map(|e| e.off_share).collect::<Vec<_>>()),
            size: self.base.size,
            advice: Vec::new(),
            conditions: conditions::of_forest(file, task)?,
        };
        let rows = self.variants.iter().zip(&sums).map(|((index, setting), sums)| Row {
            normal_deg: normals[*index],
            ..self.row(*index, setting, sums)
        });
        Ok((scan, rows.collect()))
    }

    /// Errors of the normals of each file, degrees, where surfaces are known.
    fn normal_errors(&self, task: &dyn Task) -> Result<Vec<Option<f64>>> {
        let error = |index: usize| {
            let Some(scene) = &self.analytic else { return Ok(None) };
            let file = &self.files[index].file;
            if !file.has(PlaneKind::Normal) {
                return Ok(None);
            }
            let request = PictureRequest {
                method: Method::Points,
                colour_by: Some("normal".into()),
                ..self.base.clone()
            };
            let mut drawn = ResidentScene::new(file, &request, None, task)?;
            drawn.on_cpu(Changes::NONE)?;
            let view = drawn.picture.view.with_margin(0);
            Ok(Some(scene.normal_error(&view, drawn.cpu_picture())))
        };
        (0..self.files.len()).map(error).collect()
    }

    /// Error of the reference itself: against the same, a step of the lattice aside.
    fn floor(
        &self,
        common: &mut Common<'_>,
        shift_px: [f64; 2],
        reference: &Reference,
        focal_px: f64,
    ) -> Result<Errors> {
        let file = &self.files[0].file;
        let step = (0..3).map(|axis| file.metric().scale[axis]).fold(0.0, f64::max);
        let aside =
            |view: View| View { eye: view.eye + view.world_from_view.x_axis * step, ..view };
        let moved = common.draw(shift_px, aside)?;
        Ok(errors(&moved.picture(), reference, focal_px))
    }

    /// Draws a frame twice, and times the second one.
    fn timed(
        &self,
        index: usize,
        setting: &Setting,
        shift_px: [f64; 2],
        sums: &mut Sums,
        task: &dyn Task,
    ) -> Result<Picture> {
        let mut scene = self.scene(index, setting, task)?;
        scene.picture.view = aligned(&scene.picture.view, shift_px, setting.scale);
        draw(&mut scene, setting)?;
        let before = system::cpu_ms();
        let start = Instant::now();
        let mut times = draw(&mut scene, setting)?;
        if !setting.on_gpu {
            times.total_ms = start.elapsed().as_secs_f64() * 1e3;
        }
        sums.cpu_ms.extend(system::cpu_ms().zip(before).map(|(now, before)| now - before));
        sums.frames.push(times);
        sums.points = scene.points();
        Ok(enlarged(&scene.shown(setting.on_gpu)?, self.base.size))
    }

    fn scene(&self, index: usize, setting: &Setting, task: &dyn Task) -> Result<ResidentScene<'_>> {
        let request = setting.request(self.base.size, &self.base);
        let gpu = self.gpu.filter(|_| setting.on_gpu);
        ResidentScene::new(&self.files[index].file, &request, gpu, task)
    }

    /// Measures flicker on a slow orbit.
    fn flickers(&self, common: &mut Common<'_>, sums: &mut [Sums], task: &dyn Task) -> Result<()> {
        let angle = PATH_STEP_PX / common.focal_px();
        let middle = middle_depth(&common.draw([0.0; 2], |view| view)?);
        let turned = move |view: View, frame: usize| {
            let target = view.eye + view.forward() * middle;
            let turn = DMat3::from_axis_angle(view.world_from_view.y_axis, angle * frame as f64);
            View {
                eye: target + turn * (view.eye - target),
                world_from_view: turn * view.world_from_view,
                ..view
            }
        };
        task.phase(&format!("{}: flicker", self.name), None, "frames");
        let mut references = Vec::new();
        for frame in 0..PATH_FRAMES {
            task.check()?;
            references.push(common.draw([0.0; 2], |view| turned(view, frame))?.rgba);
        }
        for ((index, setting), sums) in self.variants.iter().zip(sums) {
            task.check()?;
            let mut scene = self.scene(*index, setting, task)?;
            let still = scene.picture.view;
            let mut before: Option<Vec<u8>> = None;
            let mut changes = Vec::new();
            for frame in 0..PATH_FRAMES {
                scene.picture.view = turned(still, frame);
                draw(&mut scene, setting)?;
                let now = enlarged(&scene.shown(setting.on_gpu)?, self.base.size).rgba;
                if let Some(before) = &before {
                    let wanted = [&references[frame - 1][..], &references[frame][..]];
                    changes.push(flicker([before, &now], wanted));
                }
                before = Some(now);
            }
            sums.flicker = Some(mean(&changes));
        }
        Ok(())
    }

    fn row(&self, index: usize, setting: &Setting, sums: &Sums) -> Row {
        let of =
            |value: fn(&Errors) -> f64| -> Vec<f64> { sums.errors.iter().map(value).collect() };
        let flips = of(|e| e.flip);
        let has_cpu = !sums.cpu_ms.is_empty();
        let all: Vec<f64> = sums.frames.iter().map(|f| f.total_ms).collect();
        Row {
            file: self.file.clone(),
            method: setting.method,
            backend: if setting.on_gpu { "gpu" } else { "cpu" },
            what: setting.text(),
            options: setting.options(self.base.size),
            settings: setting.clone(),
            points: sums.points,
            ms: quantile(&all, 0.5),
            ms_quartiles: [quantile(&all, 0.25), quantile(&all, 0.75)],
            cpu_ms: has_cpu.then(|| quantile(&sums.cpu_ms, 0.5)),
            cpu_ms_quartiles: has_cpu.then(|| [0.25, 0.75].map(|q| quantile(&sums.cpu_ms, q))),
            stages_ms: pass_times::of_frames(&sums.frames, |values| quantile(values, 0.5)),
            flip: mean(&flips),
            flip_range: [quantile(&flips, 0.0), quantile(&flips, 1.0)],
            flip_own: mean(&sums.own_flip),
            off_share: mean(&of(|e| e.off_share)),
            hole_share: mean(&of(|e| e.hole_share)),
            bleeding_share: mean(&of(|e| e.bleeding_share)),
            depth_px: mean(&of(|e| e.depth_px)),
            normal_deg: None,
            flicker: sums.flicker,
            build: self.files[index].build.clone(),
            on_front: false,
        }
    }

    /// Rows of traced light; none if the program is built without it.
    #[cfg(feature = "light")]
    fn lit(&self, is_full: bool, task: &dyn Task) -> Result<Vec<LitRow>> {
        lit::measure(&self.file, &self.files[0].file, &self.base, is_full, task)
    }

    /// Rows of traced light; none if the program is built without it.
    #[cfg(not(feature = "light"))]
    #[expect(clippy::unnecessary_wraps, reason = "the same signature as with light")]
    fn lit(&self, _is_full: bool, _task: &dyn Task) -> Result<Vec<LitRow>> {
        Ok(Vec::new())
    }

    /// The pictures of the settings of least error of each method, at equal time, and the
    /// reference.
    fn crops(&self, rows: &[Row], task: &dyn Task) -> Result<Crops> {
        let reference = self.common(task)?.draw([0.0; 2], |view| view)?;
        let mut pictures = Vec::new();
        let (budget_ms, chosen) = page::at_equal_time(rows);
        for index in chosen {
            let (file, setting) = &self.variants[index];
            let picture = self.timed(*file, setting, [0.0; 2], &mut Sums::default(), task)?;
            pictures.push((index, picture));
        }
        Ok(Crops { budget_ms, reference, pictures })
    }
}

impl Built {
    /// Opens a file, or builds a scan with the options of `base`, which are called `name`.
    fn new(
        path: &Path,
        name: &'static str,
        base: &PictureRequest,
        is_scan: bool,
        task: &dyn Task,
    ) -> Result<Self> {
        let start = Instant::now();
        let (file, folder) = open(&[path.to_owned()], base, task)?;
        let seconds = start.elapsed().as_secs_f64();
        let bytes = file.file_bytes();
        let options = if name.is_empty() { "default" } else { name };
        let build = is_scan.then_some(Build { options, seconds, bytes });
        Ok(Self { file: Arc::new(file), build, _folder: folder })
    }
}

/// Draws a frame of a setting.
fn draw(scene: &mut ResidentScene<'_>, setting: &Setting) -> Result<PassTimes> {
    match setting.on_gpu {
        true => scene.on_gpu(setting.changes()),
        false => scene.on_cpu(setting.changes()),
    }
}

/// Median depth of what a reference shows; 1 if it shows nothing.
fn middle_depth(reference: &Reference) -> f64 {
    let shown = reference.depth.iter().filter(|depth| depth.is_finite());
    let depths: Vec<f64> = shown.map(|depth| f64::from(*depth)).collect();
    if depths.is_empty() { 1.0 } else { quantile(&depths, 0.5) }
}

/// Mean; 0 of nothing.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
