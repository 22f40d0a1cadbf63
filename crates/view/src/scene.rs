//! The session behind the picture, kept alive through changes: what it can change while it runs is
//! changed, for the rest it is closed and opened again on a thread of its own, while the last
//! picture stays. Never two sessions at once, so that budgets hold.

use crate::device::Device;
use crate::settings::Settings;
use anyhow::{Context, Result, bail};
use esker_engine::cameras::legend::Legend;
use esker_engine::draw::empty_picture;
use esker_engine::draw::options::Options;
use esker_engine::draw::session::{Frame, GpuBytes, Session};
use esker_engine::machine::backend::Drawer;
use esker_engine::{Cut, Forest, Picture, Status, View};
use glam::DVec2;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long nothing, or the last picture, may be shown while a new session loads what is looked at.
const HOLD: Duration = Duration::from_millis(1500);

/// A file that is looked at.
pub struct Scene {
    file: Arc<Forest>,
    settings: Settings,
    device: Device,
    /// The largest picture that the session may draw, pixels.
    size: [u32; 2],
    state: State,
    /// Until when a new session may load behind what is shown.
    hold: Option<Instant>,
    /// The view that was drawn last, once nothing more comes for it.
    at_rest: Option<(View, View)>,
    reopened: u64,
}

enum State {
    Opening(Opening),
    Running(Box<Session>),
    Failed(String),
}

/// A session that another thread opens.
struct Opening {
    session: Receiver<Result<Session>>,
    thread: Option<JoinHandle<()>>,
}

/// What a frame is to show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// What the cut is chosen for.
    pub chosen: View,
    /// Where it is seen from: the same, unless the cut is frozen.
    pub seen: View,
}

/// What came of a frame.
pub enum Shown<'a> {
    /// A new picture.
    New(Box<Frame<'a>>),
    /// The last one still holds.
    Same,
    /// There is none yet, or the last one stays while a session is opened.
    Waiting,
    /// The session cannot be opened, or not be drawn.
    Failed(String),
}

impl Scene {
    /// Opens a session; pictures of at most this size.
    pub fn new(file: Arc<Forest>, settings: Settings, device: Device, size: [u32; 2]) -> Self {
        let state = State::open(&file, &settings, &device, size);
        Self { file, settings, device, size, state, hold: None, at_rest: None, reopened: 0 }
    }

    /// The file.
    pub fn file(&self) -> &Arc<Forest> {
        &self.file
    }

    /// What it draws by.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What the colours mean; `None` where no session runs.
    pub fn legend(&self) -> Option<Legend> {
        match &self.state {
            State::Running(session) => Some(session.appearance().colouring.legend.clone()),
            _ => None,
        }
    }

    /// What streaming is at.
    pub fn status(&self) -> Status {
        match &self.state {
            State::Running(session) => session.status(),
            _ => Status::default(),
        }
    }

    /// Waits of the render thread for others.
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

    /// Whether the next frame would show something new.
    pub fn is_at_rest(&self, look: &Look) -> bool {
        self.at_rest == Some((look.chosen, look.seen)) && matches!(self.state, State::Running(_))
    }

    /// What draws, and why it is not a GPU where it is none; `None` where no session runs.
    pub fn drawer(&self) -> Option<&Drawer> {
        match &self.state {
            State::Running(session) => Some(session.drawer()),
            _ => None,
        }
    }

    /// Bytes of GPU buffers, where a GPU draws.
    pub fn gpu_bytes(&self) -> Option<GpuBytes> {
        match &self.state {
            State::Running(session) => session.gpu_bytes(),
            _ => None,
        }
    }

    /// Eye depth at a place of the newest finished frame's picture, coarsely; never waits.
    pub fn depth_at(&self, place: DVec2) -> Option<f64> {
        match &self.state {
            State::Running(session) => session.depth_at(place),
            _ => None,
        }
    }

    /// The last picture, in main memory; waits until it is finished.
    ///
    /// # Errors
    /// Where there is none.
    pub fn picture(&mut self) -> Result<Picture> {
        match &mut self.state {
            State::Running(session) => session.picture(),
            _ => bail!("no session draws"),
        }
    }

    /// Whether a session is being opened, or loads behind the last picture.
    pub fn is_waiting(&self) -> bool {
        matches!(self.state, State::Opening(_)) || self.hold.is_some()
    }

    /// Has the next frame drawn, even where nothing changed.
    pub fn disturb(&mut self) {
        self.at_rest = None;
    }

    /// Draws by other settings from here on.
    pub fn set(&mut self, settings: Settings) {
        if settings == self.settings {
            return;
        }
        let Settings { method, shines, .. } = settings;
        let is_method_alone = Settings { method, shines, ..self.settings.clone() } == settings;
        self.settings = settings;
        self.at_rest = None;
        match &mut self.state {
            State::Running(session) if is_method_alone => {
                session.set_method(method);
                session.set_shine(shines);
            }
            _ => self.reopen(),
        }
    }

    /// The largest picture is of this size from here on.
    pub fn resize(&mut self, size: [u32; 2]) {
        if size != self.size {
            self.size = size;
            self.reopen();
        }
    }

    /// The largest picture that can be drawn.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    fn reopen(&mut self) {
        // The old session ends before the new one takes its memory.
        self.state = State::Failed(String::new());
        self.state = State::open(&self.file, &self.settings, &self.device, self.size);
        self.hold = None;
        self.at_rest = None;
        self.reopened += 1;
    }

    /// Draws what is there, at once.
    pub fn frame(&mut self, look: &Look) -> Shown<'_> {
        if let State::Opening(opening) = &mut self.state {
            match opening.poll() {
                None => return Shown::Waiting,
                Some(Ok(session)) => {
                    self.state = State::Running(Box::new(session));
                    self.hold = Some(Instant::now() + HOLD);
                }
                Some(Err(error)) => self.state = State::Failed(format!("{error:#}")),
            }
        }
        let session = match &mut self.state {
            State::Running(session) => session,
            State::Failed(fault) => return Shown::Failed(fault.clone()),
            State::Opening(_) => return Shown::Waiting,
        };
        if let Some(until) = self.hold {
            let cut = session.settle(&look.chosen, Duration::ZERO);
            // The first picture shows whatever there is, later ones replace a whole one.
            let is_loading =
                |cut: &Cut| cut.nodes.is_empty() || (self.reopened > 0 && !cut.settled);
            let has_nodes = !self.file.table().nodes.is_empty();
            if has_nodes && cut.is_ok_and(|cut| is_loading(&cut)) && Instant::now() < until {
                return Shown::Waiting;
            }
            self.hold = None;
        }
        if self.at_rest == Some((look.chosen, look.seen)) {
            return Shown::Same;
        }
        match session.frame_from(&look.chosen, &look.seen) {
            Ok(frame) => {
                self.at_rest = frame.is_final.then_some((look.chosen, look.seen));
                Shown::New(Box::new(frame))
            }
            Err(error) => Shown::Failed(format!("{error:#}")),
        }
    }
}

impl State {
    fn open(file: &Arc<Forest>, settings: &Settings, device: &Device, size: [u32; 2]) -> Self {
        match Opening::start(Arc::clone(file), device.options(settings, size)) {
            Ok(opening) => Self::Opening(opening),
            Err(error) => Self::Failed(format!("{error:#}")),
        }
    }
}

impl Opening {
    fn start(file: Arc<Forest>, options: Options) -> Result<Self> {
        let (sender, session) = sync_channel(1);
        let work = move || {
            // Nobody listens once the window has closed; the session then ends here.
            let _ = sender.send(open(file, options));
        };
        let thread = std::thread::Builder::new()
            .name("esker-session".into())
            .spawn(work)
            .context("cannot start a thread to open the session")?;
        Ok(Self { session, thread: Some(thread) })
    }

    fn poll(&mut self) -> Option<Result<Session>> {
        match self.session.try_recv() {
            Ok(session) => Some(session),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(anyhow::anyhow!("the thread that opens the session has ended early")))
            }
        }
    }
}

/// Opens a session that has something to show.
fn open(file: Arc<Forest>, options: Options) -> Result<Session> {
    let session = Session::open(file, options)?;
    empty_picture::check_wanted(session.file(), &session.appearance().shown)?;
    Ok(session)
}

impl Drop for Opening {
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so itself.
            let _ = thread.join();
        }
    }
}
