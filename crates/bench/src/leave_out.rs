//! What leaving out saves: each thing that a frame can do without is drawn with and without it, in turns, in one
//! run; bytes read from the file, bytes of planes in drawing memory, milliseconds a frame. What only dense views can do
//! without is drawn at the largest size at which the view is dense, from farther away where it is at none; where even so both frames are the same, the row
//! says that it does not apply.

use crate::flight::quantile;
use crate::render::stand::{Changes, Stand};
use anyhow::Result;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::colour;
use esker_engine::draw::scene::PictureRequest as Picture;
use esker_engine::draw::scene::PictureScene;
use esker_engine::draw::scene::open;
use esker_engine::io::quantity::readable_bytes;
use esker_engine::machine::backend::DrawWith;
use esker_engine::machine::pool;
use esker_format::{Forest, PlaneKind};
use esker_points::attribute::names;
use esker_points::{Filter, Task};
use esker_render::gpu::Gpu;
use esker_render::{FramePlan, Method, Pass, Stages};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Frames at least and at most, and how long they may take before the least is enough.
const FRAMES: [usize; 2] = [3, 9];
const PATIENCE: Duration = Duration::from_secs(2);
/// A target spacing with which views are dense, and one with which points do not crowd.
const DENSE: f64 = 0.3;
const SPARSE: f64 = 1.5;
/// Pixels on the shorter side of the smallest picture in which a dense view is looked for.
const SIDE_MIN: u32 = 16;

/// What is measured.
#[derive(Clone, Debug)]
pub struct Request {
    /// `.esker` files or scans.
    pub files: Vec<PathBuf>,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// The camera.
    pub camera: Camera,
    /// The GPU; the CPU is always measured as well.
    pub with: DrawWith,
    /// Threads; 0 is one a core.
    pub threads: usize,
}

/// One thing that can be left out: what is drawn with it, and without.
struct Omission {
    name: &'static str,
    with: (Picture, Changes),
    without: (Picture, Changes),
}

/// Measures; the report.
///
/// # Errors
/// Where a file cannot be read, a GPU is asked for and there is none, or it fails; on request.
pub fn measure(request: &Request, task: &dyn Task) -> Result<Value> {
    let (gpu, drawer) = request.with.choose(None)?;
    pool::run(request.threads, || {
        let mut rows = Vec::new();
        for path in &request.files {
            let (file, _folder) = open(std::slice::from_ref(path), &Picture::default(), task)?;
            for omission in omissions(&file, request)? {
                task.phase(omission.name, None, "frames");
                let mut row = omission.measure(&file, gpu.as_ref(), task)?;
                row["file"] = json!(path.display().to_string());
                rows.push(row);
            }
        }
        Ok(json!({
            "adapter": gpu.as_ref().map(|gpu| &gpu.name),
            "note": drawer.note,
            "threads": rayon::current_num_threads(),
            "width": request.size[0],
            "height": request.size[1],
            "rows": rows,
        }))
    })
}

/// What can be left out of pictures of a file.
fn omissions(file: &Forest, request: &Request) -> Result<Vec<Omission>> {
    let base = Picture {
        size: request.size,
        camera: request.camera,
        colour_by: Some("plain".into()),
        full: true,
        ..Picture::default()
    };
    let same = Changes::default();
    let mut all = vec![Omission {
        name: "highlights",
        with: (base.clone(), same),
        without: (Picture { shines: false, ..base.clone() }, same),
    }];
    if let Some(colour) =
        [PlaneKind::Colour, PlaneKind::Intensity].into_iter().find(|&k| file.has(k))
    {
        let name = if colour == PlaneKind::Colour { "rgb" } else { names::INTENSITY };
        all.push(Omission {
            name: "colour plane",
            with: (Picture { colour_by: Some(name.into()), ..base.clone() }, same),
            without: (base.clone(), same),
        });
    }
    if file.palette().is_some() {
        let full = Picture { colour_by: Some("rgb".into()), ..base.clone() };
        all.push(Omission {
            name: "colours beyond a palette",
            with: (full.clone(), same),
            without: (Picture { full: false, ..full }, same),
        });
    }
    if file.has(PlaneKind::Colour) && colour::scans(file).is_ok() {
        let coloured = Picture { colour_by: Some("rgb".into()), ..base.clone() };
        all.push(Omission {
            name: "exposure compensation",
            with: (Picture { evens_exposure: true, ..coloured.clone() }, same),
            without: (coloured, same),
        });
    }
    if file.has(PlaneKind::Normal) {
        let points = Picture { method: Method::Points, ..base.clone() };
        all.push(Omission {
            name: "normal plane of points alone",
            with: (Picture { colour_by: Some("normal".into()), ..points.clone() }, same),
            without: (points, same),
        });
    }
    if file.has_oriented_normals() {
        all.push(Omission {
            name: "back faces",
            with: (base.clone(), Changes { keeps_back_faces: true, ..same }),
            without: (base.clone(), same),
        });
    }
    if colour::colouring(file, Some(names::GPS_TIME), esker_engine::calls::info::bounds(file))
        .is_ok()
    {
        let coded = Picture { colour_by: Some(names::GPS_TIME.into()), ..base.clone() };
        all.push(Omission {
            name: "values beyond a byte of code",
            with: (Picture { keeps_values: true, ..coded.clone() }, same),
            without: (coded, same),
        });
    }
    let sparse = Picture { target_spacing_px: SPARSE, ..base.clone() };
    all.push(Omission {
        name: "smoothing of pixels that show one point",
        with: (sparse.clone(), same),
        without: (sparse.clone(), Changes { is_rough: true, ..same }),
    });
    if !file.has(PlaneKind::Normal) {
        all.push(Omission {
            name: "planes told from depths",
            with: (sparse.clone(), same),
            without: (sparse, Changes { is_flat: true, ..same }),
        });
    }
    let dense = Picture { target_spacing_px: DENSE, budget_points: u64::MAX, ..base.clone() };
    let crowded = largest(file, &dense, FramePlan::averages)?;
    all.push(Omission {
        name: "means of the points that share a pixel",
        with: (crowded.clone(), same),
        without: (crowded, Changes { one_wins: true, ..same }),
    });
    let dense = largest(file, &dense, |plan| !plan.passes.contains(&Pass::Push))?;
    all.push(Omission {
        name: "pull and push of a dense view",
        with: (dense.clone(), Changes { always_pushes: true, ..same }),
        without: (dense, same),
    });
    all.push(Omission {
        name: "surfaces: points alone",
        with: (base.clone(), same),
        without: (Picture { method: Method::Points, ..base.clone() }, same),
    });
    if let Some(bounds) = quarter(file) {
        let filter = Filter { bounds: Some(bounds), ..Filter::default() };
        let camera = fixed(file, request);
        let whole = Picture { camera, ..base };
        all.push(Omission {
            name: "what lies outside a box",
            with: (whole.clone(), same),
            without: (Picture { filter, ..whole }, same),
        });
    }
    Ok(all)
}

/// The same picture at the largest size, halved and halved again, at which its plan is so; where at none, from farther
/// away; as it is where not even so.
fn largest(file: &Forest, picture: &Picture, is_so: fn(&FramePlan) -> bool) -> Result<Picture> {
    let away = Picture { camera: farther(file, picture), ..picture.clone() };
    for mut smaller in [picture.clone(), away] {
        while smaller.size.into_iter().min() >= Some(SIDE_MIN) {
            if is_so(&PictureScene::choose(file, &smaller)?.plan) {
                return Ok(smaller);
            }
            // The same points, drawn smaller.
            smaller.size = smaller.size.map(|side| side / 2);
            smaller.target_spacing_px /= 2.0;
        }
    }
    Ok(picture.clone())
}

/// A picture's camera, as much farther away as the file is large: nothing is near the eye.
fn farther(file: &Forest, picture: &Picture) -> Camera {
    let bounds = esker_engine::calls::info::bounds(file);
    let view = picture.camera.view(bounds, picture.size);
    let extent: f64 = (0..3).map(|i| (bounds[1][i] - bounds[0][i]).powi(2)).sum();
    let eye = view.eye - view.forward() * extent.sqrt();
    Camera { eye: Some(eye), target: Some(eye + view.forward()), ..picture.camera }
}

/// The camera that shows the whole file, whatever a filter leaves of it.
fn fixed(file: &Forest, request: &Request) -> Camera {
    let view = request.camera.view(esker_engine::calls::info::bounds(file), request.size);
    Camera { eye: Some(view.eye), target: Some(view.eye + view.forward()), ..request.camera }
}

/// The middle quarter of a file, seen from above.
fn quarter(file: &Forest) -> Option<esker_points::filter::Bounds> {
    let [low, high] = esker_engine::calls::info::bounds(file);
    let at = |axis: usize, share: f64| low[axis] + (high[axis] - low[axis]) * share;
    let bounds = esker_points::filter::Bounds {
        min: [at(0, 0.25), at(1, 0.25), f64::NEG_INFINITY],
        max: [at(0, 0.75), at(1, 0.75), f64::INFINITY],
    };
    (0..2).all(|axis| bounds.min[axis] < bounds.max[axis]).then_some(bounds)
}

impl Omission {
    fn measure(&self, file: &Forest, gpu: Option<&Gpu>, task: &dyn Task) -> Result<Value> {
        let mut with = Stand::new(file, &self.with.0, gpu, task)?;
        let mut without = Stand::new(file, &self.without.0, gpu, task)?;
        let applies = with.takes(self.with.1) != without.takes(self.without.1);
        let size = self.without.0.size;
        let mut stands = [(&mut with, self.with.1), (&mut without, self.without.1)];
        let mut frames = [[Vec::new(), Vec::new()], [Vec::new(), Vec::new()]];
        let start = Instant::now();
        // The first round pays for fresh memory and is left out.
        for round in 0..=FRAMES[1] {
            if round > FRAMES[0] && start.elapsed() > PATIENCE {
                break;
            }
            for ((stand, changes), frames) in stands.iter_mut().zip(&mut frames) {
                task.check()?;
                let [cpu, on_gpu] = frames;
                let took = stand.on_cpu(*changes)?;
                let gpu_took = stand.has_gpu().then(|| stand.on_gpu(*changes)).transpose()?;
                if round > 0 {
                    cpu.push(took);
                    on_gpu.extend(gpu_took);
                }
            }
        }
        let ms = |frames: &[Stages]| {
            let all: Vec<f64> = frames.iter().map(|s| s.total_ms).collect();
            (!all.is_empty()).then(|| quantile(&all, 0.5))
        };
        let side = |stand: &Stand<'_>, frames: &[Vec<Stages>; 2]| {
            json!({
                "bytes_read": stand.scene.read_bytes,
                "bytes_resident": stand.plane_bytes(),
                "points": stand.points(),
                "cpu_ms": ms(&frames[0]),
                "gpu_ms": ms(&frames[1]),
            })
        };
        Ok(json!({
            "left_out": self.name,
            "applies": applies,
            "width": size[0],
            "height": size[1],
            "with": side(&with, &frames[0]),
            "without": side(&without, &frames[1]),
        }))
    }
}

/// What is left out, and the size of the picture where it is another than was asked for.
fn name_of(row: &Value, report: &Value) -> String {
    let name = row["left_out"].as_str().unwrap_or("?");
    let is_smaller = row["width"] != report["width"] || row["height"] != report["height"];
    if is_smaller { format!("{name} ({}x{})", row["width"], row["height"]) } else { name.into() }
}

/// The report for people.
pub fn text(report: &Value) -> String {
    let rows = report["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let mut lines = Vec::new();
    let mut file = "";
    for row in rows {
        if let Some(name) = row["file"].as_str().filter(|name| *name != file) {
            file = name;
            lines.push(format!("{name}: with it and without"));
        }
        let pair = |name: &str| [&row["with"][name], &row["without"][name]];
        let bytes = |name: &str| {
            let [with, without] = pair(name).map(|v| readable_bytes(v.as_u64().unwrap_or(0)));
            format!("{with:>10} {without:>10}")
        };
        let ms = |name: &str| match pair(name).map(Value::as_f64) {
            [Some(with), Some(without)] => format!("{with:>8.2} {without:>8.2} ms"),
            _ => String::new(),
        };
        let name = name_of(row, report);
        if row["applies"] == false {
            lines.push(format!("  {name:<50} not in this view: nothing is left out"));
            continue;
        }
        lines.push(format!(
            "  {name:<50} read {}  resident {}  cpu {}{}{}",
            bytes("bytes_read"),
            bytes("bytes_resident"),
            ms("cpu_ms"),
            if row["with"]["gpu_ms"].is_null() { "" } else { "  gpu " },
            ms("gpu_ms"),
        ));
    }
    lines.extend(report["adapter"].as_str().map(|name| format!("gpu: {name}")));
    lines.join("\n")
}
