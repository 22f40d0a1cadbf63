//! Keeps the session behind the picture through changes of settings. A running session takes most
//! of them, once they are prepared on a thread; for the others it is closed and opened again on a
//! thread, while the last picture stays. There are never two sessions at once, so that memory
//! budgets hold.

use crate::device::Device;
use crate::job::Job;
use crate::settings::Settings;
use anyhow::{Result, bail};
use esker_engine::cameras::boxes::Boxes;
use esker_engine::cameras::legend::Legend;
use esker_engine::draw::change::Change;
use esker_engine::draw::session::{DrawnFrame, GpuBytes, Session};
use esker_engine::machine::backend::Drawer;
use esker_engine::{Cut, Forest, ForestFilter, Method, Picture, Status, View};
use glam::DVec2;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest time that the window stays empty, or keeps the last picture, while a new session loads.
const HOLD_MAX: Duration = Duration::from_millis(1500);

/// An open file with the session that draws it.
pub struct Scene {
    file: Arc<Forest>,
    settings: Settings,
    device: Device,
    /// Size of the largest picture that is wanted, pixels.
    size: [u32; 2],
    state: State,
    /// Change of settings that is being prepared for the running session.
    change: Option<(Settings, Job<Change>)>,
    /// Why the session cannot take the settings; it draws by the last ones that it took.
    refusal: Option<String>,
    /// Until when a new session may load before its pictures are shown.
    hold_until: Option<Instant>,
    /// The views of the last picture, if that picture is final.
    at_rest: Option<(View, View)>,
    reopened: u64,
}

enum State {
    Opening(Job<Session>),
    Running(Box<Session>),
    Failed(String),
}

/// The views of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameViews {
    /// View that the cut is chosen for.
    pub chosen: View,
    /// View that the cut is seen from; the same unless the cut is frozen.
    pub seen: View,
}

/// Outcome of a frame.
pub enum FrameOutcome<'a> {
    /// A new picture.
    New(Box<DrawnFrame<'a>>),
    /// The last picture is still valid.
    Unchanged,
    /// There is no picture yet, or the last one stays while a session is opened.
    Waiting,
    /// The session cannot be opened, or cannot draw.
    Failed(String),
}

impl Scene {
    /// Starts to open a session, for pictures of at most `size` pixels.
    pub fn new(file: Arc<Forest>, settings: Settings, device: Device, size: [u32; 2]) -> Self {
        let state = State::open(&file, &settings, &device, size);
        let (change, refusal, hold_until, at_rest) = (None, None, None, None);
        let reopened = 0;
        Self { file, settings, device, size, state, change, refusal, hold_until, at_rest, reopened }
    }

    /// The open file: of a tree that grows, the state that is drawn.
    pub fn file(&self) -> &Arc<Forest> {
        match &self.state {
            State::Running(session) => session.file(),
            _ => &self.file,
        }
    }

    /// Present settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether pictures are lit.
    pub fn is_lit(&self) -> bool {
        self.settings.method == Method::Lit
    }

    /// Legend of the colours; `None` if no session runs.
    pub fn legend(&self) -> Option<Legend> {
        match &self.state {
            State::Running(session) => Some(session.legend().clone()),
            _ => None,
        }
    }

    /// Boxes of the points that are shown; `None` if no session runs.
    pub fn boxes(&self) -> Option<&Boxes> {
        match &self.state {
            State::Running(session) => Some(session.boxes()),
            _ => None,
        }
    }

    /// Which points are shown; `None` if no session runs.
    pub fn shown(&self) -> Option<Arc<ForestFilter>> {
        match &self.state {
            State::Running(session) => Some(Arc::clone(&session.appearance().shown)),
            _ => None,
        }
    }

    /// Status of streaming.
    pub fn status(&self) -> Status {
        match &self.state {
            State::Running(session) => session.status(),
            _ => Status::default(),
        }
    }

    /// Number of times that the render thread waited for another thread.
    pub fn stalls(&self) -> u64 {
        match &self.state {
            State::Running(session) => session.stalls(),
            _ => 0,
        }
    }

    /// How often the session was opened again.
    pub fn reopened(&self) -> u64 {
        self.reopened
    }

    /// Whether the picture of these views is final, so that the next frame would be the same.
    pub fn is_at_rest(&self, views: &FrameViews) -> bool {
        self.at_rest == Some((views.chosen, views.seen)) && matches!(self.state, State::Running(_))
    }

    /// What draws, with the reason if it is not a GPU; `None` if no session runs.
    pub fn drawer(&self) -> Option<&Drawer> {
        match &self.state {
            State::Running(session) => Some(session.drawer()),
            _ => None,
        }
    }

    /// Bytes of GPU buffers, if a GPU draws.
    pub fn gpu_bytes(&self) -> Option<GpuBytes> {
        match &self.state {
            State::Running(session) => session.gpu_bytes(),
            _ => None,
        }
    }

    /// Eye depth at a position in the newest finished picture, at the resolution of depth tiles;
    /// never waits.
    pub fn depth_at(&self, place: DVec2) -> Option<f64> {
        match &self.state {
            State::Running(session) => session.depth_at(place),
            _ => None,
        }
    }

    /// Copies the last picture to main memory; waits until it is finished.
    ///
    /// # Errors
    /// If no session runs, or the picture cannot be read.
    pub fn picture(&mut self) -> Result<Picture> {
        match &mut self.state {
            State::Running(session) => session.picture(),
            _ => bail!("no session draws"),
        }
    }

    /// Whether a session is being opened, or loads behind the last picture.
    pub fn is_waiting(&self) -> bool {
        matches!(self.state, State::Opening(_)) || self.hold_until.is_some()
    }

    /// Makes the next frame be drawn even if nothing has changed.
    pub fn invalidate(&mut self) {
        self.at_rest = None;
    }

    /// Changes the settings.
    pub fn set(&mut self, settings: Settings) {
        if settings == self.settings {
            return;
        }
        let Settings { method, shines, dots, .. } = settings;
        let light = settings.light.clone();
        // Files of meshes are read when a session is opened.
        let same_meshes = light.meshes == self.settings.light.meshes;
        let known =
            Settings { method, shines, dots, light: light.clone(), ..self.settings.clone() };
        let is_quick = known == settings && same_meshes && self.change.is_none();
        self.settings = settings;
        self.at_rest = None;
        self.refusal = None;
        let State::Running(session) = &mut self.state else { return self.reopen() };
        if is_quick && session.set_method(method) {
            session.set_shine(shines);
            session.set_dots(dots);
            session.set_light(light);
        } else if self.change.is_none() {
            self.prepare();
        }
    }

    /// Prepares a change to the present settings.
    fn prepare(&mut self) {
        let (file, settings) = (Arc::clone(&self.file), self.settings.clone());
        match Job::start("esker-settings", move || Change::new(&file, settings)) {
            Ok(job) => self.change = Some((self.settings.clone(), job)),
            Err(error) => self.refusal = Some(format!("{error:#}")),
        }
    }

    /// Makes a change once it is prepared, or opens another session for it.
    fn take_change(&mut self) {
        let Some(result) = self.change.as_mut().and_then(|(_, job)| job.poll()) else { return };
        let prepared = self.change.take().map(|(settings, _)| settings);
        let State::Running(session) = &mut self.state else { return };
        let taken = result.and_then(|change| session.apply(change));
        self.at_rest = None;
        match taken {
            // The settings have changed since.
            _ if prepared.as_ref() != Some(&self.settings) => self.prepare(),
            Ok(true) => {}
            Ok(false) => self.reopen(),
            Err(error) => self.refusal = Some(format!("{error:#}")),
        }
    }

    /// Changes the size of the largest picture, pixels.
    pub fn resize(&mut self, size: [u32; 2]) {
        if size != self.size {
            self.size = size;
            self.reopen();
        }
    }

    /// Size of the largest picture that is wanted, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Size of the largest picture that the session draws, pixels: lit ones may be smaller.
    pub fn drawn_size(&self) -> [u32; 2] {
        match &self.state {
            State::Running(session) => session.size(),
            _ => self.size,
        }
    }

    fn reopen(&mut self) {
        // The old session ends before the new one takes its memory.
        self.state = State::Failed(String::new());
        self.state = State::open(&self.file, &self.settings, &self.device, self.size);
        self.change = None;
        self.refusal = None;
        self.hold_until = None;
        self.at_rest = None;
        self.reopened += 1;
    }

    /// Draws a frame of the points that are resident.
    pub fn frame(&mut self, views: &FrameViews) -> FrameOutcome<'_> {
        if let State::Opening(opening) = &mut self.state {
            match opening.poll() {
                None => return FrameOutcome::Waiting,
                Some(Ok(session)) => {
                    let is_smaller = session.size() != self.size;
                    self.state = State::Running(Box::new(session));
                    self.hold_until = Some(Instant::now() + HOLD_MAX);
                    if is_smaller {
                        // The views are of pictures that it does not draw.
                        return FrameOutcome::Waiting;
                    }
                }
                Some(Err(error)) => self.state = State::Failed(format!("{error:#}")),
            }
        }
        self.take_change();
        if let Some(fault) = &self.refusal {
            return FrameOutcome::Failed(fault.clone());
        }
        let session = match &mut self.state {
            State::Running(session) => session,
            State::Failed(fault) => return FrameOutcome::Failed(fault.clone()),
            State::Opening(_) => return FrameOutcome::Waiting,
        };
        if let Some(until) = self.hold_until {
            let cut = session.settle(&views.chosen, Duration::ZERO);
            // The first picture may be incomplete; later ones replace a complete picture.
            let is_loading =
                |cut: &Cut| cut.nodes.is_empty() || (self.reopened > 0 && !cut.settled);
            let has_nodes = !self.file.table().nodes.is_empty();
            if has_nodes && cut.is_ok_and(|cut| is_loading(&cut)) && Instant::now() < until {
                return FrameOutcome::Waiting;
            }
            self.hold_until = None;
        }
        if self.at_rest == Some((views.chosen, views.seen)) {
            return FrameOutcome::Unchanged;
        }
        match session.frame_from(&views.chosen, &views.seen) {
            Ok(frame) => {
                let is_final = frame.is_final && self.change.is_none();
                self.at_rest = is_final.then_some((views.chosen, views.seen));
                FrameOutcome::New(Box::new(frame))
            }
            Err(error) => FrameOutcome::Failed(format!("{error:#}")),
        }
    }
}

impl State {
    fn open(file: &Arc<Forest>, settings: &Settings, device: &Device, size: [u32; 2]) -> Self {
        let (file, options) = (Arc::clone(file), device.options(settings, size));
        match Job::start("esker-session", move || Session::open(file, options)) {
            Ok(opening) => Self::Opening(opening),
            Err(error) => Self::Failed(format!("{error:#}")),
        }
    }
}
