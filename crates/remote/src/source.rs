//! A file at an address, read by position from any thread. Readers take blocks out of memory and
//! wait for those that are on their way; what they are going to read can be said beforehand.

use crate::address;
use crate::blocks::{BLOCK, Block, Blocks};
use crate::disk::{Disk, DiskFile};
use crate::fetch::{Fault, Fetcher, has_certain_version, version};
use crate::pool::{Limits, Pool};
use crate::threads::{GIVEN_UP, LOOK_EVERY, finish, runtime, stopped};
use bytes::Bytes;
use esker_points::read_at::ReadAt;
use object_store::ObjectMeta;
use std::io;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes that are requested at a time for one long read.
const WINDOW: u64 = 8 << 20;
/// Most bytes that are fetched behind reads that go on where the last one ended.
const AHEAD: u64 = 8 << 20;
/// Such reads in a row before the first bytes are fetched ahead; each further one doubles these, as
/// readers of pages here and there also go on at times.
const IN_ORDER: u32 = 2;
/// The first bytes that are fetched ahead.
const AHEAD_FIRST: u64 = 512 << 10;
/// Bytes that are fetched to see what there is.
const HEAD: u64 = 64 << 10;
/// Bytes at the end of a file that are fetched when it is opened: footer and node table of a file
/// of some ten million points.
const TAIL: u64 = 256 << 10;

/// A file at an address.
pub struct Remote {
    shared: Arc<Shared>,
}

struct Shared {
    fetcher: Fetcher,
    meta: ObjectMeta,
    pool: Arc<Pool>,
    blocks: Mutex<Blocks>,
    /// A block has come, or failed.
    came: Condvar,
    disk: Option<DiskFile>,
    has_changed: AtomicBool,
    /// Nobody reads any more.
    is_closed: AtomicBool,
    /// Number of calls of [`ReadAt::interrupt`]: readers that waited before the last one give up.
    interrupts: AtomicU64,
    /// Where the last read ended, and how many in a row began where one ended.
    last_end: AtomicU64,
    in_order: AtomicU32,
    /// Requests made, and bytes received.
    requests: AtomicU64,
    received: AtomicU64,
}

impl Remote {
    /// Opens the file at an address by one request for its first block, and begins to fetch its
    /// end. It shares nothing with other files.
    ///
    /// # Errors
    /// If the address is invalid, there is no file, the server refuses it, does not answer, or
    /// sends no parts of files.
    pub fn open(address: &str, disk: Option<Arc<Disk>>, limits: Limits) -> io::Result<Self> {
        Self::open_in(address, disk, &Arc::new(Pool::new(limits, Arc::default())))
    }

    /// Opens a file that shares requests and memory with others.
    ///
    /// # Errors
    /// As for [`Remote::open`]; if the pool is stopped.
    pub fn open_in(address: &str, disk: Option<Arc<Disk>>, pool: &Arc<Pool>) -> io::Result<Self> {
        let (store, path) = address::locate(address, pool.limits.answer)?;
        let fetcher = Fetcher::new(store, path, pool.limits.answer);
        let head = async move { (fetcher.head(HEAD).await, fetcher) };
        let (head, fetcher) = finish(pool, head)?;
        let (meta, head) = head?;
        let disk = disk.filter(|_| has_certain_version(&meta));
        let disk = disk.and_then(|disk| disk.file(address, &version(&meta), meta.size));
        let size = meta.size;
        let remote = Self::over(fetcher, meta, disk, pool);
        remote.shared.requests.store(1, Relaxed);
        remote.shared.received.store(head.len() as u64, Relaxed);
        remote.shared.put((0..).zip(head.chunks(BLOCK as usize).map(Bytes::copy_from_slice)));
        remote.request(size.saturating_sub(TAIL)..size);
        Ok(remote)
    }

    /// Reads what a fetcher fetches, of which `meta` is known; nothing is fetched yet.
    pub(crate) fn over(
        fetcher: Fetcher,
        meta: ObjectMeta,
        disk: Option<DiskFile>,
        pool: &Arc<Pool>,
    ) -> Self {
        pool.opened();
        let shared = Shared {
            fetcher,
            meta,
            pool: Arc::clone(pool),
            blocks: Mutex::new(Blocks::new()),
            came: Condvar::new(),
            disk,
            has_changed: AtomicBool::new(false),
            is_closed: AtomicBool::new(false),
            interrupts: AtomicU64::new(0),
            last_end: AtomicU64::new(u64::MAX),
            in_order: AtomicU32::new(0),
            requests: AtomicU64::new(0),
            received: AtomicU64::new(0),
        };
        Self { shared: Arc::new(shared) }
    }

    /// Requests that were made, and bytes that came.
    pub fn counts(&self) -> [u64; 2] {
        [self.shared.requests.load(Relaxed), self.shared.received.load(Relaxed)]
    }

    /// Whether another file was found at the address.
    pub fn has_changed(&self) -> bool {
        self.shared.has_changed.load(Relaxed)
    }

    /// Begins to fetch what is absent of a range.
    fn request(&self, range: Range<u64>) {
        let numbers = range.start / BLOCK..range.end.div_ceil(BLOCK);
        self.request_blocks(numbers);
    }

    fn request_blocks(&self, numbers: impl Iterator<Item = u64>) {
        let Ok(runtime) = runtime() else { return };
        let runs = self.shared.lock().request(numbers, self.shared.pool.limits.blocks);
        for run in runs {
            let coming = Coming { shared: Arc::clone(&self.shared), run };
            runtime.spawn(coming.fetch());
        }
    }

    /// Waits for a block.
    fn block(&self, number: u64) -> io::Result<Bytes> {
        let shared = &self.shared;
        let interrupts = shared.interrupts.load(Relaxed);
        let mut blocks = shared.lock();
        loop {
            match blocks.take(number) {
                Block::Here(bytes) => return Ok(bytes),
                Block::Failed(fault) => return Err(fault.into()),
                Block::Absent => {
                    drop(blocks);
                    self.request_blocks(number..number + 1);
                    blocks = shared.lock();
                }
                Block::Coming => {
                    if shared.pool.is_stopped() || shared.interrupts.load(Relaxed) != interrupts {
                        return Err(stopped());
                    }
                    let came = shared.came.wait_timeout(blocks, LOOK_EVERY);
                    blocks = came.unwrap_or_else(PoisonError::into_inner).0;
                }
            }
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Blocks> {
        self.blocks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps blocks in memory, within the share of this file.
    fn put(&self, blocks: impl IntoIterator<Item = (u64, Bytes)>) {
        let mut all = self.lock();
        let before = all.count();
        for (number, bytes) in blocks {
            all.put(number, bytes, self.pool.share());
        }
        let after = all.count();
        self.pool.blocks.fetch_add(after.saturating_sub(before), Relaxed);
        self.pool.blocks.fetch_sub(before.saturating_sub(after), Relaxed);
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        let count = self.lock().count();
        self.pool.blocks.fetch_sub(count, Relaxed);
        self.pool.closed();
    }
}

impl Drop for Remote {
    fn drop(&mut self) {
        self.shared.is_closed.store(true, Relaxed);
    }
}

/// A run of blocks that is being fetched. Whatever happens, none stays on its way.
struct Coming {
    shared: Arc<Shared>,
    run: Range<u64>,
}

impl Coming {
    async fn fetch(self) {
        let shared = &self.shared;
        let Ok(_permit) = shared.pool.permits.acquire().await else { return };
        if shared.is_closed.load(Relaxed) || shared.pool.is_stopped() {
            return;
        }
        let mut left = self.run.clone();
        if shared.disk.is_some() {
            let (of, numbers) = (Arc::clone(shared), self.run.clone());
            let read = move || {
                let read = |number| Some((number, of.disk.as_ref()?.read(number)?.into()));
                numbers.map_while(read).collect::<Vec<_>>()
            };
            let kept = tokio::task::spawn_blocking(read).await.unwrap_or_default();
            left.start += kept.len() as u64;
            shared.put(kept);
        }
        if !left.is_empty() {
            self.fetch_from_server(left).await;
        }
    }

    async fn fetch_from_server(&self, run: Range<u64>) {
        let shared = &self.shared;
        let range = bytes_of(&run, shared.meta.size);
        shared.requests.fetch_add(1, Relaxed);
        match shared.fetcher.range(range, &shared.meta).await {
            Ok(bytes) => {
                shared.received.fetch_add(bytes.len() as u64, Relaxed);
                // Copies, since parts of one allocation would keep all of it.
                let parts = bytes.chunks(BLOCK as usize).map(Bytes::copy_from_slice);
                let parts: Vec<_> = run.zip(parts).collect();
                shared.put(parts.iter().cloned());
                if shared.disk.is_some() {
                    let shared = Arc::clone(shared);
                    tokio::task::spawn_blocking(move || {
                        let Some(disk) = &shared.disk else { return };
                        parts.iter().for_each(|(number, part)| disk.write(*number, part));
                    });
                }
            }
            Err(fault) => {
                if fault == Fault::changed() {
                    shared.has_changed.store(true, Relaxed);
                }
                let mut blocks = shared.lock();
                run.for_each(|number| blocks.fail(number, &fault));
            }
        }
    }
}

impl Drop for Coming {
    fn drop(&mut self) {
        let given_up = Fault::Passing(GIVEN_UP.into());
        let mut blocks = self.shared.lock();
        self.run.clone().for_each(|number| blocks.fail(number, &given_up));
        drop(blocks);
        self.shared.came.notify_all();
    }
}

/// Bytes of the blocks of a run, of a file of `size` bytes.
fn bytes_of(run: &Range<u64>, size: u64) -> Range<u64> {
    run.start.saturating_mul(BLOCK).min(size)..run.end.saturating_mul(BLOCK).min(size)
}

impl ReadAt for Remote {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        let shared = &self.shared;
        let end = offset.checked_add(buf.len() as u64).filter(|end| *end <= shared.meta.size);
        let end = end.ok_or(io::ErrorKind::UnexpectedEof)?;
        if self.has_changed() {
            return Err(Fault::changed().into());
        }
        // What is fetched before it is read has to stay until then.
        let most = (shared.pool.share() / 2).max(BLOCK);
        // Reads in the order of the file go on: the next ones are fetched beside this one.
        if shared.last_end.swap(end, Relaxed) != offset {
            shared.in_order.store(0, Relaxed);
        } else if end > offset {
            let more = shared.in_order.fetch_add(1, Relaxed).checked_sub(IN_ORDER - 1);
            let ahead = more.map_or(0, |more| (AHEAD_FIRST << more.min(8)).min(AHEAD).min(most));
            self.request(offset..end.saturating_add(ahead).min(shared.meta.size));
        }
        let window = WINDOW.min(most);
        let mut requested = offset;
        let mut at = offset;
        while at < end {
            if requested < end && at + window / 2 >= requested {
                let until = requested.saturating_add(window).min(end);
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
        let mut left = self.shared.pool.share() / 2;
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

    fn traffic(&self) -> Option<[u64; 2]> {
        Some(self.counts())
    }

    fn readers(&self) -> Option<usize> {
        Some(self.shared.pool.limits.requests)
    }

    fn interrupt(&self) {
        self.shared.interrupts.fetch_add(1, Relaxed);
        self.shared.came.notify_all();
    }
}
