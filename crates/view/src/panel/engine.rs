//! The tab of what the engine does: frame times, counts of what is drawn and loaded, memory, and
//! budgets.

use super::data::PanelData;
use super::widgets::{Scale, budget_bar, note, row, section, slide, tick};
use super::{names, plot};
use crate::commands::{self, Command};
use crate::settings::Settings;
use eframe::egui::{Grid, Ui};
use esker_engine::io::quantity::{grouped, readable_bytes};
use std::ops::RangeInclusive;

/// Range of the slider of the points budget.
const POINTS: RangeInclusive<u64> = 100_000..=200_000_000;
/// Range of the slider of the target spacing, pixels.
const SPACING: RangeInclusive<f64> = 0.5..=8.0;
/// Range of the slider of drawing memory, MiB.
const MEMORY_MIB: RangeInclusive<u64> = 32..=32_768;

/// Shows the tab.
pub fn show(ui: &mut Ui, data: &PanelData<'_>, wanted: &mut Settings, given: &mut Vec<Command>) {
    plot::show(ui, data.times);
    counters(ui, data);
    memory(ui, data, wanted);
    section(ui, "Choice of points");
    ui.horizontal(|ui| {
        if commands::button(ui, Command::Freeze, data.is_frozen).clicked() {
            given.push(Command::Freeze);
        }
        let about = "Do not draw points that lie behind others: faster, and the same picture (O)";
        tick(ui, &mut wanted.occlusion, "leave out what is hidden", about);
    });
    section(ui, "Budgets");
    budgets(ui, wanted);
    section(ui, "Drawn by");
    note(ui, data.backend);
}

fn counters(ui: &mut Ui, data: &PanelData<'_>) {
    let (counters, status) = (data.counters, &data.counters.status);
    ui.add_space(4.0);
    let [width, height] = data.picture;
    let loading = status.requests_waiting + status.requests_in_flight;
    let state = match (data.is_failed, counters.settled, loading) {
        (true, ..) => "stopped".to_owned(),
        (_, true, _) => "complete".to_owned(),
        (_, _, 0) => "choosing".to_owned(),
        (_, _, 1) => "1 request".to_owned(),
        (_, _, n) => format!("{n} requests"),
    };
    let bytes = readable_bytes(counters.read_rate as u64);
    let rate = format!("{bytes}/s, {:.0} reads/s", counters.reads_rate);
    let times = format!("{:.1}, {:.1} ms", counters.lod_ms, counters.draw_ms);
    Grid::new("counters").num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
        for (name, value, about) in [
            ("points drawn", grouped(counters.points), "Points in the newest picture"),
            ("nodes drawn", grouped(counters.nodes), "Parts of the octree in the newest picture"),
            ("nodes hidden", grouped(counters.occluded), "Parts left out, since others hide them"),
            (
                "nodes resident",
                grouped(status.nodes_resident as u64),
                "Parts that are in drawing memory",
            ),
            ("loading", state, "Whether more is read for this view"),
            ("reading", rate, "Read from the disk in the last half second"),
            ("choose, draw", times, "Time to choose the nodes of a picture, and to draw it"),
            ("picture", format!("{width} x {height}"), "Size of the picture, pixels"),
            (
                "speed",
                format!("{}/s", names::length(data.speed, data.unit)),
                "Speed of flying; the wheel changes it while a key is held",
            ),
        ] {
            row(ui, name, &value, about);
        }
    });
    ui.add_space(4.0);
}

fn memory(ui: &mut Ui, data: &PanelData<'_>, settings: &Settings) {
    let (counters, budget) = (data.counters, settings.budget_gpu_bytes);
    match counters.gpu_bytes {
        Some(gpu) => {
            budget_bar(ui, "GPU memory", gpu.bytes, budget, "All buffers on the graphics card");
        }
        None => {
            let about = "Points that are ready to be drawn";
            budget_bar(ui, "drawing memory", counters.status.drawing_bytes, budget, about);
        }
    }
    if data.anon_bytes > 0 {
        let budget = settings.budget_ram_bytes + settings.budget_gpu_bytes;
        let about = "All memory of this program, files that the system maps apart";
        budget_bar(ui, "main memory", data.anon_bytes, budget, about);
    }
}

fn budgets(ui: &mut Ui, wanted: &mut Settings) {
    let points = Scale { is_millions: true, ..Scale::logarithmic(0) };
    let about = "Most points of a picture: more is sharper and slower";
    slide(ui, ("points at most", about), &mut wanted.points_budget, POINTS, &points);
    let about = "Distance of neighbouring points that is fine enough: less is sharper and slower";
    let spacing = Scale::logarithmic(2);
    let value = &mut wanted.target_spacing_px;
    slide(ui, ("distance of points, pixels", about), value, SPACING, &spacing);
    let mut mib = wanted.budget_gpu_bytes >> 20;
    let about = "Memory for points that are drawn; on a graphics card, for all of its buffers";
    let memory = Scale::logarithmic(0);
    if slide(ui, ("drawing memory, MiB", about), &mut mib, MEMORY_MIB, &memory) {
        wanted.budget_gpu_bytes = mib << 20;
    }
    note(ui, "Main memory is set by --budget-ram when the program starts.");
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
}
