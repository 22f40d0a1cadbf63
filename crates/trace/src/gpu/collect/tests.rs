//! Discs that a GPU collects from pages are those that the CPU makes of the same frame, in the same
//! order, and their scenes stop the same rays.

use super::*;
use crate::gpu::scene::GpuDisc;
use crate::gpu::{GpuHit, SceneKernels};
use crate::ray::Ray;
use crate::scene::SplatInput;
use crate::scene::splats::{disc_of, is_fine};
use esker_lod::View;
use esker_points::AttrType;
use esker_render::{Codebook, ColourBy, ColourMap, ColourPlane, DrawNode, Gradient, splats};
use gpus::gpus;
use scene::{Dice, Scene, sphere};

#[path = "../../../tests/gpus/mod.rs"]
mod gpus;
#[path = "../../../../render/tests/scene/mod.rs"]
#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

/// Bytes of a page: the planes of a node lie in several.
const PAGE_BYTES: u64 = 64 << 10;
/// Places differ by the rounding of a sum and of a product, which a compiler may join.
const ROUNDING: f32 = 2.0 * f32::EPSILON;

/// A ball whose points have different colours, in nodes of 2,500 points; those of one node have no
/// extent.
fn ball() -> Scene {
    let mut dice = Dice(5);
    let mut points = sphere(&mut dice, DVec3::ZERO, 1.0, 9000, [200, 90, 30]);
    for p in &mut points {
        p.colour = p.colour.map(|c| c.wrapping_add(dice.bits() as u8 % 90));
    }
    let mut scene = Scene::new(&points, 2f64.powi(-20), 0.03, 0.03, 2500);
    scene.nodes[2].node.spacing = 0.0;
    scene
}

/// Writes planes to a pool, and gives their places.
fn upload<'a>(gpu: &Gpu, draws: &[DrawNode<'a>]) -> (NodePool, Vec<DrawNode<'a, PlaneAt>>) {
    let mut pool = NodePool::with_pages(gpu, 1 << 30, PAGE_BYTES);
    let mut next = 0;
    let mut put = |bytes: &[u8]| {
        let size = bytes.len() as u64;
        if next % PAGE_BYTES + size.next_multiple_of(4) > PAGE_BYTES {
            next = next.next_multiple_of(PAGE_BYTES);
        }
        let at = PlaneAt { offset: next, bytes: size };
        pool.write(gpu, at.offset, bytes).unwrap();
        next = (next + size).next_multiple_of(256);
        at
    };
    let placed = draws.iter().map(|d| DrawNode {
        node: d.node,
        entry: d.entry,
        prefix: d.prefix,
        above: d.above,
        position: put(d.position),
        residual: d.residual.map(&mut put),
        colour: match d.colour {
            ColourPlane::None => ColourPlane::None,
            ColourPlane::Indexed => ColourPlane::Indexed,
            ColourPlane::Rgba(bytes) => ColourPlane::Rgba(put(bytes)),
            ColourPlane::Scalar { bytes, ty } => ColourPlane::Scalar { bytes: put(bytes), ty },
        },
        normal: d.normal.map(&mut put),
        clip: None,
        tangents: None,
    });
    let placed = placed.collect();
    (pool, placed)
}

/// Discs of a frame as the CPU makes them.
fn discs_on_cpu(frame: &Frame<'_>, albedo: Albedo, origin: DVec3) -> Vec<GpuDisc> {
    let splats = splats(frame, origin);
    let input = SplatInput { splats: &splats, albedo, ..SplatInput::default() };
    let rule = input.albedo_rule();
    let fine = splats.iter().enumerate().filter(|(_, splat)| is_fine(splat));
    fine.map(|(i, splat)| GpuDisc::new(&disc_of(splat, input.tint(i, rule)))).collect()
}

fn is_same(got: &GpuDisc, want: &GpuDisc) -> bool {
    let near = |a: f32, b: f32| (a - b).abs() <= ROUNDING * b.abs();
    let places = got.centre.iter().zip(want.centre).all(|(&a, b)| near(a, b));
    let codes = got.normal.iter().zip(want.normal).all(|(&a, b)| a.abs_diff(b) <= 1);
    let tints = got.tint.iter().zip(want.tint).all(|(&a, b)| a.abs_diff(b) <= 1);
    places && codes && tints && got.radius == want.radius
}

#[test]
fn collected_discs_equal_those_of_the_cpu() {
    let view = View::look_at(DVec3::NEG_Y * 4.0, DVec3::ZERO, DVec3::Z, 0.6, 64, 48);
    let (scene, origin) = (ball(), DVec3::new(0.25, -0.5, 0.125));
    let book = Codebook::Own(std::array::from_fn(|i| [i as u8, 200, 255 - i as u8]));
    let map = ColourMap { low: 0.0, high: 60_000.0, gradient: Gradient::Grey };
    // With and without normals and residuals; colours as they are, of a palette, of values, none.
    let cases = [
        (true, true, ColourBy::Rgb, Albedo::Rgb),
        (false, false, ColourBy::Rgb, Albedo::Rgb),
        (true, false, ColourBy::Codes(book), Albedo::Rgb),
        (true, true, ColourBy::Scalar(map), Albedo::Rgb),
        (false, true, ColourBy::Plain, Albedo::Plain([0.55, 0.5, 0.45])),
        (true, true, ColourBy::Rgb, Albedo::AsIs),
    ];
    for gpu in gpus() {
        let mut collector = SceneCollector::new(&gpu).unwrap();
        for (case, (normals, residuals, colour, albedo)) in cases.into_iter().enumerate() {
            let mut draws = scene.draws(residuals, true, normals);
            for (draw, node) in draws.iter_mut().zip(&scene.nodes) {
                match colour {
                    ColourBy::Codes(_) => draw.colour = ColourPlane::Indexed,
                    ColourBy::Scalar(_) => draw.colour = Scene::scalar(node, AttrType::U16),
                    _ => (),
                }
            }
            let frame = Frame { colour, ..scene.frame(&view, &draws) };
            let want = discs_on_cpu(&frame, albedo, origin);
            let (pool, placed) = upload(&gpu, &draws);
            let on_gpu = frame.with_draws(&placed);
            let made = collector.splats.make(&gpu, &on_gpu, &pool, origin).unwrap();
            let measures = collector.measure(&gpu, &made).unwrap();
            collector.tint(&gpu, &made, &measures, albedo).unwrap();
            let read = readback::read(&gpu, &[(&made.splats, u64::from(measures.count) * 32)]);
            let got: Vec<GpuDisc> = pod_collect_to_vec(&read.unwrap()[0]);
            let got: Vec<_> = got.into_iter().filter(|disc| disc.radius > 0.0).collect();
            assert_eq!((measures.given, measures.fine), (9000, want.len()), "case {case}");
            assert_eq!(got.len(), want.len(), "case {case}");
            for (got, want) in got.iter().zip(&want) {
                assert!(is_same(got, want), "{}, case {case}: {got:?}, {want:?}", gpu.name);
            }
            let mut bounds = Bounds::EMPTY;
            for disc in &got {
                bounds = bounds.union(&Bounds::of_point(disc.centre.into()));
            }
            assert_eq!(measures.centres, bounds, "case {case}");
            assert_eq!(gpu.fault(), None);
        }
    }
}

/// Whether two hits are equal but for rounding: trees of other groups of discs blend in another
/// order.
fn is_same_hit(got: Option<GpuHit>, want: Option<GpuHit>) -> bool {
    let Some((got, want)) = got.zip(want) else { return got.is_none() && want.is_none() };
    (got.distance - want.distance).abs() < 1e-4 * want.distance
        && (got.normal - want.normal).length() < 1e-3
        && (got.albedo - want.albedo).length() < 1e-3
        && (got.lift - want.lift).abs() < 1e-3 * want.lift
}

#[test]
fn rays_meet_collected_scenes_as_those_that_were_uploaded() {
    let view = View::look_at(DVec3::NEG_Y * 4.0, DVec3::ZERO, DVec3::Z, 0.6, 64, 48);
    let (scene, mut dice) = (ball(), Dice(3));
    let mut vector = || Vec3::from_array([0; 3].map(|_| dice.unit() as f32 * 2.0 - 1.0));
    let ray = |_| {
        let origin = vector() * 3.0;
        Ray::new(origin, (vector() * 0.7 - origin).normalize_or(Vec3::X))
    };
    let rays: Vec<_> = (0..2000).map(ray).collect();
    for gpu in gpus() {
        let kernels = SceneKernels::new(&gpu).unwrap();
        let mut collector = SceneCollector::new(&gpu).unwrap();
        let draws = scene.draws(true, true, true);
        let frame = scene.frame(&view, &draws);
        let splats = splats(&frame, DVec3::ZERO);
        let input = SplatInput { splats: &splats, ..SplatInput::default() };
        let want = kernels.scene(&gpu, &input).unwrap();
        let (pool, placed) = upload(&gpu, &draws);
        let frame = frame.with_draws(&placed);
        let got = collector.collect(&gpu, &frame, &pool, DVec3::ZERO, Albedo::Rgb).unwrap();
        assert_eq!((got.splats(), got.dropped()), (want.splats(), want.dropped()));
        assert!((got.diagonal() / want.diagonal() - 1.0).abs() < 1e-6);
        let [got, want] = [&got, &want].map(|scene| kernels.hits(&gpu, scene, &rays).unwrap());
        assert!(want.iter().flatten().count() > 500);
        let differ = got.iter().zip(&want).filter(|(a, b)| !is_same_hit(**a, **b)).count();
        assert!(differ <= 2, "{}: {differ} rays differ", gpu.name);
        let nothing = frame.with_draws::<PlaneAt>(&[]);
        let empty = collector.collect(&gpu, &nothing, &pool, DVec3::ZERO, Albedo::Rgb).unwrap();
        assert_eq!((empty.splats(), kernels.hits(&gpu, &empty, &rays).unwrap()[0]), (0, None));
    }
}
