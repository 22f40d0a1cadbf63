//! The part of the panel that chooses the points to show: a list of classes with a check box each,
//! and fields for a box and a spacing. A field takes effect when it loses the focus; if its text is
//! invalid, an error is shown.

use crate::settings::Settings;
use crate::theme;
use eframe::egui::{
    Align, Color32, Context, Id, Label, Layout, RichText, Sense, TextEdit, Ui, vec2,
};
use esker_engine::cameras::classes::ClassCount;
use esker_engine::io::quantity::grouped;
use esker_engine::{Bounds, Classes, Filter};

/// Width of a field, points.
const WIDTH: f32 = 150.0;
/// Side of the square of a colour, points.
const SQUARE: f32 = 10.0;

/// Texts of the fields, and the error of the last one.
#[derive(Clone, Debug, Default, PartialEq)]
struct Fields {
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
        })
    }
}

/// Shows the list of `classes`, those that occur, and the fields; changes the filter of `wanted`
/// when a class is ticked, or a field loses the focus.
pub fn show(ui: &mut Ui, wanted: &mut Settings, classes: &[ClassCount]) {
    class_list(ui, &mut wanted.filter, classes);
    let id = words_id();
    let known = ui.data_mut(|data| data.get_temp::<Fields>(id));
    let mut fields = known.unwrap_or_else(|| Fields::of(&wanted.filter));
    let mut is_left = false;
    let Fields { bounds, spacing, fault } = &mut fields;
    for (name, word, hint, about) in [
        (
            "box",
            bounds,
            "x0,y0,x1,y1",
            "Show the points within a box: its least and greatest coordinates. Press Enter",
        ),
        (
            "spacing",
            spacing,
            "such as 0.5",
            "Show an even sample whose points are about this far apart. Press Enter",
        ),
    ] {
        ui.horizontal(|ui| {
            ui.label(RichText::new(name).color(theme::FAINT));
            let field = TextEdit::singleline(word).hint_text(hint).desired_width(WIDTH);
            is_left |= ui.add(field).on_hover_text(about).lost_focus();
        });
    }
    if wanted.filter.polygon.is_some() {
        ui.horizontal(|ui| {
            ui.label(RichText::new("within a polygon").color(theme::FAINT));
            if ui.small_button("clear").clicked() {
                wanted.filter.polygon = None;
            }
        });
    }
    if let Some(fault) = fault {
        ui.add(Label::new(RichText::new(fault.as_str()).small().color(theme::FAULT)).wrap());
    }
    if is_left {
        match fields.filter(&wanted.filter) {
            Ok(filter) => (wanted.filter, fields.fault) = (filter, None),
            Err(fault) => fields.fault = Some(fault),
        }
    }
    ui.data_mut(|data| data.insert_temp(id, fields));
}

/// Where the texts of the fields are kept between passes.
fn words_id() -> Id {
    Id::unique("filter words")
}

/// Shows all points again.
pub fn clear(ctx: &Context, wanted: &mut Settings) {
    wanted.filter = Filter::default();
    ctx.data_mut(|data| data.remove::<Fields>(words_id()));
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
            let tick = tick.on_hover_text(format!("{} points of this class", grouped(*points)));
            if tick.changed() {
                set_class(filter, classes, *class, is_ticked);
            }
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let only = ui.small_button("only").on_hover_text("Show this class alone");
                if only.clicked() {
                    let mut set = Classes::default();
                    set.set(*class, true);
                    filter.classes = Some(set);
                }
                ui.label(RichText::new(grouped(*points)).small().color(theme::FAINT));
            });
        });
    }
    if filter.classes.is_some() && !classes.is_empty() && ui.small_button("all classes").clicked() {
        filter.classes = None;
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
        let fields = Fields { bounds: "1,2,3,4".into(), spacing: "0.5".into(), fault: None };
        let before = Filter { classes: "2,6".parse().ok(), ..Filter::default() };
        let filter = fields.filter(&before).unwrap();
        assert!(filter.classes.unwrap().has(6) && filter.max_spacing == Some(0.5));
        assert_eq!(Fields::of(&filter), fields);
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
