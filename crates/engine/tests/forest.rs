//! A scan in two parts, built and appended, gives the picture of the scan built at once: the same
//! points if all are drawn, and surfaces that differ no more than those of the scan in nodes of
//! another size. It streams as one cloud, within its budgets, and loses nothing to the depth test.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod parts;

use esker_engine::Method;
use esker_engine::calls::info;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_format::Forest;
use esker_lod::View;
use esker_points::task::Silent;
use esker_render::Picture;
use glam::DVec3;
use parts::{Both, Split, built, whole};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const SIZE: [u32; 2] = [256, 192];
const CAMERAS: [&str; 2] = ["", "direction=0.3,1,-0.5;fovy=12"];
/// Views whose differences are summed: a single one depends on chance.
const LOOKS: [&str; 3] = [CAMERAS[0], "fovy=30", CAMERAS[1]];

fn picture(file: &Forest, method: Method, target_spacing_px: f64, camera: &str) -> Picture {
    let with = DrawWith { backend: Backend::Cpu, ..DrawWith::default() };
    let camera = Camera::parse(camera).unwrap();
    let request = PictureRequest {
        size: SIZE,
        method,
        with,
        target_spacing_px,
        camera,
        ..PictureRequest::default()
    };
    draw(file, &request, &Silent).unwrap().0
}

/// Difference of two pictures, or a sum of differences.
#[derive(Clone, Copy, Debug, Default)]
struct Difference {
    /// Mean FLIP.
    flip: f64,
    /// Fractions of the pixels that differ by more than 8 of 255, that only the first picture
    /// covers, and that only the second one covers.
    off: f64,
    holes: f64,
    blobs: f64,
}

impl Difference {
    fn add(&mut self, other: Self) {
        self.flip += other.flip;
        self.off += other.off;
        self.holes += other.holes;
        self.blobs += other.blobs;
    }
}

fn apart(a: &Picture, b: &Picture) -> Difference {
    let pixels = a.depth.len() as f64;
    let colours = a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
    let off = colours.filter(|(a, b)| (0..4).any(|i| a[i].abs_diff(b[i]) > 8)).count();
    let covered = || a.depth.iter().zip(&b.depth).map(|(a, b)| (a.is_finite(), b.is_finite()));
    Difference {
        flip: esker_truth::flip::mean_flip(&a.rgba, &b.rgba, SIZE[0] as usize),
        off: off as f64 / pixels,
        holes: covered().filter(|&(a, b)| a && !b).count() as f64 / pixels,
        blobs: covered().filter(|&(a, b)| b && !a).count() as f64 / pixels,
    }
}

/// A scan of rooms.
const ROOMS: &str = "synthetic:office:60k:1";
/// Thin parts before the sky.
const BRIDGE: &str = "synthetic:bridge:60k:1";

#[test]
fn parts_give_the_picture_of_the_whole() {
    // Of a bridge of fewer points, of uneven density, parts and whole are arranged differently.
    for (scan, capacity) in [(ROOMS, 4096), ("synthetic:bridge:200k:1", 8192)] {
        let scan = Path::new(scan);
        let other = whole(scan, capacity / 2);
        for split in [Split::Space, Split::Shuffled, Split::Thinned] {
            let Both { at_once, forest, .. } = built(scan, split, capacity);
            let (mut parts, mut sizes) = (Difference::default(), Difference::default());
            for camera in LOOKS {
                let of = |file, method, target| picture(file, method, target, camera);
                // All points: the same picture, except for coincident points of different colours.
                let points = [&at_once, &forest].map(|file| of(file, Method::Points, 0.0));
                assert_eq!(points[0].stats.points_drawn, points[1].stats.points_drawn);
                let same = apart(&points[0], &points[1]);
                assert!(same.off <= 0.001 && same.flip <= 0.01, "{split:?} {camera}: {same:?}");
                let whole = of(&at_once, Method::PullPush, 1.0);
                parts.add(apart(&whole, &of(&forest, Method::PullPush, 1.0)));
                sizes.add(apart(&whole, &of(&other.file, Method::PullPush, 1.0)));
            }
            // Surfaces: the chosen points differ a little, as in nodes of another size, and more in
            // some pictures than in others. Two trees on the same ground have wider splats each.
            println!("{} {split:?}: {parts:?} {sizes:?}", scan.display());
            let pictures = LOOKS.len() as f64;
            assert!(parts.flip <= sizes.flip * 1.4 + 0.002 * pictures, "{parts:?} {sizes:?}");
            assert!(parts.holes <= sizes.holes * 1.5 + 0.002 * pictures, "{parts:?} {sizes:?}");
            assert!(parts.blobs <= sizes.blobs * 1.5 + 0.003 * pictures, "{parts:?} {sizes:?}");
        }
    }
}

#[test]
fn a_dense_tree_opens_no_holes_in_a_sparse_one_and_is_not_covered_by_it() {
    // Against the picture of all points: the forest, and the same points in one tree.
    for scan in [ROOMS, BRIDGE].map(Path::new) {
        let truth = whole(scan, 4096);
        let Both { at_once, forest, .. } = built(scan, Split::Patch, 4096);
        for camera in CAMERAS {
            let of = |file| picture(file, Method::PullPush, 1.0, camera);
            let truth = of(&truth.file);
            let [one, two] = [&at_once, &forest].map(|file| apart(&truth, &of(file)));
            println!("{} {camera:?}: {one:?} {two:?}", scan.display());
            // One tree draws a sparse point by the dense cell that it is in: a hole that the forest
            // does not have.
            assert!(two.holes <= one.holes * 1.1 + 0.001, "{one:?} {two:?}");
            let wrong = |apart: &Difference| apart.holes + apart.blobs;
            assert!(wrong(&two) <= wrong(&one) * 1.1 + 0.002, "{one:?} {two:?}");
            assert!(two.flip <= one.flip * 1.1 + 0.002, "{one:?} {two:?}");
        }
    }
}

fn session(file: &Arc<Forest>, occlusion: bool, budget_gpu_bytes: u64) -> Session {
    let options = Options {
        settings: Settings {
            budget_gpu_bytes,
            budget_ram_bytes: 96 << 20,
            occlusion,
            ..Settings::default()
        },
        backend: Backend::Cpu,
        size: SIZE,
        ..Options::default()
    };
    Session::open(file.clone(), options).unwrap()
}

/// Views from inside the cloud and from outside.
fn views(file: &Forest) -> Vec<View> {
    let [low, high] = info::bounds(file).map(DVec3::from_array);
    let at = |x: f64, y: f64, z: f64| low + (high - low) * DVec3::new(x, y, z);
    let look = |from, to| View::look_at(from, to, DVec3::Z, 1.0, SIZE[0], SIZE[1]);
    vec![
        View::fit(low, high, DVec3::new(0.6, 0.5, -0.6), 1.0, SIZE[0], SIZE[1]),
        look(at(0.3, 0.4, 0.5), at(0.8, 0.5, 0.4)),
        look(at(0.7, 0.2, 1.4), at(0.5, 0.6, 0.3)),
    ]
}

/// Draws until the view is settled, with the depth test.
fn drawn(session: &mut Session, view: &View) -> Picture {
    for _ in 0..200 {
        let cut = session.settle(view, Duration::from_secs(20)).unwrap();
        let epoch = session.frame(view).unwrap().cut.epoch;
        assert!(!cut.nodes.is_empty());
        if epoch == cut.epoch {
            break;
        }
    }
    session.picture().unwrap()
}

#[test]
fn the_depth_test_hides_no_visible_tree() {
    for scan in [ROOMS, BRIDGE].map(Path::new) {
        let Both { forest, folder: _folder, .. } = built(scan, Split::Thinned, 2048);
        let forest = Arc::new(forest);
        let [mut all, mut seen] =
            [false, true].map(|occlusion| session(&forest, occlusion, 64 << 20));
        for view in views(&forest) {
            let [a, b] = [&mut all, &mut seen].map(|session| drawn(session, &view));
            let apart = apart(&a, &b);
            println!("{} hidden: {apart:?}", scan.display());
            assert!(apart.flip <= 0.01 && apart.holes <= 0.001, "{} {apart:?}", scan.display());
        }
    }
}

#[test]
fn budgets_that_hold_a_tenth_are_kept_with_every_tree_in_the_cut() {
    let Both { forest, folder: _folder, .. } = built(Path::new(ROOMS), Split::Shuffled, 1024);
    let forest = Arc::new(forest);
    let budget = forest.points() * 12 / 10;
    let mut session = session(&forest, true, budget);
    for view in views(&forest).iter().cycle().take(12) {
        for _ in 0..5 {
            let frame = session.frame(view).unwrap();
            assert!(frame.status.drawing_bytes_peak <= budget, "{:?}", frame.status);
            let trees: std::collections::HashSet<_> =
                frame.cut.nodes.iter().map(|n| forest.name_of(n.node).tree).collect();
            assert!(trees.len() == 2 || !frame.is_of_view, "{trees:?} {:?}", frame.cut.counters);
        }
    }
    let status = session.status();
    assert!(status.fault.is_none() && status.nodes_evicted > 0, "{status:?}");
}
