//! Conditions of generated clouds are those that the clouds were made with, in any unit and at any
//! place.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_builder::{NormalsMode, Options, build_sources};
use esker_engine::Forest;
use esker_engine::calls::conditions::{ConditionRow, ConditionsReport, of_forest, text};
use esker_points::task::Silent;
use given::given;

/// Steps of a unit of the clouds.
const STEPS: f64 = 256.0;
/// Points of a cloud.
const POINTS: usize = 20_000;

/// Numbers in 0..1 that fill a square evenly (an additive recurrence with the plastic number).
fn even(count: usize) -> impl Iterator<Item = [f64; 2]> {
    let share = |i: usize, k: f64| (i as f64 * k).fract();
    (1..=count).map(move |i| [share(i, 0.754_877_666_246_693), share(i, 0.569_840_290_998_053)])
}

/// A pseudo-random number in 0..1 of an index and a seed.
fn random(at: usize, seed: u64) -> f64 {
    let mut x = (at as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ seed.wrapping_mul(0xd6e8_feb8_6659_fd93);
    for _ in 0..2 {
        x = (x ^ (x >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    }
    ((x ^ (x >> 32)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A normally distributed number.
fn normal(at: usize, seed: u64) -> f64 {
    let turn = std::f64::consts::TAU * random(at, seed + 1);
    (-2.0 * random(at, seed).max(1e-300).ln()).sqrt() * turn.cos()
}

/// Even points at a distance of 1 in a square.
fn plane(count: usize) -> Vec<[f64; 3]> {
    let side = (count as f64).sqrt();
    even(count).map(|[a, b]| [a * side, b * side, 0.0]).collect()
}

/// Builds a cloud whose unit is `unit` long, moved by `offset`, and measures it.
fn measured(
    places: &[[f64; 3]],
    steps: f64,
    unit: f64,
    offset: f64,
    capacity: u32,
) -> ConditionsReport {
    let positions = places.iter().map(|place| place.map(|c| (c * steps).round() as i32)).collect();
    let source = given("cloud", [unit / steps; 3], positions).at([offset; 3]);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cloud.esker");
    let options =
        Options { normals: NormalsMode::None, node_capacity: capacity, ..Options::default() };
    build_sources(vec![Box::new(source)], &file, &options, &Silent).unwrap();
    of_forest(&Forest::open(&file).unwrap(), &Silent).unwrap()
}

/// A condition of a cloud in one cell.
fn hardest(places: &[[f64; 3]], condition: &str) -> f64 {
    row(&measured(places, STEPS, 1.0, 0.0, 1 << 16), condition).hardest.unwrap()
}

fn row(report: &ConditionsReport, condition: &str) -> ConditionRow {
    report.conditions.iter().find(|row| row.condition == condition).unwrap().clone()
}

fn assert_near(measured: f64, wanted: f64, factor: f64, what: &str) {
    let is_near = measured >= wanted / factor && measured <= wanted * factor;
    assert!(is_near, "{what}: {measured}, not {wanted} within a factor of {factor}");
}

/// A dense square in a sparse one.
fn jump(ratio: f64) -> Vec<[f64; 3]> {
    let (dense, around) = (POINTS * 15 / 16, POINTS / 16);
    let (inner, sparse) = ((dense as f64).sqrt() / 2.0, ratio.sqrt());
    let covered = (4.0 * inner * inner / ratio) as usize;
    let outer = ((around + covered) as f64).sqrt() * sparse / 2.0;
    let at = |count: usize, half: f64| {
        even(count).map(move |[a, b]| [(2.0 * a - 1.0) * half, (2.0 * b - 1.0) * half, 0.0])
    };
    let is_outside = |p: &[f64; 3]| p[0].abs().max(p[1].abs()) > inner;
    at(dense, inner).chain(at(around + covered, outer).filter(is_outside)).collect()
}

#[test]
fn jumps_of_density_are_found() {
    assert!(hardest(&plane(POINTS), "density-jump") < 1.6);
    let scattered: Vec<[f64; 3]> =
        (0..POINTS).map(|i| [random(i, 1) * 141.0, random(i, 2) * 141.0, 0.0]).collect();
    assert!(hardest(&scattered, "density-jump") < 2.5);
    for ratio in [10.0, 100.0, 1e4] {
        assert_near(hardest(&jump(ratio), "density-jump"), ratio, 1.6, "density jump");
    }
}

#[test]
fn steps_and_noise_are_relative_to_the_distance_of_points() {
    let flat = plane(POINTS);
    for per_unit in [4.0, 1.0, 0.5] {
        let report = measured(&flat, per_unit, 1.0, 0.0, 1 << 16);
        assert_near(row(&report, "step").hardest.unwrap(), 1.0 / per_unit, 1.2, "step");
    }
    assert!(hardest(&flat, "noise") < 0.01);
    for noise in [0.05, 0.2, 0.5] {
        let rough: Vec<[f64; 3]> =
            flat.iter().enumerate().map(|(i, [x, y, _])| [*x, *y, noise * normal(i, 3)]).collect();
        assert_near(hardest(&rough, "noise"), noise, 1.25, "noise");
    }
}

#[test]
fn rows_of_a_scanner_are_told_from_even_and_random_points() {
    assert!(hardest(&plane(POINTS), "scan-lines") < 2.0);
    let scattered: Vec<[f64; 3]> =
        (0..POINTS).map(|i| [random(i, 4) * 141.0, random(i, 5) * 141.0, 0.0]).collect();
    assert!(hardest(&scattered, "scan-lines") < 2.0);
    for ratio in [3.0f64, 10.0, 50.0] {
        let (column, row) = (1.0 / ratio.sqrt(), ratio.sqrt());
        let columns = (141.0 / column) as usize;
        let lined: Vec<[f64; 3]> = (0..(141.0 / row) as usize * columns)
            .map(|i| {
                let off = |seed: u64| 0.05 * column * normal(i, seed);
                let at = [(i % columns) as f64 * column, (i / columns) as f64 * row];
                [at[0] + off(6), at[1] + off(8), off(10)]
            })
            .collect();
        assert_near(hardest(&lined, "scan-lines"), ratio, 1.3, "scan lines");
    }
}

#[test]
fn points_at_one_place_are_counted() {
    assert!(hardest(&plane(POINTS), "same-place") < 1e-3);
    let mut places = plane(POINTS / 2);
    places.extend(std::iter::repeat_n([20.5, 20.5, 0.0], POINTS / 2));
    assert_near(hardest(&places, "same-place"), 0.5, 1.01, "share at one place");
}

#[test]
fn thin_strips_are_told_from_surfaces() {
    assert!(hardest(&plane(POINTS), "thickness") > 4.0);
    for width in [2.0f64, 0.1] {
        let strips = (0..12).flat_map(|strip| {
            let count = (600.0 * width.max(1.0)) as usize;
            let at =
                move |[a, b]: [f64; 2]| [a * 600.0, f64::from(strip) * 1000.0 + b * width, 0.0];
            even(count).map(at)
        });
        let strips: Vec<[f64; 3]> = strips.collect();
        assert_near(hardest(&strips, "thickness"), width, 1.5, "width of strips");
    }
}

#[test]
fn values_are_those_of_any_unit_place_and_capacity() {
    let rough: Vec<[f64; 3]> = jump(100.0)
        .into_iter()
        .enumerate()
        .map(|(i, [x, y, _])| [x, y, 0.1 * normal(i, 12)])
        .collect();
    let own = measured(&rough, STEPS, 1.0, 0.0, 1 << 16);
    // Powers of two leave every coordinate as it is; other units and places choose other points.
    let exact = measured(&rough, STEPS, 2f64.powi(-10), 2f64.powi(19), 1 << 16);
    let other = measured(&rough, STEPS, 0.001, 5e5, 1 << 16);
    for (row, (exact, other)) in
        own.conditions.iter().zip(exact.conditions.iter().zip(&other.conditions))
    {
        let [own, exact, other] = [row, exact, other].map(|row| row.hardest.unwrap());
        assert!((own - exact).abs() <= 1e-9 * own, "{}: {own} {exact}", row.condition);
        assert_near(other, own, 1.3, row.condition);
    }
}

#[test]
fn large_scans_are_measured_by_cells() {
    let many = plane(20 * POINTS);
    let small = measured(&many, STEPS, 1.0, 0.0, 4096);
    assert!(small.cells > 4 && small.cells_read > 4 && small.cells_read <= 32, "{small:?}");
    assert!(row(&small, "density-jump").hardest.unwrap() < 2.0);
    assert!(row(&small, "noise").hardest.unwrap() < 0.01);
    assert_near(row(&small, "step").typical.unwrap(), 1.0 / STEPS, 1.2, "step in many cells");
}

#[test]
fn what_is_beyond_the_rated_values_is_marked() {
    let easy = measured(&plane(POINTS), STEPS, 1.0, 0.0, 1 << 16);
    assert!(easy.conditions.iter().flat_map(|row| &row.rated).all(|rated| rated.is_within));
    assert!(!text(&easy).contains("BEYOND"), "{}", text(&easy));
    let hard = measured(&jump(1e4), STEPS, 1.0, 0.0, 1 << 16);
    assert!(row(&hard, "density-jump").rated.iter().all(|rated| !rated.is_within));
    assert!(text(&hard).contains("pull-push holes 1 BEYOND"), "{}", text(&hard));
    let empty = measured(&[[0.0; 3], [1.0; 3]], STEPS, 1.0, 0.0, 1 << 16);
    assert_eq!(row(&empty, "noise").hardest, None);
}
