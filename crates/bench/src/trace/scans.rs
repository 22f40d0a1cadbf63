//! Scenes that are scans: built like any input, and lit as the splats of the nodes that a camera
//! needs.

use super::content::Content;
use super::estimate::{Effort, Estimate};
use super::report::Surroundings;
use super::scene::{Parts, TraceScene, data};
use anyhow::Result;
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, PictureScene, open};
use esker_engine::{BuildOptions, Method, NormalsMode};
use esker_format::Forest;
use esker_lod::{CompactOctree, light_octree};
use esker_points::Task;
use esker_render::{Frame, Splat, splats};
use esker_trace::scene::{Albedo, SplatInput, adopt_normals};
use esker_trace::{Light, Lights, Scene, Sequence, Sky};
use glam::DVec3;
use std::path::PathBuf;
use std::time::Instant;

/// Points of generated scans, and of those in a quick run. The terrain grows with its points; the
/// office gets denser.
const POINTS: [&str; 2] = ["6M", "1M"];
const QUICK_POINTS: [&str; 2] = ["1M", "300k"];
/// Most points of a lit scene: about those that 1024 x 768 pixels need.
const SPLATS_MAX: u64 = 1_200_000;
/// Bounces and samples with which the light of surroundings is compared.
const SURROUNDINGS_BOUNCES: u32 = 2;
const SURROUNDINGS_SAMPLES: u32 = 2;

/// A scan, its camera as shares of its box, and its lights.
struct Scan {
    path: PathBuf,
    eye: [f64; 3],
    target: [f64; 3],
    up: DVec3,
    fovy_deg: f64,
    albedo: Albedo,
    lights: fn([DVec3; 2]) -> Vec<Light>,
}

impl Scan {
    fn of(name: &str, is_quick: bool) -> Result<Self> {
        let [office, terrain] = if is_quick { QUICK_POINTS } else { POINTS };
        let generated = |scene: &str, points: &str| format!("synthetic:{scene}:{points}:1").into();
        Ok(match name {
            "office" => Self {
                path: generated("office", office),
                eye: [0.19, 0.63, 0.19],
                target: [0.24, 0.95, 0.16],
                up: DVec3::Z,
                fovy_deg: 60.0,
                albedo: Albedo::Rgb,
                lights: rooms,
            },
            "terrain" => Self {
                path: generated("terrain", terrain),
                eye: [0.5, -0.12, 1.9],
                target: [0.5, 0.45, 0.2],
                up: DVec3::Z,
                fovy_deg: 40.0,
                albedo: Albedo::Rgb,
                lights: open_air,
            },
            _ => Self {
                path: data()?.join("laz/indoor.laz"),
                // Along a corridor with stairs; the second axis points up.
                eye: [0.7, 0.31, 0.54],
                target: [0.28, 0.31, 0.39],
                up: DVec3::Y,
                fovy_deg: 70.0,
                // Its fields of colour are empty.
                albedo: Albedo::Plain([0.6; 3]),
                lights: corridor,
            },
        })
    }

    /// Opens the scan, after building it, and reads what a picture needs.
    fn open(self, size: [u32; 2], task: &dyn Task) -> Result<OpenScan> {
        // As `esker render --method lit` builds scans.
        let build = BuildOptions { normals: NormalsMode::Estimate, ..BuildOptions::default() };
        let method = Method::Lit;
        let request = PictureRequest { size, method, build, ..PictureRequest::default() };
        let (file, folder) = open(std::slice::from_ref(&self.path), &request, task)?;
        let [low, high] = info::bounds(&file).map(DVec3::from_array);
        let at = |share: [f64; 3]| low + (high - low) * DVec3::from_array(share);
        let camera = Camera {
            eye: Some(at(self.eye)),
            target: Some(at(self.target)),
            up: Some(self.up),
            fovy_deg: Some(self.fovy_deg),
            ..Camera::default()
        };
        let camera = camera.unmeasured(file.lattice());
        let request = PictureRequest { camera, budget_points: SPLATS_MAX, ..request };
        let picture = PictureScene::read(&file, &request, task)?;
        Ok(OpenScan { scan: self, bounds: [low, high], picture, file, _folder: folder })
    }
}

/// A scan with the points of its picture and those around it.
pub(super) struct OpenScan {
    scan: Scan,
    bounds: [DVec3; 2],
    picture: PictureScene,
    file: Forest,
    /// Where the file lies if it was built.
    _folder: Option<tempfile::TempDir>,
}

/// Lamps in the room that is seen and along the corridor, and a sky that windows let in.
fn rooms(bounds: [DVec3; 2]) -> Vec<Light> {
    let corridor = (0..4).map(|i| DVec3::new(0.2 + 0.2 * f64::from(i), 0.5, 0.24));
    lamps(bounds, corridor.chain([DVec3::new(0.215, 0.75, 0.25)]))
}

/// Lamps along the corridor of the real scan.
fn corridor(bounds: [DVec3; 2]) -> Vec<Light> {
    lamps(bounds, [0.65, 0.5, 0.35].map(|x| DVec3::new(x, 0.45, 0.44)).into_iter())
}

/// Lamps at shares of a box, and a sky.
fn lamps([low, high]: [DVec3; 2], shares: impl Iterator<Item = DVec3>) -> Vec<Light> {
    let lamps = shares.map(|share| {
        let position = (low + (high - low) * share).to_array();
        Light::Point { position, intensity: [3.0, 2.7, 2.3] }
    });
    let sky = Light::Sky { sky: Sky::Constant([1.0, 1.15, 1.3]) };
    lamps.chain([sky]).collect()
}

fn open_air(_: [DVec3; 2]) -> Vec<Light> {
    vec![
        Light::Sun {
            azimuth_deg: 235.0,
            elevation_deg: 28.0,
            irradiance: [3.0, 2.7, 2.2],
            angular_diameter_deg: 0.533,
        },
        Light::Sky {
            sky: Sky::Gradient {
                zenith: [0.25, 0.4, 0.7],
                horizon: [0.6, 0.65, 0.7],
                ground: [0.2, 0.2, 0.2],
            },
        },
    ]
}

/// Indirect light with the points in the picture alone, and with those around it, over that with
/// all points of the scan; none if a part has no light.
///
/// # Errors
/// If the scan cannot be read, or `task` is cancelled.
pub(super) fn surroundings(
    scene: &TraceScene,
    OpenScan { scan, picture, file, .. }: &OpenScan,
    task: &dyn Task,
) -> Result<Option<Surroundings>> {
    let whole = PictureRequest {
        method: Method::PullPush,
        target_spacing_px: 0.0,
        budget_points: u64::MAX,
        ..PictureRequest::default()
    };
    let whole = PictureScene::read(file, &whole, task)?;
    let cull_back_faces = picture.plan.culls_back_faces;
    let light = |splats: &[Splat]| -> Result<f64> {
        let input =
            SplatInput { splats, albedo: scan.albedo, cull_back_faces, ..Default::default() };
        let part = TraceScene { scene: Scene::new(input), ..scene.clone() };
        let effort = Effort {
            bounces: SURROUNDINGS_BOUNCES,
            samples: SURROUNDINGS_SAMPLES,
            sequence: Sequence::ZOrder,
            seed: 0,
            gloss: None,
        };
        let estimate = Estimate::new(&part, effort, task)?;
        let hits = estimate.guides.is_hit.iter().filter(|is_hit| **is_hit).count();
        let lit = |plane: &Vec<f32>| -> f64 {
            let lit = plane.iter().zip(&estimate.guides.is_hit).filter(|(_, is_hit)| **is_hit);
            lit.map(|(value, _)| f64::from(*value)).sum()
        };
        Ok(estimate.incident.planes.iter().map(lit).sum::<f64>() / hits.max(1) as f64)
    };
    let origin = picture.view.eye;
    let of = |picture: &PictureScene, draws: &[_], octree: &_| {
        lit_splats(&picture.appearance.frame(file, &picture.view, draws, octree), origin)
    };
    let octree = |picture: &PictureScene| {
        CompactOctree::with_hidden(
            file.table(),
            &picture.selection.drawn,
            &picture.selection.hidden,
        )
    };
    let alone = of(picture, &picture.draws(file), &octree(picture));
    let octree_of_both = light_octree(file.table(), &picture.selection);
    let around = of(picture, &picture.lit_draws(file), &octree_of_both);
    let all = of(&whole, &whole.draws(file), &octree(&whole));
    let points = [alone.len(), around.len(), all.len()];
    let total = light(&all)?;
    let (alone, around) = (light(&alone)? / total, light(&around)? / total);
    Ok((total > 0.0).then_some(Surroundings { points, alone, around }))
}

/// The splats of a frame as lit pictures take them.
fn lit_splats(frame: &Frame<'_>, origin: DVec3) -> Vec<Splat> {
    let mut splats = splats(frame, origin);
    adopt_normals(&mut splats);
    splats
}

/// The scene of a scan, and the scan.
///
/// # Errors
/// If the scan cannot be read or built, or `task` is cancelled.
pub(super) fn scene(
    name: &str,
    size: [u32; 2],
    is_quick: bool,
    task: &dyn Task,
) -> Result<(TraceScene, OpenScan)> {
    let open = Scan::of(name, is_quick)?.open(size, task)?;
    let OpenScan { scan, bounds, picture, file, .. } = &open;
    let octree = light_octree(file.table(), &picture.selection);
    let draws = picture.lit_draws(file);
    let frame = picture.appearance.frame(file, &picture.view, &draws, &octree);
    let origin = frame.view.eye;
    let (splats, albedo) = (lit_splats(&frame, origin), scan.albedo);
    let cull_back_faces = frame.cull_back_faces;
    let parts = Parts {
        view: frame.view.with_margin(0),
        lights: Lights { lights: (scan.lights)(*bounds), ..Lights::default() },
        origin,
        content: Content::default().add_splats(&splats).add(&albedo).add(&cull_back_faces),
    };
    let start = Instant::now();
    let scene =
        Scene::new(SplatInput { splats: &splats, albedo, cull_back_faces, ..Default::default() });
    let build_ms = start.elapsed().as_secs_f64() * 1e3;
    let scene = parts.scene(name, scene, splats.len(), build_ms);
    Ok((scene, open))
}
