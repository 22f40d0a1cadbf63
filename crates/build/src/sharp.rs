//! Sharp edges of scanned surfaces: where the tangent planes of neighbouring points meet within their reach at an angle,
//! each point gets the line in which they do, and is drawn on its own side of it only (zwicker2004, section 5).
//!
//! Near an edge a normal is blurred: its neighbours lie on both sides. So it first becomes that of the flattest
//! plane near by that goes through the point, whose own neighbours lie on one side. What a point gets depends on points
//! within the reach of normals alone, in three steps that share it: so it is the same however a cloud is cut into
//! chunks.

use crate::neighbours::{Ask, Neighbours, sorted_codes};
use crate::normals::{Bounds, flattest, joined};
use esker_points::{Clip, ClipLine, Grain, morton, quant};
use rayon::prelude::*;

/// What a plane is laid through.
const NEIGHBOURS: usize = 16;
/// Neighbours that edges are looked for among, and flatter planes: in a corner the nearest clean ones are three spacings away.
const AROUND: usize = 32;
const AROUND_FLAT: usize = 64;
/// Shares of the reach: of planes, of the flattest near by, of edges. Together they are less than one.
const PLANE_SHARE: f64 = 0.5;
const FLAT_SHARE: f64 = 0.25;
const EDGE_SHARE: f64 = 0.1875;
/// A plane goes through a point that is so many local spacings off it.
const THROUGH: f64 = 0.3;
/// What being off a plane by a local spacing counts, in roughness.
const OFF: f64 = 0.1;
/// Roughness under which a plane is flat, and no better one is looked for.
const FLAT: f64 = 1e-4;
/// How much flatter another plane must be than a point's own.
const FLATTER: f64 = 0.5;
/// Cosine of the angle between planes that are one, and of that from which they meet in an edge: 15 and 30 degrees.
const SAME: f64 = 0.966;
const EDGE: f64 = 0.866;
/// Local spacings from a point to an edge at most: what its splat reaches, and something for the low-pass.
const NEAR: f64 = 2.0;
/// Share of the points of the same plane that may lie beyond a line, and how far beyond counts, in local spacings.
const BEYOND_SHARE: f64 = 0.2;
const BEYOND: f64 = 0.35;

type Vec3 = [f64; 3];

/// What is known of a point that lies near an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// The code of its own side's normal.
    pub normal: [i16; 2],
    /// Its lines, whose sides are told as that normal sees them.
    pub clip: Clip,
}

/// The tangent plane of a point.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: Vec3,
    /// Least variance over all.
    roughness: f64,
    /// Local distance of points.
    spacing: f64,
}

/// A line in which two points' planes meet.
#[derive(Clone, Copy, Debug)]
struct Meeting {
    /// A place of it, against the point.
    at: Vec3,
    along: Vec3,
    /// Across it in the point's plane, away from what is kept.
    out: Vec3,
    /// Whose plane it meets.
    mate: Mate,
}

/// A point near another one.
#[derive(Clone, Copy, Debug)]
struct Mate {
    place: usize,
    plane: Plane,
    /// The way to it.
    way: Vec3,
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn plus(a: Vec3, b: Vec3, times: f64) -> Vec3 {
    [0, 1, 2].map(|i| a[i] + b[i] * times)
}

/// Edges near `own` points, which lie along the Morton curve; `halo` as for [`crate::normals::estimate`].
pub fn detect(own: &[[u32; 3]], halo: &[[u32; 3]], bounds: &Bounds) -> Vec<Option<Edge>> {
    let (points, place_of) = joined(own, &sorted_codes(halo));
    let index = Neighbours::new(&points, bounds.scale);
    let codes = points.par_iter().map(|&p| morton::encode3(p)).collect();
    let cloud = Cloud { points: &points, codes, scale: bounds.scale };
    let ask = |count, share: f64| Ask { count, count_max: count, reach: bounds.reach * share };
    let planes = index.map_placed(
        &ask(NEIGHBOURS, PLANE_SHARE),
        |_| true,
        |_, steps| Some(plane(steps, bounds.scale)),
        None,
    );
    let flat = index.map_placed(
        &ask(AROUND_FLAT, FLAT_SHARE),
        |_| true,
        |place, steps| Some(cloud.flattest(place, steps, &planes)),
        None,
    );
    let mut wanted = vec![false; points.len()];
    place_of.iter().for_each(|&place| wanted[place as usize] = true);
    let found = index.map_placed(
        &ask(AROUND, EDGE_SHARE),
        |place| wanted[place],
        |place, steps| Some(cloud.edge(place, steps, &flat)),
        None,
    );
    place_of.into_par_iter().map(|place| found[place as usize]).collect()
}

/// The plane of a point and its neighbours, so many steps away.
fn plane(steps: &[Vec3], scale: Vec3) -> Option<Plane> {
    let (normal, values) = flattest(steps, scale)?;
    let lengths = steps.iter().map(|s| [0, 1, 2].map(|i| s[i] * scale[i])).map(|s| dot(s, s));
    let far = lengths.fold(0.0, f64::max).sqrt();
    // A circle of this radius has so many points.
    let spacing = far * (std::f64::consts::PI / steps.len() as f64).sqrt();
    Some(Plane { normal, roughness: values[2] / (values[0] + values[1] + values[2]), spacing })
}

/// Points along the Morton curve, no two alike.
struct Cloud<'a> {
    points: &'a [[u32; 3]],
    codes: Vec<u128>,
    scale: Vec3,
}

impl Cloud<'_> {
    /// A neighbour's place, and the way to it in the file's unit.
    fn neighbour(&self, place: usize, step: &Vec3) -> Option<(usize, Vec3)> {
        let p = self.points[place];
        let at = [0, 1, 2].map(|i| (i64::from(p[i]) + step[i] as i64) as u32);
        let found = self.codes.binary_search(&morton::encode3(at)).ok()?;
        Some((found, [0, 1, 2].map(|i| step[i] * self.scale[i])))
    }

    /// A point's own plane, or the flattest of those around that go through it.
    fn flattest(&self, place: usize, steps: &[Vec3], planes: &[Option<Plane>]) -> Option<Plane> {
        let own = planes[place]?;
        if own.roughness < FLAT {
            return Some(own);
        }
        let (mut best, mut least) = (own, own.roughness * FLATTER);
        for (other, way) in steps.iter().filter_map(|s| self.neighbour(place, s)) {
            let Some(plane) = planes[other] else { continue };
            // On an edge the planes of both sides are flat: the one that the point is on counts.
            let off = dot(plane.normal, way).abs() / own.spacing;
            let score = plane.roughness + OFF * off * off;
            if off <= THROUGH && score < least {
                (best, least) = (Plane { spacing: own.spacing, ..plane }, score);
            }
        }
        Some(best)
    }

    /// The edge of a point, where it has one.
    fn edge(&self, place: usize, steps: &[Vec3], planes: &[Option<Plane>]) -> Option<Edge> {
        let own = planes[place]?;
        let around: Vec<Mate> = steps
            .iter()
            .filter_map(|s| self.neighbour(place, s))
            .filter_map(|(place, way)| Some(Mate { place, plane: planes[place]?, way }))
            .collect();
        let cosine = |m: &Mate| dot(m.plane.normal, own.normal).abs();
        let is_same =
            |m: &&Mate| cosine(m) > SAME && dot(own.normal, m.way).abs() < BEYOND * own.spacing;
        let same: Vec<Vec3> = around.iter().filter(is_same).map(|m| m.way).collect();
        let mut mates: Vec<&Mate> = around.iter().filter(|m| cosine(m) < EDGE).collect();
        mates.sort_by(|a, b| dot(a.way, a.way).total_cmp(&dot(b.way, b.way)));
        let meetings: Vec<Meeting> =
            mates.into_iter().filter_map(|mate| meeting(&own, mate, &same)).collect();
        let beyond =
            |m: &Meeting, way: &Vec3| dot(m.out, plus(*way, m.at, -1.0)) > BEYOND * own.spacing;
        let holds = |is_beyond: &dyn Fn(&Vec3) -> bool| {
            let count = same.iter().filter(|w| is_beyond(w)).count();
            count as f64 <= BEYOND_SHARE * (same.len() + 1) as f64
        };
        let is_end = |m: &&Meeting| holds(&|way| beyond(m, way));
        let (ends, others): (Vec<&Meeting>, Vec<&Meeting>) = meetings.iter().partition(is_end);
        let is_other = |a: &Meeting, b: &Meeting| {
            dot(a.along, b.along).abs() < EDGE || dot(a.out, b.out) < -EDGE
        };
        let (mut lines, mut either) = ([None; 2], false);
        if let Some(first) = ends.first() {
            let second = ends.iter().find(|m| is_other(first, m));
            lines = [self.line(place, &own, first), second.and_then(|m| self.line(place, &own, m))];
        } else {
            // A corner that goes in: some of the plane lies beyond each line, none beyond both.
            let pair = others.iter().enumerate().find_map(|(i, a)| {
                let fits = |b: &&&Meeting| {
                    is_other(a, b) && holds(&|way| beyond(a, way) && beyond(b, way))
                };
                others[i + 1..].iter().find(fits).map(|b| [*a, *b])
            });
            if let Some(pair) = pair {
                lines = pair.map(|m| self.line(place, &own, m));
                either = !lines.contains(&None);
            }
            if !either {
                lines = [None; 2];
            }
        }
        let clip = Clip { lines, either };
        let normal = quant::oct_encode(own.normal.map(|c| c as f32));
        (!clip.is_none()).then_some(Edge { normal, clip })
    }

    /// The line as it is stored: worked out from the pair's first point, whichever of both asks.
    fn line(&self, place: usize, own: &Plane, m: &Meeting) -> Option<ClipLine> {
        let mate = &m.mate;
        let (first, (at, along)) = if place < mate.place {
            (place, crossing(own, &mate.plane, mate.way))
        } else {
            (mate.place, crossing(&mate.plane, own, mate.way.map(|w| -w)))
        };
        // What is kept lies to the left, seen from where the normal points to.
        let turn = dot(cross(own.normal, along), m.out);
        let half = dot(mate.way, mate.way).sqrt();
        let half = if turn < 0.0 { half } else { -half };
        let end = |way: f64| {
            let at = plus(at, along, way);
            [0, 1, 2].map(|i| f64::from(self.points[first][i]) + at[i] / self.scale[i])
        };
        ClipLine::through(end(-half), end(half), Grain::new(self.scale))
    }
}

/// Where two planes meet, of points that far apart: the place nearest to the middle between both, against the first, and
/// the line's direction.
fn crossing(a: &Plane, b: &Plane, way: Vec3) -> (Vec3, Vec3) {
    let (a, b) = (a.normal, b.normal);
    let c = dot(a, b);
    let squared = 1.0 - c * c;
    let middle = way.map(|w| 0.5 * w);
    let (f, g) = (dot(a, middle), -dot(b, middle));
    let at = plus(plus(middle, a, (c * g - f) / squared), b, (c * f - g) / squared);
    (at, cross(a, b).map(|v| v / squared.sqrt()))
}

/// Where the plane of a point meets that of a mate; `None` where that is too far away.
fn meeting(own: &Plane, mate: &Mate, same: &[Vec3]) -> Option<Meeting> {
    let (at, along) = crossing(own, &mate.plane, mate.way);
    let far = |from: Vec3| {
        let off = plus(from, along, -dot(from, along));
        dot(off, off).sqrt()
    };
    let from_mate = plus(at, mate.way, -1.0);
    if far(at) > NEAR * own.spacing || far(from_mate) > NEAR * mate.plane.spacing {
        return None;
    }
    let across = cross(along, own.normal);
    // What is kept is where the points of the plane are.
    let from_line = |way: &Vec3| dot(across, plus(*way, at, -1.0));
    let side = same.iter().map(from_line).sum::<f64>() + from_line(&[0.0; 3]);
    let out = if side > 0.0 { across.map(|v| -v) } else { across };
    Some(Meeting { at, along, out, mate: *mate })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps between points.
    const SPACING: f64 = 100.0;
    const MIDDLE: f64 = 2e9;

    fn bounds() -> Bounds {
        Bounds::new([0.001; 3], SPACING)
    }

    /// A sheet of jittered points from the middle on along two directions, off it by noise of so many spacings.
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

    /// Two walls that meet at this angle, in the line along x through the middle.
    fn walls(degrees: f64, noise: f64) -> Vec<[u32; 3]> {
        let (s, c) = degrees.to_radians().sin_cos();
        let mut points = sheet([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 40, noise, 1);
        points.extend(sheet([1.0, 0.0, 0.0], [0.0, c, s], 40, noise, 2));
        sorted(points)
    }

    /// A point's distance from the edge of the walls, spacings; `None` near their other ends.
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
            let edges = detect(&points, &[], &bounds());
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
        let edges = detect(&points, &[], &bounds());
        let lines: Vec<ClipLine> =
            edges.iter().flatten().flat_map(|e| e.clip.lines).flatten().collect();
        let is_shared = |a: &&ClipLine| {
            lines.iter().filter(|b| (a.from, a.along) == (b.from, b.along)).count() > 1
        };
        let shared = lines.iter().filter(is_shared).count();
        assert!(shared * 3 > lines.len(), "{shared} of {}", lines.len());
    }

    #[test]
    fn what_has_no_edge_gets_no_line() {
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
            let found = detect(&points, &[], &bounds()).iter().flatten().count();
            assert!(found * 1000 <= points.len(), "{found} of {}", points.len());
        }
    }

    #[test]
    fn a_cloud_cut_into_chunks_has_the_same_edges() {
        let points = walls(75.0, 0.04);
        let (bounds, steps) = (bounds(), bounds().steps());
        let whole = detect(&points, &[], &bounds);
        for cut in [(MIDDLE + 1500.0) as u32, (MIDDLE + 3100.0) as u32] {
            for side in [false, true] {
                let is_own = |p: &[u32; 3]| (p[0] < cut) == side;
                let own: Vec<_> = points.iter().copied().filter(is_own).collect();
                let near = |p: &&[u32; 3]| {
                    if side { p[0] < cut + steps[0] } else { p[0] + steps[0] >= cut }
                };
                let halo: Vec<_> =
                    points.iter().filter(near).copied().filter(|p| !is_own(p)).collect();
                let expected: Vec<_> = points
                    .iter()
                    .zip(&whole)
                    .filter(|(p, _)| is_own(p))
                    .map(|(_, edge)| *edge)
                    .collect();
                assert_eq!(detect(&own, &halo, &bounds), expected);
            }
        }
    }
}
