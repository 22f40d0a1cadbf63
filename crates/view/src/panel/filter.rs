//! The tab that chooses the points to show: a list of classes with a check box each, flags, ranges
//! of values, a box, a spacing and the polygon of the command line. A field takes effect when it
//! loses the focus; if its text is invalid, an error is shown.

use super::data::PanelData;
use super::names;
use super::ranges::{self, Rows};
use super::widgets::{SMALL, label, note, section, tick};
use crate::theme;
use eframe::egui::{Align, Button, Color32, Label, Layout, RichText, Sense, TextEdit, Ui, vec2};
use esker_engine::cameras::classes::ClassCount;
use esker_engine::io::quantity::grouped;
use esker_engine::{Bounds, Classes, Filter, Flags};

/// Side of the square of a colour, points.
const SQUARE: f32 = 10.0;
/// Names of flags, and what they mark.
const FLAGS: [(&str, &str); 4] = [
    ("withheld", "Points that whoever classified the scan wants left out"),
    ("overlap", "Points where flight lines overlap"),
    ("synthetic", "Points that no scanner has measured"),
    ("key-point", "Points that a model of the ground needs"),
];

/// Texts of the fields, and the error of the last one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fields {
    /// The filter that the texts are of; none before the first pass.
    of: Option<Filter>,
    bounds: String,
    spacing: String,
    fault: Option<String>,
}

impl Fields {
    fn of(filter: &Filter) -> Self {
        let bounds = filter.bounds.map(|Bounds { min, max }| {
            let axes = if min[2].is_finite() { 3 } else { 2 };
            let numbers = min[..axes].iter().chain(&max[..axes]);
            numbers.map(f64::to_string).collect::<Vec<_>>().join(",")
        });
        Self {
            bounds: bounds.unwrap_or_default(),
            spacing: filter.max_spacing.map(|s| s.to_string()).unwrap_or_default(),
            fault: None,
            of: Some(filter.clone()),
        }
    }

    /// Parses the fields; all other conditions are those of `before`.
    fn filter(&self, before: &Filter) -> Result<Filter, String> {
        fn read<T>(
            word: &str,
            read: impl Fn(&str) -> Result<T, String>,
        ) -> Result<Option<T>, String> {
            let word = word.trim();
            if word.is_empty() { Ok(None) } else { read(word).map(Some) }
        }
        let spacing = |word: &str| {
            let value = word.parse().ok().filter(|s: &f64| s.is_finite() && *s > 0.0);
            value.ok_or_else(|| format!("`{word}` is not a length above 0"))
        };
        Ok(Filter {
            classes: before.classes,
            bounds: read(&self.bounds, |w| w.parse::<Bounds>().map_err(|e| e.to_string()))?,
            max_spacing: read(&self.spacing, spacing)?,
            polygon: before.polygon.clone(),
            flags: before.flags,
            without_flags: before.without_flags,
            values: before.values.clone(),
        })
    }
}

/// Shows the tab; changes `filter` when a class is ticked, an end of a range is moved, or a field
/// loses the focus.
pub fn show(
    ui: &mut Ui,
    (fields, rows): (&mut Fields, &mut Rows),
    data: &PanelData<'_>,
    filter: &mut Filter,
) {
    if fields.of.is_none() {
        *fields = Fields::of(filter);
    }
    let is_filtered = *filter != Filter::default();
    let all = ui.add_enabled(is_filtered, Button::new("Show all points"));
    let all = all.on_hover_text("Remove the whole filter");
    if all.on_disabled_hover_text("All points are shown").clicked() {
        *filter = Filter::default();
        *fields = Fields::of(filter);
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
    text_fields(ui, fields, filter, data.unit);
    if filter.polygon.is_some() {
        ui.horizontal(|ui| {
            label(ui, "within a polygon");
            let clear = ui.small_button("clear").on_hover_text("Show the points outside it too");
            if clear.clicked() {
                filter.polygon = None;
            }
        });
    }
}

/// Fields that are typed.
fn text_fields(ui: &mut Ui, fields: &mut Fields, filter: &mut Filter, unit: Option<&str>) {
    let unit = unit.map_or(String::new(), |unit| format!(", {}", names::plural(unit)));
    let mut is_left = false;
    let Fields { bounds, spacing, fault, .. } = fields;
    for (name, word, hint, about) in [
        (
            "box".to_owned(),
            bounds,
            "x0, y0, x1, y1",
            "Show the points within a box: its least and greatest coordinates. Press Enter",
        ),
        (
            format!("spacing{unit}"),
            spacing,
            "such as 0.5",
            "Show an even sample whose points are about this far apart. Press Enter",
        ),
    ] {
        let name = label(ui, &name).on_hover_text(about);
        let field = TextEdit::singleline(word).hint_text(hint).desired_width(f32::INFINITY);
        is_left |= ui.add(field).labelled_by(name.id).on_hover_text(about).lost_focus();
    }
    if let Some(fault) = fault {
        let text = RichText::new(fault.as_str()).small().color(theme::inks(ui).fault);
        ui.add(Label::new(text).wrap());
    } else {
        note(ui, "A field takes effect with Enter.");
    }
    if is_left {
        match fields.filter(filter) {
            Ok(wanted) => (*filter, fields.fault) = (wanted, None),
            Err(fault) => fields.fault = Some(fault),
        }
    }
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
    for ClassCount { class, name, rgb: [r, g, b], points } in classes {
        ui.horizontal(|ui| {
            let mut is_ticked = is_shown(filter, *class);
            let (square, _) = ui.allocate_exact_size(vec2(SQUARE, SQUARE), Sense::hover());
            ui.painter().rect_filled(square, 2.0, Color32::from_rgb(*r, *g, *b));
            let tick = ui.checkbox(&mut is_ticked, format!("{class} {name}"));
            let tick =
                tick.on_hover_text(format!("Show the {} points of this class", grouped(*points)));
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
                ui.label(RichText::new(grouped(*points)).size(SMALL).color(theme::inks(ui).faint));
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
    fn fields_are_parsed_to_a_filter_and_a_filter_is_formatted_to_fields() {
        let fields =
            Fields { bounds: "1,2,3,4".into(), spacing: "0.5".into(), ..Fields::default() };
        let before = Filter { classes: "2,6".parse().ok(), ..Filter::default() };
        let filter = fields.filter(&before).unwrap();
        assert!(filter.classes.unwrap().has(6) && filter.max_spacing == Some(0.5));
        let again = Fields::of(&filter);
        assert_eq!((again.bounds, again.spacing), (fields.bounds.clone(), fields.spacing.clone()));
        assert_eq!(Fields::default().filter(&filter).unwrap(), before);
        for wrong in [
            Fields { bounds: "1,2".into(), ..fields.clone() },
            Fields { spacing: "-1".into(), ..fields.clone() },
        ] {
            assert!(wrong.filter(&filter).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn ticked_classes_are_a_filter_unless_they_are_all() {
        let count = |class| ClassCount { class, name: "class", rgb: [0; 3], points: 1 };
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
