//! The root of a file, and prefixes of it, represent a scan as well as a Poisson-disk sample of as
//! many points: in colour (mean colours of the sample in coarse cells against those of all points),
//! and as the picture of an overview (mean FLIP against the picture of all points). Samples become
//! files of one node each, so that only the choice of points differs.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;
#[path = "../../builder/tests/poisson/mod.rs"]
#[allow(dead_code, reason = "other tests use the rest of it")]
mod poisson;

use esker_engine::Method;
use esker_engine::calls::info;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::draw::frame::{Appearance, draw_node};
use esker_engine::draw::scene::PictureRequest;
use esker_format::{Forest, PlaneKind};
use esker_lod::{AllResident, CompactOctree, Drawn, Options, View, select};
use esker_points::strata::{STRATA, stratum_len};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth, Filter, Lattice};
use esker_render::{Picture, Renderer};
use given::given;
use glam::DVec3;
use poisson::{P, Poisson, throw_indices};
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::Path;

/// Width and height of the pictures.
const SIDE: u32 = 256;
/// Most points of the root.
const CAPACITY: u32 = 8192;
/// Mean number of points of a sample in a cell whose colours are compared.
const CELL_POINTS: usize = 4;
/// Directions of view.
const VIEWS: [[f64; 3]; 3] = [[0.0, 0.02, -1.0], [0.6, 0.5, -0.6], [-0.8, 0.3, -0.4]];
/// Greatest ratios of our errors to those of the samples, of pictures and of colours; measured are
/// at most 1.06 and 1.09.
const FLIP_RATIO_MAX: f64 = 1.1;
const COLOUR_RATIO_MAX: f64 = 1.15;
/// Chance matters in few cells: Poisson-disk samples of 500 points differ by up to 12 % from each
/// other.
const FEW: (usize, f64) = (1000, 1.35);
/// Poisson-disk samples to compare with, each by another order of darts.
const ORDERS: u64 = 3;

/// A point: lattice coordinates, and the colour as drawn.
type Point = ([u32; 3], [u8; 3]);

/// All points of a file, node by node, the root first.
fn points_of(file: &Forest) -> Vec<Point> {
    let mut points = Vec::new();
    for node in 0..file.table().nodes.len() as u32 {
        let positions = file.file_of(node).read_page(node).unwrap().points().unwrap().positions;
        let planes = file.read_planes(node, &[PlaneKind::Colour]).unwrap();
        let colours = planes.get(PlaneKind::Colour).unwrap().chunks_exact(4);
        points.extend(positions.into_iter().zip(colours.map(|c| [c[0], c[1], c[2]])));
    }
    points
}

/// Builds a file of one node with these points.
fn one_node(points: &[Point], lattice: &Lattice, folder: &Path, name: &str) -> Forest {
    assert_eq!(lattice.shift, [0; 3], "raw coordinates are those of the lattice");
    let raw = |p: [u32; 3]| p.map(|c| (i64::from(c) - (1 << 31)) as i32);
    let positions = points.iter().map(|(p, _)| raw(*p)).collect();
    let mut source = given(name, lattice.scale, positions).at(lattice.offset);
    for (channel, attribute) in ["red", "green", "blue"].into_iter().enumerate() {
        source =
            source.with(attribute, AttrType::U16, |i| u64::from(points[i as usize].1[channel]));
    }
    let source = source.coloured(ColourDepth::Eight);
    let out = folder.join(format!("{name}.esker"));
    // Only the choice of points may differ: normals depend on all points of a file.
    let normals = esker_engine::NormalsMode::None;
    let options = esker_builder::Options { node_capacity: 1 << 17, normals, ..Default::default() };
    esker_builder::build_sources(vec![source.boxed()], &out, &options, &Silent).unwrap();
    let file = Forest::open(&out).unwrap();
    assert_eq!(file.table().nodes.len(), 1);
    file
}

/// Picture of all points of a file.
fn picture(file: &Forest, view: &View) -> Picture {
    let method = Method::PullPush;
    let appearance =
        Appearance::new(file, None, Vertical::default(), &Filter::default(), method, true).unwrap();
    let kinds = [PlaneKind::Position, PlaneKind::Residual, PlaneKind::Colour];
    let options = Options { points_budget: u64::MAX, target_spacing_px: 0.0, ..Options::default() };
    let lattice = file.lattice();
    let drawn = select(file.table(), lattice, view, &options, &AllResident, None).drawn;
    let planes: Vec<_> = drawn.iter().map(|d| file.read_planes(d.node, &kinds).unwrap()).collect();
    let colouring = &appearance.colouring;
    let draw = |(entry, d): (usize, &Drawn)| {
        let plane = |kind| planes[entry].get(kind);
        draw_node(file.table(), d.node, entry, d.prefix, colouring, plane)
    };
    let draws: Vec<_> = drawn.iter().enumerate().map(draw).collect();
    let octree = CompactOctree::new(file.table(), &drawn);
    let frame = appearance.frame(file, view, &draws, &octree);
    Renderer::default().render(&frame).unwrap()
}

/// Sums of colours by cells with an edge of `2^log2` steps.
fn cells(points: &[Point], log2: u32) -> HashMap<[u32; 3], ([f64; 3], f64)> {
    let mut cells: HashMap<_, ([f64; 3], f64)> = HashMap::new();
    for (p, colour) in points {
        let cell = cells.entry(p.map(|c| c >> log2)).or_default();
        (0..3).for_each(|i| cell.0[i] += f64::from(colour[i]));
        cell.1 += 1.0;
    }
    cells
}

/// Mean distance of the mean colours of cells from those of all points, in cells where the sample
/// has a point: 0 to 255.
fn colour_error(sample: &[Point], all: &[Point], log2: u32) -> f64 {
    let (all, cells) = (cells(all, log2), cells(sample, log2));
    let distance = |(cell, (sum, n)): (&[u32; 3], &([f64; 3], f64))| {
        let (all_sum, all_n) = all[cell];
        (0..3).map(|i| (sum[i] / n - all_sum[i] / all_n).powi(2)).sum::<f64>().sqrt()
    };
    cells.iter().map(distance).sum::<f64>() / cells.len() as f64
}

/// Log2 of the edge of cells that contain some points of this sample each.
fn cells_of(sample: &[Point]) -> u32 {
    let is_wide = |log2: &u32| cells(sample, *log2).len() * CELL_POINTS <= sample.len();
    (0..32).find(is_wide).unwrap_or(31)
}

/// A number for a seed (SplitMix64).
fn random(seed: u64) -> u64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Errors of a sample: in colour, and of the picture.
#[derive(Clone, Copy, Debug)]
struct Errors {
    colour: f64,
    flip: f64,
}

/// Ratio of our error to the mean of others; and a text with it and the deviation of the others
/// from their mean.
fn over(ours: f64, others: Vec<f64>) -> (f64, String) {
    let mean = others.iter().sum::<f64>() / others.len() as f64;
    let off = others.iter().map(|e| (e / mean - 1.0).abs()).fold(0.0, f64::max);
    let ratio = ours / mean;
    (ratio, format!("{ratio:.3} times Poisson's (whose differ by {off:.3})"))
}

/// A built scan, with pictures of all of it.
struct Scan {
    file: Forest,
    all: Vec<Point>,
    views: Vec<(View, Picture)>,
    folder: tempfile::TempDir,
}

impl Scan {
    fn build(input: &Path) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scan.esker");
        let normals = esker_engine::NormalsMode::None;
        let options =
            esker_builder::Options { node_capacity: CAPACITY, normals, ..Default::default() };
        esker_builder::build(&[input.to_owned()], &out, &options, &Silent).unwrap();
        let file = Forest::open(&out).unwrap();
        let all = points_of(&file);
        let [low, high] = info::bounds(&file).map(DVec3::from_array);
        let view = |direction| View::fit(low, high, DVec3::from(direction), 1.0, SIDE, SIDE);
        let views = VIEWS.map(view).map(|view| (view, picture(&file, &view)));
        Self { file, all, views: views.into(), folder }
    }

    fn errors(&self, sample: &[Point], log2: u32) -> Errors {
        let lattice = self.file.lattice();
        let file = one_node(sample, lattice, self.folder.path(), "sample");
        let flip = self.views.iter().map(|(view, expected)| {
            let picture = picture(&file, view);
            esker_truth::flip::mean_flip(&picture.rgba, &expected.rgba, SIDE as usize)
        });
        let flip = flip.sum::<f64>() / self.views.len() as f64;
        Errors { colour: colour_error(sample, &self.all, log2), flip }
    }

    /// Asserts that the root, and two prefixes of it, have errors within these ratios of
    /// Poisson-disk samples.
    fn compare(&self, name: &str) {
        let lattice = self.file.lattice();
        let world = |p: &Point| lattice.world(p.0);
        let orders: Vec<Vec<Point>> = (1..=ORDERS)
            .map(|seed| {
                let mut order: Vec<usize> = (0..self.all.len()).collect();
                order.sort_by_cached_key(|&i| random(seed << 40 | i as u64));
                order.into_iter().map(|i| self.all[i]).collect()
            })
            .collect();
        let clouds: Vec<Vec<P>> = orders.iter().map(|o| o.iter().map(world).collect()).collect();
        let mut poisson = Poisson::new(&clouds[0]);
        for share in [16, 4, 1] {
            let prefix = self.prefix(self.file.table().nodes[0].points() / share);
            poisson.sample(prefix);
            let radius = poisson.radius;
            let samples = clouds.par_iter().zip(&orders).map(|(cloud, order)| {
                let taken = throw_indices(cloud, radius);
                taken.into_iter().map(|i| order[i]).collect::<Vec<_>>()
            });
            let samples: Vec<_> = samples.collect();
            let log2 = cells_of(&self.all[..prefix]);
            let ours = self.errors(&self.all[..prefix], log2);
            let theirs: Vec<_> = samples.iter().map(|s| self.errors(s, log2)).collect();
            let [colour, flip] = [|e: &Errors| e.colour, |e: &Errors| e.flip]
                .map(|of| over(of(&ours), theirs.iter().map(of).collect()));
            println!(
                "{name}: {prefix} of {} points: colour {:.2} of 255, {}; FLIP {:.4}, {}",
                self.all.len(),
                ours.colour,
                colour.1,
                ours.flip,
                flip.1
            );
            let colour_max = if prefix < FEW.0 { FEW.1 } else { COLOUR_RATIO_MAX };
            assert!(colour.0 <= colour_max && flip.0 <= FLIP_RATIO_MAX, "{name}, {prefix} points");
        }
    }

    /// Number of points of whole strata of the root that is nearest to `count`.
    fn prefix(&self, count: usize) -> usize {
        let strata = |n| (0..STRATA).map(move |s| stratum_len(n, s));
        let mut prefixes = vec![0];
        for more in self.file.table().nodes[0].levels().flat_map(strata) {
            prefixes.push(prefixes[prefixes.len() - 1] + more);
        }
        prefixes.into_iter().min_by_key(|p| p.abs_diff(count)).unwrap()
    }
}

#[test]
fn the_root_of_an_airborne_scan_is_as_accurate_as_a_poisson_disk_sample() {
    let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
    Scan::build(&scan).compare("creek");
}

#[test]
fn the_root_of_an_office_is_as_accurate_as_a_poisson_disk_sample() {
    Scan::build("synthetic:office:300k:1".as_ref()).compare("office");
}

#[test]
fn the_root_of_an_outcrop_is_as_accurate_as_a_poisson_disk_sample() {
    let Some(data) = std::env::var_os("ESKER_DATA") else {
        println!("skipped: ESKER_DATA is not set");
        return;
    };
    Scan::build(&Path::new(&data).join("laz/example-outcrop.laz")).compare("outcrop");
}

/// A target only gives a direction, in metres as in units of a millionth of the scan.
#[test]
fn the_distance_of_the_target_does_not_change_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    for (scale, name) in [(1e-3, "room.esker"), (1e-9, "tiny.esker")] {
        // The walls of a cube of 4 m around the eye, in steps of a millimetre.
        let place = |i: i32| {
            let [u, v] = [i * 7919 % 4001 - 2000, i * 104_729 % 4001 - 2000];
            let wall = if i % 2 == 0 { -2000 } else { 2000 };
            match i / 2 % 3 {
                0 => [wall, u, v],
                1 => [u, wall, v],
                _ => [u, v, wall],
            }
        };
        let source = given("room", [scale; 3], (0..20_000).map(place).collect()).boxed();
        let out = folder.path().join(name);
        esker_builder::build_sources(vec![source], &out, &Default::default(), &Silent).unwrap();
        let file = Forest::open(&out).unwrap();
        let picture = |x: f64, is_direction: bool| {
            let what = if is_direction { "direction" } else { "target" };
            let camera = Camera::parse(&format!("eye=0,0,0;{what}={x},0,0;fovy=90")).unwrap();
            let size = [96, 72];
            let request = PictureRequest { size, camera, ..PictureRequest::default() };
            draw(&file, &request, &Silent).unwrap().0
        };
        let near = picture(1.0, false);
        assert!(near.stats.pixels_covered > 96 * 72 * 9 / 10, "{}", near.stats.pixels_covered);
        for x in [1e-6, 20_000.0, 1e9] {
            assert_eq!(picture(x, false).rgba, near.rgba, "a target at {x}");
        }
        assert_eq!(picture(1.0, true).rgba, near.rgba);
    }
}

#[test]
fn an_eye_beyond_all_steps_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let source = given("scan", [0.01; 3], vec![[0, 0, 0], [100, 100, 100]]).boxed();
    let out = folder.path().join("scan.esker");
    esker_builder::build_sources(vec![source], &out, &Default::default(), &Silent).unwrap();
    let camera = Camera::parse("eye=0,-1e13,0;target=0,0,0;fovy=0.006").unwrap();
    let request = PictureRequest { camera, ..PictureRequest::default() };
    let error = draw(&Forest::open(&out).unwrap(), &request, &Silent).unwrap_err();
    assert!(error.to_string().contains("2^46 steps"), "{error}");
}

/// A stray does not take the picture, and is mentioned.
#[test]
fn a_fitted_view_shows_the_scan_and_not_the_way_to_a_stray() {
    let folder = tempfile::tempdir().unwrap();
    let place = |i: i32| [i * 7919 % 1000, i * 104_729 % 997, i % 300];
    let drawn = |name: &str, strays: &[[i32; 3]]| {
        let mut positions: Vec<[i32; 3]> = (0..3000).map(place).collect();
        positions.extend(strays);
        let source = given(name, [0.01; 3], positions).boxed();
        let out = folder.path().join(format!("{name}.esker"));
        esker_builder::build_sources(vec![source], &out, &Default::default(), &Silent).unwrap();
        let request = PictureRequest { size: [160, 120], ..PictureRequest::default() };
        let (picture, report) = draw(&Forest::open(&out).unwrap(), &request, &Silent).unwrap();
        let columns = picture.depth.iter().enumerate().filter(|(_, depth)| depth.is_finite());
        let columns: Vec<_> = columns.map(|(i, _)| i % 160).collect();
        let width = columns.iter().max().unwrap() - columns.iter().min().unwrap();
        (width, report.notes.join("\n"))
    };
    let (whole, notes) = drawn("room", &[]);
    assert!(!notes.contains("far outside"), "{notes}");
    for strays in [&[[6_000_000, 0, 0]][..], &[[0, -50_000, 0], [0, 0, 90_000]]] {
        let (width, notes) = drawn("stray", strays);
        assert!(width * 10 > whole * 9, "{width} of {whole} pixels");
        assert!(notes.contains("a few lie far outside"), "{notes}");
    }
    // A tenth of the points is no stray.
    let tower: Vec<[i32; 3]> = (0..300).map(|i| [500, 500, 20 * i]).collect();
    let (_, notes) = drawn("tower", &tower);
    assert!(!notes.contains("far outside"), "{notes}");
}
