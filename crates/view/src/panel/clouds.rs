//! The tab of what is open: the scans with their numbers of points, the extent, the coordinate
//! system, and notes on what is unusual.

use super::data::PanelData;
use super::names;
use super::widgets::{label, note, row, section, tick};
use crate::clouds::Cloud;
use crate::commands::{self, Command};
use crate::theme;
use eframe::egui::{Align, Grid, Label, Layout, RichText, Ui};
use esker_engine::io::quantity::grouped;

/// Most scans that are listed.
const LISTED: usize = 200;

/// Shows the tab; changes `hidden`, the clouds that are not shown, when one is ticked.
pub fn show(ui: &mut Ui, data: &PanelData<'_>, hidden: &mut Vec<usize>, given: &mut Vec<Command>) {
    ui.add(Label::new(data.about).wrap());
    if data.is_built && commands::button(ui, Command::Keep, false).clicked() {
        given.push(Command::Keep);
    }
    if data.together.len() > 1 {
        section(ui, "Shown");
        for (i, name) in data.together.iter().enumerate().take(LISTED) {
            let mut is_shown = !hidden.contains(&i);
            if tick(ui, &mut is_shown, name, "Show the points of this file").changed() {
                hidden.retain(|&other| other != i);
                if !is_shown {
                    hidden.push(i);
                    hidden.sort_unstable();
                }
            }
        }
    }
    section(ui, "Extent");
    match data.extent {
        None => drop(label(ui, "there are no points")),
        Some(extent) => {
            Grid::new("extent").num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
                for (axis, [low, high]) in ["x", "y", "z"].into_iter().zip(extent) {
                    let unit = data.unit.filter(|_| !data.has_degrees);
                    let about = format!("From {low} to {high} in the scan's coordinates");
                    row(ui, axis, &names::length(high - low, unit), &about);
                }
            });
        }
    }
    section(ui, "Coordinate system");
    note(ui, data.crs.unwrap_or("the scans name none"));
    let unit = match data.unit {
        Some(unit) => format!("lengths are in {}", names::plural(unit)),
        None => "the scans name no unit of length".to_owned(),
    };
    note(ui, &unit);
    section(ui, "Scans");
    for cloud in data.clouds.iter().take(LISTED) {
        scan(ui, cloud);
    }
    if data.clouds.len() > LISTED {
        note(ui, &format!("and {} more", grouped((data.clouds.len() - LISTED) as u64)));
    }
    if !data.notes.is_empty() {
        section(ui, "Notes");
        for line in data.notes {
            let text = RichText::new(line).small().color(theme::inks(ui).accent);
            ui.add(Label::new(text).wrap());
        }
    }
}

/// A line for a scan: its name, which may be cut, and its points.
fn scan(ui: &mut Ui, Cloud { name, path, format, points }: &Cloud) {
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.label(RichText::new(grouped(*points)).monospace()).on_hover_text("Points");
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let name = ui.add(Label::new(name).truncate());
                name.on_hover_text(format!("{path} ({format})"));
            });
        });
    });
}
