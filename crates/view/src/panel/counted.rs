//! The histogram of what colours the points, or of the values of an attribute, which a thread
//! counts since that reads the disk.

use eframe::egui::Context;
use esker_engine::Forest;
use esker_engine::cameras::histogram::{Histogram, histogram, value_histogram};
use esker_engine::cameras::vertical::Vertical;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread::JoinHandle;

/// The newest histogram that was wanted. Dropping it waits for the threads that count.
#[derive(Debug, Default)]
pub struct Counted {
    /// Whether it is of the values of an attribute, also of one whose values have colours of their
    /// own.
    is_of_values: bool,
    /// File, source of colours and vertical of the histogram.
    of: Option<(Arc<Forest>, String, Vertical)>,
    state: State,
    /// Threads that count, also those whose histogram is not wanted any more.
    threads: Vec<JoinHandle<()>>,
}

#[derive(Debug, Default)]
enum State {
    /// There is none, or it cannot be counted.
    #[default]
    None,
    Counting(Receiver<Option<Histogram>>),
    Known(Histogram),
}

impl Counted {
    /// Histograms of the values of attributes, whatever colours they have.
    pub fn of_values() -> Self {
        Self { is_of_values: true, of: None, state: State::None, threads: Vec::new() }
    }

    /// The histogram of a source of colours, once it is counted; repaints the window then.
    pub fn get(
        &mut self,
        ctx: &Context,
        (file, name, vertical): (&Arc<Forest>, &str, Vertical),
    ) -> Option<&Histogram> {
        let is_same = |(of, own, along): &(Arc<Forest>, String, Vertical)| {
            of.is_same(file) && own == name && *along == vertical
        };
        if !self.of.as_ref().is_some_and(is_same) {
            self.of = Some((Arc::clone(file), name.to_owned(), vertical));
            self.state = self.start(ctx, Arc::clone(file), name.to_owned(), vertical);
        }
        if let State::Counting(counted) = &self.state {
            match counted.try_recv() {
                Ok(Some(known)) => self.state = State::Known(known),
                Err(TryRecvError::Empty) => {}
                Ok(None) | Err(TryRecvError::Disconnected) => self.state = State::None,
            }
        }
        match &self.state {
            State::Known(known) => Some(known),
            State::None | State::Counting(_) => None,
        }
    }

    /// Whether a thread counts.
    pub fn is_counting(&self) -> bool {
        matches!(self.state, State::Counting(_))
    }

    fn start(
        &mut self,
        ctx: &Context,
        file: Arc<Forest>,
        name: String,
        vertical: Vertical,
    ) -> State {
        let (sender, counted) = sync_channel(1);
        let (ctx, is_of_values) = (ctx.clone(), self.is_of_values);
        let work = move || {
            // A file that cannot be read shows that when it is drawn. The receiver is gone if
            // another histogram is wanted.
            let counted = match is_of_values {
                true => value_histogram(&file, &name),
                false => histogram(&file, &name, vertical),
            };
            let _ = sender.send(counted.unwrap_or_default());
            ctx.request_repaint();
        };
        // Without a thread the channel is closed, and there is no histogram.
        let thread = std::thread::Builder::new().name("esker-histogram".into()).spawn(work);
        self.threads.retain(|thread| !thread.is_finished());
        self.threads.extend(thread);
        State::Counting(counted)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        for thread in self.threads.drain(..) {
            // A panic was already reported by the thread.
            let _ = thread.join();
        }
    }
}
