//! Scenes that are triangle meshes: those that are generated, and the Stanford bunny.

use super::content::Content;
use super::quads::add_quad;
use super::scene::{Parts, TraceScene, data};
use anyhow::{Context, Result};
use esker_lod::View;
use esker_points::Task;
use esker_scan::mesh::generated::{Lamp, MODELS, Model, Viewpoint};
use esker_scan::mesh::{self, TriangleMesh};
use esker_trace::scene::{Mesh, MeshTree, Object};
use esker_trace::{Light, Lights, Scene, Sky};
use glam::{Affine3A, DVec3, Vec3};
use std::sync::Arc;
use std::time::Instant;

/// Triangles of a mesh in a quick run: enough for its shape.
const QUICK_TRIANGLES: u64 = 40_000;

/// The scene of a generated mesh.
pub(super) fn generated(model: &Model, size: [u32; 2], is_quick: bool) -> TraceScene {
    let triangles = if is_quick { QUICK_TRIANGLES } else { model.triangles };
    of_mesh(model.name, &model.make(triangles), &model.view, model.lamps, size)
}

/// A scene of a mesh, whose origin is that of the mesh.
fn of_mesh(
    name: &str,
    mesh: &TriangleMesh,
    view: &Viewpoint,
    lamps: &[Lamp],
    [width, height]: [u32; 2],
) -> TraceScene {
    let eye = DVec3::from_array(view.eye);
    let target = DVec3::from_array(view.target);
    let view = View::look_at(eye, target, DVec3::Z, view.fov_deg.to_radians(), width, height);
    let lights: Vec<Light> = lamps.iter().map(light).collect();
    let parts = Parts {
        view,
        lights: Lights { lights, ..Lights::default() },
        origin: DVec3::ZERO,
        content: Content::default().add_mesh(mesh),
    };
    let start = Instant::now();
    let scene = Scene::default().with_objects(vec![object(mesh)]);
    let build_ms = start.elapsed().as_secs_f64() * 1e3;
    TraceScene { is_scan: false, ..parts.scene(name, scene, mesh.triangles.len(), build_ms) }
}

/// The light of plain numbers.
fn light(lamp: &Lamp) -> Light {
    let narrow = |colour: [f64; 3]| colour.map(|c| c as f32);
    match *lamp {
        Lamp::Sun { azimuth_deg, elevation_deg, diameter_deg, irradiance } => Light::Sun {
            azimuth_deg,
            elevation_deg,
            irradiance: narrow(irradiance),
            angular_diameter_deg: diameter_deg,
        },
        Lamp::Sky { zenith, horizon } => {
            let [zenith, horizon] = [zenith, horizon].map(narrow);
            Light::Sky { sky: Sky::Gradient { zenith, horizon, ground: horizon } }
        }
        Lamp::Point { place, intensity } => {
            Light::Point { position: place, intensity: narrow(intensity) }
        }
    }
}

/// A mesh as an object of a scene whose origin is that of the mesh.
pub(super) fn object(mesh: &TriangleMesh) -> Object {
    let narrow = |p: &[f64; 3]| DVec3::from_array(*p).as_vec3();
    let mesh = Mesh {
        positions: mesh.positions.iter().map(narrow).collect(),
        normals: mesh.normals.iter().map(|&n| Vec3::from_array(n)).collect(),
        colours: mesh.colours.iter().map(|c| Vec3::from_array(c.map(linear))).collect(),
        triangles: mesh.triangles.clone(),
        ..Mesh::default()
    };
    Object { mesh: Arc::new(MeshTree::new(mesh)), place: Affine3A::IDENTITY }
}

/// A value of sRGB as linear light (IEC 61966-2-1).
fn linear(byte: u8) -> f32 {
    let value = f32::from(byte) / 255.0;
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The Stanford bunny as it is published, before a wall and under the lights of the generated bust.
///
/// # Errors
/// If `ESKER_DATA` is not set, or the file cannot be read.
pub(super) fn bunny(size: [u32; 2], task: &dyn Task) -> Result<TraceScene> {
    let path = data()?.join("models/bunny-zipper-ascii.ply");
    let mut mesh = mesh::read(&path, task)?;
    let [low, high] = mesh.bounds().context("the bunny has no vertices")?;
    // Its y is up; the largest extent becomes 1 m, and its feet stand on the floor.
    let scale = 1.0 / (0..3).fold(0.0f64, |most, a| most.max(high[a] - low[a]));
    let middle = [0, 1, 2].map(|a| 0.5 * (low[a] + high[a]));
    for p in &mut mesh.positions {
        let [x, y, z] = [p[0] - middle[0], p[1] - low[1], p[2] - middle[2]];
        *p = [x * scale, -z * scale, y * scale];
    }
    mesh.normals.iter_mut().for_each(|n| *n = [n[0], -n[2], n[1]]);
    mesh.colours = vec![[214, 206, 196]; mesh.positions.len()];
    add_floor(&mut mesh);
    let view = Viewpoint { eye: [0.7, -2.1, 1.1], target: [0.0, 0.0, 0.45], fov_deg: 40.0 };
    let lamps = &MODELS[0].lamps;
    Ok(of_mesh("bunny", &mesh, &view, lamps, size))
}

/// Adds a floor and a red wall behind.
fn add_floor(mesh: &mut TriangleMesh) {
    let far = 3.0;
    let floor = [[-far, -far, 0.0], [far, -far, 0.0], [far, 1.0, 0.0], [-far, 1.0, 0.0]];
    let wall = [[-far, 1.0, 0.0], [far, 1.0, 0.0], [far, 1.0, far], [-far, 1.0, far]];
    add_quad(mesh, floor, [200, 196, 188]);
    add_quad(mesh, wall, [176, 62, 48]);
}
