//! What occlusion culling saves and costs in rooms: most nodes without a visible point in the
//! picture of full density are culled, and the finished picture does not change. Prints the figures
//! of each source of occlusion: software depth, depth of the last frame, both.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_format::{Forest, PlaneKind, Planes};
use esker_lod::{
    AllResident, CompactOctree, DepthFeedback, Drawn, Occlusion, Options, Selection, SoftwareDepth,
    View, select, tiles_of,
};
use esker_points::task::Silent;
use esker_render::inputs::camera::{Camera, Positions};
use esker_render::{
    Background, ColourBy, ColourPlane, Dots, DrawNode, Frame, Method, PassChoice, Picture, Renderer,
};
use glam::{DMat3, DVec3};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Width and height of the pictures, which so few points fill.
const SIDE: u32 = 384;

/// A built scan, with the planes of its nodes.
struct Scan {
    file: Forest,
    planes: Vec<Planes>,
    _folder: tempfile::TempDir,
}

impl Scan {
    fn build(input: PathBuf, node_capacity: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scan.esker");
        // Only positions are read below.
        let normals = esker_engine::NormalsMode::None;
        let options = esker_builder::Options { node_capacity, normals, ..Default::default() };
        esker_builder::build(&[input], &out, &options, &Silent).unwrap();
        let file = Forest::open(&out).unwrap();
        let kinds = [PlaneKind::Position, PlaneKind::Residual];
        let nodes = 0..file.table().nodes.len() as u32;
        let planes = nodes.map(|node| file.read_planes(node, &kinds).unwrap()).collect();
        Self { file, planes, _folder: folder }
    }

    fn cut(&self, view: &View, target_px: f64, occlusion: Option<&dyn Occlusion>) -> Selection {
        let options =
            Options { target_spacing_px: target_px, points_budget: u64::MAX, ..Options::default() };
        let lattice = self.file.lattice();
        select(self.file.table(), lattice, view, &options, &AllResident, occlusion)
    }

    fn draws(&self, drawn: &[Drawn]) -> Vec<DrawNode<'_>> {
        let draw = |(entry, d): (usize, &Drawn)| {
            let planes = &self.planes[d.node as usize];
            DrawNode {
                node: &self.file.table().nodes[d.node as usize],
                entry,
                prefix: d.prefix,
                above: 0.0,
                position: planes.get(PlaneKind::Position).unwrap(),
                residual: planes.get(PlaneKind::Residual),
                colour: ColourPlane::None,
                normal: None,
                clip: None,
                tangents: None,
            }
        };
        drawn.iter().enumerate().map(draw).collect()
    }

    fn picture(&self, view: &View, cut: &Selection) -> Picture {
        self.drawn(view, cut, true)
    }

    fn drawn(&self, view: &View, cut: &Selection, averages: bool) -> Picture {
        let octree = CompactOctree::with_hidden(self.file.table(), &cut.drawn, &cut.hidden);
        let frame = Frame {
            view,
            lattice: self.file.lattice(),
            draws: &self.draws(&cut.drawn),
            octree: Some(&octree),
            method: Method::PullPush,
            colour: ColourBy::Plain,
            cull_back_faces: false,
            has_fronts: false,
            hides_points: false,
            shines: true,
            skips_push: true,
            averages,
            crowding: None,
            smooths: averages,
            fits_planes: averages,
            evens_exposure: false,
            dots: Dots::default(),
            target_spacing_px: 0.0,
            mixes_dots: false,
            passes: PassChoice::default(),
            background: Background::Plain([0, 0, 0, 255]),
        };
        Renderer::default().render(&frame).unwrap()
    }

    /// Nodes with a point that the picture of full density shows. Such a point is the nearest of
    /// its pixel, in a picture whose pixels have the depth of one point and not a mean; and it is
    /// not seen through a gap that pictures close by fitted planes and averaged points.
    fn visible(&self, view: &View) -> HashSet<u32> {
        let cut = self.cut(view, 0.0, None);
        let [picture, closed] = [false, true].map(|averages| self.drawn(view, &cut, averages));
        let camera = Camera::new(view, self.file.lattice()).unwrap();
        let shows = |draw: &DrawNode<'_>| {
            let positions = Positions::of(draw);
            let place = camera.place(draw.node, positions.is_exact());
            (0..positions.len).any(|i| {
                let from_eye = place.steps_from_anchor(positions.offset(i).0) * camera.step;
                let v = camera.to_view(from_eye);
                let scale = camera.focal_px / -v.z;
                let [x, y] = [camera.centre_px[0] + v.x * scale, camera.centre_px[1] - v.y * scale];
                let is_on = |c: f32| (0.0..SIDE as f32).contains(&c);
                -v.z > camera.near && is_on(x) && is_on(y) && {
                    let pixel = y as usize * SIDE as usize + x as usize;
                    let shown = picture.depth[pixel];
                    (-v.z - shown).abs() <= shown * 1e-6 && -v.z <= closed.depth[pixel] * 1.01
                }
            })
        };
        let draws = self.draws(&cut.drawn);
        cut.drawn.iter().zip(&draws).filter(|(_, draw)| shows(draw)).map(|(d, _)| d.node).collect()
    }
}

/// Fraction of the pixels that differ by more than 8 of 255.
fn changed(a: &Picture, b: &Picture) -> f64 {
    let (a, b) = (a.rgba.as_chunks::<4>().0, b.rgba.as_chunks::<4>().0);
    let is_off = |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|i| a[i].abs_diff(b[i]) > 8);
    a.iter().zip(b).filter(is_off).count() as f64 / a.len() as f64
}

/// Results of a source of occlusion over some views.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    hidden: usize,
    culled: usize,
    /// Nodes with a visible point that were left out.
    lost: usize,
    nodes: [u64; 2],
    points: [u64; 2],
    /// Fractions of the pixels that change: in the worst view, and over all views.
    changed_most: f64,
    changed: f64,
}

impl Sums {
    fn culled_share(&self) -> f64 {
        self.culled as f64 / self.hidden as f64
    }

    fn print(&self, what: &str) {
        let saved = |[all, some]: [u64; 2]| 100.0 * (1.0 - some as f64 / all as f64);
        println!(
            "  {what}: {:.1} % of {} hidden nodes culled, {:.1} % of nodes and {:.1} % of points saved, \
             {:.3} % of pixels changed ({:.3} % in the worst view), {} visible nodes lost",
            100.0 * self.culled_share(),
            self.hidden,
            saved(self.nodes),
            saved(self.points),
            100.0 * self.changed,
            100.0 * self.changed_most,
            self.lost,
        );
    }
}

const SOURCES: [&str; 4] = ["software depth", "last frame", "both", "last frame, camera moved"];

/// Measures all sources over some views; `step` is the distance that the camera moves in a frame.
fn measure(scan: &Scan, views: &[View], step: f64) -> [Sums; 4] {
    let mut sums = [Sums::default(); 4];
    let side = SIDE as usize;
    for view in views {
        let visible = scan.visible(view);
        let all = scan.cut(view, 1.0, None);
        let picture = scan.picture(view, &all);
        let feedback = |old: &View| {
            let old_picture = scan.picture(old, &scan.cut(old, 1.0, None));
            let tiles = tiles_of(&old_picture.depth, side, side);
            Arc::new(DepthFeedback::new(old, &tiles).unwrap().seen_from(view))
        };
        let lattice = scan.file.lattice();
        let soft = Arc::new(SoftwareDepth::new(scan.file.table(), lattice, view, &all.drawn));
        let still = feedback(view);
        let mut before = *view;
        before.eye += view.world_from_view * DVec3::new(step, 0.0, step);
        before.world_from_view *= DMat3::from_rotation_y(0.02);
        let moved = feedback(&before);
        let sources: [Vec<Arc<dyn Occlusion>>; 4] =
            [vec![soft.clone()], vec![still.clone()], vec![soft, still], vec![moved]];
        for (source, sums) in sources.iter().zip(&mut sums) {
            let some = scan.cut(view, 1.0, Some(source));
            let drawn: HashSet<u32> = some.drawn.iter().map(|d| d.node).collect();
            let shown = all.drawn.iter().map(|d| d.node).filter(|n| visible.contains(n));
            sums.lost += shown.filter(|n| !drawn.contains(n)).count();
            let hidden = all.drawn.iter().map(|d| d.node).filter(|n| !visible.contains(n));
            let (culled, left): (Vec<_>, Vec<_>) = hidden.partition(|n| !drawn.contains(n));
            sums.hidden += culled.len() + left.len();
            sums.culled += culled.len();
            for (i, c) in [all.counters, some.counters].iter().enumerate() {
                sums.nodes[i] += c.drawn;
                sums.points[i] += c.points;
            }
            let off = changed(&picture, &scan.picture(view, &some));
            sums.changed_most = sums.changed_most.max(off);
            sums.changed += off / views.len() as f64;
        }
    }
    SOURCES.iter().zip(&sums).for_each(|(what, sums)| sums.print(what));
    sums
}

fn view(eye: DVec3, target: DVec3, up: DVec3) -> View {
    let mut view = View::look_at(eye, target, up, 70f64.to_radians(), SIDE, SIDE);
    view.near = 0.05;
    view
}

/// An office and four views in it, along corridors and into rooms.
fn office(seed: u32) -> (Scan, [View; 4]) {
    let scan = Scan::build(format!("synthetic:office:1500000:{seed}").into(), 1 << 11);
    let corner = DVec3::from_array(scan.file.lattice().offset);
    let views = [
        ([3.0, 0.15, 1.6], [40.0, 0.0, 1.4]),
        ([10.0, 5.0, 1.6], [14.0, -1.0, 1.2]),
        ([30.0, -5.0, 5.0], [20.0, -2.0, 4.6]),
        ([44.0, 4.0, 1.6], [0.0, 3.0, 1.4]),
    ];
    let views =
        views.map(|(eye, at)| view(corner + DVec3::from(eye), corner + DVec3::from(at), DVec3::Z));
    (scan, views)
}

#[test]
fn in_an_office_most_hidden_nodes_are_culled_and_the_picture_stays() {
    let (scan, views) = office(1);
    let [soft, still, both, moved] = measure(&scan, &views, 0.01);
    assert!(still.culled_share() >= 0.8, "{still:?}");
    assert!(both.culled >= still.culled && moved.culled * 2 >= still.culled, "{moved:?}");
    for sums in [soft, still, both] {
        assert!(sums.changed_most < 1e-3, "{sums:?}");
    }
    // In the one frame until the next depth, gaps of up to a pixel may open.
    assert!(moved.changed < 1e-3 && moved.changed_most < 4e-3, "{moved:?}");
}

/// The worst view of one office depends on chance; the mean over several does not.
#[test]
fn over_several_offices_pictures_change_little_on_average() {
    let seeds = 2..=6;
    let offices = seeds.clone().map(|seed| {
        let (scan, views) = office(seed);
        measure(&scan, &views, 0.01)[1]
    });
    let mut changed = 0.0;
    for still in offices {
        assert!(still.culled_share() >= 0.9 && still.lost == 0, "{still:?}");
        assert!(still.changed_most < 2e-3, "{still:?}");
        changed += still.changed / seeds.clone().count() as f64;
    }
    assert!(changed < 5e-4, "{changed}");
}

/// 800 thousand uneven points, in nodes of small and of large capacity, of which three quarters are
/// culled. Boxes of the others reach past gaps in sparse walls, or out of empty space into the
/// picture, where their points do not.
#[test]
fn in_a_sparse_scan_most_hidden_nodes_are_culled_and_the_picture_stays() {
    let Some(data) = std::env::var_os("ESKER_DATA") else {
        println!("skipped: ESKER_DATA is not set");
        return;
    };
    let views = [
        ([-14.0, 0.0, 3.0], [0.0, 0.0, 0.0]),
        ([-2.0, 0.0, 2.0], [-20.0, 0.0, 2.0]),
        ([-2.0, 0.0, 4.0], [5.0, 0.0, -2.0]),
        ([-8.0, 0.5, 2.0], [-20.0, 0.0, 0.0]),
        ([-3.0, 5.5, 2.0], [-20.0, 5.0, 5.0]),
    ]
    .map(|(eye, at)| view(eye.into(), at.into(), DVec3::Y));
    for (node_capacity, culled_least) in [(1 << 10, 0.8), (1 << 11, 0.8), (1 << 12, 0.75)] {
        println!("nodes of {node_capacity}");
        let scan = Scan::build(Path::new(&data).join("laz/indoor.laz"), node_capacity);
        let [soft, still, both, moved] = measure(&scan, &views, 0.01);
        assert!(still.culled_share() >= culled_least, "{still:?}");
        for sums in [soft, still, both, moved] {
            assert!(sums.changed < 5e-4 && sums.changed_most < 1e-3, "{sums:?}");
        }
    }
}
