//! Tasks that run ahead on the threads of a rayon pool. They are begun in order and their results
//! are taken in order; a thread of the pool that waits for a result runs other tasks meanwhile.

use rayon::{ScopeFifo, Yield};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Handle of a task under way, with which its result is taken.
pub struct Ahead<T>(Arc<Shared<T>>);

struct Shared<T> {
    state: Mutex<State<T>>,
    is_done: Condvar,
}

enum State<T> {
    UnderWay,
    Made(T),
    /// The task has panicked.
    Lost,
}

impl<T> Ahead<T> {
    /// Spawns `work` on the pool of `scope`, in first-in, first-out order.
    pub fn begin<'s>(scope: &ScopeFifo<'s>, work: impl FnOnce() -> T + Send + 's) -> Self
    where
        T: Send + 's,
    {
        let state = Mutex::new(State::UnderWay);
        let shared = Arc::new(Shared { state, is_done: Condvar::new() });
        let ending = Ending(Arc::clone(&shared));
        scope.spawn_fifo(move |_| {
            let made = work();
            *ending.0.lock() = State::Made(made);
            drop(ending);
        });
        Self(shared)
    }

    /// Waits for the result. `None` if the task has panicked; then its scope panics, too.
    pub fn wait(self) -> Option<T> {
        loop {
            let state = std::mem::replace(&mut *self.0.lock(), State::UnderWay);
            match state {
                State::Made(made) => return Some(made),
                State::Lost => return None,
                State::UnderWay if rayon::yield_now() == Some(Yield::Executed) => {}
                State::UnderWay => {
                    let is_under_way = |state: &mut State<T>| matches!(state, State::UnderWay);
                    drop(self.0.is_done.wait_while(self.0.lock(), is_under_way));
                }
            }
        }
    }
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Notifies the waiting thread when the task ends, also when it panics.
struct Ending<T>(Arc<Shared<T>>);

impl<T> Drop for Ending<T> {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        if matches!(*state, State::UnderWay) {
            *state = State::Lost;
        }
        self.0.is_done.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn what_was_begun_is_taken_in_any_order_on_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let made = pool.install(|| {
                rayon::in_place_scope_fifo(|scope| {
                    let begun: Vec<_> = (0..100).map(|i| Ahead::begin(scope, move || i)).collect();
                    begun.into_iter().rev().filter_map(Ahead::wait).collect::<Vec<i32>>()
                })
            });
            assert_eq!(made, (0..100).rev().collect::<Vec<_>>());
        }
    }

    #[test]
    fn nobody_waits_for_what_has_panicked() {
        let waits = || {
            rayon::in_place_scope_fifo(|scope| {
                let lost = Ahead::<()>::begin(scope, || panic!("as this test wants"));
                assert!(lost.wait().is_none());
            });
        };
        assert!(catch_unwind(AssertUnwindSafe(waits)).is_err());
    }
}
