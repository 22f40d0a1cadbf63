//! Rates of rays on generated clouds of discs: an office, a terrain and a cluster of spheres. Prints
//! JSON, one row a scene and tree: millions of rays a CPU second on one thread for primary, bounce
//! and shadow rays, blended and first hits, for the implicit tree, the refined one, and `obvhs`'
//! own binary tree over the same discs; times of building; bytes a splat.
//!
//! `cargo run --release -p esker-trace --example rays [SPLATS [SCENE]]`

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
use std::f32::consts::PI;
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
    bounce_first: f64,
    bounce_blended: f64,
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
    let clouds: [(&str, fn(&mut Random, usize) -> Cloud); 3] =
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
        primary_blended: rate(&rays.primary, |r| trace.hit(r).map_or(0.0, |h| h.normal.x)),
        bounce_first: rate(&rays.bounce, |r| trace.first(r).map_or(0.0, |h| h.distance)),
        bounce_blended: rate(&rays.bounce, |r| trace.hit(r).map_or(0.0, |h| h.normal.x)),
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
        bounce_first: rate(&rays.bounce, nearest),
        bounce_blended: f64::NAN,
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
    let forward = (cloud.target - cloud.eye).normalize();
    let right = forward.cross(Vec3::Z).normalize();
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
            Ray::new(cloud.eye, direction.normalize())
        })
        .collect();
    let (mut bounce, mut shadow) = (Vec::new(), Vec::new());
    for ray in &primary {
        let Some(hit) = trace.hit(ray) else { continue };
        let start = hit.start(ray);
        bounce.push(Ray::new(start, (hit.normal + random.unit() * 0.999).normalize()));
        let to = cloud.lamp + random.unit() * cloud.lamp_radius - start;
        shadow.push(Ray { reach: to.length(), ..Ray::new(start, to.normalize()) });
    }
    Rays { primary, bounce, shadow }
}

/// Splats and where they are seen from.
struct Cloud {
    splats: Vec<Splat>,
    eye: Vec3,
    target: Vec3,
    lamp: Vec3,
    lamp_radius: f32,
}

/// A rectangle: corner and two edges.
type Side = (Vec3, Vec3, Vec3);

/// Sides of a box.
fn sides(min: Vec3, max: Vec3) -> Vec<Side> {
    let s = max - min;
    let [x, y, z] = [Vec3::X * s.x, Vec3::Y * s.y, Vec3::Z * s.z];
    vec![(min, x, y), (min, y, z), (min, z, x), (max, -y, -x), (max, -z, -y), (max, -x, -z)]
}

/// A room with desks, cabinets, lamps and a hundred small things.
fn office(random: &mut Random, count: usize) -> Cloud {
    let mut all = sides(Vec3::ZERO, Vec3::new(12.0, 8.0, 3.0));
    for i in 0..12 {
        let at = Vec3::new(1.0 + (i % 4) as f32 * 2.8, 1.0 + (i / 4) as f32 * 2.3, 0.0);
        let top = at + Vec3::Z * 0.72;
        all.extend(sides(top, top + Vec3::new(1.6, 0.8, 0.03)));
        for leg in [[0.0, 0.0], [1.55, 0.0], [0.0, 0.75], [1.55, 0.75]] {
            let foot = at + Vec3::new(leg[0], leg[1], 0.0);
            all.extend(sides(foot, foot + Vec3::new(0.05, 0.05, 0.72)));
        }
        for _ in 0..8 {
            let thing = top + Vec3::new(random.next() * 1.4, random.next() * 0.6, 0.03);
            let size = Vec3::new(random.next(), random.next(), random.next()) * 0.25 + 0.03;
            all.extend(sides(thing, thing + size));
        }
        all.extend(sides(at + Vec3::X * 1.8, at + Vec3::new(2.3, 0.6, 1.6)));
    }
    let area = |s: &Side| s.1.cross(s.2).length();
    let total: f32 = all.iter().map(area).sum();
    let spacing = (total / count as f32).sqrt();
    let mut splats = Vec::with_capacity(count);
    for side in &all {
        let n = (area(side) / total * count as f32).round() as usize;
        for _ in 0..n {
            let at = side.0 + side.1 * random.next() + side.2 * random.next();
            splats.push(random.splat(at, side.1.cross(side.2).normalize(), spacing));
        }
    }
    let (eye, target) = (Vec3::new(0.5, 0.5, 1.7), Vec3::new(8.0, 5.5, 0.8));
    Cloud { splats, eye, target, lamp: Vec3::new(6.0, 4.0, 2.8), lamp_radius: 0.4 }
}

/// Hills of 1 km with noise, seen from above.
fn terrain(random: &mut Random, count: usize) -> Cloud {
    let spacing = 1000.0 / (count as f32).sqrt();
    let height = |x: f32, y: f32| {
        (1..7)
            .map(|k| {
                let f = 0.004 * (1 << k) as f32;
                let (a, b) = ((x * f + k as f32).sin(), (y * f * 1.1 - k as f32).cos());
                a * b * 60.0 / (1 << k) as f32
            })
            .sum::<f32>()
    };
    let splats = (0..count).map(|_| {
        let (x, y) = (random.next() * 1000.0, random.next() * 1000.0);
        let slope = |dx: f32, dy: f32| height(x + dx, y + dy) - height(x - dx, y - dy);
        let normal = Vec3::new(-slope(0.5, 0.0), -slope(0.0, 0.5), 1.0).normalize();
        random.splat(Vec3::new(x, y, height(x, y)), normal, spacing)
    });
    let splats = splats.collect();
    let (eye, target) = (Vec3::new(-100.0, 200.0, 150.0), Vec3::new(500.0, 500.0, 0.0));
    Cloud { splats, eye, target, lamp: Vec3::new(2e4, 1e4, 1e4), lamp_radius: 100.0 }
}

/// Two hundred spheres that overlap, on a plane.
fn spheres(random: &mut Random, count: usize) -> Cloud {
    let all: Vec<(Vec3, f32)> = (0..200)
        .map(|_| {
            let at = random.unit() * random.next().sqrt() * 4.0;
            (Vec3::new(at.x, at.y, at.z.abs()), 0.2 + 0.5 * random.next())
        })
        .collect();
    let area: f32 = all.iter().map(|s| 4.0 * PI * s.1 * s.1).sum::<f32>() + 400.0;
    let spacing = (area / count as f32).sqrt();
    let mut splats = Vec::with_capacity(count);
    for &(centre, radius) in &all {
        let n = (4.0 * PI * radius * radius / area * count as f32) as usize;
        for _ in 0..n {
            let normal = random.unit();
            splats.push(random.splat(centre + normal * radius, normal, spacing));
        }
    }
    while splats.len() < count {
        let at = Vec3::new(random.next() - 0.5, random.next() - 0.5, 0.0) * 20.0;
        splats.push(random.splat(at, Vec3::Z, spacing));
    }
    let (eye, target) = (Vec3::new(9.0, 2.0, 5.0), Vec3::new(0.0, 0.0, 1.0));
    Cloud { splats, eye, target, lamp: Vec3::new(3.0, 3.0, 9.0), lamp_radius: 0.5 }
}

/// A generator of random numbers (`splitmix64`).
struct Random(u64);

impl Random {
    /// A number in 0 to 1.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1 << 24) as f32
    }

    /// A unit vector.
    fn unit(&mut self) -> Vec3 {
        let (z, turn) = (self.next() * 2.0 - 1.0, self.next() * 2.0 * PI);
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * turn.cos(), r * turn.sin(), z)
    }

    /// A splat of a scanned surface: off by a tenth of the spacing, its normal by some degrees.
    fn splat(&mut self, at: Vec3, normal: Vec3, spacing: f32) -> Splat {
        Splat {
            centre: (at + normal * (self.next() - 0.5) * 0.2 * spacing).to_array(),
            radius: spacing,
            normal: (normal + self.unit() * 0.1).normalize().to_array(),
            colour: [0.5; 3],
            draw: 0,
            index: 0,
        }
    }
}
