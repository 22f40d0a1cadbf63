//! Measurements by clicks: the coordinates of the point under the pointer, and the distance between
//! two points.

use crate::{frustum, theme};
use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2, vec2};
use esker_engine::{Lattice, View};
use glam::DVec3;

/// Radius of the mark of a point, in points of the screen.
const MARK: f32 = 4.0;
/// Most digits after the decimal point.
const DIGITS_MAX: usize = 4;

/// A point that was clicked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredPoint {
    /// Position on the metric lattice.
    pub at: DVec3,
    /// Width of a pixel at its depth: the precision of the position.
    pub pixel: f64,
}

/// The points clicked last, two at most.
#[derive(Clone, Debug, Default)]
pub struct Measure {
    points: Vec<MeasuredPoint>,
}

impl Measure {
    /// Adds a point; a third one replaces both.
    pub fn push(&mut self, point: MeasuredPoint) {
        if self.points.len() == 2 {
            self.points.clear();
        }
        self.points.push(point);
    }

    /// Removes the last point.
    pub fn pop(&mut self) {
        self.points.pop();
    }

    /// Removes all points.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Coordinates of the points on a scan's lattice, and the distance between them, as lines of
    /// text.
    pub fn lines(&self, unit: Option<&str>, lattice: &Lattice) -> Vec<String> {
        let unit = unit.map_or(String::new(), |unit| format!(" {unit}"));
        let coordinates = |p: &MeasuredPoint| {
            let place = lattice.unmeasure(p.at.to_array());
            let [x, y, z] = [0, 1, 2].map(|axis| {
                // Degrees need more digits than metres, for places as precise.
                let more = lattice.factor[axis].log10().ceil().max(0.0) as usize;
                format!("{:.*}", digits(p.pixel) + more, place[axis])
            });
            format!("{x}  {y}  {z}")
        };
        let mut lines: Vec<String> = self.points.iter().map(coordinates).collect();
        if let [a, b] = self.points[..] {
            let (between, digits) = (b.at - a.at, digits(a.pixel.max(b.pixel)));
            let [all, across, up] = [between.length(), between.truncate().length(), between.z]
                .map(|v| format!("{v:.digits$}"));
            lines.push(format!("distance {all}{unit}, across {across}, up {up}"));
        }
        lines
    }

    /// Paints the points and the line between them over a picture of the view `seen` that fills
    /// `rect`.
    pub fn paint(&self, painter: &Painter, rect: Rect, seen: &View) {
        let size = [seen.width, seen.height].map(f64::from);
        let on = |p: [f64; 2]| -> Pos2 {
            let [x, y] = [0, 1].map(|i| (p[i] / size[i]).clamp(-100.0, 100.0) as f32);
            pos2(rect.left() + x * rect.width(), rect.top() + y * rect.height())
        };
        let dark = Color32::from_black_alpha(150);
        if let [a, b] = self.points[..]
            && let Some([from, to]) = frustum::project(seen, [a.at, b.at])
        {
            let line = [on(from), on(to)];
            painter.line_segment(line, Stroke::new(3.5, dark));
            painter.line_segment(line, Stroke::new(1.5, theme::ACCENT));
            let digits = digits(a.pixel.max(b.pixel));
            let text = format!("{:.digits$}", a.at.distance(b.at));
            let font = FontId::proportional(13.0);
            let text = painter.layout_no_wrap(text, font, theme::ACCENT);
            let middle = line[0].lerp(line[1], 0.5) - vec2(0.0, 14.0);
            let behind = Align2::CENTER_CENTER.anchor_size(middle, text.size());
            painter.rect_filled(behind.expand(4.0), 4.0, dark);
            painter.galley(behind.min, text, theme::ACCENT);
        }
        for p in &self.points {
            if let Some([at, _]) = frustum::project(seen, [p.at, p.at]) {
                painter.circle(on(at), MARK, dark, Stroke::new(1.5, theme::ACCENT));
            }
        }
    }
}

/// Digits after the decimal point that resolve a tenth of a pixel of this width.
fn digits(pixel: f64) -> usize {
    let digits = (1.0 - pixel.max(1e-9).log10()).ceil();
    (digits.max(0.0) as usize).min(DIGITS_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_points_have_a_distance_and_a_third_point_replaces_them() {
        let point = |x: f64, y: f64, z: f64| MeasuredPoint { at: DVec3::new(x, y, z), pixel: 0.04 };
        let (mut measure, plain) = (Measure::default(), Lattice::default());
        measure.push(point(600_000.125, 10.0, -2.0));
        assert_eq!(measure.lines(Some("metre"), &plain), ["600000.125  10.000  -2.000"]);
        measure.push(point(600_003.125, 14.0, 10.0));
        assert_eq!(
            measure.lines(Some("metre"), &plain)[2],
            "distance 13.000 metre, across 5.000, up 12.000"
        );
        measure.push(point(1.0, 2.0, 3.0));
        assert_eq!(measure.lines(None, &plain), ["1.000  2.000  3.000"]);
        measure.pop();
        assert!(measure.lines(None, &plain).is_empty());
        let degrees = Lattice { factor: [1e5, 1e5, 1.0], ..plain };
        measure.push(point(8.25e5, 47.5e5, 400.0));
        assert_eq!(measure.lines(None, &degrees), ["8.25000000  47.50000000  400.000"]);
        assert_eq!([5e3, 10.0, 0.9, 1e-12].map(digits), [0, 0, 2, DIGITS_MAX]);
    }
}
