//! A session: draws an open file, with the files that it names, frame by frame. It starts the
//! threads that choose and read (`kanzok2015`, section 3.2), is used by the render thread, and
//! never waits for the disk. It takes views and returns pictures, and needs no window.
//!
//! **The order of a frame allows slots to be reused**: landed runs are taken *first*, then the
//! newest cut; then the runs are copied into their slots, and the cut is drawn. A slot gets a new
//! owner only after a cut without the old one was published, and the bytes that land in it were
//! requested after that. So a cut that is taken after the run cannot draw the old owner from bytes
//! of the new one. And the new owner is in no cut before the streamer knows that its last byte is
//! in place. A GPU runs copies and passes in the order in which they are submitted, so the same
//! holds there for frames in flight.

use crate::cameras::boxes::Boxes;
use crate::cameras::legend::Legend;
use crate::draw::budget::{Shares, lit_size};
use crate::draw::frame::Appearance;
use crate::draw::method::Method;
pub use crate::draw::options::{Options, Settings};
use crate::draw::painter::{CpuPainter, FrameInput, GpuPainter, Painter};
pub use crate::draw::painter::{GpuBytes, Image};
use crate::light::settings::LightSettings;
use crate::light::status::LitStatus;
use crate::light::{check_built, gpu_refusal};
use crate::machine::backend::{Backend, Drawer};
use crate::machine::system;
use anyhow::{Context, Error, Result, bail, ensure};
use esker_format::{Forest, PlaneKind};
use esker_lod::{DepthFeedback, View};
use esker_render::inputs::camera::Camera;
use esker_render::{Dots, Picture, Stats};
use esker_stream::{Cut, Shown, Status, Streamer};
use glam::DVec2;
use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A wait of the render thread that is longer counts as a stall, milliseconds.
const STALL_MS: f64 = 1.0;
/// Longest time to read the roots.
const ROOTS_PATIENCE: Duration = Duration::from_secs(60);
/// Interval of checks for landed runs while nothing is drawn.
const NAP: Duration = Duration::from_micros(200);

/// A drawn frame.
#[derive(Debug)]
pub struct DrawnFrame<'a> {
    /// The picture.
    pub image: Image<'a>,
    /// Nodes in the picture, and how they were chosen.
    pub cut: Arc<Cut>,
    /// Whether the cut was chosen for the requested view.
    pub is_of_view: bool,
    /// Whether the next frame of this view would be the same: nothing more is loaded, and the nodes
    /// that are hidden are known.
    pub is_final: bool,
    /// State of the picture if it is lit.
    pub light: Option<LitStatus>,
    /// Statistics of the renderer: of this frame on the CPU, of the last finished one on a GPU.
    pub stats: Stats,
    /// State of streaming.
    pub status: Status,
    /// Durations.
    pub times: Times,
    /// Bytes copied to drawing memory.
    pub uploaded_bytes: u64,
}

/// Durations of the steps of a frame, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Exchange with the other threads, which should not wait.
    pub exchange_ms: f64,
    /// Copying landed runs; on a GPU, writing the commands for it.
    pub upload_ms: f64,
    /// Drawing, and taking the depth; on a GPU, writing the commands, and waiting if two frames are
    /// in flight.
    pub draw_ms: f64,
    /// The whole frame.
    pub total_ms: f64,
}

/// An open file and the threads that stream it.
pub struct Session {
    pub(super) file: Arc<Forest>,
    pub(super) options: Options,
    /// What is to be shown.
    pub(super) appearance: Appearance,
    /// Boxes of what is to be shown.
    pub(super) boxes: Boxes,
    /// Legend of the last picture, if its colours are those of depths.
    seen_legend: Option<Legend>,
    /// The same, for the cuts that show it.
    look: Arc<dyn Any + Send + Sync>,
    /// What the newest cut is drawn by: what it was chosen for.
    drawn: Appearance,
    /// The look of that cut.
    drawn_look: Arc<dyn Any + Send + Sync>,
    /// Whether its memory was shared out for exposure compensation.
    pub(super) had_exposure: bool,
    pub(super) shares: Shares,
    drawer: Drawer,
    /// Whether the largest picture is smaller than the requested one.
    is_smaller: bool,
    /// `None` only while the session is dropped or changes its backend.
    pub(super) running: Option<Running>,
    /// Depth of the last finished frame.
    depth: Option<DepthFeedback>,
    /// Consecutive frames of a settled view.
    pub(super) still: u32,
    stalls: u64,
}

impl Session {
    /// Opens a session on a file and waits until its roots can be drawn, so that no frame is empty.
    ///
    /// # Errors
    /// If a budget is too small (the message has the smallest possible one), the file lacks the
    /// source of colours, a thread cannot be started, a root cannot be read, or the user insists on
    /// a GPU and there is none.
    pub fn open(file: Arc<Forest>, mut options: Options) -> Result<Self> {
        // What an earlier session freed is in no budget of this one.
        system::give_back_freed_memory();
        options.settings.light = options.settings.light.measured(file.lattice());
        let appearance = Appearance::of(&file, &options.settings)?;
        let boxes = appearance.boxes(&file, &options.settings);
        let is_lit = options.settings.method == Method::Lit;
        if is_lit {
            check_built()?;
        }
        let (gpu, drawer) = options.backend.choose(&options.gpu, options.device.as_ref())?;
        let refusal = if is_lit { gpu_refusal(&options.settings.light) } else { None };
        let (gpu, drawer) = match refusal.filter(|_| gpu.is_some()) {
            Some(why) if options.backend == Backend::Gpu => bail!("{why}; {USE_CPU}"),
            Some(why) => (None, Drawer::cpu(why)),
            None => (gpu, drawer),
        };
        let wanted_size = options.size;
        if options.shrinks_lit && is_lit {
            options.size = lit_size(&file, &options, gpu.is_some());
        }
        let is_smaller = options.size != wanted_size;
        let shares = match &gpu {
            Some(_) => Shares::beside_gpu(&file, &options),
            None => Shares::of(&file, &options),
        };
        let (gpu, drawer, shares) = match shares {
            Err(fault) if gpu.is_some() && options.backend == Backend::Auto => {
                (None, Drawer::cpu(format!("{fault:#}")), Shares::of(&file, &options)?)
            }
            shares => (gpu, drawer, shares?),
        };
        let look: Arc<dyn Any + Send + Sync> = Arc::new(appearance.clone());
        let mut session = Self {
            file,
            had_exposure: options.settings.evens_exposure,
            options,
            drawn: appearance.clone(),
            drawn_look: Arc::clone(&look),
            look,
            appearance,
            boxes,
            seen_legend: None,
            shares,
            drawer,
            is_smaller,
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
        let painter = CpuPainter::new(self.options.settings.budget_gpu_bytes, self.shares.runs());
        self.start(Box::new(painter))
    }

    fn start(&mut self, painter: Box<dyn Painter>) -> Result<()> {
        let options = self.options.stream();
        let points_budget = self.points_budget();
        let surroundings = self.shares.lit.map(|(_, around)| around);
        let options = esker_stream::Options { points_budget, surroundings, ..options };
        let streamer = painter.start(self.file.clone(), options, self.shown())?;
        self.running = Some(Running { streamer: Some(streamer), painter });
        self.wait_for_roots()
    }

    /// Goes on with the CPU if a GPU has failed that the user did not insist on.
    fn fall_back(&mut self, fault: Error) -> Result<()> {
        if self.drawer.adapter.is_none() || self.options.backend != Backend::Auto {
            return Err(fault);
        }
        // The memory of the GPU is freed before that of the CPU is taken.
        self.running = None;
        self.drawer = Drawer::cpu(format!("{fault:#}"));
        self.shares = Shares::of(&self.file, &self.options)?;
        self.start_on_cpu()
    }

    /// Most points of a picture.
    pub(super) fn points_budget(&self) -> u64 {
        let points_max = self.shares.lit.map_or(u64::MAX, |(points_max, _)| points_max);
        self.options.settings.points_budget.min(points_max)
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

    /// The file, with the files that it names.
    pub fn file(&self) -> &Arc<Forest> {
        &self.file
    }

    /// Size of the largest picture, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.options.size
    }

    /// What draws, and why no GPU does. Changes if a GPU fails that the user did not insist on.
    pub fn drawer(&self) -> &Drawer {
        &self.drawer
    }

    /// State of streaming.
    pub fn status(&self) -> Status {
        let Some(running) = &self.running else { return Status::default() };
        let mut status = running.streamer.as_ref().map(Streamer::status).unwrap_or_default();
        if let Some(fault) = running.painter.shader_fault() {
            status.fault.get_or_insert_with(|| fault.to_owned());
        }
        status
    }

    /// Bytes of GPU buffers; `None` if the CPU draws.
    pub fn gpu_bytes(&self) -> Option<GpuBytes> {
        self.running.as_ref().and_then(|r| r.painter.gpu_bytes())
    }

    /// Number of times that the render thread waited for another thread, or the disk, for more than
    /// a millisecond.
    pub fn stalls(&self) -> u64 {
        self.stalls
    }

    /// Draws a frame of what is in memory, and publishes the view to the other threads, so that
    /// later frames are finer. The CPU renderer works in the current rayon pool. On a GPU the
    /// commands are submitted, and at most two frames are in flight.
    ///
    /// # Errors
    /// If the view is an invalid camera, or larger than the session was opened for; if a GPU fails
    /// that the user insists on.
    pub fn frame(&mut self, view: &View) -> Result<DrawnFrame<'_>> {
        self.frame_from(view, view)
    }

    /// Draws a frame like [`Session::frame`], of nodes that are chosen for the view `chosen`, seen
    /// from the view `seen`: shows a cut from outside.
    ///
    /// # Errors
    /// As for [`Session::frame`].
    pub fn frame_from(&mut self, chosen: &View, seen: &View) -> Result<DrawnFrame<'_>> {
        self.check(chosen)?;
        self.check(seen)?;
        let [chosen, seen] = &[chosen, seen].map(|view| self.appearance.drawn_view(view));
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
        // The first settled frame returns the depth that hides nodes, and the next one is drawn
        // without them.
        let is_final =
            self.still > painter.feedback_frames() + u32::from(self.options.settings.occlusion);
        let is_final = is_final && painter.is_converged();
        let (stats, light) = (painter.stats(), painter.light());
        let counters = &cut.counters;
        let withheld = counters.withheld + counters.shortened + counters.surroundings_withheld;
        let light = light.map(|light| LitStatus {
            is_bounded: withheld > 0,
            is_smaller: self.is_smaller,
            lacks_normals: !self.file.has(PlaneKind::Normal),
            ..light
        });
        Ok(DrawnFrame {
            image,
            cut,
            is_of_view,
            is_final,
            stats,
            light,
            status,
            times,
            uploaded_bytes,
        })
    }

    /// Draws by `method` from the next frame on. Returns false, and changes nothing, if that takes
    /// another session: those that light read the surroundings of the view too.
    pub fn set_method(&mut self, method: Method) -> bool {
        let is_lit = |method| method == Method::Lit;
        if is_lit(method) != is_lit(self.appearance.method) {
            return false;
        }
        self.options.settings.method = method;
        self.appearance.method = method;
        self.drawn.method = method;
        self.show();
        true
    }

    /// Lights lit pictures by `light` from the next frame on. Its meshes are those of the session.
    pub fn set_light(&mut self, light: LightSettings) {
        let before = self.shown().needs;
        self.options.settings.light = light.measured(self.file.lattice());
        if self.shown().needs != before {
            if self.shown().needs.classes.is_some() {
                self.set_look(self.appearance.clone().with_values());
            }
            self.show();
        }
    }

    /// Draws surfaces with or without highlights from the next frame on.
    pub fn set_shine(&mut self, shines: bool) {
        self.options.settings.shines = shines;
        self.appearance.shines = shines;
        self.drawn.shines = shines;
        self.still = 0;
    }

    /// Draws points alone as these dots from the next frame on.
    pub fn set_dots(&mut self, dots: Dots) {
        self.options.settings.dots = dots;
        self.appearance.dots = dots;
        self.drawn.dots = dots;
        self.still = 0;
    }

    /// Settings of the pictures to come.
    pub fn settings(&self) -> &Settings {
        &self.options.settings
    }

    /// What is to be shown, and how. Frames show it once its planes are loaded
    /// ([`Session::shows_newest`]).
    pub fn appearance(&self) -> &Appearance {
        &self.appearance
    }

    /// Boxes of what is to be shown, for cameras.
    pub fn boxes(&self) -> &Boxes {
        &self.boxes
    }

    /// Legend of the colours; that of depths is the one of the last picture.
    pub fn legend(&self) -> &Legend {
        let own = &self.appearance.colouring;
        self.seen_legend.as_ref().filter(|_| own.is_by_depth()).unwrap_or(&own.legend)
    }

    /// Whether frames show [`Session::appearance`]; before, they show what was set earlier.
    pub fn shows_newest(&self) -> bool {
        Arc::ptr_eq(&self.drawn_look, &self.look)
    }

    /// What cuts are to show.
    pub(super) fn shown(&self) -> Shown {
        let shown = self.appearance.shown_by(&self.file, &self.options.settings.light);
        Shown { look: Arc::clone(&self.look), ..shown }
    }

    /// Sets what is to be shown.
    pub(super) fn set_look(&mut self, appearance: Appearance) {
        self.look = Arc::new(appearance.clone());
        self.appearance = appearance;
    }

    /// Requests what is to be shown; planes that it does not need are evicted.
    pub(super) fn show(&mut self) {
        self.still = 0;
        self.drawn = self.drawn.drawn_as(&self.appearance);
        if let Some(streamer) = self.running.as_ref().and_then(|r| r.streamer.as_ref()) {
            streamer.show(self.shown());
        }
    }

    /// Takes over what the newest cut was chosen for.
    fn take_look(&mut self, cut: &Cut) {
        let look = &cut.shown.look;
        if !Arc::ptr_eq(look, &self.drawn_look)
            && let Some(appearance) = look.downcast_ref::<Appearance>()
        {
            self.drawn = appearance.drawn_as(&self.appearance);
            self.drawn_look = Arc::clone(look);
            self.still = 0;
        }
    }

    /// Coarse eye depth of the nearest surface at `place` of the picture (0 to 1 from its top left
    /// corner), from the last finished frame; never waits. `None` if there is no surface, and on
    /// the CPU without the depth test: its pictures have their depth.
    pub fn depth_at(&self, place: DVec2) -> Option<f64> {
        self.depth.as_ref()?.nearest_at(place)
    }

    /// Picture of the last frame in main memory, for screenshots; waits until it is finished.
    ///
    /// # Errors
    /// If no frame was drawn, or the GPU has failed.
    pub fn picture(&mut self) -> Result<Picture> {
        self.running()?.painter.picture()
    }

    /// Takes what lands for `view`, without drawing, until the view is settled or `patience` is
    /// over. Returns the newest cut.
    ///
    /// # Errors
    /// As for [`Session::frame`].
    pub fn settle(&mut self, view: &View, patience: Duration) -> Result<Arc<Cut>> {
        self.check(view)?;
        let view = &self.appearance.drawn_view(view);
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

    /// Refuses a view that cannot be drawn, so that any later fault is one of the backend.
    fn check(&self, view: &View) -> Result<()> {
        let shown = view.with_margin(0);
        let [width, height] = self.options.size.map(u64::from);
        ensure!(
            u64::from(shown.width) * u64::from(shown.height) <= width * height,
            "a picture of {}x{} is larger than the {width}x{height} that the session was opened for",
            shown.width,
            shown.height
        );
        Camera::new(view, self.file.metric())?;
        Ok(())
    }

    pub(super) fn running(&mut self) -> Result<&mut Running> {
        self.running.as_mut().context(ENDED)
    }

    /// Drains, takes the cut and uploads, in the order that the head of this file explains.
    /// Publishes `view` first, if there is one.
    fn exchange(&mut self, view: Option<&View>) -> Result<Exchange> {
        let bytes_max = self.options.upload_bytes_a_frame;
        let Running { streamer, painter } = self.running.as_mut().context(ENDED)?;
        let streamer = streamer.as_ref().context(ENDED)?;
        let mut timer = ExchangeTimer::default();
        let (is_settled, cut) = timer.time(|| {
            view.iter().for_each(|view| streamer.look(**view));
            painter.drain(bytes_max);
            let knows_all = streamer.has_taken_in();
            let cut = streamer.cut();
            (knows_all && cut.settled, cut)
        });
        let start = Instant::now();
        painter.free_beyond(cut.drawing_bytes);
        let uploaded_bytes = painter.upload()?;
        let upload_ms = ms(start);
        timer.time(|| painter.report_uploaded(&mut |request| streamer.uploaded(request)));
        self.stalls += timer.stalls;
        let times = Times { exchange_ms: timer.ms, upload_ms, ..Times::default() };
        self.take_look(&cut);
        // A tree that grows has a newer table with each cut.
        if !Arc::ptr_eq(&self.file, &cut.forest) {
            self.file = Arc::clone(&cut.forest);
        }
        Ok(Exchange { cut, is_settled, uploaded_bytes, times })
    }

    /// Draws a whole frame.
    fn draw(&mut self, chosen: &View, seen: &View) -> Result<Exchange> {
        let mut exchange = self.exchange(Some(chosen))?;
        let start = Instant::now();
        let colour = self.options.settings.colour_by.as_deref();
        let by_depth = self.drawn.seen(seen, &self.boxes, colour);
        self.seen_legend = by_depth.as_ref().map(|of| of.colouring.legend.clone());
        let Running { streamer, painter } = self.running.as_mut().context(ENDED)?;
        painter.draw(&FrameInput {
            file: &self.file,
            view: seen,
            cut: &exchange.cut,
            appearance: by_depth.as_ref().unwrap_or(&self.drawn),
            light: &self.options.settings.light,
            splats_max: self.shares.splats_max(),
        })?;
        let occlusion = self.options.settings.occlusion;
        let needs_depth = occlusion || self.drawer.adapter.is_some();
        let depth = needs_depth.then(|| painter.feedback()).flatten();
        self.depth = depth.clone().or(self.depth.take());
        // The depth seen from elsewhere hides nothing from the eye of the choice.
        // Neither does that of points that are no longer shown.
        let is_newest = Arc::ptr_eq(&self.drawn_look, &self.look);
        let depth = depth.filter(|_| occlusion && is_newest && chosen == seen);
        exchange.times.draw_ms = ms(start);
        let mut timer = ExchangeTimer::default();
        timer.time(|| {
            if let (Some(streamer), Some(depth)) = (&streamer, depth) {
                streamer.feedback(depth);
            }
        });
        self.stalls += timer.stalls;
        exchange.times.exchange_ms += timer.ms;
        Ok(exchange)
    }
}

/// What to do where a GPU does not draw.
const USE_CPU: &str = "draw it with --backend cpu";
/// Error of a session without threads.
const ENDED: &str = "the session has ended";

/// The threads, and the memory that they fill.
pub(super) struct Running {
    /// `None` only while the session is dropped.
    pub(super) streamer: Option<Streamer>,
    pub(super) painter: Box<dyn Painter>,
}

impl Drop for Running {
    fn drop(&mut self) {
        self.painter.close();
        // The threads return their runs before the memory is freed.
        if let Some(streamer) = self.streamer.take() {
            streamer.stop();
        }
    }
}

/// Result of an exchange with the other threads.
struct Exchange {
    cut: Arc<Cut>,
    /// Whether the view is settled.
    is_settled: bool,
    uploaded_bytes: u64,
    times: Times,
}

/// Durations of the exchanges of the render thread with other threads, and how often it waited.
#[derive(Default)]
struct ExchangeTimer {
    ms: f64,
    stalls: u64,
}

impl ExchangeTimer {
    fn time<T>(&mut self, exchange: impl FnOnce() -> T) -> T {
        let waits = system::waits_of_this_thread();
        let start = Instant::now();
        let result = exchange();
        let took = ms(start);
        self.ms += took;
        // A thread that was preempted has not waited.
        let waited = waits.is_none() || system::waits_of_this_thread() != waits;
        self.stalls += u64::from(took > STALL_MS && waited);
        result
    }
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
