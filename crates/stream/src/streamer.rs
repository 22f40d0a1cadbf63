//! The streamer: starts the threads, passes messages to them and joins them. No function that the
//! render thread calls waits. The crate's documentation lists what each thread may touch.

use crate::batch::{Batch, REQUESTS_MAX};
use crate::cache::Cache;
use crate::choose::{Chooser, check_roots};
use crate::cut::Cut;
use crate::error::StreamError;
use crate::identity::Identity;
use crate::landing::{Landing, RUN_BYTES_MIN, Transfer};
use crate::loader::{Loader, Report};
use crate::lod_thread::LodThread;
use crate::options::{Limits, Options, Shown};
use crate::planes::{Planes, Rules};
use crate::pool::Pool;
use crate::queue::Queue;
use crate::rate::Rate;
use crate::retries::Retries;
use crate::shared::Shared;
use crate::status::Status;
use crossbeam_channel::{Receiver, Sender, bounded};
use esker_format::{Forest, TREES_MAX};
use esker_lod::{DepthFeedback, Surroundings, View, Visible};
use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

/// Greatest number of loader threads: a disk serves no more requests at once.
const LOADERS_MAX: usize = 64;

/// Streams one cloud. Dropping a streamer stops and joins its threads, which takes at most one read
/// and one wait for a run of the landing.
///
/// In each frame the render thread first drains landed runs, then takes [`Streamer::cut`], then
/// uploads the drained runs and reports them by [`Streamer::uploaded`], then draws. In this order
/// no slot that is drawn is ever overwritten by another node.
#[derive(Debug)]
pub struct Streamer {
    shared: Arc<Shared>,
    forest: Arc<Forest>,
    /// Options at the start.
    options: Options,
    wake: Sender<()>,
    uploaded: Sender<u64>,
    /// Closed on stopping, which ends the loaders that wait for a batch.
    queue: Arc<Queue<Batch>>,
    /// Dropped on stopping, which ends all other waits.
    stop: Option<Sender<Infallible>>,
    threads: Vec<JoinHandle<()>>,
}

/// Both ends of the channels between the threads of one streamer. All of them are bounded.
struct Channels {
    /// Capacity 1 is enough: the message only says that something has changed.
    wake: (Sender<()>, Receiver<()>),
    /// Each request is reported once; requests for roots may come on top of the others.
    uploaded: (Sender<u64>, Receiver<u64>),
    /// Each request is reported once; a changed file is reported once a second.
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
    /// Starts streaming: first the roots, then the nodes of the first view.
    ///
    /// # Errors
    /// If the roots do not fit drawing memory, the landing's runs are too short, or the system
    /// refuses a thread.
    pub fn start<L: Landing>(
        forest: Arc<Forest>,
        landing: Arc<L>,
        options: Options,
        shown: impl Into<Shown>,
    ) -> Result<Self, StreamError> {
        let run_bytes = landing.run_bytes();
        if run_bytes < RUN_BYTES_MIN || !run_bytes.is_multiple_of(Transfer::ALIGNMENT) {
            return Err(StreamError::Runs(run_bytes));
        }
        let wanted = options.loaders.max(forest.readers().unwrap_or(0));
        let loaders = wanted.clamp(1, LOADERS_MAX);
        let rate = options.read_bytes_a_second.map(|rate| Arc::new(Rate::new(rate)));
        let shown = Arc::new(shown.into());
        let mut rules = Rules::default();
        let filter = Arc::clone(&shown.filter);
        let planes =
            Planes { rules: rules.of(&filter), ..Planes::read_by(Arc::clone(&forest), filter) };
        check_roots(&[(&planes, &shown.needs)], &options)?;
        let shared = Arc::new(Shared::new(&forest, &shown));
        let started = options.clone();
        let channels = Channels::new();
        let queue = Arc::new(Queue::new());
        let chooser = Chooser {
            rules,
            run_bytes,
            ..chooser(&planes, &shared, Arc::clone(&queue), options, shown)
        };
        let lod = LodThread {
            chooser,
            wake: channels.wake.1,
            uploaded: channels.uploaded.1,
            reports: channels.reports.1,
            stop: channels.stop.1.clone(),
            status: Status::default(),
            inputs: 0,
            is_fed: false,
        };
        let mut streamer = Self {
            shared: Arc::clone(&shared),
            forest: Arc::clone(&forest),
            options: started,
            wake: channels.wake.0.clone(),
            uploaded: channels.uploaded.0,
            queue: Arc::clone(&queue),
            stop: Some(channels.stop.0),
            threads: Vec::with_capacity(loaders + 1),
        };
        streamer.spawn("esker-lod".into(), move || lod.run())?;
        let identity = Arc::new(Identity::new(forest));
        for i in 0..loaders {
            let loader = Loader {
                landing: Arc::clone(&landing),
                shared: Arc::clone(&shared),
                identity: Arc::clone(&identity),
                queue: Arc::clone(&queue),
                rate: rate.clone(),
                reports: channels.reports.0.clone(),
                wake: channels.wake.0.clone(),
                stop: channels.stop.1.clone(),
            };
            streamer.spawn(format!("esker-load-{i}"), move || loader.run())?;
        }
        Ok(streamer)
    }

    fn spawn(
        &mut self,
        name: String,
        run: impl FnOnce() + Send + 'static,
    ) -> Result<(), StreamError> {
        let thread = Builder::new().name(name.clone()).spawn(run);
        self.threads.push(thread.map_err(|source| StreamError::Thread { name, source })?);
        Ok(())
    }

    /// Sets the view, which replaces the one before. Never waits.
    pub fn look(&self, view: View) {
        self.shared.visible.store(Some(Arc::new(Visible::new(&view, None))));
        self.shared.view.put(view);
        self.wake_lod_thread();
    }

    /// Changes what is shown. What is resident and not changed by it stays. Cuts show what they did
    /// ([`Cut::shown`]) until their nodes have the new planes, or the roots have them and memory is
    /// full. If the new planes of the roots do not fit, [`Status::fault`] says so and nothing
    /// changes. Never waits.
    pub fn show(&self, shown: impl Into<Shown>) {
        self.shared.shown.put(Arc::new(shown.into()));
        self.count_input();
    }

    /// Changes the budgets. Below a smaller budget of drawing memory, slots that lie beyond it are
    /// freed, and [`Cut::drawing_bytes`] says when; the caller has memory for a larger one before
    /// the call. If it is too small for the roots, [`Status::fault`] says so and nothing changes.
    /// Never waits.
    pub fn limit(&self, limits: Limits) {
        self.shared.limits.put(limits);
        self.count_input();
    }

    /// Changes what is loaded around the picture for light ([`Cut::surroundings`]); `None` switches
    /// it off, which frees its memory. The picture stays the same, and its nodes are read first.
    /// Never waits.
    pub fn surround(&self, surroundings: Option<Surroundings>) {
        self.shared.surroundings.put(surroundings);
        self.count_input();
    }

    /// Checks that the planes of the roots for all of `shown` fit drawing memory at the same time:
    /// for [`Streamer::show`] or [`Streamer::limit`], those of the newest cut, and what is to be
    /// shown.
    ///
    /// # Errors
    /// If they do not fit.
    pub fn check(&self, shown: &[&Shown], limits: &Limits) -> Result<(), StreamError> {
        let mut options = self.options.clone();
        options.limit(limits);
        let mut rules = Rules::default();
        let planes: Vec<_> = shown
            .iter()
            .map(|shown| {
                let filter = Arc::clone(&shown.filter);
                let rules = rules.of(&filter);
                Planes { rules, ..Planes::read_by(Arc::clone(&self.forest), filter) }
            })
            .collect();
        let needs = shown.iter().map(|shown| &shown.needs);
        check_roots(&planes.iter().zip(needs).collect::<Vec<_>>(), &options)
    }

    /// Passes on the depth of a finished frame. Later choices cull what it hides, if
    /// `Options::occlusion` is set. Never waits.
    pub fn feedback(&self, feedback: DepthFeedback) {
        self.shared.feedback.put(feedback);
        self.count_input();
    }

    /// The cut to draw: empty until a root is resident, and later only if no root is in view. Never
    /// waits. The caller takes the cut after it has drained the landed runs of the frame.
    pub fn cut(&self) -> Arc<Cut> {
        self.shared.front.load_full()
    }

    /// Whether the current cut was chosen with everything passed to [`Streamer::show`],
    /// [`Streamer::limit`], [`Streamer::surround`] and [`Streamer::feedback`]. Otherwise a cut may
    /// be marked as settled although it is about to change. Never waits.
    pub fn has_taken_in(&self) -> bool {
        self.shared.inputs_used.load(SeqCst) == self.shared.inputs.load(SeqCst)
    }

    /// Reports that a request ([`Transfer::request`]) is uploaded. Never waits: the channel has
    /// room for all requests in progress.
    pub fn uploaded(&self, request: u64) {
        // The channel is full only if requests are reported that were never made.
        let _ = self.uploaded.try_send(request);
    }

    /// Snapshot of the streamer's state. Never waits.
    pub fn status(&self) -> Status {
        self.shared.status()
    }

    /// Stops and joins all threads, as dropping does.
    pub fn stop(self) {}

    /// Counts an input after it was put into a mailbox: a thread that reads the new count finds the
    /// input in the mailbox, or has taken it already.
    fn count_input(&self) {
        self.shared.inputs.fetch_add(1, SeqCst);
        self.wake_lod_thread();
    }

    fn wake_lod_thread(&self) {
        // A full channel means that the LOD thread is woken already.
        let _ = self.wake.try_send(());
    }
}

/// Pause between two interrupts of the reads of threads that are to end: each may begin some more.
const INTERRUPT_EVERY: Duration = Duration::from_millis(5);

impl Drop for Streamer {
    fn drop(&mut self) {
        drop(self.stop.take());
        self.queue.close();
        for thread in self.threads.drain(..) {
            // A read from a server that stalls would be waited for.
            while self.forest.readers().is_some() && !thread.is_finished() {
                self.forest.interrupt();
                std::thread::sleep(INTERRUPT_EVERY);
            }
            // A thread that panicked has printed its message itself.
            let _ = thread.join();
        }
    }
}

fn chooser(
    planes: &Planes,
    shared: &Arc<Shared>,
    queue: Arc<Queue<Batch>>,
    options: Options,
    shown: Arc<Shown>,
) -> Chooser {
    let pool = Pool::new(options.drawing_bytes, options.page_bytes);
    Chooser {
        cache: Cache::new(Arc::clone(&planes.forest), pool, options.nodes_max),
        spare_bytes: 0,
        surroundings: options.surroundings,
        spare_around_bytes: 0,
        extent_bytes: options.drawing_bytes,
        options,
        planes: planes.clone(),
        newest_planes: planes.clone(),
        rules: Rules::default(),
        shared: Arc::clone(shared),
        retries: Retries::default(),
        run_bytes: RUN_BYTES_MIN,
        queue,
        requests: HashMap::new(),
        last_id: 0,
        epoch: 0,
        view: None,
        newest: Arc::clone(&shown),
        shown,
        is_full: false,
        feedback: None,
        drawn: Vec::new(),
        has_more: false,
    }
}
