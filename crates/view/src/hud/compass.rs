//! The compass: the axes of the scan as the camera sees them. A click on the end of an axis looks
//! along it from there.

use crate::camera::Camera;
use crate::theme;
use eframe::egui::{
    Align2, Color32, CursorIcon, FontId, Id, Painter, Pos2, Rect, Sense, Stroke, Ui, vec2,
};
use glam::DVec3;

/// Length of an axis, points.
const LENGTH: f32 = 32.0;
/// Radius of the end of an axis, points.
const END: f32 = 8.0;
/// Names and colours of the axes.
const AXES: [(&str, Color32); 3] = [
    ("x", Color32::from_rgb(226, 92, 92)),
    ("y", Color32::from_rgb(124, 190, 84)),
    ("z", Color32::from_rgb(92, 148, 236)),
];

/// An end of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct End {
    axis: usize,
    is_negative: bool,
    /// Place, points: right and down from the middle of the compass.
    at: [f32; 2],
    /// How far it lies towards the eye, -1 to 1.
    near: f64,
}

impl End {
    fn direction(&self) -> DVec3 {
        DVec3::AXES[self.axis] * if self.is_negative { -1.0 } else { 1.0 }
    }
}

/// Shows the compass around `middle`. Returns the end that was clicked, as a direction.
pub fn show(ui: &Ui, painter: &Painter, middle: Pos2, camera: &Camera) -> Option<DVec3> {
    painter.circle_filled(middle, LENGTH + END + 2.0, Color32::from_black_alpha(70));
    let mut clicked = None;
    // The nearest end is on top of the others, also for clicks.
    for end in ends(camera) {
        let at = middle + vec2(end.at[0], end.at[1]);
        let (name, ink) = AXES[end.axis];
        let id = Id::unique(("compass", end.axis, end.is_negative));
        let area = Rect::from_center_size(at, vec2(END, END) * 2.0);
        let sign = if end.is_negative { "-" } else { "" };
        let about = format!("Look at all of the scan from {sign}{name}");
        let response = ui.interact(area, id, Sense::click()).on_hover_text(about);
        let response = response.on_hover_cursor(CursorIcon::PointingHand);
        if response.clicked() {
            clicked = Some(end.direction());
        }
        // Ends behind the middle are darker.
        let ink = ink.lerp_to_gamma(theme::GROUND, if end.near < 0.0 { 0.45 } else { 0.0 });
        let edge = if response.hovered() { theme::TEXT } else { ink };
        if end.is_negative {
            let fill = ink.lerp_to_gamma(theme::GROUND, 0.65);
            painter.circle(at, END - 2.0, fill, Stroke::new(1.2, edge));
        } else {
            painter.line_segment([middle, at], Stroke::new(2.0, ink));
            painter.circle(at, END - 0.5, ink, Stroke::new(1.2, edge));
            painter.text(at, Align2::CENTER_CENTER, name, FontId::monospace(11.0), theme::GROUND);
        }
    }
    clicked
}

/// The ends of the axes, the farthest first.
fn ends(camera: &Camera) -> Vec<End> {
    let view_from_world = camera.axes().transpose();
    let all = (0..3).flat_map(|axis| [false, true].map(|is_negative| (axis, is_negative)));
    let mut ends: Vec<End> = all
        .map(|(axis, is_negative)| {
            let end = End { axis, is_negative, at: [0.0; 2], near: 0.0 };
            let v = view_from_world * end.direction();
            End { at: [v.x as f32 * LENGTH, -v.y as f32 * LENGTH], near: v.z, ..end }
        })
        .collect();
    ends.sort_by(|a, b| a.near.total_cmp(&b.near));
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_turn_with_the_camera_and_the_nearest_end_is_last() {
        // Along y, with z upwards.
        let mut camera = Camera::new(DVec3::NEG_Y * 5.0, DVec3::ZERO, DVec3::Z, 1.0);
        let all = ends(&camera);
        let of = |axis: usize| all.iter().find(|e| e.axis == axis && !e.is_negative).unwrap();
        let near = |at: [f32; 2], to: [f32; 2]| (at[0] - to[0]).hypot(at[1] - to[1]) < 1e-3;
        assert!(near(of(0).at, [LENGTH, 0.0]) && near(of(2).at, [0.0, -LENGTH]), "{all:?}");
        assert_eq!(all.last().map(|e| e.direction()), Some(DVec3::NEG_Y), "y points away");
        camera.look(std::f64::consts::FRAC_PI_2, 0.0);
        let all = ends(&camera);
        assert_eq!(all.last().map(|e| e.direction()), Some(DVec3::X), "it looks along -x");
    }
}
