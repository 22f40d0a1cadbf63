//! Draws each omission's two pictures in turns, on the CPU and on the GPU.

use crate::leave_out::loaded;
use crate::leave_out::omissions::{Omission, omissions};
use crate::leave_out::passes;
use crate::leave_out::pictures::{Difference, LeftOutBy, Verdict};
use crate::leave_out::report::{FrameCost, LeaveOutReport, LeaveOutRow, Saving};
use crate::quantile::median_ms;
use crate::render::scene::ResidentScene;
use anyhow::Result;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, open};
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::pool;
use esker_format::Forest;
use esker_points::Task;
use esker_render::PassTimes;
use esker_render::gpu::Gpu;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Least and greatest number of frames of a picture.
const FRAMES: [usize; 2] = [3, 9];
/// Time after which the least number of frames is enough.
const PATIENCE: Duration = Duration::from_secs(2);

/// Files, pictures and devices to measure.
#[derive(Clone, Debug)]
pub struct LeaveOutRequest {
    /// `.esker` files or scans.
    pub files: Vec<PathBuf>,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// The camera.
    pub camera: Camera,
    /// Choice of the GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 stands for one a core.
    pub threads: usize,
}

/// Measures what each omission saves.
///
/// # Errors
/// If a file cannot be read, a required GPU is missing or fails, or `task` is cancelled.
pub fn measure(request: &LeaveOutRequest, task: &dyn Task) -> Result<LeaveOutReport> {
    let (gpu, drawer) = request.with.choose(None)?;
    pool::run(request.threads, || {
        let (mut rows, mut passes, mut loads) = (Vec::new(), Vec::new(), Vec::new());
        for path in &request.files {
            let (file, _folder) =
                open(std::slice::from_ref(path), &PictureRequest::default(), task)?;
            let base = PictureRequest {
                size: request.size,
                camera: request.camera,
                colour_by: Some("plain".into()),
                full: true,
                ..PictureRequest::default()
            };
            for omission in omissions(&file, &base)? {
                task.phase(omission.name, None, "frames");
                rows.push(measure_omission(&omission, path, &file, gpu.as_ref(), task)?);
            }
            loads.extend(loaded::measure(path, &file, &base, &request.with, task)?);
            passes.extend(passes::measure(path, &file, &base, gpu.as_ref(), task)?);
        }
        Ok(LeaveOutReport {
            adapter: gpu.as_ref().map(|gpu| gpu.name.clone()),
            note: drawer.note,
            threads: rayon::current_num_threads(),
            width: request.size[0],
            height: request.size[1],
            rows,
            passes,
            loaded: loads,
            has_light: cfg!(feature = "light"),
        })
    })
}

/// Times of frames of one picture.
#[derive(Default)]
struct FrameTimes {
    cpu: Vec<PassTimes>,
    gpu: Vec<PassTimes>,
}

/// Draws both pictures of an omission in turns.
fn measure_omission(
    omission: &Omission,
    path: &Path,
    file: &Forest,
    gpu: Option<&Gpu>,
    task: &dyn Task,
) -> Result<LeaveOutRow> {
    let Omission { name, with: (with, with_changes), without: (without, without_changes), by } =
        omission;
    let mut scenes = [
        (ResidentScene::new(file, with, gpu, task)?, *with_changes),
        (ResidentScene::new(file, without, gpu, task)?, *without_changes),
    ];
    let [with_cost, without_cost] = scenes.each_ref().map(|(scene, changes)| scene.cost(*changes));
    let mut times = [FrameTimes::default(), FrameTimes::default()];
    let start = Instant::now();
    // Frames of the first round are slower, for memory is new, and do not count.
    for round in 0..=FRAMES[1] {
        if round > FRAMES[0] && start.elapsed() > PATIENCE {
            break;
        }
        for ((scene, changes), times) in scenes.iter_mut().zip(&mut times) {
            task.check()?;
            let cpu = scene.on_cpu(*changes)?;
            let gpu = scene.has_gpu().then(|| scene.on_gpu(*changes)).transpose()?;
            if round > 0 {
                times.cpu.push(cpu);
                times.gpu.extend(gpu);
            }
        }
    }
    let has_gpu = scenes[0].0.has_gpu();
    let mut compared = |on_gpu: bool| {
        let [with, without] = &mut scenes;
        Ok::<_, anyhow::Error>(Difference::of(&with.0.shown(on_gpu)?, &without.0.shown(on_gpu)?))
    };
    let cpu_difference = compared(false)?;
    let gpu_difference = has_gpu.then(|| compared(true)).transpose()?;
    let applies = with_cost != without_cost;
    let is_left_out = !applies || *by == LeftOutBy::Rule;
    let differences = [cpu_difference].into_iter().chain(gpu_difference);
    let frame_cost = |i: usize| FrameCost {
        bytes_read: scenes[i].0.picture.read_bytes,
        bytes_resident: scenes[i].0.plane_bytes(),
        points: scenes[i].0.points(),
        cpu_ms: median_ms(&times[i].cpu),
        gpu_ms: median_ms(&times[i].gpu),
    };
    Ok(LeaveOutRow {
        file: path.display().to_string(),
        left_out: name,
        applies,
        verdict: Verdict::of(differences, is_left_out),
        difference: cpu_difference,
        gpu_difference,
        is_promised: !applies,
        width: without.size[0],
        height: without.size[1],
        with: frame_cost(0),
        without: frame_cost(1),
        cpu_saving: Saving::of(&times[0].cpu, &times[1].cpu),
        gpu_saving: Saving::of(&times[0].gpu, &times[1].gpu),
    })
}
