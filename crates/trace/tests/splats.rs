//! Rays against splats: the trees against all discs one by one in `f64`, closed surfaces, thin
//! walls, and clouds that are degenerate.

mod cloud;
#[path = "cloud/discs.rs"]
mod discs;

use cloud::{Random, splat};
use discs::{all_met, soup, sphere};
use esker_render::Splat;
use esker_trace::accel::Kind;
use esker_trace::scene::{
    Albedo, Emitter, Members, RADIUS_FACTOR, Shape, SplatInput, adopt_normals,
};
use esker_trace::{Ray, Scene};
use glam::{DVec3, Vec3};

fn scene(splats: &[Splat]) -> Scene {
    Scene::new(SplatInput { splats, albedo: Albedo::AsIs, ..Default::default() })
}

fn refined(splats: &[Splat]) -> Scene {
    let mut scene = scene(splats);
    assert!(scene.refine());
    assert_eq!(scene.kind(), Kind::Refined);
    scene
}

/// Compares a scene with all discs one by one; most rays must be comparable, and some hit.
fn compare(splats: &[Splat], scene: &Scene, rays: usize) {
    let mut random = Random(99);
    let (mut compared, mut hits) = (0, 0);
    for _ in 0..rays {
        let ray = Ray { reach: 0.5 + 4.0 * random.next(), ..random.ray() };
        let Some(met) = all_met(splats, &ray) else { continue };
        compared += 1;
        let (first, hit) = (scene.first(&ray), scene.hit(&ray));
        assert_eq!(scene.is_blocked(&ray), !met.is_empty(), "{ray:?}");
        assert_eq!((first.is_some(), hit.is_some()), (!met.is_empty(), !met.is_empty()));
        let (Some(first), Some(hit)) = (first, hit) else { continue };
        hits += 1;
        assert!((f64::from(first.distance) - met[0].distance).abs() < 1e-4, "{ray:?}");
        assert_eq!(first.distance, hit.distance);
        assert_eq!(first.radius, splats[met[0].index].radius * RADIUS_FACTOR);
        let end = met.iter().map(|m| m.distance + 2.0 * m.radius).fold(f64::INFINITY, f64::min);
        if met.iter().any(|m| (m.distance - end).abs() < 1e-4) {
            continue;
        }
        let (mut normal, mut albedo, mut sum) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for m in met.iter().filter(|m| m.distance <= end) {
            let s = &splats[m.index];
            let n = DVec3::from_array(s.normal.map(f64::from));
            let weight = 1.0 - m.off;
            normal += n * -n.dot(ray.direction.as_dvec3()).signum() * weight;
            albedo += DVec3::from_array(s.colour.map(f64::from)) * weight;
            sum += weight;
        }
        let normal = normal.try_normalize().unwrap_or(-ray.direction.as_dvec3());
        assert!((hit.normal.as_dvec3() - normal).length() < 0.02, "{ray:?} {normal} {hit:?}");
        assert!((hit.albedo.as_dvec3() - albedo / sum).length() < 0.01);
    }
    assert!(compared * 10 > rays * 8 && hits > 2, "{compared} {hits}");
}

#[test]
fn trees_meet_what_all_discs_one_by_one_meet() {
    for (count, largest) in [(1, 1.0), (7, 0.8), (9, 0.8), (65, 0.5), (600, 0.2), (4000, 0.06)] {
        let splats = soup(count, largest, count as u64);
        compare(&splats, &scene(&splats), 400);
        if count > 8 {
            compare(&splats, &refined(&splats), 400);
        }
    }
}

#[test]
fn discs_without_normals_face_the_ray() {
    let mut splats = soup(300, 0.3, 5);
    splats.iter_mut().step_by(2).for_each(|s| s.normal = [0.0; 3]);
    compare(&splats, &scene(&splats), 400);
    compare(&splats, &refined(&splats), 400);
    let alone = [splat(Vec3::ZERO, Vec3::ZERO, 0.5, 0)];
    let ray = Ray::new(Vec3::new(0.1, 0.2, 4.0), Vec3::new(0.05, 0.0, -1.0).normalize_or_zero());
    let hit = scene(&alone).hit(&ray).unwrap();
    assert_eq!(hit.normal, -ray.direction);
}

#[test]
fn rays_from_the_eye_pass_through_backs_if_these_are_culled() {
    let mut splats = soup(600, 0.25, 6);
    splats.iter_mut().step_by(5).for_each(|s| s.normal = [0.0; 3]);
    let open = scene(&splats);
    let input = SplatInput { splats: &splats, cull_back_faces: true, ..Default::default() };
    let mut culled = Scene::new(input);
    for _ in ["implicit", "refined"] {
        let (mut random, mut through) = (Random(7), 0);
        for _ in 0..600 {
            let ray = random.ray();
            let Some(mut met) = all_met(&splats, &ray) else { continue };
            let [all, seen] = [culled.hit(&ray), culled.seen(&ray)].map(|h| h.map(|h| h.distance));
            let near = |a: Option<f32>, b: Option<f64>| match (a, b) {
                (Some(a), Some(b)) => (f64::from(a) - b).abs() < 1e-4,
                (a, b) => a.is_none() && b.is_none(),
            };
            assert!(near(all, met.first().map(|m| m.distance)));
            assert_eq!(open.seen(&ray).map(|h| h.distance), all);
            let count = met.len();
            met.retain(|m| Vec3::from_array(splats[m.index].normal).dot(ray.direction) <= 0.0);
            assert!(near(seen, met.first().map(|m| m.distance)), "{ray:?}");
            assert!(culled.seen(&ray).is_none_or(|h| !h.is_back && h.normal.is_normalized()));
            assert_eq!(culled.is_blocked(&ray), count > 0);
            through += u32::from(seen != all);
        }
        assert!(through > 30, "{through}");
        assert!(culled.refine());
    }
}

#[test]
fn splats_without_a_normal_take_that_of_the_nearest_one_within_two_radii() {
    let whole = sphere(5_000, [0.1, 0.0], 12);
    let mut some = whole.clone();
    some.iter_mut().step_by(40).for_each(|s| s.normal = [0.0; 3]);
    // Nothing is near this one.
    some.push(splat(Vec3::splat(3.0), Vec3::ZERO, 0.1, 0));
    let given = some.clone();
    adopt_normals(&mut some);
    for (i, splat) in some.iter().enumerate() {
        if given[i].normal != [0.0; 3] {
            assert_eq!(*splat, given[i]);
            continue;
        }
        let at = Vec3::from_array(splat.centre);
        let apart = |s: &Splat| at.distance(s.centre.into());
        let others = given.iter().filter(|s| s.normal != [0.0; 3]);
        let nearest = others.min_by(|a, b| apart(a).total_cmp(&apart(b))).unwrap();
        let is_near = apart(nearest) < 2.0 * splat.radius;
        assert_eq!(splat.normal, if is_near { nearest.normal } else { [0.0; 3] });
    }
    assert_eq!(some.iter().filter(|s| s.normal == [0.0; 3]).count(), 1);
    // Where half have none, that is how they are meant.
    let mut half = whole;
    half.iter_mut().step_by(2).for_each(|s| s.normal = [0.0; 3]);
    let given = half.clone();
    adopt_normals(&mut half);
    assert_eq!(half, given);
}

#[test]
fn refined_and_implicit_trees_agree() {
    let splats = sphere(20_000, [0.2, 0.2], 3);
    let (a, b) = (scene(&splats), refined(&splats));
    assert_eq!((a.splats(), a.bounds()), (b.splats(), b.bounds()));
    let mut random = Random(4);
    for _ in 0..2000 {
        let ray = random.ray();
        let (x, y) = (a.hit(&ray), b.hit(&ray));
        assert_eq!(x.map(|h| (h.distance, h.radius)), y.map(|h| (h.distance, h.radius)));
        if let (Some(x), Some(y)) = (x, y) {
            assert!((x.normal - y.normal).length() < 1e-4 && (x.lift - y.lift).abs() < 1e-6);
        }
    }
}

#[test]
fn the_tree_does_not_depend_on_the_number_of_threads() {
    let splats = soup(30_000, 0.05, 8);
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let scene = scene(&splats);
            let bytes = |tree: &[u8]| tree.to_vec();
            let tree = scene.tree();
            (bytes(bytemuck::cast_slice(&tree.nodes)), bytes(bytemuck::cast_slice(&tree.leaves)))
        })
    };
    assert!(of(1) == of(3));
}

#[test]
fn a_closed_sphere_leaks_hardly_a_ray_and_lifted_rays_hardly_meet_it() {
    let splats = sphere(60_000, [0.17, 0.1], 1);
    let scene = scene(&splats);
    let mut random = Random(2);
    let (rays, mut leaked, mut own) = (20_000, 0, 0);
    for _ in 0..rays {
        let Some(_) = scene.hit(&Ray::new(random.vector() * 0.3, random.unit())) else {
            leaked += 1;
            continue;
        };
        let from = random.unit() * 3.0;
        let ray = Ray::new(from, (random.vector() * 0.5 - from).normalize_or_zero());
        let Some(hit) = scene.hit(&ray) else { continue };
        let out = (hit.normal + random.unit() * 0.999).normalize_or_zero();
        let is_outward = out.dot(hit.start(&ray)) > 0.0;
        own += u32::from(is_outward && scene.is_blocked(&Ray::new(hit.start(&ray), out)));
    }
    assert!(leaked * 1000 < rays * 5, "{leaked} of {rays}");
    assert!(own * 1000 < rays * 2, "{own} of {rays}");
}

#[test]
fn rays_start_before_a_facing_surface() {
    // Two walls, 3 spacings apart, which face each other; splats of radius 1.4 spacings.
    let wall = |x: f32, normal: Vec3| {
        (0..2500).map(move |i| {
            let at = Vec3::new(x, (i % 50) as f32 * 0.1, (i / 50) as f32 * 0.1);
            splat(at, normal, 0.1, i)
        })
    };
    let gap = 0.2;
    let splats: Vec<Splat> = wall(0.0, Vec3::X).chain(wall(gap, -Vec3::X)).collect();
    let scene = scene(&splats);
    let ray =
        Ray::new(Vec3::new(0.5 * gap, 2.43, 2.57), Vec3::new(-1.0, 0.1, 0.0).normalize_or_zero());
    let hit = scene.hit(&ray).unwrap();
    assert!((hit.lift - 0.5 * gap).abs() < 0.01, "{hit:?}");
    // From outside nothing faces the wall.
    let ray = Ray::new(Vec3::new(-1.0, 2.43, 2.57), Vec3::X);
    assert!((scene.hit(&ray).unwrap().lift - 2.0 * 0.1 * RADIUS_FACTOR).abs() < 1e-6);
}

#[test]
fn splats_that_no_ray_can_meet_are_dropped_and_counted() {
    let mut splats = soup(100, 0.3, 11);
    let good = splats.clone();
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
        let mut bad = splats[0];
        bad.centre[1] = value;
        splats.push(bad);
        bad = splats[1];
        bad.radius = if value < 0.0 { 0.0 } else { value };
        splats.insert(3, bad);
    }
    let mut bad = splats[0];
    bad.normal = [f32::NAN, 0.0, 1.0];
    splats.push(bad);
    bad = splats[0];
    bad.radius = -1.0;
    splats.push(bad);
    let scene = scene(&splats);
    assert_eq!((scene.splats(), scene.dropped()), (100, 10));
    compare(&good, &scene, 300);
}

#[test]
fn coincident_points_are_one_surface() {
    let splats = vec![splat(Vec3::ONE, Vec3::Z, 0.5, 7); 10_000];
    let mut scene = scene(&splats);
    scene.refine();
    let ray = Ray::new(Vec3::new(1.1, 1.0, 3.0), Vec3::NEG_Z);
    let hit = scene.hit(&ray).unwrap();
    assert!((hit.distance - 2.0).abs() < 1e-6 && (hit.normal - Vec3::Z).length() < 1e-6);
    let colour = Vec3::from_array(splats[0].colour);
    assert!((hit.albedo - colour).abs().max_element() < 1e-4, "{hit:?}");
    assert!(scene.is_blocked(&ray));
}

#[test]
fn empty_scenes_and_broken_rays_meet_nothing() {
    let none = scene(&[]);
    assert!(none.hit(&Ray::new(Vec3::ZERO, Vec3::X)).is_none() && none.bounds().is_empty());
    assert!(!none.is_blocked(&Ray::new(Vec3::ZERO, Vec3::X)));
    let some = scene(&soup(50, 0.5, 1));
    for v in [Vec3::NAN, Vec3::INFINITY, Vec3::ZERO] {
        for ray in [Ray::new(v, Vec3::X), Ray::new(Vec3::X, v), Ray::new(v, v)] {
            if ray.origin != Vec3::ZERO || ray.direction != Vec3::X {
                assert!(some.hit(&ray).is_none_or(|h| h.distance.is_finite()), "{ray:?}");
                some.is_blocked(&ray);
            }
        }
    }
}

#[test]
fn huge_extents_and_far_origins_are_met() {
    let mut splats = soup(500, 0.3, 21);
    let far = splat(Vec3::splat(9e14), Vec3::X, 1e13, 3);
    splats.push(far);
    let all = scene(&splats);
    assert_eq!(all.splats(), 501);
    let hit = all.hit(&Ray::new(Vec3::new(0.0, 9e14, 9e14), Vec3::X)).unwrap();
    assert!((hit.distance / 9e14 - 1.0).abs() < 1e-5);
    // A camera a million extents away sees what a near one sees.
    let near = scene(&soup(500, 0.3, 21));
    let (mut random, mut differ) = (Random(5), 0);
    for _ in 0..300 {
        let (target, axis) = (random.vector(), (random.next() * 3.0) as usize % 3);
        let (mut from, mut back) = ([target; 2], Vec3::ZERO);
        (from[0][axis], from[1][axis], back[axis]) = (4.0, 1e6, 1.0);
        let [a, b] = from.map(|from| near.hit(&Ray::new(from, -back)));
        assert_eq!(a.is_some(), b.is_some());
        let (Some(a), Some(b)) = (a, b) else { continue };
        assert!((b.distance - a.distance - (1e6 - 4.0)).abs() < 0.1);
        differ += u32::from((a.normal - b.normal).length() > 1e-4 || a.radius != b.radius);
    }
    // Discs at the end of a surface or at their rims may be seen otherwise.
    assert!(differ <= 3, "{differ}");
}

#[test]
fn axis_parallel_rays_meet_flat_floors() {
    let at = |i: usize| Vec3::new((i % 30) as f32, (i / 30) as f32, 2.0);
    let splats: Vec<Splat> = (0..900).map(|i| splat(at(i), Vec3::Z, 1.0, i)).collect();
    for scene in [scene(&splats), refined(&splats)] {
        for i in 0..700 {
            let from = at(i) + Vec3::new(0.37, 0.41, 5.0);
            assert_eq!(scene.hit(&Ray::new(from, Vec3::NEG_Z)).unwrap().distance, 5.0);
        }
        assert!(scene.hit(&Ray::new(Vec3::new(-5.0, 3.3, 2.5), Vec3::X)).is_none());
    }
}

#[test]
fn emitters_by_box_and_class_are_listed_and_met() {
    let splats: Vec<Splat> =
        (0..100).map(|i| splat(Vec3::new(i as f32, 0.0, 0.0), Vec3::Z, 0.5, i)).collect();
    let classes: Vec<u8> = (0..100).map(|i| u8::from(i >= 90) * 6).collect();
    let emitters = [
        Emitter {
            members: Members::Box { min: [-1.0; 3], max: [4.5, 1.0, 1.0] },
            radiance: [1.0, 2.0, 3.0],
        },
        Emitter { members: Members::Classes(vec![6]), radiance: [5.0; 3] },
    ];
    let scene = Scene::new(SplatInput {
        splats: &splats,
        classes: Some(&classes),
        albedo: Albedo::Plain([0.25; 3]),
        emitters: &emitters,
        ..Default::default()
    });
    assert_eq!(scene.area_lights().len(), 15);
    for light in scene.area_lights() {
        assert!(matches!(light.shape, Shape::Disc { .. }) && (light.area - 0.25).abs() < 1e-6);
    }
    let look = |x: f32| scene.hit(&Ray::new(Vec3::new(x, 0.0, 1.0), Vec3::NEG_Z)).unwrap();
    assert!((look(2.0).emission - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-5);
    assert!((look(95.0).emission - 5.0).length() < 1e-5);
    assert_eq!(look(50.0).emission, Vec3::ZERO);
    assert!((look(50.0).albedo - 0.25).length() < 1e-4);
}

#[test]
fn albedo_of_colours_has_its_95th_percentile_at_0_8() {
    let mut splats: Vec<Splat> =
        (0..1000).map(|i| splat(Vec3::new(i as f32, 0.0, 0.0), Vec3::Z, 0.5, i)).collect();
    for (i, s) in splats.iter_mut().enumerate() {
        s.colour = [i as f32 / 1000.0 * 0.2; 3];
    }
    let scene = Scene::new(SplatInput { splats: &splats, ..Default::default() });
    let look = |x: f32| scene.first(&Ray::new(Vec3::new(x, 0.0, 1.0), Vec3::NEG_Z)).unwrap().albedo;
    assert!((look(949.0) - 0.8).abs().max_element() < 0.002, "{}", look(949.0));
    assert!((look(0.0) - 0.02).abs().max_element() < 1e-4);
    assert!(look(999.0).max_element() <= 0.9);
}
