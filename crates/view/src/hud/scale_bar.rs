//! The scale bar: the longest of 1, 2 or 5 times a power of ten that is at most as long as the room
//! for it.

use super::label::boxed;
use crate::theme;
use eframe::egui::{Align2, Color32, Id, Painter, Pos2, Sense, Stroke, Ui, pos2, vec2};

/// Greatest length of the bar, points.
const LENGTH: f64 = 140.0;
/// Height of the ends of the bar, points.
const END: f32 = 5.0;

/// Shows the bar with its right end near `corner`; `point` is the length of a point of the screen,
/// in `unit`.
pub fn show(
    ui: &Ui,
    painter: &Painter,
    corner: Pos2,
    point: f64,
    unit: Option<&str>,
    is_parallel: bool,
) {
    let Some(length) = round_below(point * LENGTH) else { return };
    let points = (length / point) as f32;
    let text = labelled(length, unit);
    let label = boxed(painter, corner - vec2(0.0, END + 3.0), Align2::RIGHT_BOTTOM, &text);
    let (left, right, y) = (corner.x - points, corner.x, corner.y);
    let line = [pos2(left, y - END), pos2(left, y), pos2(right, y), pos2(right, y - END)];
    for (width, ink) in [(4.0, Color32::from_black_alpha(150)), (1.5, theme::TEXT)] {
        line.windows(2).for_each(|ends| {
            painter.line_segment([ends[0], ends[1]], Stroke::new(width, ink));
        });
    }
    let area = label.union(eframe::egui::Rect::from_min_max(line[0], line[2]));
    let about = match is_parallel {
        true => "A length in the picture, the same everywhere in it",
        false => {
            "A length at the distance of what is in the middle of the picture; nearer things are larger"
        }
    };
    ui.interact(area, Id::unique("scale bar"), Sense::hover()).on_hover_text(about);
}

/// The greatest of 1, 2 and 5 times a power of ten that is at most `length`.
fn round_below(length: f64) -> Option<f64> {
    if !(length.is_normal() && length > 0.0) {
        return None;
    }
    // A length that is such a number but for rounding is one.
    let length = length * (1.0 + 1e-9);
    let power = 10.0_f64.powf(length.log10().floor());
    let round = [5.0, 2.0, 1.0].map(|n| n * power).into_iter().find(|round| *round <= length);
    round.filter(|round| round.is_normal())
}

/// A round length with its unit; metres in the unit of their size.
fn labelled(length: f64, unit: Option<&str>) -> String {
    // Without the noise of powers of ten.
    let number = |length: f64| {
        if (1e-4..1e7).contains(&length) {
            let digits = (-length.log10().floor()).max(0.0) as usize;
            format!("{length:.digits$}")
        } else {
            format!("{length:.0e}")
        }
    };
    match unit {
        Some("m") if length >= 999.0 => format!("{} km", number(length / 1e3)),
        Some("m") if length < 0.009 => format!("{} mm", number(length * 1e3)),
        Some("m") if length < 0.9 => format!("{} cm", number(length * 1e2)),
        Some(unit) => format!("{} {unit}", number(length)),
        None => format!("{} units", number(length)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_round_and_not_longer_than_the_room() {
        for (room, length) in [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.9, 2.0), (5.1, 5.0)] {
            for power in -6..7 {
                let scale = 10.0_f64.powi(power);
                let found = round_below(room * scale).unwrap();
                assert!((found / (length * scale) - 1.0).abs() < 1e-9, "{room} {power}: {found}");
            }
        }
        for none in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(round_below(none), None);
        }
    }

    #[test]
    fn labels_have_units_that_fit_the_length() {
        for (length, unit, label) in [
            (1000.0, Some("m"), "1 km"),
            (50_000.0, Some("m"), "50 km"),
            (500.0, Some("m"), "500 m"),
            (1.0, Some("m"), "1 m"),
            (0.2, Some("m"), "20 cm"),
            (0.01, Some("m"), "1 cm"),
            (0.005, Some("m"), "5 mm"),
            (0.0002, Some("m"), "0.2 mm"),
            (0.5, Some("ft"), "0.5 ft"),
            (2000.0, Some("ft"), "2000 ft"),
            (0.02, None, "0.02 units"),
            (1e9, None, "1e9 units"),
        ] {
            assert_eq!(labelled(length, unit), label);
        }
    }
}
