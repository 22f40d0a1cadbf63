//! Model of how a slot passes from one node to another, in all interleavings (loom). It uses the
//! real load queue and the minimum that LOD thread, loader and render thread do around it: in the
//! order that [`crate::shared`] requires, and in wrong orders, which must fail. Run it by
//! `RUSTFLAGS="--cfg loom" cargo test --release -p esker-stream --lib handover`.

use crate::queue::Queue;
use loom::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use loom::sync::{Arc, Mutex};
use loom::thread;

/// Node that a cut draws from the slot, and node whose bytes are in it.
const NOTHING: usize = 0;
const OLD: usize = 1;
const NEW: usize = 2;

/// Order of the steps.
#[derive(Clone, Copy, PartialEq)]
struct Order {
    /// The LOD thread publishes a cut without the old node before it gives the slot away.
    publishes_first: bool,
    /// The render thread drains landed runs before it takes the cut.
    drains_first: bool,
}

const CORRECT: Order = Order { publishes_first: true, drains_first: true };

struct World {
    order: Order,
    front: AtomicUsize,
    /// Written and read by the render thread alone, as GPU memory is.
    slot: AtomicUsize,
    requested: Queue<usize>,
    landed: Mutex<Vec<usize>>,
    uploaded: Queue<usize>,
}

impl World {
    /// Gives the slot of the old node to the new one, and draws the new one once it is uploaded.
    fn choose(&self) {
        if self.order.publishes_first {
            self.front.store(NOTHING, SeqCst);
            self.requested.fill([NEW]);
        } else {
            self.requested.fill([NEW]);
            self.front.store(NOTHING, SeqCst);
        }
        if self.uploaded.take().is_some() {
            self.front.store(NEW, SeqCst);
        }
    }

    fn load(&self) {
        while let Some(node) = self.requested.take() {
            self.landed.lock().expect("no test panics under a lock").push(node);
        }
    }

    fn drain(&self) -> Vec<usize> {
        std::mem::take(&mut *self.landed.lock().expect("no test panics under a lock"))
    }

    fn frame(&self) {
        let (landed, cut) = if self.order.drains_first {
            let landed = self.drain();
            (landed, self.front.load(SeqCst))
        } else {
            let cut = self.front.load(SeqCst);
            (self.drain(), cut)
        };
        for node in landed {
            self.slot.store(node, SeqCst);
            self.uploaded.fill([node]);
        }
        let is_drawn = self.slot.load(SeqCst);
        assert!(cut == NOTHING || cut == is_drawn, "the cut has {cut}, the slot {is_drawn}");
    }
}

/// Bound on the preemptions of a thread in explored interleavings. It finds nearly all faults;
/// without a bound there are too many interleavings.
const PREEMPTIONS_MAX: usize = 3;

fn model(run: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(PREEMPTIONS_MAX);
    builder.check(run);
}

fn explore(order: Order) {
    model(move || {
        let world = Arc::new(World {
            order,
            front: AtomicUsize::new(OLD),
            slot: AtomicUsize::new(OLD),
            requested: Queue::new(),
            landed: Mutex::new(Vec::new()),
            uploaded: Queue::new(),
        });
        let threads = [World::choose, World::load].map(|run| {
            let world = Arc::clone(&world);
            thread::spawn(move || run(&world))
        });
        world.frame();
        world.frame();
        world.requested.close();
        world.uploaded.close();
        threads.into_iter().for_each(|t| t.join().expect("no thread panics"));
        world.frame();
    });
}

#[test]
fn a_drawn_slot_is_never_overwritten() {
    explore(CORRECT);
}

#[test]
#[should_panic(expected = "the cut has")]
fn taking_the_cut_before_draining_fails() {
    explore(Order { drains_first: false, ..CORRECT });
}

#[test]
#[should_panic(expected = "the cut has")]
fn giving_a_slot_away_before_publishing_fails() {
    explore(Order { publishes_first: false, ..CORRECT });
}

#[test]
fn each_batch_is_taken_or_withdrawn_once() {
    model(|| {
        let queue = Arc::new(Queue::new());
        let loaders = [(); 2].map(|()| {
            let queue = Arc::clone(&queue);
            thread::spawn(move || queue.take().map_or(0, |n: usize| n))
        });
        queue.fill([1, 2]);
        let back: usize = queue.take_back().into_iter().sum();
        queue.fill([4]);
        queue.close();
        let left: usize = queue.take_back().into_iter().sum();
        let taken: usize = loaders.into_iter().map(|t| t.join().expect("no panic")).sum();
        assert_eq!(back + left + taken, 7);
    });
}
