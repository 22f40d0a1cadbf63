//! Outlines of drawn surfaces against their true outlines, and their effect on light: no bright
//! rims, no dark dots, no growing gaps.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::{Background, Frame, Picture, Renderer};
use glam::{DVec2, DVec3};
use scene::{Dice, Scene, ScenePoint, even_sphere};

const SIDE: u32 = 320;

fn draw(points: &[ScenePoint], spacing: f64, normals: bool) -> Picture {
    let scene = Scene::new(points, 1e-6, spacing, spacing, 10_000);
    let view = view();
    let draws = scene.draws(true, true, normals);
    let mut frame = scene.frame(&view, &draws);
    frame.background = Background::Plain([0; 4]);
    Renderer::default().render(&frame).unwrap()
}

fn view() -> View {
    View::look_at(DVec3::NEG_Y * 20.0, DVec3::ZERO, DVec3::Z, 0.11, SIDE, SIDE)
}

/// Distance from the centre of the picture at which alpha reaches one half, pixels, for `n`
/// directions, searched from outside inwards.
fn outline(picture: &Picture, n: usize) -> Vec<f64> {
    let alpha = |at: DVec2| {
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let (i, j) = (x.floor(), y.floor());
        let value = |i: f64, j: f64| {
            f64::from(picture.rgba[(j as usize * SIDE as usize + i as usize) * 4 + 3]) / 255.0
        };
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        mix(
            mix(value(i, j), value(i + 1.0, j), x - i),
            mix(value(i, j + 1.0), value(i + 1.0, j + 1.0), x - i),
            y - j,
        )
    };
    let middle = f64::from(SIDE) / 2.0;
    (0..n)
        .map(|k| {
            let direction = DVec2::from_angle(k as f64 / n as f64 * std::f64::consts::TAU);
            let mut at = middle - 3.0;
            while alpha(direction * at + middle) < 0.5 && at > 0.0 {
                at -= 0.05;
            }
            at
        })
        .collect()
}

/// Pixels a unit of length at the origin.
fn pixels_per_unit() -> f64 {
    view().focal_px() / 20.0
}

/// Radius of the outline of a sphere of radius 1, pixels.
fn radius_px() -> f64 {
    view().focal_px() / (20f64.powi(2) - 1.0).sqrt()
}

/// Brightness of a pixel, 0 to 255.
fn light(picture: &Picture, x: usize, y: usize) -> f64 {
    let pixel = &picture.rgba[(y * SIDE as usize + x) * 4..][..3];
    pixel.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0
}

/// A wall that faces the viewer, `behind` the origin, with one random point in each cell of a grid.
/// Its corners `low` and `high` are in pixels from the centre of the picture.
fn wall(dice: &mut Dice, behind: f64, low: DVec2, high: DVec2, spacing_px: f64) -> Vec<ScenePoint> {
    let pixel = (20.0 + behind) / view().focal_px();
    let [columns, rows] = ((high - low) / spacing_px).to_array().map(|n| n as usize);
    (0..columns * rows)
        .map(|i| {
            let cell = DVec2::new((i % columns) as f64, (i / columns) as f64);
            let at = low + (cell + DVec2::new(dice.unit(), dice.unit())) * spacing_px;
            let at = DVec3::new(at.x * pixel, behind, at.y * pixel);
            ScenePoint { at, normal: DVec3::NEG_Y, colour: [180; 3] }
        })
        .collect()
}

#[test]
fn the_outline_of_a_sphere_is_about_a_pixel_from_the_true_circle() {
    let radius_px = radius_px();
    for spacing_px in [1.0, 2.0, 4.0, 8.0] {
        for normals in [true, false] {
            let spacing = spacing_px / pixels_per_unit();
            let picture = draw(&even_sphere(&mut Dice(3), spacing), spacing, normals);
            let off: Vec<f64> = outline(&picture, 720).iter().map(|r| r - radius_px).collect();
            let mean = off.iter().sum::<f64>() / 720.0;
            let rough = (off.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / 720.0).sqrt();
            // Without normals a surface extends a third of a radius beyond its samples.
            let beyond = if normals { 1.5 } else { 1.2f64.max(0.3 * spacing_px) };
            let what =
                format!("{mean:.2} px, rough {rough:.2} px: spacing {spacing_px} px, {normals}");
            assert!(mean.abs() < beyond && rough < 0.5 + 0.06 * spacing_px, "{what}");
        }
    }
}

/// Backs of the far side lie just behind an outline, and their light comes from the other side.
#[test]
fn backs_do_not_show_at_outlines() {
    for spacing_px in [1.0, 2.0, 4.0, 8.0] {
        let spacing = spacing_px / pixels_per_unit();
        let scene = Scene::new(&even_sphere(&mut Dice(8), spacing), 1e-6, spacing, spacing, 10_000);
        let view = view();
        let draws = scene.draws(true, true, true);
        let [culled, both] = [true, false].map(|cull_back_faces| {
            let frame = Frame { cull_back_faces, has_fronts: true, ..scene.frame(&view, &draws) };
            Renderer::default().render(&frame).unwrap()
        });
        let sides = SIDE as usize;
        let pixels = (0..sides * sides).map(|i| (i % sides, i / sides));
        let other =
            pixels.filter(|&(x, y)| (light(&both, x, y) - light(&culled, x, y)).abs() > 8.0);
        let share = other.count() as f64 / (std::f64::consts::TAU * radius_px());
        let what = format!("{share:.3} pixels for each of the outline: spacing {spacing_px} px");
        assert!(share < 0.15 * spacing_px, "{what}");
    }
}

#[test]
fn a_rim_is_no_brighter_than_the_surface_inside_it() {
    for spacing_px in [1.5, 3.0, 6.0] {
        let spacing = spacing_px / pixels_per_unit();
        let picture = draw(&even_sphere(&mut Dice(4), spacing), spacing, false);
        let ends = outline(&picture, 360);
        // Mean light between two distances from the outline, in twelve sectors.
        let ring = |sector: usize, from: f64, to: f64| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (k, end) in ends.iter().enumerate().skip(sector * 30).take(30) {
                let direction = DVec2::from_angle(f64::from(k as u32).to_radians());
                for step in 0..4 {
                    let inwards = from + (to - from) * f64::from(step) / 3.0;
                    let at = direction * (end - inwards) + f64::from(SIDE) / 2.0;
                    sum += light(&picture, at.x as usize, at.y as usize);
                    count += 1.0;
                }
            }
            sum / count
        };
        for sector in 0..12 {
            let (rim, inside) = (ring(sector, 1.5, 3.5), ring(sector, 8.0, 12.0));
            assert!(
                rim < inside * 1.1,
                "{rim:.0} after {inside:.0}: sector {sector}, {spacing_px} px"
            );
        }
    }
}

#[test]
fn the_edge_of_a_near_surface_in_front_of_a_far_one_has_no_dark_dots() {
    let far = DVec2::splat(f64::from(SIDE) * 0.6);
    for normals in [true, false] {
        for spacing_px in [0.8, 1.5, 3.0] {
            let dice = &mut Dice(5);
            let mut points = wall(dice, 0.5, -far, far, spacing_px);
            let near = DVec2::new(90.0, 70.0);
            // Two layers, as in overlapping scans.
            points.extend(wall(dice, 0.0, -near, near, spacing_px));
            points.extend(wall(dice, 0.004, -near, near, spacing_px));
            let picture = draw(&points, spacing_px / pixels_per_unit(), normals);
            let (mut dots, mut bright) = (0, 0);
            let inner = 4..SIDE as usize - 4;
            for (x, y) in inner.clone().flat_map(|y| inner.clone().map(move |x| (x, y))) {
                let here = light(&picture, x, y);
                bright += usize::from(here > 100.0);
                let around = (0..9).filter(|&k| k != 4);
                let darker =
                    around.filter(|k| light(&picture, x + k % 3 - 1, y + k / 3 - 1) > here + 25.0);
                dots += usize::from(darker.count() == 8);
            }
            assert!(dots == 0, "{dots} dots at {spacing_px} px, {normals}");
            assert!(bright > 90_000, "{bright} pixels lit");
        }
    }
}

#[test]
fn an_isolated_point_is_drawn_smaller_than_the_disc_that_closes_surfaces() {
    let at = DVec3::ZERO;
    let point = ScenePoint { at, normal: DVec3::NEG_Y, colour: [200; 3] };
    for (normals, share) in [(true, 0.6), (false, 0.45)] {
        let radius_px = 30.0;
        let picture = draw(&[point], radius_px / pixels_per_unit(), normals);
        let factor = if normals { 1.4 } else { 1.15 };
        let drawn = (picture.stats.pixels_covered as f64 / std::f64::consts::PI).sqrt();
        assert!(drawn > 5.0 && drawn < share * factor * radius_px, "{drawn} px");
    }
}

#[test]
fn a_slanted_edge_covers_its_share_of_pixels_and_thin_lines_stay() {
    let line = |across: f64, along: f64| {
        let (s, c) = 0.2f64.sin_cos();
        let at = DVec2::new(c * across - s * along, s * across + c * along) / pixels_per_unit();
        let at = DVec3::new(at.x, 0.0, at.y);
        ScenePoint { at, normal: DVec3::NEG_Y, colour: [200; 3] }
    };
    let steps = |half: f64, step: f64| {
        let n = (half / step) as i32;
        (-n..=n).map(move |i| f64::from(i) * step)
    };
    let spacing = 1.0 / pixels_per_unit();
    let alphas = |picture: &Picture| -> Vec<f64> {
        picture.rgba.as_chunks::<4>().0.iter().map(|p| f64::from(p[3]) / 255.0).collect()
    };
    let square: Vec<_> =
        steps(60.0, 0.5).flat_map(|a| steps(60.0, 0.5).map(move |b| line(a, b))).collect();
    let alpha = alphas(&draw(&square, spacing, true));
    let area: f64 = alpha.iter().sum();
    // Discs extend beyond their samples by up to 1.5 pixels.
    assert!(area > 120.0f64.powi(2) && area < 123.0f64.powi(2), "{area}");
    assert!(alpha.iter().filter(|a| (0.1..0.9).contains(*a)).count() > 300);
    let wire: Vec<_> = steps(100.0, 0.5).map(|along| line(0.0, along)).collect();
    let alpha = alphas(&draw(&wire, spacing, true));
    for y in 80..240 {
        let width: f64 = alpha[y * SIDE as usize..][..SIDE as usize].iter().sum();
        assert!(width > 0.7 && width < 4.5, "{width} px wide in row {y}");
    }
}

/// Discs of scan lines on slanted ground leave narrow gaps. Behind a gap lies the same ground, so
/// its edges are no silhouettes and must not be eroded.
#[test]
fn gaps_between_scan_lines_on_slopes_do_not_grow() {
    let (radius_px, apart_px, pixel) = (10.0, 22.5, 1.0 / pixels_per_unit());
    for degrees in [35.0f64, 50.0, 90.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let place =
            |i: i32| DVec2::new(f64::from(i % 81 - 40) * 5.0, f64::from(i / 81 - 10) * apart_px);
        let points = (0..21 * 81).map(place).map(|at| ScenePoint {
            at: DVec3::new(at.x, at.y / sin * cos, at.y) * pixel,
            normal: DVec3::new(0.0, -sin, cos),
            colour: [180; 3],
        });
        let picture = draw(&points.collect::<Vec<_>>(), radius_px * pixel, false);
        let alpha = |x: usize, y: usize| picture.rgba[(y * SIDE as usize + x) * 4 + 3];
        let middle = (60..260).flat_map(|y| (60..260).map(move |x| alpha(x, y)));
        let open = middle.map(|a| 1.0 - f64::from(a) / 255.0).sum::<f64>() / 200.0f64.powi(2);
        // Gaps between straight edges would leave a ninth open; smoothed discs close most of it.
        assert!(open < 0.03, "{open} at {degrees} degrees");
    }
}

/// Where points are far apart, pixels of coarse levels may hold only points of the surface behind.
/// Discs beside these pixels hide them.
#[test]
fn a_wall_hides_a_wall_behind_it_however_far_apart_its_points_are() {
    for spacing_px in [24.0, 32.0, 48.0] {
        let corner = DVec2::splat(170.0);
        let mut shows_through = 0;
        for seed in 1..6 {
            let mut dice = Dice(seed);
            let mut points = wall(&mut dice, 0.0, -corner, corner, spacing_px);
            // A wall of the same density in the picture, farther away.
            points.extend(wall(&mut dice, 6.0, -corner * 1.3, corner * 1.3, spacing_px / 1.3));
            let picture = draw(&points, 0.9 * spacing_px / pixels_per_unit(), false);
            let is_behind = |x: usize, y: usize| picture.depth[y * SIDE as usize + x] > 23.0;
            let middle = (60..260).flat_map(|y| (60..260).map(move |x| (x, y)));
            shows_through += middle.filter(|&(x, y)| is_behind(x, y)).count();
        }
        let share = shows_through as f64 / (5.0 * 200.0f64.powi(2));
        // Comparing pixels only with the coarser pixel above gives 0.0035 at 48 px.
        assert!(share < 0.001, "{share} at {spacing_px} px");
    }
}

#[test]
fn the_number_of_threads_does_not_change_the_picture() {
    let spacing = 5.0 / pixels_per_unit();
    let dice = &mut Dice(6);
    let far = DVec2::splat(f64::from(SIDE) * 0.6);
    let mut points = wall(dice, 2.0, -far, far, 5.0);
    points.extend(even_sphere(dice, spacing));
    for normals in [true, false] {
        let drawn = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| draw(&points, spacing, normals))
        };
        let one = drawn(1);
        for threads in [2, 5] {
            let more = drawn(threads);
            assert!(one.rgba == more.rgba && one.depth == more.depth, "{threads}, {normals}");
        }
    }
}
