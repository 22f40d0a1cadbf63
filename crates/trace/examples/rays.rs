//! Rates of rays on generated clouds of discs: an office, a terrain and a cluster of spheres.
//! Prints JSON, one row a scene and tree: millions of rays a CPU second on one thread for primary,
//! bounce and shadow rays, as first hits, blended, and blended with a bounded lift; for the
//! implicit tree, the refined one, and the binary tree of `obvhs` over the same discs; times of
//! building; bytes a splat.
//!
//! `cargo run --release -p esker-trace --example rays [SPLATS [SCENE]]`

mod clouds;

use clouds::{Cloud, Make, Random, office, spheres, terrain};
use esker_render::Splat;
use esker_trace::scene::{Albedo, RADIUS_FACTOR, SplatInput};
use esker_trace::{Ray, Scene};
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::ray::RayHit;
use obvhs::{BvhBuildParams, ray::Ray as ObvhsRay};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Pixels of the picture that rays are made for.
const SIZE: [usize; 2] = [512, 384];
/// Times that each measurement is taken; the best counts.
const REPEATS: usize = 3;

/// One row of the result: rates in millions a CPU second.
#[derive(Serialize)]
struct Row {
    scene: &'static str,
    tree: &'static str,
    splats: usize,
    primary_first: f64,
    primary_blended: f64,
    primary_lifted: f64,
    bounce_first: f64,
    bounce_blended: f64,
    bounce_lifted: f64,
    shadow: f64,
    build_cpu_ms: f64,
    build_wall_ms: f64,
    bytes_a_splat: f64,
}

/// Rays of one scene.
struct Rays {
    primary: Vec<Ray>,
    bounce: Vec<Ray>,
    shadow: Vec<Ray>,
}

fn main() {
    let count = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(1_000_000);
    let only = std::env::args().nth(2);
    let mut rows = Vec::new();
    let clouds: [(&str, Make); 3] =
        [("office", office), ("terrain", terrain), ("spheres", spheres)];
    let is_wanted = |name: &str| only.as_ref().is_none_or(|only| only == name);
    for (name, make) in clouds.into_iter().filter(|c| is_wanted(c.0)) {
        let cloud = make(&mut Random(1), count);
        rows.extend(measure(name, &cloud));
    }
    println!("{}", serde_json::json!({ "rows": rows }));
}

fn measure(scene: &'static str, cloud: &Cloud) -> Vec<Row> {
    let input = SplatInput { splats: &cloud.splats, albedo: Albedo::AsIs, ..Default::default() };
    let mut trace = Scene::new(input);
    let rays = rays(&trace, cloud);
    let splats = trace.splats();
    let row = |trace: &Scene, tree, build: [f64; 2]| Row {
        scene,
        tree,
        splats,
        primary_first: rate(&rays.primary, |r| trace.first(r).map_or(0.0, |h| h.distance)),
        primary_blended: rate(&rays.primary, |r| trace.blended(r).map_or(0.0, |h| h.normal.x)),
        primary_lifted: rate(&rays.primary, |r| trace.hit(r).map_or(0.0, |h| h.lift)),
        bounce_first: rate(&rays.bounce, |r| trace.first(r).map_or(0.0, |h| h.distance)),
        bounce_blended: rate(&rays.bounce, |r| trace.blended(r).map_or(0.0, |h| h.normal.x)),
        bounce_lifted: rate(&rays.bounce, |r| trace.hit(r).map_or(0.0, |h| h.lift)),
        shadow: rate(&rays.shadow, |r| f32::from(u8::from(trace.is_blocked(r)))),
        build_cpu_ms: build[0],
        build_wall_ms: build[1],
        bytes_a_splat: trace.bytes() as f64 / splats as f64,
    };
    let built = build_ms(|| drop(black_box(Scene::new(input))));
    let implicit = row(&trace, "implicit", built);
    let refined_ms = build_ms(|| {
        let mut trace = Scene::new(input);
        black_box(trace.refine());
    });
    trace.refine();
    let refined = row(&trace, "refined", [0, 1].map(|k| refined_ms[k] - built[k]));
    vec![implicit, refined, obvhs_row(scene, cloud, &rays)]
}

/// The row of `obvhs`: nearest hits only.
fn obvhs_row(scene: &'static str, cloud: &Cloud, rays: &Rays) -> Row {
    let boxes: Vec<Aabb> = cloud.splats.iter().map(bounds).collect();
    let build = build_ms(|| drop(black_box(binary(&boxes))));
    let tree = binary(&boxes);
    let discs: Vec<&Splat> =
        tree.primitive_indices.iter().map(|&i| &cloud.splats[i as usize]).collect();
    let nearest = |ray: &Ray| {
        let mut hit = RayHit::none();
        let own = ObvhsRay::new(ray.origin.into(), ray.direction.into(), 0.0, ray.reach);
        tree.ray_traverse(own, &mut hit, |_, i| meet(discs[i], ray));
        if hit.t.is_finite() { hit.t } else { 0.0 }
    };
    let any = |ray: &Ray| {
        let own = ObvhsRay::new(ray.origin.into(), ray.direction.into(), 0.0, ray.reach);
        f32::from(u8::from(!tree.ray_traverse_miss(own, |_, i| meet(discs[i], ray))))
    };
    let bytes = tree.nodes.len() * size_of_val(&tree.nodes[0]) + cloud.splats.len() * (28 + 4);
    Row {
        scene,
        tree: "obvhs Bvh2",
        splats: cloud.splats.len(),
        primary_first: rate(&rays.primary, nearest),
        primary_blended: f64::NAN,
        primary_lifted: f64::NAN,
        bounce_first: rate(&rays.bounce, nearest),
        bounce_blended: f64::NAN,
        bounce_lifted: f64::NAN,
        shadow: rate(&rays.shadow, any),
        build_cpu_ms: build[0],
        build_wall_ms: build[1],
        bytes_a_splat: bytes as f64 / cloud.splats.len() as f64,
    }
}

fn binary(boxes: &[Aabb]) -> Bvh2 {
    let how = BvhBuildParams::fast_build();
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        how.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        how.sort_precision,
        how.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut tree, how.reinsertion_batch_ratio, None);
    collapse(&mut tree, how.max_prims_per_leaf, how.collapse_traversal_cost);
    tree
}

fn bounds(splat: &Splat) -> Aabb {
    let (centre, n) = (Vec3A::from(splat.centre), Vec3A::from(splat.normal));
    let half = (1.0 - n * n).max(Vec3A::ZERO).map(f32::sqrt) * splat.radius * RADIUS_FACTOR;
    Aabb::new(centre - half, centre + half)
}

fn meet(splat: &Splat, ray: &Ray) -> f32 {
    let (n, radius) = (Vec3::from(splat.normal), splat.radius * RADIUS_FACTOR);
    let to = Vec3::from(splat.centre) - ray.origin;
    let t = n.dot(to) / n.dot(ray.direction);
    let off = (ray.direction * t - to).length_squared();
    if t > 0.0 && off < radius * radius { t } else { f32::INFINITY }
}

/// Millions of rays a CPU second, the best of some runs.
fn rate(rays: &[Ray], trace: impl Fn(&Ray) -> f32) -> f64 {
    let seconds = (0..REPEATS).map(|_| {
        let start = cpu_seconds();
        black_box(rays.iter().map(&trace).sum::<f32>());
        cpu_seconds() - start
    });
    rays.len() as f64 / seconds.fold(f64::INFINITY, f64::min) / 1e6
}

/// Milliseconds that `build` takes: of one CPU, and by the clock on all threads; the least of some.
fn build_ms(build: impl Fn() + Sync) -> [f64; 2] {
    let least =
        |times: &dyn Fn() -> f64| (0..REPEATS).map(|_| times()).fold(f64::INFINITY, f64::min) * 1e3;
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let cpu = least(&|| {
        alone.install(|| {
            let start = cpu_seconds();
            build();
            cpu_seconds() - start
        })
    });
    let wall = least(&|| {
        let start = Instant::now();
        build();
        start.elapsed().as_secs_f64()
    });
    [cpu, wall]
}

/// CPU time of this thread; the clock where the system does not say.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split(' ').next().and_then(|n| n.parse::<f64>().ok());
    nanoseconds.map_or_else(
        || std::time::UNIX_EPOCH.elapsed().map_or(0.0, |d| d.as_secs_f64()),
        |ns| ns * 1e-9,
    )
}

/// Rays from the camera, rays from where these hit in directions of the cosine law, and rays from
/// there to the lamp.
fn rays(trace: &Scene, cloud: &Cloud) -> Rays {
    let mut random = Random(7);
    let forward = (cloud.target - cloud.eye).normalize_or_zero();
    let right = forward.cross(Vec3::Z).normalize_or_zero();
    let up = right.cross(forward);
    let [width, height] = SIZE;
    let tile = 8;
    let primary: Vec<Ray> = (0..width * height)
        .map(|i| {
            // Rays of a square of pixels follow each other, as in the renderer.
            let (t, p) = (i / (tile * tile), i % (tile * tile));
            let x = (t % (width / tile)) * tile + p % tile;
            let y = (t / (width / tile)) * tile + p / tile;
            let [x, y] = [(x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32];
            let direction = forward + right * (x - 0.5) * 1.2 - up * (y - 0.5) * 0.9;
            Ray::new(cloud.eye, direction.normalize_or_zero())
        })
        .collect();
    let (mut bounce, mut shadow) = (Vec::new(), Vec::new());
    for ray in &primary {
        let Some(hit) = trace.hit(ray) else { continue };
        let start = hit.start(ray);
        bounce.push(Ray::new(start, (hit.normal + random.unit() * 0.999).normalize_or_zero()));
        let to = cloud.lamp + random.unit() * cloud.lamp_radius - start;
        shadow.push(Ray { reach: to.length(), ..Ray::new(start, to.normalize_or_zero()) });
    }
    Rays { primary, bounce, shadow }
}
