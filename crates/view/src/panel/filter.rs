//! The tab that chooses the points to show: a list of classes with a check box each, flags, ranges
//! of values, a box, a spacing, the polygon of the command line, and clips.

use super::clips;
use super::data::PanelData;
use super::names;
use super::numbers::{Field, number};
use super::ranges::{self, Rows};
use super::widgets::{SMALL, label, section, tick};
use crate::theme;
use eframe::egui::{Align, Button, Color32, Layout, RichText, Sense, Ui, vec2};
use esker_engine::cameras::classes::ClassCount;
use esker_engine::io::quantity::grouped;
use esker_engine::{Bounds, Classes, Filter, Flags};

/// Side of the square of a colour, points.
const SQUARE: f32 = 10.0;
/// Width of the field of the spacing, points.
const SPACING_WIDTH: f32 = 72.0;
/// Names of flags, and what they mark.
const FLAGS: [(&str, &str); 4] = [
    ("withheld", "Points that whoever classified the scan wants left out"),
    ("overlap", "Points where flight lines overlap"),
    ("synthetic", "Points that no scanner has measured"),
    ("key-point", "Points that a model of the ground needs"),
];

/// Shows the tab; changes `filter` as the user does.
pub fn show(ui: &mut Ui, rows: &mut Rows, data: &PanelData<'_>, filter: &mut Filter) {
    let is_filtered = *filter != Filter::default();
    let all = ui.add_enabled(is_filtered, Button::new("Show all points"));
    let all = all.on_hover_text("Remove the whole filter");
    if all.on_disabled_hover_text("All points are shown").clicked() {
        *filter = Filter::default();
    }
    if !data.classes.is_empty() {
        section(ui, "Classes");
        class_list(ui, filter, data.classes);
    }
    if data.has_flags {
        section(ui, "Leave out");
        flags(ui, &mut filter.without_flags);
    }
    ranges::show(ui, rows, data, filter);
    section(ui, "Place");
    box_of_filter(ui, data, &mut filter.bounds);
    spacing(ui, data, &mut filter.max_spacing);
    if filter.polygon.is_some() {
        ui.horizontal(|ui| {
            label(ui, "within a polygon");
            let clear = ui.small_button("clear").on_hover_text("Show the points outside it too");
            if clear.clicked() {
                filter.polygon = None;
            }
        });
    }
    clips::show(ui, data, filter);
}

/// A switch and the corners of the box of the filter.
fn box_of_filter(ui: &mut Ui, data: &PanelData<'_>, bounds: &mut Option<Bounds>) {
    let mut is_boxed = bounds.is_some();
    let about = "Show the points between two corners, in the scan's coordinates";
    if tick(ui, &mut is_boxed, "within a box", about).changed() {
        *bounds = data.extent.filter(|_| is_boxed).map(|extent| whole(data, extent));
    }
    let Some(bounds) = bounds else { return };
    let mut has_heights = bounds.min[2].is_finite() && bounds.max[2].is_finite();
    let about = "Whether heights are bounded too";
    if tick(ui, &mut has_heights, "also heights", about).changed() {
        let heights = data.extent.filter(|_| has_heights).map(|extent| whole(data, extent));
        let ends = heights.map(|whole| [whole.min[2], whole.max[2]]);
        [bounds.min[2], bounds.max[2]] = ends.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    }
    clips::box_fields(ui, clips::speed(data), bounds);
}

/// The box of all points, a step wider, so that rounding of its corners loses none.
fn whole(data: &PanelData<'_>, extent: [[f64; 2]; 3]) -> Bounds {
    let scale = data.file.lattice().scale;
    let corner = |end: usize, sign: f64| {
        clips::tidy(data, [0, 1, 2].map(|i| extent[i][end] + sign * scale[i]))
    };
    Bounds { min: corner(0, -1.0), max: corner(1, 1.0) }
}

/// A field of the spacing, where 0 stands for all points.
fn spacing(ui: &mut Ui, data: &PanelData<'_>, spacing: &mut Option<f64>) {
    let unit = data.unit.map_or(String::new(), |unit| format!(", {}", names::plural(unit)));
    let about = "Show an even sample whose points are about this far apart; 0 shows all points";
    ui.horizontal(|ui| {
        label(ui, &format!("spacing{unit}")).on_hover_text(about);
        let field = Field {
            name: "spacing",
            about,
            speed: clips::speed(data) / 10.0,
            range: 0.0..=f64::MAX,
            width: SPACING_WIDTH,
        };
        let mut length = spacing.unwrap_or(0.0);
        if number(ui, &field, &mut length) {
            *spacing = (length > 0.0).then_some(length);
        }
    });
}

/// A check box for each flag whose points are left out.
fn flags(ui: &mut Ui, without: &mut Flags) {
    let text = without.to_string();
    let mut named: Vec<&str> = text.split(',').filter(|name| !name.is_empty()).collect();
    for (name, about) in FLAGS {
        let mut is_out = named.contains(&name);
        if tick(ui, &mut is_out, name, about).changed() {
            named.retain(|other| *other != name);
            named.extend(is_out.then_some(name));
        }
    }
    *without = named.join(",").parse().unwrap_or_default();
}

/// A line for each class: whether it is shown, its colour, name and points, and a button that shows
/// it alone.
fn class_list(ui: &mut Ui, filter: &mut Filter, classes: &[ClassCount]) {
    let is_shown = |filter: &Filter, class: u8| filter.classes.is_none_or(|set| set.has(class));
    for ClassCount { class, name, rgb: [r, g, b], points, is_estimate } in classes {
        ui.horizontal(|ui| {
            let mut is_ticked = is_shown(filter, *class);
            let (square, _) = ui.allocate_exact_size(vec2(SQUARE, SQUARE), Sense::hover());
            ui.painter().rect_filled(square, 2.0, Color32::from_rgb(*r, *g, *b));
            let tick = ui.checkbox(&mut is_ticked, format!("{class} {name}"));
            let (about, all) = (if *is_estimate { "about " } else { "" }, grouped(*points));
            let tick = tick.on_hover_text(format!("Show the {about}{all} points of this class"));
            if tick.changed() {
                set_class(filter, classes, *class, is_ticked);
            }
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let only =
                    ui.small_button("only").on_hover_text(format!("Show class {class} alone"));
                if only.clicked() {
                    let mut set = Classes::default();
                    set.set(*class, true);
                    filter.classes = Some(set);
                }
                let about = if *is_estimate { "~" } else { "" };
                let count = RichText::new(format!("{about}{all}")).size(SMALL);
                ui.label(count.color(theme::inks(ui).faint));
            });
        });
    }
    if filter.classes.is_some() {
        let all = ui.small_button("all classes").on_hover_text("Show the points of all classes");
        if all.clicked() {
            filter.classes = None;
        }
    }
}

/// Shows a class, or hides it. All that occur are no filter.
fn set_class(filter: &mut Filter, classes: &[ClassCount], class: u8, is_wanted: bool) {
    let occurring = || classes.iter().map(|count| count.class);
    let mut set = filter.classes.unwrap_or_else(|| {
        let mut all = Classes::default();
        occurring().for_each(|class| all.set(class, true));
        all
    });
    set.set(class, is_wanted);
    filter.classes = (!occurring().all(|class| set.has(class))).then_some(set);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn ticked_classes_are_a_filter_unless_they_are_all() {
        let count =
            |class| ClassCount { class, name: "class", rgb: [0; 3], points: 1, is_estimate: false };
        let classes = [1, 2, 70].map(count);
        let mut filter = Filter::default();
        set_class(&mut filter, &classes, 2, false);
        let has = |filter: &Filter| [1, 2, 70].map(|class| filter.classes.unwrap().has(class));
        assert_eq!(has(&filter), [true, false, true]);
        set_class(&mut filter, &classes, 70, false);
        assert_eq!(has(&filter), [true, false, false]);
        set_class(&mut filter, &classes, 2, true);
        set_class(&mut filter, &classes, 70, true);
        assert_eq!(filter, Filter::default());
    }
}
