//! Widgets that all tabs of the panel have: labels, rows of values, check boxes and sliders, each
//! with a tooltip and an accessible name.

use crate::theme;
use eframe::egui::{
    Align, DragValue, Label, Layout, ProgressBar, Response, RichText, Slider, SliderClamping, Ui,
    emath,
};
use esker_engine::io::quantity::readable_bytes;
use std::ops::RangeInclusive;

/// Size of small text, points.
pub const SMALL: f32 = 10.5;
/// Width of the number beside a slider, points.
const NUMBER_WIDTH: f32 = 64.0;
/// Height of a bar of progress, points.
const BAR_HEIGHT: f32 = 17.0;

/// Shows the name of a part of a tab.
pub fn section(ui: &mut Ui, name: &str) {
    ui.add_space(8.0);
    ui.label(RichText::new(name).strong().color(theme::inks(ui).accent));
}

/// Shows the name of a control, or an explanation.
pub fn label(ui: &mut Ui, text: &str) -> Response {
    ui.label(RichText::new(text).color(theme::inks(ui).faint))
}

/// Shows an explanation in small text, which wraps.
pub fn note(ui: &mut Ui, text: &str) {
    let text = RichText::new(text).size(SMALL).color(theme::inks(ui).faint);
    ui.add(Label::new(text).wrap());
}

/// Shows a row of a grid: a name with an explanation, and a value at the right end.
pub fn row(ui: &mut Ui, name: &str, value: &str, about: &str) {
    label(ui, name).on_hover_text(about);
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        // A long value must not make the panel wider.
        ui.add(Label::new(RichText::new(value).monospace()).truncate());
    });
    ui.end_row();
}

/// Shows a check box.
pub fn tick(ui: &mut Ui, is_on: &mut bool, name: &str, about: &str) -> Response {
    ui.checkbox(is_on, name).on_hover_text(about)
}

/// How a slider turns its value into text and back.
pub struct Scale {
    /// Whether equal distances on the slider are equal ratios.
    pub is_logarithmic: bool,
    /// Digits after the decimal point.
    pub decimals: usize,
    /// Whether numbers of points are shown in millions.
    pub is_millions: bool,
}

impl Scale {
    /// Equal distances are equal differences.
    pub fn linear(decimals: usize) -> Self {
        Self { is_logarithmic: false, decimals, is_millions: false }
    }

    /// Equal distances are equal ratios.
    pub fn logarithmic(decimals: usize) -> Self {
        Self { is_logarithmic: true, ..Self::linear(decimals) }
    }
}

/// Shows a slider with its name above it and its number beside it. A value beyond its ends, from
/// the command line, stays until the user changes it. Returns whether the value has changed.
pub fn slide<N: emath::Numeric>(
    ui: &mut Ui,
    (name, about): (&str, &str),
    value: &mut N,
    range: RangeInclusive<N>,
    scale: &Scale,
) -> bool {
    let name = label(ui, name).on_hover_text(about);
    let before = value.to_f64();
    ui.horizontal(|ui| {
        let spare = ui.available_width() - NUMBER_WIDTH - ui.spacing().item_spacing.x;
        ui.spacing_mut().slider_width = spare.max(NUMBER_WIDTH);
        let slider = Slider::new(value, range.clone()).logarithmic(scale.is_logarithmic);
        let slider = slider.clamping(SliderClamping::Edits).show_value(false);
        ui.add(slider).labelled_by(name.id).on_hover_text(about);
        let speed = (range.end().to_f64() - range.start().to_f64()) / 500.0;
        let number = DragValue::new(value).range(range.clone()).clamp_existing_to_range(false);
        let number = match scale.is_millions {
            true => number.custom_formatter(|n, _| millions(n)).custom_parser(parse_millions),
            false => number.fixed_decimals(scale.decimals),
        };
        ui.add(number.speed(speed)).labelled_by(name.id).on_hover_text(about);
    });
    value.to_f64() != before
}

/// Shows how much of a memory budget is taken.
pub fn budget_bar(ui: &mut Ui, name: &str, bytes: u64, budget: u64, about: &str) {
    let share = bytes as f32 / budget.max(1) as f32;
    let inks = theme::inks(ui);
    let text = format!("{name}  {} of {}", readable_bytes(bytes), readable_bytes(budget));
    let fill = if share > 1.0 { inks.fault } else { inks.cool.gamma_multiply(0.55) };
    bar(ui, share, fill, &text).on_hover_text(about);
}

/// Shows a share, 0 to 1, as a bar with a text on it.
pub fn bar(ui: &mut Ui, share: f32, fill: eframe::egui::Color32, text: &str) -> Response {
    let bar = ProgressBar::new(share.min(1.0)).fill(fill).corner_radius(3.0);
    ui.add(bar.desired_height(BAR_HEIGHT).text(RichText::new(text).size(11.0)))
}

/// Formats a number of points in millions, with all digits if it is below a hundred thousand.
pub fn millions(n: f64) -> String {
    if n < 1e5 { format!("{} M", n / 1e6) } else { format!("{:.1} M", n / 1e6) }
}

/// Parses a number of millions.
fn parse_millions(text: &str) -> Option<f64> {
    text.trim().trim_end_matches(['M', ' ']).parse::<f64>().ok().map(|n| n * 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_of_few_points_are_shown_exactly() {
        assert_eq!(millions(20_000_000.0), "20.0 M");
        assert_eq!(millions(99_429.0), "0.099429 M");
        assert_eq!(millions(1.0), "0.000001 M");
        assert_eq!(parse_millions("2.5 M"), Some(2.5e6));
        assert_eq!(parse_millions("much"), None);
    }
}
