//! Colours and styles of the window: a dark theme, so that the picture is the brightest thing in
//! it.

use eframe::egui::{
    Color32, Context, CornerRadius, FontFamily, FontId, Stroke, TextStyle, Theme, Visuals, vec2,
};

/// The window's title, behind the name of what it shows.
pub const TITLE: &str = "Esker";

/// Background.
pub const GROUND: Color32 = Color32::from_rgb(19, 21, 25);
/// Background of the panel.
pub const PANEL: Color32 = Color32::from_rgb(27, 30, 35);
/// Emphasis: curves, selected values, progress.
pub const ACCENT: Color32 = Color32::from_rgb(222, 165, 87);
/// Second curve.
pub const COOL: Color32 = Color32::from_rgb(104, 162, 196);
/// Text.
pub const TEXT: Color32 = Color32::from_rgb(212, 214, 217);
/// Labels and explanations.
pub const FAINT: Color32 = Color32::from_rgb(138, 143, 151);
/// Faults.
pub const FAULT: Color32 = Color32::from_rgb(226, 118, 100);

/// Applies the theme to a window.
pub fn apply(ctx: &Context) {
    ctx.set_theme(Theme::Dark);
    let mut visuals = Visuals::dark();
    visuals.panel_fill = PANEL;
    visuals.window_fill = PANEL;
    visuals.extreme_bg_color = GROUND;
    visuals.faint_bg_color = Color32::from_rgb(32, 35, 41);
    visuals.override_text_color = Some(TEXT);
    visuals.selection.bg_fill = Color32::from_rgb(92, 70, 40);
    visuals.selection.stroke = Stroke::new(1.0, ACCENT);
    visuals.hyperlink_color = ACCENT;
    visuals.slider_trailing_fill = true;
    visuals.window_stroke = Stroke::new(1.0, Color32::from_rgb(48, 52, 59));
    let widgets = &mut visuals.widgets;
    for (state, fill) in [
        (&mut widgets.inactive, Color32::from_rgb(44, 48, 55)),
        (&mut widgets.hovered, Color32::from_rgb(56, 61, 69)),
        (&mut widgets.active, Color32::from_rgb(70, 75, 84)),
        (&mut widgets.open, Color32::from_rgb(44, 48, 55)),
    ] {
        state.bg_fill = fill;
        state.weak_bg_fill = fill;
        state.bg_stroke = Stroke::NONE;
        state.corner_radius = CornerRadius::same(4);
    }
    widgets.noninteractive.bg_stroke = Stroke::new(1.0, Color32::from_rgb(42, 46, 53));
    ctx.set_visuals_of(Theme::Dark, visuals);
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
