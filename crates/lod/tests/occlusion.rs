//! What occludes and what does not: closed walls do; doorways, grilles, sparse and missing parts do
//! not, and no point that a ray can reach is ever hidden.

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod tree;

use bytemuck::Zeroable;
use esker_lod::{
    DepthFeedback, Drawn, Frustum, Occlusion, OrientedBox, Projection, SoftwareDepth, View,
    tiles_of,
};
use esker_points::node::{NONE, SHAPE_ORIENTED, pack_rotation};
use esker_points::{Lattice, Node, NodeTable};
use glam::{DMat3, DVec2, DVec3};
use tree::Random;

const CORNER: [u32; 3] = [1 << 31; 3];
const SIDE: u32 = 256;

fn lattice() -> Lattice {
    Lattice { scale: [1e-3; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() }
}

/// Looks along y at the origin from a distance of 10; the picture is about 9 wide there.
fn view() -> View {
    let mut view = View::look_at(DVec3::NEG_Y * 10.0, DVec3::ZERO, DVec3::Z, 0.85, SIDE, SIDE);
    view.near = 0.01;
    view
}

/// Beyond a corner of the picture no single side of the frustum refuses a box, whatever the tiles
/// show.
#[test]
fn what_lies_beyond_a_corner_of_the_picture_is_hidden() {
    let view = View::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z, 1.0, SIDE, SIDE);
    let depths = vec![f32::INFINITY; (SIDE * SIDE) as usize];
    let feedback = DepthFeedback::new(&view, &tiles_of(&depths, SIDE as usize, SIDE as usize));
    let moved = View { eye: DVec3::X * 0.1, ..view };
    let feedback = feedback.map(|feedback| feedback.seen_from(&moved));
    let turned = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_4);
    let (mut beyond, mut random) = (0, Random(5));
    for _ in 0..4000 {
        let mut within = |low: f64, high: f64| low + (high - low) * random.unit();
        let b = OrientedBox {
            centre: DVec3::new(within(4.0, 10.0), within(10.0, 11.0), within(4.0, 10.0)),
            half: DVec3::new(within(0.0, 6.0), 0.3, 0.3),
            axes: turned,
        };
        let outline = Projection::of(&moved).silhouette(&b);
        let size = DVec2::splat(f64::from(SIDE));
        let is_beyond = outline.is_some_and(|o| o.clipped(DVec2::ZERO, size).corners().is_empty());
        if is_beyond && Frustum::of(&moved).touches(&b) {
            beyond += 1;
            assert!(feedback.as_ref().is_some_and(|feedback| feedback.hides(&b)), "{b:?}");
        }
    }
    assert!(beyond > 100, "{beyond}");
}

/// A piece of a wall: centre, half its width and height, rotation about z, and occupancy mask.
struct Piece {
    centre: DVec3,
    half: [f64; 2],
    turn: f64,
    occupancy: u64,
    /// Share of the occupied parts that is surface.
    fill: f64,
}

/// Less than half a tile, which is a pixel, at a distance of ten.
const SPACING: f64 = 0.03;

fn wall(centre: DVec3, half: [f64; 2]) -> Piece {
    Piece { centre, half, turn: 0.0, occupancy: u64::MAX, fill: 1.0 }
}

/// A wall of n x n pieces, 4 wide, in the plane y = 0.
fn pieces(n: u32) -> Vec<Piece> {
    let half = 2.0 / f64::from(n);
    let at = |i: u32| half * f64::from(2 * i + 1) - 2.0;
    (0..n * n).map(|i| wall(DVec3::new(at(i % n), 0.0, at(i / n)), [half; 2])).collect()
}

fn node(piece: &Piece) -> Node {
    let mut node = Node::zeroed();
    (node.corner, node.cell_log2, node.parent) = (CORNER, 20, NONE);
    node.shape = 2 | SHAPE_ORIENTED;
    let (sin, cos) = piece.turn.sin_cos();
    let axes = [[cos, sin, 0.0], [0.0, 0.0, 1.0], [sin, -cos, 0.0]];
    node.contour_rotation = pack_rotation(axes).0;
    node.contour_centre = piece.centre.as_vec3().to_array();
    node.contour_half = [piece.half[0] as f32, piece.half[1] as f32, 0.005];
    node.occupancy = piece.occupancy;
    node.spacing = SPACING as f32;
    let area = 4.0 * piece.half[0] * piece.half[1] * f64::from(piece.occupancy.count_ones()) / 64.0;
    node.set_levels(&[(area * piece.fill / SPACING.powi(2)) as usize]);
    node
}

fn depth_of(pieces: &[Piece], view: &View) -> SoftwareDepth {
    let table = NodeTable::of_tree(pieces.iter().map(node).collect());
    let drawn: Vec<_> = table
        .nodes
        .iter()
        .zip(0..)
        .map(|(n, node)| Drawn { node, prefix: n.points(), effective_spacing: n.spacing })
        .collect();
    SoftwareDepth::new(&table, &lattice(), view, &drawn)
}

fn cube(centre: DVec3, half: f64) -> OrientedBox {
    OrientedBox { centre, half: DVec3::splat(half), axes: DMat3::IDENTITY }
}

#[test]
fn a_closed_wall_hides_what_is_behind_it_and_nothing_else() {
    for n in [1, 2, 5, 11] {
        let depth = depth_of(&pieces(n), &view());
        assert_eq!(depth.occluders(), (n * n) as usize);
        assert!(depth.hides(&cube(DVec3::Y * 3.0, 1.0)), "{n}: behind, across the seams");
        assert!(depth.hides(&cube(DVec3::new(1.2, 0.3, -1.1), 0.2)), "{n}: just behind");
        assert!(!depth.hides(&cube(DVec3::NEG_Y * 3.0, 0.5)), "{n}: in front");
        assert!(!depth.hides(&cube(DVec3::ZERO, 0.1)), "{n}: in the wall");
        assert!(!depth.hides(&cube(DVec3::new(3.0, 3.0, 0.0), 0.5)), "{n}: beside");
        assert!(!depth.hides(&cube(DVec3::new(2.0, 3.0, 0.0), 1.0)), "{n}: half beside");
        assert!(!depth.hides(&cube(DVec3::new(0.0, 300.0, 0.0), 70.0)), "{n}: larger than it");
    }
}

#[test]
fn a_doorway_hides_nothing() {
    // Two of the eight columns are open, five of the rows.
    let mut closed = pieces(1);
    closed[0].occupancy &= !(0..5).fold(0u64, |door, v| door | 0b1_1000 << (v * 8));
    let depth = depth_of(&closed, &view());
    assert_eq!(depth.occluders(), 1);
    assert!(!depth.hides(&cube(DVec3::new(0.0, 3.0, -1.0), 0.2)), "seen through the door");
    assert!(!depth.hides(&cube(DVec3::new(0.55, 0.3, -1.0), 0.1)), "the jamb may be open in part");
    assert!(depth.hides(&cube(DVec3::new(1.5, 1.0, 0.0), 0.2)), "behind the wall beside it");
    // One piece of a wall of many is missing.
    let mut missing = pieces(8);
    missing.remove(27);
    let at = missing[26].centre + DVec3::X * 0.5;
    let depth = depth_of(&missing, &view());
    assert!(!depth.hides(&cube(at + DVec3::Y * 0.5, 0.05)), "seen through the gap");
    assert!(depth.hides(&cube(at + DVec3::new(-0.5, 0.5, 0.0), 0.05)));
}

#[test]
fn grilles_and_foliage_hide_nothing() {
    for fill in [0.05, 0.3, 0.5, 0.7] {
        let mut grille = pieces(3);
        grille.iter_mut().for_each(|p| p.fill = fill);
        let depth = depth_of(&grille, &view());
        assert_eq!(depth.occluders(), 0, "{fill}");
        assert!(!depth.hides(&cube(DVec3::Y * 3.0, 0.2)));
    }
    let mut bars = pieces(3);
    bars.iter_mut().for_each(|p| p.occupancy = 0x5555_5555_5555_5555);
    assert_eq!(depth_of(&bars, &view()).occluders(), 0);
}

#[test]
fn what_is_drawn_sparsely_hides_nothing() {
    let near = View { eye: DVec3::NEG_Y * 4.0, ..view() };
    assert_eq!(depth_of(&pieces(3), &view()).occluders(), 9);
    assert_eq!(depth_of(&pieces(3), &near).occluders(), 0);
}

/// Whether the segment between two points crosses one of the pieces.
fn is_blocked(pieces: &[Piece], from: DVec3, to: DVec3) -> bool {
    let way = to - from;
    pieces.iter().any(|p| {
        let (sin, cos) = p.turn.sin_cos();
        let (u, normal) = (DVec3::new(cos, sin, 0.0), DVec3::new(sin, -cos, 0.0));
        let t = normal.dot(p.centre - from) / normal.dot(way);
        let off = from + way * t - p.centre;
        // Half a centimetre for the slab, and some more for the edge of a pixel.
        (0.0..1.0).contains(&t)
            && off.dot(u).abs() <= p.half[0] + 0.02
            && off.z.abs() <= p.half[1] + 0.02
    })
}

fn depth_picture(pieces: &[Piece], view: &View) -> Vec<f32> {
    let ray = |i: u32| {
        let px = DVec2::new(f64::from(i % SIDE), f64::from(i / SIDE)) + 0.5;
        let xy = (px - f64::from(SIDE) * 0.5) / view.focal_px();
        view.world_from_view * DVec3::new(xy.x, -xy.y, -1.0)
    };
    let depth = |i: u32| {
        let way = ray(i);
        pieces.iter().fold(f32::INFINITY, |least, p| {
            let (sin, cos) = p.turn.sin_cos();
            let (u, normal) = (DVec3::new(cos, sin, 0.0), DVec3::new(sin, -cos, 0.0));
            let t = normal.dot(p.centre - view.eye) / normal.dot(way);
            let off = view.eye + way * t - p.centre;
            let is_hit = t > 0.0 && off.dot(u).abs() <= p.half[0] && off.z.abs() <= p.half[1];
            if is_hit { least.min(t as f32) } else { least }
        })
    };
    (0..SIDE * SIDE).map(depth).collect()
}

/// A scene of walls of very different sizes.
fn walls(random: &mut Random) -> Vec<Piece> {
    let mut within = |low: f64, high: f64| low + (high - low) * random.unit();
    (0..12)
        .map(|_| Piece {
            turn: within(-1.2, 1.2),
            ..wall(
                DVec3::new(within(-5.0, 5.0), within(-4.0, 6.0), within(-4.0, 4.0)),
                [within(0.2, 4.0), within(0.2, 4.0)],
            )
        })
        .collect()
}

/// Counts hidden boxes, points in them that are on the picture, and those of the points that a ray
/// reaches.
fn count(
    pieces: &[Piece],
    view: &View,
    occlusion: &dyn Occlusion,
    random: &mut Random,
) -> [usize; 3] {
    let mut counts = [0; 3];
    for _ in 0..150 {
        let mut within = |low: f64, high: f64| low + (high - low) * random.unit();
        let b = OrientedBox {
            centre: DVec3::new(within(-6.0, 6.0), within(-8.0, 12.0), within(-5.0, 5.0)),
            half: DVec3::new(within(0.0, 1.0), within(0.0, 1.0), within(0.0, 1.0)),
            axes: DMat3::from_rotation_z(within(-3.0, 3.0))
                * DMat3::from_rotation_x(within(-3.0, 3.0)),
        };
        if !occlusion.hides(&b) {
            continue;
        }
        counts[0] += 1;
        for _ in 0..60 {
            let at = DVec3::new(within(-1.0, 1.0), within(-1.0, 1.0), within(-1.0, 1.0));
            let p = b.centre + b.axes * (b.half * at);
            if view.project(p).is_some_and(|on| view.is_on_picture(on)) {
                counts[1] += 1;
                counts[2] += usize::from(!is_blocked(pieces, view.eye, p));
            }
        }
    }
    counts
}

#[test]
fn software_depth_hides_nothing_that_a_ray_reaches() {
    let mut random = Random(7);
    let mut sums = [0; 3];
    for _ in 0..40 {
        let pieces = walls(&mut random);
        let depth = depth_of(&pieces, &view());
        let counts = count(&pieces, &view(), &depth, &mut random);
        (0..3).for_each(|i| sums[i] += counts[i]);
    }
    assert!(sums[0] > 300, "{sums:?}");
    assert_eq!(sums[2], 0, "{sums:?}");
}

#[test]
fn the_last_frames_depth_hides_nothing_that_a_ray_reaches_when_the_camera_turns_and_moves() {
    let mut random = Random(9);
    for (moved, turned) in [(0.0, 0.0), (0.0, 0.3), (0.01, 0.0), (0.05, 0.1), (0.3, 0.2)] {
        let mut sums = [0; 3];
        for _ in 0..10 {
            let pieces = walls(&mut random);
            let old = view();
            let tiles = tiles_of(&depth_picture(&pieces, &old), SIDE as usize, SIDE as usize);
            let feedback = DepthFeedback::new(&old, &tiles).expect("the number of tiles is right");
            let mut new = old;
            let step = DVec3::new(random.unit(), random.unit(), random.unit()) - DVec3::splat(0.5);
            new.eye += step * moved;
            new.world_from_view *= DMat3::from_rotation_y(turned * (random.unit() - 0.5))
                * DMat3::from_rotation_x(turned * (random.unit() - 0.5));
            let counts = count(&pieces, &new, &feedback.seen_from(&new), &mut random);
            (0..3).for_each(|i| sums[i] += counts[i]);
        }
        println!("moved {moved} turned {turned}: {sums:?}");
        assert!(sums[0] > 100, "{moved} {turned}: {sums:?}");
        // Gaps of up to a pixel are tolerated.
        assert!(sums[2] * 1000 <= sums[1], "{moved} {turned}: {sums:?}");
    }
}

#[test]
fn pixels_that_show_nothing_hide_nothing() {
    let pieces = pieces(1);
    let mut picture = depth_picture(&pieces, &view());
    let side = SIDE as usize;
    let hides = |picture: &[f32]| {
        let tiles = tiles_of(picture, side, side);
        let feedback = DepthFeedback::new(&view(), &tiles).expect("the number of tiles is right");
        feedback.hides(&cube(DVec3::Y * 3.0, 0.2))
    };
    assert!(hides(&picture));
    for nothing in [f32::INFINITY, f32::NAN, 0.0, -1.0] {
        picture[side * side / 2 + side / 2] = nothing;
        assert!(!hides(&picture), "{nothing}");
    }
    // Tiles made elsewhere may be NaN; the camera is still, then moved.
    let mut tiles = tiles_of(&depth_picture(&pieces, &view()), side, side);
    let box_hidden = |tiles: &[esker_lod::DepthTile], step: f64| {
        let feedback = DepthFeedback::new(&view(), tiles).expect("the number of tiles is right");
        let moved = View { eye: view().eye + DVec3::X * step, ..view() };
        feedback.seen_from(&moved).hides(&cube(DVec3::Y * 3.0, 0.2))
    };
    assert!([0.0, 1e-3].iter().all(|&step| box_hidden(&tiles, step)));
    let middle = tiles.len() / 2 + (tiles.len() as f64).sqrt() as usize / 2;
    tiles[middle].farthest = f32::NAN;
    assert!([0.0, 1e-3].iter().all(|&step| !box_hidden(&tiles, step)));
    assert!(DepthFeedback::new(&view(), &[]).is_none());
    assert!(!hides(&picture[..side]), "a picture cut short hides nothing");
}

#[test]
fn places_of_a_frame_count_from_what_it_shows() {
    let wide = View { width: 96, height: 96, ..view() }.with_margin(16);
    // Each pixel of the picture with its margin, which is one tile, is as deep as its column.
    let picture: Vec<f32> = (0..128 * 128).map(|i| (i % 128 + 1) as f32).collect();
    let feedback = DepthFeedback::new(&wide, &tiles_of(&picture, 128, 128))
        .expect("the number of tiles is right");
    let nearest = |x: f64| feedback.nearest_at(DVec2::new((x + 0.5) / 96.0, 0.5));
    assert_eq!([nearest(0.0), nearest(40.0), nearest(95.0)], [17.0, 57.0, 112.0].map(Some));
}
