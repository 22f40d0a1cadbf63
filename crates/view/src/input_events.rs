//! The input events that a hand would make, for scripts and the autopilot: keys, clicks, the wheel;
//! and what a script sees of the window in each frame.

use crate::camera::Camera;
use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, Rect, TouchPhase,
    pos2, vec2,
};

/// What the pilot sees of the window.
pub struct Sight<'a> {
    /// Seconds since the start.
    pub now_s: f64,
    /// Where the picture is shown, points.
    pub place: Rect,
    /// The camera.
    pub camera: &'a Camera,
    /// Whether nothing more comes for the view.
    pub settled: bool,
    /// Whether a picture that was ordered is still to come.
    pub is_busy: bool,
    /// Bytes read so far.
    pub read_bytes: u64,
}

/// A place of the picture in the window.
pub fn place_at(place: Rect, share: [f64; 2]) -> Pos2 {
    let [x, y] = share.map(|s| s as f32);
    // Just inside, so that what is at its edge is still the picture.
    let inside = place.shrink(1.0);
    pos2(inside.left() + x * inside.width(), inside.top() + y * inside.height())
}

/// A key goes down or up.
pub fn pressed(key: Key, pressed: bool) -> Event {
    Event::Key {
        key,
        physical_key: Some(key),
        pressed,
        repeat: false,
        modifiers: Modifiers::default(),
    }
}

/// A button goes down or up.
pub fn clicked(pos: Pos2, button: PointerButton, pressed: bool) -> Event {
    Event::PointerButton { pos, button, pressed, modifiers: Modifiers::default() }
}

/// The wheel turns.
pub fn scrolled(points: f64) -> Event {
    Event::MouseWheel {
        unit: MouseWheelUnit::Point,
        delta: vec2(0.0, points as f32),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers: Modifiers::default(),
    }
}
