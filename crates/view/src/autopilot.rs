//! Follows a camera path with the window's own input: holds the middle button and moves the mouse
//! to turn, presses and releases keys to stay near the path, and turns the wheel to reach its
//! speed.
//! The camera is late by a fraction of a second and never exactly on the path.

use crate::input_events::{WindowState, button_event, key_event, position_at, wheel_event};
use crate::tools::{SPEED_A_POINT, TURN_RAD};
use eframe::egui::{Event, Key, PointerButton, vec2};
use esker_engine::View;
use esker_engine::cameras::path::Path;
use glam::DVec3;

/// Share of the error in direction that is corrected in a frame.
const TURN_A_FRAME: f64 = 0.5;
/// A key is pressed if the eye is off the path by the first share of the distance to the scene, and
/// released below the second.
const PRESS: f64 = 0.03;
const RELEASE: f64 = 0.012;
/// Seconds in which the keys should correct the error in position.
const CATCH_UP_S: f64 = 0.3;
/// Range of the speed that is set with the wheel.
const SPEED: [f64; 2] = [0.05, 20.0];
/// Longest stay at a stop, seconds.
const STAY_MAX_S: f64 = 0.5;
/// Keys for right, up and ahead, each with the key for the opposite direction.
const KEYS: [[Key; 2]; 3] = [[Key::D, Key::A], [Key::E, Key::Q], [Key::W, Key::S]];

/// A flight along a path.
pub struct Autopilot {
    path: Path,
    start_s: f64,
    faster: f64,
    /// Position of the pointer, points from where the button was pressed.
    pointer: [f64; 2],
    is_held: bool,
    /// Which key of each pair is held.
    down: [Option<usize>; 3],
}

impl Autopilot {
    /// Begins to follow `path` at the time `now_s`, `faster` times its own speed.
    pub fn new(path: Path, now_s: f64, faster: f64) -> Self {
        Self { path, start_s: now_s, faster, pointer: [0.0; 2], is_held: false, down: [None; 3] }
    }

    /// The view that the path has at this time; `None` after its end.
    fn wanted(&self, now_s: f64) -> Option<View> {
        let mut seconds = (now_s - self.start_s) * self.faster;
        for (i, stop) in self.path.views.iter().enumerate() {
            let travel = if i == 0 { 0.0 } else { stop.travel_s };
            if seconds < travel {
                return Some(self.path.between(i, seconds / travel));
            }
            seconds -= travel;
            let stay = stop.stay_s.min(STAY_MAX_S);
            if seconds < stay {
                return Some(stop.view);
            }
            seconds -= stay;
        }
        None
    }

    /// Adds the input of a frame to `events`. Returns whether the path has ended; all keys and
    /// buttons are then released.
    pub fn steer(&mut self, window: &WindowState<'_>, events: &mut Vec<Event>) -> bool {
        let middle = position_at(window.picture_rect, [0.5, 0.5]);
        let Some(view) = self.wanted(window.now_s) else {
            self.release_all(window, events);
            return true;
        };
        if !self.is_held {
            events.push(Event::PointerMoved(middle));
            events.push(button_event(middle, PointerButton::Middle, true));
            self.is_held = true;
            return false;
        }
        self.turn(&view, window);
        let at = middle + vec2(self.pointer[0] as f32, self.pointer[1] as f32);
        events.push(Event::PointerMoved(at));
        self.fly(&view, window, events);
        false
    }

    fn turn(&mut self, view: &View, window: &WindowState<'_>) {
        let axes = window.camera.axes();
        let wanted = axes.transpose() * view.forward();
        let level = (1.0 - window.camera.forward().dot(window.camera.up()).powi(2)).sqrt().max(0.1);
        let left = (-wanted.x).atan2(-wanted.z) / level;
        let up = wanted.y.clamp(-1.0, 1.0).asin();
        let points = f64::from(window.picture_rect.height()) / TURN_RAD * TURN_A_FRAME;
        self.pointer[0] -= left * points;
        self.pointer[1] -= up * points;
    }

    fn fly(&mut self, view: &View, window: &WindowState<'_>, events: &mut Vec<Event>) {
        let camera = window.camera;
        let off = along_keys(
            view.eye - camera.eye(),
            camera.axes().x_axis,
            camera.up(),
            camera.forward(),
        );
        let share = off / camera.distance();
        for (axis, keys) in KEYS.into_iter().enumerate() {
            let way = usize::from(share[axis] < 0.0);
            let wanted = match self.down[axis] {
                Some(down) if down == way && share[axis].abs() > RELEASE => Some(way),
                _ => (share[axis].abs() > PRESS).then_some(way),
            };
            if wanted != self.down[axis] {
                events.extend(self.down[axis].map(|i| key_event(keys[i], false)));
                events.extend(wanted.map(|i| key_event(keys[i], true)));
                self.down[axis] = wanted;
            }
        }
        let speed = (share.abs().max_element() / CATCH_UP_S).clamp(SPEED[0], SPEED[1]);
        let change = (speed / camera.speed()).ln();
        if change.abs() > 0.2 {
            // Only half of the change, because egui still smooths earlier turns of the wheel.
            events.push(wheel_event(change / SPEED_A_POINT * 0.5));
        }
    }

    fn release_all(&mut self, window: &WindowState<'_>, events: &mut Vec<Event>) {
        for (axis, keys) in KEYS.into_iter().enumerate() {
            events.extend(self.down[axis].take().map(|i| key_event(keys[i], false)));
        }
        if std::mem::take(&mut self.is_held) {
            let at = position_at(window.picture_rect, [0.5, 0.5]);
            let at = at + vec2(self.pointer[0] as f32, self.pointer[1] as f32);
            events.push(button_event(at, PointerButton::Middle, false));
        }
    }
}

/// Distances to fly to the right, upwards and ahead that add up to `way`. The keys move along the
/// world's up axis, along which the view may look too.
fn along_keys(way: DVec3, right: DVec3, up: DVec3, forward: DVec3) -> DVec3 {
    let lean = forward.dot(up);
    let (ahead, upwards) = (way.dot(forward), way.dot(up));
    let whole = 1.0 - lean * lean;
    if whole < 0.2 {
        return DVec3::new(way.dot(right), 0.0, ahead);
    }
    DVec3::new(way.dot(right), (upwards - lean * ahead) / whole, (ahead - lean * upwards) / whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use eframe::egui::{Rect, pos2};
    use esker_engine::Lattice;

    #[test]
    fn distances_of_keys_add_up_to_the_way() {
        let camera = Camera::new(DVec3::ZERO, DVec3::new(3.0, 4.0, -2.0), DVec3::Z, 1.0);
        let (right, up, forward) = (camera.axes().x_axis, camera.up(), camera.forward());
        let way = DVec3::new(0.3, -1.0, 0.7);
        let keys = along_keys(way, right, up, forward);
        assert!((right * keys.x + up * keys.y + forward * keys.z).distance(way) < 1e-12);
    }

    #[test]
    fn every_pressed_key_and_button_is_released() {
        let text = r#"{"views": [{"name": "a", "eye": [0,-9,1], "target": [0,0,0], "stay_s": 0},
                                 {"name": "b", "eye": [9,-2,5], "target": [0,0,1], "travel_s": 2}]}"#;
        let path =
            Path::parse(text, ([[0.0; 3], [1.0; 3]], &Lattice::default()), [640, 400]).unwrap();
        let mut camera = Camera::new(DVec3::new(0.0, -9.0, 1.0), DVec3::ZERO, DVec3::Z, 1.0);
        let mut autopilot = Autopilot::new(path, 0.0, 1.0);
        let (mut keys, mut buttons) = (0, 0);
        for frame in 0..200 {
            let window = WindowState {
                widgets: &[],
                now_s: f64::from(frame) * 0.02,
                picture_rect: Rect::from_min_max(pos2(0.0, 0.0), pos2(640.0, 400.0)),
                camera: &camera,
                settled: false,
                is_busy: false,
                read_bytes: 0,
            };
            let mut events = Vec::new();
            let is_done = autopilot.steer(&window, &mut events);
            for event in &events {
                match event {
                    Event::Key { pressed, .. } => keys += if *pressed { 1 } else { -1 },
                    Event::PointerButton { pressed, .. } => {
                        buttons += if *pressed { 1 } else { -1 }
                    }
                    _ => {}
                }
            }
            if is_done {
                assert_eq!((keys, buttons), (0, 0));
                assert!(frame > 100, "not before the end of the path");
                return;
            }
            camera.step(DVec3::ZERO, 0.02);
        }
        unreachable!("the path ends");
    }
}
