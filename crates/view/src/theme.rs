//! Colours and styles of the window, light and dark. What lies over the picture has the colours of
//! the dark theme, on dark boxes.

use eframe::egui::{
    Color32, Context, CornerRadius, FontFamily, FontId, Stroke, TextStyle, Theme, ThemePreference,
    Ui, Visuals, vec2,
};

/// The window's title, behind the name of what it shows.
pub const TITLE: &str = "Esker";

/// Colours of a theme.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inks {
    /// Background.
    pub ground: Color32,
    /// Background of the panel.
    pub panel: Color32,
    /// Emphasis: curves, selected values, progress.
    pub accent: Color32,
    /// Second curve.
    pub cool: Color32,
    /// Text.
    pub text: Color32,
    /// Labels and explanations.
    pub faint: Color32,
    /// Faults.
    pub fault: Color32,
    /// Background of what is selected.
    selected: Color32,
    /// Lines between parts.
    line: Color32,
    /// Widgets: at rest, under the pointer, pressed.
    widgets: [Color32; 3],
}

const fn grey(level: u8) -> Color32 {
    Color32::from_rgb(level, level + 2, level + 6)
}

/// Dark, so that the picture is the brightest thing in the window.
pub const DARK: Inks = Inks {
    ground: Color32::from_rgb(19, 21, 25),
    panel: Color32::from_rgb(27, 30, 35),
    accent: Color32::from_rgb(222, 165, 87),
    cool: Color32::from_rgb(104, 162, 196),
    text: Color32::from_rgb(212, 214, 217),
    faint: Color32::from_rgb(148, 153, 161),
    fault: Color32::from_rgb(226, 118, 100),
    selected: Color32::from_rgb(92, 70, 40),
    line: Color32::from_rgb(48, 52, 59),
    widgets: [
        Color32::from_rgb(44, 48, 55),
        Color32::from_rgb(56, 61, 69),
        Color32::from_rgb(70, 75, 84),
    ],
};

/// For bright rooms.
const LIGHT: Inks = Inks {
    ground: grey(222),
    panel: grey(243),
    accent: Color32::from_rgb(143, 86, 8),
    cool: Color32::from_rgb(24, 98, 144),
    text: grey(32),
    faint: grey(86),
    fault: Color32::from_rgb(176, 40, 24),
    selected: Color32::from_rgb(242, 214, 172),
    line: grey(200),
    widgets: [grey(224), grey(212), grey(198)],
};

/// Emphasis over the picture, which has a dark ground in both themes.
pub const ACCENT: Color32 = DARK.accent;
/// Text over the picture, and the ground behind it.
pub const TEXT: Color32 = DARK.text;
pub const GROUND: Color32 = DARK.ground;

/// Colours of the theme that a window has.
pub fn inks(ui: &Ui) -> Inks {
    of(ui.ctx())
}

/// Colours of the theme that a context has.
pub fn of(ctx: &Context) -> Inks {
    match ctx.theme() {
        Theme::Dark => DARK,
        Theme::Light => LIGHT,
    }
}

/// Chooses the light or the dark theme, or that of the system.
pub fn choose(ctx: &Context, preference: ThemePreference) {
    ctx.set_theme(preference);
    ctx.request_repaint();
}

/// Applies both themes to a window, which follows the system. Where the system has none, the
/// window is dark.
pub fn apply(ctx: &Context) {
    ctx.options_mut(|options| options.fallback_theme = Theme::Dark);
    ctx.set_theme(ThemePreference::System);
    ctx.set_visuals_of(Theme::Dark, visuals(Visuals::dark(), DARK));
    ctx.set_visuals_of(Theme::Light, visuals(Visuals::light(), LIGHT));
    ctx.all_styles_mut(|style| {
        style.spacing.item_spacing = vec2(8.0, 4.0);
        style.spacing.slider_width = 150.0;
        style.spacing.interact_size.y = 18.0;
        // Content that scrolls ends beside the scroll bar, not under it.
        style.spacing.scroll.floating_allocated_width = style.spacing.scroll.bar_width;
        let sizes = [
            (TextStyle::Small, 10.5),
            (TextStyle::Body, 12.5),
            (TextStyle::Button, 12.5),
            (TextStyle::Heading, 15.0),
        ];
        for (text, size) in sizes {
            style.text_styles.insert(text, FontId::new(size, FontFamily::Proportional));
        }
        style.text_styles.insert(TextStyle::Monospace, FontId::new(12.0, FontFamily::Monospace));
    });
}

fn visuals(mut visuals: Visuals, inks: Inks) -> Visuals {
    visuals.panel_fill = inks.panel;
    visuals.window_fill = inks.panel;
    visuals.extreme_bg_color = inks.ground;
    visuals.faint_bg_color = inks.panel.lerp_to_gamma(inks.ground, 0.5);
    visuals.override_text_color = Some(inks.text);
    visuals.selection.bg_fill = inks.selected;
    visuals.selection.stroke = Stroke::new(1.0, inks.accent);
    visuals.hyperlink_color = inks.accent;
    visuals.slider_trailing_fill = true;
    visuals.window_stroke = Stroke::new(1.0, inks.line);
    let [rest, hovered, active] = inks.widgets;
    let widgets = &mut visuals.widgets;
    for (state, fill) in [
        (&mut widgets.inactive, rest),
        (&mut widgets.hovered, hovered),
        (&mut widgets.active, active),
        (&mut widgets.open, rest),
    ] {
        state.bg_fill = fill;
        state.weak_bg_fill = fill;
        state.bg_stroke = Stroke::NONE;
        state.corner_radius = CornerRadius::same(4);
    }
    widgets.noninteractive.bg_stroke = Stroke::new(1.0, inks.line);
    visuals
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast of two colours as WCAG 2 defines it, 1 to 21.
    fn contrast(a: Color32, b: Color32) -> f32 {
        let light = |colour: Color32| {
            let [r, g, b, _] = eframe::egui::Rgba::from(colour).to_array();
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let (a, b) = (light(a), light(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn all_text_can_be_read_in_both_themes() {
        for inks in [DARK, LIGHT] {
            for ink in [inks.text, inks.faint, inks.accent, inks.cool, inks.fault] {
                // WCAG 2 demands 4.5 for text.
                assert!(contrast(ink, inks.panel) >= 4.5, "{ink:?} on {:?}", inks.panel);
            }
            assert!(contrast(inks.text, inks.selected) >= 4.5);
            assert!(contrast(inks.text, inks.widgets[2]) >= 4.5);
        }
    }
}
