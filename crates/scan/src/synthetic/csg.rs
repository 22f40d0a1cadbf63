//! Constructive solid geometry: a solid is a Boolean expression of half-spaces, balls and
//! cylinders. Its surface is sampled evenly by splats, and each splat near an edge gets clip lines
//! (zwicker2004, section 5): exact, since the surfaces on both sides of the edge are known.

use super::draw::cos_sin;
use super::ray::Vec3;

/// Greatest distance of a splat with clip lines from the edge, in spacings.
const REACH: f64 = 3.0;
/// Steps of Newton's method: each doubles the digits.
const STEPS: usize = 8;
/// Greatest distance of a point that counts as on a surface.
const ON: f64 = 1e-9;
/// Sine of the angle between two surfaces below which they have no edge.
const SINE_MIN: f64 = 0.05;

/// A surface that bounds a solid.
#[derive(Clone, Copy, Debug)]
pub enum Surface {
    /// Plane: the inside does not reach beyond this distance along this unit vector.
    HalfSpace(Vec3, f64),
    /// Ball of a centre and a radius.
    Ball(Vec3, f64),
    /// Cylinder of an upright axis and a radius.
    Cylinder([f64; 2], f64),
}

/// A solid within the cube from -1 to 1.
pub struct Solid {
    /// Its surfaces.
    pub surfaces: Vec<Surface>,
    /// Whether a point is inside, given whether it is inside each surface.
    pub is_inside: fn(&[bool]) -> bool,
}

/// Two points of a line; the side to the left of the way between them, seen from outside, is kept.
pub type Line = [Vec3; 2];

/// A splat.
#[derive(Clone, Copy, Debug)]
pub struct Splat {
    /// Centre.
    pub at: Vec3,
    /// Outward unit normal.
    pub normal: Vec3,
    /// Clip lines.
    pub lines: [Option<Line>; 2],
    /// Whether the union of what both lines keep is kept; else the intersection.
    pub either: bool,
}

pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn is_near(a: Vec3, b: Vec3, distance: f64) -> bool {
    let off = plus(a, b, -1.0);
    dot(off, off) < distance * distance
}

fn plus(a: Vec3, b: Vec3, times: f64) -> Vec3 {
    [0, 1, 2].map(|i| a[i] + b[i] * times)
}

impl Surface {
    /// Signed distance of a point, negative inside, and the unit direction outwards.
    fn at(&self, p: Vec3) -> (f64, Vec3) {
        let from = match *self {
            Self::HalfSpace(n, offset) => return (dot(n, p) - offset, n),
            Self::Ball(centre, _) => [0, 1, 2].map(|i| p[i] - centre[i]),
            Self::Cylinder([x, y], _) => [p[0] - x, p[1] - y, 0.0],
        };
        let (Self::Ball(_, radius) | Self::Cylinder(_, radius) | Self::HalfSpace(_, radius)) =
            *self;
        let length = dot(from, from).sqrt().max(1e-12);
        (length - radius, from.map(|c| c / length))
    }

    /// Calls `give` with evenly spread points of the surface, some of which may be outside of the
    /// cube.
    fn for_each(&self, spacing: f64, give: &mut dyn FnMut(Vec3)) {
        let cells = |length: f64| (length / spacing + 0.5).max(1.0) as i64;
        let middle = |i: i64, n: i64| (i as f64 + 0.5) / n as f64;
        match *self {
            Self::HalfSpace(n, offset) => {
                let u = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
                let u = plus(u, n, -dot(u, n));
                let u = u.map(|c| c / dot(u, u).sqrt());
                let v = cross(n, u);
                // Wide enough for the cube's diagonal.
                let side = 2 * cells(1.8);
                let along = |i: i64| (i as f64 + 0.5) * spacing - 0.5 * side as f64 * spacing;
                for i in 0..side {
                    for j in 0..side {
                        let base = n.map(|c| c * offset);
                        give(plus(plus(base, u, along(i)), v, along(j)));
                    }
                }
            }
            Self::Ball(centre, radius) => {
                let rings = cells(0.5 * std::f64::consts::TAU * radius);
                for i in 0..rings {
                    let [c, s] = cos_sin(0.5 * middle(i, rings));
                    let steps = cells(std::f64::consts::TAU * radius * s);
                    for j in 0..steps {
                        let [x, y] = cos_sin(middle(j, steps) + 0.5 * middle(i, 2));
                        give(plus(centre, [x * s, y * s, c], radius));
                    }
                }
            }
            Self::Cylinder([x, y], radius) => {
                let (rings, steps) = (cells(2.0), cells(std::f64::consts::TAU * radius));
                for i in 0..rings {
                    for j in 0..steps {
                        let [c, s] = cos_sin(middle(j, steps));
                        give([x + c * radius, y + s * radius, 2.0 * middle(i, rings) - 1.0]);
                    }
                }
            }
        }
    }
}

impl Solid {
    /// Passes splats of the surface, about `spacing` apart, to `take` while that returns `true`.
    pub fn for_each(&self, spacing: f64, take: &mut dyn FnMut(Splat) -> bool) {
        let mut goes_on = true;
        for own in 0..self.surfaces.len() {
            self.surfaces[own].for_each(spacing, &mut |at| {
                if goes_on && let Some(splat) = self.splat(own, at, spacing) {
                    goes_on = take(splat);
                }
            });
        }
    }

    /// The splat at a point of surface `own`; `None` if the solid does not end there.
    fn splat(&self, own: usize, at: Vec3, spacing: f64) -> Option<Splat> {
        let found: Vec<(f64, Vec3)> = self.surfaces.iter().map(|s| s.at(at)).collect();
        let mut inside: Vec<bool> = found.iter().map(|(distance, _)| *distance < 0.0).collect();
        let ends = |inside: &mut Vec<bool>| {
            let [within, beyond] = [true, false].map(|is_inside| {
                inside[own] = is_inside;
                (self.is_inside)(inside)
            });
            (within != beyond).then_some(within)
        };
        let goes_out = ends(&mut inside)?;
        let normal = found[own].1.map(|c| if goes_out { c } else { -c });
        let mut near: Vec<usize> = (0..found.len())
            .filter(|&j| j != own && found[j].0.abs() < REACH * spacing)
            .filter(|&j| {
                self.edge(own, j, at).is_some_and(|e| is_near(e, at, 2.0 * REACH * spacing))
            })
            .collect();
        near.sort_by(|&a, &b| found[a].0.abs().total_cmp(&found[b].0.abs()));
        // A near surface is no edge if the solid's surface does not end at it, whether the other
        // near surfaces are flipped or not.
        let mut ends_at = |turned: &[usize]| {
            turned.iter().for_each(|&j| inside[j] = !inside[j]);
            let is_end = ends(&mut inside) == Some(goes_out);
            turned.iter().for_each(|&j| inside[j] = !inside[j]);
            is_end
        };
        let pairs = near.clone();
        near.retain(|&j| {
            !ends_at(&[j]) || pairs.iter().any(|&k| k != j && ends_at(&[k]) != ends_at(&[j, k]))
        });
        let line = |j: usize, keeps_own_side: bool| {
            let is_inside = (found[j].0 < 0.0) == keeps_own_side;
            self.line(own, j, at, normal, is_inside, spacing)
        };
        let (mut lines, mut either) = ([None; 2], false);
        match near[..] {
            [] => {}
            [j] => lines[0] = line(j, true),
            [j, k, ..] => match [ends_at(&[j]), ends_at(&[k]), ends_at(&[j, k])] {
                [false, false, _] => lines = [line(j, true), line(k, true)],
                // Three of the four quadrants are kept.
                [true, true, false] => (lines, either) = ([line(j, true), line(k, true)], true),
                [false, true, true] => (lines, either) = ([line(j, true), line(k, false)], true),
                [true, false, true] => (lines, either) = ([line(j, false), line(k, true)], true),
                [false, true, false] => lines[0] = line(j, true),
                [true, false, false] => lines[0] = line(k, true),
                [true, true, true] => {}
            },
        }
        Some(Splat { at, normal, lines, either })
    }

    /// The point near `near` on the edge of two surfaces, by Newton's method.
    fn edge(&self, own: usize, other: usize, near: Vec3) -> Option<Vec3> {
        let mut at = near;
        for _ in 0..STEPS {
            let ((f, a), (g, b)) = (self.surfaces[own].at(at), self.surfaces[other].at(at));
            // The shortest step that reduces both distances to zero.
            let c = dot(a, b);
            let squared = 1.0 - c * c;
            if squared < SINE_MIN * SINE_MIN {
                return None;
            }
            at = plus(plus(at, a, (c * g - f) / squared), b, (c * f - g) / squared);
        }
        // No edge if the surfaces do not meet here.
        let is_on = |surface: usize| self.surfaces[surface].at(at).0.abs() < ON;
        (is_on(own) && is_on(other)).then_some(at)
    }

    /// The line in which the tangent planes of two surfaces meet, at the point of their edge near
    /// `near`. It keeps the inside of the other surface, or its outside.
    fn line(
        &self,
        own: usize,
        other: usize,
        near: Vec3,
        normal: Vec3,
        keeps_inside: bool,
        spacing: f64,
    ) -> Option<Line> {
        let edge = self.edge(own, other, near)?;
        // Splats on both sides of a piece of the edge share its line: it belongs to a cell of
        // space.
        let cell = edge.map(|c| ((c / spacing).floor() + 0.5) * spacing);
        let (first, second) = (own.min(other), own.max(other));
        let at = self.edge(first, second, cell);
        let at = at.filter(|at| is_near(*at, edge, 2.0 * spacing)).unwrap_or(edge);
        let (a, b) = (self.surfaces[first].at(at).1, self.surfaces[second].at(at).1);
        let along = cross(a, b);
        let along = along.map(|c| c / dot(along, along).sqrt());
        // Left of the direction of the line, seen from outside.
        let away = self.surfaces[other].at(at).1;
        let is_left_inside = dot(cross(normal, along), away) < 0.0;
        // As long as the splats that share the line.
        let ends = [-1.0, 1.0].map(|way| plus(at, along, way * spacing * REACH * 0.5));
        Some(if is_left_inside == keeps_inside { ends } else { [ends[1], ends[0]] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(line: &Line, p: Vec3) -> f64 {
        let way = plus(line[1], line[0], -1.0);
        let from = plus(p, line[0], -1.0);
        let off = plus(from, way, -dot(from, way) / dot(way, way));
        dot(off, off).sqrt()
    }

    fn walls() -> Vec<Surface> {
        let wall = |i: usize, side: f64| {
            let mut n = [0.0; 3];
            n[i] = side;
            Surface::HalfSpace(n, 0.5)
        };
        (0..6).map(|k| wall(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 })).collect()
    }

    fn splats(solid: &Solid, spacing: f64) -> Vec<Splat> {
        let mut splats = Vec::new();
        solid.for_each(spacing, &mut |splat| {
            splats.push(splat);
            true
        });
        splats
    }

    #[test]
    fn a_cube_has_lines_on_its_edges_and_two_in_its_corners() {
        let cube = Solid { surfaces: walls(), is_inside: |inside| inside.iter().all(|i| *i) };
        let splats = splats(&cube, 0.05);
        assert_eq!(splats.len(), 6 * 20 * 20);
        for splat in &splats {
            // Every point of a line is on two faces; the splat's own side is kept.
            for line in splat.lines.iter().flatten() {
                for end in line {
                    let on = end.iter().filter(|c| (c.abs() - 0.5).abs() < 1e-9).count();
                    assert!(on >= 2, "{end:?}");
                }
                let way = plus(line[1], line[0], -1.0);
                let left = cross(splat.normal, way);
                assert!(dot(left, plus(splat.at, line[0], -1.0)) > 0.0);
            }
            let edges = splat.at.iter().filter(|c| (c.abs() - 0.5).abs() < 0.15).count() - 1;
            assert_eq!(splat.lines.iter().flatten().count(), edges.min(2), "{splat:?}");
            assert!(!splat.either);
        }
        // Some lines are shared by splats of both faces, bit by bit.
        let all: Vec<Line> = splats.iter().flat_map(|s| s.lines).flatten().collect();
        let shared = all.iter().filter(|l| all.contains(&[l[1], l[0]])).count();
        assert!(shared * 10 > all.len() * 9, "{shared} of {}", all.len());
    }

    #[test]
    fn a_corner_that_goes_in_keeps_what_either_line_keeps() {
        // A wall with its upper right quarter cut out.
        let mut surfaces = walls();
        surfaces.push(Surface::HalfSpace([1.0, 0.0, 0.0], 0.0));
        surfaces.push(Surface::HalfSpace([0.0, 1.0, 0.0], 0.0));
        let is_inside =
            |inside: &[bool]| inside[..6].iter().all(|i| *i) && (inside[6] || inside[7]);
        let splats = splats(&Solid { surfaces, is_inside }, 0.05);
        let top = splats.iter().filter(|s| s.normal == [0.0, 0.0, 1.0]);
        let mut corners = 0;
        for splat in top.filter(|s| s.at[0].abs().max(s.at[1].abs()) < 0.12) {
            corners += 1;
            assert!(splat.either, "{splat:?}");
            // A point of the quarter that is cut out is right of both lines; other points are left
            // of at least one.
            for (p, is_kept) in [
                ([0.1, 0.1], false),
                ([0.1, -0.1], true),
                ([-0.1, 0.1], true),
                ([-0.1, -0.1], true),
            ] {
                let kept = splat.lines.iter().flatten().any(|line| {
                    let left = cross(splat.normal, plus(line[1], line[0], -1.0));
                    dot(left, plus([p[0], p[1], 0.5], line[0], -1.0)) > 0.0
                });
                assert_eq!(kept, is_kept, "{splat:?} {p:?}");
            }
        }
        assert!(corners > 8);
    }

    #[test]
    fn lines_of_round_edges_touch_them() {
        // A ball with a hole: the edge is a circle.
        let surfaces = vec![Surface::Ball([0.0; 3], 0.8), Surface::Cylinder([0.0; 2], 0.3)];
        let ball = Solid { surfaces, is_inside: |inside| inside[0] && !inside[1] };
        let splats = splats(&ball, 0.02);
        let height = (0.64f64 - 0.09).sqrt();
        let lines: Vec<Line> = splats.iter().flat_map(|s| s.lines).flatten().collect();
        assert!(lines.len() > 500);
        for line in lines {
            let middle = [0, 1, 2].map(|i| 0.5 * (line[0][i] + line[1][i]));
            let round = (middle[0] * middle[0] + middle[1] * middle[1]).sqrt();
            assert!((round - 0.3).abs() < 1e-9 && (middle[2].abs() - height).abs() < 1e-9);
            assert!(distance(&line, [0.0, 0.0, middle[2]]) > 0.3 - 1e-9);
        }
    }
}
