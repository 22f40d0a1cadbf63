//! Measurements by clicks: the points of the file that were clicked, with their own coordinates and
//! attributes, and the distance between the last two.

use crate::panel::names::plural;
use crate::{frustum, theme};
use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2, vec2};
use esker_engine::View;
use esker_engine::calls::pick::Picked;

/// Radius of the mark of a point, in points of the screen.
const MARK: f32 = 4.0;
/// The points clicked last, two at most.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    points: Vec<Picked>,
}

impl Measure {
    /// Adds a point; a third one replaces the first.
    pub fn push(&mut self, point: Picked) {
        if self.points.len() == 2 {
            self.points.remove(0);
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

    /// Coordinates of the points, as an export writes them, and the distance between them, as lines
    /// of text.
    pub fn lines(&self, unit: Option<&str>) -> Vec<String> {
        let unit = unit.map_or(String::new(), |unit| format!(" {}", plural(unit)));
        let mut lines: Vec<String> =
            self.points.iter().map(|point| point.coordinates.join("  ")).collect();
        if let [a, b] = &self.points[..] {
            let (between, digits) = (b.at() - a.at(), digits(a).max(digits(b)));
            let [all, across, up] = [between.length(), between.truncate().length(), between.z]
                .map(|v| format!("{v:.digits$}"));
            lines.push(format!("distance {all}{unit}, across {across}, up {up}"));
        }
        lines
    }

    /// Names and values of the last point: steps, attributes, scan.
    pub fn about_last(&self) -> Vec<(String, String)> {
        self.points.last().map_or_else(Vec::new, Picked::rows)
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
        if let [a, b] = &self.points[..]
            && let Some([from, to]) = frustum::project(seen, [a.at(), b.at()])
        {
            let line = [on(from), on(to)];
            painter.line_segment(line, Stroke::new(3.5, dark));
            painter.line_segment(line, Stroke::new(1.5, theme::ACCENT));
            let digits = digits(a).max(digits(b));
            let text = format!("{:.digits$}", a.at().distance(b.at()));
            let font = FontId::proportional(13.0);
            let text = painter.layout_no_wrap(text, font, theme::ACCENT);
            let middle = line[0].lerp(line[1], 0.5) - vec2(0.0, 14.0);
            let behind = Align2::CENTER_CENTER.anchor_size(middle, text.size());
            painter.rect_filled(behind.expand(4.0), 4.0, dark);
            painter.galley(behind.min, text, theme::ACCENT);
        }
        for p in &self.points {
            if let Some([at, _]) = frustum::project(seen, [p.at(), p.at()]) {
                painter.circle(on(at), MARK, dark, Stroke::new(1.5, theme::ACCENT));
            }
        }
    }
}

/// Digits after the decimal point for distances from this point: those of its height, which is in
/// the unit of lengths also where x and y are degrees.
fn digits(point: &Picked) -> usize {
    /// Most digits.
    const MOST: usize = 9;
    let least = |axis: usize| {
        let text = point.coordinates[axis].as_str();
        text.split_once('.').map_or(0, |(_, digits)| digits.len())
    };
    least(2).min(MOST)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(coordinates: [&str; 3]) -> Picked {
        let position = coordinates.map(|text| text.parse().unwrap_or_default());
        Picked {
            coordinates: coordinates.map(String::from),
            steps: [1, 2, 3],
            scale: [0.001; 3],
            offset: [0.0; 3],
            position,
            attributes: Vec::new(),
            file: String::new(),
            scans: vec!["town.laz".into()],
            node: 0,
            point: 0,
            offset_px: 0.4,
            depth: 1.0,
        }
    }

    #[test]
    fn two_points_have_a_distance_and_a_third_one_replaces_the_first() {
        let mut measure = Measure::default();
        measure.push(point(["600000.125", "10.000", "-2.000"]));
        assert_eq!(measure.lines(Some("metre")), ["600000.125  10.000  -2.000"]);
        measure.push(point(["600003.125", "14.000", "10.000"]));
        let distance = "distance 13.000 metres, across 5.000, up 12.000";
        assert_eq!(measure.lines(Some("metre"))[2], distance);
        measure.push(point(["600003.12", "14.00", "11.00"]));
        let lines = measure.lines(None);
        assert_eq!(lines[1], "600003.12  14.00  11.00");
        assert!(lines[2].starts_with("distance 1.000,"), "{lines:?}");
        assert!(
            measure
                .about_last()
                .iter()
                .any(|(name, value)| name == "of scan" && value == "town.laz")
        );
        measure.pop();
        assert_eq!(measure.lines(None), ["600003.125  14.000  10.000"]);
    }
}
