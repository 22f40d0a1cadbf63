//! A session: one opened file that is looked at, frame by frame. It starts the threads that choose and
//! read (kanzok2015, section 3.2), is their render thread, and never waits for the disk. Views go in,
//! pictures come out; a window is not needed.
//!
//! **The order of a frame is what lets slots be reused**: landed runs are taken *first*, then the newest
//! cut, then the runs are copied into their slots, then the cut is drawn. A slot changes hands only after
//! a cut without its former owner was published, and what lands in it was asked for after that: so the
//! cut taken after the run cannot draw the former owner from bytes of the new one. And the new owner is
//! in no cut before the streamer was told that its last byte is in place.

use crate::budget::Shares;
use crate::colour::{Colouring, colouring};
use crate::drawing::{draw_node, frame};
use crate::slots::DrawingMemory;
use crate::staging::{Landed, RUN_BYTES, Staging};
use crate::{info, system};
use anyhow::{Context, Result, bail, ensure};
use esker_format::{EskerFile, PlaneKind};
use esker_lod::{DepthFeedback, View, tiles_of};
use esker_render::{Method, Picture, Renderer};
use esker_stream::{Cut, Needs, Priority, Status, Streamer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Waits of the render thread that count as stalls are longer than this, milliseconds.
const STALL_MS: f64 = 1.0;
/// How long the root may take to be read.
const ROOT_PATIENCE: Duration = Duration::from_secs(60);
/// Between two looks for landed runs where nothing is drawn meanwhile.
const NAP: Duration = Duration::from_micros(200);

/// What a session may cost and how it draws.
#[derive(Clone, Debug)]
pub struct Options {
    /// Bytes of drawing memory.
    pub budget_gpu_bytes: u64,
    /// Bytes of main memory: table, statistics, staging, the renderer's buffers.
    pub budget_ram_bytes: u64,
    /// Width and height of the largest picture, pixels.
    pub size: [u32; 2],
    /// Points alone, or surfaces.
    pub method: Method,
    /// Where colours come from; the best there is where not said.
    pub colour_by: Option<String>,
    /// Points drawn at most.
    pub points_budget: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Whether what is hidden is left out.
    pub occlusion: bool,
    /// Which missing node is read first.
    pub priority: Priority,
    /// Reads in flight.
    pub loaders: usize,
    /// Nodes resident at most.
    pub nodes_max: usize,
    /// Runs of staging; what the budget allows where not said.
    pub runs: Option<usize>,
    /// Bytes copied to drawing memory in a frame, beyond the first run.
    pub upload_bytes_a_frame: usize,
}

impl Default for Options {
    fn default() -> Self {
        let stream = esker_stream::Options::default();
        Self {
            budget_gpu_bytes: 512 << 20,
            budget_ram_bytes: 1 << 30,
            size: [1024, 1024],
            method: Method::PullPush,
            colour_by: None,
            points_budget: stream.points_budget,
            target_spacing_px: stream.target_spacing_px,
            occlusion: stream.occlusion,
            priority: stream.priority,
            loaders: stream.loaders,
            nodes_max: stream.nodes_max,
            runs: None,
            // About ten milliseconds of copying.
            upload_bytes_a_frame: 32 << 20,
        }
    }
}

/// A drawn frame.
#[derive(Debug)]
pub struct Frame<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// What is in it, and how it was chosen.
    pub cut: Arc<Cut>,
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
    /// Copying what landed.
    pub upload_ms: f64,
    /// Drawing, and taking the depth that hides things from the next choice.
    pub draw_ms: f64,
    /// All of it.
    pub total_ms: f64,
}

/// An opened file and the threads that stream it.
pub struct Session {
    file: Arc<EskerFile>,
    options: Options,
    colouring: Colouring,
    landing: Arc<Staging>,
    /// `None` only while it is dropped.
    streamer: Option<Streamer>,
    memory: DrawingMemory,
    renderer: Renderer,
    picture: Picture,
    stalls: u64,
}

impl Session {
    /// Opens a session on a file and waits until its root can be drawn, so that no frame is empty.
    ///
    /// # Errors
    /// Where a budget is too small (the least is told), the file has not what colours shall come from,
    /// a thread cannot be started, or the root cannot be read.
    pub fn open(file: Arc<EskerFile>, options: Options) -> Result<Self> {
        let shares = Shares::of(options.budget_ram_bytes, &file, options.size, options.runs)?;
        let colouring =
            colouring(&file, options.colour_by.as_deref(), info::bounds(file.metadata()))?;
        let memory = DrawingMemory::new(options.budget_gpu_bytes);
        let landing = Arc::new(Staging::new(shares.runs()));
        let stream = esker_stream::Options {
            drawing_bytes: options.budget_gpu_bytes,
            page_bytes: memory.page_bytes(),
            nodes_max: options.nodes_max,
            points_budget: options.points_budget,
            target_spacing_px: options.target_spacing_px,
            priority: options.priority,
            occlusion: options.occlusion,
            loaders: options.loaders,
        };
        let needs = Needs {
            colour: colouring.plane.map(|(kind, _)| kind),
            normals: file.layout().has(PlaneKind::Normal),
        };
        let streamer = Streamer::start(file.clone(), landing.clone(), stream, needs)?;
        let mut session = Self {
            file,
            options,
            colouring,
            landing,
            streamer: Some(streamer),
            memory,
            renderer: Renderer::default(),
            picture: Picture::default(),
            stalls: 0,
        };
        session.wait_for_root()?;
        Ok(session)
    }

    fn wait_for_root(&mut self) -> Result<()> {
        let start = Instant::now();
        while !self.file.table().nodes.is_empty() {
            self.exchange()?;
            let status = self.status();
            if status.nodes_resident > 0 {
                break;
            }
            let path = self.file.path().display();
            if status.nodes_failed > 0 {
                bail!("{}", status.fault.unwrap_or_else(|| format!("{path}: cannot be read")));
            }
            ensure!(
                start.elapsed() < ROOT_PATIENCE,
                "{path}: its first node was not read within {} s; is its disk there?",
                ROOT_PATIENCE.as_secs()
            );
            std::thread::sleep(NAP);
        }
        Ok(())
    }

    /// The file that is looked at.
    pub fn file(&self) -> &Arc<EskerFile> {
        &self.file
    }

    /// What streaming is at.
    pub fn status(&self) -> Status {
        self.streamer.as_ref().map(Streamer::status).unwrap_or_default()
    }

    /// How often the render thread waited for another thread, or the disk, for more than a millisecond.
    pub fn stalls(&self) -> u64 {
        self.stalls
    }

    /// Draws a frame, in the current rayon pool, of what is there at once, and tells the other threads
    /// what is looked at, so that later frames are finer.
    ///
    /// # Errors
    /// Where the view is no usable camera, or a larger picture than the budget was made for.
    pub fn frame(&mut self, view: &View) -> Result<Frame<'_>> {
        let [width, height] = self.options.size.map(u64::from);
        ensure!(
            u64::from(view.width) * u64::from(view.height) <= width * height,
            "a picture of {}x{} is larger than the {width}x{height} that the session was opened for",
            view.width,
            view.height
        );
        let start = Instant::now();
        self.look(view);
        let Exchange { cut, uploaded_bytes, mut times } = self.exchange()?;
        let drawing = Instant::now();
        self.draw(view, &cut)?;
        let [width, height] = [view.width as usize, view.height as usize];
        let depth = self
            .options
            .occlusion
            .then(|| DepthFeedback::new(view, &tiles_of(&self.picture.depth, width, height)))
            .flatten();
        times.draw_ms = ms(drawing);
        let talking = Instant::now();
        if let (Some(streamer), Some(depth)) = (&self.streamer, depth) {
            streamer.feedback(depth);
        }
        let status = self.status();
        times.talk_ms += ms(talking);
        times.total_ms = ms(start);
        Ok(Frame { picture: &self.picture, cut, status, times, uploaded_bytes })
    }

    /// Takes what lands for `view`, without drawing, until nothing more comes or `patience` is over. The
    /// newest cut.
    ///
    /// # Errors
    /// As [`Session::frame`].
    pub fn settle(&mut self, view: &View, patience: Duration) -> Result<Arc<Cut>> {
        let start = Instant::now();
        self.look(view);
        loop {
            let Exchange { cut, uploaded_bytes, .. } = self.exchange()?;
            if (cut.settled && cut.view == *view) || start.elapsed() > patience {
                return Ok(cut);
            }
            if uploaded_bytes == 0 {
                std::thread::sleep(NAP);
            }
        }
    }

    fn look(&self, view: &View) {
        if let Some(streamer) = &self.streamer {
            streamer.look(*view);
        }
    }

    /// Drain, cut, upload: the order of the module's head.
    fn exchange(&mut self) -> Result<Exchange> {
        let streamer = self.streamer.as_ref().context("the session has ended")?;
        let waits = system::waits_of_this_thread();
        let start = Instant::now();
        let landed = drain(&self.landing, self.options.upload_bytes_a_frame);
        let cut = streamer.cut();
        let mut times = Times { talk_ms: ms(start), ..Times::default() };
        let mut uploaded_bytes = 0;
        for run in landed {
            let copying = Instant::now();
            for t in &run.transfers {
                let bytes = run.bytes(t);
                self.memory.write(t.slot, t.slot_offset, bytes);
                uploaded_bytes += bytes.len() as u64;
            }
            times.upload_ms += ms(copying);
            let talking = Instant::now();
            run.transfers.iter().filter_map(|t| t.request).for_each(|r| streamer.uploaded(r));
            self.landing.free(run);
            times.talk_ms += ms(talking);
        }
        // A thread that was only put aside for others has not waited of its own accord.
        let waited = system::waits_of_this_thread() != waits || waits.is_none();
        self.stalls += u64::from(times.talk_ms > STALL_MS && waited);
        Ok(Exchange { cut, uploaded_bytes, times })
    }

    fn draw(&mut self, view: &View, cut: &Cut) -> Result<()> {
        let (file, memory) = (&self.file, &self.memory);
        let draws: Vec<_> = cut
            .nodes
            .iter()
            .enumerate()
            .map(|(entry, n)| {
                let node = &file.table().nodes[n.node as usize];
                let plane = |kind| n.slot(kind).map(|slot| memory.read(slot));
                draw_node(node, entry, n.prefix, &self.colouring, plane)
            })
            .collect();
        let frame = frame(file, view, &draws, &cut.octree, &self.colouring, self.options.method);
        self.renderer.render_into(&frame, &mut self.picture)?;
        Ok(())
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.landing.close();
        if let Some(streamer) = self.streamer.take() {
            streamer.stop();
        }
    }
}

/// What came of taking what landed.
struct Exchange {
    cut: Arc<Cut>,
    uploaded_bytes: u64,
    times: Times,
}

/// Landed runs of at most so many bytes, and one where there is any.
fn drain(landing: &Staging, bytes_max: usize) -> Vec<Landed> {
    let runs = (bytes_max / RUN_BYTES).max(1);
    std::iter::from_fn(|| landing.take()).take(runs).collect()
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
