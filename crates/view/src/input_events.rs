//! Input events as a user causes them, for scripts and the autopilot: keys, clicks, the wheel; and
//! the state of the window that a script reads in each frame.

use crate::camera::Camera;
use crate::widgets::Widget;
use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, Rect, TouchPhase,
    pos2, vec2,
};

/// State of the window in a frame.
pub struct WindowState<'a> {
    /// Time since the start, seconds.
    pub now_s: f64,
    /// Rectangle of the picture in the window, points.
    pub picture_rect: Rect,
    /// Camera of the scene.
    pub camera: &'a Camera,
    /// Widgets that can be clicked, if the script clicks any.
    pub widgets: &'a [Widget],
    /// Whether the view is complete.
    pub settled: bool,
    /// Whether a requested picture is not written yet.
    pub is_busy: bool,
    /// Bytes read so far.
    pub read_bytes: u64,
}

/// Position in the window of a position in the picture, which is given as fractions of its sides.
pub fn position_at(picture_rect: Rect, share: [f64; 2]) -> Pos2 {
    let [x, y] = share.map(|s| s as f32);
    // One point inside, so that positions at the edge are still in the picture.
    let inside = picture_rect.shrink(1.0);
    pos2(inside.left() + x * inside.width(), inside.top() + y * inside.height())
}

/// Event of a key that is pressed or released.
pub fn key_event(key: Key, pressed: bool) -> Event {
    Event::Key {
        key,
        physical_key: Some(key),
        pressed,
        repeat: false,
        modifiers: Modifiers::default(),
    }
}

/// Event of a mouse button that is pressed or released.
pub fn button_event(pos: Pos2, button: PointerButton, pressed: bool) -> Event {
    Event::PointerButton { pos, button, pressed, modifiers: Modifiers::default() }
}

/// Event of the wheel.
pub fn wheel_event(points: f64) -> Event {
    Event::MouseWheel {
        unit: MouseWheelUnit::Point,
        delta: vec2(0.0, points as f32),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers: Modifiers::default(),
    }
}
