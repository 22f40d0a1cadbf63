//! Turns input into movements of the camera: keys fly, the left button orbits around the point
//! under the pointer, the right one pans, the middle one looks around, the wheel zooms to the
//! pointer (or changes the speed while flying), a double click flies to the point. In lit pictures
//! the left button with Ctrl (Command on a Mac) moves the sun. Gestures that need the point under
//! the pointer wait for the picture of this frame, which has its depth, so that nothing blocks on
//! reading a depth.

use super::tool::{Depth, Tool, share_of};
use crate::camera::Camera;
use eframe::egui::{Key, PointerButton, Rect, Response, Ui};
use glam::{DVec2, DVec3};

/// Turn of the camera for a drag over the whole height of the picture, radians.
pub const TURN_RAD: f64 = 2.6;
/// Logarithm of the ratio of distances for one point of scrolling.
const ZOOM_A_POINT: f64 = 1.0 / 360.0;
/// Logarithm of the change of speed for one point of scrolling.
pub const SPEED_A_POINT: f64 = 1.0 / 250.0;
/// Factors of the speed of flying with Shift and with Alt.
const FASTER: f64 = 4.0;
const SLOWER: f64 = 0.25;

/// Keys that fly, and their directions: right, up, ahead.
const FLY: [(Key, DVec3); 10] = [
    (Key::W, DVec3::Z),
    (Key::S, DVec3::NEG_Z),
    (Key::D, DVec3::X),
    (Key::A, DVec3::NEG_X),
    (Key::E, DVec3::Y),
    (Key::Q, DVec3::NEG_Y),
    (Key::ArrowUp, DVec3::Z),
    (Key::ArrowDown, DVec3::NEG_Z),
    (Key::ArrowRight, DVec3::X),
    (Key::ArrowLeft, DVec3::NEG_X),
];

/// Moves the camera. Has the gesture that is being made, and what waits for a depth.
#[derive(Debug, Default)]
pub struct Navigate {
    drag: Option<Drag>,
    waiting: Vec<Waiting>,
    /// Whether there is a sun to drag.
    pub has_sun: bool,
    /// Movement of the sun that was not taken yet, in shares of the height of the picture.
    sun: DVec2,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Drag {
    /// The sun.
    Sun,
    /// Around a point, once it is known.
    Orbit(Option<DVec3>),
    Look,
    /// At an eye depth, once it is known.
    Pan(Option<f64>),
}

/// A pixel whose depth is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Waiting {
    /// Position in the picture, 0 to 1 from its top left corner.
    at: DVec2,
    /// What the point behind the pixel is used for.
    purpose: Purpose,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Purpose {
    Orbit,
    Pan,
    Zoom {
        ratio: f64,
    },
    FlyTo,
    /// Make the picture a parallel one, or a perspective one.
    Parallel(bool),
}

impl Navigate {
    fn start(&mut self, ui: &Ui, response: &Response, rect: Rect) {
        let Some(at) = response.interact_pointer_pos().map(|p| share_of(rect, p)) else { return };
        if response.double_clicked() {
            self.waiting.push(Waiting { at, purpose: Purpose::FlyTo });
        }
        let pressed = |button| ui.input(|i| i.pointer.button_pressed(button));
        if !response.is_pointer_button_down_on() {
            return;
        }
        let [shift, command] = ui.input(|i| [i.modifiers.shift, i.modifiers.command]);
        if pressed(PointerButton::Secondary) || (pressed(PointerButton::Primary) && shift) {
            self.drag = Some(Drag::Pan(None));
            self.waiting.push(Waiting { at, purpose: Purpose::Pan });
        } else if pressed(PointerButton::Primary) && command && self.has_sun {
            self.drag = Some(Drag::Sun);
        } else if pressed(PointerButton::Primary) {
            self.drag = Some(Drag::Orbit(None));
            self.waiting.push(Waiting { at, purpose: Purpose::Orbit });
        } else if pressed(PointerButton::Middle) {
            self.drag = Some(Drag::Look);
        }
    }

    fn drag(&mut self, camera: &mut Camera, moved: DVec2, height: f64) {
        let turn = moved * (TURN_RAD / height);
        match self.drag {
            // The scene follows the pointer: when it moves to the right, the camera turns to the
            // left around the pivot.
            Some(Drag::Orbit(Some(pivot))) => camera.orbit(pivot, -turn.x, -turn.y),
            Some(Drag::Sun) => self.sun += moved / height,
            // The view follows the pointer.
            Some(Drag::Look) => camera.look(-turn.x, -turn.y),
            Some(Drag::Pan(Some(depth))) => camera.pan(moved.x, moved.y, depth, height),
            // The point is not known before this frame is drawn.
            Some(Drag::Orbit(None) | Drag::Pan(None)) | None => {}
        }
    }

    fn wheel(&mut self, ui: &Ui, response: &Response, camera: &mut Camera, rect: Rect) {
        let Some(pointer) = response.hover_pos() else { return };
        let (scrolled, pinched) = ui.input(|i| (i.smooth_scroll_delta().y, i.zoom_delta()));
        let scrolled = f64::from(scrolled);
        let is_flying = self.drag == Some(Drag::Look) || keys_held(ui) != DVec3::ZERO;
        if is_flying && scrolled != 0.0 {
            camera.change_speed((scrolled * SPEED_A_POINT).exp());
            return;
        }
        let ratio = (-scrolled * ZOOM_A_POINT).exp() / f64::from(pinched.max(1e-3));
        if ratio != 1.0 {
            self.waiting
                .push(Waiting { at: share_of(rect, pointer), purpose: Purpose::Zoom { ratio } });
        }
    }

    /// Makes the picture a parallel one, or a perspective one, when the depth in its middle is
    /// known.
    pub fn set_parallel(&mut self, is_parallel: bool) {
        self.waiting
            .push(Waiting { at: DVec2::splat(0.5), purpose: Purpose::Parallel(is_parallel) });
    }

    /// Movement of the sun since the last call, in shares of the height of the picture.
    #[cfg(feature = "light")]
    pub fn take_sun_drag(&mut self) -> Option<[f64; 2]> {
        let moved = std::mem::take(&mut self.sun);
        (moved != DVec2::ZERO).then_some(moved.to_array())
    }
}

impl Tool for Navigate {
    fn input(&mut self, ui: &Ui, response: &Response, camera: &mut Camera) {
        let rect = response.rect;
        self.start(ui, response, rect);
        let moved = response.drag_delta();
        let moved = DVec2::new(f64::from(moved.x), f64::from(moved.y));
        if moved != DVec2::ZERO {
            self.drag(camera, moved, f64::from(rect.height().max(1.0)));
        }
        if !response.is_pointer_button_down_on() {
            self.drag = None;
        }
        self.wheel(ui, response, camera, rect);
        camera.step(keys_held(ui), f64::from(ui.input(|i| i.stable_dt)));
    }

    fn needs_depth(&self) -> bool {
        !self.waiting.is_empty()
    }

    fn take_depths(&mut self, camera: &mut Camera, picture: &mut Depth<'_>) {
        for Waiting { at, purpose } in self.waiting.drain(..) {
            // Where the picture is empty, the viewing distance is used.
            let depth = (picture.at)(at).unwrap_or(camera.distance());
            let point = camera.point_at(at * picture.size, picture.size, depth);
            match purpose {
                Purpose::Zoom { ratio } => camera.zoom(point, ratio),
                Purpose::FlyTo => camera.fly_to(point),
                Purpose::Parallel(is_parallel) => camera.set_parallel(is_parallel, depth),
                Purpose::Orbit => {
                    if self.drag == Some(Drag::Orbit(None)) {
                        self.drag = Some(Drag::Orbit(Some(point)));
                    }
                }
                Purpose::Pan => {
                    if self.drag == Some(Drag::Pan(None)) {
                        self.drag = Some(Drag::Pan(Some(depth)));
                    }
                }
            }
        }
    }

    fn is_dragging(&self) -> bool {
        self.drag.is_some()
    }
}

/// Direction of the held keys: right, up, ahead; zero while text is edited.
fn keys_held(ui: &Ui) -> DVec3 {
    if ui.ctx().text_edit_focused() {
        return DVec3::ZERO;
    }
    // Arrows move the focus between widgets once one has it.
    let has_focus = ui.memory(|memory| memory.focused().is_some());
    let is_arrow =
        |key: Key| matches!(key, Key::ArrowUp | Key::ArrowDown | Key::ArrowLeft | Key::ArrowRight);
    ui.input(|i| {
        if i.modifiers.command {
            return DVec3::ZERO;
        }
        let flies = |key: Key| i.key_down(key) && !(has_focus && is_arrow(key));
        let held = FLY.iter().filter(|(key, _)| flies(*key)).map(|(_, to)| *to);
        let pace = if i.modifiers.shift {
            FASTER
        } else if i.modifiers.alt {
            SLOWER
        } else {
            1.0
        };
        held.sum::<DVec3>().clamp(DVec3::NEG_ONE, DVec3::ONE) * pace
    })
}
