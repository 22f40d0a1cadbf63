//! A file written from front to back: bytes are gathered in blocks, which a thread of its own brings to the file, past
//! the system's cache where the file system allows. A copy in that cache is the first touch of fresh memory for each
//! page, which took a tenth of the CPU time of a build, and drives out what others read.

use crate::system::write_all_at;
use crossbeam_channel::{Receiver, Sender, bounded};
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::thread::{self, JoinHandle};

/// Bytes that are written together.
const BLOCK_BYTES: usize = 4 << 20;
/// One is filled while one is written; as many as a chunk's pages fill may wait.
const BLOCKS: usize = 8;
/// What writing past the cache wants all places to be multiples of: in the file and in memory.
const SECTOR: usize = 4096;
/// A small file, up to so many bytes, goes through the cache: it is likely to be read at once.
const CACHED_BYTES: u64 = 32 << 20;
/// All that a thread needs that waits for the disk.
pub(crate) const STACK_BYTES: usize = 128 << 10;

/// A file that grows at its end.
#[derive(Debug)]
pub struct Sequential {
    file: File,
    /// What is being filled.
    block: Block,
    /// Blocks with nothing in them.
    free: Vec<Block>,
    /// How many are on their way.
    busy: usize,
    /// `None` while it is dropped.
    to_disk: Option<Sender<Block>>,
    from_disk: Receiver<(Block, io::Result<()>)>,
    thread: Option<JoinHandle<()>>,
}

/// Bytes on their way to a part of the file.
#[derive(Debug)]
struct Block {
    /// [`BLOCK_BYTES`] from `start`, which is a multiple of [`SECTOR`] in memory, on.
    bytes: Vec<u8>,
    start: usize,
    /// Where in the file that is, a multiple of [`SECTOR`] too.
    offset: u64,
    /// The part of it that has been filled.
    filled: std::ops::Range<usize>,
}

impl Block {
    fn new() -> Self {
        let bytes = vec![0; BLOCK_BYTES + SECTOR];
        let start = bytes.as_ptr().addr().next_multiple_of(SECTOR) - bytes.as_ptr().addr();
        Self { bytes, start, offset: 0, filled: 0..0 }
    }

    /// Empties it, to be filled from this place in the file on.
    fn begin(&mut self, offset: u64) {
        let from = (offset % SECTOR as u64) as usize;
        self.offset = offset - from as u64;
        self.filled = from..from;
    }

    /// Where in the file its bytes end.
    fn end(&self) -> u64 {
        self.offset + self.filled.end as u64
    }

    /// Takes what it has room for; how many bytes those are.
    fn take(&mut self, bytes: &[u8]) -> usize {
        let at = self.filled.end;
        let count = bytes.len().min(BLOCK_BYTES - at);
        self.bytes[self.start + at..][..count].copy_from_slice(&bytes[..count]);
        self.filled.end = at + count;
        count
    }

    /// Its bytes between two of its places.
    fn part(&self, from: usize, to: usize) -> &[u8] {
        &self.bytes[self.start + from..self.start + to]
    }
}

impl Sequential {
    /// Writes from the front of `file`, which stands at `path`.
    ///
    /// # Errors
    /// Where the system gives no thread.
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

    /// The file. What is still on its way may not be in it.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Where the next byte goes.
    pub fn offset(&self) -> u64 {
        self.block.end()
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// Where the disk is full, for these bytes or some before them.
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

    /// Hands all to the system; the file has it then.
    ///
    /// # Errors
    /// Where the disk is full.
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

    /// Goes on at another place.
    ///
    /// # Errors
    /// As [`Sequential::flush`].
    pub fn seek(&mut self, offset: u64) -> io::Result<()> {
        self.flush()?;
        self.block.begin(offset);
        Ok(())
    }

    /// Sends what is filled on its way and begins with what follows it.
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

    /// Waits for the block that is longest on its way.
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
        // After this nothing of it is written any more.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// What blocks go to.
struct Output {
    file: File,
    /// The same file past the cache, where that is possible.
    direct: Option<File>,
    /// What lies before this goes through the cache.
    cached_bytes: u64,
}

impl Output {
    fn write(&mut self, block: &Block) -> io::Result<()> {
        let (from, to) = (block.filled.start, block.filled.end);
        let cached = |part: std::ops::Range<usize>| {
            let bytes = block.part(part.start, part.end);
            write_all_at(&self.file, bytes, block.offset + part.start as u64)
        };
        // Sectors that this block has as a whole.
        let (first, last) = (from.next_multiple_of(SECTOR), to - to % SECTOR);
        let direct = self.direct.as_ref().filter(|_| block.offset >= self.cached_bytes);
        let Some(direct) = direct.filter(|_| first < last) else { return cached(from..to) };
        let whole = block.part(first, last);
        match write_all_at(direct, whole, block.offset + first as u64) {
            // Not every file system that opens a file so lets it be written so.
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
    use std::os::unix::fs::OpenOptionsExt;
    let flags = i32::try_from(rustix::fs::OFlags::DIRECT.bits()).ok()?;
    std::fs::OpenOptions::new().write(true).custom_flags(flags).open(path).ok()
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

    #[derive(Clone, Debug)]
    enum Act {
        Write(usize),
        Flush,
        GoBack(u64),
    }

    fn acts() -> impl Strategy<Value = Vec<Act>> {
        let write = prop_oneof![1..200_usize, 3_000..10_000_usize, 1_000_000..9_000_000_usize];
        let act = prop_oneof![
            6 => write.prop_map(Act::Write),
            2 => Just(Act::Flush),
            1 => (0..20_000_u64).prop_map(Act::GoBack),
        ];
        proptest::collection::vec(act, 1..12)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Whatever is written in whatever parts, through the cache or past it, is in the file.
        #[test]
        fn the_file_has_what_was_written(acts in acts(), cached in 0..16_000_000_u64) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("file");
            let file = File::options().read(true).write(true).create_new(true).open(&path).unwrap();
            let mut out = Sequential::past_cache_from(cached, file, &path).unwrap();
            let (mut expected, mut at) = (Vec::new(), 0_usize);
            let mut random = 1_u64;
            for act in acts {
                match act {
                    Act::Write(count) => {
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
                    Act::Flush => {
                        out.flush().unwrap();
                        prop_assert!(fs::metadata(&path).unwrap().len() >= at as u64);
                    }
                    Act::GoBack(by) => {
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
            crate::system::read_exact_at(&file, &mut found, 0).unwrap();
            prop_assert!(found == expected);
            prop_assert_eq!(file.metadata().unwrap().len(), expected.len() as u64);
        }
    }

    #[test]
    fn a_file_that_takes_no_more_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, []).unwrap();
        let file = File::open(&path).unwrap();
        let mut out = Sequential::past_cache_from(u64::MAX, file, &path).unwrap();
        let failed = out.write_all(&[1]).and_then(|()| out.flush());
        assert!(failed.is_err());
    }
}
