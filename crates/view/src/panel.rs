//! The panel beside the picture: how long frames take, what is drawn and loaded, what it may cost,
//! how it is drawn. Shows what it is given and says what the user asks for; does nothing itself.

use crate::counters::Counters;
use crate::filters;
use crate::legend;
use crate::plot;
use crate::settings::Settings;
use crate::shots::Said;
use crate::theme;
use crate::times::Times;
use eframe::egui::{
    Align, Button, CollapsingHeader, ComboBox, Grid, Label, Layout, ProgressBar, RichText,
    ScrollArea, Slider, SliderClamping, Ui, emath,
};
use esker_engine::Method;
use esker_engine::cameras::colour::SCANS;
use esker_engine::cameras::legend::Legend;
use esker_engine::io::quantity::{grouped, readable_bytes};
use std::ops::RangeInclusive;

/// Points budgets that the slider offers.
const POINTS: RangeInclusive<u64> = 100_000..=200_000_000;
/// Target spacings, pixels.
const SPACING: RangeInclusive<f64> = 0.5..=8.0;
/// Drawing memory, MiB.
const MEMORY_MIB: RangeInclusive<u64> = 32..=32_768;

/// What the panel shows.
pub struct Facts<'a> {
    /// The file's name.
    pub name: &'a str,
    /// What else there is to say of it.
    pub about: &'a str,
    /// What reading it has left out or found odd.
    pub notes: &'a [String],
    /// The unit of its lengths, where it tells one.
    pub unit: Option<&'a str>,
    /// Whether there is no new picture, for a reason that stands over it.
    pub is_failed: bool,
    /// The frames of the last seconds.
    pub times: &'a Times,
    /// Counts.
    pub counters: &'a Counters,
    /// Bytes of main memory that are this process's own; 0 where the system does not tell.
    pub anon_bytes: u64,
    /// What draws, and on which adapter.
    pub backend: &'a str,
    /// Where colours can come from.
    pub sources: &'a [String],
    /// What the colours mean.
    pub legend: Option<&'a Legend>,
    /// What was measured by clicks.
    pub measured: &'a [String],
    /// Size of the picture, pixels.
    pub picture: [u32; 2],
    /// Speed of the camera in the file's unit a second.
    pub speed: f64,
    /// Whether the cut is frozen.
    pub is_frozen: bool,
    /// What went wrong, newest last.
    pub faults: &'a [String],
    /// What was done, such as where a screenshot lies, or could not be.
    pub said: Option<&'a Said>,
}

/// What the user asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Asked {
    /// To freeze the cut, or to let it go.
    pub freeze: bool,
    /// To write a picture.
    pub screenshot: bool,
    /// To go where the camera stood first.
    pub home: bool,
    /// To hide the panel.
    pub hide: bool,
    /// To forget what was measured.
    pub forget: bool,
}

impl Asked {
    /// What is asked for by either.
    pub fn add(&mut self, other: Self) {
        self.freeze |= other.freeze;
        self.screenshot |= other.screenshot;
        self.home |= other.home;
        self.hide |= other.hide;
        self.forget |= other.forget;
    }
}

/// Shows the panel, as wide as there is room, whatever stands in it; changes `wanted` and
/// `is_coarser_moving` as the user does.
pub fn show(
    ui: &mut Ui,
    facts: &Facts<'_>,
    wanted: &mut Settings,
    is_coarser_moving: &mut bool,
) -> Asked {
    let mut asked = Asked::default();
    ui.set_width(ui.available_width());
    ui.horizontal(|ui| {
        ui.add(Label::new(RichText::new(facts.name).heading().strong()).truncate());
    });
    ui.add(Label::new(RichText::new(facts.about).color(theme::FAINT)).wrap());
    for note in facts.notes {
        ui.add(Label::new(RichText::new(note).small().color(theme::ACCENT)).wrap());
    }
    ui.add_space(4.0);
    // What is asked for and what goes wrong are seen in windows of any height.
    actions(ui, facts, &mut asked);
    messages(ui, facts);
    for line in facts.measured {
        ui.add(Label::new(RichText::new(line).monospace().size(11.0).color(theme::ACCENT)).wrap());
    }
    ui.add_space(4.0);
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        plot::show(ui, facts.times);
        counters(ui, facts, wanted);
        section(ui, "Drawing");
        drawing(ui, facts, wanted, is_coarser_moving);
        section(ui, "Budgets");
        budgets(ui, wanted);
        help(ui);
    });
    asked
}

fn section(ui: &mut Ui, name: &str) {
    ui.add_space(8.0);
    ui.label(RichText::new(name).strong().color(theme::ACCENT));
}

fn counters(ui: &mut Ui, facts: &Facts<'_>, settings: &Settings) {
    let (counters, status) = (facts.counters, &facts.counters.status);
    ui.add_space(4.0);
    let [width, height] = facts.picture;
    let loading = status.requests_waiting + status.requests_in_flight;
    let state = match (facts.is_failed, counters.settled, loading) {
        (true, ..) => "stopped".to_owned(),
        (_, true, _) => "complete".to_owned(),
        (_, _, 0) => "choosing".to_owned(),
        (_, _, n) => format!("{n} requests"),
    };
    Grid::new("counters").num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
        row(ui, "points", &grouped(counters.points));
        row(ui, "nodes drawn", &grouped(counters.nodes));
        row(ui, "hidden", &grouped(counters.occluded));
        row(ui, "resident", &grouped(status.nodes_resident as u64));
        row(ui, "loading", &state);
        let rate = format!(
            "{}/s, {:.0} reads/s",
            readable_bytes(counters.read_rate as u64),
            counters.reads_rate
        );
        row(ui, "read", &rate);
        row(ui, "choose, draw", &format!("{:.1}, {:.1} ms", counters.lod_ms, counters.draw_ms));
        row(ui, "picture", &format!("{width} x {height}"));
        let unit = facts.unit.map_or(String::new(), |unit| format!(" {unit}"));
        row(ui, "speed", &format!("{}{unit} a second", length(facts.speed)));
    });
    ui.add_space(4.0);
    match counters.gpu_bytes {
        Some(gpu) => budget_bar(ui, "GPU memory", gpu.bytes, settings.budget_gpu_bytes),
        None => {
            budget_bar(ui, "drawing memory", status.drawing_bytes, settings.budget_gpu_bytes);
        }
    }
    if facts.anon_bytes > 0 {
        let budget = settings.budget_ram_bytes + settings.budget_gpu_bytes;
        budget_bar(ui, "main memory", facts.anon_bytes, budget);
    }
}

/// A length in the file's unit, short.
fn length(value: f64) -> String {
    match value.abs() {
        v if v >= 100.0 => format!("{value:.0}"),
        v if v >= 1.0 => format!("{value:.1}"),
        _ => format!("{value:.3}"),
    }
}

fn row(ui: &mut Ui, name: &str, value: &str) {
    ui.label(RichText::new(name).color(theme::FAINT));
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        ui.label(RichText::new(value).monospace());
    });
    ui.end_row();
}

fn budget_bar(ui: &mut Ui, name: &str, bytes: u64, budget: u64) {
    let share = bytes as f32 / budget.max(1) as f32;
    let text = format!("{name}  {} of {}", readable_bytes(bytes), readable_bytes(budget));
    let fill = if share > 1.0 { theme::FAULT } else { theme::COOL.gamma_multiply(0.55) };
    let bar = ProgressBar::new(share.min(1.0)).fill(fill).corner_radius(3.0).desired_height(17.0);
    ui.add(bar.text(RichText::new(text).size(11.0)));
}

fn drawing(ui: &mut Ui, facts: &Facts<'_>, wanted: &mut Settings, is_coarser_moving: &mut bool) {
    ui.horizontal(|ui| {
        let methods =
            [(Method::PullPush, "Surfaces"), (Method::Ewa, "Splats"), (Method::Points, "Points")];
        for (method, name) in methods {
            ui.selectable_value(&mut wanted.method, method, name);
        }
    });
    ui.horizontal(|ui| {
        let shown = wanted.colour_by.as_deref().unwrap_or("best there is").to_owned();
        ui.label(RichText::new("colours").color(theme::FAINT));
        ComboBox::from_id_salt("colours").selected_text(shown).width(150.0).show_ui(ui, |ui| {
            ui.selectable_value(&mut wanted.colour_by, None, "best there is");
            for source in facts.sources {
                let value = Some(source.clone());
                ui.selectable_value(&mut wanted.colour_by, value, source);
            }
        });
    });
    if let Some(legend) = facts.legend {
        legend::show(ui, legend, facts.unit);
    }
    filters::show(ui, wanted);
    ui.checkbox(&mut wanted.shines, "highlights");
    if wanted.evens_exposure || facts.sources.iter().any(|s| SCANS.contains(&s.as_str())) {
        ui.checkbox(&mut wanted.evens_exposure, "even out exposures");
    }
    ui.checkbox(&mut wanted.occlusion, "leave out what is hidden");
    ui.checkbox(is_coarser_moving, "coarser while moving");
}

fn budgets(ui: &mut Ui, wanted: &mut Settings) {
    let points = slider(&mut wanted.points_budget, POINTS)
        .custom_formatter(|n, _| millions(n))
        .custom_parser(|text| {
            text.trim().trim_end_matches(['M', ' ']).parse::<f64>().ok().map(|n| n * 1e6)
        });
    ui.label(RichText::new("points at most").color(theme::FAINT));
    ui.add(points);
    ui.label(RichText::new("distance of points, pixels").color(theme::FAINT));
    ui.add(slider(&mut wanted.target_spacing_px, SPACING).fixed_decimals(2));
    let mut mib = wanted.budget_gpu_bytes >> 20;
    ui.label(RichText::new("drawing memory, MiB").color(theme::FAINT));
    if ui.add(slider(&mut mib, MEMORY_MIB)).changed() {
        wanted.budget_gpu_bytes = mib << 20;
    }
}

/// A slider. A value beyond its ends, from the command line, stays until the user changes it.
fn slider<N: emath::Numeric>(value: &mut N, range: RangeInclusive<N>) -> Slider<'_> {
    Slider::new(value, range).logarithmic(true).clamping(SliderClamping::Edits)
}

/// Millions, exactly where they are less than the slider offers.
fn millions(n: f64) -> String {
    if n < *POINTS.start() as f64 { format!("{} M", n / 1e6) } else { format!("{:.1} M", n / 1e6) }
}

fn actions(ui: &mut Ui, facts: &Facts<'_>, asked: &mut Asked) {
    ui.horizontal_wrapped(|ui| {
        let freeze = Button::selectable(facts.is_frozen, "Freeze");
        asked.freeze = ui
            .add(freeze)
            .on_hover_text("Space: keep the cut, and look at it from outside")
            .clicked();
        asked.screenshot = ui.button("Screenshot").on_hover_text("P").clicked();
        asked.home = ui.button("Home").on_hover_text("F").clicked();
        asked.hide = ui.button("Hide").on_hover_text("Tab").clicked();
    });
}

fn messages(ui: &mut Ui, facts: &Facts<'_>) {
    ui.add(Label::new(RichText::new(facts.backend).small().color(theme::FAINT)).wrap());
    if let Some(said) = facts.said {
        let (text, ink) = match said {
            Ok(text) => (text, theme::COOL),
            Err(text) => (text, theme::FAULT),
        };
        ui.add(Label::new(RichText::new(text).small().color(ink)).wrap());
    }
    for fault in facts.faults {
        ui.add(Label::new(RichText::new(fault).color(theme::FAULT)).wrap());
    }
}

/// Keys and buttons, and what they do.
pub const HELP: [(&str, &str); 13] = [
    ("W A S D", "fly"),
    ("E  Q", "up, down"),
    ("Shift  Alt", "faster, slower"),
    ("left button", "orbit around the point"),
    ("right button", "look around"),
    ("middle, Shift+left", "move sideways"),
    ("wheel", "zoom to the pointer"),
    ("wheel while flying", "change the speed"),
    ("click, twice  Esc", "coordinates, distance, none"),
    ("double click", "fly there"),
    ("F  Home", "back to the start"),
    ("M  C  O", "method, colours, hiding"),
    ("Space  P  Tab", "freeze, picture, panel"),
];

fn help(ui: &mut Ui) {
    ui.add_space(4.0);
    CollapsingHeader::new(RichText::new("Keys").color(theme::FAINT)).show(ui, |ui| {
        Grid::new("keys").num_columns(2).spacing([12.0, 2.0]).show(ui, |ui| {
            for (key, what) in HELP {
                ui.label(RichText::new(key).monospace().size(11.0));
                ui.label(RichText::new(what).color(theme::FAINT));
                ui.end_row();
            }
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Context, RawInput};

    #[test]
    fn what_the_command_line_says_stays_as_it_is() {
        for (points_budget, target_spacing_px, budget_gpu_bytes) in
            [(1, 0.0, 1), (99_429, 0.123_456, 33_554_433), (u64::MAX, 1e9, u64::MAX)]
        {
            let said = Settings {
                points_budget,
                target_spacing_px,
                budget_gpu_bytes,
                ..Settings::default()
            };
            let mut wanted = said.clone();
            let ctx = Context::default();
            for _ in 0..3 {
                let _ = ctx.run_ui(RawInput::default(), |ui| budgets(ui, &mut wanted));
            }
            assert_eq!(wanted, said);
        }
    }

    #[test]
    fn budgets_of_few_points_are_told_in_full() {
        assert_eq!(millions(20_000_000.0), "20.0 M");
        assert_eq!(millions(99_429.0), "0.099429 M");
        assert_eq!(millions(1.0), "0.000001 M");
    }
}
