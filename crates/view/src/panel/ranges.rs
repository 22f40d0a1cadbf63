//! The part of the tab of filters that chooses points by values: a row for each range, with a
//! histogram whose handles move its ends, and the choice of another attribute.

use super::counted::Counted;
use super::data::PanelData;
use super::widgets::{label, note, section};
use super::{histogram, names};
use crate::theme;
use eframe::egui::{Align, ComboBox, Layout, RichText, Ui};
use esker_engine::cameras::histogram::Histogram;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::{Bound, Filter, ValueRange};

/// Attributes that are no sources of colours by themselves.
const COLOURS: [&str; 3] = ["red", "green", "blue"];

/// Histograms of the attributes that have or had a row, by their names: dropping one would wait for
/// the thread that counts.
#[derive(Debug, Default)]
pub struct Rows {
    counted: Vec<(String, Counted)>,
}

impl Rows {
    /// Whether threads count.
    #[cfg(test)]
    pub fn are_counting(&self) -> bool {
        self.counted.iter().any(|(_, counted)| counted.is_counting())
    }

    fn counted(&mut self, name: &str) -> &mut Counted {
        let at = self.counted.iter().position(|(own, _)| own == name).unwrap_or_else(|| {
            self.counted.push((name.to_owned(), Counted::of_values()));
            self.counted.len() - 1
        });
        &mut self.counted[at].1
    }
}

/// Shows the rows; changes the ranges of `filter` as the user moves their ends, adds or removes
/// one.
pub fn show(ui: &mut Ui, rows: &mut Rows, data: &PanelData<'_>, filter: &mut Filter) {
    let offered = offered(data, filter);
    if filter.values.is_empty() && offered.is_empty() {
        return;
    }
    section(ui, "Values");
    let mut removed = None;
    for (i, range) in filter.values.iter_mut().enumerate() {
        ui.push_id(i, |ui| {
            if row(ui, rows.counted(&range.name), data, range) {
                removed = Some(i);
            }
        });
    }
    if let Some(i) = removed {
        filter.values.remove(i);
    }
    if let Some(name) = choice(ui, &offered) {
        filter.values.push(ValueRange { name, ends: [None; 2] });
    }
}

/// Names of the attributes that have no row. Classes have a list of their own.
fn offered(data: &PanelData<'_>, filter: &Filter) -> Vec<String> {
    let all = data.file.schema().names().into_iter().filter(|name| *name != "classification");
    let has = |name: &str| data.sources.iter().any(|source| source == name);
    let has = |name: &str| has(name) || COLOURS.contains(&name) && has("rgb");
    let shown = all.filter(|name| has(name));
    let rest = shown.filter(|name| filter.values.iter().all(|range| range.name != *name));
    rest.map(str::to_owned).collect()
}

/// The attributes to add. Returns one that is chosen.
fn choice(ui: &mut Ui, offered: &[String]) -> Option<String> {
    if offered.is_empty() {
        return None;
    }
    let mut chosen = None;
    let name = label(ui, "by value");
    let choice = ComboBox::from_id_salt("values").selected_text("add filter");
    let choice = choice.width(ui.available_width()).show_ui(ui, |ui| {
        for (name, words) in offered.iter().zip(names::sources(offered)) {
            if ui.selectable_label(false, words).clicked() {
                chosen = Some(name.clone());
            }
        }
    });
    let choice = choice.response.labelled_by(name.id);
    choice.on_hover_text("Show the points with values of an attribute within a range");
    chosen
}

/// A range of an attribute. Returns whether it is to be removed.
fn row(ui: &mut Ui, counted: &mut Counted, data: &PanelData<'_>, range: &mut ValueRange) -> bool {
    let words = names::source(&range.name);
    let mut is_removed = false;
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let remove = ui.small_button("remove");
            is_removed = remove.on_hover_text(format!("Do not filter by {words}")).clicked();
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                label(ui, &words);
            });
        });
    });
    let name = range.name.clone();
    let wants = (data.file, name.as_str(), Vertical::default());
    if counted.get(ui.ctx(), wants).is_none() && counted.is_counting() {
        note(ui, "The values are being counted.");
    }
    match counted.get(ui.ctx(), wants) {
        Some(histogram) => {
            let before = range.ends;
            let mut shown = shown_ends(range, histogram);
            let cool = theme::inks(ui).cool;
            let colours = [[cool.r(), cool.g(), cool.b()]];
            if histogram::show(ui, (&words, None), histogram, &colours, &mut shown) {
                range.ends = ends(before, shown, histogram);
            }
        }
        None => {
            ui.label(RichText::new(range.to_string()).monospace().size(11.0));
        }
    }
    is_removed
}

/// Ends as the histogram shows them: open ones at its ends.
fn shown_ends(range: &ValueRange, histogram: &Histogram) -> [f64; 2] {
    [0, 1].map(|end| range.ends[end].map_or(histogram.range[end], Bound::to_f64))
}

/// The ends that are meant by those that the user moved to `shown`. Ends at those of the histogram
/// are open, so that values beyond it are kept; ends that were not moved stay exact.
fn ends(before: [Option<Bound>; 2], shown: [f64; 2], histogram: &Histogram) -> [Option<Bound>; 2] {
    [0, 1].map(|end| {
        let was = before[end].map_or(histogram.range[end], Bound::to_f64);
        let value = shown[end];
        let is_open = match end {
            0 => value <= histogram.range[0],
            _ => value >= histogram.range[1],
        };
        match value {
            _ if value == was => before[end],
            _ if is_open => None,
            _ if histogram.is_whole => Bound::new(value.round()),
            _ => Bound::new(value),
        }
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn moved_ends_are_whole_or_open_and_others_stay_exact() {
        let mut histogram =
            Histogram { range: [0.5, 5.5], counts: vec![1.0; 5], sample: None, is_whole: true };
        let range: ValueRange = "id:..9007199254740993".parse().unwrap();
        let shown = shown_ends(&range, &histogram);
        assert_eq!(shown, [0.5, 9_007_199_254_740_992.0]);
        let moved = ends(range.ends, [2.4, shown[1]], &histogram);
        assert_eq!(moved, [Some(Bound::Whole(2)), range.ends[1]]);
        assert_eq!(ends(moved, [0.5, 5.5], &histogram), [None, None]);
        histogram.is_whole = false;
        let moved = ends([None; 2], [0.5, 2.25], &histogram);
        assert_eq!(moved, [None, Some(Bound::Real(2.25))]);
    }
}
