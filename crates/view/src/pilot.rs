//! Plays a script: turns its steps, frame by frame, into the input events that a user would cause,
//! and into orders to the window. The flight is repeated from the same pose until a repetition
//! reads nothing from the disk, so that frame times while loading and with the scene resident are
//! compared on the same path in the same run.

use crate::autopilot::Autopilot;
use crate::camera::{Camera, Pose};
use crate::commands::Command;
use crate::input_events::{WindowState, button_event, key_event, position_at, wheel_event};
use crate::script::{Script, Step, key};
use crate::widgets;
use eframe::egui::accesskit::{Action, ActionRequest, TreeId};
use eframe::egui::{Event, Modifiers, PointerButton, Pos2, RawInput};
use std::path::PathBuf;

/// Greatest share of a drag or of a turn of the wheel that is made in one frame.
const STRIDE: f64 = 0.1;

/// Frames of a click on a widget.
const WIDGET_FRAMES: f64 = 7.0;
/// Movements of the pointer a second.
const POINTS_A_SECOND: f64 = 60.0;

/// A click at a place of the window.
fn click(at: Pos2) -> [Event; 3] {
    let button = |is_down| button_event(at, PointerButton::Primary, is_down);
    [Event::PointerMoved(at), button(true), button(false)]
}

/// Share of the way of the pointer after `seconds` of `length`: it moves as often as a mouse, not
/// as often as the window is drawn.
fn pointed_share(seconds: f64, length: f64) -> f64 {
    let moves = (length * POINTS_A_SECOND).max(1.0);
    ((seconds / length.max(1e-3)).min(1.0) * moves).floor() / moves
}

/// What the window does beside handling the input.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Write the picture of the scene.
    Picture(PathBuf),
    /// Write a picture of the whole window.
    Window(PathBuf),
    /// Move the camera to this pose.
    SetPose(Pose),
    /// Begin a flight, whose frames are timed.
    Begin,
    /// End the flight.
    End,
    /// Report what the script could not do.
    Fault(String),
    /// Give a command.
    Command(Command),
    /// Close the window, which writes the report.
    Close,
}

/// The list of steps that is played; a flight has its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StepList {
    Before,
    Flight(u32),
    After,
}

/// The camera paths of a script, with the names that its steps use.
pub type Paths = Vec<(Option<PathBuf>, esker_engine::cameras::path::Path)>;

/// A script that is being played.
pub struct Pilot {
    script: Script,
    list: StepList,
    step: usize,
    /// When the step began, seconds; `None` before its first frame.
    began: Option<f64>,
    /// Share of the step that is done, 0 to 1.
    share: f64,
    start: Option<(Pose, u64)>,
    autopilot: Option<Autopilot>,
    paths: Paths,
    ended: bool,
}

impl Pilot {
    /// Makes a pilot of `script`; `paths` are the camera paths that its steps name.
    pub fn new(script: Script, paths: Paths) -> Self {
        Self {
            script,
            list: StepList::Before,
            step: 0,
            began: None,
            share: 0.0,
            start: None,
            autopilot: None,
            paths,
            ended: false,
        }
    }

    /// Replaces the user's input of the next frame in `raw`. Returns what else is to be done.
    pub fn fly(&mut self, raw: &mut RawInput, window: &WindowState<'_>) -> Vec<Order> {
        raw.events.retain(|event| matches!(event, Event::WindowFocused(_)));
        raw.focused = true;
        let mut orders = Vec::new();
        if self.ended {
            return orders;
        }
        // Steps without duration may follow one another within a frame, but their number is
        // bounded.
        for _ in 0..8 {
            let Some(step) = self.steps().get(self.step).cloned() else {
                if self.next_list(window, &mut orders) {
                    return orders;
                }
                continue;
            };
            let begins = self.began.is_none();
            if begins && self.step == 0 {
                self.begin_list(window, &mut orders);
            }
            let began = *self.began.get_or_insert(window.now_s);
            if !self.go_on(&step, window, window.now_s - began, begins, raw, &mut orders) {
                return orders;
            }
            (self.step, self.began, self.share) = (self.step + 1, None, 0.0);
        }
        orders
    }

    fn steps(&self) -> &[Step] {
        match self.list {
            StepList::Before => &self.script.before,
            StepList::Flight(_) => &self.script.flight,
            StepList::After => &self.script.after,
        }
    }

    fn begin_list(&mut self, window: &WindowState<'_>, orders: &mut Vec<Order>) {
        let StepList::Flight(_) = self.list else { return };
        let pose = match (self.start, self.script.flight.first()) {
            (Some((pose, _)), _) => pose,
            (None, Some(Step::Path { file, .. })) => self.first_pose(file.as_ref(), window.camera),
            (None, _) => window.camera.pose(),
        };
        self.start = Some((pose, window.read_bytes));
        orders.extend([Order::SetPose(pose), Order::Begin]);
    }

    /// Pose at the start of a path.
    fn first_pose(&self, file: Option<&PathBuf>, camera: &Camera) -> Pose {
        let path = self.paths.iter().find(|(name, _)| name.as_ref() == file);
        path.map_or(camera.pose(), |(_, path)| {
            let view = &path.views[0].view;
            camera.pose_along(view.eye, view.forward())
        })
    }

    /// Begins the next list of steps. Returns whether a frame is to be drawn before it.
    fn next_list(&mut self, window: &WindowState<'_>, orders: &mut Vec<Order>) -> bool {
        let has_flown = matches!(self.list, StepList::Flight(_)) && !self.script.flight.is_empty();
        if has_flown {
            orders.push(Order::End);
        }
        let read = self.start.is_some_and(|(_, before)| window.read_bytes > before);
        self.list = match self.list {
            StepList::Before => StepList::Flight(0),
            StepList::Flight(n)
                if has_flown && (read || n == 0) && n + 1 < self.script.flights_max =>
            {
                StepList::Flight(n + 1)
            }
            StepList::Flight(_) => StepList::After,
            StepList::After => {
                self.ended = true;
                orders.push(Order::Close);
                StepList::After
            }
        };
        (self.step, self.began, self.share) = (0, None, 0.0);
        self.ended || has_flown
    }

    /// Plays one frame of a step. Returns whether the step is done.
    fn go_on(
        &mut self,
        step: &Step,
        window: &WindowState<'_>,
        seconds: f64,
        begins: bool,
        raw: &mut RawInput,
        orders: &mut Vec<Order>,
    ) -> bool {
        let at = |p: [f64; 2]| position_at(window.picture_rect, p);
        // Bounded, so that a movement takes several frames even if they are slow, as a user's does.
        let most = self.share + STRIDE;
        let share =
            |length: f64| (if length > 0.0 { seconds / length } else { 1.0 }).min(most).min(1.0);
        let events = &mut raw.events;
        match step {
            Step::Hold { keys, seconds: length } => {
                let is_done = seconds >= *length;
                if begins || is_done {
                    let keys = keys.iter().filter_map(|name| key(name).ok());
                    events.extend(keys.map(|key| key_event(key, !is_done)));
                }
                is_done
            }
            Step::Press { key: name } => {
                events.extend(key(name).ok().map(|key| key_event(key, begins)));
                !begins
            }
            Step::Drag { button, from, to, command, seconds: length } => {
                let button = PointerButton::from(*button);
                if begins {
                    if *command {
                        let held = Modifiers { ctrl: true, ..Modifiers::COMMAND };
                        events.push(Event::ModifiersChanged(held));
                    }
                    events.push(Event::PointerMoved(at(*from)));
                    events.push(button_event(at(*from), button, true));
                    return false;
                }
                let t = share(*length);
                self.share = t;
                let now = [0, 1].map(|i| from[i] + (to[i] - from[i]) * t);
                events.push(Event::PointerMoved(at(now)));
                if t >= 1.0 {
                    events.push(button_event(at(now), button, false));
                    events.push(Event::ModifiersChanged(Modifiers::default()));
                }
                t >= 1.0
            }
            Step::Point { from, to, seconds: length } => {
                let t = pointed_share(seconds, *length);
                events.extend(self.pointed(t, begins, [*from, *to], window));
                seconds >= *length
            }
            Step::Wheel { at: position, points, seconds: length } => {
                let t = share(*length);
                events.push(Event::PointerMoved(at(*position)));
                events.push(wheel_event((t - self.share) * points));
                self.share = t;
                t >= 1.0
            }
            Step::Click { at: position } | Step::DoubleClick { at: position } => {
                events.extend(click(at(*position)));
                matches!(step, Step::Click { .. }) || !begins
            }
            Step::Widget { name, seconds: length } => {
                self.click_widget(name, seconds >= *length, window, events, orders)
            }
            Step::Type { text } => {
                events.push(Event::Text(text.clone()));
                true
            }
            Step::Path { file, faster } => {
                self.follow(file.as_ref(), *faster, window, begins, events)
            }
            Step::Wait { seconds: length } => seconds >= *length,
            // In the first frame of a step, `settled` is still that of the previous view.
            Step::Settle { seconds: length } => (window.settled && !begins) || seconds >= *length,
            Step::Picture { path } => {
                orders.extend(begins.then(|| Order::Picture(path.clone())));
                !begins && !window.is_busy
            }
            Step::Window { path } => {
                orders.extend(begins.then(|| Order::Window(path.clone())));
                !begins && !window.is_busy
            }
            Step::Command { id } => {
                orders.extend(Command::of(id).filter(|_| begins).map(Order::Command));
                !begins
            }
            Step::Close => {
                self.ended = true;
                orders.push(Order::Close);
                false
            }
        }
    }

    /// Clicks a widget: brings it into view, then moves the pointer to it, presses and releases,
    /// each in frames of its own. Returns whether that is done.
    fn click_widget(
        &mut self,
        name: &str,
        is_late: bool,
        window: &WindowState<'_>,
        events: &mut Vec<Event>,
        orders: &mut Vec<Order>,
    ) -> bool {
        let Some(widget) = widgets::find(window.widgets, name) else {
            if is_late {
                orders.push(Order::Fault(format!("the window has no widget `{name}`")));
            }
            return is_late;
        };
        let (at, button) = (widget.rect.center(), PointerButton::Primary);
        self.share += 1.0 / WIDGET_FRAMES;
        match (self.share * WIDGET_FRAMES).round() as u32 {
            1 => events.push(Event::AccessKitActionRequest(ActionRequest {
                action: Action::ScrollIntoView,
                target_tree: TreeId::ROOT,
                target_node: widget.id,
                data: None,
            })),
            // It has moved by then.
            2..=4 => {}
            5 => events.push(Event::PointerMoved(at)),
            6 => events.push(button_event(at, button, true)),
            _ => events.push(button_event(at, button, false)),
        }
        self.share >= 1.0
    }

    /// Moves the pointer to a share of the way, unless it is there.
    fn pointed(
        &mut self,
        share: f64,
        begins: bool,
        [from, to]: [[f64; 2]; 2],
        window: &WindowState<'_>,
    ) -> Option<Event> {
        let is_new = begins || share > self.share;
        self.share = share;
        let now = [0, 1].map(|i| from[i] + (to[i] - from[i]) * share);
        is_new.then(|| Event::PointerMoved(position_at(window.picture_rect, now)))
    }

    fn follow(
        &mut self,
        file: Option<&PathBuf>,
        faster: f64,
        window: &WindowState<'_>,
        begins: bool,
        events: &mut Vec<Event>,
    ) -> bool {
        if begins {
            let path = self.paths.iter().find(|(name, _)| name.as_ref() == file);
            self.autopilot =
                path.map(|(_, path)| Autopilot::new(path.clone(), window.now_s, faster));
        }
        let Some(autopilot) = &mut self.autopilot else { return true };
        let is_done = autopilot.steer(window, events);
        if is_done {
            self.autopilot = None;
        }
        is_done
    }
}
