//! A file written from front to back: bytes are collected in blocks, which a separate thread
//! writes, past the system's cache if the file system allows. A copy in that cache costs the first
//! touch of each fresh page of memory, and evicts what others read.

use crossbeam_channel::{Receiver, Sender, bounded};
use esker_points::positioned::write_all_at;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::thread::{self, JoinHandle};

/// Bytes that are written together.
const BLOCK_BYTES: usize = 4 << 20;
/// Number of blocks: one is filled while one is written; as many as the pages of a chunk fill may
/// wait.
const BLOCKS: usize = 8;
/// Alignment that direct writes require, in the file and in memory.
const SECTOR: usize = 4096;
/// Length up to which a file is written through the cache: a small file is likely to be read at
/// once.
const CACHED_BYTES: u64 = 32 << 20;
/// Stack of a thread that only waits for the disk.
pub(crate) const STACK_BYTES: usize = 128 << 10;

/// A file that grows at its end.
#[derive(Debug)]
pub struct Sequential {
    file: File,
    /// Block that is being filled.
    block: Block,
    /// Empty blocks.
    free: Vec<Block>,
    /// Number of blocks in progress.
    busy: usize,
    /// `None` while the value is dropped.
    to_disk: Option<Sender<Block>>,
    from_disk: Receiver<(Block, io::Result<()>)>,
    thread: Option<JoinHandle<()>>,
}

/// Bytes of a part of the file.
#[derive(Debug)]
struct Block {
    /// [`BLOCK_BYTES`] from `start` on, which is a multiple of [`SECTOR`] in memory.
    bytes: Vec<u8>,
    start: usize,
    /// Their offset in the file, also a multiple of [`SECTOR`].
    offset: u64,
    /// Part of the block that has been filled.
    filled: std::ops::Range<usize>,
}

impl Block {
    fn new() -> Self {
        let bytes = vec![0; BLOCK_BYTES + SECTOR];
        let start = bytes.as_ptr().addr().next_multiple_of(SECTOR) - bytes.as_ptr().addr();
        Self { bytes, start, offset: 0, filled: 0..0 }
    }

    /// Empties the block, to be filled from this offset in the file on.
    fn begin(&mut self, offset: u64) {
        let from = (offset % SECTOR as u64) as usize;
        self.offset = offset - from as u64;
        self.filled = from..from;
    }

    /// Offset in the file after its last byte.
    fn end(&self) -> u64 {
        self.offset + self.filled.end as u64
    }

    /// Copies the bytes that fit; returns their number.
    fn take(&mut self, bytes: &[u8]) -> usize {
        let at = self.filled.end;
        let count = bytes.len().min(BLOCK_BYTES - at);
        self.bytes[self.start + at..][..count].copy_from_slice(&bytes[..count]);
        self.filled.end = at + count;
        count
    }

    /// The bytes between two positions of the block.
    fn part(&self, from: usize, to: usize) -> &[u8] {
        &self.bytes[self.start + from..self.start + to]
    }
}

impl Sequential {
    /// Writes from the front of `file`, which has the path `path`.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn new(file: File, path: &Path) -> io::Result<Self> {
        Self::past_cache_from(CACHED_BYTES, file, path)
    }

    fn past_cache_from(cached_bytes: u64, file: File, path: &Path) -> io::Result<Self> {
        let (to_disk, blocks) = bounded::<Block>(BLOCKS);
        let (done, from_disk) = bounded(BLOCKS);
        let mut output =
            Output { file: file.try_clone()?, direct: open_direct(path), cached_bytes };
        let thread = thread::Builder::new().name("esker-write".into()).stack_size(STACK_BYTES);
        let thread = thread.spawn(move || {
            for block in blocks {
                let written = output.write(&block);
                if done.send((block, written)).is_err() {
                    return;
                }
            }
        })?;
        let (to_disk, thread) = (Some(to_disk), Some(thread));
        Ok(Self {
            file,
            block: Block::new(),
            free: Vec::new(),
            busy: 0,
            to_disk,
            from_disk,
            thread,
        })
    }

    /// The file. Bytes in progress may not be in it.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Offset of the next byte.
    pub fn offset(&self) -> u64 {
        self.block.end()
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// If the disk is full, for these bytes or some before them.
    pub fn write_all(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            let taken = self.block.take(bytes);
            bytes = &bytes[taken..];
            if self.block.filled.end == BLOCK_BYTES {
                self.send()?;
            }
        }
        Ok(())
    }

    /// Passes all bytes to the system; afterwards they are in the file.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn flush(&mut self) -> io::Result<()> {
        if !self.block.filled.is_empty() {
            self.send()?;
        }
        while self.busy > 0 {
            let block = self.receive()?;
            self.free.push(block);
        }
        Ok(())
    }

    /// Continues at another offset.
    ///
    /// # Errors
    /// See [`Sequential::flush`].
    pub fn seek(&mut self, offset: u64) -> io::Result<()> {
        self.flush()?;
        self.block.begin(offset);
        Ok(())
    }

    /// Passes the filled block to the thread and begins the next one.
    fn send(&mut self) -> io::Result<()> {
        let end = self.block.end();
        let mut next = match self.free.pop() {
            Some(block) => block,
            None if self.busy + 1 < BLOCKS => Block::new(),
            None => self.receive()?,
        };
        next.begin(end);
        let full = std::mem::replace(&mut self.block, next);
        let sent = self.to_disk.as_ref().map(|to_disk| to_disk.send(full));
        if !matches!(sent, Some(Ok(()))) {
            return Err(io::Error::other("the thread that writes it is gone"));
        }
        self.busy += 1;
        Ok(())
    }

    /// Waits for the oldest block in progress.
    fn receive(&mut self) -> io::Result<Block> {
        let gone = |_| io::Error::other("the thread that writes it is gone");
        let (block, written) = self.from_disk.recv().map_err(gone)?;
        self.busy -= 1;
        written.map(|()| block)
    }
}

impl Drop for Sequential {
    fn drop(&mut self) {
        self.to_disk = None;
        // After this no byte is written any more.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Destination of blocks.
struct Output {
    file: File,
    /// The same file past the cache, if that is possible.
    direct: Option<File>,
    /// Bytes before this offset go through the cache.
    cached_bytes: u64,
}

impl Output {
    fn write(&mut self, block: &Block) -> io::Result<()> {
        let (from, to) = (block.filled.start, block.filled.end);
        let cached = |part: std::ops::Range<usize>| {
            let bytes = block.part(part.start, part.end);
            write_all_at(&self.file, bytes, block.offset + part.start as u64)
        };
        // Sectors that this block has completely.
        let (first, last) = (from.next_multiple_of(SECTOR), to - to % SECTOR);
        let direct = self.direct.as_ref().filter(|_| block.offset >= self.cached_bytes);
        let Some(direct) = direct.filter(|_| first < last) else { return cached(from..to) };
        let whole = block.part(first, last);
        match write_all_at(direct, whole, block.offset + first as u64) {
            // Some file systems open files for direct writes and then refuse such writes.
            Err(error) if error.kind() == ErrorKind::InvalidInput => {
                cached(from..to)?;
                self.direct = None;
                return Ok(());
            }
            written => written?,
        }
        cached(from..first)?;
        cached(last..to)
    }
}

/// Opens a file to be written past the system's cache.
#[cfg(target_os = "linux")]
fn open_direct(path: &Path) -> Option<File> {
    use esker_points::place::is_own;
    use std::os::unix::fs::OpenOptionsExt;
    let flags = i32::try_from(rustix::fs::OFlags::DIRECT.bits()).ok()?;
    let direct = std::fs::OpenOptions::new().write(true).custom_flags(flags).open(path).ok()?;
    // The name may have become a link since the file was opened first.
    is_own(&direct, path).then_some(direct)
}

#[cfg(not(target_os = "linux"))]
fn open_direct(_path: &Path) -> Option<File> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::fs;

    /// A step of a random sequence of writes.
    #[derive(Clone, Debug)]
    enum Step {
        Write(usize),
        Flush,
        GoBack(u64),
    }

    fn steps() -> impl Strategy<Value = Vec<Step>> {
        let write = prop_oneof![1..200_usize, 3_000..10_000_usize, 1_000_000..9_000_000_usize];
        let step = prop_oneof![
            6 => write.prop_map(Step::Write),
            2 => Just(Step::Flush),
            1 => (0..20_000_u64).prop_map(Step::GoBack),
        ];
        proptest::collection::vec(step, 1..12)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// All bytes are in the file, however they are divided and whether written through the
        /// cache or past it.
        #[test]
        fn the_file_has_what_was_written(steps in steps(), cached in 0..16_000_000_u64) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("file");
            let file = File::options().read(true).write(true).create_new(true).open(&path).unwrap();
            let mut out = Sequential::past_cache_from(cached, file, &path).unwrap();
            let (mut expected, mut at) = (Vec::new(), 0_usize);
            let mut random = 1_u64;
            for step in steps {
                match step {
                    Step::Write(count) => {
                        let mut bytes = vec![0; count];
                        for byte in &mut bytes {
                            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                            *byte = (random >> 56) as u8;
                        }
                        out.write_all(&bytes).unwrap();
                        expected.resize(expected.len().max(at + count), 0);
                        expected[at..at + count].copy_from_slice(&bytes);
                        at += count;
                    }
                    Step::Flush => {
                        out.flush().unwrap();
                        prop_assert!(fs::metadata(&path).unwrap().len() >= at as u64);
                    }
                    Step::GoBack(by) => {
                        at = at.saturating_sub(by as usize);
                        out.seek(at as u64).unwrap();
                    }
                }
                prop_assert_eq!(out.offset(), at as u64);
            }
            out.flush().unwrap();
            drop(out);
            let file = File::open(&path).unwrap();
            let mut found = vec![0; expected.len()];
            esker_points::positioned::read_exact_at(&file, &mut found, 0).unwrap();
            prop_assert!(found == expected);
            prop_assert_eq!(file.metadata().unwrap().len(), expected.len() as u64);
        }
    }

    #[test]
    fn a_failed_write_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, []).unwrap();
        let file = File::open(&path).unwrap();
        let mut out = Sequential::past_cache_from(u64::MAX, file, &path).unwrap();
        let failed = out.write_all(&[1]).and_then(|()| out.flush());
        assert!(failed.is_err());
    }
}
