//! Which parts of a frame were needed: each optional pass that a plan runs is left out in turn, and
//! each that the plan leaves out as not needed is run.

use crate::leave_out::omissions::{DENSE_PX, largest};
use crate::leave_out::pictures::{Difference, Verdict};
use crate::quantile::quantile;
use crate::render::scene::{Changes, ResidentScene};
use anyhow::Result;
use esker_engine::Method;
use esker_engine::cameras::colour;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_format::{Forest, PlaneKind};
use esker_points::Task;
use esker_render::gpu::Gpu;
use esker_render::{Dots, FramePlan, Pass, PassChoice, PassSet, PassTimes, PointSize};
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

/// Least and greatest number of frames with a part and without it.
const FRAMES: [usize; 2] = [3, 9];
/// Time after which the least number of frames is enough.
const PATIENCE: Duration = Duration::from_millis(500);

/// A part of the frames of a view.
#[derive(Clone, Debug, Serialize)]
pub(super) struct PassRow {
    pub file: String,
    /// How the view is drawn.
    pub view: &'static str,
    /// Name of the part.
    pub part: &'static str,
    /// Passes that are the part; none if it is part of a pass.
    pub passes: Vec<&'static str>,
    /// Whether the plan of the view runs it.
    pub runs: bool,
    /// Whether it was needed.
    pub verdict: Verdict,
    /// How the pictures of the CPU with it and without it differ.
    #[serde(flatten)]
    pub difference: Difference,
    /// How the pictures of the GPU differ; `None` without a GPU, or if the part is always there.
    pub gpu_difference: Option<Difference>,
    /// Median time of its passes on the CPU, milliseconds; of part of a pass, the median time that
    /// a frame takes longer with it than the one after it without.
    pub cpu_ms: f64,
    /// The same on the GPU.
    pub gpu_ms: Option<f64>,
    /// Median time of a frame of the view on the CPU, milliseconds.
    pub frame_cpu_ms: f64,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
}

/// A part of frames, and the changes that turn it off or on.
struct Part {
    name: &'static str,
    passes: &'static [Pass],
    runs: bool,
    changes: Changes,
    /// Whether GPUs follow the changes.
    is_on_gpu: bool,
}

/// Optional passes, or groups of them that run together, with what is skipped for them.
const SKIPPED: [(&str, &[Pass], Pass); 10] = [
    ("dots among surfaces", &[Pass::Split, Pass::Grow, Pass::Overlay], Pass::Split),
    ("planes fitted to depths", &[Pass::FitPlanes], Pass::FitPlanes),
    ("means of points", &[Pass::Average], Pass::Average),
    ("exposure", &[Pass::Exposure], Pass::Exposure),
    ("pull and push", &[Pass::Pull, Pass::Push], Pass::Push),
    ("filling of holes", &[Pass::FillHoles], Pass::FillHoles),
    ("silhouettes", &[Pass::Silhouette], Pass::Silhouette),
    ("smoothing of depths", &[Pass::SmoothDepth], Pass::SmoothDepth),
    ("antialiasing", &[Pass::Antialias], Pass::Antialias),
    ("eye-dome lighting", &[Pass::EyeDome], Pass::EyeDome),
];

/// Passes that plans leave out where they change nothing.
const FORCED: [(&str, &[Pass]); 1] = [("silhouettes", &[Pass::Silhouette])];

/// Measures the parts of frames of a file.
///
/// # Errors
/// If a file cannot be read, the GPU fails, or `task` is cancelled.
pub(super) fn measure(
    path: &Path,
    file: &Forest,
    base: &PictureRequest,
    gpu: Option<&Gpu>,
    task: &dyn Task,
) -> Result<Vec<PassRow>> {
    let mut rows = Vec::new();
    for (view, request) in views(file, base)? {
        task.phase(view, None, "frames");
        let mut scene = ResidentScene::new(file, &request, gpu, task)?;
        for part in parts(&scene) {
            let mut row = measure_part(&mut scene, &part, task)?;
            (row.file, row.view) = (path.display().to_string(), view);
            [row.width, row.height] = request.size;
            rows.push(row);
        }
    }
    Ok(rows)
}

/// The views that are drawn: every method with what it has beside others.
fn views(file: &Forest, base: &PictureRequest) -> Result<Vec<(&'static str, PictureRequest)>> {
    let of = |method| PictureRequest { method, colour_by: None, full: false, ..base.clone() };
    let surfaces = of(Method::PullPush);
    let fine =
        PictureRequest { target_spacing_px: DENSE_PX, budget_points: u64::MAX, ..surfaces.clone() };
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 1.0 };
    let mut all = vec![
        ("surfaces", surfaces.clone()),
        ("surfaces and dots", of(Method::Auto)),
        ("splats", of(Method::Ewa)),
        ("points, adaptive dots", PictureRequest { dots, ..of(Method::Points) }),
    ];
    let is_dense = |plan: &FramePlan| !plan.passes.contains(&Pass::Push);
    let dense = largest(file, &fine, is_dense)?;
    if is_dense(&PictureScene::choose(file, &dense)?.plan) {
        all.push(("surfaces, dense view", dense));
    }
    let has_scans = colour::is_one_scan(file).is_ok_and(|is_one| !is_one);
    if has_scans && file.has(PlaneKind::Colour) {
        let colour_by = Some("rgb".into());
        let evened = PictureRequest { evens_exposure: true, colour_by, ..surfaces };
        all.push(("surfaces, exposure evened", evened));
    }
    Ok(all)
}

/// The parts of the frames of a scene.
fn parts(scene: &ResidentScene<'_>) -> Vec<Part> {
    let (plan, ..) = scene.cost(Changes::NONE);
    let has = |pass: Pass| plan.passes.contains(&pass);
    let mut all = Vec::new();
    let mut add = |name, passes, runs, changes, is_on_gpu| {
        all.push(Part { name, passes, runs, changes, is_on_gpu });
    };
    for (name, passes, skipped) in SKIPPED {
        let choice = PassChoice { skipped: PassSet::of(&[skipped]), ..PassChoice::default() };
        if passes.iter().all(|&pass| has(pass)) {
            add(name, passes, true, Changes { passes: choice, ..Changes::NONE }, true);
        }
    }
    for (name, passes) in FORCED {
        let choice = PassChoice { forced: PassSet::of(passes), ..PassChoice::default() };
        let changes = Changes { passes: choice, ..Changes::NONE };
        let (forced, ..) = scene.cost(changes);
        if passes.iter().all(|pass| !has(*pass) && forced.passes.contains(pass)) {
            add(name, passes, false, changes, true);
        }
    }
    if plan.smooths {
        let rough = Changes { is_rough: true, ..Changes::NONE };
        add("smoothing of pixels that show one point", &[], true, rough, true);
    }
    if plan.shines {
        add("highlights", &[], true, Changes { is_matt: true, ..Changes::NONE }, true);
    }
    if plan.margin_px > 0 {
        add("margin", &[], true, Changes { has_no_margin: true, ..Changes::NONE }, true);
    }
    if scene.has_residuals() {
        let coarse = Changes { has_no_residuals: true, ..Changes::NONE };
        add("residuals of positions", &[], true, coarse, false);
    }
    all
}

/// Draws frames as planned and changed, in turns.
fn measure_part(scene: &mut ResidentScene<'_>, part: &Part, task: &dyn Task) -> Result<PassRow> {
    let sides = [Changes::NONE, part.changes];
    let mut cpu: [Vec<PassTimes>; 2] = Default::default();
    let mut gpu: [Vec<PassTimes>; 2] = Default::default();
    let has_gpu = scene.has_gpu() && part.is_on_gpu;
    let mut pictures = Vec::new();
    let start = Instant::now();
    // Frames of the first round do not count.
    for round in 0..=FRAMES[1] {
        if round > FRAMES[0] && start.elapsed() > PATIENCE {
            break;
        }
        for (side, &changes) in sides.iter().enumerate() {
            task.check()?;
            let on_cpu = scene.on_cpu(changes)?;
            let on_gpu = has_gpu.then(|| scene.on_gpu(changes)).transpose()?;
            if round > 0 {
                cpu[side].push(on_cpu);
                gpu[side].extend(on_gpu);
                continue;
            }
            pictures.push(scene.shown(false)?);
            if has_gpu {
                pictures.push(scene.shown(true)?);
            }
        }
    }
    let (difference, gpu_difference) = match &pictures[..] {
        [a, b] => (Difference::of(a, b), None),
        [a, on_gpu, b, changed] => (Difference::of(a, b), Some(Difference::of(on_gpu, changed))),
        _ => anyhow::bail!("a frame has no picture"),
    };
    let taken = |[planned, changed]: &[Vec<PassTimes>; 2]| {
        let with = if part.runs { planned } else { changed };
        let own = with.iter().map(|times| times.sum_ms(part.passes));
        let longer = planned.iter().zip(changed).map(|(a, b)| a.total_ms - b.total_ms);
        let all: Vec<f64> = if part.passes.is_empty() { longer.collect() } else { own.collect() };
        quantile(&all, 0.5)
    };
    let frames: Vec<f64> = cpu[0].iter().map(|times| times.total_ms).collect();
    let differences = [difference].into_iter().chain(gpu_difference);
    Ok(PassRow {
        file: String::new(),
        view: "",
        part: part.name,
        passes: part.passes.iter().map(|pass| pass.name()).collect(),
        runs: part.runs,
        verdict: Verdict::of(differences, !part.runs),
        difference,
        gpu_difference,
        cpu_ms: taken(&cpu),
        gpu_ms: has_gpu.then(|| taken(&gpu)),
        frame_cpu_ms: quantile(&frames, 0.5),
        width: 0,
        height: 0,
    })
}
