//! The legend of the colours: a bar with the ends of a range of values, or a line with a colour for
//! each value.

use super::names;
use super::widgets::SMALL;
use crate::theme;
use eframe::egui::{Align2, Color32, FontId, Label, Mesh, Rect, RichText, Sense, Ui, pos2, vec2};
use esker_engine::cameras::legend::{Legend, LegendEntry};

/// Height of the bar, and side of the square of a colour, points.
const BAR: f32 = 10.0;
/// Colours of the bar; those between are interpolated.
const COLOURS: usize = 24;

/// Shows a legend; `unit` is that of lengths.
pub fn show(ui: &mut Ui, legend: &Legend, unit: Option<&str>) {
    let faint = theme::inks(ui).faint;
    let small = |text: &str| RichText::new(text).size(SMALL).color(faint);
    let name = names::source(&legend.name);
    let unit = unit
        .filter(|_| legend.is_length)
        .map_or(String::new(), |unit| format!(", {}", names::plural(unit)));
    let range = legend.range_text();
    let colours = legend.bar(COLOURS);
    match &range {
        Some([low, high]) if !colours.is_empty() => {
            ui.label(small(&format!("{name}{unit}")));
            bar(ui, &colours, [low, high]);
        }
        Some([low, high]) if legend.entries.is_empty() => {
            drop(ui.label(small(&format!("{name} {low} to {high}"))))
        }
        _ => drop(ui.label(small(&name))),
    }
    for LegendEntry { value, name, rgb: [r, g, b] } in &legend.entries {
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(vec2(BAR, BAR), Sense::hover());
            ui.painter().rect_filled(rect, 2.0, Color32::from_rgb(*r, *g, *b));
            ui.add(Label::new(small(&entry(*value, name))).truncate());
        });
    }
    if let Some(note) = legend.note {
        ui.add(Label::new(small(note)).wrap());
    }
}

/// What a colour of its own stands for.
fn entry(value: u32, name: &str) -> String {
    match name {
        // What LAS calls a source is a scan to people.
        "source" => format!("scan {value}"),
        "return" => format!("return {value}"),
        "returns" if value == 1 => "1 return".to_owned(),
        "returns" => format!("{value} returns"),
        _ => format!("{value}  {name}"),
    }
}

/// Paints colours from left to right, with the values of the first and the last.
fn bar(ui: &mut Ui, colours: &[[u8; 3]], [low, high]: [&str; 2]) {
    let size = vec2(ui.available_width(), BAR + SMALL + 4.0);
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let bar = Rect::from_min_size(rect.min, vec2(rect.width(), BAR));
    let mut mesh = Mesh::default();
    for (i, &[r, g, b]) in (0u32..).zip(colours) {
        let x = bar.left() + bar.width() * i as f32 / (colours.len() - 1).max(1) as f32;
        let colour = Color32::from_rgb(r, g, b);
        mesh.colored_vertex(pos2(x, bar.top()), colour);
        mesh.colored_vertex(pos2(x, bar.bottom()), colour);
        if i > 0 {
            mesh.add_triangle(2 * i - 2, 2 * i - 1, 2 * i);
            mesh.add_triangle(2 * i - 1, 2 * i, 2 * i + 1);
        }
    }
    ui.painter().add(mesh);
    let ink = theme::inks(ui).faint;
    let font = FontId::proportional(SMALL);
    let text = |at, align, text: &str| ui.painter().text(at, align, text, font.clone(), ink);
    text(rect.left_bottom(), Align2::LEFT_BOTTOM, low);
    text(rect.right_bottom(), Align2::RIGHT_BOTTOM, high);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_their_own_are_named_in_plain_words() {
        for (value, name, words) in [
            (211, "source", "scan 211"),
            (1, "returns", "1 return"),
            (3, "returns", "3 returns"),
            (2, "ground", "2  ground"),
        ] {
            assert_eq!(entry(value, name), words);
        }
    }
}
