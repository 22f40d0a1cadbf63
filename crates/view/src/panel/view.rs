//! The tab of how points are drawn: method, sizes, colours with their legend, light, and the looks
//! of the window itself.

use super::counted::Counted;
use super::data::PanelData;
use super::widgets::{Scale, label, note, section, slide, tick};
use super::{histogram, legend, names, sides};
use crate::commands::Command;
use crate::settings::Settings;
use crate::theme;
use eframe::egui::{Button, ComboBox, ThemePreference, Ui};
use esker_engine::cameras::colour::SCANS;
use esker_engine::cameras::colour_request::{Parts, parts};
use esker_engine::cameras::legend::Legend;
use esker_engine::light::IS_BUILT;
use esker_engine::{Dots, Gradient, Method, POINT_SIZE_MAX, PointSize};

/// Colours of the bars of a histogram.
const COLOURS: usize = 64;
/// The source of colours by height; legends name its axis too.
const ELEVATION: &str = "elevation";

/// Methods, their names, and when to choose them.
const METHODS: [(Method, &str, &str); 5] = [
    (Method::Auto, "Auto", "Surfaces where points are near each other, round points elsewhere"),
    (Method::PullPush, "Surfaces", "Closes the gaps between points: walls, ground, objects"),
    (Method::Ewa, "Splats", "Draws each point as a disc on its surface: slower, exact outlines"),
    (Method::Points, "Points", "Draws each point alone, without light"),
    (Method::Lit, "Lit", "Lights the points by sun and sky, with shadows: slowest"),
];

/// What the colours mean.
pub struct Shown<'a> {
    /// Legend of the newest picture.
    pub legend: Option<&'a Legend>,
    /// The histogram of their values.
    pub counted: &'a mut Counted,
}

/// Shows the tab.
pub fn show(
    ui: &mut Ui,
    data: &PanelData<'_>,
    shown: Shown<'_>,
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
    colours(ui, data, shown, wanted);
    section(ui, "Looks");
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

fn colours(ui: &mut Ui, data: &PanelData<'_>, shown: Shown<'_>, wanted: &mut Settings) {
    sources(ui, data, wanted);
    let Shown { legend, counted } = shown;
    let is_counted = legend.is_some_and(|legend| range(ui, data, (legend, counted), wanted));
    if let Some(legend) = legend.filter(|_| !is_counted) {
        legend::show(ui, legend, data.unit);
    }
    if wanted.evens_exposure || data.sources.iter().any(|s| SCANS.contains(&s.as_str())) {
        let about = "Even out differences of brightness where scans overlap";
        tick(ui, &mut wanted.evens_exposure, "even out exposures", about);
    }
}

/// The colour map, and the histogram of the values that have colours, by which their range is
/// chosen. Returns whether there is a histogram.
fn range(
    ui: &mut Ui,
    data: &PanelData<'_>,
    (legend, counted): (&Legend, &mut Counted),
    wanted: &mut Settings,
) -> bool {
    let Some((mapped, gradient)) = legend.range.zip(legend.gradient) else { return false };
    let text = wanted.colour_by.clone();
    let is_elevation = legend.name.starts_with(ELEVATION);
    let automatic = if is_elevation { ELEVATION } else { &legend.name };
    let requested = text.as_deref().and_then(|text| parts(text).ok());
    let own = requested.unwrap_or(Parts { name: automatic, ..Parts::default() });
    if let Some(gradient) = maps(ui, gradient) {
        wanted.colour_by = Some(Parts { gradient: Some(gradient), ..own }.text());
    }
    let wants = (data.file, own.name, wanted.vertical);
    if counted.get(ui.ctx(), wants).is_none() && counted.is_counting() {
        note(ui, "The values are being counted.");
    }
    let Some(histogram) = counted.get(ui.ctx(), wants) else { return false };
    let mut range = [0, 1].map(|end| own.range[end].unwrap_or(mapped[end]));
    let unit = data.unit.filter(|_| is_elevation || legend.is_length);
    let words = names::source(own.name);
    if histogram::show(ui, (&words, unit), histogram, &legend.bar(COLOURS), &mut range) {
        wanted.colour_by = Some(Parts { range: range.map(Some), ..own }.text());
    }
    let is_chosen = own.range != [None; 2];
    let whole = ui.add_enabled(is_chosen, Button::new("whole range").small());
    let whole = whole.on_hover_text("Spread the colours over nearly all values again");
    if whole.on_disabled_hover_text("The colours are spread over nearly all values").clicked() {
        wanted.colour_by = Some(Parts { range: [None; 2], ..own }.text());
    }
    true
}

/// The choice of a colour map, of which `shown` is the present one. Returns another one that is
/// chosen.
fn maps(ui: &mut Ui, shown: Gradient) -> Option<Gradient> {
    let mut chosen = shown;
    ui.horizontal(|ui| {
        let name = label(ui, "map");
        let width = ui.available_width();
        let choice = ComboBox::from_id_salt("maps").selected_text(shown.name()).width(width);
        let choice = choice.show_ui(ui, |ui| {
            for gradient in Gradient::ALL {
                ui.selectable_value(&mut chosen, gradient, gradient.name());
            }
        });
        let about = "The colours from the least to the greatest value";
        choice.response.labelled_by(name.id).on_hover_text(about);
    });
    (chosen != shown).then_some(chosen)
}

/// The choice of what gives the points their colours.
fn sources(ui: &mut Ui, data: &PanelData<'_>, wanted: &mut Settings) {
    let requested = wanted.colour_by.as_deref().map(|text| parts(text).map_or(text, |of| of.name));
    let mut source = requested.map(str::to_owned);
    let words = names::sources(data.sources);
    let at = |name: &String| data.sources.iter().position(|source| source == name);
    let chosen = match &source {
        None => "automatic".to_owned(),
        Some(name) => at(name).map_or_else(|| names::source(name), |i| words[i].clone()),
    };
    ui.horizontal(|ui| {
        let name = label(ui, "by");
        let width = ui.available_width();
        let choice = ComboBox::from_id_salt("colours").selected_text(chosen).width(width);
        let choice = choice.truncate().show_ui(ui, |ui| {
            ui.selectable_value(&mut source, None, "automatic");
            for (name, words) in data.sources.iter().zip(&words) {
                ui.selectable_value(&mut source, Some(name.clone()), words);
            }
        });
        let choice = choice.response.labelled_by(name.id);
        choice.on_hover_text("What gives the points their colours (C: the next one)");
    });
    if source.as_deref() != requested {
        wanted.colour_by = source;
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
