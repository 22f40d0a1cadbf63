//! Clip lines (zwicker2004, section 5, figures 4, 5 and 8): the two splats of a pair meet at their
//! line without a gap or an overlap, convex and concave corners, and a cube with the outline and
//! edges of the analytic one.

use crate::passes::draw;
use crate::scene::{Dice, Scene, ScenePoint};
use esker_lod::View;
use esker_points::{Clip, ClipLine, Grain, Lattice, quant};
use esker_render::ewa::Options;
use esker_render::ewa::clip::WIDER;
use glam::{DMat3, DQuat, DVec2, DVec3, Vec3Swizzles};
use std::f64::consts::TAU;

const STEP: f64 = 1e-5;
/// Stored radius of single splats.
const RADIUS: f64 = 0.06;

fn direction(dice: &mut Dice) -> DVec3 {
    loop {
        let v = DVec3::from_array([0; 3].map(|_| dice.unit() * 2.0 - 1.0));
        if v.length_squared() <= 1.0 && v.length_squared() > 1e-2 {
            return v.normalize_or_zero();
        }
    }
}

fn rotation(dice: &mut Dice) -> DMat3 {
    DMat3::from_quat(DQuat::from_axis_angle(direction(dice), dice.unit() * 6.2))
}

/// Clip line from `from` to `to` in world space; the splat is kept to the left of it.
fn line(lattice: &Lattice, from: DVec3, to: DVec3) -> Option<ClipLine> {
    let steps = |p: DVec3| [0, 1, 2].map(|i| lattice.steps_axis(i, p[i]));
    ClipLine::through(steps(from), steps(to), Grain::new(lattice.scale))
}

/// Whether each pixel is covered, by splats with their clip lines or (without `clips`) by unclipped
/// splats of the same width.
fn covered(scene: &Scene, view: &View, clips: bool) -> Vec<bool> {
    let (mut draws, mut options) = (scene.draws(true, true, true), Options::default());
    if !clips {
        draws.iter_mut().for_each(|d| d.clip = None);
        options.radius_factor *= WIDER;
    }
    let frame = scene.frame(view, &draws);
    let (level, ..) = draw(&frame, options);
    (0..level.tint.len()).map(|i| level.is_valid(i)).collect()
}

#[test]
fn two_splats_of_a_pair_share_their_line_without_gap_or_overlap() {
    let mut dice = Dice(31);
    let (mut pixels, mut cut, mut twice) = (0, 0, 0);
    for _ in 0..400 {
        // An edge with two faces at an angle of 20 to 340 degrees.
        let axes = rotation(&mut dice);
        let (along, up) = (axes.x_axis, axes.y_axis);
        let turn = 0.35 + dice.unit() * 5.6;
        let out = |angle: f64| up * angle.cos() + axes.z_axis * angle.sin();
        let faces = [out(0.0), out(turn)];
        let normals = [faces[0].cross(along), along.cross(faces[1])];
        let edge = direction(&mut dice) * 0.3;
        let ends = [edge - along * 0.03, edge + along * (0.02 + 0.02 * dice.unit())];
        let points = [0, 1].map(|i| {
            let at = edge + faces[i] * 0.03 * dice.unit() + along * 0.02 * (dice.unit() - 0.5);
            ScenePoint { at, normal: normals[i], colour: [255, 255, 255] }
        });
        let both = |lattice: &Lattice, i: usize| {
            let [from, to] = if i == 0 { [ends[1], ends[0]] } else { ends };
            Clip { lines: [line(lattice, from, to), None], either: false }
        };
        // Both faces are turned to the eye; close to the edge, the line reaches behind the eye.
        let eye = edge + direction(&mut dice) * (0.02 + 0.5 * dice.unit() * dice.unit());
        if normals.iter().any(|n| n.dot(eye - edge) < 0.003) {
            continue;
        }
        let target = edge + direction(&mut dice) * 0.01;
        let mut view = View::look_at(eye, target, DVec3::Z, 1.2, 160, 120);
        view.near = 1e-4;
        // Each splat is in a node of its own, so that the two lines are decoded from different
        // values.
        let seen = |points: &[ScenePoint], first: usize, clips: bool| {
            let clip = |lattice: &Lattice, i: usize| both(lattice, first + i);
            covered(&Scene::clipped(points, clip, STEP, RADIUS, RADIUS, 1), &view, clips)
        };
        let whole = [0, 1].map(|i| seen(&points[i..=i], i, false));
        let parts = [0, 1].map(|i| seen(&points[i..=i], i, true));
        let pair = seen(&points, 0, true);
        let kept = [0, 1].map(|i| {
            let reach = faces[i].dot(points[i].at - edge);
            KeptOutline::new(&view, points[i].at, [-faces[i], along], reach)
        });
        // At grazing angles, the low-pass filter widens a splat beyond its line.
        let sine = |i: usize| normals[i].dot((eye - points[i].at).normalize_or_zero());
        let is_flat = (0..2).any(|i| sine(i) < 0.5);
        for i in 0..pair.len() {
            let at = DVec2::new((i % 160) as f64, (i / 160) as f64) + 0.5;
            let is_on =
                |kept: &Option<KeptOutline>| kept.as_ref().is_none_or(|k| k.distance(at) < 0.0);
            if whole[0][i] && whole[1][i] && (!is_flat || kept.iter().any(is_on)) {
                pixels += 1;
                assert!(parts[0][i] || parts[1][i], "pixel {i}: covered by neither splat");
                assert!(pair[i], "pixel {i}");
                twice += usize::from(parts[0][i] && parts[1][i]);
            }
            assert!(whole[0][i] || !parts[0][i]);
            cut += usize::from(whole[0][i] && !parts[0][i]);
        }
    }
    assert!(pixels > 100_000 && cut > 100_000, "{pixels} {cut}");
    assert!(twice < 20, "{twice}");
}

/// Outline in the picture of the part of a disc that a line keeps.
struct KeptOutline {
    /// Corners in order; seen edge on, the outline has no area.
    outline: Vec<DVec2>,
}

impl KeptOutline {
    /// Outline of a splat at `at` with the drawn width, kept up to `reach` along `out`; `None` if
    /// part of it is behind the eye.
    fn new(view: &View, at: DVec3, [out, along]: [DVec3; 2], reach: f64) -> Option<Self> {
        let factor = quant::radius_factor(quant::radius_code(RADIUS, RADIUS));
        let radius = RADIUS * f64::from(factor * Options::default().radius_factor * WIDER);
        let seen = |p: DVec3| {
            let v = view.view_from_world() * (p - view.eye);
            let middle = DVec2::new(f64::from(view.width), f64::from(view.height)) * 0.5;
            (v.z < -view.near).then(|| middle + DVec2::new(v.x, -v.y) * view.focal_px() / -v.z)
        };
        // The arc from one end of the line to the other.
        let first = (reach / radius).clamp(-1.0, 1.0).acos();
        let rim = (0..=48).map(|i| first + f64::from(i) / 48.0 * (TAU - 2.0 * first));
        let outline = rim.map(|turn| seen(at + (out * turn.cos() + along * turn.sin()) * radius));
        Some(Self { outline: outline.collect::<Option<_>>()? })
    }

    fn sides(&self) -> impl Iterator<Item = [DVec2; 2]> {
        let next = self.outline.iter().cycle().skip(1);
        self.outline.iter().zip(next).map(|(a, b)| [*a, *b])
    }

    /// Distance of a place from the outline, pixels; negative inside.
    fn distance(&self, at: DVec2) -> f64 {
        let apart = self.sides().map(|[a, b]| {
            let way = b - a;
            let along = ((at - a).dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0);
            (at - a - way * along).length()
        });
        let turns = || self.sides().map(|[a, b]| (b - a).perp_dot(at - a));
        let is_inside = turns().all(|turn| turn > 0.0) || turns().all(|turn| turn < 0.0);
        apart.fold(f64::INFINITY, f64::min) * if is_inside { -1.0 } else { 1.0 }
    }
}

#[test]
fn splats_end_at_their_line_also_at_grazing_angles() {
    let mut dice = Dice(8);
    let (mut pixels, mut inside) = (0, 0);
    for round in 0..600 {
        let axes = rotation(&mut dice);
        let (out, along, normal) = (axes.x_axis, axes.y_axis, axes.z_axis);
        // Sines of the viewing angle down to 0.01; the splat is 15 to 80 pixels wide.
        let sine = 0.01 * 60f64.powf(dice.unit());
        let (s, c) = (dice.unit() * TAU).sin_cos();
        let way = (out * c + along * s) * (1.0 - sine * sine).sqrt() + normal * sine;
        let eye = way * RADIUS * (3.0 + 18.0 * dice.unit());
        let mut view = View::look_at(eye, direction(&mut dice) * 0.02, DVec3::Z, 1.2, 160, 120);
        view.near = 1e-4;
        let reach = RADIUS * (0.02 + 1.5 * dice.unit());
        let ends = [-1.0, 1.0].map(|side| out * reach + along * side * RADIUS);
        let point = ScenePoint { at: DVec3::ZERO, normal, colour: [255; 3] };
        let clip = |lattice: &Lattice, _: usize| Clip {
            lines: [line(lattice, ends[0], ends[1]), None],
            either: false,
        };
        let scene = Scene::clipped(&[point], clip, STEP, RADIUS, RADIUS, 1);
        let seen = covered(&scene, &view, true);
        let kept = KeptOutline::new(&view, DVec3::ZERO, [out, along], reach).unwrap();
        for (i, is_seen) in seen.into_iter().enumerate() {
            let distance = kept.distance(DVec2::new((i % 160) as f64, (i / 160) as f64) + 0.5);
            let case = || format!("round {round}, sine {sine}: {distance} px, pixel {i}");
            // The low-pass filter has a radius of 1.5 pixels.
            assert!(!is_seen || distance < 2.5, "{}", case());
            assert!(is_seen || distance > -0.5, "{}", case());
            pixels += usize::from(is_seen);
            inside += usize::from(distance < -0.5);
        }
    }
    assert!(pixels > 50_000 && inside > 30_000, "{pixels} {inside}");
}

/// A splat clipped to all but its lower left quarter.
pub fn l_shaped() -> Scene {
    let point = ScenePoint { at: DVec3::ZERO, normal: DVec3::NEG_Y, colour: [200, 120, 60] };
    Scene::clipped(&[point], |lattice, _| corner(lattice, true), STEP, 0.5, 0.5, 16)
}

/// Corner that keeps x > 0 and z > 0, or with `either` one of them, seen from the side of the
/// normal with x to the right and z up.
fn corner(lattice: &Lattice, either: bool) -> Clip {
    let upright = line(lattice, DVec3::Z * 0.3, DVec3::Z * -0.3);
    let level = line(lattice, DVec3::X * -0.3, DVec3::X * 0.3);
    Clip { lines: [upright, level], either }
}

#[test]
fn convex_and_concave_corners_keep_their_quarters() {
    let view = {
        let mut view =
            View::look_at(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, DVec3::Z, 0.6, 100, 100);
        view.near = 0.01;
        view
    };
    let point = ScenePoint { at: DVec3::ZERO, normal: DVec3::NEG_Y, colour: [255; 3] };
    let share = |either: bool| {
        let clip = |lattice: &Lattice, _: usize| corner(lattice, either);
        let scene = Scene::clipped(&[point], clip, STEP, 0.5, 0.5, 16);
        let seen = |clips| covered(&scene, &view, clips);
        let (whole, kept) = (seen(false), seen(true));
        for (i, &is_kept) in kept.iter().enumerate() {
            let (right, above) = (i % 100 >= 50, i / 100 < 50);
            let wanted = if either { right || above } else { right && above };
            assert_eq!(is_kept, whole[i] && wanted, "pixel {i}, {either}");
        }
        let count = |seen: &[bool]| seen.iter().filter(|s| **s).count() as f64;
        count(&kept) / count(&whole)
    };
    assert!((share(false) - 0.25).abs() < 0.01);
    assert!((share(true) - 0.75).abs() < 0.01);
}

/// A cube with `side` x `side` splats a face, a smooth texture and clip lines.
struct Cube {
    axes: DMat3,
    side: usize,
}

/// A turned cube of `side` x `side` splats a face.
pub fn cube(side: usize) -> Scene {
    Cube { axes: rotation(&mut Dice(5)), side }.scene()
}

/// Half the cube's edge.
const HALF: f64 = 0.5;

impl Cube {
    /// Place and normal of splat `i` in the frame of the cube.
    fn splat(&self, i: usize) -> (DVec3, DVec3) {
        let (face, cell) = (i / (self.side * self.side), i % (self.side * self.side));
        let at = |c: usize| (c as f64 + 0.5) / self.side as f64 - 0.5;
        let normal = DVec3::AXES[face / 2] * if face % 2 == 0 { 1.0 } else { -1.0 };
        let [u, v] = Self::across(normal);
        (normal * HALF + u * at(cell % self.side) + v * at(cell / self.side), normal)
    }

    fn across(normal: DVec3) -> [DVec3; 2] {
        [normal.yzx().abs(), normal.zxy().abs()]
    }

    /// Smooth texture, 0 to 1.
    fn texture(at: DVec3) -> DVec3 {
        (at * 3.0 + DVec3::new(0.0, 1.0, 2.0)).to_array().map(|c| 0.5 + 0.4 * c.sin()).into()
    }

    fn scene(&self) -> Scene {
        let count = self.side * self.side * 6;
        let splats: Vec<_> = (0..count).map(|i| self.splat(i)).collect();
        let points: Vec<_> = splats
            .iter()
            .map(|&(at, normal)| ScenePoint {
                at: self.axes * at,
                normal: self.axes * normal,
                colour: Self::texture(at).to_array().map(|c| (c * 255.0) as u8),
            })
            .collect();
        let spacing = 1.0 / self.side as f64;
        let clip = |lattice: &Lattice, i: usize| {
            let (at, normal) = splats[i];
            // The nearer edge along each axis, however far: at grazing angles the low-pass filter
            // reaches it from anywhere on the face.
            let lines = Self::across(normal).map(|across| {
                let (along, out) = (normal.cross(across), across * at.dot(across).signum());
                // The line is centred where the splat's row meets the edge, and as long as the
                // splat is far: the splats of both faces get the same line. The face lies to its
                // left.
                let edge = (normal + out) * HALF + along * at.dot(along);
                let way = out.cross(normal) * -(HALF - at.dot(out)).max(spacing);
                line(lattice, self.axes * (edge - way), self.axes * (edge + way))
            });
            Clip { lines, either: false }
        };
        Scene::clipped(&points, clip, STEP, spacing, spacing, 1000)
    }

    /// First intersection of a ray with the cube, in the frame of the cube: place and normal of the
    /// face.
    fn meets(&self, eye: DVec3, ray: DVec3) -> Option<(DVec3, DVec3)> {
        let own = self.axes.transpose();
        let (eye, ray) = (own * eye, own * ray);
        let [a, b] = [-HALF, HALF].map(|h| (DVec3::splat(h) - eye) / ray);
        let (near, far) = (a.min(b), a.max(b));
        let t = near.max_element();
        let face = (0..3).find(|&i| near[i] == t)?;
        (t <= far.min_element() && t > 0.0)
            .then(|| (eye + ray * t, DVec3::AXES[face] * -ray[face].signum()))
    }
}

#[test]
fn figure_5_a_cube_has_the_analytic_outline_and_edges_and_smooth_faces() {
    let mut dice = Dice(77);
    let cube = Cube { axes: rotation(&mut dice), side: 24 };
    let scene = cube.scene();
    for round in 0..12 {
        // From far away to so close that splats are forty pixels wide.
        let away = [3.0, 1.6, 1.02][round % 3];
        let eye = direction(&mut dice) * away;
        let target = if round % 3 == 2 { direction(&mut dice) * 0.8 } else { DVec3::ZERO };
        let mut view = View::look_at(eye, target, DVec3::Z, 0.7, 240, 200);
        view.near = 1e-3;
        let draws = scene.draws(true, true, true);
        let frame = scene.frame(&view, &draws);
        let (level, ..) = draw(&frame, Options::default());
        let ray = |x: f64, y: f64| {
            let at = [(x - 120.0) / view.focal_px(), (100.0 - y) / view.focal_px()];
            view.world_from_view * DVec3::new(at[0], at[1], -1.0)
        };
        let (mut seen, mut worst, mut turned) = (0, 0f64, 1f64);
        for i in 0..level.tint.len() {
            let (x, y) = ((i % 240) as f64 + 0.5, (i / 240) as f64 + 0.5);
            // Where all rays within half a pixel meet the same face, or none, the picture must
            // agree.
            let around = (0..16).map(|k| {
                let (s, c) = (f64::from(k) * TAU / 16.0).sin_cos();
                cube.meets(eye, ray(x + 0.5 * c, y + 0.5 * s)).map(|(_, face)| face)
            });
            let own = cube.meets(eye, ray(x, y));
            let face = own.map(|(_, face)| face);
            if around.into_iter().any(|other| other != face) {
                continue;
            }
            assert_eq!(level.is_valid(i), own.is_some(), "round {round}: {x} {y}");
            let Some((at, face)) = own else { continue };
            let normal = level.normal[i].truncate().as_dvec3().normalize_or_zero();
            let wanted = view.view_from_world() * (cube.axes * face);
            turned = turned.min(normal.dot(wanted));
            let colour = Cube::texture(at).to_array().map(|c| (c * 255.0) as u8);
            let wanted = esker_render::inputs::colour::linear(colour);
            worst = worst.max(f64::from((level.tint[i].truncate() - wanted).abs().max_element()));
            seen += 1;
        }
        assert!(seen > 2000, "round {round}: {seen}");
        assert!(turned > 0.999, "round {round}: a normal of another face, {turned}");
        assert!(worst < 0.1, "round {round}: {worst}");
    }
}
