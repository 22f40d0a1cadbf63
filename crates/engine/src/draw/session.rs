//! A session: an opened file, with those that it names, that is looked at, frame by frame. It
//! starts the threads that choose and read (kanzok2015, section 3.2), is their render thread, and
//! never waits for the disk. Views go in, pictures come out; a window is not needed.
//!
//! **The order of a frame is what lets slots be reused**: landed runs are taken *first*, then the
//! newest cut, then the runs are copied into their slots, then the cut is drawn. A slot changes
//! hands only after a cut without its former owner was published, and what lands in it was asked
//! for after that: so the cut taken after the run cannot draw the former owner from bytes of the
//! new one. And the new owner is in no cut before the streamer was told that its last byte is in
//! place. On a GPU copies and passes run in the order in which they were submitted, so the same
//! holds there, whatever is still in flight.

use crate::draw::budget::Shares;
use crate::draw::frame::Look;
pub use crate::draw::options::Options;
use crate::draw::painter::{CpuPainter, GpuPainter, Painter, Scene};
pub use crate::draw::painter::{GpuBytes, Image};
use crate::machine::backend::{Backend, Drawer};
use crate::machine::system;
use anyhow::{Context, Error, Result, bail, ensure};
use esker_format::Forest;
use esker_lod::{DepthFeedback, View};
use esker_render::inputs::camera::Camera;
use esker_render::{Method, Picture, Stats};
use esker_stream::{Cut, Status, Streamer};
use glam::DVec2;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Waits of the render thread that count as stalls are longer than this, milliseconds.
const STALL_MS: f64 = 1.0;
/// How long the roots may take to be read.
const ROOTS_PATIENCE: Duration = Duration::from_secs(60);
/// Between two looks for landed runs where nothing is drawn meanwhile.
const NAP: Duration = Duration::from_micros(200);

/// A drawn frame.
#[derive(Debug)]
pub struct Frame<'a> {
    /// The picture.
    pub image: Image<'a>,
    /// What is in it, and how it was chosen.
    pub cut: Arc<Cut>,
    /// Whether that is the one of the view that was asked for.
    pub is_of_view: bool,
    /// Whether the next frame of the same view would be the same: nothing more comes, and what this
    /// view hides is known.
    pub is_final: bool,
    /// What the renderer did: for this frame on the CPU, for the newest finished one on a GPU.
    pub stats: Stats,
    /// What streaming is at.
    pub status: Status,
    /// How long it took.
    pub times: Times,
    /// Bytes copied to drawing memory.
    pub uploaded_bytes: u64,
}

/// Milliseconds of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Talking to the other threads: no part of it should be waiting.
    pub talk_ms: f64,
    /// Copying what landed; on a GPU, writing the commands that do.
    pub upload_ms: f64,
    /// Drawing, and taking the depth that hides things from the next choice; on a GPU, writing the
    /// commands and waiting where two frames are in flight.
    pub draw_ms: f64,
    /// All of it.
    pub total_ms: f64,
}

/// An opened file and the threads that stream it.
pub struct Session {
    file: Arc<Forest>,
    options: Options,
    look: Look,
    shares: Shares,
    drawer: Drawer,
    /// `None` only while it is dropped or changes its backend.
    running: Option<Running>,
    /// Of the newest finished frame.
    depth: Option<DepthFeedback>,
    /// Frames in a row for whose view nothing more came.
    still: u32,
    stalls: u64,
}

impl Session {
    /// Opens a session on a file and waits until its roots can be drawn, so that no frame is empty.
    ///
    /// # Errors
    /// Where a budget is too small (the least is told), the file has not what colours shall come
    /// from, a thread cannot be started, a root cannot be read, or a GPU is asked for and cannot be
    /// had.
    pub fn open(file: Arc<Forest>, options: Options) -> Result<Self> {
        let shares = Shares::of(&file, &options)?;
        let Options { colour_by, filter, method, shines, evens_exposure, full, .. } = &options;
        let look = Look::new(&file, colour_by.as_deref(), filter, *method, *shines)?;
        let look = look.evened(&file, *evens_exposure)?;
        let look = if *full { look } else { look.compacted(&file) };
        let (gpu, drawer) = options.backend.choose(&options.gpu, options.device.as_ref())?;
        let mut session = Self {
            file,
            options,
            look,
            shares,
            drawer,
            running: None,
            depth: None,
            still: 0,
            stalls: 0,
        };
        let started = match gpu {
            Some(gpu) => GpuPainter::new(gpu, &session.file, &session.options)
                .and_then(|painter| session.start(Box::new(painter))),
            None => session.start_on_cpu(),
        };
        started.or_else(|fault| session.fall_back(fault))?;
        Ok(session)
    }

    fn start_on_cpu(&mut self) -> Result<()> {
        let painter = CpuPainter::new(self.options.budget_gpu_bytes, self.shares.runs());
        self.start(Box::new(painter))
    }

    fn start(&mut self, painter: Box<dyn Painter>) -> Result<()> {
        let shown = Arc::clone(&self.look.shown);
        let options = esker_stream::Options { filter: shown, ..self.options.stream() };
        let needs = self.look.needs(&self.file);
        let streamer = painter.start(self.file.clone(), options, needs)?;
        self.running = Some(Running { streamer: Some(streamer), painter });
        self.wait_for_roots()
    }

    /// Where a GPU has failed that the user did not insist on: goes on with the CPU.
    fn fall_back(&mut self, fault: Error) -> Result<()> {
        if self.drawer.adapter.is_none() || self.options.backend != Backend::Auto {
            return Err(fault);
        }
        // The GPU's memory goes before the CPU's comes.
        self.running = None;
        self.drawer = Drawer::cpu(format!("{fault:#}"));
        self.start_on_cpu()
    }

    fn wait_for_roots(&mut self) -> Result<()> {
        let start = Instant::now();
        let roots = self.file.table().roots().count();
        if roots == 0 {
            return Ok(());
        }
        loop {
            self.exchange(None)?;
            self.running()?.painter.flush()?;
            let status = self.status();
            if status.nodes_resident >= roots {
                return Ok(());
            }
            let path = self.file.path().display();
            if status.nodes_failed > 0 {
                bail!("{}", status.fault.unwrap_or_else(|| format!("{path}: cannot be read")));
            }
            ensure!(
                start.elapsed() < ROOTS_PATIENCE,
                "{path}: its first node was not read within {} s; is its disk there?",
                ROOTS_PATIENCE.as_secs()
            );
            std::thread::sleep(NAP);
        }
    }

    /// The file that is looked at, with those that it names.
    pub fn file(&self) -> &Arc<Forest> {
        &self.file
    }

    /// What draws, and why it is not a GPU where it is none. It changes where a GPU fails that the
    /// user did not insist on.
    pub fn drawer(&self) -> &Drawer {
        &self.drawer
    }

    /// What streaming is at.
    pub fn status(&self) -> Status {
        let Some(running) = &self.running else { return Status::default() };
        let mut status = running.streamer.as_ref().map(Streamer::status).unwrap_or_default();
        if let Some(fault) = running.painter.shader_fault() {
            status.fault.get_or_insert_with(|| fault.to_owned());
        }
        status
    }

    /// Bytes of GPU buffers; `None` where the CPU draws.
    pub fn gpu_bytes(&self) -> Option<GpuBytes> {
        self.running.as_ref().and_then(|r| r.painter.gpu_bytes())
    }

    /// How often the render thread waited for another thread, or the disk, for more than a
    /// millisecond.
    pub fn stalls(&self) -> u64 {
        self.stalls
    }

    /// Draws a frame of what is there at once, and tells the other threads what is looked at, so
    /// that later frames are finer. The CPU renderer works in the current rayon pool; on a GPU the
    /// commands are submitted, and at most two frames are in flight.
    ///
    /// # Errors
    /// Where the view is no usable camera, or a larger picture than the budget was made for; where
    /// a GPU fails that the user insists on.
    pub fn frame(&mut self, view: &View) -> Result<Frame<'_>> {
        self.frame_from(view, view)
    }

    /// As [`Session::frame`], but seen from elsewhere than it was chosen for: a cut looked at from
    /// outside.
    ///
    /// # Errors
    /// As [`Session::frame`].
    pub fn frame_from(&mut self, chosen: &View, seen: &View) -> Result<Frame<'_>> {
        self.check(chosen)?;
        self.check(seen)?;
        let [chosen, seen] = &[chosen, seen].map(|view| self.look.with_margin(&self.file, view));
        let start = Instant::now();
        let drawn = match self.draw(chosen, seen) {
            Ok(drawn) => drawn,
            Err(fault) => {
                self.fall_back(fault)?;
                self.draw(chosen, seen)?
            }
        };
        let Exchange { cut, is_settled, uploaded_bytes, mut times } = drawn;
        let status = self.status();
        times.total_ms = ms(start);
        let painter = &self.running.as_ref().context(ENDED)?.painter;
        let image = painter.image().context("nothing was drawn")?;
        let is_of_view = cut.view == *chosen;
        self.still = if is_settled && is_of_view { self.still.saturating_add(1) } else { 0 };
        // The first such frame tells what it hides, and the next one has that taken in.
        let is_final = self.still > painter.feedback_frames() + u32::from(self.options.occlusion);
        let stats = painter.stats();
        Ok(Frame { image, cut, is_of_view, is_final, stats, status, times, uploaded_bytes })
    }

    /// Draws points alone, or surfaces, from the next frame on.
    pub fn set_method(&mut self, method: Method) {
        self.look.method = method;
        self.look_anew();
    }

    /// Draws surfaces with highlights or without, from the next frame on.
    pub fn set_shine(&mut self, shines: bool) {
        self.look.shines = shines;
    }

    /// What is shown, and how.
    pub fn look(&self) -> &Look {
        &self.look
    }

    /// Asks for the planes that the look now needs; what it needs no more leaves.
    fn look_anew(&self) {
        let streamer = self.running.as_ref().and_then(|r| r.streamer.as_ref());
        if let Some(streamer) = streamer {
            streamer.need(self.look.needs(&self.file));
        }
    }

    /// Eye depth of the nearest thing about a place of the picture (0 to 1 from its top left
    /// corner), from the depth of the newest finished frame, coarsely; never waits. `None` where
    /// nothing is, and on the CPU where nothing that is hidden is left out: its pictures have their
    /// depth.
    pub fn depth_at(&self, place: DVec2) -> Option<f64> {
        self.depth.as_ref()?.nearest_at(place)
    }

    /// The picture of the last frame, in main memory; waits until it is finished. For screenshots.
    ///
    /// # Errors
    /// Where no frame was drawn, or the GPU has failed.
    pub fn picture(&mut self) -> Result<Picture> {
        self.running()?.painter.picture()
    }

    /// Takes what lands for `view`, without drawing, until nothing more comes or `patience` is
    /// over. The newest cut.
    ///
    /// # Errors
    /// As [`Session::frame`].
    pub fn settle(&mut self, view: &View, patience: Duration) -> Result<Arc<Cut>> {
        self.check(view)?;
        let view = &self.look.with_margin(&self.file, view);
        let start = Instant::now();
        loop {
            let taken = self.exchange(Some(view)).and_then(|exchange| {
                self.running()?.painter.flush()?;
                Ok(exchange)
            });
            let Exchange { cut, is_settled, uploaded_bytes, .. } = match taken {
                Ok(exchange) => exchange,
                Err(fault) => {
                    self.fall_back(fault)?;
                    continue;
                }
            };
            if (is_settled && cut.view == *view) || start.elapsed() > patience {
                return Ok(cut);
            }
            if uploaded_bytes == 0 {
                std::thread::sleep(NAP);
            }
        }
    }

    /// Refuses what cannot be drawn, so that whatever else fails is a fault of the backend.
    fn check(&self, view: &View) -> Result<()> {
        let shown = view.with_margin(0);
        let [width, height] = self.options.size.map(u64::from);
        ensure!(
            u64::from(shown.width) * u64::from(shown.height) <= width * height,
            "a picture of {}x{} is larger than the {width}x{height} that the session was opened for",
            shown.width,
            shown.height
        );
        Camera::new(view, self.file.lattice())?;
        Ok(())
    }

    fn running(&mut self) -> Result<&mut Running> {
        self.running.as_mut().context(ENDED)
    }

    /// Drain, cut, upload: the order of the module's head. First the others are told of the view,
    /// where there is one.
    fn exchange(&mut self, view: Option<&View>) -> Result<Exchange> {
        let bytes_max = self.options.upload_bytes_a_frame;
        let Running { streamer, painter } = self.running.as_mut().context(ENDED)?;
        let streamer = streamer.as_ref().context(ENDED)?;
        let mut talk = Talk::default();
        let (is_settled, cut) = talk.time(|| {
            view.iter().for_each(|view| streamer.look(**view));
            painter.drain(bytes_max);
            let knows_all = streamer.has_taken_in();
            let cut = streamer.cut();
            (knows_all && cut.settled, cut)
        });
        let copying = Instant::now();
        let uploaded_bytes = painter.upload()?;
        let upload_ms = ms(copying);
        talk.time(|| painter.tell(&mut |request| streamer.uploaded(request)));
        self.stalls += talk.stalls;
        let times = Times { talk_ms: talk.ms, upload_ms, ..Times::default() };
        Ok(Exchange { cut, is_settled, uploaded_bytes, times })
    }

    /// A whole frame.
    fn draw(&mut self, chosen: &View, seen: &View) -> Result<Exchange> {
        let mut exchange = self.exchange(Some(chosen))?;
        let drawing = Instant::now();
        let Running { streamer, painter } = self.running.as_mut().context(ENDED)?;
        painter.draw(&Scene {
            file: &self.file,
            view: seen,
            cut: &exchange.cut,
            look: &self.look,
        })?;
        let is_asked = self.options.occlusion || self.drawer.adapter.is_some();
        let depth = is_asked.then(|| painter.feedback()).flatten();
        self.depth = depth.clone().or(self.depth.take());
        // What is seen from elsewhere hides nothing from the eye of the choice.
        let depth = depth.filter(|_| self.options.occlusion && chosen == seen);
        exchange.times.draw_ms = ms(drawing);
        let mut talk = Talk::default();
        talk.time(|| {
            if let (Some(streamer), Some(depth)) = (&streamer, depth) {
                streamer.feedback(depth);
            }
        });
        self.stalls += talk.stalls;
        exchange.times.talk_ms += talk.ms;
        Ok(exchange)
    }
}

/// Why there is nothing to talk to.
const ENDED: &str = "the session has ended";

/// The threads and the memory that they fill.
struct Running {
    /// `None` only while it is dropped.
    streamer: Option<Streamer>,
    painter: Box<dyn Painter>,
}

impl Drop for Running {
    fn drop(&mut self) {
        self.painter.close();
        // Its threads give their runs back before the memory goes.
        if let Some(streamer) = self.streamer.take() {
            streamer.stop();
        }
    }
}

/// What came of taking what landed.
struct Exchange {
    cut: Arc<Cut>,
    /// Whether nothing more comes for its view.
    is_settled: bool,
    uploaded_bytes: u64,
    times: Times,
}

/// Times what the render thread says to the others, and notes where it waited.
#[derive(Default)]
struct Talk {
    ms: f64,
    stalls: u64,
}

impl Talk {
    fn time<T>(&mut self, talk: impl FnOnce() -> T) -> T {
        let waits = system::waits_of_this_thread();
        let start = Instant::now();
        let said = talk();
        let took = ms(start);
        self.ms += took;
        // A thread that was only put aside for others has not waited of its own accord.
        let waited = waits.is_none() || system::waits_of_this_thread() != waits;
        self.stalls += u64::from(took > STALL_MS && waited);
        said
    }
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
