//! The streamer: starts the threads, passes messages on, joins the threads. What the render thread
//! calls never waits.

use crate::batch::{Batch, REQUESTS_MAX};
use crate::cache::Cache;
use crate::choose::Chooser;
use crate::cut::Cut;
use crate::error::StreamError;
use crate::identity::Identity;
use crate::landing::{Landing, RUN_BYTES_MIN, Transfer};
use crate::loader::{Loader, Report};
use crate::lod_thread::LodThread;
use crate::options::{Needs, Options};
use crate::planes::Planes;
use crate::pool::Pool;
use crate::queue::Queue;
use crate::retries::Retries;
use crate::shared::Shared;
use crate::status::Status;
use crossbeam_channel::{Receiver, Sender, bounded};
use esker_format::Forest;
use esker_format::forest::TREES_MAX;
use esker_lod::{DepthFeedback, View, Visible};
use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::thread::{Builder, JoinHandle};

/// Loader threads at most: a disk serves no more at once.
const LOADERS_MAX: usize = 64;

/// Streams one cloud. Dropping it stops and joins its threads: after at most one read and one patience
/// of the landing.
///
/// Each frame the render thread first drains landed runs, then takes [`Streamer::cut`], then uploads
/// what it drained and tells of it by [`Streamer::uploaded`], then draws. In this order no slot that is
/// drawn is ever overwritten by another node.
#[derive(Debug)]
pub struct Streamer {
    shared: Arc<Shared>,
    wake: Sender<()>,
    uploaded: Sender<u64>,
    /// Closed to stop those that wait for something to load.
    queue: Arc<Queue<Batch>>,
    /// Dropped to stop all others.
    stop: Option<Sender<Infallible>>,
    threads: Vec<JoinHandle<()>>,
}

/// Both ends of every channel between the threads of one streamer. All are bounded.
struct Channels {
    /// One is enough: it only says "look around".
    wake: (Sender<()>, Receiver<()>),
    /// Each request is told of once; roots may be asked for beside the others.
    uploaded: (Sender<u64>, Receiver<u64>),
    /// Each request is told of once; a changed file once a second.
    reports: (Sender<Report>, Receiver<Report>),
    stop: (Sender<Infallible>, Receiver<Infallible>),
}

impl Channels {
    fn new() -> Self {
        Self {
            wake: bounded(1),
            uploaded: bounded(REQUESTS_MAX + TREES_MAX),
            reports: bounded(REQUESTS_MAX + TREES_MAX + LOADERS_MAX),
            stop: bounded(0),
        }
    }
}

impl Streamer {
    /// Starts streaming: the roots first, and what views need once there is one.
    ///
    /// # Errors
    /// Where the roots do not fit drawing memory, the landing's runs are too short, or the system
    /// refuses a thread.
    pub fn start<L: Landing>(
        forest: Arc<Forest>,
        landing: Arc<L>,
        options: Options,
        needs: Needs,
    ) -> Result<Self, StreamError> {
        let run_bytes = landing.run_bytes();
        if run_bytes < RUN_BYTES_MIN || !run_bytes.is_multiple_of(Transfer::ALIGNMENT) {
            return Err(StreamError::Runs(run_bytes));
        }
        let loaders = options.loaders.clamp(1, LOADERS_MAX);
        let planes = Planes { forest: Arc::clone(&forest), shown: Arc::clone(&options.shown) };
        let shared = Arc::new(Shared::new(&needs));
        let channels = Channels::new();
        let queue = Arc::new(Queue::new());
        let chooser = chooser(&planes, &shared, Arc::clone(&queue), options, needs, run_bytes);
        chooser.check_roots(&chooser.needs)?;
        let lod = LodThread {
            chooser,
            wake: channels.wake.1,
            uploaded: channels.uploaded.1,
            reports: channels.reports.1,
            stop: channels.stop.1.clone(),
            status: Status::default(),
            told: 0,
            is_fed: false,
        };
        let mut streamer = Self {
            shared: Arc::clone(&shared),
            wake: channels.wake.0.clone(),
            uploaded: channels.uploaded.0,
            queue: Arc::clone(&queue),
            stop: Some(channels.stop.0),
            threads: Vec::with_capacity(loaders + 1),
        };
        streamer.thread("esker-lod".into(), move || lod.run())?;
        let identity = Arc::new(Identity::new(forest));
        for i in 0..loaders {
            let loader = Loader {
                planes: planes.clone(),
                landing: Arc::clone(&landing),
                shared: Arc::clone(&shared),
                identity: Arc::clone(&identity),
                queue: Arc::clone(&queue),
                reports: channels.reports.0.clone(),
                wake: channels.wake.0.clone(),
                stop: channels.stop.1.clone(),
            };
            streamer.thread(format!("esker-load-{i}"), move || loader.run())?;
        }
        Ok(streamer)
    }

    fn thread(
        &mut self,
        name: String,
        run: impl FnOnce() + Send + 'static,
    ) -> Result<(), StreamError> {
        let thread = Builder::new().name(name.clone()).spawn(run);
        self.threads.push(thread.map_err(|source| StreamError::Thread { name, source })?);
        Ok(())
    }

    /// Looks from here; replaces the view before. Never waits.
    pub fn look(&self, view: View) {
        self.shared.visible.store(Some(Arc::new(Visible::new(&view, None))));
        self.shared.view.put(view);
        self.nudge();
    }

    /// Changes which planes are drawn. Cuts keep the planes before until the roots have the new ones.
    /// Where they would not fit, [`Status::fault`] says so and nothing changes. Never waits.
    pub fn need(&self, needs: Needs) {
        self.shared.needs.put(needs);
        self.tell();
    }

    /// Tells what a finished frame hides; used by the choices that follow, where `Options::occlusion`
    /// is set. Never waits.
    pub fn feedback(&self, feedback: DepthFeedback) {
        self.shared.feedback.put(feedback);
        self.tell();
    }

    /// What to draw: empty until a root is there, never after that where a root is in view. Never
    /// waits. To be taken after the landed runs of the frame have been drained.
    pub fn cut(&self) -> Arc<Cut> {
        self.shared.front.load_full()
    }

    /// Whether cuts that are taken from now on were chosen with all that was told by [`Streamer::need`] and [`Streamer::feedback`]
    /// in mind: else a cut may be called settled though it is about to change. Never waits.
    pub fn has_taken_in(&self) -> bool {
        self.shared.taken_in.load(SeqCst) == self.shared.told.load(SeqCst)
    }

    /// Tells that a request ([`Transfer::request`]) is uploaded. Never waits: there is room for all
    /// requests under way.
    pub fn uploaded(&self, request: u64) {
        // Full only where requests are told of that never were.
        let _ = self.uploaded.try_send(request);
    }

    /// What streaming is at. Never waits.
    pub fn status(&self) -> Status {
        self.shared.status()
    }

    /// Stops and joins all threads, as dropping does.
    pub fn stop(self) {}

    /// After something was put into a mailbox: who reads this number finds it there, or has taken it.
    fn tell(&self) {
        self.shared.told.fetch_add(1, SeqCst);
        self.nudge();
    }

    fn nudge(&self) {
        // Full: it has been nudged already.
        let _ = self.wake.try_send(());
    }
}

impl Drop for Streamer {
    fn drop(&mut self) {
        drop(self.stop.take());
        self.queue.close();
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so itself.
            let _ = thread.join();
        }
    }
}

fn chooser(
    planes: &Planes,
    shared: &Arc<Shared>,
    queue: Arc<Queue<Batch>>,
    options: Options,
    needs: Needs,
    run_bytes: usize,
) -> Chooser {
    let pool = Pool::new(options.drawing_bytes, options.page_bytes);
    Chooser {
        cache: Cache::new(planes.clone(), pool, options.nodes_max),
        spare_bytes: 0,
        options,
        planes: planes.clone(),
        shared: Arc::clone(shared),
        retries: Retries::default(),
        run_bytes,
        queue,
        asked: HashMap::new(),
        last_id: 0,
        epoch: 0,
        view: None,
        shown: needs.clone(),
        needs,
        feedback: None,
        drawn: Vec::new(),
        has_more: false,
    }
}
