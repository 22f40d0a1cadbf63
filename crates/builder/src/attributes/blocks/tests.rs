//! Accuracy on generated surfaces, shapes that are no surface, chunks.

use super::plane::VOLUME;
use super::*;
use crate::attributes::density::Distances;
use crate::attributes::eigen::Eigen;
use crate::attributes::normals::{Bounds, LINE, stored};
use crate::attributes::surfaces::{Truth, plane, sphere, tilted, two_walls};
use crate::random::Random;
use esker_points::{Cell, quant};
use proptest::prelude::*;

const SCALE: f64 = 0.001;

fn blocks(scale: [f64; 3], spacing: f64) -> Blocks {
    Blocks::new(scale, &Distances { spacing, steps_max: f64::INFINITY })
}

/// Codes as pages store them.
fn estimate(own: &[[u32; 3]], halo: &[[u32; 3]], blocks: &Blocks) -> Vec<[i16; 2]> {
    super::estimate(own, halo, blocks).into_iter().map(stored).collect()
}

fn sorted(mut points: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    points.sort_by_key(|&p| morton::encode3(p));
    points
}

fn lattice(p: [f64; 3]) -> [u32; 3] {
    p.map(|c| (c / SCALE + 2e9).round() as u32)
}

/// Median and 95th percentile of the angles to the true normals, degrees, and the share of points
/// without a normal.
fn errors(points: &Truth, spacing_m: f64) -> [f64; 3] {
    let mut along: Vec<_> = points.iter().map(|&(p, n)| (lattice(p), n)).collect();
    along.sort_by_key(|&(p, _)| morton::encode3(p));
    let own: Vec<_> = along.iter().map(|s| s.0).collect();
    let codes = estimate(&own, &[], &blocks([SCALE; 3], spacing_m / SCALE));
    let known = codes.iter().zip(&along).filter(|(code, _)| **code != UNKNOWN);
    let angle = |(&code, (_, n)): (&[i16; 2], &([u32; 3], [f64; 3]))| {
        let ours = quant::oct_decode(code).map(f64::from);
        let cosine: f64 = (0..3).map(|i| ours[i] * n[i]).sum();
        cosine.abs().min(1.0).acos().to_degrees()
    };
    let mut angles: Vec<f64> = known.map(angle).collect();
    angles.sort_by(f64::total_cmp);
    let share = 1.0 - angles.len() as f64 / own.len() as f64;
    let at = |part: usize| angles.get(angles.len() * part / 100).copied().unwrap_or(f64::NAN);
    [at(50), at(95), share]
}

#[test]
fn no_cell_extends_over_the_limit_on_any_axis() {
    for scale in [[1e-2, 1e-2, 1e-7], [1e-5, 1e-2, 1e-2], [1e-3, 1e-4, 1e-3]] {
        for steps_max in [1.0, 2.0, 700.0, 65_536.0] {
            for spacing in [0.01, 1.0, 1e6] {
                let distances = Distances { spacing, steps_max };
                let steps = Blocks::new(scale, &distances).steps();
                assert!(steps.iter().all(|&s| f64::from(s) <= steps_max), "{scale:?} {steps:?}");
                let bounds = Bounds::new(scale, &distances);
                assert!(bounds.steps().iter().all(|&s| f64::from(s) <= steps_max + 1.0));
            }
        }
    }
}

#[test]
fn steps_may_differ_between_axes() {
    let points = sphere(4.5);
    let share = |scale: [f64; 3]| {
        let on = |p: [f64; 3]| [0, 1, 2].map(|i| (p[i] / scale[i] + 2e9).round() as u32);
        let mut along: Vec<_> = points.iter().map(|&(p, n)| (on(p), n)).collect();
        along.sort_by_key(|&(p, _)| morton::encode3(p));
        let own: Vec<_> = along.iter().map(|s| s.0).collect();
        let longest = scale.into_iter().fold(0.0, f64::max);
        let codes = estimate(&own, &[], &blocks(scale, 0.125 / longest));
        let near = codes.iter().zip(&along).filter(|(code, (_, n))| {
            let ours = quant::oct_decode(**code).map(f64::from);
            (0..3).map(|i| ours[i] * n[i]).sum::<f64>().abs() > 0.998
        });
        near.count() as f64 / own.len() as f64
    };
    let scales = [[1e-3, 1e-4, 1e-3], [1e-3, 1e-3, 1e-5], [1e-2, 1e-5, 1e-7], [1e-6, 1e-3, 1e-3]];
    for scale in scales {
        assert!(share(scale) > 0.98, "{scale:?}: {}", share(scale));
    }
}

#[test]
fn noise_turns_normals_of_planes_by_a_few_degrees() {
    for (noise_m, median, most) in [(0.0, 0.2, 0.5), (0.007, 1.6, 4.0), (0.021, 4.8, 12.0)] {
        let [middle, worst, unknown] = errors(&plane(noise_m), 0.07);
        assert!(middle < median && worst < most, "{noise_m}: {middle} {worst}");
        assert!(unknown < 0.01, "{noise_m}: {unknown}");
    }
}

#[test]
fn a_sphere_of_36_spacings_has_radial_normals() {
    let [middle, worst, unknown] = errors(&sphere(4.5), 0.125);
    assert!(middle < 1.5 && worst < 3.0 && unknown < 0.01, "{middle} {worst} {unknown}");
}

#[test]
fn edges_are_blurred_by_no_more_than_a_block() {
    // Two walls of 5 m at a right angle. Normals are wrong only within five spacings of the edge.
    let points = two_walls();
    let [middle, most, unknown] = errors(&points, 0.05);
    assert!(middle < 0.1 && most < 45.0 && unknown < 0.01, "{middle} {most} {unknown}");
    let far: Truth = points.into_iter().filter(|(p, _)| p[0] + p[2] > 0.3).collect();
    let [_, worst, _] = errors(&far, 0.05);
    assert!(worst < 0.1, "{worst}");
}

/// Of the points within six spacings of the edge between two walls, the share whose normals are
/// more than 20 degrees off, and the share without a normal.
fn wrong_at_edges(turn: impl Fn([f64; 3]) -> [f64; 3], noise_m: f64) -> [f64; 2] {
    let mut r = Random(7);
    let near: Vec<_> = two_walls().into_iter().filter(|(p, _)| p[0] + p[2] < 1.0).collect();
    let noisy = near.into_iter().map(|(p, n)| {
        let off = r.bell() * noise_m;
        (turn([0, 1, 2].map(|i| p[i] + n[i] * off)), turn(n), p)
    });
    let mut along: Vec<_> = noisy.map(|(p, n, flat)| (lattice(p), n, flat)).collect();
    along.sort_by_key(|&(p, ..)| morton::encode3(p));
    let own: Vec<_> = along.iter().map(|s| s.0).collect();
    let codes = estimate(&own, &[], &blocks([SCALE; 3], 50.0));
    let (mut wrong, mut unknown, mut all) = (0, 0, 0);
    for (code, (_, n, flat)) in codes.into_iter().zip(&along) {
        if flat[0] + flat[2] > 0.3 {
            continue;
        }
        let ours = quant::oct_decode(code).map(f64::from);
        let cosine = (0..3).map(|i| ours[i] * n[i]).sum::<f64>().abs();
        all += 1;
        unknown += usize::from(code == UNKNOWN);
        wrong += usize::from(code != UNKNOWN && cosine < 0.94);
    }
    [wrong, unknown].map(|n| f64::from(n as u32) / f64::from(all))
}

/// Turns a direction by 31 degrees about z, then by 23 about x.
fn askew([x, y, z]: [f64; 3]) -> [f64; 3] {
    let (s, c) = (0.515, 0.857_191_25);
    let [x, y] = [c * x - s * y, s * x + c * y];
    let (s, c) = (0.391, 0.920_385_8);
    [x, c * y - s * z, s * y + c * z]
}

#[test]
fn edges_are_sharp() {
    for (noise_m, most) in [(0.0, 0.05), (0.005, 0.07), (0.015, 0.1)] {
        for [wrong, unknown] in [wrong_at_edges(|p| p, noise_m), wrong_at_edges(askew, noise_m)] {
            assert!(wrong < most && unknown < 0.09, "{noise_m}: {wrong} {unknown}");
        }
    }
}

#[test]
fn three_planes_meet_at_the_corners_of_a_cube() {
    // Points at most 3.5 spacings from a corner.
    let mut r = Random(8);
    let mut face = |axis: usize| {
        let (mut p, mut n) = ([0; 3].map(|_| r.unit() * 2.0), [0.0; 3]);
        (p[axis], n[axis]) = (0.0, 1.0);
        (askew(p), askew(n))
    };
    let points: Truth = (0..4800).map(|i| face(i % 3)).collect();
    let mut along: Vec<_> = points.iter().map(|&(p, n)| (lattice(p), n, p)).collect();
    along.sort_by_key(|&(p, ..)| morton::encode3(p));
    let own: Vec<_> = along.iter().map(|s| s.0).collect();
    let codes = estimate(&own, &[], &blocks([SCALE; 3], 50.0));
    let at_corner = |p: &[f64; 3]| p.iter().map(|c| c * c).sum::<f64>() < 0.175 * 0.175;
    let near: Vec<_> = codes.iter().zip(&along).filter(|(_, (.., p))| at_corner(p)).collect();
    let right = near.iter().filter(|(code, (_, n, _))| {
        let ours = quant::oct_decode(**code).map(f64::from);
        **code != UNKNOWN && (0..3).map(|i| ours[i] * n[i]).sum::<f64>().abs() > 0.94
    });
    let (right, all) = (right.count(), near.len());
    assert!(all > 20 && right * 2 > all, "{right} of {all}");
}

#[test]
fn scan_lines_ten_times_as_far_apart_as_their_points_have_the_normals_of_their_plane() {
    let mut r = Random(4);
    let point =
        |i: u32| tilted(f64::from(i % 500) * 0.01, f64::from(i / 500) * 0.1, r.bell() * 0.001);
    let [middle, most, unknown] = errors(&(0..25_000).map(point).collect(), 0.03);
    assert!(middle < 1.0 && most < 3.0 && unknown < 0.01, "{middle} {most} {unknown}");
}

#[test]
fn a_jump_of_density_leaves_no_point_without_a_normal() {
    let mut r = Random(5);
    let mut point = |i: u32| {
        let a = if i.is_multiple_of(10) { 5.0 } else { 0.0 };
        tilted(a + r.unit() * 5.0, r.unit() * 10.0, 0.0)
    };
    let [middle, most, unknown] = errors(&(0..20_000).map(&mut point).collect(), 0.05);
    assert!(middle < 0.3 && most < 1.0 && unknown < 0.001, "{middle} {most} {unknown}");
}

#[test]
fn lines_and_volumes_have_no_normals() {
    let limits = blocks([SCALE; 3], 30.0);
    let share = |points: Vec<[u32; 3]>| {
        let codes = estimate(&sorted(points), &[], &limits);
        codes.iter().filter(|&&code| code == UNKNOWN).count() as f64 / codes.len() as f64
    };
    let mut r = Random(6);
    let mut volume = || [0; 3].map(|_| lattice([r.unit() * 0.6; 3])[0]);
    let without = share((0..8000).map(|_| volume()).collect());
    assert!(without > 0.96, "{without}");
    // Twigs in crowns: balls of points that are a third as high as wide.
    let mut twig = |_| {
        let middle = [0; 3].map(|_| r.unit() * 3.0);
        let mut leaf = |i: usize| middle[i] + r.bell() * [0.09, 0.09, 0.03][i];
        [0; 20].map(|_| lattice([0, 1, 2].map(&mut leaf)))
    };
    let without = share((0..2000).flat_map(&mut twig).collect());
    assert!(without > 0.98, "{without}");
    // Wires a metre apart, whose points are 3 cm apart and off by 1 mm.
    let mut wire = |i: u32| {
        let off = [r.bell() * 0.001, r.bell() * 0.001];
        lattice([f64::from(i % 1000) * 0.03, f64::from(i / 1000) + off[0], off[1]])
    };
    assert!(share((0..4000).map(&mut wire).collect()) > 0.9);
    for points in [vec![], vec![[5; 3]], vec![[5; 3]; 100], vec![[0; 3], [u32::MAX; 3]]] {
        let count = points.len();
        assert_eq!(estimate(&points, &[], &limits), vec![UNKNOWN; count]);
    }
}

/// Shares of points with a normal: of parallel rows of points `apart` as far from each other as the
/// points of a row, which sag, over a ground whose points are `ground` as far apart.
fn with_normals(rows: u32, apart: f64, ground: f64, turn: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
    let mut r = Random(9);
    let mut cloud: Truth = Vec::new();
    for i in 0..rows * 600 {
        let along = f64::from(i % 600);
        let sag = (along / 300.0 - 1.0).powi(2) * 20.0;
        let off = [r.bell() * 0.2, r.bell() * 0.08, r.bell() * 0.08];
        let p = [along + off[0], f64::from(i / 600) * apart + off[1], sag + off[2]];
        cloud.push((p, [0.0; 3]));
    }
    for _ in 0..40_000 {
        cloud.push(([r.unit() * 200.0 * ground, r.unit() * 200.0 * ground, -120.0], [1.0; 3]));
    }
    let mut along: Vec<_> =
        cloud.into_iter().map(|(p, of)| (lattice(turn(p).map(|c| c * 0.03)), of)).collect();
    along.sort_by_key(|&(p, _)| morton::encode3(p));
    let own: Vec<_> = along.iter().map(|s| s.0).collect();
    let codes = estimate(&own, &[], &blocks([SCALE; 3], ground * 0.03 / SCALE));
    let of_rows = codes.iter().zip(&along).filter(|(_, (_, of))| of[0] == 0.0);
    let known = of_rows.filter(|(code, _)| **code != UNKNOWN).count();
    known as f64 / f64::from(rows * 600)
}

#[test]
fn up_to_three_parallel_wires_have_no_normals_and_more_lines_have() {
    for turn in [|p| p, askew] {
        for (apart, ground) in [(6.0, 2.0), (11.0, 2.2), (20.0, 4.0), (25.0, 4.0)] {
            for wires in 1..=3 {
                let share = with_normals(wires, apart, ground, turn);
                let most = if apart < 10.0 { 0.3 } else { 0.15 };
                assert!(share < most, "{wires} wires, {apart}: {share}");
            }
            let share = with_normals(12, apart, ground, turn);
            assert!(share > if apart < 24.0 { 0.99 } else { 0.8 }, "{apart}: {share}");
        }
    }
}

#[test]
fn normals_at_all_ends_of_the_lattice_are_those_of_the_middle() {
    let sheet = |corner: [u32; 3]| {
        let place = |i: u32| [corner[0] + i % 60 * 20, corner[1] + i / 60 * 20, corner[2] + i % 60];
        sorted((0..3600).map(place).collect())
    };
    let limits = blocks([SCALE; 3], 20.0);
    let codes = |corner| estimate(&sheet(corner), &[], &limits);
    let middle = codes([1 << 31; 3]);
    assert!(middle.iter().all(|&code| code != UNKNOWN && code == middle[0]));
    assert!(codes([0; 3]) == middle);
    assert!(codes([u32::MAX - 1200; 3]).iter().all(|&code| code == middle[0]));
    // Coarse clouds have coarse cells.
    let far = sorted((0..900).map(|i| [(i % 30) << 26, (i / 30) << 26, 1 << 30]).collect());
    let up = quant::oct_encode([0.0, 0.0, 1.0]);
    assert!(estimate(&far, &[], &blocks([SCALE; 3], 6.7e7)) == [up; 900]);
}

proptest! {
    #[test]
    fn directions_are_the_eigenvectors_of_the_least_eigenvalue(points in prop::collection::vec([-50i32..50, -50i32..50, -6i32..6], 12..80), tilt in 0.0f64..1.0) {
        let mut m = [0.0; 6];
        let points: Vec<[f64; 3]> = points.iter().map(|p| { let p = p.map(f64::from); [p[0], p[1] + tilt * p[2], p[2] - tilt * p[1]] }).collect();
        let mean = [0, 1, 2].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64);
        for p in &points {
            let [x, y, z] = [0, 1, 2].map(|i| p[i] - mean[i]);
            m.iter_mut().zip([x * x, y * y, z * z, x * y, x * z, y * z]).for_each(|(sum, term)| *sum += term);
        }
        let Eigen { values, axes } = Eigen::of(m);
        let is_surface = values[1] > LINE * values[0] && VOLUME * values[1] >= values[2];
        let apart = (values[1] / values[0] / LINE - 1.0).abs().min((values[2] / values[1] - VOLUME).abs());
        let found = plane::Covariance::new(m).map(|m| m.least()).filter(|(_, spread, _)| *spread == Spread::Plane).map(|(normal, ..)| normal);
        if apart > 1e-6 {
            prop_assert_eq!(found.is_some(), is_surface);
        }
        if let Some(n) = found.filter(|_| is_surface) {
            let norm = n.iter().map(|c| c * c).sum::<f64>().sqrt();
            let cosine = (0..3).map(|i| n[i] * axes[2][i]).sum::<f64>().abs() / norm;
            prop_assert!(cosine > 1.0 - 1e-9, "{}", cosine);
        }
    }

    #[test]
    fn a_cloud_cut_into_cells_has_the_same_normals(points in prop::collection::vec([0u32..300, 0u32..300, 0u32..20], 1..600), log2 in 3u8..8, coarsest in 1u32..7, more in 0u32..2, shift in prop::sample::select(vec![[0; 3], [0, 0, 1], [3, 0, 2]])) {
        let blocks = Blocks { scale: [1.0, 1.0, 2.0], coarsest, reach: coarsest + more, shift };
        let all = sorted(points);
        let whole = super::estimate(&all, &[], &blocks);
        let cell_of = |p: &[u32; 3]| p.map(|c| c >> log2);
        let mut start = 0;
        for own in all.chunk_by(|a, b| cell_of(a) == cell_of(b)) {
            let cell = Cell { corner: cell_of(&own[0]).map(|c| c << log2), log2 };
            let [low, high] = blocks.around(&cell);
            let within = |p: &&[u32; 3]| (0..3).all(|i| (low[i]..=high[i]).contains(&p[i]));
            let mut halo: Vec<_> = all.iter().filter(within).copied().filter(|p| !cell.contains(*p)).collect();
            halo.reverse();
            let expected = &whole[start..start + own.len()];
            prop_assert_eq!(super::estimate(own, &halo, &blocks), expected);
            start += own.len();
        }
    }
}
