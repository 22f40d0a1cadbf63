//! A scene that moves, as those of `bauszat2011`: a lamp, an object that keeps its tree, and a mesh
//! that deforms, whose tree is fitted to it. Each picture is compared with that of a tree built
//! anew.

use super::picture::Tile;
use super::quads::{add_quad, sphere};
use super::report::MovingRow;
use anyhow::Result;
use esker_lod::View;
use esker_points::Task;
use esker_scan::mesh::TriangleMesh;
use esker_trace::scene::{Material, Mesh, MeshTree, Object};
use esker_trace::{Camera, Light, Lights, LitImage, Options, PreparedLights, Scene, Tracer};
use glam::{Affine3A, DVec3, Vec3};
use std::f32::consts::TAU;
use std::sync::Arc;
use std::time::Instant;

/// Pictures of the sequence.
const PICTURES: usize = 4;
/// Rings of the mesh that deforms: 80 thousand triangles. The ball has fewer.
const RINGS: u32 = 140;
const BALL_RINGS: u32 = 60;
/// Bounces and samples of a pixel.
const BOUNCES: u32 = 2;
const SAMPLES: u32 = 4;
/// Number of the mesh that deforms among the objects.
const DEFORMED: usize = 2;

/// Draws the sequence; the pictures stand side by side.
///
/// # Errors
/// If `task` is cancelled.
pub(super) fn measure(size: [u32; 2], task: &dyn Task) -> Result<(Vec<MovingRow>, Tile)> {
    let (directions, triangles) = sphere(RINGS);
    let deformed = |time| places(&directions, time);
    let drop = mesh_of(deformed(0.0), triangles.clone(), [0.75, 0.55, 0.2]);
    let (ball, ball_triangles) = sphere(BALL_RINGS);
    let ball = ball.iter().map(|d| *d * 0.28).collect();
    let ball = Arc::new(MeshTree::new(mesh_of(ball, ball_triangles, [0.25, 0.4, 0.75])));
    let stage = super::meshes::object(&stage());
    let objects = |ball_at, drop: &Arc<MeshTree>| {
        let place = Affine3A::from_translation;
        vec![
            stage.clone(),
            Object { mesh: ball.clone(), place: place(ball_at) },
            Object { mesh: drop.clone(), place: place(Vec3::new(0.35, 0.2, 0.62)) },
        ]
    };
    let drop = Arc::new(MeshTree::new(drop));
    let mut scene = Scene::default().with_objects(objects(ball_place(0.0), &drop));
    let camera = camera(size);
    let (mut rows, mut tiles) = (Vec::new(), Vec::new());
    for number in 0..PICTURES {
        task.phase("moving scene", None, "pictures");
        let time = number as f32 / PICTURES as f32;
        let lights = lights(time);
        let (positions, normals) = (deformed(time), Vec::new());
        let (refit_ms, ()) = timed(|| scene.refit(DEFORMED, positions, normals));
        let fitted = scene.objects()[DEFORMED].mesh.clone();
        let moved = objects(ball_place(time), &fitted);
        let (move_ms, ()) = timed(|| scene.set_objects(moved));
        let (trace_ms, picture) = timed(|| draw(&scene, &lights, &camera));
        let (rebuild_ms, anew) = timed(|| {
            let mesh = mesh_of(deformed(time), triangles.clone(), [0.75, 0.55, 0.2]);
            Arc::new(MeshTree::new(mesh))
        });
        let rebuilt = Scene::default().with_objects(objects(ball_place(time), &anew));
        let (rebuilt_trace_ms, expected) = timed(|| draw(&rebuilt, &lights, &camera));
        task.check()?;
        let equal = equal(&picture, &expected);
        tiles.push(Tile::of_light(&picture.radiance, 1.0));
        rows.push(MovingRow { move_ms, refit_ms, rebuild_ms, trace_ms, rebuilt_trace_ms, equal });
    }
    Ok((rows, Tile::beside(&tiles)))
}

fn timed<T>(run: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let value = run();
    (start.elapsed().as_secs_f64() * 1e3, value)
}

/// Share of the pixels of equal colour.
fn equal(a: &LitImage, b: &LitImage) -> f64 {
    let is_equal = |i: &usize| (0..3).all(|c| a.radiance.planes[c][*i] == b.radiance.planes[c][*i]);
    let count = a.radiance.len();
    (0..count).filter(is_equal).count() as f64 / count.max(1) as f64
}

fn draw(scene: &Scene, lights: &PreparedLights, camera: &Camera) -> LitImage {
    let options = Options { bounces: BOUNCES, reprojects: false, ..Options::default() };
    let mut tracer = Tracer::new(options);
    tracer.trace(scene, 0, lights, camera, SAMPLES, &|| false);
    tracer.resolve()
}

/// Places of the mesh that deforms: a sphere with waves that run down.
fn places(directions: &[Vec3], time: f32) -> Vec<Vec3> {
    let place = |d: &Vec3| {
        let wave = (9.0 * d.z + TAU * time).sin() + (5.0 * d.x - 4.0 * d.y + TAU * time).sin();
        *d * (0.4 + 0.07 * wave)
    };
    directions.iter().map(place).collect()
}

fn ball_place(time: f32) -> Vec3 {
    Vec3::new(-1.0 + 1.3 * time, -0.75, 0.28)
}

fn mesh_of(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, albedo: [f32; 3]) -> Mesh {
    let material = Material { albedo: albedo.into(), ..Material::default() };
    Mesh { positions, triangles, material, ..Mesh::default() }
}

/// A floor before two coloured walls.
fn stage() -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let (x, y, z) = (1.6, 1.2, 2.2);
    let corners = |c: [[f64; 3]; 4]| c.map(|[a, b, c]| [a * x, b * y, c * z]);
    let floor = [[-1.0, -2.0, 0.0], [1.0, -2.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let back = [[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]];
    let left = [[-1.0, -2.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 1.0, 1.0], [-1.0, -2.0, 1.0]];
    let right = [[1.0, 1.0, 0.0], [1.0, -2.0, 0.0], [1.0, -2.0, 1.0], [1.0, 1.0, 1.0]];
    add_quad(&mut mesh, corners(floor), [205, 200, 192]);
    add_quad(&mut mesh, corners(back), [205, 200, 192]);
    add_quad(&mut mesh, corners(left), [186, 60, 48]);
    add_quad(&mut mesh, corners(right), [64, 140, 70]);
    mesh
}

fn camera([width, height]: [u32; 2]) -> Camera {
    let (eye, target) = (DVec3::new(0.0, -4.6, 1.3), DVec3::new(0.0, 0.0, 0.75));
    let view = View::look_at(eye, target, DVec3::Z, 36f64.to_radians(), width, height);
    Camera::new(&view, DVec3::ZERO)
}

/// A lamp that goes around above the stage.
fn lights(time: f32) -> PreparedLights {
    let (sin, cos) = (f64::from(time) * std::f64::consts::TAU).sin_cos();
    let corner = [0.9 * cos - 0.15, -0.4 + 0.6 * sin, 2.0];
    let edges = [[0.0, 0.3, 0.0], [0.3, 0.0, 0.0]];
    let lamp = Light::Area { corner, edges, radiance: [70.0, 64.0, 55.0], two_sided: false };
    Lights { lights: vec![lamp], ..Lights::default() }.prepare(DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;

    #[test]
    fn fitted_trees_give_the_pictures_of_trees_built_anew() {
        let (rows, _) = measure([40, 30], &Silent).unwrap();
        assert_eq!(rows.len(), PICTURES);
        // Rays through a common edge can meet either triangle.
        assert!(rows.iter().all(|row| row.equal > 0.99), "{rows:?}");
    }
}
