//! The tab of how points are drawn: method, sizes, colours with their legend, light, and the looks
//! of the window itself.

use super::data::PanelData;
use super::widgets::{Scale, label, section, slide, tick};
use super::{legend, names, sides};
use crate::commands::Command;
use crate::settings::Settings;
use crate::theme;
use eframe::egui::{ComboBox, ThemePreference, Ui};
use esker_engine::cameras::colour::SCANS;
use esker_engine::light::IS_BUILT;
use esker_engine::{Dots, Method, POINT_SIZE_MAX, PointSize};

/// Methods, their names, and when to choose them.
const METHODS: [(Method, &str, &str); 5] = [
    (Method::Auto, "Auto", "Surfaces where points are near each other, round points elsewhere"),
    (Method::PullPush, "Surfaces", "Closes the gaps between points: walls, ground, objects"),
    (Method::Ewa, "Splats", "Draws each point as a disc on its surface: slower, exact outlines"),
    (Method::Points, "Points", "Draws each point alone, without light"),
    (Method::Lit, "Lit", "Lights the points by sun and sky, with shadows: slowest"),
];

/// Shows the tab.
pub fn show(
    ui: &mut Ui,
    data: &PanelData<'_>,
    wanted: &mut Settings,
    is_coarser_moving: &mut bool,
    given: &mut Vec<Command>,
) {
    ui.horizontal_wrapped(|ui| {
        for (method, name, about) in METHODS {
            if method != Method::Lit || IS_BUILT {
                ui.selectable_value(&mut wanted.method, method, name).on_hover_text(about);
            }
        }
    });
    if wanted.method == Method::Points {
        dots(ui, &mut wanted.dots);
    }
    section(ui, "Look from");
    sides::show(ui, wanted, data.is_parallel, data.up_note, given);
    section(ui, "Colours");
    colours(ui, data, wanted);
    section(ui, "Surfaces");
    tick(ui, &mut wanted.shines, "highlights", "Surfaces that face the camera shine a little");
    if data.has_fronts {
        let about = "Leave out points whose surface looks away from the camera";
        tick(ui, &mut wanted.culls_back, "hide backs", about);
    }
    let about = "Draw fewer pixels while the camera moves, so that it moves smoothly";
    tick(ui, is_coarser_moving, "coarser while moving", about);
    #[cfg(feature = "light")]
    if wanted.method == Method::Lit {
        section(ui, "Light");
        super::light::show(ui, wanted, data.counters.lit.as_ref());
    }
    section(ui, "Window");
    theme_switch(ui);
}

/// How points look that are drawn alone.
fn dots(ui: &mut Ui, wanted: &mut Dots) {
    let mut is_adaptive = wanted.size == PointSize::Adaptive;
    let about = "Points are as wide as they are apart, so that neighbours touch";
    tick(ui, &mut is_adaptive, "size by distance of points", about);
    wanted.size = match wanted.size {
        _ if is_adaptive => PointSize::Adaptive,
        PointSize::Adaptive => PointSize::default(),
        PointSize::Pixels(mut pixels) => {
            let named = ("size of points, pixels", "Diameter of a point in the picture");
            slide(ui, named, &mut pixels, 1.0..=POINT_SIZE_MAX, &Scale::logarithmic(1));
            PointSize::Pixels(pixels)
        }
    };
    let mut is_domed = wanted.eye_dome > 0.0;
    let about = "Darken points that lie behind their surroundings, which shows their shape";
    if tick(ui, &mut is_domed, "eye-dome lighting", about).changed() {
        wanted.eye_dome = if is_domed { 1.0 } else { 0.0 };
    }
}

fn colours(ui: &mut Ui, data: &PanelData<'_>, wanted: &mut Settings) {
    let words = names::sources(data.sources);
    let at = |name: &String| data.sources.iter().position(|source| source == name);
    let chosen = match &wanted.colour_by {
        None => "automatic".to_owned(),
        Some(name) => at(name).map_or_else(|| names::source(name), |i| words[i].clone()),
    };
    ui.horizontal(|ui| {
        let name = label(ui, "by");
        let width = ui.available_width();
        let choice = ComboBox::from_id_salt("colours").selected_text(chosen).width(width);
        let choice = choice.truncate().show_ui(ui, |ui| {
            ui.selectable_value(&mut wanted.colour_by, None, "automatic");
            for (source, words) in data.sources.iter().zip(&words) {
                let value = Some(source.clone());
                ui.selectable_value(&mut wanted.colour_by, value, words);
            }
        });
        let choice = choice.response.labelled_by(name.id);
        choice.on_hover_text("What gives the points their colours (C: the next one)");
    });
    if let Some(legend) = data.legend {
        legend::show(ui, legend, data.unit);
    }
    if wanted.evens_exposure || data.sources.iter().any(|s| SCANS.contains(&s.as_str())) {
        let about = "Even out differences of brightness where scans overlap";
        tick(ui, &mut wanted.evens_exposure, "even out exposures", about);
    }
}

/// The choice between a light and a dark window.
fn theme_switch(ui: &mut Ui) {
    let mut chosen = ui.ctx().options(|options| options.theme_preference);
    let before = chosen;
    ui.horizontal(|ui| {
        for (preference, name, about) in [
            (ThemePreference::System, "system", "Light or dark as the system is"),
            (ThemePreference::Light, "light", "A light window"),
            (ThemePreference::Dark, "dark", "A dark window"),
        ] {
            ui.selectable_value(&mut chosen, preference, name).on_hover_text(about);
        }
    });
    if chosen != before {
        theme::choose(ui.ctx(), chosen);
    }
}
