//! Something that is made on a thread of its own while the window goes on. Dropping it waits for
//! the thread.

use anyhow::{Context, Result};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread::JoinHandle;

/// Something that is being made on another thread.
pub struct Job<T> {
    result: Receiver<Result<T>>,
    thread: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> Job<T> {
    /// Starts to make something on a thread of this name.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(name: &str, make: impl FnOnce() -> Result<T> + Send + 'static) -> Result<Self> {
        let (sender, result) = sync_channel(1);
        let work = move || {
            // The receiver is gone if the window has closed; the result then ends here.
            let _ = sender.send(make());
        };
        let thread = std::thread::Builder::new()
            .name(name.into())
            .spawn(work)
            .with_context(|| format!("cannot start the thread {name}"))?;
        Ok(Self { result, thread: Some(thread) })
    }

    /// What was made, once it is; nothing follows it.
    pub fn poll(&mut self) -> Option<Result<T>> {
        match self.result.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(anyhow::anyhow!("a thread of the window has ended unexpectedly")))
            }
        }
    }
}

impl<T> Drop for Job<T> {
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            // A panic was already reported by the thread.
            let _ = thread.join();
        }
    }
}
