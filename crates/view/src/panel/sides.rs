//! The part of the panel that chooses where the camera looks from: the axis that points upwards,
//! views from the sides, and the projection.

use crate::commands::{self, Command};
use crate::settings::Settings;
use crate::theme;
use crate::views::Side;
use eframe::egui::{RichText, Ui};
use esker_engine::cameras::vertical::Vertical;

/// Commands of the buttons.
const SIDES: [Side; 7] =
    [Side::Top, Side::Bottom, Side::Front, Side::Back, Side::Left, Side::Right, Side::Isometric];

/// Shows the controls. Changes the axis that points upwards in `wanted`, and adds the commands that
/// were given. `note` says why that axis was guessed.
pub fn show(
    ui: &mut Ui,
    wanted: &mut Settings,
    is_parallel: bool,
    note: Option<&str>,
    given: &mut Vec<Command>,
) {
    ui.horizontal_wrapped(|ui| {
        for command in SIDES.map(Command::Look) {
            if commands::button(ui, command, false).clicked() {
                given.push(command);
            }
        }
        if commands::button(ui, Command::Parallel, is_parallel).clicked() {
            given.push(Command::Parallel);
        }
    });
    ui.horizontal(|ui| {
        ui.label(RichText::new("up").color(theme::inks(ui).faint));
        let is_down = wanted.vertical.is_down();
        for axis in 0..3 {
            let vertical = Vertical::of(axis, is_down);
            let about = format!("Turn the scan so that {vertical} points upwards");
            let name = ["x", "y", "z"][axis];
            ui.selectable_value(&mut wanted.vertical, vertical, name).on_hover_text(about);
        }
        let mut is_flipped = is_down;
        let about = "Turn the scan upside down";
        if ui.checkbox(&mut is_flipped, "flip").on_hover_text(about).changed() {
            wanted.vertical = Vertical::of(wanted.vertical.axis(), is_flipped);
        }
    });
    if let Some(note) = note {
        let text = format!("{note}. This is a guess: choose another axis if it is wrong");
        ui.label(RichText::new(text).small().color(theme::inks(ui).accent));
    }
}
