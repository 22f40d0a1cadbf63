//! The section of *View* for lit pictures: the place of the sun, the rays, and how far the
//! picture is refined.

use super::widgets::{Scale, bar, note, slide, tick};
use crate::settings::Settings;
use crate::theme;
use eframe::egui::{Checkbox, Ui};
use esker_engine::io::quantity::grouped;
use esker_engine::light::settings::{FILTERS, Gloss, ROUGHNESS_MIN};
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
        let azimuth = ("sun: direction, degrees", "Where the sun stands, clockwise from north");
        slide(ui, azimuth, &mut place[0], 0.0..=360.0, &Scale::linear(0));
        let height = ("sun: height, degrees", "How high the sun stands above the horizon");
        slide(ui, height, &mut place[1], low..=high, &Scale::linear(0));
        if place != before {
            sun::set_place(&mut wanted.light, place);
        }
    }
    let bounces = ("reflections of light", "How often light is thrown from surface to surface");
    slide(ui, bounces, &mut wanted.light.bounces, BOUNCES, &Scale::linear(0));
    ui.horizontal_wrapped(|ui| {
        for (filter, name, about) in FILTERS {
            ui.selectable_value(&mut wanted.light.filter, filter, name).on_hover_text(about);
        }
    });
    let is_glossy = wanted.light.gloss.is_some();
    let shadows = Checkbox::new(&mut wanted.light.filters_shadows, "filter soft shadows");
    let shadows = ui.add_enabled(!is_glossy, shadows);
    let shadows = shadows.on_hover_text("Remove the noise of soft shadows");
    shadows.on_disabled_hover_text("Shadows on glossy surfaces are not filtered");
    show_gloss(ui, &mut wanted.light.gloss);
    let Some(status) = status else { return };
    let share = status.samples as f32 / status.samples_final.max(1) as f32;
    let text = format!("{} of {} rays a pixel", status.samples, status.samples_final);
    bar(ui, share, theme::inks(ui).cool.gamma_multiply(0.55), &text);
    note(ui, &format!("{} lit points", grouped(status.splats as u64)));
    let hints = [
        (
            status.lacks_normals,
            "points without normals are lit roughly: build with --normals estimate",
        ),
        (status.is_bounded, "the memory budget holds no more points"),
        (status.is_smaller, "the memory budget holds no larger picture"),
        (
            status.is_bounded || status.is_smaller,
            "to raise it: --budget-ram, or drawing memory on a GPU",
        ),
    ];
    for (_, hint) in hints.iter().filter(|(is_so, _)| *is_so) {
        note(ui, hint);
    }
}

/// Shows whether surfaces are glossy, and how much.
fn show_gloss(ui: &mut Ui, gloss: &mut Option<Gloss>) {
    let mut is_glossy = gloss.is_some();
    let about = "Surfaces mirror a part of the light";
    if tick(ui, &mut is_glossy, "glossy surfaces", about).changed() {
        *gloss = is_glossy.then(Gloss::default);
    }
    if let Some(gloss) = gloss {
        let share = ("mirrored share", "Share of the light that is mirrored");
        slide(ui, share, &mut gloss.reflectance, 0.0..=1.0, &Scale::logarithmic(3));
        let roughness = ("roughness", "How far mirrored light spreads");
        slide(ui, roughness, &mut gloss.roughness, ROUGHNESS_MIN..=1.0, &Scale::linear(2));
    }
}

/// Moves the sun by a drag, in shares of the height of the picture.
pub fn drag_sun(wanted: &mut Settings, [x, y]: [f64; 2]) {
    if let Some([azimuth, elevation]) = sun::place(&wanted.light) {
        let place = [azimuth + x * DRAG_DEG[0], elevation - y * DRAG_DEG[1]];
        sun::set_place(&mut wanted.light, place);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;
    use eframe::egui::{Context, RawInput};
    use esker_engine::light::spec::parse;

    #[test]
    fn showing_the_section_changes_nothing() {
        let mut wanted = Settings::default();
        wanted.light.lights = Some(parse("sun:12.5,-33|lamp:1,2,3").unwrap());
        wanted.light.bounces = 9;
        wanted.light.gloss = Some(Gloss { reflectance: 0.123, roughness: 0.456 });
        let given = wanted.clone();
        let status = LitStatus { samples: 3, samples_final: 8, ..LitStatus::default() };
        let ctx = Context::default();
        for status in [None, Some(&status)] {
            let _ = ctx.run_ui(RawInput::default(), |ui| show(ui, &mut wanted, status));
            assert_eq!(wanted, given);
        }
    }

    #[test]
    fn a_drag_to_the_right_and_up_turns_and_lifts_the_sun() {
        let mut wanted = Settings::default();
        wanted.light.lights = Some(parse("sun:350,10").unwrap());
        drag_sun(&mut wanted, [0.1, -0.2]);
        let [azimuth, elevation] = sun::place(&wanted.light).unwrap();
        assert!((azimuth - 8.0).abs() < 1e-9 && (elevation - 28.0).abs() < 1e-9);
        wanted.light.lights = Some(parse("sky").unwrap());
        let before = wanted.clone();
        drag_sun(&mut wanted, [0.1, 0.1]);
        assert_eq!(wanted, before, "there is no sun to move");
    }
}
