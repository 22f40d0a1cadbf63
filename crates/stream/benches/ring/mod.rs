//! A ring of plain memory for benchmarks: loaders write into it, and landed bytes are not copied
//! any further.

use crossbeam_channel::{Receiver, Sender, bounded};
use esker_stream::{Landing, Run, Transfer};
use std::ops::Range;
use std::time::Duration;

/// Bytes of a run.
pub const RUN_BYTES: usize = 1 << 20;

/// A run of plain memory.
pub struct Plain(Vec<u8>);

impl Run for Plain {
    fn fill<T>(&mut self, range: Range<usize>, write: impl FnOnce(&mut [u8]) -> T) -> Option<T> {
        self.0.get_mut(range).map(write)
    }
}

type Landed = (Plain, Vec<Transfer>);

/// Both queues hold as many runs as there are.
pub struct Ring {
    pub free: (Sender<Plain>, Receiver<Plain>),
    pub landed: (Sender<Landed>, Receiver<Landed>),
}

impl Ring {
    pub fn new(runs: usize) -> Self {
        let ring = Self { free: bounded(runs), landed: bounded(runs) };
        (0..runs).for_each(|_| ring.free.0.send(Plain(vec![0; RUN_BYTES])).unwrap());
        ring
    }
}

impl Landing for Ring {
    type Run = Plain;
    fn run_bytes(&self) -> usize {
        RUN_BYTES
    }
    fn lend(&self, patience: Duration) -> Option<Plain> {
        self.free.1.recv_timeout(patience).ok()
    }
    fn land(&self, run: Plain, transfers: Vec<Transfer>) {
        let _ = self.landed.0.try_send((run, transfers));
    }
}
