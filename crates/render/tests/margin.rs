//! The margin around pictures: at its border a picture equals a larger picture of the same scene,
//! and scenes that lie within the picture are drawn without a margin.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::picture::margin::{MARGIN_PX, goes_beyond};
use esker_render::{Background, Frame, FramePlan, Method, Picture, render};
use glam::{DVec2, DVec3};
use scene::{Dice, Scene, ScenePoint};

const SIZE: [u32; 2] = [150, 110];
/// Width by which the larger picture exceeds the other on each side, pixels.
const BEYOND: u32 = 96;

/// View of the floor from above, with a picture that is `more` pixels larger on each side.
fn view(more: u32) -> View {
    let [width, height] = SIZE.map(|side| side + 2 * more);
    // A pixel at unit distance is 0.01 wide.
    let fovy = (f64::from(height) / 200.0).atan() * 2.0;
    View::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y, fovy, width, height)
}

/// A checkered floor with hollows, points `apart_px` pixels apart.
fn floor(apart_px: f64, half: DVec2) -> Scene {
    let mut dice = Dice(5);
    let spacing = apart_px / 100.0;
    let count = (half * 2.0 / spacing).ceil();
    let mut points = Vec::new();
    for (i, j) in (0..count.y as i32).flat_map(|j| (0..count.x as i32).map(move |i| (i, j))) {
        let at =
            DVec2::new(f64::from(i) + dice.unit(), f64::from(j) + dice.unit()) * spacing - half;
        let height = 0.02 * (at.x * 9.0).sin() * (at.y * 7.0).cos();
        let is_light = ((at.x * 4.0).floor() + (at.y * 4.0).floor()) as i32 & 1 == 0;
        points.push(ScenePoint {
            at: at.extend(height),
            normal: DVec3::new(0.0, 0.0, 1.0),
            colour: if is_light { [230, 220, 200] } else { [60, 80, 120] },
        });
    }
    Scene::new(&points, 1e-5, spacing, spacing * 1.5, 3000)
}

/// Share of the pixels within `deep` pixels of the border that differ from the larger picture.
fn share_off(picture: &Picture, larger: &Picture, deep: u32) -> f64 {
    let ([width, height], more) = (SIZE, (larger.width - SIZE[0]) / 2);
    let (mut off, mut all) = (0, 0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if x.min(y).min(width - 1 - x).min(height - 1 - y) < deep {
            let here = picture.rgba.as_chunks::<4>().0[(y * width + x) as usize];
            let there = ((y + more) * larger.width + x + more) as usize;
            let there = larger.rgba.as_chunks::<4>().0[there];
            let worst = (0..4).map(|i| here[i].abs_diff(there[i])).max().unwrap();
            off += u32::from(worst > 12);
            all += 1;
        }
    }
    f64::from(off) / f64::from(all)
}

#[test]
fn the_border_of_a_picture_equals_that_place_in_a_larger_picture() {
    for (apart_px, normals) in [(1.5, true), (1.5, false), (6.0, true), (6.0, false)] {
        let half = (DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0
            + 2.0 * f64::from(BEYOND))
            / 100.0;
        let scene = floor(apart_px, half);
        let draws = scene.draws(true, true, normals);
        let draw = |view: View| render(&scene.frame(&view, &draws)).unwrap();
        let larger = draw(view(BEYOND));
        let [with, without] = [MARGIN_PX, 0].map(|margin| draw(view(0).with_margin(margin)));
        assert_eq!([with.width, with.height], SIZE);
        assert_eq!(with.stats.pixels_covered, u64::from(SIZE[0] * SIZE[1]));
        let [with, without] = [with, without].map(|picture| share_off(&picture, &larger, 2));
        println!("{apart_px} px, {normals}: {with:.4}, without {without:.4}");
        assert!(with < 0.01 && without > 5.0 * with, "{apart_px} px: {with}, without {without}");
    }
}

#[test]
fn only_pull_push_of_scenes_beyond_the_picture_has_a_margin() {
    let view = view(0);
    let bounds = |half: [f64; 3]| [half.map(|h| -h), half];
    assert!(!goes_beyond(&view, bounds([0.7, 0.5, 0.01])));
    assert!(goes_beyond(&view, bounds([0.8, 0.5, 0.01])));
    assert!(goes_beyond(&view, bounds([0.7, 0.56, 0.01])));
    assert!(goes_beyond(&view, bounds([0.1, 0.1, 1.5])), "a part of the box is behind the eye");
    let scene = floor(2.0, DVec2::new(0.5, 0.4));
    let draws = scene.draws(true, true, true);
    let wide = view.with_margin(MARGIN_PX);
    assert_eq!(wide.with_margin(0).focal_px() as f32, view.focal_px() as f32);
    for (method, margin_px) in
        [(Method::PullPush, MARGIN_PX), (Method::Points, 0), (Method::Ewa, 0)]
    {
        let frame = Frame { method, ..scene.frame(&wide, &draws) };
        assert_eq!(FramePlan::new(&frame).margin_px, margin_px);
        let picture = render(&frame).unwrap();
        assert_eq!([picture.width, picture.height], SIZE);
    }
}

#[test]
fn a_margin_does_not_change_the_background() {
    let scene = floor(2.0, DVec2::new(0.9, 0.2));
    let draws = scene.draws(true, true, true);
    let view = view(0);
    let background = Background::Gradient([10, 20, 30], [200, 190, 180]);
    let [with, without] = [MARGIN_PX, 0].map(|margin| {
        let view = view.with_margin(margin);
        render(&Frame { background, ..scene.frame(&view, &draws) }).unwrap()
    });
    let behind = |p: &Picture| -> Vec<[u8; 4]> {
        let rows = p.rgba.as_chunks::<4>().0.chunks(SIZE[0] as usize);
        // The floor crosses the rows in the middle.
        rows.map(|row| row[0])
            .enumerate()
            .filter(|(y, _)| !(25..85).contains(y))
            .map(|r| r.1)
            .collect()
    };
    assert_eq!(behind(&with), behind(&without));
    assert_ne!(behind(&with)[0], behind(&with)[40]);
}
