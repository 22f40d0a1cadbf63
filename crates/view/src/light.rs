//! The section of the panel for lit pictures: the place of the sun, the rays, and how far the
//! picture is refined.

use crate::settings::Settings;
use crate::theme;
use eframe::egui::{ProgressBar, RichText, Slider, Ui};
use esker_engine::io::quantity::grouped;
use esker_engine::light::settings::FILTERS;
use esker_engine::light::status::LitStatus;
use esker_engine::light::sun;
use std::ops::RangeInclusive;

/// Range of the slider of bounces.
const BOUNCES: RangeInclusive<u32> = 0..=4;
/// Degrees that a drag over the whole height of the picture moves the sun by: azimuth, elevation.
const DRAG_DEG: [f64; 2] = [180.0, 90.0];

/// Shows the section, and changes `wanted` as the user does.
pub fn show(ui: &mut Ui, wanted: &mut Settings, status: Option<&LitStatus>) {
    if let Some(mut place) = sun::place(&wanted.light) {
        let before = place;
        let [low, high] = sun::ELEVATIONS_DEG;
        ui.label(RichText::new("sun: direction and height, degrees").color(theme::FAINT));
        ui.add(Slider::new(&mut place[0], 0.0..=360.0).fixed_decimals(0));
        ui.add(Slider::new(&mut place[1], low..=high).fixed_decimals(0));
        if place != before {
            sun::set_place(&mut wanted.light, place);
        }
    }
    ui.label(RichText::new("reflections of light").color(theme::FAINT));
    ui.add(Slider::new(&mut wanted.light.bounces, BOUNCES));
    ui.horizontal_wrapped(|ui| {
        for (filter, name, about) in FILTERS {
            ui.selectable_value(&mut wanted.light.filter, filter, name).on_hover_text(about);
        }
    });
    let Some(status) = status else { return };
    let share = status.samples as f32 / status.samples_final.max(1) as f32;
    let text = format!("{} of {} rays a pixel", status.samples, status.samples_final);
    let bar = ProgressBar::new(share).corner_radius(3.0).desired_height(17.0);
    ui.add(bar.fill(theme::COOL.gamma_multiply(0.55)).text(RichText::new(text).size(11.0)));
    let bound = if status.is_bounded { ": the bound of main memory is reached" } else { "" };
    let splats = format!("{} lit points{bound}", grouped(status.splats as u64));
    ui.label(RichText::new(splats).color(theme::FAINT));
}

/// Moves the sun by a drag, in shares of the height of the picture.
pub fn drag_sun(wanted: &mut Settings, [x, y]: [f64; 2]) {
    if let Some([azimuth, elevation]) = sun::place(&wanted.light) {
        let place = [azimuth + x * DRAG_DEG[0], elevation - y * DRAG_DEG[1]];
        sun::set_place(&mut wanted.light, place);
    }
}
