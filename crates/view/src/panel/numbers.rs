//! Fields for numbers of any size, such as coordinates: what is typed is kept to the last digit,
//! and shown shortened only while it is not edited.

use eframe::egui::{DragValue, Ui, vec2};
use std::ops::RangeInclusive;

/// Most characters of a number that is not edited.
const CHARACTERS: usize = 12;

/// How a number is edited.
#[derive(Clone, Debug)]
pub struct Field<'a> {
    /// Accessible name.
    pub name: &'a str,
    /// Tooltip.
    pub about: &'a str,
    /// Change by a drag over one point of the screen.
    pub speed: f64,
    /// Values to which what the user enters is clamped.
    pub range: RangeInclusive<f64>,
    /// Width, points.
    pub width: f32,
}

/// Shows a field. A number takes effect when Enter is pressed or the field loses the focus, or
/// while it is dragged. Returns whether the value has changed.
pub fn number(ui: &mut Ui, field: &Field<'_>, value: &mut f64) -> bool {
    let before = *value;
    // The field has this identity whether it is edited or not.
    let is_edited = ui.memory(|memory| memory.has_focus(ui.next_auto_id()));
    let text = move |value: f64| if is_edited { value.to_string() } else { short(value) };
    let drag = DragValue::new(value).speed(field.speed).range(field.range.clone());
    let drag = drag.clamp_existing_to_range(false).update_while_editing(false);
    let drag = drag.custom_formatter(move |value, _| text(value)).custom_parser(parse);
    let height = ui.spacing().interact_size.y;
    let response = ui.add(drag.min_size(vec2(field.width, height)).clip_text(true));
    ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(field.name));
    response.on_hover_text(field.about);
    value.to_bits() != before.to_bits()
}

/// A number in a few characters: without its last digits if it has too many.
fn short(value: f64) -> String {
    let exact = value.to_string();
    if exact.chars().count() <= CHARACTERS {
        return exact;
    }
    let whole = format!("{value:.0}").chars().count();
    match CHARACTERS.checked_sub(whole + 1) {
        Some(decimals) if value.abs() >= 1e-3 => format!("{value:.decimals$}"),
        _ => format!("{value:.4e}"),
    }
}

/// Parses a number; groups of digits may be separated.
fn parse(text: &str) -> Option<f64> {
    let is_separator = |c: char| c.is_whitespace() || matches!(c, '_' | '\'' | '’');
    let digits: String = text.chars().filter(|&c| !is_separator(c)).collect();
    let value: f64 = digits.replace('−', "-").parse().ok()?;
    value.is_finite().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_exactly_and_shown_in_few_characters() {
        assert_eq!(parse("4 512 345.123"), Some(4_512_345.123));
        assert_eq!(parse("4_512'345.1234567"), Some(4_512_345.123_456_7));
        assert_eq!(parse("−0.5"), Some(-0.5));
        for wrong in ["", "x", "inf", "nan", "1,5", "1e999"] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
        assert_eq!(short(4_512_345.123), "4512345.123");
        assert_eq!(short(4_512_345.123_456_7), "4512345.1235");
        assert_eq!(short(0.1 + 0.2), "0.3000000000");
        for value in [1e300, -1e300, 1e-300, f64::MIN_POSITIVE, -123_456_789_012.5, 0.0, -0.1 / 3.0] {
            assert!(short(value).chars().count() <= CHARACTERS, "{}", short(value));
        }
    }
}
