//! A mailbox from one thread to another, which holds only the newest value. Neither side waits.

use arc_swap::ArcSwapOption;
use std::sync::Arc;

/// Holds one value, which a newer one replaces.
#[derive(Debug)]
pub(crate) struct Mailbox<T>(ArcSwapOption<T>);

impl<T> Mailbox<T> {
    /// Replaces the value.
    pub(crate) fn put(&self, value: T) {
        self.0.store(Some(Arc::new(value)));
    }

    /// Takes the newest value, unless it has been taken already.
    pub(crate) fn take(&self) -> Option<Arc<T>> {
        self.0.swap(None)
    }
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self(ArcSwapOption::empty())
    }
}
