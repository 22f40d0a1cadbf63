//! Measurements: those of a scene document, the points of the file that were clicked, with their
//! own coordinates and attributes, and the distance between the last two.

use crate::panel::names::plural;
use crate::{frustum, theme};
use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2, vec2};
use esker_engine::View;
use esker_engine::calls::pick::Picked;
use esker_engine::document::{Measurement, MeasurementKind};
use glam::DVec3;

/// Radius of the mark of a point, in points of the screen.
const MARK: f32 = 4.0;
/// Size of text in the picture, points.
const TEXT: f32 = 13.0;
/// Most digits after the decimal point.
const DIGITS_MOST: usize = 9;

/// Measurements of a document, and the points clicked last, two at most.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measure {
    kept: Vec<Kept>,
    points: Vec<Picked>,
}

/// A measurement of a document.
#[derive(Clone, Debug, PartialEq)]
struct Kept {
    measurement: Measurement,
    /// Its points in the lengths of the view.
    at: Vec<DVec3>,
}

impl Measure {
    /// The measurements of a document; `placed` gives the place of coordinates of the scans in the
    /// lengths of the view.
    pub fn of(measurements: &[Measurement], placed: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        let kept = measurements.iter().map(|measurement| {
            let at = measurement.points.iter().map(|p| placed(*p).into()).collect();
            Kept { measurement: measurement.clone(), at }
        });
        Self { kept: kept.collect(), points: Vec::new() }
    }

    /// All measurements as a document has them: those that it had, then the clicked points, in the
    /// coordinates of the scans.
    pub fn measurements(&self) -> Vec<Measurement> {
        let kept = self.kept.iter().map(|kept| kept.measurement.clone());
        // As text they have the digits that the scan has.
        let exact = |p: &Picked, i: usize| p.coordinates[i].parse().unwrap_or(p.position[i]);
        let points = self.points.iter().map(|p| [0, 1, 2].map(|i| exact(p, i))).collect();
        let kind = match self.points[..] {
            [_] => MeasurementKind::Coordinates,
            _ => MeasurementKind::Distance,
        };
        let clicked = Measurement { name: None, kind, points };
        kept.chain((!self.points.is_empty()).then_some(clicked)).collect()
    }

    /// Adds a point; a third one replaces the first.
    pub fn push(&mut self, point: Picked) {
        if self.points.len() == 2 {
            self.points.remove(0);
        }
        self.points.push(point);
    }

    /// Removes the last clicked point.
    pub fn pop(&mut self) {
        self.points.pop();
    }

    /// Removes the clicked points.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Removes the clicked points and the measurements of the document.
    pub fn clear_all(&mut self) {
        *self = Self::default();
    }

    /// Measurements of the document, then coordinates of the points, as an export writes them, and
    /// the distance between them, as lines of text.
    pub fn lines(&self, unit: Option<&str>) -> Vec<String> {
        let mut lines: Vec<String> = self.kept.iter().map(|kept| kept.line(unit)).collect();
        let unit = unit.map_or(String::new(), |unit| format!(" {}", plural(unit)));
        lines.extend(self.points.iter().map(|point| point.coordinates.join("  ")));
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

    /// Paints the points and the lines between them over a picture of the view `seen` that fills
    /// `rect`.
    pub fn paint(&self, painter: &Painter, rect: Rect, seen: &View) {
        let over = Over { painter, rect, seen };
        for kept in &self.kept {
            kept.paint(&over);
        }
        if let [a, b] = &self.points[..] {
            let digits = digits(a).max(digits(b));
            over.line([a.at(), b.at()]);
            over.text(a.at().lerp(b.at(), 0.5), format!("{:.digits$}", a.at().distance(b.at())));
        }
        for p in &self.points {
            over.mark(p.at());
        }
    }
}

impl Kept {
    /// What it measures, in words without its unit; `None` for coordinates and what has no value.
    fn value(&self) -> Option<String> {
        let points: Vec<[f64; 3]> = self.at.iter().map(DVec3::to_array).collect();
        let value = self.measurement.kind.value(&points)?;
        let heights = self.measurement.points.iter().map(|p| digits_of(&p[2].to_string()));
        let digits = match self.measurement.kind {
            MeasurementKind::Angle => 2,
            _ => heights.max().unwrap_or(0),
        };
        let sign = if self.measurement.kind == MeasurementKind::Angle { "°" } else { "" };
        Some(format!("{value:.digits$}{sign}"))
    }

    /// Its name, and what it measures.
    fn line(&self, unit: Option<&str>) -> String {
        let kind = self.measurement.kind;
        let what = match kind {
            MeasurementKind::Coordinates => {
                let place = self.measurement.points.iter().flatten().map(f64::to_string);
                place.collect::<Vec<String>>().join("  ")
            }
            _ => self.value().unwrap_or_else(|| "has no value".into()),
        };
        let unit = match (kind, unit.map(plural)) {
            (MeasurementKind::Distance | MeasurementKind::Height, Some(unit)) => format!(" {unit}"),
            (MeasurementKind::Area, Some(unit)) => format!(" square {unit}"),
            _ => String::new(),
        };
        let name = match (&self.measurement.name, kind) {
            (Some(name), _) => format!("{name}: "),
            (None, MeasurementKind::Coordinates) => String::new(),
            (None, MeasurementKind::Distance) => "distance ".into(),
            (None, MeasurementKind::Height) => "height ".into(),
            (None, MeasurementKind::Angle) => "angle ".into(),
            (None, MeasurementKind::Area) => "area ".into(),
        };
        format!("{name}{what}{unit}")
    }

    fn paint(&self, over: &Over<'_>) {
        self.at.windows(2).for_each(|line| over.line([line[0], line[1]]));
        if let (MeasurementKind::Area, [first, .., last]) = (self.measurement.kind, &self.at[..]) {
            over.line([*last, *first]);
        }
        let middle = self.at.iter().sum::<DVec3>() / self.at.len().max(1) as f64;
        let texts = self.measurement.name.iter().cloned().chain(self.value());
        let text = texts.collect::<Vec<String>>().join(": ");
        if !text.is_empty() {
            over.text(middle, text);
        }
        self.at.iter().for_each(|&at| over.mark(at));
    }
}

/// Paints marks over a picture.
pub struct Over<'a> {
    /// The painter.
    pub painter: &'a Painter,
    /// Where the picture is, points of the screen.
    pub rect: Rect,
    /// View of the picture.
    pub seen: &'a View,
}

impl Over<'_> {
    fn on(&self, p: [f64; 2]) -> Pos2 {
        let size = [self.seen.width, self.seen.height].map(f64::from);
        let [x, y] = [0, 1].map(|i| (p[i] / size[i]).clamp(-100.0, 100.0) as f32);
        pos2(self.rect.left() + x * self.rect.width(), self.rect.top() + y * self.rect.height())
    }

    fn dark() -> Color32 {
        Color32::from_black_alpha(150)
    }

    /// A line.
    fn line(&self, line: [DVec3; 2]) {
        if let Some([from, to]) = frustum::project(self.seen, line) {
            let line = [self.on(from), self.on(to)];
            self.painter.line_segment(line, Stroke::new(3.5, Self::dark()));
            self.painter.line_segment(line, Stroke::new(1.5, theme::ACCENT));
        }
    }

    /// A text above a place.
    pub fn text(&self, at: DVec3, text: String) {
        let Some([at, _]) = frustum::project(self.seen, [at, at]) else { return };
        let text = self.painter.layout_no_wrap(text, FontId::proportional(TEXT), theme::ACCENT);
        let middle = self.on(at) - vec2(0.0, 14.0);
        let behind = Align2::CENTER_CENTER.anchor_size(middle, text.size());
        self.painter.rect_filled(behind.expand(4.0), 4.0, Self::dark());
        self.painter.galley(behind.min, text, theme::ACCENT);
    }

    /// A ring around a place.
    pub fn mark(&self, at: DVec3) {
        if let Some([at, _]) = frustum::project(self.seen, [at, at]) {
            let ring = Stroke::new(1.5, theme::ACCENT);
            self.painter.circle(self.on(at), MARK, Self::dark(), ring);
        }
    }
}

/// Digits after the decimal point for distances from this point: those of its height, which is in
/// the unit of lengths also where x and y are degrees.
fn digits(point: &Picked) -> usize {
    digits_of(&point.coordinates[2])
}

fn digits_of(text: &str) -> usize {
    text.split_once('.').map_or(0, |(_, digits)| digits.len()).min(DIGITS_MOST)
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

    #[test]
    fn measurements_of_a_document_stay_and_clicked_points_are_added() {
        // One degree of longitude is 50,000 metres here.
        let placed = |[x, y, z]: [f64; 3]| [x * 5e4, y * 1e5, z];
        let measurement = |name: &str, kind, points: &[[f64; 3]]| Measurement {
            name: (!name.is_empty()).then(|| name.into()),
            kind,
            points: points.to_vec(),
        };
        let [a, b] = [[7.0, 50.0, 100.25], [7.0, 50.0003, 60.25]];
        let corner = [7.0008, 50.0003, 60.25];
        let kept = [
            measurement("mast", MeasurementKind::Height, &[b, a]),
            measurement("", MeasurementKind::Distance, &[a, b]),
            measurement("", MeasurementKind::Coordinates, &[a]),
            measurement("roof", MeasurementKind::Area, &[[7.0, 50.0, 60.25], b, corner]),
            measurement("", MeasurementKind::Angle, &[[7.0, 50.0, 60.25], b, corner]),
        ];
        let mut measure = Measure::of(&kept, placed);
        let lines = [
            "mast: 40.00 metres",
            "distance 50.00 metres",
            "7  50  100.25",
            "roof: 600.00 square metres",
            "angle 90.00°",
        ];
        assert_eq!(measure.lines(Some("metre")), lines);
        assert_eq!(measure.measurements(), kept);
        measure.push(point(["600000.125", "10.000", "-2.000"]));
        let place = [600_000.125, 10.0, -2.0];
        let one = measurement("", MeasurementKind::Coordinates, &[place]);
        assert_eq!(measure.measurements()[5..], [one]);
        measure.push(point(["600003.125", "14.000", "10.000"]));
        let points = [place, [600_003.125, 14.0, 10.0]];
        let two = measurement("", MeasurementKind::Distance, &points);
        assert_eq!(measure.measurements()[5..], [two]);
        measure.clear();
        assert_eq!(measure.measurements(), kept, "a click beside the scan keeps them");
        measure.clear_all();
        assert_eq!(measure, Measure::default());
    }
}
