//! Measures the model of this machine ([`Pace`]) at first use: frames of a generated terrain by
//! each method, of different numbers of points, pixels and covered pixels. The result is kept in
//! the user's cache folder, a file for each processor, number of threads and version.

use crate::draw::method::{METHODS, Method};
use crate::draw::pace::{Cost, Pace};
use crate::draw::probe::measured;
use crate::draw::scene::{PictureRequest, open};
use crate::machine::system;
use anyhow::{Context, Result};
use esker_points::Task;
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The scan that is drawn.
const SCAN: &str = "synthetic:terrain:1M:1";
/// Methods that are measured.
const MEASURED: [Method; 4] = [Method::Points, Method::PullPush, Method::Auto, Method::Ewa];
/// Width and height of pictures, and targets of points in pixels.
const SIZES: [[u32; 2]; 2] = [[480, 300], [960, 600]];
const SPACINGS_PX: [f64; 2] = [1.0, 6.0];
/// Cameras: the whole scan, a part that fills the picture, and the scan from afar in an otherwise
/// empty picture. In pictures that are all about equally full, the cost of a covered pixel cannot
/// be separated from that of any pixel.
const CAMERAS: [&str; 3] =
    ["", "direction=0.2,0.3,-1;fovy=20", "eye=599544,5299450,1010;target=600144,5300150,510"];
/// Part of the name of kept models: of another set of pictures, models are others.
const PICTURES: u32 = 2;
/// Time that threads may wait for a core, over CPU time, for a model that is used again.
const WAITED_MAX: f64 = 0.1;
/// Age of a model of a busy machine from which it is measured again.
const BUSY_AGE: Duration = Duration::from_secs(3600);
/// Most bytes of a kept model.
const BYTES_MAX: u64 = 1 << 16;
/// Frames of each picture, of which the least CPU time counts.
const FRAMES: usize = 4;

/// The model of this machine with as many threads as the current pool has: read from the cache, or
/// measured and kept there. One that was measured while the machine was busy is measured again an
/// hour later, and the better one kept.
///
/// # Errors
/// If a frame cannot be drawn, or `task` is cancelled. A cache that cannot be written is no error.
pub fn pace(task: &dyn Task) -> Result<Pace> {
    let threads = rayon::current_num_threads();
    let kept = cache(threads);
    let known = kept.as_deref().and_then(read);
    if let Some(known) = known.as_ref().filter(|known| is_good(known, age(kept.as_deref()))) {
        return Ok(known.clone());
    }
    let measured = better(known, measure(threads, task)?);
    if let Some(path) = &kept
        && write(path, &measured).is_err()
    {
        task.note(&format!("{}: the speed of this machine cannot be kept", path.display()));
    }
    if measured.waited > WAITED_MAX {
        task.note("other programs kept this machine busy while its speed was measured: times may be predicted too long, and it is measured again an hour from now");
    }
    Ok(measured)
}

/// The model of this machine, if it was measured before and is still good.
pub fn kept() -> Option<Pace> {
    let path = cache(rayon::current_num_threads())?;
    read(&path).filter(|pace| is_good(pace, age(Some(&path))))
}

/// Time since a file was written; `None` if that is unknown.
fn age(path: Option<&Path>) -> Option<Duration> {
    path?.metadata().ok()?.modified().ok()?.elapsed().ok()
}

/// Whether a model of some age is used as it is.
fn is_good(pace: &Pace, age: Option<Duration>) -> bool {
    pace.waited <= WAITED_MAX || age.is_some_and(|age| age < BUSY_AGE)
}

/// The one of two models for which threads waited less.
fn better(known: Option<Pace>, measured: Pace) -> Pace {
    known.filter(|known| known.waited < measured.waited).unwrap_or(measured)
}

/// File of the model of this machine; `None` without a cache folder.
fn cache(threads: usize) -> Option<PathBuf> {
    let folder = dirs::cache_dir()?.join("esker");
    let processor: String = system::processor()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '-' })
        .collect();
    let version = env!("CARGO_PKG_VERSION");
    Some(folder.join(format!("pace-{version}-{PICTURES}-{threads}-{processor}.json")))
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
    let is_shared = pace.parallel.is_finite() && pace.parallel > 0.0 && pace.waited.is_finite();
    (is_whole && is_shared).then_some(pace)
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
    let pictures = pictures();
    task.phase(
        "measuring this machine",
        Some((MEASURED.len() * pictures.len()) as u64),
        "pictures",
    );
    let (file, _folder) = open(&[PathBuf::from(SCAN)], &PictureRequest::default(), task)?;
    let (mut costs, mut parallel) = (Vec::new(), Vec::new());
    let before = (system::waited_for_cores_ms(), system::cpu_ms());
    for (method, name, _) in METHODS.iter().filter(|(method, ..)| MEASURED.contains(method)) {
        let mut all = Vec::new();
        for (size, target_spacing_px, camera) in &pictures {
            let request = PictureRequest {
                size: *size,
                target_spacing_px: *target_spacing_px,
                camera: camera.parse().map_err(anyhow::Error::msg)?,
                method: *method,
                ..PictureRequest::default()
            };
            let picture = measured(&file, &request, FRAMES, task)?;
            all.extend(picture.cpu_ms.first().map(|least_ms| (picture.load, *least_ms)));
            parallel.push(picture.parallel);
            task.advance(1);
        }
        costs.push(((*name).to_owned(), Cost::fit(&all)));
    }
    parallel.sort_by(f64::total_cmp);
    let parallel = parallel.get(parallel.len() / 2).copied().unwrap_or(1.0);
    let since = |now: Option<f64>, then: Option<f64>| now.zip(then).map(|(now, then)| now - then);
    let waited_ms = since(system::waited_for_cores_ms(), before.0).unwrap_or_default();
    let cpu_ms = since(system::cpu_ms(), before.1).unwrap_or(f64::INFINITY);
    let waited = (waited_ms / cpu_ms.max(1e-6)).max(0.0);
    Ok(Pace { threads, parallel: parallel.clamp(1.0, threads as f64), waited, costs })
}

/// Size, target of points in pixels and camera of each picture.
fn pictures() -> Vec<([u32; 2], f64, &'static str)> {
    let of_camera = |camera| {
        let of_size = move |size| SPACINGS_PX.map(|spacing_px| (size, spacing_px, camera));
        SIZES.into_iter().flat_map(of_size)
    };
    CAMERAS.into_iter().flat_map(of_camera).collect()
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
        let pace = Pace { threads: 2, parallel: 1.7, waited: 0.02, costs: costs.to_vec() };
        write(&path, &pace).unwrap();
        assert_eq!(read(&path), Some(pace.clone()));
        write(&path, &Pace { parallel: f64::NAN, ..pace.clone() }).unwrap();
        assert_eq!(read(&path), None);
        write(&path, &Pace { costs: Vec::new(), ..pace }).unwrap();
        assert_eq!(read(&path), None);
        std::fs::write(&path, "{").unwrap();
        assert_eq!(read(&path), None);
    }

    #[test]
    fn a_model_of_a_busy_machine_gives_way_to_a_better_one_only() {
        let of = |waited| Pace { waited, ..Pace::default() };
        let (young, old) = (Some(BUSY_AGE / 2), Some(BUSY_AGE * 2));
        assert!(is_good(&of(0.0), old) && is_good(&of(0.5), young));
        assert!(!is_good(&of(0.5), old) && !is_good(&of(0.5), None));
        assert_eq!(better(None, of(0.5)).waited, 0.5);
        assert_eq!(better(Some(of(0.5)), of(0.2)).waited, 0.2);
        assert_eq!(better(Some(of(0.5)), of(0.9)).waited, 0.5);
    }
}
