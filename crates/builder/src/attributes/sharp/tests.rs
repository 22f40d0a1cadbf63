//! Edges between walls, surfaces without edges, pairs that share a clip line, chunks.

use super::*;
use crate::attributes::density::Distances;
use esker_points::morton;

/// Steps between points.
const SPACING: f64 = 100.0;
const MIDDLE: f64 = 2e9;

fn bare(positions: &[[u32; 3]]) -> Points<'_> {
    Points { positions, normals: &[] }
}

fn bounds() -> Bounds {
    Bounds::new([0.001; 3], &Distances { spacing: SPACING, steps_max: f64::INFINITY })
}

/// A sheet of jittered points from [`MIDDLE`] on along `u` and `v`, off it by `noise` spacings.
fn sheet(u: Vec3, v: Vec3, side: u64, noise: f64, seed: u64) -> Vec<[u32; 3]> {
    let random = |i: u64| {
        let z = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15 ^ seed << 32);
        let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb) >> 11) as f64 / (1u64 << 53) as f64
    };
    let n = cross(u, v);
    let point = |i: u64| {
        let a = ((i % side) as f64 + 0.15 + 0.7 * random(3 * i)) * SPACING;
        let b = ((i / side) as f64 + 0.15 + 0.7 * random(3 * i + 1)) * SPACING;
        let off = (random(3 * i + 2) * 2.0 - 1.0) * noise * SPACING;
        plus(plus(plus([MIDDLE; 3], u, a), v, b), n, off).map(|c| c.round() as u32)
    };
    (0..side * side).map(point).collect()
}

fn sorted(mut points: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    points.sort_by_key(|&p| morton::encode3(p));
    points.dedup();
    points
}

/// Two walls that meet at an angle in the line along x through [`MIDDLE`].
fn walls(degrees: f64, noise: f64) -> Vec<[u32; 3]> {
    let (s, c) = degrees.to_radians().sin_cos();
    let mut points = sheet([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 40, noise, 1);
    points.extend(sheet([1.0, 0.0, 0.0], [0.0, c, s], 40, noise, 2));
    sorted(points)
}

/// Distance of a point from the edge of the walls, in spacings; `None` near their other ends.
fn from_edge(p: [u32; 3]) -> Option<f64> {
    let at = p.map(|c| (f64::from(c) - MIDDLE) / SPACING);
    let away = at[1].hypot(at[2]);
    ((4.0..36.0).contains(&at[0]) && away < 36.0).then_some(away)
}

#[test]
fn walls_meet_in_their_edge() {
    for (degrees, noise, slack) in
        [(90.0, 0.0, 0.1), (60.0, 0.0, 0.1), (130.0, 0.0, 0.1), (90.0, 0.05, 0.3)]
    {
        let points = walls(degrees, noise);
        let (_, edges) = detect(bare(&points), Points::default(), &bounds());
        let (mut near, mut missing, mut far, mut wide) = (0, 0, 0, 0);
        for (p, edge) in points.iter().zip(&edges) {
            let Some(away) = from_edge(*p) else { continue };
            near += usize::from(away < 1.0);
            missing += usize::from(away < 1.0 && edge.is_none());
            far += usize::from(away > 2.6 && edge.is_some());
            for line in edge.iter().flat_map(|e| e.clip.lines).flatten() {
                let off = [1, 2].map(|i| (f64::from(line.from[i]) - MIDDLE) / SPACING);
                wide += usize::from(off[0].hypot(off[1]) > slack);
            }
        }
        assert!(
            near > 50 && missing * 50 <= near && wide * 20 <= near,
            "{degrees} {noise}: {near} {missing} {wide}"
        );
        assert!(far * 100 <= points.len(), "{far}");
    }
}

#[test]
fn splats_of_a_pair_share_their_line() {
    let points = walls(90.0, 0.03);
    let (_, edges) = detect(bare(&points), Points::default(), &bounds());
    let lines: Vec<ClipLine> =
        edges.iter().flatten().flat_map(|e| e.clip.lines).flatten().collect();
    let is_shared =
        |a: &&ClipLine| lines.iter().filter(|b| (a.from, a.along) == (b.from, b.along)).count() > 1;
    let shared = lines.iter().filter(is_shared).count();
    assert!(shared * 3 > lines.len(), "{shared} of {}", lines.len());
}

#[test]
fn surfaces_without_edges_get_no_clip_lines() {
    let plane = sorted(sheet([0.6, 0.8, 0.0], [0.0, 0.0, 1.0], 60, 0.1, 3));
    let ball: Vec<[u32; 3]> = (0..6000)
        .map(|i| {
            let z = (f64::from(i) + 0.5) / 3000.0 - 1.0;
            let (s, c) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            [r * c, r * s, z].map(|v| (v * 22.0 * SPACING + MIDDLE).round() as u32)
        })
        .collect();
    for points in [plane, sorted(ball)] {
        let found = detect(bare(&points), Points::default(), &bounds()).1.iter().flatten().count();
        assert!(found * 1000 <= points.len(), "{found} of {}", points.len());
    }
}

#[test]
fn a_cloud_cut_into_chunks_has_the_same_edges() {
    let points = walls(75.0, 0.04);
    let (bounds, steps) = (bounds(), bounds().steps());
    let (_, whole) = detect(bare(&points), Points::default(), &bounds);
    for cut in [(MIDDLE + 1500.0) as u32, (MIDDLE + 3100.0) as u32] {
        for side in [false, true] {
            let is_own = |p: &[u32; 3]| (p[0] < cut) == side;
            let own: Vec<_> = points.iter().copied().filter(is_own).collect();
            let near = |p: &&[u32; 3]| {
                if side { p[0] < cut + steps[0] } else { p[0] + steps[0] >= cut }
            };
            let halo: Vec<_> = points.iter().filter(near).copied().filter(|p| !is_own(p)).collect();
            let expected: Vec<_> = points
                .iter()
                .zip(&whole)
                .filter(|(p, _)| is_own(p))
                .map(|(_, edge)| *edge)
                .collect();
            let (codes, edges) = detect(bare(&own), bare(&halo), &bounds);
            assert_eq!(codes, crate::attributes::normals::estimate(&own, &halo, &bounds));
            assert_eq!(edges, expected);
        }
    }
}
