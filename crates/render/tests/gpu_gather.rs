//! Gather, resolve and tiles on the GPU give the results of their CPU twins on every adapter of the
//! machine, with all its features and with the minimum that WebGPU guarantees. The hits come from
//! the CPU, so that only these passes can differ.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

#[path = "gpu_gather/gpu_passes.rs"]
mod gpu_passes;

use esker_lod::{CompactOctree, Drawn, View, tiles_of};
use esker_points::quant::INDEX_AT;
use esker_points::{AttrType, Cell, Node, NodeTable};
use esker_render::gpu::memory::pyramid::GpuPyramid;
use esker_render::{
    Background, Codebook, ColourBy, ColourMap, ColourPlane, DrawNode, Frame, FramePlan, Gradient,
    Method,
};
use glam::Vec4Swizzles;
use glam::{DVec3, Vec4};
use gpu_passes::{GpuPasses, gpus, project_on_cpu};
use scene::{Dice, Scene, SceneNode, sheet, sphere};

/// Steps of lattices on which hot positions drop no bits, at most ten, and more than ten.
const STEPS: [f64; 3] = [1e-4, 3e-6, 2e-9];

/// A ball in front of a wall, in nodes of at most 700 points.
fn ball_and_wall(step: f64) -> Scene {
    let mut dice = Dice(7);
    let mut points = sphere(&mut dice, DVec3::ZERO, 1.0, 4000, [200, 40, 90]);
    let corner = DVec3::new(-1.5, 1.2, -1.5);
    points.extend(sheet(&mut dice, corner, DVec3::X * 3.0, DVec3::Z * 3.0, 60, [20, 130, 220]));
    for p in &mut points {
        p.colour = p.colour.map(|c| c.wrapping_add(dice.bits() as u8 % 50));
        // A third of the normals are reversed.
        p.normal *= if dice.bits().is_multiple_of(3) { -1.0 } else { 1.0 };
    }
    Scene::new(&points, step, 0.05, 0.04, 700)
}

fn view(width: u32, height: u32) -> View {
    View::look_at(DVec3::new(1.0, -3.0, 0.8), DVec3::ZERO, DVec3::Z, 0.9, width, height)
}

/// An octree with the cells of the nodes and some smaller cells below them that are drawn, too.
fn octree(scene: &Scene) -> CompactOctree {
    let mut dice = Dice(11);
    let whole = scene.nodes.iter().map(|n| n.node);
    let record = |cell: Cell, parent| {
        let mut node: Node = bytemuck::Zeroable::zeroed();
        (node.corner, node.cell_log2, node.parent) = (cell.corner, cell.log2, parent);
        node
    };
    let mut nodes = vec![record(Cell::containing([0; 3], 32), u32::MAX)];
    nodes.extend(whole.map(|n| record(n.cell(), 0)));
    for parent in 1..400 {
        let Some(cell) = nodes.get(parent).map(Node::cell).filter(|c| c.log2 > 2) else { break };
        let at = cell.corner.map(|c| c + (dice.bits() as u32 >> (32 - cell.log2)));
        nodes.push(record(Cell::containing(at, cell.log2 - 1), parent as u32));
        nodes.push(record(Cell::containing(cell.corner, cell.log2 - 2), parent as u32));
    }
    let table = NodeTable::of_tree(nodes);
    let drawn: Vec<_> = (1..table.nodes.len() as u32)
        .map(|node| Drawn { node, prefix: 1, effective_spacing: 0.01 + dice.unit() as f32 * 0.05 })
        .collect();
    CompactOctree::new(&table, &drawn)
}

fn map(low: f64, high: f64) -> ColourMap {
    ColourMap { low, high, gradient: Gradient::Viridis }
}

/// Whether two numbers are equal up to rounding.
fn near(a: f32, b: f32) -> bool {
    a == b || (a - b).abs() <= 1e-4 * a.abs().max(b.abs()).max(1e-3)
}

fn near_all(a: Vec4, b: Vec4) -> bool {
    a.to_array().iter().zip(b.to_array()).all(|(&a, b)| near(a, b))
}

/// Compares level 0 with that of the CPU twin. At most 0.1 % of the pixels may differ, where
/// rounding changes a decision.
fn assert_gathers(passes: &mut GpuPasses, frame: &Frame<'_>, what: &str) {
    let cpu = project_on_cpu(frame);
    let mut pyramid = GpuPyramid::default();
    let [width, height] = [frame.view.width, frame.view.height];
    pyramid.fit(&passes.gpu, width, height, FramePlan::new(frame).planes()).unwrap();
    let (gpu, count) = passes.gather(frame, &cpu.hits, &pyramid);
    let (valid, twin) = cpu.gather();
    assert_eq!((u64::from(count), valid > 100), (valid, true), "{what}: pixels won");
    let mut off = 0;
    for i in 0..(width * height) as usize {
        assert_eq!(gpu.is_valid(i), twin.is_valid(i), "{what}: pixel {i}");
        if !twin.is_valid(i) {
            assert_eq!(gpu.front[i], twin.front[i], "{what}: an invalid pixel");
            continue;
        }
        let normal = |l: &esker_render::picture::pyramid::Level| {
            l.normal.get(i).copied().unwrap_or_default()
        };
        let tilt =
            |l: &esker_render::picture::pyramid::Level| l.tilt.get(i).copied().unwrap_or_default();
        // Displacements are differences of coordinates of hundreds of pixels: 0.001 pixels is their
        // precision.
        let [front, twins] = [gpu.front[i], twin.front[i]];
        // With fitted planes depths are moved along the planes, otherwise they are those of the
        // points.
        let is_fitted = frame.draws.iter().all(|d| d.normal.is_none());
        let same = (gpu.depth[i] == twin.depth[i]
            || is_fitted && near(gpu.depth[i], twin.depth[i]))
            && near(front.x, twins.x)
            && near(front.y, twins.y)
            && (front - twins).zw().abs().max_element() <= 1e-3
            && near_all(gpu.tint[i], twin.tint[i])
            && near_all(normal(&gpu), normal(&twin))
            && (tilt(&gpu) - tilt(&twin)).length() <= 1e-4 * tilt(&twin).length().max(0.1);
        off += u64::from(!same);
    }
    assert!(off * 1000 <= valid, "{what}: {off} of {valid} pixels are off");
    assert_eq!(passes.gpu.fault(), None, "{what}");
}

/// Compares the picture of points with that of the CPU twin; bytes may differ by one.
fn assert_resolves(passes: &mut GpuPasses, frame: &Frame<'_>, what: &str) {
    let cpu = project_on_cpu(frame);
    let (rgba, depth, [won, shown]) = passes.resolve(frame, &cpu.hits);
    let (covered, picture) = cpu.resolve();
    assert_eq!([u64::from(won), u64::from(shown)], [covered; 2], "{what}: pixels covered");
    assert_eq!(depth, picture.depth, "{what}: depths");
    let far = rgba.iter().zip(&picture.rgba).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert_eq!(far, 0, "{what}: bytes off by more than one");
    assert_eq!(passes.gpu.fault(), None, "{what}");
}

#[test]
fn level_0_equals_the_cpu_with_and_without_normals_octree_and_dropped_bits() {
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        let view = view(150, 110);
        for step in STEPS {
            let scene = ball_and_wall(step);
            let octree = octree(&scene);
            // All 16 cases if the dropped bits of a position fit in one word, else a few.
            for case in (0..16).filter(|c| step == STEPS[1] || c % 5 == 0) {
                let has = |bit: u32| case >> bit & 1 == 1;
                let mut draws = scene.draws(has(0), true, has(1));
                for (i, draw) in draws.iter_mut().enumerate() {
                    (draw.entry, draw.prefix) = (i, 650);
                }
                if let Some(last) = draws.last_mut() {
                    (last.entry, last.normal) = (usize::MAX, None);
                }
                let mut frame = scene.frame(&view, &draws);
                frame.octree = has(2).then_some(&octree);
                frame.cull_back_faces = has(3);
                assert_gathers(&mut passes, &frame, &format!("step {step}, case {case:04b}"));
            }
        }
    }
}

#[test]
fn heights_include_the_dropped_bits() {
    // A floor that rises by three steps of the hot positions, seen from above, coloured by height.
    let floor = |step: f64, rise: f64| {
        let (u, v) = (DVec3::new(3.0, 0.0, rise * 0.5), DVec3::new(0.0, 3.0, rise * 0.5));
        let points = sheet(&mut Dice(2), DVec3::ZERO, u, v, 80, [9, 99, 199]);
        Scene::new(&points, step, 0.05, 0.04, 700)
    };
    let (eye, middle) = (DVec3::new(1.5, 1.4, 3.0), DVec3::new(1.5, 1.5, 0.0));
    let view = View::look_at(eye, middle, DVec3::Y, 1.0, 100, 100);
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        for step in &STEPS[1..] {
            let shift = floor(*step, 0.0).nodes[0].node.hot_shift;
            assert!(shift > 0);
            let rise = 3.0 * step * f64::from(1 << shift);
            let scene = floor(*step, rise);
            for residual in [true, false] {
                let draws = scene.draws(residual, false, true);
                let mut frame = scene.frame(&view, &draws);
                frame.colour = ColourBy::Coordinate(2, map(0.0, rise));
                let what = format!("shift {shift}, residual {residual}");
                assert_gathers(&mut passes, &frame, &what);
                frame.method = Method::Points;
                assert_resolves(&mut passes, &frame, &what);
            }
        }
    }
}

#[test]
fn colours_of_points_equal_the_cpu_for_every_source_of_colour() {
    let scene = ball_and_wall(STEPS[1]);
    let view = view(120, 90);
    let colours = [
        ColourBy::Plain,
        ColourBy::Rgb,
        ColourBy::Scalar(map(0.0, 255.0)),
        ColourBy::Codes(Codebook::Classes),
        ColourBy::Codes(Codebook::Own(std::array::from_fn(|i| [i as u8, 255 - i as u8, 7]))),
        ColourBy::Coordinate(0, map(-0.7, 0.9)),
        ColourBy::Coordinate(1, map(0.8, -1.1)),
        ColourBy::Coordinate(2, map(-1.0, 1.0)),
        ColourBy::Coordinate(2, map(1.0, -1.0)),
        ColourBy::EyeDepth(map(2.0, 4.5)),
        ColourBy::EyeDepth(map(2.0, f64::NAN)),
        ColourBy::Cell,
        ColourBy::Normal,
    ];
    // Hot positions with indices of colours in a gradient.
    let indexed_positions = |node: &SceneNode| {
        let mut plane = node.position.clone();
        for (i, point) in plane.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            point[INDEX_AT] = (i * 37) as u8;
        }
        plane
    };
    let indexed: Vec<_> = scene.nodes.iter().map(indexed_positions).collect();
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        for colour in colours {
            for plane in 0..4 {
                let mut draws = scene.draws(true, plane > 0, true);
                for (draw, node) in draws.iter_mut().zip(&scene.nodes).filter(|_| plane == 2) {
                    draw.colour = Scene::scalar(node, AttrType::U8);
                }
                for (draw, plane) in draws.iter_mut().zip(&indexed).filter(|_| plane == 3) {
                    (draw.position, draw.colour) = (plane, ColourPlane::Indexed);
                }
                draws[0].normal = None;
                let what = format!("{colour:?}, plane {plane}");
                let mut frame = scene.frame(&view, &draws);
                frame.colour = colour;
                assert_gathers(&mut passes, &frame, &what);
                frame.method = Method::Points;
                frame.background = match plane {
                    0 => Background::Plain([1, 2, 3, 0]),
                    _ => Background::Gradient([10, 200, 30], [250, 20, 90]),
                };
                assert_resolves(&mut passes, &frame, &what);
            }
        }
    }
}

/// Values of type `ty` that are hard to map to colours, and the range of most of them.
fn values(ty: AttrType, points: usize) -> (Vec<u8>, ColourMap) {
    let mut dice = Dice(5);
    let mut bytes = Vec::new();
    // Ranges in which neighbouring values are often equal as `f32`.
    let (low, span) = match ty {
        AttrType::U8 => (3.0, 200.0),
        AttrType::I8 => (-100.0, 180.0),
        AttrType::U16 => (500.0, 60_000.0),
        AttrType::I16 => (-30_000.0, 50_000.0),
        AttrType::U32 => (4.294_967_0e9, 290.0),
        AttrType::I32 => (-2.147_483_6e9, 300.0),
        AttrType::U64 => (1.0e19, 1e6),
        AttrType::I64 => (-9.0e18, 1e6),
        AttrType::F32 => (1e5, 20.0),
        AttrType::F64 => (3.0e8, 7.0),
    };
    for i in 0..points {
        let at = low + span * (dice.unit() * 1.2 - 0.1);
        let bits = dice.bits();
        match (ty, i % 16) {
            // Random bits, which may be no number.
            (_, 0) => bytes.extend(&bits.to_le_bytes()[..ty.size()]),
            (AttrType::F32, 1) => bytes.extend(f32::NAN.to_le_bytes()),
            (AttrType::F64, 1) => bytes.extend(f64::NEG_INFINITY.to_le_bytes()),
            (AttrType::F32, 2) => bytes.extend((bits as u32 & 0x807f_ffff).to_le_bytes()),
            (AttrType::U8, _) => bytes.push(at as u8),
            (AttrType::I8, _) => bytes.extend((at as i8).to_le_bytes()),
            (AttrType::U16, _) => bytes.extend((at as u16).to_le_bytes()),
            (AttrType::I16, _) => bytes.extend((at as i16).to_le_bytes()),
            (AttrType::U32, _) => bytes.extend((at as u32).to_le_bytes()),
            (AttrType::I32, _) => bytes.extend((at as i32).to_le_bytes()),
            // Low bits beyond the precision of `f64`, which rounds them.
            (AttrType::U64, _) => bytes.extend((at as u64).wrapping_add(bits % 4096).to_le_bytes()),
            (AttrType::I64, _) => bytes.extend((at as i64 + (bits % 4096) as i64).to_le_bytes()),
            (AttrType::F32, _) => bytes.extend((at as f32).to_le_bytes()),
            (AttrType::F64, _) => bytes.extend(at.to_le_bytes()),
        }
    }
    (bytes, map(low, low + span))
}

const TYPES: [AttrType; 10] = [
    AttrType::U8,
    AttrType::I8,
    AttrType::U16,
    AttrType::I16,
    AttrType::U32,
    AttrType::I32,
    AttrType::U64,
    AttrType::I64,
    AttrType::F32,
    AttrType::F64,
];

#[test]
fn colours_of_scalars_of_every_type_equal_the_cpu_bit_by_bit() {
    let scene = ball_and_wall(STEPS[0]);
    let view = view(120, 90);
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        for ty in TYPES {
            let (bytes, wide) = values(ty, 700);
            let mut draws = scene.draws(true, false, false);
            draws.iter_mut().for_each(|d| d.colour = ColourPlane::Scalar { bytes: &bytes, ty });
            let narrow = map(wide.low, wide.low + (wide.high - wide.low) * 1e-3);
            let denormal = map(-1e-38, 1e-38);
            let maps = [wide, narrow, map(wide.high, wide.low), map(0.0, 0.0), denormal];
            let colours =
                maps.map(ColourBy::Scalar).into_iter().chain([ColourBy::Codes(Codebook::Classes)]);
            for colour in colours {
                let mut frame = scene.frame(&view, &draws);
                frame.colour = colour;
                let cpu = project_on_cpu(&frame);
                let mut pyramid = GpuPyramid::default();
                pyramid
                    .fit(&passes.gpu, view.width, view.height, FramePlan::new(&frame).planes())
                    .unwrap();
                let (level, _) = passes.gather(&frame, &cpu.hits, &pyramid);
                let (_, twin) = cpu.gather();
                for i in (0..twin.front.len()).filter(|&i| twin.is_valid(i)) {
                    let colours = [&level, &twin].map(|l| l.tint[i].truncate());
                    assert_eq!(colours[0], colours[1], "{ty:?} by {colour:?}, pixel {i}");
                }
                assert_eq!(passes.gpu.fault(), None);
            }
        }
    }
}

/// A node whose planes are too short, with lengths that depend on `i`.
fn cut(i: usize, node: &SceneNode) -> DrawNode<'_> {
    let part = |plane: &'_ [u8], share: usize| plane.len() * share / 4 + 3 * (share % 2);
    let within = |plane: &'_ [u8], share: usize| part(plane, share).min(plane.len());
    DrawNode {
        position: &node.position[..within(&node.position, i % 5)],
        residual: Some(&node.residual[..within(&node.residual, 4 - i % 3)]),
        colour: match i % 3 {
            0 => ColourPlane::Rgba(&node.colour[..within(&node.colour, 2)]),
            1 => ColourPlane::Scalar { bytes: &node.colour[..331], ty: AttrType::U16 },
            _ => ColourPlane::None,
        },
        normal: (!i.is_multiple_of(3)).then_some(&node.normal[..within(&node.normal, 1 + i % 3)]),
        ..node.draw(true, true, true)
    }
}

#[test]
fn planes_that_are_too_short_are_used_up_to_their_end() {
    let view = view(120, 90);
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        for step in STEPS {
            let scene = ball_and_wall(step);
            let draws: Vec<_> = scene.nodes.iter().enumerate().map(|(i, n)| cut(i, n)).collect();
            let colours = [ColourBy::Rgb, ColourBy::Scalar(map(0.0, 65535.0)), ColourBy::Normal];
            for colour in colours {
                let mut frame = scene.frame(&view, &draws);
                (frame.colour, frame.cull_back_faces) = (colour, false);
                let what = format!("short planes, step {step}, {colour:?}");
                assert_gathers(&mut passes, &frame, &what);
                frame.method = Method::Points;
                assert_resolves(&mut passes, &frame, &what);
            }
        }
    }
}

#[test]
fn an_empty_frame_has_no_valid_pixel_and_shows_the_background() {
    let view = view(64, 48);
    let scene = ball_and_wall(STEPS[0]);
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        let mut frame = scene.frame(&view, &[]);
        let cpu = project_on_cpu(&frame);
        let mut pyramid = GpuPyramid::default();
        pyramid.fit(&passes.gpu, view.width, view.height, FramePlan::new(&frame).planes()).unwrap();
        let (level, count) = passes.gather(&frame, &cpu.hits, &pyramid);
        assert!(count == 0 && (0..level.front.len()).all(|i| !level.is_valid(i)));
        frame.method = Method::Points;
        assert_resolves(&mut passes, &frame, "nothing");
    }
}

#[test]
fn depth_tiles_equal_the_cpu_for_pictures_of_any_size() {
    let mut dice = Dice(3);
    for gpu in gpus() {
        let mut passes = GpuPasses::new(gpu);
        for (width, height) in [(1, 1), (17, 301), (128, 128), (333, 129), (640, 360)] {
            let depth: Vec<f32> = (0..width * height)
                .map(|_| match dice.bits() % 64 {
                    0 => f32::INFINITY,
                    1 => f32::NAN,
                    2 => -1.0,
                    3 => 0.0,
                    4 => 1e-40,
                    _ => dice.unit() as f32 * 100.0,
                })
                .collect();
            let twin = tiles_of(&depth, width as usize, height as usize);
            assert!(passes.tiles(&depth, width, height) == twin, "{width} x {height}");
            assert_eq!(passes.gpu.fault(), None);
        }
    }
}
