//! Splats that a GPU makes of the pages of the pool are those of the CPU, in the same order, on
//! every adapter of the machine, with all its features and with the minimum that WebGPU guarantees.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::{CompactOctree, Drawn, View};
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, INDEX_AT, oct_decode};
use esker_points::{AttrType, Cell, Node, NodeTable};
use esker_render::gpu::device::readback::read;
use esker_render::gpu::splats::SPLAT_BYTES;
use esker_render::gpu::{Gpu, GpuSplats};
use esker_render::{Codebook, ColourBy, ColourMap, ColourPlane, Frame, Gradient, Splat, splats};
use glam::{DVec3, Vec3};
use gpu::{few_gpus, name, upload, uploaded_frame};
use scene::{Dice, Scene, sphere};

/// Bytes of a page: the planes of a node lie in several.
const PAGE_BYTES: u64 = 64 << 10;
/// Places differ by the rounding of a sum and of a product, which a compiler may join.
const ROUNDING: f32 = 2.0 * f32::EPSILON;

/// A ball of 9,000 points in nodes of at most `capacity`. Hot positions drop bits.
fn ball(capacity: usize) -> Scene {
    let mut dice = Dice(7);
    let mut points = sphere(&mut dice, DVec3::ZERO, 1.0, 9000, [200, 90, 30]);
    for p in &mut points {
        p.colour = p.colour.map(|c| c.wrapping_add(dice.bits() as u8 % 50));
    }
    let mut scene = Scene::new(&points, 2f64.powi(-20), 0.05, 0.04, capacity);
    for node in &mut scene.nodes {
        for (i, hot) in node.position.chunks_exact_mut(HOT_POSITION_BYTES).enumerate() {
            hot[INDEX_AT] = if i % 5 == 0 { 1 } else { 0 };
        }
    }
    scene
}

fn view() -> View {
    View::look_at(DVec3::new(0.3, -4.0, 0.5), DVec3::ZERO, DVec3::Z, 0.6, 64, 48)
}

/// An octree with the cells of the nodes and smaller ones below them.
fn octree(scene: &Scene) -> CompactOctree {
    let record = |cell: Cell, parent| {
        let mut node: Node = bytemuck::Zeroable::zeroed();
        (node.corner, node.cell_log2, node.parent) = (cell.corner, cell.log2, parent);
        node
    };
    let mut nodes = vec![record(Cell::containing([0; 3], 32), u32::MAX)];
    nodes.extend(scene.nodes.iter().map(|n| record(n.node.cell(), 0)));
    for parent in 1..=scene.nodes.len() {
        let cell = nodes[parent].cell();
        nodes.push(record(Cell::containing(cell.corner, cell.log2 - 1), parent as u32));
    }
    let table = NodeTable::of_tree(nodes);
    let mut dice = Dice(11);
    let drawn: Vec<_> = (1..table.nodes.len() as u32)
        .map(|node| Drawn { node, prefix: 1, effective_spacing: 0.01 + dice.unit() as f32 * 0.05 })
        .collect();
    CompactOctree::new(&table, &drawn)
}

/// Reads the splats of a frame that a GPU has made.
fn made(gpu: &Gpu, maker: &mut GpuSplats, frame: &Frame<'_>, origin: DVec3) -> Vec<[f32; 8]> {
    let uploaded = upload(gpu, frame.draws, PAGE_BYTES);
    let frame = uploaded_frame(frame, &uploaded.draws);
    let buffer = maker.make(gpu, &frame, &uploaded.pool, origin).unwrap();
    let bytes = u64::from(buffer.room) * SPLAT_BYTES;
    let read = read(gpu, &[(&buffer.number, 4), (&buffer.splats, bytes)]).unwrap();
    assert_eq!(gpu.fault(), None);
    let number = u32::from_le_bytes(*read[0].first_chunk().unwrap()) as usize;
    bytemuck::pod_collect_to_vec(&read[1][..number * SPLAT_BYTES as usize])
}

/// Compares splats of the GPU with those of the CPU. At most one in a thousand may have another
/// colour: colours by depth change where rounding decides.
fn assert_same(got: &[[f32; 8]], want: &[Splat], what: &str) {
    assert_eq!(got.len(), want.len(), "{what}");
    let mut other_colours = 0;
    for (got, want) in got.iter().zip(want) {
        for axis in 0..3 {
            let off = (got[axis] - want.centre[axis]).abs();
            assert!(off <= ROUNDING * want.centre[axis].abs(), "{what}: {got:?}, {want:?}");
        }
        assert_eq!(got[3], want.radius, "{what}");
        let bits = got[4].to_bits();
        assert_eq!(oct_decode([bits as i16, (bits >> 16) as i16]), want.normal, "{what}");
        let colour = Vec3::from_slice(&got[5..]) - Vec3::from_array(want.colour);
        other_colours += usize::from(colour.abs().max_element() > 1e-6);
    }
    assert!(other_colours * 1000 <= want.len(), "{what}: {other_colours} colours differ");
}

#[test]
fn splats_equal_those_of_the_cpu_with_any_planes_and_an_octree() {
    // Many small nodes need several batches.
    for (scene, prefix) in [(ball(2500), usize::MAX), (ball(2500), 701), (ball(100), 64)] {
        let (view, octree) = (view(), octree(&scene));
        let origin = DVec3::new(0.25, -0.5, 0.125);
        for gpu in few_gpus() {
            let mut maker = GpuSplats::new(&gpu).unwrap();
            for case in 0..8 {
                let has = |bit: u32| case >> bit & 1 == 1;
                let mut draws = scene.draws(has(0), has(1), has(2));
                for (i, draw) in draws.iter_mut().enumerate() {
                    (draw.entry, draw.prefix) = (i, prefix);
                }
                let octree = has(0).then_some(&octree);
                let frame = Frame { octree, ..scene.frame(&view, &draws) };
                let got = made(&gpu, &mut maker, &frame, origin);
                let what = format!("{}, planes {case:03b}, {prefix}", name(&gpu));
                assert_same(&got, &splats(&frame, origin), &what);
            }
        }
    }
}

#[test]
fn colours_of_all_sources_equal_those_of_the_cpu() {
    let (scene, view) = (ball(4000), view());
    let map = |low, high| ColourMap { low, high, gradient: Gradient::Viridis };
    let book = Codebook::Own(std::array::from_fn(|i| [i as u8, 200, 255 - i as u8]));
    let sources = [
        ColourBy::Plain,
        ColourBy::Scalar(map(0.0, 60_000.0)),
        ColourBy::Coordinate(0, map(-1.0, 1.0)),
        ColourBy::Coordinate(1, map(-1.0, 1.0)),
        ColourBy::Coordinate(2, map(-1.0, 1.0)),
        ColourBy::EyeDepth(map(3.0, 5.0)),
        ColourBy::Cell,
        ColourBy::Normal,
        ColourBy::Codes(book),
    ];
    for gpu in few_gpus() {
        let mut maker = GpuSplats::new(&gpu).unwrap();
        for colour in sources {
            let mut draws = scene.draws(true, true, true);
            for (draw, node) in draws.iter_mut().zip(&scene.nodes) {
                draw.colour = match colour {
                    ColourBy::Codes(_) => ColourPlane::Indexed,
                    _ => Scene::scalar(node, AttrType::U16),
                };
            }
            let frame = Frame { colour, ..scene.frame(&view, &draws) };
            let got = made(&gpu, &mut maker, &frame, DVec3::ZERO);
            let what = format!("{}, {}", name(&gpu), colour.number());
            assert_same(&got, &splats(&frame, DVec3::ZERO), &what);
        }
    }
}

#[test]
fn hidden_points_are_left_out_and_an_empty_frame_has_no_splats() {
    let (mut scene, view) = (ball(4000), view());
    for node in &mut scene.nodes {
        for hot in node.position.chunks_exact_mut(HOT_POSITION_BYTES).step_by(3) {
            hot[HIDDEN_AT] = 1;
        }
    }
    let draws = scene.draws(true, true, true);
    for gpu in few_gpus() {
        let mut maker = GpuSplats::new(&gpu).unwrap();
        for hides_points in [true, false] {
            let frame = Frame { hides_points, ..scene.frame(&view, &draws) };
            let got = made(&gpu, &mut maker, &frame, DVec3::ONE);
            assert_same(&got, &splats(&frame, DVec3::ONE), &name(&gpu));
        }
        assert!(made(&gpu, &mut maker, &scene.frame(&view, &[]), DVec3::ONE).is_empty());
    }
}
