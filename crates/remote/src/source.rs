//! A file at an address, read by position from any thread. Readers take blocks out of memory and
//! wait for those that are on their way; what they are going to read can be said beforehand.

use crate::address;
use crate::blocks::{BLOCK, Block, Blocks};
use crate::disk::{Disk, DiskFile};
use crate::fetch::{CHANGED, Fault, Fetcher, bytes_of, version};
use crate::threads::runtime;
use bytes::Bytes;
use esker_points::read_at::ReadAt;
use object_store::ObjectMeta;
use std::io;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Semaphore;

/// Bytes that are requested at a time for one long read.
const WINDOW: u64 = 8 << 20;
/// Bytes that are fetched behind a read that goes on where the last one ended.
const AHEAD: u64 = 8 << 20;
/// Bytes at the end of a file that are fetched when it is opened: footer and node table of a file
/// of some ten million points.
const TAIL: u64 = 256 << 10;

/// How much is done at a time.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Requests that run at the same time, for one file.
    pub requests: usize,
    /// Most blocks of one request, of 64 KiB each.
    pub blocks: u64,
    /// Bytes in memory, for one file.
    pub memory_bytes: u64,
    /// Longest time for an answer.
    pub answer: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self { requests: 16, blocks: 32, memory_bytes: 64 << 20, answer: Duration::from_secs(30) }
    }
}

/// A file at an address.
pub struct Remote {
    shared: Arc<Shared>,
}

struct Shared {
    fetcher: Fetcher,
    meta: ObjectMeta,
    limits: Limits,
    blocks: Mutex<Blocks>,
    /// A block has come, or failed.
    came: Condvar,
    disk: Option<DiskFile>,
    permits: Semaphore,
    has_changed: AtomicBool,
    /// Where the last read ended: one that begins there is followed by others.
    last_end: AtomicU64,
    /// Requests made, and bytes received.
    requests: AtomicU64,
    received: AtomicU64,
}

impl Remote {
    /// Opens the file at an address by one request for its first block, and begins to fetch its
    /// end.
    ///
    /// # Errors
    /// If the address is invalid, there is no file, the server refuses it, does not answer, or
    /// sends no parts of files.
    pub fn open(address: &str, disk: Option<Arc<Disk>>, limits: Limits) -> io::Result<Self> {
        let runtime = runtime()?;
        let (store, path) = address::place(address, limits.answer)?;
        let fetcher = Fetcher::new(store, path);
        let (meta, head) = runtime.block_on(fetcher.head(BLOCK))?;
        let disk = disk.and_then(|disk| disk.file(address, &version(&meta), meta.size));
        let mut blocks = Blocks::new(limits.memory_bytes);
        blocks.put(0, head.clone());
        let shared = Shared {
            fetcher,
            limits,
            blocks: Mutex::new(blocks),
            came: Condvar::new(),
            disk,
            permits: Semaphore::new(limits.requests.max(1)),
            has_changed: AtomicBool::new(false),
            last_end: AtomicU64::new(u64::MAX),
            requests: AtomicU64::new(1),
            received: AtomicU64::new(head.len() as u64),
            meta,
        };
        let remote = Self { shared: Arc::new(shared) };
        let size = remote.shared.meta.size;
        remote.request(size.saturating_sub(TAIL)..size);
        Ok(remote)
    }

    /// Requests that were made, and bytes that came.
    pub fn counts(&self) -> [u64; 2] {
        [self.shared.requests.load(Relaxed), self.shared.received.load(Relaxed)]
    }

    /// Begins to fetch what is absent of a range.
    fn request(&self, range: Range<u64>) {
        let numbers = range.start / BLOCK..range.end.div_ceil(BLOCK);
        self.request_blocks(numbers);
    }

    fn request_blocks(&self, numbers: impl Iterator<Item = u64>) {
        let runs = self.shared.lock().request(numbers, self.shared.limits.blocks);
        let Ok(runtime) = runtime() else { return };
        for run in runs {
            let shared = Arc::clone(&self.shared);
            runtime.spawn(async move { shared.fetch(run).await });
        }
    }

    /// Waits for a block.
    fn block(&self, number: u64) -> io::Result<Bytes> {
        let mut blocks = self.shared.lock();
        loop {
            match blocks.take(number) {
                Block::Here(bytes) => return Ok(bytes),
                Block::Failed(why) if self.shared.has_changed.load(Relaxed) => {
                    drop(why);
                    return Err(io::Error::other(CHANGED));
                }
                Block::Failed(why) => return Err(io::Error::other(why)),
                Block::Absent => {
                    drop(blocks);
                    self.request_blocks(number..number + 1);
                    blocks = self.shared.lock();
                }
                Block::Coming => {
                    let came = self.shared.came.wait(blocks);
                    blocks = came.unwrap_or_else(PoisonError::into_inner);
                }
            }
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Blocks> {
        self.blocks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Fetches a run of blocks. Whatever happens, none stays on its way.
    async fn fetch(self: Arc<Self>, run: Range<u64>) {
        let Ok(_permit) = self.permits.acquire().await else { return };
        let mut left = run.clone();
        if self.disk.is_some() {
            let (shared, numbers) = (Arc::clone(&self), run.clone());
            let read = move || {
                let read = |number| Some((number, shared.disk.as_ref()?.read(number)?));
                numbers.map_while(read).collect::<Vec<_>>()
            };
            let kept = tokio::task::spawn_blocking(read).await.unwrap_or_default();
            left.start += kept.len() as u64;
            let mut blocks = self.lock();
            kept.into_iter().for_each(|(number, bytes)| blocks.put(number, bytes.into()));
        }
        if !left.is_empty() {
            self.fetch_from_server(left).await;
        }
        self.came.notify_all();
    }

    async fn fetch_from_server(self: &Arc<Self>, run: Range<u64>) {
        let range = bytes_of(&run, self.meta.size);
        self.requests.fetch_add(1, Relaxed);
        let fetched = self.fetcher.range(range, &self.meta).await;
        let mut blocks = self.lock();
        match fetched {
            Ok(bytes) => {
                self.received.fetch_add(bytes.len() as u64, Relaxed);
                let mut parts = Vec::new();
                for (i, number) in run.enumerate() {
                    let start = i * BLOCK as usize;
                    let part = bytes.slice(start..bytes.len().min(start + BLOCK as usize));
                    blocks.put(number, part.clone());
                    parts.push((number, part));
                }
                drop(blocks);
                if self.disk.is_some() {
                    let shared = Arc::clone(self);
                    tokio::task::spawn_blocking(move || {
                        let Some(disk) = &shared.disk else { return };
                        parts.iter().for_each(|(number, part)| disk.write(*number, part));
                    });
                }
            }
            Err(fault) => {
                let why = match fault {
                    Fault::Passing(why) | Fault::Lasting(_, why) => why,
                };
                if why == CHANGED {
                    self.has_changed.store(true, Relaxed);
                }
                run.for_each(|number| blocks.fail(number, &why));
            }
        }
    }
}

impl ReadAt for Remote {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        let end = offset.checked_add(buf.len() as u64).filter(|end| *end <= self.shared.meta.size);
        let end = end.ok_or(io::ErrorKind::UnexpectedEof)?;
        // Reads in the order of the file go on: the next ones are fetched beside this one.
        if self.shared.last_end.swap(end, Relaxed) == offset && end > offset {
            self.request(offset..end.saturating_add(AHEAD).min(self.shared.meta.size));
        }
        let mut requested = offset;
        let mut at = offset;
        while at < end {
            if requested < end && at + WINDOW / 2 >= requested {
                let until = requested.saturating_add(WINDOW).min(end);
                self.request(requested..until);
                requested = until;
            }
            let number = at / BLOCK;
            let block = self.block(number)?;
            let within = (at - number * BLOCK) as usize;
            let length = (block.len() - within).min((end - at) as usize);
            let to = (at - offset) as usize;
            buf[to..to + length].copy_from_slice(&block[within..within + length]);
            at += length as u64;
        }
        Ok(())
    }

    fn bytes(&self) -> io::Result<u64> {
        Ok(self.shared.meta.size)
    }

    fn will_read(&self, ranges: &[Range<u64>]) {
        // More than the memory holds would be forgotten before it is read.
        let mut left = self.shared.limits.memory_bytes / 2;
        let mut numbers: Vec<u64> = Vec::new();
        for range in ranges {
            let end = range.end.min(self.shared.meta.size);
            let Some(bytes) = end.checked_sub(range.start).filter(|bytes| *bytes <= left) else {
                break;
            };
            left -= bytes;
            numbers.extend(range.start / BLOCK..end.div_ceil(BLOCK));
        }
        numbers.sort_unstable();
        numbers.dedup();
        self.request_blocks(numbers.into_iter());
    }

    fn readers(&self) -> Option<usize> {
        Some(self.shared.limits.requests)
    }
}
