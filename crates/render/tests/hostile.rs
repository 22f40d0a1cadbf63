//! Any bytes in planes and node records give a valid picture: the right size, no depth that is not
//! a number, no panic.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_points::{AttrType, Lattice, Node};
use esker_render::passes::pull;
use esker_render::passes::push;
use esker_render::picture::pyramid::Pyramid;
use esker_render::{
    Codebook, ColourBy, ColourMap, ColourPlane, DrawNode, Frame, Gradient, Method, RenderError,
    Renderer,
};
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use scene::{Dice, Scene, sphere};

fn colour_by() -> impl Strategy<Value = ColourBy> {
    let number = prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(0.0), -1e9f64..1e9];
    (0..9, number.clone(), number).prop_map(|(kind, low, high)| {
        let map = ColourMap { low, high, gradient: Gradient::Terrain };
        match kind {
            0 => ColourBy::Plain,
            1 => ColourBy::Rgb,
            2 => ColourBy::Scalar(map),
            3 => ColourBy::Codes(Codebook::Classes),
            8 => ColourBy::Codes(Codebook::Own([[9; 3]; 256])),
            4 => ColourBy::Coordinate(low.to_bits() as usize % 4, map),
            5 => ColourBy::EyeDepth(map),
            6 => ColourBy::Cell,
            _ => ColourBy::Normal,
        }
    })
}

fn plane(bytes: usize) -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), 0..bytes)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_bits_give_a_valid_picture(
        record: [[u8; 16]; 9],
        position in plane(4000),
        residual in prop::option::of(plane(3000)),
        colours in plane(2000),
        normal in prop::option::of(plane(2000)),
        prefix in prop_oneof![0usize..600, Just(usize::MAX)],
        plain_place: bool,
        scalar in prop::option::of(0usize..11),
        colour in colour_by(),
        (width, height) in (1u32..40, 1u32..40),
        cull_back_faces: bool,
        clips: bool,
        method in 0usize..3,
        scale in prop_oneof![Just(1e-3), Just(1e-300), Just(1e300), Just(2f64.powi(-30))],
    ) {
        let mut node: Node = bytemuck::pod_read_unaligned(&record.concat());
        if plain_place {
            // At the target of the camera, so that points reach the picture.
            (node.box_min, node.hot_shift) = ([2_147_483_648; 3], 0);
        }
        let types = [AttrType::U8, AttrType::I8, AttrType::U16, AttrType::I16, AttrType::U32,
            AttrType::I32, AttrType::U64, AttrType::I64, AttrType::F32, AttrType::F64];
        let draw = DrawNode {
            node: &node,
            entry: 0,
            prefix, above: 0.0,
            position: &position[..],
            residual: residual.as_deref(),
            colour: scalar.map_or(ColourPlane::Rgba(&colours[..]),
                |ty| match types.get(ty) {
                    Some(&ty) => ColourPlane::Scalar { bytes: &colours[..], ty },
                    None => ColourPlane::Indexed,
                }),
            normal: normal.as_deref(),
            clip: clips.then_some(&colours[..]),
            tangents: clips.then_some(&colours[..]),
        };
        let lattice = Lattice { scale: [scale; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let target = DVec3::splat(32_768.0) * scale.clamp(1e-200, 1e200);
        let view = View::look_at(target * 3.0, target, DVec3::Z, 1.0, width, height);
        let draws = [draw, draw];
        let method = [Method::Points, Method::PullPush, Method::Ewa][method];
        let frame = Frame { method, colour, cull_back_faces, ..Frame::new(&view, &lattice, &draws) };
        let mut renderer = Renderer::default();
        let picture = match renderer.render(&frame) {
            Ok(picture) => picture,
            // Coordinates of 10^300 are refused.
            Err(e) => { { let camera = matches!(e, RenderError::Camera { .. }); prop_assert!(camera, "{}", e) }; return Ok(()) }
        };
        prop_assert_eq!(picture.rgba.len(), (width * height * 4) as usize);
        prop_assert!(picture.depth.iter().all(|&d| d > 0.0));
        let covered = picture.depth.iter().filter(|d| d.is_finite()).count() as u64;
        prop_assert_eq!(picture.stats.pixels_covered, covered);
        let mut pyramid = Pyramid::default();
        renderer.base_level(&frame, &mut pyramid).unwrap();
        pull::pull(&mut pyramid);
        push::push(&mut pyramid);
        for level in &pyramid.levels {
            for i in (0..level.front.len()).filter(|&i| level.is_valid(i)) {
                prop_assert!(level.front[i].is_finite() && level.tint[i].is_finite());
                prop_assert!(level.depth[i].is_finite());
                prop_assert!(level.normal.get(i).is_none_or(|n| n.is_finite()));
            }
        }
    }
}

#[test]
fn invalid_cameras_and_pictures_too_large_are_refused() {
    let scene =
        Scene::new(&sphere(&mut Dice(1), DVec3::ZERO, 1.0, 10, [0; 3]), 1e-3, 0.1, 0.1, 100);
    let good = View::look_at(DVec3::X * 3.0, DVec3::ZERO, DVec3::Z, 1.0, 8, 8);
    let refused = |view: View| Renderer::default().render(&scene.frame(&view, &[])).is_err();
    assert!(!refused(good));
    assert!(refused(View { eye: DVec3::splat(f64::NAN), ..good }));
    assert!(refused(View { world_from_view: DMat3::from_cols_array(&[f64::NAN; 9]), ..good }));
    assert!(refused(View { fovy_rad: f64::NAN, ..good }));
    assert!(refused(View { fovy_rad: 0.0, ..good }));
    assert!(refused(View { near: 0.0, ..good }));
    assert!(refused(View { width: 0, ..good }));
    assert!(refused(View { width: u32::MAX, ..good }));
    assert!(refused(View { width: 16_384, height: 16_384, ..good }));
}
