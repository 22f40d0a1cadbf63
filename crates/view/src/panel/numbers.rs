//! Fields for numbers of any size, such as coordinates: what is typed is kept to the last digit,
//! and shown shortened only while it is not edited.

use eframe::egui::{DragValue, Key, Ui, vec2};
use std::ops::RangeInclusive;

/// Width of a digit, and of the margins of a field, points.
const DIGIT: f32 = 7.2;
const MARGINS: f32 = 10.0;

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
/// while it is dragged; Escape leaves it as it was. Returns whether the value has changed.
pub fn number(ui: &mut Ui, field: &Field<'_>, value: &mut f64) -> bool {
    let before = *value;
    // The field has this identity whether it is edited or not.
    let id = ui.next_auto_id();
    let is_edited = ui.memory(|memory| memory.has_focus(id));
    let characters = ((field.width - MARGINS) / DIGIT) as usize;
    let text =
        move |value: f64| if is_edited { value.to_string() } else { short(value, characters) };
    let drag = DragValue::new(value).speed(field.speed).range(field.range.clone());
    let drag = drag.clamp_existing_to_range(false).update_while_editing(false);
    let drag = drag.custom_formatter(move |value, _| text(value)).custom_parser(parse);
    let height = ui.spacing().interact_size.y;
    let response = ui.add(drag.min_size(vec2(field.width, height)).clip_text(true));
    ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(field.name));
    // egui would take what was typed in the pass after the one in which Escape takes the focus.
    let escaped = id.with("escaped");
    let was_escaped = ui.data_mut(|data| data.remove_temp::<bool>(escaped)).is_some();
    let is_escaped = response.lost_focus() && ui.input(|input| input.key_pressed(Key::Escape));
    if is_escaped {
        ui.data_mut(|data| data.insert_temp(escaped, true));
    }
    if is_escaped || was_escaped {
        *value = before;
    }
    response.on_hover_text(field.about);
    value.to_bits() != before.to_bits()
}

/// A number in so many characters: without its last digits if it has more.
fn short(value: f64, characters: usize) -> String {
    let fits = |text: &String| text.chars().count() <= characters;
    let exact = value.to_string();
    if fits(&exact) {
        return exact;
    }
    let fixed = (0..characters).rev().map(|decimals| format!("{value:.decimals$}")).find(fits);
    let scientific = (0..characters).rev().map(|decimals| format!("{value:.decimals$e}"));
    let scientific = scientific.into_iter().find(fits);
    let is_tiny = value.abs() < 1e-3;
    let (first, second) = if is_tiny { (scientific, fixed) } else { (fixed, scientific) };
    first.or(second).unwrap_or(exact)
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
        for (value, characters, text) in [
            (4_512_345.123, 11, "4512345.123"),
            (4_512_345.123_456_7, 11, "4512345.123"),
            (0.1 + 0.2, 11, "0.300000000"),
            (-30.123_456, 6, "-30.12"),
            (-180.5, 6, "-180.5"),
            (123_456_789.0, 6, "1.23e8"),
            (1e-9 / 3.0, 6, "3e-10"),
            (-1e300, 6, "-1e300"),
        ] {
            assert_eq!(short(value, characters), text);
        }
    }
}
