//! Detects sharp edges of scanned surfaces: where the tangent planes of neighbouring points meet
//! nearby at an angle, each point gets the line of intersection as a clip line, and its splat is
//! drawn on its own side only (`zwicker2004`, section 5). Normals are blurred near an edge, since
//! neighbours lie on both sides, so a point first takes the flattest plane nearby that passes
//! through it; the plane of a normal that the source gives stays. The result depends only on points
//! within the reach of normals. See docs/design/building.md.

use crate::attributes::knn::{Query, sorted_codes};
use crate::attributes::knn_index::KnnIndex;
use crate::attributes::knn_search::Neighbourhood;
use crate::attributes::normals::{
    Bounds, NEIGHBOURS, NEIGHBOURS_MAX, UNKNOWN, code_of, flattest, joined,
};
use esker_points::{Clip, ClipLine, Grain, morton, quant};
use rayon::prelude::*;

/// Neighbours among which edges, and flatter planes, are searched. In a corner the nearest planes
/// of one side are three spacings away.
const AROUND: usize = 32;
const AROUND_FLAT: usize = 64;
/// Shares of the reach: of planes, of flatter planes, of edges. Their sum is less than one.
const PLANE_SHARE: f64 = 0.5;
const FLAT_SHARE: f64 = 0.25;
const EDGE_SHARE: f64 = 0.1875;
/// Greatest distance of a point from a plane that passes through it, in local spacings.
const THROUGH: f64 = 0.3;
/// Roughness that a distance of one local spacing from a plane adds.
const OFF: f64 = 0.1;
/// Roughness below which a plane is flat, and no better one is searched.
const FLAT: f64 = 1e-4;
/// Share of the roughness of a point's own plane that another one must stay below.
const FLATTER: f64 = 0.5;
/// Cosines of 15 and 30 degrees: planes below the first angle are the same, above the second they
/// meet in an edge.
const SAME: f64 = 0.966;
const EDGE: f64 = 0.866;
/// Greatest distance from a point to an edge, in local spacings: the reach of its splat, and a
/// margin for the low-pass.
const NEAR: f64 = 2.0;
/// Share of the points of the same plane that may lie beyond a line, and the distance from which
/// they do, in local spacings.
const BEYOND_SHARE: f64 = 0.2;
const BEYOND: f64 = 0.35;

type Vec3 = [f64; 3];

/// Positions of points, and the normals that their sources give.
#[derive(Clone, Copy, Debug, Default)]
pub struct Points<'a> {
    /// Positions on the lattice.
    pub positions: &'a [[u32; 3]],
    /// Codes of the normals, [`UNKNOWN`] for points that have none; empty if no point has one.
    pub normals: &'a [[i16; 2]],
}

/// Normal and clip lines of a point near an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Code of the normal on the point's own side.
    pub normal: [i16; 2],
    /// Clip lines, whose sides are relative to that normal.
    pub clip: Clip,
}

/// Tangent plane of a point.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: Vec3,
    /// Least variance over the sum of all.
    roughness: f64,
    /// Local distance of points.
    spacing: f64,
}

/// Line in which the planes of two points meet.
#[derive(Clone, Copy, Debug)]
struct Crease {
    /// A position on the line, relative to the point.
    at: Vec3,
    along: Vec3,
    /// Perpendicular to the line in the point's plane, away from the side that is kept.
    out: Vec3,
    /// The point of the other plane.
    neighbour: Neighbour,
}

/// A point near another one.
#[derive(Clone, Copy, Debug)]
struct Neighbour {
    place: usize,
    plane: Plane,
    /// Vector to the point.
    offset: Vec3,
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

/// Detects edges. Returns the codes of the normals of `own` points, given ones or else equal to
/// those of [`crate::attributes::normals::estimate`], and the edges near them. The parameters are
/// as there.
pub fn detect(
    own: Points<'_>,
    halo: Points<'_>,
    bounds: &Bounds,
) -> (Vec<[i16; 2]>, Vec<Option<Edge>>) {
    let (points, place_of) = joined(own.positions, &sorted_codes(halo.positions));
    let given = given(&points, [own, halo]);
    let normal_at = |place: usize| given.get(place).copied().filter(|&normal| normal != UNKNOWN);
    let index = KnnIndex::new(&points, bounds.scale);
    let query = |count, share: f64| Query { count, count_max: count, reach: bounds.reach * share };
    // Fits normals and planes to the nearest neighbours.
    let fits = index.map_placed(
        &Query { count: NEIGHBOURS, count_max: NEIGHBOURS_MAX, reach: bounds.reach },
        |_| true,
        |place, found| {
            let fit = PointFit::of(found.steps, normal_at(place), bounds);
            Some(fit).filter(|t| t.normal != UNKNOWN)
        },
        PointFit { normal: UNKNOWN, plane: None },
    );
    let cloud = Cloud { points: &points, scale: bounds.scale };
    let mut wanted = vec![false; points.len()];
    place_of.iter().for_each(|&place| wanted[place as usize] = true);
    let mut flat: Vec<Option<Plane>> = fits.iter().map(|t| t.plane).collect();
    // The others are flat enough.
    let is_rough = |place: usize| fits[place].plane.is_some_and(|p| p.roughness >= FLAT);
    let flatter = index.map_placed(
        &query(AROUND_FLAT, FLAT_SHARE),
        is_rough,
        |place, found| Some(cloud.flattest(place, found, &fits)),
        None,
    );
    let rough = (0..).zip(flat.iter_mut().zip(flatter)).filter(|(place, _)| is_rough(*place));
    rough.for_each(|(_, (flat, flatter))| *flat = flatter);
    let found = index.map_placed(
        &query(AROUND, EDGE_SHARE),
        |place| wanted[place],
        |place, found| Some(cloud.edge(place, found, &flat)),
        None,
    );
    let code = |(i, &place): (usize, &u32)| {
        let own = own.normals.get(i).copied().filter(|&normal| normal != UNKNOWN);
        own.unwrap_or(fits[place as usize].normal)
    };
    let codes = place_of.iter().enumerate().map(code).collect();
    (codes, place_of.into_par_iter().map(|place| found[place as usize]).collect())
}

/// Codes of the normals that sources give to `points`, which are distinct and along the Morton
/// curve; the greatest of coincident ones. Empty if sources give none.
fn given(points: &[[u32; 3]], parts: [Points<'_>; 2]) -> Vec<[i16; 2]> {
    if parts.iter().all(|part| part.normals.is_empty()) {
        return Vec::new();
    }
    let mut given = vec![UNKNOWN; points.len()];
    for part in parts {
        for (&position, &normal) in part.positions.iter().zip(part.normals) {
            let code = morton::encode3(position);
            let place = points.partition_point(|&p| morton::encode3(p) < code);
            given[place] = given[place].max(normal);
        }
    }
    given
}

/// Normal and plane fitted to the nearest neighbours of a point.
#[derive(Clone, Copy, Debug)]
struct PointFit {
    /// Code of the normal.
    normal: [i16; 2],
    /// The plane.
    plane: Option<Plane>,
}

impl PointFit {
    /// Fits the normal to all neighbours, which are at the offsets `steps`, and the plane to the
    /// nearest. Where the source gives the normal, the plane is the one across it, and flat.
    fn of(steps: &[Vec3], given: Option<[i16; 2]>, bounds: &Bounds) -> Self {
        let scale = bounds.scale;
        let given = given.map(|code| (quant::oct_decode(code).map(f64::from), [1.0, 0.0, 0.0]));
        let fit = |steps: &[Vec3]| match given {
            Some(plane) => Some(plane).filter(|_| !steps.is_empty()),
            None => flattest(steps, scale),
        };
        let found = fit(steps);
        let normal = found.map_or(UNKNOWN, |(normal, _)| code_of(normal));
        let weights = scale.map(|s| (s / scale[0]) * (s / scale[0]));
        let square = |s: &Vec3| {
            (weights[0] * (s[0] * s[0]) + weights[1] * (s[1] * s[1]) + weights[2] * (s[2] * s[2]))
                as f32
        };
        let reach = bounds.reach * PLANE_SHARE;
        let reach = (reach * reach) as f32;
        if steps.len() <= NEIGHBOURS && steps.iter().all(|s| square(s) <= reach) {
            let plane = found.map(|(normal, values)| Plane::of(normal, values, steps, scale));
            return Self { normal, plane };
        }
        let mut nearest: Vec<Vec3> = steps.iter().copied().filter(|s| square(s) <= reach).collect();
        nearest.sort_by(|a, b| square(a).total_cmp(&square(b)));
        nearest.truncate(NEIGHBOURS);
        let found = fit(&nearest);
        let plane = found.map(|(normal, values)| Plane::of(normal, values, &nearest, scale));
        Self { normal, plane }
    }
}

impl Plane {
    /// Makes a plane of the normal and the variances that were fitted to neighbours at the offsets
    /// `steps`.
    fn of(normal: Vec3, values: Vec3, steps: &[Vec3], scale: Vec3) -> Self {
        let lengths = steps.iter().map(|s| [0, 1, 2].map(|i| s[i] * scale[i])).map(|s| dot(s, s));
        let far = lengths.fold(0.0, f64::max).sqrt();
        // A circle of this radius has `steps.len()` points.
        let spacing = far * (std::f64::consts::PI / steps.len() as f64).sqrt();
        Self { normal, roughness: values[2] / (values[0] + values[1] + values[2]), spacing }
    }
}

/// Distinct points along the Morton curve.
struct Cloud<'a> {
    points: &'a [[u32; 3]],
    scale: Vec3,
}

impl Cloud<'_> {
    /// Indices of neighbours, and the vectors to them in the file's unit.
    fn offsets<'f>(
        &self,
        found: Neighbourhood<'f>,
    ) -> impl Iterator<Item = (usize, Vec3)> + use<'f> {
        let scale = self.scale;
        let offset = move |s: &Vec3| [0, 1, 2].map(|i| s[i] * scale[i]);
        found.places.iter().map(|&place| place as usize).zip(found.steps.iter().map(offset))
    }

    /// Chooses the flattest of a point's own plane and of those nearby that pass through the point.
    fn flattest(&self, place: usize, found: Neighbourhood<'_>, fits: &[PointFit]) -> Option<Plane> {
        let own = fits[place].plane?;
        let (mut best, mut least) = (own, own.roughness * FLATTER);
        for (other, offset) in self.offsets(found) {
            let Some(plane) = fits[other].plane else { continue };
            // On an edge the planes of both sides are flat: the one that the point is on counts.
            let off = dot(plane.normal, offset).abs() / own.spacing;
            let score = plane.roughness + OFF * off * off;
            if off <= THROUGH && score < least {
                (best, least) = (Plane { spacing: own.spacing, ..plane }, score);
            }
        }
        Some(best)
    }

    /// Detects the edge of a point.
    fn edge(
        &self,
        place: usize,
        found: Neighbourhood<'_>,
        planes: &[Option<Plane>],
    ) -> Option<Edge> {
        let own = planes[place]?;
        // Most points have none.
        let meets = |plane: &Plane| dot(plane.normal, own.normal).abs() < EDGE;
        if !found.places.iter().any(|&p| planes[p as usize].as_ref().is_some_and(meets)) {
            return None;
        }
        let around: Vec<Neighbour> = self
            .offsets(found)
            .filter_map(|(place, offset)| Some(Neighbour { place, plane: planes[place]?, offset }))
            .collect();
        let cosine = |m: &Neighbour| dot(m.plane.normal, own.normal).abs();
        let is_same = |m: &&Neighbour| {
            cosine(m) > SAME && dot(own.normal, m.offset).abs() < BEYOND * own.spacing
        };
        let same: Vec<Vec3> = around.iter().filter(is_same).map(|m| m.offset).collect();
        let mut neighbours: Vec<&Neighbour> = around.iter().filter(|m| meets(&m.plane)).collect();
        neighbours.sort_by(|a, b| dot(a.offset, a.offset).total_cmp(&dot(b.offset, b.offset)));
        let creases: Vec<Crease> =
            neighbours.into_iter().filter_map(|neighbour| crease(&own, neighbour, &same)).collect();
        let beyond = |m: &Crease, offset: &Vec3| {
            dot(m.out, plus(*offset, m.at, -1.0)) > BEYOND * own.spacing
        };
        let holds = |is_beyond: &dyn Fn(&Vec3) -> bool| {
            let count = same.iter().filter(|w| is_beyond(w)).count();
            count as f64 <= BEYOND_SHARE * (same.len() + 1) as f64
        };
        let is_end = |m: &&Crease| holds(&|offset| beyond(m, offset));
        let (ends, others): (Vec<&Crease>, Vec<&Crease>) = creases.iter().partition(is_end);
        let is_other = |a: &Crease, b: &Crease| {
            dot(a.along, b.along).abs() < EDGE || dot(a.out, b.out) < -EDGE
        };
        let (mut lines, mut either) = ([None; 2], false);
        if let Some(first) = ends.first() {
            let second = ends.iter().find(|m| is_other(first, m));
            lines = [self.line(place, &own, first), second.and_then(|m| self.line(place, &own, m))];
        } else {
            // At a concave corner, points of the plane lie beyond each line, but none beyond both.
            let pair = others.iter().enumerate().find_map(|(i, a)| {
                let is_pair = |b: &&&Crease| {
                    is_other(a, b) && holds(&|offset| beyond(a, offset) && beyond(b, offset))
                };
                others[i + 1..].iter().find(is_pair).map(|b| [*a, *b])
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

    /// The clip line to be stored. It is computed from the first point of the pair, so that both
    /// points get the same line.
    fn line(&self, place: usize, own: &Plane, m: &Crease) -> Option<ClipLine> {
        let neighbour = &m.neighbour;
        let (first, (at, along)) = if place < neighbour.place {
            (place, intersect(own, &neighbour.plane, neighbour.offset))
        } else {
            (neighbour.place, intersect(&neighbour.plane, own, neighbour.offset.map(|w| -w)))
        };
        // The kept side is to the left of the line, seen from the side that the normal points to.
        let turn = dot(cross(own.normal, along), m.out);
        let half = dot(neighbour.offset, neighbour.offset).sqrt();
        let half = if turn < 0.0 { half } else { -half };
        let end = |t: f64| {
            let at = plus(at, along, t);
            [0, 1, 2].map(|i| f64::from(self.points[first][i]) + at[i] / self.scale[i])
        };
        ClipLine::through(end(-half), end(half), Grain::new(self.scale))
    }
}

/// Intersects the planes of two points, `offset` apart. Returns the position on the line that is
/// nearest to the middle between the points, relative to the first, and the direction of the line.
fn intersect(a: &Plane, b: &Plane, offset: Vec3) -> (Vec3, Vec3) {
    let (a, b) = (a.normal, b.normal);
    let c = dot(a, b);
    let squared = 1.0 - c * c;
    let middle = offset.map(|w| 0.5 * w);
    let (f, g) = (dot(a, middle), -dot(b, middle));
    let at = plus(plus(middle, a, (c * g - f) / squared), b, (c * f - g) / squared);
    (at, cross(a, b).map(|v| v / squared.sqrt()))
}

/// Returns where the plane of a point meets that of a neighbour; `None` if that is too far away.
fn crease(own: &Plane, neighbour: &Neighbour, same: &[Vec3]) -> Option<Crease> {
    let (at, along) = intersect(own, &neighbour.plane, neighbour.offset);
    let far = |from: Vec3| {
        let off = plus(from, along, -dot(from, along));
        dot(off, off).sqrt()
    };
    let from_neighbour = plus(at, neighbour.offset, -1.0);
    if far(at) > NEAR * own.spacing || far(from_neighbour) > NEAR * neighbour.plane.spacing {
        return None;
    }
    let across = cross(along, own.normal);
    // The side that is kept has the points of the plane.
    let from_line = |offset: &Vec3| dot(across, plus(*offset, at, -1.0));
    let side = same.iter().map(from_line).sum::<f64>() + from_line(&[0.0; 3]);
    let out = if side > 0.0 { across.map(|v| -v) } else { across };
    Some(Crease { at, along, out, neighbour: *neighbour })
}

#[cfg(test)]
mod tests;
