//! What pictures load that need neither light nor filters nor, some, normals: the planes in memory
//! by kind, and the shaders that a new device built kernels from. Each picture names what it must
//! not load.

use crate::leave_out::pictures::Verdict;
use crate::render::scene::{Changes, ResidentScene};
use anyhow::Result;
use esker_engine::Method;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::DrawWith;
use esker_format::{Forest, PlaneKind};
use esker_points::Task;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Constants of shaders that turn on tests of filters.
const FILTERS: &str = "HIDES_POINTS";
/// Folders of shaders of light alone.
const LIGHT: [&str; 3] = ["trace", "filter", "splats"];

/// What a picture loads.
#[derive(Clone, Debug, Serialize)]
pub(super) struct LoadedRow {
    /// `loaded`.
    pub kind: &'static str,
    pub file: String,
    pub picture: &'static str,
    /// Bytes of planes in memory, by the name of their kind.
    pub planes: BTreeMap<String, u64>,
    /// Shaders of the plan.
    pub shaders: Vec<&'static str>,
    /// Files of the shaders that the GPU built kernels from; `None` without a GPU.
    pub built: Option<Vec<&'static str>>,
    /// What the picture does not need, of planes, shaders and their constants, but has.
    pub unneeded: Vec<String>,
    /// `not needed, left out`, or `fault`.
    pub verdict: Verdict,
}

/// A picture, and what it must not load.
struct Bare {
    name: &'static str,
    request: PictureRequest,
    planes: &'static [PlaneKind],
    /// Folders of shaders.
    shaders: &'static [&'static str],
    /// Constants of shaders that have to be 0.
    constants: &'static [&'static str],
}

/// Lists what pictures of a file load.
///
/// # Errors
/// If the file cannot be read, the GPU fails, or `task` is cancelled.
pub(super) fn measure(
    path: &Path,
    file: &Forest,
    base: &PictureRequest,
    with: &DrawWith,
    task: &dyn Task,
) -> Result<Vec<LoadedRow>> {
    let mut rows = Vec::new();
    for bare in pictures(base) {
        task.phase(bare.name, None, "frames");
        // Kernels of other pictures are no kernels of this one.
        let (gpu, _) = with.choose(None)?;
        let mut scene = ResidentScene::new(file, &bare.request, gpu.as_ref(), task)?;
        scene.on_gpu(Changes::NONE)?;
        let built = gpu.as_ref().map(|gpu| gpu.shaders());
        let mut planes: BTreeMap<String, u64> = BTreeMap::new();
        let mut unneeded = Vec::new();
        for (kind, bytes) in scene.picture.planes.iter().flat_map(|planes| planes.iter()) {
            let sum = planes.entry(kind.name()).or_default();
            if *sum == 0 && bare.planes.contains(&kind) {
                unneeded.push(format!("plane {}", kind.name()));
            }
            *sum += bytes.len() as u64;
        }
        let variants = scene.cost(Changes::NONE).0.variants();
        let on = variants.iter().flat_map(|variant| &variant.constants);
        let on = on.filter(|(name, value)| *value > 0 && bare.constants.contains(name));
        unneeded.extend(on.map(|(name, _)| format!("constant {name}")));
        let shaders: Vec<_> = variants.iter().map(|variant| variant.shader).collect();
        let files = shaders.iter().chain(built.iter().flatten());
        let folder_of = |file: &str| file.split('/').next().unwrap_or_default().to_owned();
        let is_bad = |file: &str| {
            let folder = folder_of(file);
            bare.shaders.iter().chain(&LIGHT).any(|bad| *bad == folder)
        };
        unneeded.extend(files.filter(|file| is_bad(file)).map(|file| format!("shader {file}")));
        unneeded.dedup();
        rows.push(LoadedRow {
            kind: "loaded",
            file: path.display().to_string(),
            picture: bare.name,
            planes,
            shaders,
            built,
            verdict: if unneeded.is_empty() { Verdict::LeftOut } else { Verdict::Fault },
            unneeded,
        });
    }
    Ok(rows)
}

/// Pictures that need little.
fn pictures(base: &PictureRequest) -> [Bare; 4] {
    use PlaneKind::{ClipLines, Colour, ColourRemainder, Compact, Intensity, Normal, Tangents};
    let points = PictureRequest { method: Method::Points, ..base.clone() };
    let matt = PictureRequest { shines: false, ..base.clone() };
    let splats = PictureRequest { method: Method::Ewa, ..base.clone() };
    let surfaces =
        &["pull", "push", "fill_holes", "silhouette", "smooth_depth", "shade", "antialias", "ewa"];
    [
        Bare {
            name: "points in one colour",
            request: points.clone(),
            planes: &[Normal, Colour, ColourRemainder, Compact, Intensity, Tangents, ClipLines],
            shaders: surfaces,
            constants: &[FILTERS, "NORMALS", "COLOURS", "SHINES"],
        },
        Bare {
            name: "points in the file's colours",
            request: PictureRequest { colour_by: None, full: false, ..points },
            planes: &[Normal, ColourRemainder, Tangents, ClipLines],
            shaders: surfaces,
            constants: &[FILTERS, "NORMALS", "SHINES"],
        },
        Bare {
            name: "surfaces without highlights",
            request: matt,
            planes: &[Colour, ColourRemainder, Compact, Intensity, Tangents, ClipLines],
            shaders: &["ewa", "exposure", "overlay", "eye_dome", "resolve"],
            constants: &[FILTERS, "COLOURS", "SHINES"],
        },
        Bare {
            name: "splats in one colour",
            request: splats,
            planes: &[Colour, ColourRemainder, Compact, Intensity],
            shaders: &["pull", "push", "fill_holes", "silhouette", "average", "overlay"],
            constants: &[FILTERS, "COLOURS"],
        },
    ]
}
