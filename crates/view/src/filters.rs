//! The fields of the panel that choose the points to show: classes, a box, a spacing. A field takes
//! effect when it loses the focus; if its text is invalid, an error is shown.

use crate::settings::Settings;
use crate::theme;
use eframe::egui::{Id, Label, RichText, TextEdit, Ui};
use esker_engine::{Bounds, Classes, Filter};

/// Width of a field, points.
const WIDTH: f32 = 150.0;

/// Texts of the fields, and the error of the last one.
#[derive(Clone, Debug, Default, PartialEq)]
struct Fields {
    classes: String,
    bounds: String,
    spacing: String,
    fault: Option<String>,
}

impl Fields {
    fn of(filter: &Filter) -> Self {
        let classes = filter.classes.map(|wanted| {
            let mut runs: Vec<[u8; 2]> = Vec::new();
            for class in (0..=u8::MAX).filter(|&class| wanted.has(class)) {
                match runs.last_mut().filter(|run| run[1] + 1 == class) {
                    Some(run) => run[1] = class,
                    None => runs.push([class; 2]),
                }
            }
            let word = |[first, last]: &[u8; 2]| match last - first {
                0 => first.to_string(),
                1 => format!("{first},{last}"),
                _ => format!("{first}-{last}"),
            };
            // The name of this class stands for a flag as well.
            let overlap = wanted.has_overlap().then(|| "overlap".to_owned());
            runs.iter().map(word).chain(overlap).collect::<Vec<_>>().join(",")
        });
        let bounds = filter.bounds.map(|Bounds { min, max }| {
            let axes = if min[2].is_finite() { 3 } else { 2 };
            let numbers = min[..axes].iter().chain(&max[..axes]);
            numbers.map(f64::to_string).collect::<Vec<_>>().join(",")
        });
        Self {
            classes: classes.unwrap_or_default(),
            bounds: bounds.unwrap_or_default(),
            spacing: filter.max_spacing.map(|s| s.to_string()).unwrap_or_default(),
            fault: None,
        }
    }

    /// Parses the fields; the polygon and the flags of `before` are kept.
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
            classes: read(&self.classes, |w| w.parse::<Classes>().map_err(|e| e.to_string()))?,
            bounds: read(&self.bounds, |w| w.parse::<Bounds>().map_err(|e| e.to_string()))?,
            max_spacing: read(&self.spacing, spacing)?,
            polygon: before.polygon.clone(),
            flags: before.flags,
            without_flags: before.without_flags,
        })
    }
}

/// Shows the fields; changes the filter of `wanted` when a field loses the focus.
pub fn show(ui: &mut Ui, wanted: &mut Settings) {
    let id = Id::unique("filter words");
    let known = ui.data_mut(|data| data.get_temp::<Fields>(id));
    let mut fields = known.unwrap_or_else(|| Fields::of(&wanted.filter));
    let mut is_left = false;
    let Fields { classes, bounds, spacing, fault } = &mut fields;
    for (name, word, hint) in [
        ("classes", classes, "2,6 or ground"),
        ("box", bounds, "x0,y0,x1,y1"),
        ("spacing", spacing, "at most, such as 0.5"),
    ] {
        ui.horizontal(|ui| {
            ui.label(RichText::new(name).color(theme::FAINT));
            let field = TextEdit::singleline(word).hint_text(hint).desired_width(WIDTH);
            is_left |= ui.add(field).lost_focus();
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn fields_are_parsed_to_a_filter_and_a_filter_is_formatted_to_fields() {
        let fields = Fields {
            classes: "2,6".into(),
            bounds: "1,2,3,4".into(),
            spacing: "0.5".into(),
            fault: None,
        };
        let filter = fields.filter(&Filter::default()).unwrap();
        assert!(filter.classes.unwrap().has(6) && filter.max_spacing == Some(0.5));
        assert_eq!(Fields::of(&filter), fields);
        assert_eq!(Fields::default().filter(&filter).unwrap(), Filter::default());
        let many = Fields { classes: "0,2-4,6,7,9-255".into(), ..fields.clone() };
        assert_eq!(Fields::of(&many.filter(&filter).unwrap()), many);
        for wrong in [
            Fields { classes: "trees".into(), ..fields.clone() },
            Fields { bounds: "1,2".into(), ..fields.clone() },
            Fields { spacing: "-1".into(), ..fields.clone() },
        ] {
            assert!(wrong.filter(&filter).is_err(), "{wrong:?}");
        }
    }
}
