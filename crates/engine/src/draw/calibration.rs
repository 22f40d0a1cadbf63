//! Measures the model of this machine ([`Pace`]) at first use: frames of a generated terrain by
//! each method, of different numbers of points and pixels. The result is kept in the user's cache
//! folder, a file for each processor, number of threads and version.

use crate::draw::method::{METHODS, Method};
use crate::draw::pace::{Cost, Load, Pace};
use crate::draw::scene::{PictureRequest, PictureScene, open};
use crate::machine::system;
use anyhow::{Context, Result};
use esker_format::Forest;
use esker_lod::CompactOctree;
use esker_points::Task;
use esker_render::{Picture, Renderer};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The scan that is drawn.
const SCAN: &str = "synthetic:terrain:1M:1";
/// Methods that are measured.
const MEASURED: [Method; 4] = [Method::Points, Method::PullPush, Method::Auto, Method::Ewa];
/// Pictures: width and height, target of points in pixels, camera: the whole scan, and a part that
/// fills the picture.
const PICTURES: [([u32; 2], f64, &str); 8] = [
    ([480, 300], 1.0, ""),
    ([480, 300], 6.0, ""),
    ([960, 600], 1.0, ""),
    ([960, 600], 6.0, ""),
    ([480, 300], 1.0, FULL),
    ([480, 300], 6.0, FULL),
    ([960, 600], 1.0, FULL),
    ([960, 600], 6.0, FULL),
];
/// A camera whose picture is full.
const FULL: &str = "direction=0.2,0.3,-1;fovy=20";
/// Most bytes of a kept model.
const BYTES_MAX: u64 = 1 << 16;
/// Frames of each picture, of which the least CPU time counts, after one that does not.
const FRAMES: usize = 4;

/// The model of this machine with as many threads as the current pool has: read from the cache, or
/// measured and kept there.
///
/// # Errors
/// If a frame cannot be drawn, or `task` is cancelled. A cache that cannot be written is no error.
pub fn pace(task: &dyn Task) -> Result<Pace> {
    let threads = rayon::current_num_threads();
    let kept = cache(threads);
    if let Some(known) = kept.as_deref().and_then(read) {
        return Ok(known);
    }
    let measured = measure(threads, task)?;
    if let Some(path) = &kept
        && write(path, &measured).is_err()
    {
        task.note(&format!("{}: the speed of this machine cannot be kept", path.display()));
    }
    Ok(measured)
}

/// File of the model of this machine; `None` without a cache folder.
fn cache(threads: usize) -> Option<PathBuf> {
    let folder = dirs::cache_dir()?.join("esker");
    let processor: String = system::processor()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
        .collect();
    Some(folder.join(format!("pace-{}-{threads}-{processor}.json", env!("CARGO_PKG_VERSION"))))
}

/// Reads a model; `None` if there is none, or it is damaged.
fn read(path: &Path) -> Option<Pace> {
    let mut text = String::new();
    File::open(path).ok()?.take(BYTES_MAX).read_to_string(&mut text).ok()?;
    let pace: Pace = serde_json::from_str(&text).ok()?;
    let is_sound = |cost: &Cost| {
        [cost.frame_ms, cost.points_ms, cost.pixels_ms, cost.covered_ms]
            .iter()
            .all(|term| term.is_finite() && *term >= 0.0)
    };
    let is_whole = MEASURED.iter().all(|method| pace.cost(*method).is_some_and(is_sound));
    (is_whole && pace.parallel.is_finite() && pace.parallel > 0.0).then_some(pace)
}

/// Writes a model, under a temporary name first.
fn write(path: &Path, pace: &Pace) -> Result<()> {
    let folder = path.parent().context("a file without a folder")?;
    std::fs::create_dir_all(folder)?;
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    file.write_all(&serde_json::to_vec_pretty(pace)?)?;
    file.persist(path)?;
    Ok(())
}

/// Draws all pictures by all methods.
fn measure(threads: usize, task: &dyn Task) -> Result<Pace> {
    task.phase(
        "measuring this machine",
        Some((MEASURED.len() * PICTURES.len()) as u64),
        "pictures",
    );
    let (file, _folder) = open(&[PathBuf::from(SCAN)], &PictureRequest::default(), task)?;
    let (mut costs, mut parallel) = (Vec::new(), Vec::new());
    for (method, name, _) in METHODS.iter().filter(|(method, ..)| MEASURED.contains(method)) {
        let mut measured = Vec::new();
        for (size, target_spacing_px, camera) in PICTURES {
            let camera = camera.parse().map_err(anyhow::Error::msg)?;
            let request = PictureRequest {
                size,
                target_spacing_px,
                camera,
                method: *method,
                ..PictureRequest::default()
            };
            let (load, cpu_ms, busy) = frame(&file, &request, task)?;
            measured.push((load, cpu_ms));
            parallel.push(busy);
            task.advance(1);
        }
        costs.push(((*name).to_owned(), Cost::fit(&measured)));
    }
    parallel.sort_by(f64::total_cmp);
    let parallel = parallel.get(parallel.len() / 2).copied().unwrap_or(1.0);
    Ok(Pace { threads, parallel: parallel.clamp(1.0, threads as f64), costs })
}

/// Draws frames of a picture: what they have, the least CPU time, milliseconds, and CPU time over
/// wall time.
fn frame(file: &Forest, request: &PictureRequest, task: &dyn Task) -> Result<(Load, f64, f64)> {
    let scene = PictureScene::read(file, request, task)?;
    let selection = &scene.selection;
    let octree = CompactOctree::with_hidden(file.table(), &selection.drawn, &selection.hidden);
    let draws = scene.draws(file);
    let frame = scene.appearance.frame(file, &scene.view, &draws, &octree);
    let (mut renderer, mut picture) = (Renderer::default(), Picture::default());
    let (mut least_ms, mut least_wall_ms) = (f64::MAX, f64::MAX);
    for number in 0..=FRAMES {
        task.check()?;
        let (start, before) = (Instant::now(), system::cpu_ms());
        renderer.render_into(&frame, &mut picture)?;
        let wall_ms = start.elapsed().as_secs_f64() * 1e3;
        let cpu_ms = system::cpu_ms().zip(before).map_or(wall_ms, |(now, then)| now - then);
        if number > 0 {
            least_ms = least_ms.min(cpu_ms);
            least_wall_ms = least_wall_ms.min(wall_ms);
        }
    }
    let pixels = f64::from(scene.view.width) * f64::from(scene.view.height);
    let shown = f64::from(picture.width) * f64::from(picture.height);
    let covered = picture.stats.pixels_covered as f64 / shown.max(1.0) * pixels;
    let load = Load { points: picture.stats.points_drawn as f64, pixels, covered };
    Ok((load, least_ms, least_ms / least_wall_ms.max(1e-6)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damaged_model_is_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("esker").join("pace.json");
        let cost = Cost { frame_ms: 1.0, points_ms: 2.0, pixels_ms: 3.0, covered_ms: 4.0 };
        let costs = ["points", "pull-push", "auto", "ewa"].map(|name| (name.to_owned(), cost));
        let pace = Pace { threads: 2, parallel: 1.7, costs: costs.to_vec() };
        write(&path, &pace).unwrap();
        assert_eq!(read(&path), Some(pace.clone()));
        write(&path, &Pace { parallel: f64::NAN, ..pace.clone() }).unwrap();
        assert_eq!(read(&path), None);
        write(&path, &Pace { costs: Vec::new(), ..pace }).unwrap();
        assert_eq!(read(&path), None);
        std::fs::write(&path, "{").unwrap();
        assert_eq!(read(&path), None);
    }
}
