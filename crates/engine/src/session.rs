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
pub use crate::options::Options;
use crate::slots::DrawingMemory;
use crate::staging::{Landed, RUN_BYTES, Staging};
use crate::{info, system};
use anyhow::{Context, Result, bail, ensure};
use esker_format::{EskerFile, PlaneKind};
use esker_lod::{DepthFeedback, View, tiles_of};
use esker_render::{Picture, Renderer};
use esker_stream::{Cut, Needs, Status, Streamer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Waits of the render thread that count as stalls are longer than this, milliseconds.
const STALL_MS: f64 = 1.0;
/// How long the root may take to be read.
const ROOT_PATIENCE: Duration = Duration::from_secs(60);
/// Between two looks for landed runs where nothing is drawn meanwhile.
const NAP: Duration = Duration::from_micros(200);

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
            self.exchange(None)?;
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
        let Exchange { cut, uploaded_bytes, mut times } = self.exchange(Some(view))?;
        let drawing = Instant::now();
        self.draw(view, &cut)?;
        let [width, height] = [view.width as usize, view.height as usize];
        let depth = self
            .options
            .occlusion
            .then(|| DepthFeedback::new(view, &tiles_of(&self.picture.depth, width, height)))
            .flatten();
        times.draw_ms = ms(drawing);
        let mut talk = Talk::default();
        let status = talk.time(|| {
            if let (Some(streamer), Some(depth)) = (&self.streamer, depth) {
                streamer.feedback(depth);
            }
            self.status()
        });
        self.stalls += talk.stalls;
        times.talk_ms += talk.ms;
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
        loop {
            let Exchange { cut, uploaded_bytes, .. } = self.exchange(Some(view))?;
            if (cut.settled && cut.view == *view) || start.elapsed() > patience {
                return Ok(cut);
            }
            if uploaded_bytes == 0 {
                std::thread::sleep(NAP);
            }
        }
    }

    /// Drain, cut, upload: the order of the module's head. First the others are told of the view, where
    /// there is one.
    fn exchange(&mut self, view: Option<&View>) -> Result<Exchange> {
        let streamer = self.streamer.as_ref().context("the session has ended")?;
        let mut talk = Talk::default();
        let (landed, cut) = talk.time(|| {
            view.iter().for_each(|view| streamer.look(**view));
            let landed = drain(&self.landing, self.options.upload_bytes_a_frame);
            (landed, streamer.cut())
        });
        let copying = Instant::now();
        let mut uploaded_bytes = 0;
        for run in &landed {
            for t in &run.transfers {
                let bytes = run.bytes(t);
                self.memory.write(t.slot, t.slot_offset, bytes);
                uploaded_bytes += bytes.len() as u64;
            }
        }
        let upload_ms = ms(copying);
        talk.time(|| {
            for run in landed {
                run.transfers.iter().filter_map(|t| t.request).for_each(|r| streamer.uploaded(r));
                self.landing.free(run);
            }
        });
        self.stalls += talk.stalls;
        let times = Times { talk_ms: talk.ms, upload_ms, ..Times::default() };
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

/// Landed runs of at most so many bytes, and one where there is any.
fn drain(landing: &Staging, bytes_max: usize) -> Vec<Landed> {
    let runs = (bytes_max / RUN_BYTES).max(1);
    std::iter::from_fn(|| landing.take()).take(runs).collect()
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
