//! Pictures of analytic scenes against their ground truth: occlusion, holes, shading, and errors of
//! colours, depths and normals.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;
mod truth;

use esker_render::inputs::colour::{Encoder, linear};
use esker_render::{FramePlan, Pass, Renderer};
use esker_truth::image::{Image, srgb};
use esker_truth::sample::{Kind, sample};
use esker_truth::{Paint, Truth, scenes, walls, walls_view};
use glam::{DVec2, DVec3, Vec3};
use scene::{Dice, Scene};
use truth::flicker::{flicker, orbit};
use truth::measure::Cloud;

const SIDE: u32 = 80;

/// Distance of the two walls, metres.
const GAP: f64 = 0.01;

/// Samples two walls [`GAP`] apart, which is `ratio` times the radius that covers them. Returns the
/// walls, the cloud and its spacing.
fn covered_walls(ratio: f64, kind: Kind) -> (Truth, Cloud, f64) {
    let truth = walls(GAP, if ratio < 2.0 { 0.7 } else { 0.35 });
    let factor = if kind == Kind::Regular { 0.729 } else { 0.9 };
    let mut spacing = GAP / ratio / factor;
    let mut cloud = sample(&truth, spacing, kind, &mut Dice(5));
    while cloud.radius * ratio > GAP {
        spacing *= 0.97 * GAP / (cloud.radius * ratio);
        cloud = sample(&truth, spacing, kind, &mut Dice(5));
    }
    (truth, Cloud::new(&cloud.points, spacing, cloud.radius), spacing)
}

/// Pixels that truly show the near wall.
fn near_wall(image: &Image) -> Vec<usize> {
    let is_near = |p: &usize| image.pixels[*p].is_some_and(|seen| seen.part == 0);
    (0..image.pixels.len()).filter(is_near).collect()
}

#[test]
fn a_wall_hides_a_parallel_wall_behind_it_if_the_gap_exceeds_the_radius() {
    for (ratio, kind) in [(1.15, Kind::Poisson), (1.15, Kind::Regular), (3.0, Kind::Poisson)] {
        let (truth, cloud, spacing) = covered_walls(ratio, kind);
        for spacing_px in [1.0, 4.0] {
            for degrees in [0.0, 45.0, 70.0, 80.0, 85.0] {
                let view = walls_view(SIDE, degrees, f64::from(SIDE) * spacing / spacing_px);
                let image = Image::new(&truth, &view);
                let drawn = cloud.draw(&view, true);
                let what = format!("ratio {ratio}, {kind:?}, {spacing_px} px, {degrees} degrees");
                let near = near_wall(&image);
                let bleeding = near.iter().filter(|&&p| drawn.bleeds(&image, p)).count();
                // On a grid seen edge on, the mean of several discs may cover less than the discs
                // do.
                let is_edge_on = kind == Kind::Regular && spacing_px > 1.0 && degrees > 75.0;
                assert!(bleeding <= if is_edge_on { 2 } else { 0 }, "{bleeding}: {what}");
                let blue = |p: usize| drawn.picture.rgba[p * 4 + 2] > drawn.picture.rgba[p * 4];
                // Trimmed outlines may lie a few pixels inside the true ones.
                let blue = near.iter().filter(|&&p| image.is_inside(p, 6) && blue(p)).count();
                assert_eq!(blue, 0, "blue: {what}");
            }
        }
    }
}

/// Here the step to the far wall is hardly more than half of the drawn radius, and smaller than an
/// edge of depth.
#[test]
fn a_wall_seen_from_the_front_hides_a_wall_one_radius_behind_it() {
    let spacing = GAP / 1.05 / 0.9;
    for seed in 5..9 {
        let truth = walls(GAP, f64::from(SIDE) * spacing * 2.0);
        let view = walls_view(SIDE, 0.0, f64::from(SIDE) * spacing / 1.5);
        let points = sample(&truth, spacing, Kind::Poisson, &mut Dice(seed)).points;
        let (image, cloud) = (Image::new(&truth, &view), Cloud::new(&points, spacing, GAP / 1.05));
        assert_eq!(cloud.draw(&view, true).bleeding(&image), 0, "seed {seed}");
    }
}

/// Planes are fitted where discs are at most 4 pixels wide, so samples are 1.5 pixels apart and no
/// view is nearly edge on.
#[test]
fn without_normals_a_wall_hides_nearly_all_of_a_wall_behind_it() {
    for (ratio, most) in [(1.15, 0.02), (1.5, 0.004)] {
        let (truth, cloud, spacing) = covered_walls(ratio, Kind::Poisson);
        for degrees in [0.0, 45.0, 70.0, 80.0] {
            let view = walls_view(SIDE, degrees, f64::from(SIDE) * spacing / 1.5);
            let image = Image::new(&truth, &view);
            let near = near_wall(&image);
            let [fitted, published] =
                [cloud.draw(&view, false), cloud.draw_published(&view, false)]
                    .map(|drawn| near.iter().filter(|&&p| drawn.bleeds(&image, p)).count());
            let what =
                format!("{fitted}, published {published} of {}: {ratio}, {degrees}", near.len());
            assert!(fitted as f64 <= most * near.len() as f64 && fitted <= published, "{what}");
        }
    }
}

/// This holds for samples about a pixel apart. At larger distances more shows through than with the
/// published intervals, because shorter intervals would tear the edges of sparse solids
/// (docs/design/surfaces.md).
#[test]
fn dense_walls_closer_than_a_radius_bleed_less_than_published_at_grazing_angles() {
    for ratio in [0.5, 0.75] {
        let (truth, cloud, spacing) = covered_walls(ratio, Kind::Poisson);
        for degrees in [80.0, 85.0] {
            let view = walls_view(SIDE, degrees, f64::from(SIDE) * spacing / 1.5);
            let image = Image::new(&truth, &view);
            let near = near_wall(&image);
            let bleeding = [cloud.draw(&view, true), cloud.draw_published(&view, true)]
                .map(|drawn| near.iter().filter(|&&p| drawn.bleeds(&image, p)).count());
            let what = format!("{bleeding:?}: ratio {ratio}, {degrees} degrees");
            assert!(bleeding[0] < bleeding[1], "{what}");
        }
    }
}

/// Lighting of [`esker_render::passes::shade`] (marroquim2007, section 3.4): the factor of the
/// colour, and the highlight that is added.
fn phong(normal: DVec3, to_eye: DVec3) -> (f64, f64) {
    let key = DVec3::new(-0.42, 0.60, 0.6808);
    let facing = normal.dot(key);
    let ambient = 0.12 + 0.18 * (0.5 + 0.5 * normal.y);
    let light = ambient + 0.62 * facing.max(0.0) + 0.16 * normal.dot(to_eye).max(0.0);
    let mirrored = normal * (2.0 * facing) - key;
    (light, if facing > 0.0 { 0.10 * mirrored.dot(to_eye).max(0.0).powi(24) } else { 0.0 })
}

#[test]
fn figure_7_deferred_shading_has_sharper_highlights_than_shading_each_splat() {
    const DARK: [u8; 3] = [70, 40, 30];
    let (_, truth, view) = scenes(SIDE).remove(0);
    let truth = Truth { parts: vec![(truth.parts[0].0, Paint::Plain(DARK))] };
    let image = Image::new(&truth, &view);
    let to_view = view.view_from_world();
    let lit = |normal: DVec3, at: DVec3| {
        let (light, shine) = phong(normal, -at.normalize_or_zero());
        linear(DARK) * light as f32 + Vec3::splat(shine as f32)
    };
    for spacing_px in [3.0, 5.0] {
        let spacing = spacing_px * view.eye.length() / view.focal_px();
        let s = sample(&truth, spacing, Kind::Poisson, &mut Dice(21));
        let deferred = Cloud::new(&s.points, spacing, s.radius).draw(&view, true);
        // Figure 7a of marroquim2007: splats are lit, then their colours are interpolated.
        let mut points = s.points.clone();
        for p in &mut points {
            let colour = lit(to_view * p.normal, to_view * (p.at - view.eye));
            p.colour = Encoder::get().bytes(colour);
        }
        let splats = Cloud::new(&points, spacing, s.radius).draw(&view, true);
        let (mut off, mut peaks, mut count) = ([0.0; 2], [0f64; 3], 0.0);
        for (pixel, seen) in image.pixels.iter().enumerate() {
            let Some(seen) = seen.filter(|_| image.is_inside(pixel, 4)) else { continue };
            let place = DVec2::new((pixel % SIDE as usize) as f64, (pixel / SIDE as usize) as f64);
            let at = to_view * Truth::ray(&view, place + 0.5) * seen.depth;
            let wanted = srgb(lit(seen.normal, at));
            let [r, g, b] = [0, 1, 2].map(|k| f32::from(deferred.picture.rgba[pixel * 4 + k]));
            let got = [Vec3::new(r, g, b), srgb(splats.level.tint[pixel].truncate())];
            for (off, got) in off.iter_mut().zip(got) {
                *off += f64::from((got - wanted).length_squared()) / 3.0;
            }
            for (peak, of) in peaks.iter_mut().zip([got[0], got[1], wanted]) {
                *peak = peak.max(f64::from(of.element_sum()) / 3.0);
            }
            count += 1.0;
        }
        let [deferred, splats] = off.map(|sum: f64| (sum / f64::max(count, 1.0)).sqrt());
        let what = format!("{spacing_px} px: errors {deferred:.2}, {splats:.2}; peaks {peaks:.1?}");
        assert!(count > 1000.0 && deferred < 0.7 * splats, "{what}");
        assert!((peaks[0] - peaks[2]).abs() < 0.5 * (peaks[1] - peaks[2]).abs().max(2.0), "{what}");
    }
}

#[test]
fn means_of_crowded_points_are_nearer_to_the_truth_and_flicker_less() {
    let (_, truth, view) = scenes(SIDE).remove(0);
    let pixel = view.eye.length() / view.focal_px();
    let fine = Paint::Checks(2.3 * pixel, [230, 220, 210], [40, 60, 80]);
    let fine = Truth { parts: truth.parts.iter().map(|(shape, _)| (*shape, fine)).collect() };
    // Greatest error and flicker of means, as shares of those with the nearest point of each pixel.
    for (truth, density, error, flickers) in [
        (&truth, 2.0, 0.7, 0.9),
        (&truth, 4.0, 0.65, 0.8),
        (&fine, 2.0, 0.75, 0.85),
        (&fine, 4.0, 0.5, 0.6),
    ] {
        let image = Image::new(truth, &view);
        let spacing = pixel / f64::sqrt(density);
        let s = sample(truth, spacing, Kind::Poisson, &mut Dice(17));
        let path = orbit(&view, 3, 0.25);
        for normals in [true, false] {
            let [mean, one] = [true, false].map(|averages| {
                let mut cloud = Cloud::new(&s.points, spacing, s.radius);
                cloud.averages = averages;
                let drawn = cloud.draw(&view, normals);
                assert_eq!(drawn.picture.stats.stages.ms(Pass::Average) > 0.0, averages);
                (drawn.errors(&image), flicker(&cloud, truth, &path, normals))
            });
            let what = format!("{density} points a pixel, {normals}: {mean:?}, one wins: {one:?}");
            assert!(mean.0.colour <= error * one.0.colour, "{what}");
            assert!(mean.1.colour <= flickers * one.1.colour, "{what}");
            assert!(mean.0.holes == 0 && mean.0.bleeding == 0, "{what}");
        }
    }
}

/// Scans with normals and scans without may be drawn together, and some normals cannot be
/// estimated.
#[test]
fn crowded_points_without_normals_hide_surfaces_behind_them() {
    let view = walls_view(SIDE, 0.0, 1.0);
    let truth = walls(0.5, 2.0);
    let spacing = 1.0 / f64::from(SIDE) / 1.6;
    let points = sample(&truth, spacing, Kind::Poisson, &mut Dice(3)).points;
    let of = |colour: [u8; 3]| {
        let own: Vec<_> = points.iter().filter(|p| p.colour == colour).copied().collect();
        Scene::new(&own, 1e-6, spacing, spacing, 1 << 15)
    };
    let (near, far) = (of([255, 0, 0]), of([0, 0, 255]));
    let tints = [true, false].map(|has_normals| {
        let mut draws = near.draws(true, true, has_normals);
        draws.extend(far.draws(true, true, true));
        let frame = near.frame(&view, &draws);
        assert!(FramePlan::new(&frame).averages());
        let picture = Renderer::default().render(&frame).unwrap();
        let middle = ((SIDE / 2 * SIDE + SIDE / 2) * 4) as usize;
        [picture.rgba[middle], picture.rgba[middle + 1], picture.rgba[middle + 2]]
    });
    // Surfaces of unknown direction are lit as if they faced the eye.
    assert!(tints[1][0].abs_diff(tints[0][0]) <= 8 && tints[1][2] < 40, "{tints:?}");
}

#[test]
fn smoothed_pixels_are_nearer_to_the_truth_and_flicker_less_and_edges_stay() {
    for (name, truth, view) in scenes(SIDE) {
        if !["sphere", "cube", "torus"].contains(&name) {
            continue;
        }
        let image = Image::new(&truth, &view);
        let pixel = view.eye.length() / view.focal_px();
        // Greatest error and flicker, as shares of those of pixels that are not smoothed.
        for (density, error, flickers) in [(1.0, 0.93, 0.75), (0.5, 0.98, 0.88), (0.1, 1.01, 0.97)]
        {
            let spacing = pixel / f64::sqrt(density);
            let s = sample(&truth, spacing, Kind::Poisson, &mut Dice(17));
            let path = orbit(&view, 3, 0.25);
            let [smooth, plain] = [true, false].map(|averages| {
                let mut cloud = Cloud::new(&s.points, spacing, s.radius);
                cloud.averages = averages;
                let drawn = cloud.draw(&view, true);
                (drawn.errors(&image), flicker(&cloud, &truth, &path, true))
            });
            let what = format!("{name}, {density} points a pixel: {smooth:?}, plain: {plain:?}");
            assert!(smooth.0.colour <= error * plain.0.colour, "{what}");
            assert!(smooth.1.colour <= flickers * plain.1.colour, "{what}");
            assert!(smooth.0.normal_deg <= plain.0.normal_deg * 1.02 + 0.005, "{what}");
            assert!(smooth.0.depth_px <= plain.0.depth_px * 1.02, "{what}");
            assert!(smooth.0.holes == 0 && smooth.0.bleeding <= plain.0.bleeding, "{what}");
        }
    }
}

#[test]
fn closed_surfaces_whose_radii_cover_them_have_no_holes() {
    let closed = ["sphere", "cube", "torus", "checks"];
    for (name, truth, view) in scenes(SIDE).into_iter().filter(|s| closed.contains(&s.0)) {
        let image = Image::new(&truth, &view);
        for density in [0.05, 0.1, 1.0, 4.0] {
            for kind in [Kind::Regular, Kind::Poisson] {
                let cloud = Cloud::of(&truth, &view, density, kind, &mut Dice(7));
                for normals in [true, false] {
                    let drawn = cloud.draw(&view, normals);
                    let what = format!("{name}, {density} points a pixel, {kind:?}, {normals}");
                    assert_eq!(drawn.holes(&image), 0, "{what}");
                    // If points are sparse and have no normals, sides show through edges in front.
                    let most = if normals || density > 0.5 { 0 } else { 75 };
                    let bleeding = drawn.bleeding(&image);
                    assert!(bleeding <= most, "bleeding {bleeding}: {what}");
                }
            }
        }
    }
}

/// Bounds by scene and points a pixel, with normals and without: errors of colour (of 255), depth
/// (widths of a pixel) and normals (degrees).
type Bounds = (&'static str, [(f64, [[f64; 3]; 2]); 4]);
#[rustfmt::skip]
const BOUNDS: [Bounds; 4] = [
    ("sphere", [
        (0.05, [[36.4, 0.92, 2.24], [35.7, 1.07, 5.64]]),
        (0.25, [[13.4, 0.14, 0.96], [13.3, 0.17, 1.73]]),
        (1.0, [[7.8, 0.04, 0.80], [7.0, 0.12, 1.16]]),
        (4.0, [[2.7, 0.03, 0.29], [5.8, 0.08, 1.13]]),
    ]),
    ("cube", [
        (0.05, [[27.5, 0.40, 3.30], [28.1, 1.19, 8.33]]),
        (0.25, [[11.1, 0.06, 0.57], [11.2, 0.22, 3.90]]),
        (1.0, [[8.1, 0.01, 0.07], [8.0, 0.11, 3.36]]),
        (4.0, [[1.9, 0.01, 0.01], [7.2, 0.12, 3.45]]),
    ]),
    ("torus", [
        (0.05, [[43.8, 1.02, 5.06], [45.9, 1.39, 11.49]]),
        (0.25, [[17.8, 0.18, 2.38], [18.4, 0.26, 4.14]]),
        (1.0, [[10.6, 0.05, 1.83], [11.3, 0.18, 3.12]]),
        (4.0, [[3.4, 0.04, 0.60], [7.3, 0.14, 3.24]]),
    ]),
    ("checks", [
        (0.05, [[50.7, 0.01, 0.01], [49.7, 1.87, 5.43]]),
        (0.25, [[42.9, 0.08, 0.01], [33.1, 0.21, 1.60]]),
        (1.0, [[15.9, 0.15, 0.01], [15.9, 0.17, 1.02]]),
        (4.0, [[12.4, 0.18, 0.01], [12.5, 0.22, 0.96]]),
    ]),
];

#[test]
fn colours_depths_and_normals_are_near_the_truth_from_0_05_to_4_points_a_pixel() {
    for (name, truth, view) in scenes(SIDE) {
        let Some((_, bounds)) = BOUNDS.into_iter().find(|(of, _)| *of == name) else { continue };
        let image = Image::new(&truth, &view);
        for (density, bounds) in bounds {
            let cloud = Cloud::of(&truth, &view, density, Kind::Poisson, &mut Dice(17));
            for (normals, [colour, depth, normal]) in [true, false].into_iter().zip(bounds) {
                let errors = cloud.draw(&view, normals).errors(&image);
                let what =
                    format!("{name}, {density} points a pixel, normals {normals}: {errors:.2?}");
                let is_near = errors.depth_px < depth && errors.normal_deg < normal;
                assert!(is_near && errors.colour < colour, "{what}");
            }
        }
    }
}
