//! Claims about what surfaces hide and close, against analytic scenes.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;
mod truth;

use scene::Dice;
use truth::measure::{Cloud, Image};
use truth::sample::{Kind, sample};
use truth::{scenes, walls, walls_view};

const SIDE: u32 = 80;

#[test]
fn nothing_of_a_wall_shows_through_a_parallel_one_before_it_where_the_gap_exceeds_the_radius() {
    let gap = 0.01;
    for (ratio, kind) in [(1.15, Kind::Poisson), (1.15, Kind::Regular), (3.0, Kind::Poisson)] {
        // Both walls a centimetre apart; the radius that covers them as the ratio asks.
        let truth = walls(gap, 0.7);
        let factor = if kind == Kind::Regular { 0.729 } else { 0.9 };
        let mut spacing = gap / ratio / factor;
        let mut cloud = sample(&truth, spacing, kind, &mut Dice(5));
        while cloud.radius * ratio > gap {
            spacing *= 0.97 * gap / (cloud.radius * ratio);
            cloud = sample(&truth, spacing, kind, &mut Dice(5));
        }
        let radius = cloud.radius;
        let cloud = Cloud::new(&cloud.points, spacing, radius);
        for (spacing_px, degrees) in [(1.0, 0.0), (1.0, 45.0), (1.0, 80.0), (4.0, 0.0), (4.0, 45.0)]
        {
            {
                let view = walls_view(SIDE, degrees, f64::from(SIDE) * spacing / spacing_px);
                let image = Image::new(&truth, &view);
                let drawn = cloud.draw(&view, true);
                let what = format!("ratio {ratio}, {kind:?}, {spacing_px} px, {degrees} degrees");
                assert_eq!(drawn.bleeding(&image), 0, "{what}");
                let blue = |p: usize| drawn.picture.rgba[p * 4 + 2] > drawn.picture.rgba[p * 4];
                // Trimmed outlines may lie a few pixels inside.
                let inside = (0..image.seen.len()).filter(|&p| image.is_inside(p, 6));
                assert_eq!(inside.filter(|&p| blue(p)).count(), 0, "blue: {what}");
            }
        }
    }
}

#[test]
fn closed_surfaces_whose_radii_cover_them_have_no_holes() {
    for (name, truth, view) in
        scenes(SIDE).into_iter().filter(|s| ["sphere", "cube", "torus"].contains(&s.0))
    {
        let image = Image::new(&truth, &view);
        for density in [0.1, 1.0] {
            for kind in [Kind::Regular, Kind::Poisson] {
                let spacing = view.eye.length() / view.focal_px() / f64::sqrt(density);
                let s = sample(&truth, spacing, kind, &mut Dice(7));
                let cloud = Cloud::new(&s.points, spacing, s.radius);
                for normals in [true, false] {
                    let drawn = cloud.draw(&view, normals);
                    let what = format!("{name}, {density} points a pixel, {kind:?}, {normals}");
                    assert_eq!(drawn.holes(&image), 0, "{what}");
                    assert!(!normals || drawn.bleeding(&image) == 0, "bleeding: {what}");
                }
            }
        }
    }
}
