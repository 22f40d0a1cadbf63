//! Pull and push against the `f64` reference of the published algorithm (with normals, depths move
//! along the discs' planes): random pixels of many sizes, and views of models.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod reference;
#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::Renderer;
use esker_render::passes::pull;
use esker_render::passes::push;
use esker_render::passes::tangent::Lens;
use esker_render::picture::pyramid::{Level, Planes, Pyramid};
use glam::{DVec3, Vec2, Vec4};
use reference::{Image, Pixel, pull_push};
use scene::{Dice, Scene, sheet, sphere};

/// Greatest relative error, or absolute error of values below one.
const TOLERANCE: f64 = 1e-4;

/// Counts of pixels compared, and of those that differ.
#[derive(Default)]
struct Tally {
    pixels: usize,
    apart: usize,
}

impl Tally {
    /// Compares with the reference on a base level, with and without smoothing of pixels.
    fn compare(&mut self, name: &str, pyramid: &mut Pyramid) {
        let mut other = pyramid.clone();
        self.compare_with(name, pyramid, false);
        self.compare_with(&format!("{name}, smoothed"), &mut other, true);
    }

    /// Compares with the reference. If no decision is close to a tie, all pixels must agree.
    fn compare_with(&mut self, name: &str, pyramid: &mut Pyramid, smooths: bool) {
        let base = &pyramid.levels[0];
        let lens = (pyramid.planes() == Planes::Normals).then_some(pyramid.lens);
        let lens = lens.map(|l| [l.focal_px, l.centre_px.x, l.centre_px.y].map(f64::from));
        let expected = pull_push(Image { lens, ..read(base) }, smooths);
        pull::pull(pyramid);
        push::push_with(pyramid, f32::from(smooths), &mut []);
        let got = read(&pyramid.levels[0]);
        let apart = (0..got.pixels.len())
            .filter(|&i| !alike(got.pixels[i].as_ref(), expected.pixels[i].as_ref()))
            .collect::<Vec<_>>();
        if expected.near_ties == 0 {
            let first = apart.first().map(|&i| (i, got.pixels[i], expected.pixels[i]));
            assert!(apart.is_empty(), "{name}: {} pixels apart: {first:#?}", apart.len());
        }
        self.pixels += got.pixels.len();
        self.apart += apart.len();
    }

    fn finish(self) {
        println!("{} of {} pixels apart", self.apart, self.pixels);
        assert!(self.pixels > 0 && self.apart * 1000 <= self.pixels, "{} apart", self.apart);
    }
}

fn alike(a: Option<&Pixel>, b: Option<&Pixel>) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return a.is_none() && b.is_none() };
    let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= TOLERANCE * b.abs().max(scale);
    let flat = |p: &Pixel| {
        let [r, [dx, dy]] = [[p.radius, 0.0], p.displacement];
        let mut all = p.depth.to_vec();
        all.extend(p.carried.iter().chain(&p.disc).chain(&r).chain(&[dx, dy]));
        all.extend(p.tilt.iter().flatten());
        all
    };
    // Colours, normals and displacements may be sums near zero of values of about one.
    flat(a).iter().zip(flat(b)).all(|(&a, b)| close(a, b, 1.0))
}

/// Converts a level to an image of the reference.
fn read(level: &Level) -> Image {
    let pixel = |i: usize| {
        let [front, tint] = [level.front[i], level.tint[i]].map(|v| v.to_array().map(f64::from));
        let facing = Vec4::new(0.0, 0.0, 1.0, 1.0);
        let n = level.normal.get(i).copied().unwrap_or(facing).to_array().map(f64::from);
        Pixel {
            depth: [front[0], front[1]],
            carried: [f64::from(level.depth[i]), tint[0], tint[1], tint[2], n[2]],
            disc: [n[0], n[1], n[3]],
            tilt: level.tilt.get(i).map(|t| t.to_array().map(f64::from)),
            radius: tint[3],
            displacement: [front[2], front[3]],
        }
    };
    let valid = |i| level.is_valid(i).then(|| pixel(i));
    let (width, height) = (level.width, level.height);
    let pixels = (0..width * height).map(valid).collect();
    Image { width, height, edge: 1.0, pixels, near_ties: 0, lens: None }
}

/// Random pixels, some of them valid, on a few surfaces or at any depth.
fn random(dice: &mut Dice, width: usize, height: usize, planes: Planes) -> Pyramid {
    let mut pyramid = Pyramid::default();
    pyramid.fit(width, height, planes);
    let centre_px = Vec2::new(width as f32, height as f32) * 0.5;
    pyramid.lens = Lens { focal_px: 80.0, centre_px };
    let share = dice.unit().powi(2);
    let reach = 0.5 + 20.0 * dice.unit() * dice.unit();
    let layers = (dice.unit() * 4.0) as u32;
    let base = &mut pyramid.levels[0];
    for i in 0..width * height {
        base.front[i] = esker_render::picture::pyramid::INVALID;
        if dice.unit() >= share {
            continue;
        }
        let depth = if layers == 0 {
            1.0 + 9.0 * dice.unit()
        } else {
            2.0 * (1.0 + (dice.unit() * f64::from(layers)).floor()) + 0.3 * dice.unit()
        };
        let thick = dice.unit() * 0.5;
        base.front[i] = Vec4::new(depth as f32, (depth + thick) as f32, 0.0, 0.0);
        base.depth[i] = depth as f32;
        let [r, g, b] = [0; 3].map(|_| dice.unit() as f32);
        base.tint[i] = Vec4::new(r, g, b, (reach * (0.5 + dice.unit())) as f32);
        if planes == Planes::Fitted {
            let steep = dice.unit() * dice.unit() * 0.2;
            let (s, c) = (dice.unit() * std::f64::consts::TAU).sin_cos();
            base.tilt[i] = Vec2::new((steep * c) as f32, (steep * s) as f32);
        }
        if planes == Planes::Normals {
            let z = 0.05 + 0.95 * dice.unit();
            let (s, c) = (dice.unit() * std::f64::consts::TAU).sin_cos();
            let flat = (1.0 - z * z).sqrt();
            let n = [flat * c, flat * s, z, z.max(0.2)].map(|c| c as f32);
            base.normal[i] = Vec4::from_array(n);
        }
    }
    pyramid
}

#[test]
fn random_pixels_agree_with_the_reference() {
    let mut dice = Dice(1);
    let mut tally = Tally::default();
    let mut sizes =
        vec![(1, 1), (1, 2), (2, 1), (1, 37), (64, 1), (2, 2), (3, 3), (5, 4), (127, 65)];
    sizes.extend(
        (0..40).map(|_| (1 + (dice.unit() * 96.0) as usize, 1 + (dice.unit() * 96.0) as usize)),
    );
    for (i, (width, height)) in sizes.into_iter().enumerate() {
        for planes in [Planes::Normals, Planes::Fitted, Planes::None] {
            let mut pyramid = random(&mut dice, width, height, planes);
            tally.compare(&format!("image {i}, {width} x {height}, {planes:?}"), &mut pyramid);
        }
    }
    tally.finish();
}

/// The base level of a view, drawn by the passes before pull.
fn base_of(scene: &Scene, view: &View, normals: bool) -> Pyramid {
    let draws = scene.draws(true, true, normals);
    let frame = scene.frame(view, &draws);
    let mut pyramid = Pyramid::default();
    Renderer::default().base_level(&frame, &mut pyramid).unwrap();
    pyramid
}

#[test]
fn views_of_models_agree_with_the_reference() {
    let mut dice = Dice(2);
    let mut tally = Tally::default();
    let corner = DVec3::splat(-1.0);
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    let ball = sphere(&mut dice, DVec3::ZERO, 0.8, 30_000, [200, 150, 90]);
    let floor = sheet(&mut dice, corner, x, y, 150, [90, 150, 200]);
    let mut walls = sheet(&mut dice, DVec3::new(-1.0, 1.0, -1.0), x, z, 60, [200, 90, 90]);
    walls.extend(sheet(&mut dice, corner, z, y, 120, [90, 200, 90]));
    let all = [&ball[..], &floor, &walls].concat();
    for (name, points) in [("sphere", ball), ("floor", floor), ("two walls", walls), ("all", all)] {
        let scene = Scene::new(&points, 1e-5, 0.02, 0.03, 4096);
        for (distance, size) in [(3.0, (201, 150)), (8.0, (64, 77))] {
            let eye = DVec3::new(0.6, -1.0, 0.7) * distance;
            let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, 0.9, size.0, size.1);
            for normals in [true, false] {
                tally.compare(name, &mut base_of(&scene, &view, normals));
            }
        }
    }
    tally.finish();
}

#[test]
fn the_bunny_agrees_with_the_reference() {
    let Some(points) = scene::bunny() else {
        println!("skipped: ESKER_DATA is not set");
        return;
    };
    assert_eq!(points.len(), 35_947);
    let scene = Scene::new(&points, 1e-7, 0.001, 0.0014, 8192);
    let mut tally = Tally::default();
    for eye in [DVec3::new(0.1, 0.2, 0.35), DVec3::new(-0.3, 0.12, 0.1)] {
        let centre = DVec3::new(-0.017, 0.11, -0.0015);
        let view = View::look_at(eye, centre, DVec3::Y, 0.6, 640, 511);
        for normals in [true, false] {
            tally.compare("bunny", &mut base_of(&scene, &view, normals));
        }
    }
    tally.finish();
}
