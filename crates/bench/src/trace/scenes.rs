//! The scenes of the benchmark: generated meshes in place of those of `bauszat2011`, and scans;
//! more where `ESKER_DATA` names a folder of real scans. Each has a camera and lights of its own.

use super::content::Content;
use super::scans;
use anyhow::{Context, Result, bail};
use esker_lod::View;
use esker_points::Task;
use esker_scan::mesh::generated::{Lamp, MODELS, Viewpoint};
use esker_scan::mesh::{self, TriangleMesh};
use esker_trace::scene::{Mesh, MeshTree, Object};
use esker_trace::{Camera, Light, Lights, PreparedLights, Scene, Sky};
use glam::{Affine3A, DVec3, Vec3};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Names of the scenes that every machine has, meshes first.
pub const SCENES: [&str; 5] = ["bust", "knot", "hall", "office", "terrain"];
/// Names of the scenes that need `ESKER_DATA`.
const SCENES_OF_DATA: [&str; 2] = ["bunny", "indoor"];
/// Triangles of a mesh in a quick run: enough for its shape.
const QUICK_TRIANGLES: u64 = 40_000;

/// A scene ready to be traced.
pub(super) struct TraceScene {
    pub name: String,
    /// Whether it is a scan, of splats.
    pub is_scan: bool,
    pub scene: Scene,
    pub lights: PreparedLights,
    pub camera: Camera,
    /// Hash of surfaces, camera and lights.
    pub content: Content,
    /// Triangles or splats.
    pub surfaces: usize,
    /// Building of the tree, milliseconds.
    pub build_ms: f64,
}

/// Surfaces, camera and lights before the tree is built.
pub(super) struct Parts {
    pub view: View,
    pub lights: Lights,
    pub origin: DVec3,
    pub content: Content,
}

/// Names of the scenes that are measured by default.
pub(super) fn defaults() -> Vec<String> {
    let more = std::env::var_os("ESKER_DATA").map_or(&[][..], |_| &SCENES_OF_DATA);
    SCENES.iter().chain(more).map(|&name| name.to_owned()).collect()
}

/// The folder of real scans.
pub(super) fn data() -> Result<PathBuf> {
    let folder = std::env::var_os("ESKER_DATA").map(PathBuf::from);
    folder.context("this scene needs a folder of real scans: set ESKER_DATA")
}

impl TraceScene {
    /// Makes the scene of this name for pictures of this size. A quick one has fewer surfaces.
    ///
    /// # Errors
    /// If there is no such scene, or its files cannot be read.
    pub fn new(name: &str, size: [u32; 2], is_quick: bool, task: &dyn Task) -> Result<Self> {
        task.phase(&format!("making {name}"), None, "surfaces");
        if let Some(model) = MODELS.iter().find(|model| model.name == name) {
            let triangles = if is_quick { QUICK_TRIANGLES } else { model.triangles };
            let mesh = model.make(triangles);
            return Ok(Self::of_mesh(name, &mesh, &model.view, model.lamps, size));
        }
        match name {
            "office" | "terrain" | "indoor" => scans::scene(name, size, is_quick, task),
            "bunny" => bunny(size, task),
            _ => {
                let known: Vec<_> = SCENES.iter().chain(&SCENES_OF_DATA).copied().collect();
                bail!("there is no scene `{name}`; scenes are {}", known.join(", "))
            }
        }
    }

    fn of_mesh(
        name: &str,
        mesh: &TriangleMesh,
        view: &Viewpoint,
        lamps: &[Lamp],
        [width, height]: [u32; 2],
    ) -> Self {
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
        Self { is_scan: false, ..parts.scene(name, scene, mesh.triangles.len(), build_ms) }
    }
}

impl Parts {
    /// The scene of these parts.
    pub fn scene(self, name: &str, scene: Scene, surfaces: usize, build_ms: f64) -> TraceScene {
        let Self { view, lights, origin, content } = self;
        TraceScene {
            name: name.to_owned(),
            is_scan: true,
            scene,
            lights: lights.prepare(origin),
            camera: Camera::new(&view, origin),
            content: content.add(&view).add(&lights),
            surfaces,
            build_ms,
        }
    }
}

/// The light of plain numbers.
pub(super) fn light(lamp: &Lamp) -> Light {
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
fn object(mesh: &TriangleMesh) -> Object {
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

/// The Stanford bunny as it is published, on the niche of the generated bust.
fn bunny(size: [u32; 2], task: &dyn Task) -> Result<TraceScene> {
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
    Ok(TraceScene::of_mesh("bunny", &mesh, &view, lamps, size))
}

/// Adds a floor and a red wall behind.
fn add_floor(mesh: &mut TriangleMesh) {
    let far = 3.0;
    let quads = [
        ([[-far, -far], [far, -far], [far, 1.0], [-far, 1.0]], [200, 196, 188], true),
        ([[-far, 0.0], [far, 0.0], [far, far], [-far, far]], [176, 62, 48], false),
    ];
    for (corners, colour, is_floor) in quads {
        let first = mesh.positions.len() as u32;
        for [a, b] in corners {
            mesh.positions.push(if is_floor { [a, b, 0.0] } else { [a, 1.0, b] });
            mesh.normals.push(if is_floor { [0.0, 0.0, 1.0] } else { [0.0, -1.0, 0.0] });
            mesh.colours.push(colour);
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;

    #[test]
    fn an_unknown_scene_is_refused_with_the_names_of_the_others() {
        let error = TraceScene::new("teapot", [8, 8], true, &Silent).err().unwrap().to_string();
        assert!(error.contains("bust, knot, hall, office, terrain"), "{error}");
    }

    #[test]
    fn cameras_of_generated_meshes_see_surfaces_in_most_pixels() {
        for model in &MODELS {
            let scene = TraceScene::new(model.name, [24, 18], true, &Silent).unwrap();
            let camera = &scene.camera;
            let sees = |i: usize| {
                let (x, y) = ((i % camera.width) as f32, (i / camera.width) as f32);
                scene.scene.hit(&camera.ray(x + 0.5, y + 0.5)).is_some()
            };
            let seen = (0..camera.pixels()).filter(|&i| sees(i)).count();
            assert!(seen * 10 > camera.pixels() * 6, "{}: {seen}", model.name);
        }
    }

    #[test]
    fn the_same_scene_has_the_same_content_and_another_size_another() {
        let content = |size| TraceScene::new("hall", size, true, &Silent).unwrap().content;
        assert_eq!(content([24, 18]), content([24, 18]));
        assert_ne!(content([24, 18]), content([18, 24]));
    }
}
