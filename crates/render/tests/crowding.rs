//! Crowding of a view fades passes in and out: at both ends of its range a picture changes by less
//! than one sees when a pass comes or goes, and in between it changes evenly.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::{Frame, FramePlan, Picture, Renderer};
use glam::DVec3;
use scene::speckled;

/// Share of the pixels that differ by more than 2 of 255 in a channel.
fn changed(a: &Picture, b: &Picture) -> f64 {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 2);
    let pairs = a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
    pairs.filter(|&pair| differs(pair)).count() as f64 / a.depth.len() as f64
}

#[test]
fn passes_come_and_go_without_a_jump() {
    let (scene, eye) = (speckled(), DVec3::new(2.6, -3.1, 2.4));
    let view = View::look_at(eye, DVec3::Z * 0.5, DVec3::Z, 0.9, 200, 150).with_margin(16);
    for normals in [true, false] {
        let draws = scene.draws(true, true, normals);
        let draw = |crowding: f32| {
            let frame = Frame { crowding: Some(crowding), ..scene.frame(&view, &draws) };
            let plan = FramePlan::new(&frame);
            assert_eq!((plan.averages(), plan.smooths), (crowding > 0.0, crowding < 1.0));
            Renderer::default().render(&frame).unwrap()
        };
        let [none, little, much, all] = [0.0, 1e-3, 0.999, 1.0].map(draw);
        for (a, b) in [(&none, &little), (&much, &all)] {
            assert!(changed(a, b) < 0.001, "normals {normals}: {} of the pixels", changed(a, b));
        }
        assert!(changed(&none, &all) > 0.2, "normals {normals}: the passes do nothing");
        // In between, a twentieth of the range changes colours by at most a tenth of the whole.
        let far = |a: &Picture, b: &Picture| -> u64 {
            a.rgba.iter().zip(&b.rgba).map(|(a, b)| u64::from(a.abs_diff(*b))).sum()
        };
        for at in [0.25, 0.5, 0.7] {
            let step = far(&draw(at), &draw(at + 0.05));
            assert!(step * 10 <= far(&none, &all), "normals {normals}, {at}");
        }
    }
}
