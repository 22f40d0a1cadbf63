//! From the window's input to the camera: keys fly, the left button orbits around what is under the
//! pointer, the right one looks around, the middle one pans, the wheel zooms to the pointer (or
//! changes the speed, while flying), a click tells the coordinates there, a double click flies
//! there. What needs the place under the pointer is kept until a picture of this frame's view has
//! told its depth, so that nothing ever waits for a reading.

use crate::camera::Camera;
use crate::measure::{Measure, Place};
use eframe::egui::{Key, PointerButton, Pos2, Rect, Response, Ui};
use glam::{DVec2, DVec3};

/// Radians that the whole height of the picture turns the camera by.
pub const TURN_RAD: f64 = 2.6;
/// Ratio of distances of one point of wheel scrolling.
const ZOOM_A_POINT: f64 = 1.0 / 360.0;
/// Change of the speed of one point of wheel scrolling, as an exponent.
pub const SPEED_A_POINT: f64 = 1.0 / 250.0;
/// How much faster and slower the keys fly with Shift and with Alt.
const FASTER: f64 = 4.0;
const SLOWER: f64 = 0.25;

/// Keys that fly, and where to: right, up, ahead.
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

/// What the hand is doing, and which places it waits to be told.
#[derive(Debug, Default)]
pub struct Gestures {
    drag: Option<Drag>,
    picks: Vec<Pick>,
    measure: Measure,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Drag {
    /// Around a place, once it is known.
    Orbit(Option<DVec3>),
    Look,
    /// At a depth, once it is known.
    Pan(Option<f64>),
}

/// A pixel whose depth is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Place on the picture, 0 to 1 from its top left corner.
    pub at: DVec2,
    /// What for.
    wanted: Wanted,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Wanted {
    Orbit,
    Pan,
    Zoom { ratio: f64 },
    FlyTo,
    Tell,
}

impl Gestures {
    /// Moves the camera by the input of this frame, on a picture shown at the response's place.
    pub fn update(&mut self, ui: &Ui, response: &Response, camera: &mut Camera) {
        let place = response.rect;
        self.start(ui, response, place);
        let moved = response.drag_delta();
        let moved = DVec2::new(f64::from(moved.x), f64::from(moved.y));
        if moved != DVec2::ZERO {
            self.drag(camera, moved, f64::from(place.height().max(1.0)));
        }
        if !response.is_pointer_button_down_on() {
            self.drag = None;
        }
        self.wheel(ui, response, camera, place);
        camera.step(keys_held(ui), f64::from(ui.input(|i| i.stable_dt)));
        let keys_free = !ui.ctx().text_edit_focused();
        if keys_free && ui.input(|i| i.key_pressed(Key::F) || i.key_pressed(Key::Home)) {
            camera.go_home();
        }
    }

    fn start(&mut self, ui: &Ui, response: &Response, place: Rect) {
        let Some(at) = response.interact_pointer_pos().map(|p| share_of(place, p)) else { return };
        if response.double_clicked() {
            // The first of both clicks meant no place of its own.
            self.measure.take_back();
            self.picks.push(Pick { at, wanted: Wanted::FlyTo });
        } else if response.clicked() && ui.input(|i| i.modifiers.is_none()) {
            self.picks.push(Pick { at, wanted: Wanted::Tell });
        }
        let pressed = |button| ui.input(|i| i.pointer.button_pressed(button));
        if !response.is_pointer_button_down_on() {
            return;
        }
        let shift = ui.input(|i| i.modifiers.shift);
        if pressed(PointerButton::Middle) || (pressed(PointerButton::Primary) && shift) {
            self.drag = Some(Drag::Pan(None));
            self.picks.push(Pick { at, wanted: Wanted::Pan });
        } else if pressed(PointerButton::Primary) {
            self.drag = Some(Drag::Orbit(None));
            self.picks.push(Pick { at, wanted: Wanted::Orbit });
        } else if pressed(PointerButton::Secondary) {
            self.drag = Some(Drag::Look);
        }
    }

    fn drag(&self, camera: &mut Camera, moved: DVec2, height: f64) {
        let turn = moved * (TURN_RAD / height);
        match self.drag {
            // The scene follows the hand: to the right is a turn to the left of the camera around
            // it.
            Some(Drag::Orbit(Some(pivot))) => camera.orbit(pivot, -turn.x, -turn.y),
            // The view follows the hand.
            Some(Drag::Look) => camera.look(-turn.x, -turn.y),
            Some(Drag::Pan(Some(depth))) => camera.pan(moved.x, moved.y, depth, height),
            // The place is not known yet: this frame's picture tells it.
            Some(Drag::Orbit(None) | Drag::Pan(None)) | None => {}
        }
    }

    fn wheel(&mut self, ui: &Ui, response: &Response, camera: &mut Camera, place: Rect) {
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
            self.picks.push(Pick { at: share_of(place, pointer), wanted: Wanted::Zoom { ratio } });
        }
    }

    /// Whether a place is to be told as exactly as the picture knows it.
    pub fn is_telling(&self) -> bool {
        self.picks.iter().any(|pick| pick.wanted == Wanted::Tell)
    }

    /// The places that were clicked.
    pub fn measure(&self) -> &Measure {
        &self.measure
    }

    /// Forgets them.
    pub fn forget(&mut self) {
        self.measure.clear();
    }

    /// Pixels whose depth is wanted of the next picture.
    pub fn picks(&self) -> &[Pick] {
        &self.picks
    }

    /// Tells what lies under the pixels asked for: `depth` gives the eye depth at a place of the
    /// picture of this size; the camera stands where that picture was seen from.
    pub fn told(
        &mut self,
        camera: &mut Camera,
        size: DVec2,
        mut depth: impl FnMut(DVec2) -> Option<f64>,
    ) {
        for pick in self.picks.drain(..) {
            let known = depth(pick.at);
            // Where nothing is: as far away as what is seen.
            let depth = known.unwrap_or(camera.distance());
            let place = camera.place(pick.at * size, size, depth);
            match pick.wanted {
                Wanted::Zoom { ratio } => camera.zoom(place, ratio),
                Wanted::FlyTo => camera.fly_to(place),
                Wanted::Tell if known.is_some() => {
                    let pixel = depth * (camera.fovy_rad() * 0.5).tan() * 2.0 / size.y;
                    self.measure.take(Place { at: place, pixel });
                }
                Wanted::Tell => self.measure.clear(),
                Wanted::Orbit => {
                    if self.drag == Some(Drag::Orbit(None)) {
                        self.drag = Some(Drag::Orbit(Some(place)));
                    }
                }
                Wanted::Pan => {
                    if self.drag == Some(Drag::Pan(None)) {
                        self.drag = Some(Drag::Pan(Some(depth)));
                    }
                }
            }
        }
    }

    /// Whether the hand holds the scene.
    pub fn is_dragging(&self) -> bool {
        self.drag.is_some()
    }

    /// The place that the hand turns around.
    pub fn pivot(&self) -> Option<DVec3> {
        match self.drag {
            Some(Drag::Orbit(pivot)) => pivot,
            _ => None,
        }
    }
}

/// Where the keys fly to: right, up, ahead; zero while something is typed.
fn keys_held(ui: &Ui) -> DVec3 {
    if ui.ctx().text_edit_focused() {
        return DVec3::ZERO;
    }
    ui.input(|i| {
        if i.modifiers.command {
            return DVec3::ZERO;
        }
        let held = FLY.iter().filter(|(key, _)| i.key_down(*key)).map(|(_, to)| *to);
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

fn share_of(place: Rect, pointer: Pos2) -> DVec2 {
    let at = pointer - place.min;
    let share = |v: f32, side: f32| f64::from(v / side.max(1.0)).clamp(0.0, 1.0);
    DVec2::new(share(at.x, place.width()), share(at.y, place.height()))
}
