//! What one thread leaves for another to find: only the newest counts, and nobody waits.

use arc_swap::ArcSwapOption;
use std::sync::Arc;

/// Room for one thing, which a newer one replaces.
#[derive(Debug)]
pub(crate) struct Mailbox<T>(ArcSwapOption<T>);

impl<T> Mailbox<T> {
    /// Leaves a thing.
    pub(crate) fn put(&self, thing: T) {
        self.0.store(Some(Arc::new(thing)));
    }

    /// Takes what was left last, if that has not been taken yet.
    pub(crate) fn take(&self) -> Option<Arc<T>> {
        self.0.swap(None)
    }
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self(ArcSwapOption::empty())
    }
}
