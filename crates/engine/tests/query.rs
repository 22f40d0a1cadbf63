//! Queries give the points of the pages: all columns, in parts too, single points, those of pixels,
//! and of points that were built from a program's memory exactly what it gave.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_engine::calls::build::{build, build_given};
use esker_engine::calls::query::{PointColumns, PointGrid, PointQuery, read_points};
use esker_engine::calls::render::draw_with_layers;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::layers::{LayerChoice, NO_POINT};
use esker_engine::draw::scene::PictureRequest;
use esker_engine::given::{Coordinates, GivenInfo, Points};
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{AttrType, Attribute, BuildOptions, Filter, Forest, Grid, Method, Task, Window};
use esker_points::task::Silent;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Rows of a file: each point as steps and the bytes of its attributes, with their number.
type Rows = BTreeMap<Vec<u8>, usize>;

fn sample(name: &str) -> Arc<Forest> {
    let path = Path::new("../../data-format/samples").join(name);
    Arc::new(Forest::open(&path).unwrap())
}

fn rows(points: &PointColumns, sizes: &[usize]) -> Rows {
    let mut rows = Rows::new();
    for i in 0..points.len() {
        let mut row: Vec<u8> = points.steps.iter().flat_map(|s| s[i].to_le_bytes()).collect();
        for (column, size) in points.columns.iter().zip(sizes) {
            row.extend_from_slice(&column[i * size..][..*size]);
        }
        *rows.entry(row).or_default() += 1;
    }
    rows
}

/// All points of a file as its pages have them, decoded as a whole.
fn pages(forest: &Forest) -> PointColumns {
    let schema = forest.schema();
    let grid = PointGrid::of(forest);
    let origin: [i32; 3] = [0, 1, 2].map(|axis| {
        // Steps grow with lattice coordinates, and the world of both is the same.
        let world = grid.world([1 << 31; 3])[axis];
        ((world - grid.offset[axis]) / grid.scale[axis]).round() as i32
    });
    let mut all = PointColumns {
        columns: vec![Vec::new(); schema.attributes.len()],
        ..PointColumns::default()
    };
    for file in forest.files() {
        for node in 0..file.table().nodes.len() as u32 {
            let points = file.read_page(node).unwrap().points().unwrap();
            for p in &points.positions {
                for axis in 0..3 {
                    let from_middle = i64::from(p[axis]) - (1 << 31);
                    all.steps[axis].push((from_middle + i64::from(origin[axis])) as i32);
                }
            }
            for (column, attribute) in all.columns.iter_mut().zip(&schema.attributes) {
                let own = file.layout().schema().find_typed(&attribute.name, attribute.ty);
                match own {
                    Some(own) => column.extend_from_slice(&points.columns[own]),
                    None => {
                        column.resize(column.len() + points.len() * attribute.ty.size(), 0);
                    }
                }
            }
        }
    }
    all
}

fn sizes(forest: &Forest) -> Vec<usize> {
    forest.schema().attributes.iter().map(|a| a.ty.size()).collect()
}

fn query(forest: &Arc<Forest>, columns: Option<&[usize]>) -> PointQuery {
    PointQuery::new(forest.clone(), &Filter::default(), columns, 2).unwrap()
}

#[test]
fn all_columns_are_those_of_the_pages() {
    for name in ["small.esker", "all-kinds.esker", "degrees.esker", "forest-second.esker"] {
        let forest = sample(name);
        let found = query(&forest, None).read(None, &Silent).unwrap().unwrap();
        assert_eq!(found.len() as u64, forest.points(), "{name}");
        let sizes = sizes(&forest);
        assert_eq!(rows(&found, &sizes), rows(&pages(&forest), &sizes), "{name}");
    }
    let empty = sample("empty.esker");
    assert_eq!(query(&empty, None).read(None, &Silent).unwrap(), None);
}

#[test]
fn one_column_is_that_of_all_and_parts_are_those_of_the_whole() {
    let forest = sample("all-kinds.esker");
    let whole = query(&forest, None).read(None, &Silent).unwrap().unwrap();
    for (index, attribute) in forest.schema().attributes.iter().enumerate() {
        let mut single = query(&forest, Some(&[index]));
        assert_eq!(single.attributes(), std::slice::from_ref(attribute));
        let found = single.read(None, &Silent).unwrap().unwrap();
        assert_eq!(found.columns[0], whole.columns[index], "{}", attribute.name);
        assert_eq!(found.steps, whole.steps);
    }
    for part in [1, 7, 1000, usize::MAX] {
        let mut parts = query(&forest, None);
        let mut joined = PointColumns {
            columns: vec![Vec::new(); whole.columns.len()],
            ..PointColumns::default()
        };
        while let Some(found) = parts.read(Some(part), &Silent).unwrap() {
            let left = whole.len() - joined.len();
            assert_eq!(found.len(), part.min(left));
            for (to, from) in joined.steps.iter_mut().zip(found.steps) {
                to.extend(from);
            }
            for (to, from) in joined.columns.iter_mut().zip(found.columns) {
                to.extend(from);
            }
        }
        assert_eq!(joined, whole, "parts of {part}");
    }
    assert!(PointQuery::new(forest, &Filter::default(), Some(&[99]), 1).is_err());
}

/// Is cancelled once some points are read.
struct Stops(AtomicU64);

impl Task for Stops {
    fn advance(&self, by: u64) {
        self.0.fetch_add(by, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) > 0
    }
}

#[test]
fn a_query_that_was_stopped_gives_no_rest() {
    let mut query = query(&sample("forest-second.esker"), None);
    let error = query.read(None, &Stops(AtomicU64::new(1))).unwrap_err();
    assert!(error.to_string().contains("stopped on request"), "{error}");
    let error = query.read(Some(10), &Silent).unwrap_err();
    assert!(error.to_string().contains("begin again"), "{error}");
}

#[test]
fn single_points_come_in_the_order_that_is_given() {
    for name in ["all-kinds.esker", "forest-second.esker"] {
        let forest = sample(name);
        let (nodes, sizes) = (&forest.table().nodes, sizes(&forest));
        let mut places: Vec<[u32; 2]> = Vec::new();
        for (node, record) in (0..).zip(nodes) {
            places.extend((0..record.points() as u32).map(|point| [node, point]));
        }
        // Any order, some twice.
        places.sort_by_key(|[node, point]| (node * 7 + point * 13) % 101);
        places.extend_from_within(..10);
        let (_, found) = read_points(&forest, &places, None, 2, &Silent).unwrap();
        assert_eq!(found.len(), places.len());
        for (i, place) in places.iter().enumerate().step_by(97) {
            let (_, one) = read_points(&forest, &[*place], None, 1, &Silent).unwrap();
            assert_eq!([0, 1, 2].map(|a| one.steps[a][0]), [0, 1, 2].map(|a| found.steps[a][i]));
            for ((one, all), size) in one.columns.iter().zip(&found.columns).zip(&sizes) {
                assert_eq!(one[..], all[i * size..][..*size]);
            }
        }
        let beyond = [nodes.len() as u32, 0];
        let error = read_points(&forest, &[beyond], None, 1, &Silent).unwrap_err();
        assert!(error.to_string().contains("has no point 0"), "{error}");
    }
}

#[test]
fn each_pixel_that_shows_something_has_a_normal_and_each_pixel_of_points_a_point() {
    let folder = tempfile::tempdir().unwrap();
    let built = folder.path().join("creek.esker");
    let scan = "../../tests/sample/creek.laz".into();
    let options = BuildOptions { node_capacity: 4096, ..BuildOptions::default() };
    build(&[scan], &built, &options, 2, &Silent).unwrap();
    let forest = Forest::open(&built).unwrap();
    let camera = Camera::parse("direction=0,0,-1;up=0,1,0;ortho=fit").unwrap();
    let with = DrawWith { backend: Backend::Cpu, ..DrawWith::default() };
    let wanted = LayerChoice { normals: true, points: true };
    for (method, has_points) in [(Method::Points, true), (Method::PullPush, false)] {
        let base = PictureRequest { size: [60, 40], method, camera, with, ..Default::default() };
        let (picture, report, layers) = draw_with_layers(&forest, &base, wanted, &Silent).unwrap();
        assert!(report.pixels_covered > 100, "{method:?}");
        let mut found = 0;
        for (pixel, depth) in picture.depth.iter().enumerate() {
            let normal = layers.normals[pixel];
            let length = normal.iter().map(|n| n * n).sum::<f32>().sqrt();
            assert_eq!(depth.is_finite(), (length - 1.0).abs() < 1e-4, "{method:?} {normal:?}");
            let [node, point] = layers.points[pixel];
            let is_point = layers.points[pixel] != NO_POINT;
            assert!(depth.is_finite() || !is_point);
            assert!(!has_points || depth.is_finite() == is_point);
            assert!(!is_point || (point as usize) < forest.record(node).points());
            found += u32::from(is_point);
        }
        assert!(found > 100, "{method:?}");
        let window = Window { x: 11, y: 7, width: 30, height: 20 };
        let part = PictureRequest { window: Some(window), ..base };
        let (_, _, part) = draw_with_layers(&forest, &part, wanted, &Silent).unwrap();
        for (pixel, place) in part.points.iter().enumerate() {
            let at = (pixel / 30 + 7) * 60 + pixel % 30 + 11;
            assert!(!has_points || *place == layers.points[at]);
        }
    }
    let lit = PictureRequest { method: Method::Lit, ..Default::default() };
    let error = draw_with_layers(&forest, &lit, wanted, &Silent).unwrap_err();
    assert!(error.to_string().contains("neither lit"), "{error}");
}

/// Points in memory: coordinates, and their numbers as an attribute.
struct Numbered<T>(Vec<[T; 3]>, fn(Vec<[T; 3]>) -> Coordinates);

impl<T: Copy + Send + Sync> Points for Numbered<T> {
    fn coordinates(&self, range: Range<usize>) -> Result<Coordinates, String> {
        Ok(self.1(self.0[range].to_vec()))
    }

    fn column(&self, _: usize, range: Range<usize>) -> Result<Vec<u8>, String> {
        Ok(range.flat_map(|i| (i as u32).to_le_bytes()).collect())
    }
}

fn info(count: usize, grid: Option<Grid>) -> GivenInfo {
    let attributes = vec![Attribute::new("number", AttrType::U32)];
    GivenInfo { name: "memory".into(), count, grid, attributes }
}

#[test]
fn steps_of_a_program_come_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("given.esker");
    let place = |i: i64| [7_919, -104_729, 1_299_709].map(|k| (i * k * 1_000_003) as i32);
    let mut steps: Vec<[i32; 3]> = (0..70_000).map(place).collect();
    steps.extend([[i32::MIN; 3], [i32::MAX; 3], [0; 3], [0; 3]]);
    let grid = Grid { scale: [0.01, 0.02, 0.5], offset: [1e6, -3.25, 0.1] };
    let given = Box::new(Numbered(steps.clone(), Coordinates::Steps));
    let options = BuildOptions { refuse_loss: true, ..BuildOptions::default() };
    let report =
        build_given(info(steps.len(), Some(grid)), given, &out, &options, 2, &Silent).unwrap();
    assert_eq!((report.points_out, report.rounding_error_max), (steps.len() as u64, 0.0));
    let forest = Arc::new(Forest::open(&out).unwrap());
    let own = PointGrid::of(&forest);
    assert_eq!((own.scale, own.offset), (grid.scale, grid.offset));
    let found = query(&forest, None).read(None, &Silent).unwrap().unwrap();
    let numbers = found.columns[0].as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b));
    let mut seen = vec![false; steps.len()];
    for (i, number) in numbers.enumerate() {
        assert_eq!([0, 1, 2].map(|a| found.steps[a][i]), steps[number as usize]);
        assert!(!std::mem::replace(&mut seen[number as usize], true));
    }
    assert!(seen.into_iter().all(|seen| seen));
}

#[test]
fn coordinates_that_are_no_places_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("given.esker");
    let mut places = vec![[0.5, 1.5, 2.5]; 100];
    places[61][2] = f64::NAN;
    for grid in [None, Some(Grid { scale: [0.01; 3], offset: [0.0; 3] })] {
        let given = Box::new(Numbered(places.clone(), Coordinates::World));
        let options = BuildOptions::default();
        let error = build_given(info(100, grid), given, &out, &options, 1, &Silent).unwrap_err();
        assert!(error.to_string().contains("row 61"), "{error}");
    }
    let far = vec![[1e9, 0.0, 0.0]; 2];
    let grid = Grid { scale: [1e-3; 3], offset: [0.0; 3] };
    let given = Box::new(Numbered(far, Coordinates::World));
    let options = BuildOptions::default();
    let error = build_given(info(2, Some(grid)), given, &out, &options, 1, &Silent).unwrap_err();
    assert!(error.to_string().contains("choose a greater scale"), "{error}");
    assert_eq!(folder.path().read_dir().unwrap().count(), 0);
}
