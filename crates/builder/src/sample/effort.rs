//! Counts operations in tests: distances computed by a search of neighbours and by thinning. Time
//! would depend on the machine; what must hold is how the count grows with the number of points.

use std::cell::Cell;

/// Greatest slope, on logarithmic axes, of operations over points.
const SLOPE_MAX: f64 = 1.1;

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

/// Adds operations of this thread.
pub fn add(operations: usize) {
    OPERATIONS.with(|all| all.set(all.get() + operations as u64));
}

/// Starts counting from zero.
pub fn restart() {
    OPERATIONS.with(|all| all.set(0));
}

/// Asserts that the operations of `work`, which gets a number of points, grow no faster than the
/// number, from `points` points to 16 times as many. Up to `usual` operations a point may be due to
/// octaves of cells and radii, which begin elsewhere for another number.
pub fn assert_linear(name: &str, (points, usual): (usize, usize), mut work: impl FnMut(usize)) {
    let [few, many] = [points, points * 16].map(|n| {
        restart();
        work(n);
        OPERATIONS.with(Cell::get).max((n * usual) as u64) as f64
    });
    let slope = (many / few).log2() / 16f64.log2();
    assert!(slope <= SLOPE_MAX, "{name}: {few} and {many} operations, a slope of {slope:.2}");
}

/// A cloud with this number of points.
type Cloud = fn(usize) -> Vec<[u32; 3]>;

/// Clouds of which a part of the points is far denser than the rest.
pub const CLOUDS: [(&str, Cloud); 9] = [
    ("one stack and a point", |n| {
        (0..n).map(|i| if i == 0 { [1000, 0, 0] } else { [0; 3] }).collect()
    }),
    ("half in one stack", |n| {
        (0..n).map(|i| if i % 2 == 0 { [1 << 29; 3] } else { square(i, 1 << 30) }).collect()
    }),
    ("a few stacks", |n| (0..n).map(|i| cube(i % 20, 3000)).collect()),
    ("a square a million times denser", |n| {
        let dense = |i| square(i, 1 << 20).map(|c| c + (1 << 29));
        (0..n).map(|i| if i % 2 == 0 { dense(i) } else { square(i, 1 << 30) }).collect()
    }),
    ("a cube a billion times denser", |n| {
        let dense = |i| cube(i, 1 << 20).map(|c| c + (1 << 29));
        (0..n).map(|i| if i % 2 == 0 { dense(i) } else { cube(i, 1 << 30) }).collect()
    }),
    ("an outlier", |n| {
        (0..n).map(|i| if i == 0 { [1 << 30; 3] } else { square(i, 1 << 14) }).collect()
    }),
    ("two clusters", |n| {
        (0..n).map(|i| cube(i, 1 << 11).map(|c| c + ((i as u32 & 1) << 29))).collect()
    }),
    ("densities of 25 octaves", |n| (0..n).map(|i| square(i, 1 << (5 + mixed(i) % 26))).collect()),
    ("spheres", |n| (0..n).map(|i| sphere(i, if i % 2 == 0 { 1e5 } else { 1e3 })).collect()),
];

/// Hash of a number (`steele2014`).
fn mixed(i: usize) -> u64 {
    let z = (i as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn below(i: usize, edge: u32) -> u32 {
    (mixed(i) >> 32) as u32 % edge
}

fn square(i: usize, edge: u32) -> [u32; 3] {
    [below(2 * i, edge), below(2 * i + 1, edge), 0]
}

fn cube(i: usize, edge: u32) -> [u32; 3] {
    [0, 1, 2].map(|axis| below(3 * i + axis, edge))
}

/// A point of a sphere with this radius.
fn sphere(i: usize, radius: f64) -> [u32; 3] {
    let unit = |i: usize| f64::from(below(i, 1 << 30)) / f64::from(1 << 30);
    let (turn, up) = (unit(2 * i) * std::f64::consts::TAU, unit(2 * i + 1) * 2.0 - 1.0);
    let across = (1.0 - up * up).sqrt();
    [across * turn.cos(), across * turn.sin(), up].map(|c| (200_000.0 + radius * c) as u32)
}
