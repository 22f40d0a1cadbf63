//! What plans leave out as not needed changes no bit of a picture: silhouettes where push fills
//! nothing, and dots where there are none.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::gpu::GpuRenderer;
use esker_render::{Frame, FramePlan, Pass, PassChoice, PassSet, Picture, render};
use glam::DVec3;
use gpu::{few_gpus, name, upload, uploaded_frame};
use scene::{Dice, Scene, speckled, sphere};

const PAGE_BYTES: u64 = 64 << 10;

fn view() -> View {
    View::look_at(DVec3::new(2.6, -3.1, 2.4), DVec3::Z * 0.5, DVec3::Z, 0.9, 173, 97)
}

/// A ball of few points with wide discs, of which many pixels stick out after push.
fn sparse() -> Scene {
    let points = sphere(&mut Dice(3), DVec3::Z, 1.0, 700, [220, 90, 50]);
    Scene::new(&points, 1e-5, 0.15, 0.15, 300)
}

fn is_equal(a: &Picture, b: &Picture) -> bool {
    let bits = |picture: &Picture| picture.depth.iter().map(|d| d.to_bits()).collect::<Vec<_>>();
    a.rgba == b.rgba && bits(a) == bits(b)
}

/// The choices without push, without and with silhouettes.
fn choices() -> [PassChoice; 2] {
    let skipped = PassSet::of(&[Pass::Push]);
    [PassSet::default(), PassSet::of(&[Pass::Silhouette])]
        .map(|forced| PassChoice { skipped, forced })
}

/// Frames whose pixels come from push in none of their forms.
fn frames<'a>(frame: Frame<'a>) -> Vec<Frame<'a>> {
    let crowded = |crowding| Frame { crowding: Some(crowding), ..frame };
    vec![crowded(0.0), crowded(0.5), crowded(1.0), Frame { mixes_dots: true, ..frame }]
}

#[test]
fn silhouettes_change_no_bit_where_push_fills_nothing() {
    let (view, [without, with]) = (view(), choices());
    for (scene, normals) in
        [speckled(), sparse()].iter().flat_map(|scene| [(scene, true), (scene, false)])
    {
        let draws = scene.draws(true, true, normals);
        for frame in frames(scene.frame(&view, &draws)) {
            let [short, long] = [without, with].map(|passes| Frame { passes, ..frame });
            let trims = |frame| FramePlan::new(frame).passes.contains(&Pass::Silhouette);
            assert!(!trims(&short) && trims(&long));
            assert!(is_equal(&render(&short).unwrap(), &render(&long).unwrap()));
        }
    }
    // With push they do.
    let scene = sparse();
    let draws = scene.draws(true, true, true);
    let frame = scene.frame(&view, &draws);
    let skipped = PassSet::of(&[Pass::Silhouette]);
    let rough = Frame { passes: PassChoice { skipped, ..PassChoice::default() }, ..frame };
    assert!(!is_equal(&render(&frame).unwrap(), &render(&rough).unwrap()));
}

#[test]
fn silhouettes_change_no_bit_on_gpus_where_push_fills_nothing() {
    let (view, scene) = (view(), sparse());
    for gpu in few_gpus() {
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        for normals in [true, false] {
            let draws = scene.draws(true, true, normals);
            let uploaded = upload(&gpu, &draws, PAGE_BYTES);
            let [short, long] = choices().map(|passes| {
                let frame = Frame { passes, ..scene.frame(&view, &draws) };
                let frame = uploaded_frame(&frame, &uploaded.draws);
                renderer.render(&frame, &uploaded.pool).unwrap();
                renderer.read().unwrap()
            });
            assert!(is_equal(&short, &long), "normals {normals} on {}", name(&gpu));
        }
        assert_eq!(gpu.fault(), None, "{}", name(&gpu));
    }
}

#[test]
fn dots_change_no_bit_where_there_are_none() {
    let (view, scene) = (view(), speckled());
    for normals in [true, false] {
        let draws = scene.draws(true, true, normals);
        let plain = scene.frame(&view, &draws);
        let mixed = Frame { mixes_dots: true, ..plain };
        let mut dots = mixed;
        dots.dots.eye_dome = 1.0;
        let [plain, mixed, dots] = [plain, mixed, dots].map(|frame| render(&frame).unwrap());
        assert!(is_equal(&plain, &mixed) && is_equal(&plain, &dots), "normals {normals}");
        assert_eq!(plain.stats.pixels_covered, mixed.stats.pixels_covered);
        assert_eq!(plain.stats.pixels_projected, mixed.stats.pixels_projected);
    }
}
