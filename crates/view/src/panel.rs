//! The panel beside the picture: frame times, counts of what is drawn and loaded, memory, and the
//! settings of drawing. It shows the data that it gets and returns the user's commands, but
//! performs none itself.

use crate::commands::{self, Command};
use crate::counters::Counters;
use crate::filters;
use crate::legend;
#[cfg(feature = "light")]
use crate::light;
use crate::plot;
use crate::settings::Settings;
use crate::shots::Message;
use crate::theme;
use crate::times::Times;
use crate::views_panel;
use eframe::egui::{
    Align, Align2, Area, CollapsingHeader, ComboBox, Grid, Id, Label, Layout, Order, ProgressBar,
    Rect, RichText, ScrollArea, Slider, SliderClamping, Ui, emath, vec2,
};
use esker_engine::cameras::classes::ClassCount;
use esker_engine::cameras::colour::SCANS;
use esker_engine::cameras::legend::Legend;
use esker_engine::io::quantity::{grouped, readable_bytes};
use esker_engine::light::IS_BUILT;
use esker_engine::{Dots, Method, POINT_SIZE_MAX, PointSize};
use std::ops::RangeInclusive;

/// Range of the slider of the points budget.
const POINTS: RangeInclusive<u64> = 100_000..=200_000_000;
/// Range of the slider of the target spacing, pixels.
const SPACING: RangeInclusive<f64> = 0.5..=8.0;
/// Range of the slider of drawing memory, MiB.
const MEMORY_MIB: RangeInclusive<u64> = 32..=32_768;

/// Data that the panel shows.
pub struct PanelData<'a> {
    /// Name of the file.
    pub name: &'a str,
    /// Numbers of points and nodes, in words.
    pub about: &'a str,
    /// Notes on what was left out of the file or is unusual in it.
    pub notes: &'a [String],
    /// Unit of the file's lengths, if the file names one.
    pub unit: Option<&'a str>,
    /// Whether a fault, painted over the picture, prevents new pictures.
    pub is_failed: bool,
    /// Frame times of the last seconds.
    pub times: &'a Times,
    /// Counts of the newest frame.
    pub counters: &'a Counters,
    /// Anonymous memory of this process, bytes; 0 if the system does not report it.
    pub anon_bytes: u64,
    /// Names of what draws the scene and what paints the window.
    pub backend: &'a str,
    /// Names of the colour sources that the file offers.
    pub sources: &'a [String],
    /// Whether normals tell the front of surfaces from the back.
    pub has_fronts: bool,
    /// Classes that occur.
    pub classes: &'a [ClassCount],
    /// Legend of the colours.
    pub legend: Option<&'a Legend>,
    /// Measurements by clicks.
    pub measured: &'a [String],
    /// Names and values of the point that was clicked last.
    pub picked: &'a [(String, String)],
    /// Size of the picture, pixels.
    pub picture: [u32; 2],
    /// Speed of the camera, the file's unit a second.
    pub speed: f64,
    /// Whether the speed is fixed, instead of following the distance of what is in view.
    pub has_fixed_speed: bool,
    /// Whether pictures are parallel (orthographic) ones.
    pub is_parallel: bool,
    /// Why another axis than z points upwards, if that was guessed.
    pub up_note: Option<&'a str>,
    /// Whether the cut is frozen.
    pub is_frozen: bool,
    /// Faults, the newest last.
    pub faults: &'a [String],
    /// Outcome of the last picture: where it was written, or why not.
    pub message: Option<&'a Message>,
}

/// Shows the panel, as wide as the available space whatever its content. Changes `wanted` and
/// `is_coarser_moving` as the user does, and returns the commands that were given.
pub fn show(
    ui: &mut Ui,
    data: &PanelData<'_>,
    wanted: &mut Settings,
    is_coarser_moving: &mut bool,
) -> Vec<Command> {
    let mut given = Vec::new();
    ui.set_width(ui.available_width());
    ui.horizontal(|ui| {
        ui.add(Label::new(RichText::new(data.name).heading().strong()).truncate());
    });
    ui.add(Label::new(RichText::new(data.about).color(theme::FAINT)).wrap());
    for note in data.notes {
        ui.add(Label::new(RichText::new(note).small().color(theme::ACCENT)).wrap());
    }
    ui.add_space(4.0);
    // Buttons and faults are above the part that scrolls, so that they are visible in windows of
    // any height.
    buttons(ui, data, &mut given);
    messages(ui, data);
    for line in data.measured {
        ui.add(Label::new(RichText::new(line).monospace().size(11.0).color(theme::ACCENT)).wrap());
    }
    picked(ui, data.picked);
    ui.add_space(4.0);
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        plot::show(ui, data.times);
        counters(ui, data, wanted);
        section(ui, "View");
        views_panel::show(ui, wanted, data.is_parallel, data.up_note, &mut given);
        section(ui, "Drawing");
        drawing(ui, data, wanted, is_coarser_moving);
        #[cfg(feature = "light")]
        if wanted.method == Method::Lit {
            section(ui, "Light");
            light::show(ui, wanted, data.counters.lit.as_ref());
        }
        section(ui, "Budgets");
        budgets(ui, wanted);
    });
    given
}

fn section(ui: &mut Ui, name: &str) {
    ui.add_space(8.0);
    ui.label(RichText::new(name).strong().color(theme::ACCENT));
}

fn counters(ui: &mut Ui, data: &PanelData<'_>, settings: &Settings) {
    let (counters, status) = (data.counters, &data.counters.status);
    ui.add_space(4.0);
    let [width, height] = data.picture;
    let loading = status.requests_waiting + status.requests_in_flight;
    let state = match (data.is_failed, counters.settled, loading) {
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
        let unit = data.unit.map_or(String::new(), |unit| format!(" {unit}"));
        row(ui, "speed", &format!("{}{unit} a second", length(data.speed)));
    });
    ui.add_space(4.0);
    match counters.gpu_bytes {
        Some(gpu) => budget_bar(ui, "GPU memory", gpu.bytes, settings.budget_gpu_bytes),
        None => {
            budget_bar(ui, "drawing memory", status.drawing_bytes, settings.budget_gpu_bytes);
        }
    }
    if data.anon_bytes > 0 {
        let budget = settings.budget_ram_bytes + settings.budget_gpu_bytes;
        budget_bar(ui, "main memory", data.anon_bytes, budget);
    }
}

/// Formats a length in the file's unit, with few digits.
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

fn drawing(ui: &mut Ui, data: &PanelData<'_>, wanted: &mut Settings, is_coarser_moving: &mut bool) {
    ui.horizontal(|ui| {
        let methods = [
            (Method::Auto, "Auto"),
            (Method::PullPush, "Surfaces"),
            (Method::Ewa, "Splats"),
            (Method::Points, "Points"),
            (Method::Lit, "Lit"),
        ];
        for (method, name) in methods.into_iter().filter(|m| IS_BUILT || m.0 != Method::Lit) {
            ui.selectable_value(&mut wanted.method, method, name);
        }
    });
    ui.horizontal(|ui| {
        let shown = wanted.colour_by.as_deref().unwrap_or("automatic").to_owned();
        ui.label(RichText::new("colours").color(theme::FAINT));
        ComboBox::from_id_salt("colours").selected_text(shown).width(150.0).show_ui(ui, |ui| {
            ui.selectable_value(&mut wanted.colour_by, None, "automatic");
            for source in data.sources {
                let value = Some(source.clone());
                ui.selectable_value(&mut wanted.colour_by, value, source);
            }
        });
    });
    if let Some(legend) = data.legend {
        legend::show(ui, legend, data.unit);
    }
    filters::show(ui, wanted, data.classes);
    if wanted.method == Method::Points {
        dots(ui, &mut wanted.dots);
    }
    ui.checkbox(&mut wanted.shines, "highlights");
    if wanted.evens_exposure || data.sources.iter().any(|s| SCANS.contains(&s.as_str())) {
        ui.checkbox(&mut wanted.evens_exposure, "even out exposures");
    }
    if data.has_fronts {
        ui.checkbox(&mut wanted.culls_back, "hide backs");
    }
    ui.checkbox(&mut wanted.occlusion, "skip hidden points");
    ui.checkbox(is_coarser_moving, "coarser while moving");
}

/// How points look that are drawn alone.
fn dots(ui: &mut Ui, wanted: &mut Dots) {
    let mut is_adaptive = wanted.size == PointSize::Adaptive;
    ui.checkbox(&mut is_adaptive, "points as wide as they are apart");
    wanted.size = match wanted.size {
        _ if is_adaptive => PointSize::Adaptive,
        PointSize::Adaptive => PointSize::default(),
        PointSize::Pixels(mut pixels) => {
            ui.label(RichText::new("size of points, pixels").color(theme::FAINT));
            ui.add(slider(&mut pixels, 1.0..=POINT_SIZE_MAX).fixed_decimals(1));
            PointSize::Pixels(pixels)
        }
    };
    let mut is_domed = wanted.eye_dome > 0.0;
    if ui.checkbox(&mut is_domed, "eye-dome lighting").changed() {
        wanted.eye_dome = if is_domed { 1.0 } else { 0.0 };
    }
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

/// Makes a slider. A value beyond its ends, from the command line, stays until the user changes it.
fn slider<N: emath::Numeric>(value: &mut N, range: RangeInclusive<N>) -> Slider<'_> {
    Slider::new(value, range).logarithmic(true).clamping(SliderClamping::Edits)
}

/// Formats a number of points in millions; exactly if it is below the range of the slider.
fn millions(n: f64) -> String {
    if n < *POINTS.start() as f64 { format!("{} M", n / 1e6) } else { format!("{:.1} M", n / 1e6) }
}

fn buttons(ui: &mut Ui, data: &PanelData<'_>, given: &mut Vec<Command>) {
    let buttons = [
        (Command::Fit, false),
        (Command::Picture, false),
        (Command::FixSpeed, data.has_fixed_speed),
        (Command::Freeze, data.is_frozen),
        (Command::Keys, false),
        (Command::Panel, true),
    ];
    ui.horizontal_wrapped(|ui| {
        for (command, is_on) in buttons {
            if commands::button(ui, command, is_on).clicked() {
                given.push(command);
            }
        }
    });
}

/// The tab at the border of the picture that brings a hidden panel back.
pub fn tab(ui: &Ui, rect: Rect, given: &mut Vec<Command>) {
    let area = Area::new(Id::unique("panel tab")).order(Order::Middle);
    let corner = rect.right_top() + vec2(-8.0, 8.0);
    area.fixed_pos(corner).pivot(Align2::RIGHT_TOP).show(ui.ctx(), |ui| {
        if commands::button(ui, Command::Panel, false).clicked() {
            given.push(Command::Panel);
        }
    });
}

/// What the file has of the point that was clicked last.
fn picked(ui: &mut Ui, rows: &[(String, String)]) {
    if rows.is_empty() {
        return;
    }
    CollapsingHeader::new("Point").default_open(true).show(ui, |ui| {
        Grid::new("picked").num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
            for (name, value) in rows {
                ui.label(RichText::new(name).small().color(theme::FAINT));
                ui.add(Label::new(RichText::new(value).monospace().size(11.0)).truncate());
                ui.end_row();
            }
        });
    });
}

fn messages(ui: &mut Ui, data: &PanelData<'_>) {
    ui.add(Label::new(RichText::new(data.backend).small().color(theme::FAINT)).wrap());
    if let Some(message) = data.message {
        let (text, ink) = match message {
            Ok(text) => (text, theme::COOL),
            Err(text) => (text, theme::FAULT),
        };
        ui.add(Label::new(RichText::new(text).small().color(ink)).wrap());
    }
    for fault in data.faults {
        ui.add(Label::new(RichText::new(fault).color(theme::FAULT)).wrap());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Context, RawInput};

    #[test]
    fn values_of_the_command_line_stay_as_they_are() {
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
    fn budgets_of_few_points_are_shown_exactly() {
        assert_eq!(millions(20_000_000.0), "20.0 M");
        assert_eq!(millions(99_429.0), "0.099429 M");
        assert_eq!(millions(1.0), "0.000001 M");
    }
}
