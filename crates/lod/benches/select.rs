//! Measures the LOD pass: selecting a cut of about 1,000 nodes with and without occlusion, and
//! making the occlusion itself. The table is a generated building of rooms: walls of flat nodes,
//! quadtrees in an octree. Prints medians (and least times); run it by `cargo bench -p esker-lod`.
#![allow(clippy::unwrap_used, reason = "a benchmark may panic")]

use bytemuck::Zeroable;
use esker_lod::{
    AllResident, DepthFeedback, Occlusion, Options, Selection, SoftwareDepth, View, select,
    tiles_of,
};
use esker_points::node::{NONE, SHAPE_ORIENTED, pack_rotation};
use esker_points::{Cell, Lattice, Node, NodeTable};
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

/// Edge of a room, in steps of a millimetre.
const ROOM: u32 = 1 << 12;
/// Rooms on a side of the building, and the edge of the pieces that walls are divided into.
const ROOMS: u32 = 8;
const PIECE: u32 = 1 << 7;
/// Points of a node.
const POINTS: usize = 8192;
const CORNER: u32 = 1 << 31;
const RUNS: usize = 101;

fn main() {
    let lattice =
        Lattice { scale: [1e-3; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
    let table = building();
    let room = f64::from(ROOM) * 1e-3;
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * room;
    let view = View::look_at(at(0.5, 0.4, 0.5), at(7.0, 6.0, 0.6), DVec3::Z, 1.2, 1920, 1080);
    println!("{} nodes in the table", table.nodes.len());
    let cut = |target_spacing_px: f64, occlusion: Option<&dyn Occlusion>| {
        let options = Options { target_spacing_px, points_budget: u64::MAX, ..Options::default() };
        select(&table, &lattice, &view, &options, &AllResident, occlusion)
    };
    let fine = cut(1.0, None).drawn;
    let soft = SoftwareDepth::new(&table, &lattice, &view, &fine);
    let picture = walls(&view, room);
    let feedback = DepthFeedback::new(&view, &tiles_of(&picture, 1920, 1080)).unwrap();
    let moved = feedback.seen_from(&View { eye: view.eye + DVec3::splat(1e-4), ..view });
    let both: Vec<Arc<dyn Occlusion>> = vec![Arc::new(feedback.clone()), Arc::new(soft.clone())];
    let sources: [(&str, Option<&dyn Occlusion>); 5] = [
        ("none", None),
        ("feedback", Some(&feedback)),
        ("feedback, moved", Some(&moved)),
        ("software depth", Some(&soft)),
        ("both", Some(&both)),
    ];
    for (what, occlusion) in sources {
        // The coarsest target with a cut of 1,000 nodes.
        let mut target = 8.0;
        while target > 0.05 && cut(target, occlusion).drawn.len() < 1000 {
            target *= 0.97;
        }
        report(what, || cut(target, occlusion));
    }
    for count in [250, 500, 1000, 2000] {
        let drawn = &fine[..fine.len().min(count)];
        let ms = time(|| SoftwareDepth::new(&table, &lattice, &view, drawn));
        let occluders = SoftwareDepth::new(&table, &lattice, &view, drawn).occluders();
        println!("software depth of {count} nodes, {occluders} occluders: {ms}");
    }
    println!("tiles of 1920 x 1080: {}", time(|| tiles_of(&picture, 1920, 1080)));
}

fn report(what: &str, run: impl Fn() -> Selection) {
    let c = run().counters;
    let ms = time(&run);
    println!(
        "{what}: {ms}; {} drawn, {} visited, {} + {} occluded",
        c.drawn, c.visited, c.occluded, c.contour_occluded
    );
}

/// Median of many runs in milliseconds, and the least time, which a busy machine disturbs less.
fn time<T>(run: impl Fn() -> T) -> String {
    let mut times: Vec<_> = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            std::hint::black_box(run());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    format!("{:.3} ms ({:.3})", times[RUNS / 2], times[0])
}

/// Depth of the walls of the room with the eye, which is a box.
fn walls(view: &View, room: f64) -> Vec<f32> {
    let (width, height) = (view.width as usize, view.height as usize);
    let depth = |i: usize| {
        let px = DVec3::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5, 0.0);
        let x = (px.x - width as f64 * 0.5) / view.focal_px();
        let y = (height as f64 * 0.5 - px.y) / view.focal_px();
        let ray = view.world_from_view * DVec3::new(x, y, -1.0);
        (0..3).fold(f32::INFINITY, |least, k| {
            let wall = if ray[k] > 0.0 { room } else { 0.0 };
            least.min(((wall - view.eye[k]) / ray[k]) as f32)
        })
    };
    (0..width * height).map(depth).collect()
}

/// Whether a cell touches a wall, a floor or a ceiling of the building.
fn has_wall(cell: &Cell) -> bool {
    (0..3).any(|k| (cell.corner[k] - CORNER).is_multiple_of(ROOM))
}

/// The node table: cells that touch a wall, down to pieces of walls.
fn building() -> NodeTable {
    let side = ROOM * ROOMS;
    let mut table = NodeTable::default();
    let mut level = vec![(NONE, Cell::containing([CORNER; 3], side.trailing_zeros() as u8))];
    while !level.is_empty() {
        let mut below = Vec::new();
        for (parent, cell) in level {
            let index = table.nodes.len() as u32;
            if let Some(above) = table.nodes.get_mut(parent as usize) {
                if above.child_count == 0 {
                    above.first_child = index;
                }
                above.child_count += 1;
            }
            table.nodes.push(node(parent, &cell));
            let half = (cell.edge() / 2) as u32;
            for octant in (0..8u32).filter(|_| half >= PIECE) {
                let corner =
                    [0, 1, 2].map(|k| cell.corner[k] + if octant >> k & 1 == 1 { half } else { 0 });
                let child = Cell { corner, log2: cell.log2 - 1 };
                // One storey.
                if has_wall(&child) && corner[2] - CORNER < ROOM {
                    below.push((index, child));
                }
            }
        }
        level = below;
    }
    table
}

fn node(parent: u32, cell: &Cell) -> Node {
    let mut node = Node::zeroed();
    (node.corner, node.cell_log2, node.parent) = (cell.corner, cell.log2, parent);
    node.set_levels(&[64, 448, POINTS - 512]);
    let edge = cell.edge() as f64 * 1e-3;
    let walls: Vec<_> =
        (0..3).filter(|&k| (cell.corner[k] - CORNER).is_multiple_of(ROOM)).collect();
    node.spacing = (edge * (walls.len() as f64 / POINTS as f64).sqrt()) as f32;
    let half = (edge * 0.5) as f32;
    (node.contour_centre, node.contour_half) = ([half; 3], [half; 3]);
    node.shape = 3;
    node.contour_rotation = [0, 0, 0, i16::MAX];
    if let (true, [k]) = (cell.edge() < u64::from(ROOM), walls.as_slice()) {
        // A flat piece of one wall.
        let unit = |i: usize| [0, 1, 2].map(|j| f64::from(u8::from(i == j)));
        let (rotation, _) = pack_rotation([unit((k + 1) % 3), unit((k + 2) % 3), unit(*k)]);
        node.contour_rotation = rotation;
        node.contour_centre[*k] = 0.0;
        node.contour_half[2] = 0.005;
        node.shape = 2 | SHAPE_ORIENTED;
    }
    node.occupancy = u64::MAX;
    node
}
