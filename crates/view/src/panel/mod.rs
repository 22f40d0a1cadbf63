//! The panel beside the picture. Buttons stand above, messages and measurements at its foot;
//! between them are four tabs: how the points are drawn (*View*), which ones (*Filter*), what is
//! open (*Clouds*) and what the engine does (*Engine*). The panel shows the data that it gets and
//! returns the user's commands, but performs none itself.

mod clips;
mod clouds;
mod counted;
pub mod data;
mod engine;
mod filter;
mod histogram;
mod legend;
#[cfg(feature = "light")]
pub mod light;
pub mod names;
mod numbers;
mod plot;
mod ranges;
mod sides;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests;
mod view;
mod widgets;

use crate::commands::{self, Command};
use crate::settings::Settings;
use crate::theme;
use crate::tools::ToolName;
use counted::Counted;
use data::PanelData;
use eframe::egui::{
    Align, Align2, Area, Button, CollapsingHeader, Frame, Grid, Id, Label, Layout, Order, Panel,
    Rect, RichText, ScrollArea, Ui, vec2,
};
use esker_engine::cameras::legend::Legend;

/// Most height of the values of a picked point, points.
const PICKED_HEIGHT: f32 = 132.0;

/// What the panel keeps between passes.
#[derive(Debug, Default)]
pub struct PanelState {
    tab: Tab,
    ranges: ranges::Rows,
    counted: Counted,
    /// Legend of the last picture: it stays while a session is opened, so that nothing below it
    /// moves.
    legend: Option<Legend>,
}

/// A tab of the panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Tab {
    #[default]
    View,
    Filter,
    Clouds,
    Engine,
}

/// The tabs, their names, and what they have.
const TABS: [(Tab, &str, &str); 4] = [
    (Tab::View, "View", "How the points are drawn: method, colours, light"),
    (Tab::Filter, "Filter", "Which points are drawn: classes, flags, values, box, clips"),
    (Tab::Clouds, "Clouds", "What is open: scans, points, extent, coordinate system"),
    (Tab::Engine, "Engine", "What the engine does: frame times, memory, budgets"),
];

impl PanelState {
    /// Forgets what belongs to a file that is closed; the tab stays.
    pub fn close_file(&mut self) {
        *self = Self { tab: self.tab, ..Self::default() };
    }
}

/// Shows the panel, as wide as the available space whatever its content. Changes `wanted` and
/// `is_coarser_moving` as the user does, and returns the commands that were given.
pub fn show(
    ui: &mut Ui,
    data: &PanelData<'_>,
    state: &mut PanelState,
    wanted: &mut Settings,
    is_coarser_moving: &mut bool,
) -> Vec<Command> {
    let mut given = Vec::new();
    ui.set_width(ui.available_width());
    if let Some(legend) = data.legend {
        state.legend = Some(legend.clone());
    }
    heading(ui, data, &mut given);
    // Buttons are above the part that scrolls, messages and what was picked below it, so that they
    // are visible in windows of any height, and no control moves when they come.
    buttons(ui, data, &mut given);
    let below = Panel::bottom("below").frame(Frame::NONE).resizable(false);
    below.show_separator_line(false).show(ui, |ui| {
        ui.add_space(4.0);
        messages(ui, data);
        measured(ui, data);
    });
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        for (tab, name, about) in TABS {
            let button = Button::selectable(state.tab == tab, name).frame(true);
            if ui.add(button).on_hover_text(about).clicked() {
                state.tab = tab;
            }
        }
    });
    ui.separator();
    // Each tab keeps its own place.
    let scroll = ScrollArea::vertical().id_salt(state.tab as u8).auto_shrink([false, false]);
    scroll.show(ui, |ui| match state.tab {
        Tab::View => {
            let shown = view::Shown { legend: state.legend.as_ref(), counted: &mut state.counted };
            view::show(ui, data, shown, wanted, is_coarser_moving, &mut given);
        }
        Tab::Filter => filter::show(ui, &mut state.ranges, data, &mut wanted.filter),
        Tab::Clouds => clouds::show(ui, data, &mut wanted.hidden_clouds, &mut given),
        Tab::Engine => engine::show(ui, data, wanted, &mut given),
    });
    given
}

/// The name of the file, and the buttons that every window has at its corner.
fn heading(ui: &mut Ui, data: &PanelData<'_>, given: &mut Vec<Command>) {
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            for (command, is_on) in [(Command::Panel, true), (Command::Keys, false)] {
                if commands::button(ui, command, is_on).clicked() {
                    given.push(command);
                }
            }
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let name = RichText::new(data.name).heading().strong();
                ui.add(Label::new(name).truncate()).on_hover_text(data.about);
            });
        });
    });
}

fn buttons(ui: &mut Ui, data: &PanelData<'_>, given: &mut Vec<Command>) {
    let buttons = [
        (Command::Tool(ToolName::Navigate), data.tool == ToolName::Navigate),
        (Command::Tool(ToolName::Pick), data.tool == ToolName::Pick),
        (Command::Fit, false),
        (Command::Picture, false),
        (Command::Open, false),
        (Command::SaveScene, false),
        (Command::FixSpeed, data.has_fixed_speed),
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

fn messages(ui: &mut Ui, data: &PanelData<'_>) {
    let inks = theme::inks(ui);
    if let Some(message) = data.message {
        let (text, ink) = match message {
            Ok(text) => (text, inks.cool),
            Err(text) => (text, inks.fault),
        };
        ui.add(Label::new(RichText::new(text).small().color(ink)).wrap());
    }
    for fault in data.faults {
        ui.add(Label::new(RichText::new(fault).color(inks.fault)).wrap());
    }
}

/// Measured points and distances, and what the file has of the point that was clicked last.
fn measured(ui: &mut Ui, data: &PanelData<'_>) {
    for line in data.measured {
        let text = RichText::new(line).monospace().size(10.5).color(theme::inks(ui).accent);
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
                let copy = ui.small_button("copy").on_hover_text("Copy this line (Ctrl+C: all)");
                if copy.clicked() {
                    ui.ctx().copy_text(line.clone());
                }
                ui.with_layout(Layout::left_to_right(Align::Min), |ui| {
                    ui.add(Label::new(text).wrap());
                });
            });
        });
    }
    if data.picked.is_empty() {
        return;
    }
    let point = CollapsingHeader::new("Point").default_open(true).show(ui, |ui| {
        // Above it the tabs must stay in view.
        let height = PICKED_HEIGHT.min(ui.ctx().content_rect().height() / 4.0);
        let scroll = ScrollArea::vertical().id_salt("picked").max_height(height);
        scroll.min_scrolled_height(height).show(ui, |ui| picked(ui, data.picked));
    });
    point.header_response.on_hover_text("What the file has of the point that was clicked last");
}

fn picked(ui: &mut Ui, rows: &[(String, String)]) {
    Grid::new("picked").num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(RichText::new(names::source(name)).small().color(theme::inks(ui).faint));
            ui.add(Label::new(RichText::new(value).monospace().size(11.0)).truncate());
            ui.end_row();
        }
    });
}
