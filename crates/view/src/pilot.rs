//! Flies by a script: turns its steps into the input that egui would get from a hand, frame by
//! frame, and says what else is to be done. The flight is repeated from the same pose until a
//! repetition reads nothing from the disk, so that loading and fully resident are compared on the
//! same path in the same run.

use crate::autopilot::Autopilot;
use crate::camera::{Camera, Pose};
use crate::input_events::{Sight, clicked, place_at, pressed, scrolled};
use crate::script::{Script, Step, key};
use eframe::egui::{Event, PointerButton, RawInput};
use std::path::PathBuf;

/// Share of a drag, or of a turn of the wheel, in a frame at most.
const STRIDE: f64 = 0.1;

/// What is to be done beside the input.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Write the picture.
    Picture(PathBuf),
    /// Write the whole window.
    Window(PathBuf),
    /// Stand here.
    Stand(Pose),
    /// A flight begins: its frames are timed.
    Begin,
    /// It has ended.
    End,
    /// Write the report and close the window.
    Close,
}

/// Which list of steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Before,
    Flight(u32),
    After,
}

/// The camera paths of a script, by the names that its steps give.
pub type Paths = Vec<(Option<PathBuf>, esker_engine::cameras::path::Path)>;

/// A script on its way.
pub struct Pilot {
    script: Script,
    part: Part,
    step: usize,
    /// When the step began, seconds; `None` before it has.
    began: Option<f64>,
    /// How much of the step is done, 0 to 1.
    share: f64,
    start: Option<(Pose, u64)>,
    autopilot: Option<Autopilot>,
    paths: Paths,
    ended: bool,
}

impl Pilot {
    /// For a script; `paths` are the camera paths that its steps name.
    pub fn new(script: Script, paths: Paths) -> Self {
        Self {
            script,
            part: Part::Before,
            step: 0,
            began: None,
            share: 0.0,
            start: None,
            autopilot: None,
            paths,
            ended: false,
        }
    }

    /// The input of the next frame, in place of the hand's, and what else is to be done.
    pub fn fly(&mut self, raw: &mut RawInput, sight: &Sight<'_>) -> Vec<Order> {
        raw.events.retain(|event| matches!(event, Event::WindowFocused(_)));
        raw.focused = true;
        let mut orders = Vec::new();
        if self.ended {
            return orders;
        }
        // Steps that take no time may follow one another within a frame, but not for ever.
        for _ in 0..8 {
            let Some(step) = self.steps().get(self.step).cloned() else {
                if self.next_part(sight, &mut orders) {
                    return orders;
                }
                continue;
            };
            let begins = self.began.is_none();
            if begins && self.step == 0 {
                self.begin_part(sight, &mut orders);
            }
            let began = *self.began.get_or_insert(sight.now_s);
            if !self.go_on(&step, sight, sight.now_s - began, begins, raw, &mut orders) {
                return orders;
            }
            (self.step, self.began, self.share) = (self.step + 1, None, 0.0);
        }
        orders
    }

    fn steps(&self) -> &[Step] {
        match self.part {
            Part::Before => &self.script.before,
            Part::Flight(_) => &self.script.flight,
            Part::After => &self.script.after,
        }
    }

    fn begin_part(&mut self, sight: &Sight<'_>, orders: &mut Vec<Order>) {
        let Part::Flight(_) = self.part else { return };
        let pose = match (self.start, self.script.flight.first()) {
            (Some((pose, _)), _) => pose,
            (None, Some(Step::Path { file, .. })) => self.first_pose(file.as_ref(), sight.camera),
            (None, _) => sight.camera.pose(),
        };
        self.start = Some((pose, sight.read_bytes));
        orders.extend([Order::Stand(pose), Order::Begin]);
    }

    /// Where a path begins.
    fn first_pose(&self, file: Option<&PathBuf>, camera: &Camera) -> Pose {
        let path = self.paths.iter().find(|(name, _)| name.as_ref() == file);
        path.map_or(camera.pose(), |(_, path)| {
            let view = &path.views[0].view;
            camera.pose_along(view.eye, view.forward())
        })
    }

    /// Goes on to the next list of steps; true where a frame is to be drawn first.
    fn next_part(&mut self, sight: &Sight<'_>, orders: &mut Vec<Order>) -> bool {
        let has_flown = matches!(self.part, Part::Flight(_)) && !self.script.flight.is_empty();
        if has_flown {
            orders.push(Order::End);
        }
        let read = self.start.is_some_and(|(_, before)| sight.read_bytes > before);
        self.part = match self.part {
            Part::Before => Part::Flight(0),
            Part::Flight(n) if has_flown && (read || n == 0) && n + 1 < self.script.flights_max => {
                Part::Flight(n + 1)
            }
            Part::Flight(_) => Part::After,
            Part::After => {
                self.ended = true;
                orders.push(Order::Close);
                Part::After
            }
        };
        (self.step, self.began, self.share) = (0, None, 0.0);
        self.ended || has_flown
    }

    /// Does a frame's worth of a step; true where it is done.
    fn go_on(
        &mut self,
        step: &Step,
        sight: &Sight<'_>,
        seconds: f64,
        begins: bool,
        raw: &mut RawInput,
        orders: &mut Vec<Order>,
    ) -> bool {
        let at = |p: [f64; 2]| place_at(sight.place, p);
        // In several frames even where those are slow: a hand's way has more than two ends.
        let most = self.share + STRIDE;
        let share =
            |length: f64| (if length > 0.0 { seconds / length } else { 1.0 }).min(most).min(1.0);
        let events = &mut raw.events;
        match step {
            Step::Hold { keys, seconds: length } => {
                let is_done = seconds >= *length;
                if begins || is_done {
                    let keys = keys.iter().filter_map(|name| key(name).ok());
                    events.extend(keys.map(|key| pressed(key, !is_done)));
                }
                is_done
            }
            Step::Press { key: name } => {
                let is_done = !begins;
                events.extend(key(name).ok().map(|key| pressed(key, begins)));
                is_done
            }
            Step::Drag { button, from, to, seconds: length } => {
                let button = PointerButton::from(*button);
                if begins {
                    events.push(Event::PointerMoved(at(*from)));
                    events.push(clicked(at(*from), button, true));
                    return false;
                }
                let t = share(*length);
                self.share = t;
                let now = [0, 1].map(|i| from[i] + (to[i] - from[i]) * t);
                events.push(Event::PointerMoved(at(now)));
                if t >= 1.0 {
                    events.push(clicked(at(now), button, false));
                }
                t >= 1.0
            }
            Step::Wheel { at: place, points, seconds: length } => {
                let t = share(*length);
                events.push(Event::PointerMoved(at(*place)));
                events.push(scrolled((t - self.share) * points));
                self.share = t;
                t >= 1.0
            }
            Step::Click { at: place } => {
                let place = at(*place);
                events.push(Event::PointerMoved(place));
                events.push(clicked(place, PointerButton::Primary, true));
                events.push(clicked(place, PointerButton::Primary, false));
                true
            }
            Step::DoubleClick { at: place } => {
                let place = at(*place);
                events.push(Event::PointerMoved(place));
                events.push(clicked(place, PointerButton::Primary, true));
                events.push(clicked(place, PointerButton::Primary, false));
                !begins
            }
            Step::Path { file, faster } => {
                self.follow(file.as_ref(), *faster, sight, begins, events)
            }
            Step::Wait { seconds: length } => seconds >= *length,
            // The first frame of a step still tells of the view before it.
            Step::Settle { seconds: length } => (sight.settled && !begins) || seconds >= *length,
            Step::Picture { path } => {
                if begins {
                    orders.push(Order::Picture(path.clone()));
                }
                !begins && !sight.is_busy
            }
            Step::Window { path } => {
                if begins {
                    orders.push(Order::Window(path.clone()));
                }
                !begins && !sight.is_busy
            }
            Step::Close => {
                self.ended = true;
                orders.push(Order::Close);
                false
            }
        }
    }

    fn follow(
        &mut self,
        file: Option<&PathBuf>,
        faster: f64,
        sight: &Sight<'_>,
        begins: bool,
        events: &mut Vec<Event>,
    ) -> bool {
        if begins {
            let path = self.paths.iter().find(|(name, _)| name.as_ref() == file);
            self.autopilot =
                path.map(|(_, path)| Autopilot::new(path.clone(), sight.now_s, faster));
        }
        let Some(autopilot) = &mut self.autopilot else { return true };
        let is_done = autopilot.steer(sight, events);
        if is_done {
            self.autopilot = None;
        }
        is_done
    }
}
