//! Rays against meshes and objects: all triangles one by one in `f64`, places, meshes that deform,
//! and meshes that are degenerate.

mod cloud;

use cloud::{Random, splat};
use esker_trace::scene::{Albedo, Material, Mesh, MeshTree, Object, Shape, SplatInput};
use esker_trace::{Ray, Scene};
use glam::{Affine3A, DVec3, Quat, Vec3};
use std::sync::Arc;

/// Triangles of all sizes in a cube.
fn soup(count: usize, largest: f32, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut positions = Vec::new();
    for _ in 0..count {
        let (at, size) = (random.vector(), largest * random.next() + 1e-3);
        positions.extend([at, at + random.unit() * size, at + random.unit() * size]);
    }
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh { positions, triangles, ..Default::default() }
}

/// A sphere of 2 n n triangles with smooth normals.
fn sphere(n: u32) -> Mesh {
    let place = |i: u32, j: u32| {
        let (a, b) = (i as f32 / n as f32 * std::f32::consts::TAU, j as f32 / n as f32);
        let (sin, cos) = (b * std::f32::consts::PI).sin_cos();
        Vec3::new(sin * a.cos(), sin * a.sin(), cos)
    };
    let mut mesh = Mesh::default();
    for j in 0..=n {
        mesh.positions.extend((0..=n).map(|i| place(i % n, j)));
    }
    for k in 0..n * n {
        let at = k / n * (n + 1) + k % n;
        mesh.triangles.extend([[at, at + n + 1, at + 1], [at + 1, at + n + 1, at + n + 2]]);
    }
    mesh.normals = mesh.positions.clone();
    mesh
}

fn object(mesh: Mesh, place: Affine3A) -> Object {
    Object { mesh: Arc::new(MeshTree::new(mesh)), place }
}

fn scene(objects: Vec<Object>) -> Scene {
    Scene::new(SplatInput::default()).with_objects(objects)
}

fn place() -> Affine3A {
    let turn = Quat::from_axis_angle(Vec3::new(1.0, 2.0, 3.0).normalize_or_zero(), 0.7);
    let scale = Vec3::new(1.5, 0.5, -2.0);
    Affine3A::from_scale_rotation_translation(scale, turn, Vec3::new(0.3, -0.2, 0.1))
}

/// Distance to the nearest triangle in `f64`, and its number; an error if `f32` may see another.
fn nearest(mesh: &Mesh, ray: &Ray) -> Result<Option<(f64, usize)>, ()> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut best = None;
    for (i, t) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = t.map(|k| mesh.positions[k as usize].as_dvec3());
        let n = (b - a).cross(c - a);
        let distance = (a - o).dot(n) / d.dot(n);
        let at = o + d * distance - a;
        let scale = 1.0 / n.length_squared();
        let (v, w) = (at.cross(c - a).dot(n) * scale, (b - a).cross(at).dot(n) * scale);
        let inside = v.min(w).min(1.0 - v - w);
        if inside.abs() < 1e-3 && distance > -1e-3 {
            return Err(());
        }
        if inside > 0.0 && distance > 0.0 && best.is_none_or(|(b, _)| distance < b) {
            best = Some((distance, i));
        }
    }
    Ok(best)
}

#[test]
fn trees_meet_what_all_triangles_one_by_one_meet() {
    for (count, largest) in [(1, 2.0), (9, 1.5), (300, 0.4), (3000, 0.15)] {
        let mesh = soup(count, largest, count as u64);
        let scene = scene(vec![object(mesh.clone(), Affine3A::IDENTITY)]);
        let (mut random, mut compared, mut hits) = (Random(3), 0, 0);
        for _ in 0..500 {
            let ray = random.ray();
            let Ok(expected) = nearest(&mesh, &ray) else { continue };
            compared += 1;
            let hit = scene.hit(&ray);
            assert_eq!(hit.is_some(), expected.is_some(), "{ray:?}");
            assert_eq!(scene.is_blocked(&ray), expected.is_some());
            let (Some(hit), Some((distance, index))) = (hit, expected) else { continue };
            hits += 1;
            assert!((f64::from(hit.distance) - distance).abs() < 1e-4);
            let [a, b, c] = mesh.triangles[index].map(|k| mesh.positions[k as usize].as_dvec3());
            let n = (b - a).cross(c - a).normalize_or_zero();
            let turned = n * -n.dot(ray.direction.as_dvec3()).signum();
            assert!((hit.normal.as_dvec3() - turned).length() < 1e-3);
            assert_eq!(hit.is_back, n.dot(ray.direction.as_dvec3()) > 0.0);
        }
        assert!(compared > 350 && (hits > 20 || count == 1), "{count}: {compared} {hits}");
    }
}

#[test]
fn a_moved_object_is_met_as_a_mesh_moved_beforehand() {
    let (mesh, place) = (soup(400, 0.5, 9), place());
    let mut moved = mesh.clone();
    moved.positions.iter_mut().for_each(|p| *p = place.transform_point3(*p));
    let (a, b) = (scene(vec![object(mesh, place)]), scene(vec![object(moved, Affine3A::IDENTITY)]));
    let (mut random, mut hits) = (Random(10), 0);
    for _ in 0..1000 {
        let ray = random.ray();
        let (Some(x), Some(y)) = (a.hit(&ray), b.hit(&ray)) else { continue };
        if (x.distance - y.distance).abs() < 1e-4 {
            hits += 1;
            assert!((x.normal - y.normal).length() < 1e-2);
            // The place mirrors, so the winding is turned in the moved mesh only.
            assert_ne!(x.is_back, y.is_back);
        }
    }
    assert!(hits > 150, "{hits}");
}

#[test]
fn many_objects_are_met_as_one_mesh() {
    let ball = Arc::new(MeshTree::new(sphere(12)));
    let at = |i: usize| Vec3::new((i % 5) as f32, (i / 5 % 5) as f32, (i / 25) as f32) * 0.5 - 1.0;
    let place = |i: usize| {
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.2), Quat::IDENTITY, at(i))
    };
    let objects = (0..100).map(|i| Object { mesh: ball.clone(), place: place(i) }).collect();
    let mut joined = Mesh::default();
    for i in 0..100 {
        let first = joined.positions.len() as u32;
        joined
            .positions
            .extend(ball.mesh().positions.iter().map(|&p| place(i).transform_point3(p)));
        joined.normals.extend(&ball.mesh().normals);
        joined.triangles.extend(ball.mesh().triangles.iter().map(|t| t.map(|c| c + first)));
    }
    let (a, b) = (scene(objects), scene(vec![object(joined, Affine3A::IDENTITY)]));
    let (mut random, mut differ) = (Random(6), 0);
    for _ in 0..2000 {
        let ray = random.ray();
        let (x, y) = (a.hit(&ray).map(|h| h.distance), b.hit(&ray).map(|h| h.distance));
        let is_same =
            x.is_some() == y.is_some() && x.zip(y).is_none_or(|(x, y)| (x - y).abs() < 1e-4);
        differ += u32::from(!is_same);
    }
    assert!(differ <= 2, "{differ}");
}

#[test]
fn a_refitted_mesh_is_met_as_one_built_anew() {
    let mesh = sphere(40);
    let bend = |p: &Vec3| Vec3::new(p.x + 0.4 * (3.0 * p.z).sin(), p.y * 1.3, p.z - 0.2 * p.x);
    let positions: Vec<Vec3> = mesh.positions.iter().map(bend).collect();
    let bent = Mesh { positions: positions.clone(), normals: Vec::new(), ..mesh.clone() };
    let mut refitted = scene(vec![object(mesh, Affine3A::IDENTITY)]);
    refitted.refit(0, positions, Vec::new());
    let anew = scene(vec![object(bent, Affine3A::IDENTITY)]);
    assert!((refitted.bounds().max - anew.bounds().max).abs().max_element() < 1e-6);
    let (mut random, mut hits) = (Random(12), 0);
    for _ in 0..2000 {
        let ray = random.ray();
        let (a, b) = (refitted.hit(&ray), anew.hit(&ray));
        assert_eq!(a.map(|h| h.distance), b.map(|h| h.distance));
        hits += u32::from(a.is_some());
    }
    assert!(hits > 300, "{hits}");
}

#[test]
fn no_ray_leaves_a_closed_mesh_or_meets_it_again() {
    let mesh = sphere(60);
    let scene = scene(vec![object(mesh, Affine3A::IDENTITY)]);
    let mut random = Random(14);
    for _ in 0..20_000 {
        let ray = Ray::new(random.vector() * 0.4, random.unit());
        let hit = scene.hit(&ray).expect("the sphere is closed");
        assert!(hit.is_back && (hit.normal + ray.at(hit.distance)).length() < 0.02);
        // Outside nothing is left to meet.
        let out = ray.at(hit.distance) - hit.normal * hit.lift;
        assert!(!scene.is_blocked(&Ray::new(out, -hit.normal)));
    }
}

#[test]
fn splats_and_meshes_hide_each_other() {
    let splats = [splat(Vec3::ZERO, Vec3::Z, 1.0, 0)];
    let sheet = |z: f32| Mesh {
        positions: vec![Vec3::new(-9.0, -9.0, z), Vec3::new(9.0, -9.0, z), Vec3::new(0.0, 9.0, z)],
        triangles: vec![[0, 1, 2]],
        colours: vec![Vec3::X, Vec3::X, Vec3::X],
        material: Material { emission: Vec3::ONE, ..Default::default() },
        ..Default::default()
    };
    let ray = Ray::new(Vec3::new(0.1, 0.1, 3.0), Vec3::NEG_Z);
    for (z, is_splat, distance) in [(0.5, false, 2.5), (-0.5, true, 3.0), (0.001, false, 2.999)] {
        let input = SplatInput { splats: &splats, albedo: Albedo::AsIs, ..Default::default() };
        let scene = Scene::new(input).with_objects(vec![object(sheet(z), Affine3A::IDENTITY)]);
        let hit = scene.hit(&ray).unwrap();
        assert_eq!(hit.is_splat(), is_splat);
        assert!((hit.distance - distance).abs() < 1e-5);
        assert_eq!(hit.emission, if is_splat { Vec3::ZERO } else { Vec3::ONE });
        assert!(is_splat || hit.albedo == Vec3::X);
    }
}

/// A square of this half width in the plane through `at` along `u` and `v`.
fn square(at: Vec3, u: Vec3, v: Vec3) -> Mesh {
    let positions = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let positions = positions.map(|[a, b]| at + u * a + v * b).into();
    Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Default::default() }
}

#[test]
fn rays_start_on_their_side_of_a_body_that_touches_the_surface() {
    // A board that leans over the floor from its edge at x = 5 on, seen just above that edge.
    let at = Vec3::new(5.0, 3.0, 0.0);
    let floor = square(at, Vec3::X * 9.0, Vec3::Y * 9.0);
    let board = square(at + Vec3::new(1.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0), Vec3::Y * 2.0);
    let scene = scene(vec![object(floor, Affine3A::IDENTITY), object(board, Affine3A::IDENTITY)]);
    let mut bounded = 0;
    for i in 1..200 {
        let height = 1e-6 * 1.07_f32.powi(i % 80) * (1.0 + i as f32 * 1e-3);
        let ray = Ray::new(Vec3::new(9.0, 3.1, height), Vec3::NEG_X);
        let hit = scene.hit(&ray).unwrap();
        let start = ray.at(hit.distance) + hit.normal * hit.lift;
        assert!(hit.normal.z < -0.7 && hit.lift > 0.0);
        // Within some roundings of the place the side is not known.
        if height > 4e-6 {
            assert!(start.z > 0.0, "{height}: {start}, {hit:?}");
        }
        bounded += usize::from(hit.lift < 4e-5);
    }
    assert!(bounded > 100, "{bounded} lifts are bounded");
    // Far from the edge the lift is the one of a lone surface.
    let ray = Ray::new(Vec3::new(9.0, 3.1, 1.0), Vec3::NEG_X);
    assert!((scene.hit(&ray).unwrap().lift - 6e-5).abs() < 1e-6);
}

#[test]
fn rays_from_splats_start_before_a_mesh_that_stands_on_them() {
    let mut splats = Vec::new();
    for i in 0..400 {
        let at = Vec3::new((i % 20) as f32 * 0.1, (i / 20) as f32 * 0.1, 0.0);
        splats.push(splat(at, Vec3::Z, 0.1, i));
    }
    let lid = square(Vec3::new(1.0, 1.0, 0.05), Vec3::X, Vec3::Y);
    let input = SplatInput { splats: &splats, albedo: Albedo::AsIs, ..Default::default() };
    let scene = Scene::new(input).with_objects(vec![object(lid, Affine3A::IDENTITY)]);
    let ray = Ray::new(Vec3::new(1.02, 1.01, 0.02), Vec3::NEG_Z);
    let hit = scene.hit(&ray).unwrap();
    assert!(hit.is_splat() && hit.lift > 0.0 && hit.lift < 0.05, "{hit:?}");
}

#[test]
fn emitting_triangles_are_listed_at_their_places() {
    let mesh =
        Mesh { material: Material { emission: Vec3::X, ..Default::default() }, ..sphere(20) };
    let scale = Affine3A::from_scale(Vec3::splat(3.0));
    let scene = scene(vec![object(mesh, scale)]);
    let area: f64 = scene.area_lights().iter().map(|l| f64::from(l.area)).sum();
    let exact = 4.0 * std::f64::consts::PI * 9.0;
    assert!((area / exact - 1.0).abs() < 0.03, "{area} {exact}");
    let mut random = Random(15);
    for light in scene.area_lights() {
        let p = light.point([random.next(), random.next()], Vec3::ZERO);
        assert!(matches!(light.shape, Shape::Triangle(_)) && (p.length() - 3.0).abs() < 0.1);
        assert!(light.normal(Vec3::ZERO).dot(p.normalize_or_zero()).abs() > 0.97);
    }
}

#[test]
fn degenerate_meshes_and_places_are_left_out() {
    let mut mesh = soup(20, 1.0, 2);
    let good = mesh.clone();
    mesh.positions.extend([Vec3::NAN, Vec3::INFINITY]);
    mesh.triangles.extend([[0, 0, 1], [0, 1, 60], [61, 2, 3], [0, 1, 900]]);
    let tree = MeshTree::new(mesh);
    assert_eq!(tree.mesh().triangles.len(), 20);
    let flat = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let broken = Affine3A::from_translation(Vec3::NAN);
    let tree = Arc::new(tree);
    let objects =
        [Affine3A::IDENTITY, flat, broken].map(|place| Object { mesh: tree.clone(), place });
    let (a, b) = (scene(objects.to_vec()), scene(vec![object(good, Affine3A::IDENTITY)]));
    assert_eq!(a.bounds(), b.bounds());
    let empty = scene(vec![object(Mesh::default(), Affine3A::IDENTITY)]);
    let mut random = Random(16);
    for _ in 0..300 {
        let ray = random.ray();
        assert_eq!(a.hit(&ray).map(|h| h.distance), b.hit(&ray).map(|h| h.distance));
        assert!(empty.hit(&ray).is_none() && !empty.is_blocked(&ray));
    }
    assert_eq!(DVec3::ZERO, a.bounds().min.as_dvec3() * 0.0);
}
