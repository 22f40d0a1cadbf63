//! Text over the picture, on a dark ground.

use crate::theme;
use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, vec2};

/// Size of text, points.
const TEXT: f32 = 12.0;

/// Writes text on a dark ground; `at` is the place of the anchor of the ground. Returns the
/// rectangle of the ground.
pub fn boxed(painter: &Painter, at: Pos2, anchor: Align2, text: &str) -> Rect {
    let font = FontId::monospace(TEXT);
    let text = painter.layout_no_wrap(text.to_owned(), font, theme::TEXT);
    let ground = anchor.anchor_size(at, text.size() + vec2(12.0, 6.0));
    painter.rect_filled(ground, 4.0, Color32::from_black_alpha(150));
    painter.galley(ground.min + vec2(6.0, 3.0), text, theme::TEXT);
    ground
}
