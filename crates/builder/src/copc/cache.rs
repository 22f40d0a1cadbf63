//! The pages that were made last, within a bound of bytes. Threads that want the same chunk wait
//! for the first of them; others do not.

use std::collections::HashMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The page of a node, and the file's integers of its points.
#[derive(Debug)]
struct MadePage {
    node: u32,
    page: Vec<u8>,
    own: Vec<[i32; 3]>,
}

/// The pages of a chunk.
#[derive(Debug, Default)]
pub struct Made {
    pages: Vec<MadePage>,
}

impl Made {
    /// Adds the page of a node, and the file's integers of its points.
    pub fn add(&mut self, node: u32, page: Vec<u8>, own: Vec<[i32; 3]>) {
        self.pages.push(MadePage { node, page, own });
    }

    /// The page of a node; empty if it is of another chunk.
    pub fn page(&self, node: u32) -> &[u8] {
        self.find(node).map_or(&[], |made| &made.page)
    }

    /// The file's integers of the points of a node, in the page's order.
    pub fn own(&self, node: u32) -> &[[i32; 3]] {
        self.find(node).map_or(&[], |made| &made.own)
    }

    fn find(&self, node: u32) -> Option<&MadePage> {
        self.pages.iter().find(|made| made.node == node)
    }

    fn bytes(&self) -> u64 {
        let of = |made: &MadePage| made.page.len() + size_of_val(&made.own[..]);
        self.pages.iter().map(of).sum::<usize>() as u64
    }
}

/// A chunk's place in the cache: held while it is made.
type Entry = Arc<Mutex<Option<Arc<Made>>>>;

/// Pages of chunks.
pub struct Cache {
    bytes_max: u64,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    /// Each chunk's entry, and when it was last used.
    entries: HashMap<u32, (Entry, u64)>,
    /// Bytes of the entries that are made.
    bytes: u64,
    /// Number of uses.
    uses: u64,
}

impl Cache {
    /// A cache of at most `bytes_max` bytes.
    pub fn new(bytes_max: u64) -> Self {
        Self { bytes_max, kept: Mutex::default() }
    }

    /// Most bytes that are kept.
    pub fn bytes_max(&self) -> u64 {
        self.bytes_max
    }

    /// Whether the pages of a chunk are kept, or are being made.
    pub fn has(&self, chunk: u32) -> bool {
        self.lock().entries.contains_key(&chunk)
    }

    /// The pages of a chunk, made by `make` if they are not kept.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn with(
        &self,
        chunk: u32,
        make: impl FnOnce() -> io::Result<Made>,
    ) -> io::Result<Arc<Made>> {
        let entry = {
            let mut kept = self.lock();
            kept.uses += 1;
            let now = kept.uses;
            let (entry, used) = kept.entries.entry(chunk).or_default();
            *used = now;
            entry.clone()
        };
        let mut held = entry.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(made) = &*held {
            return Ok(made.clone());
        }
        let made = make().map(Arc::new);
        let mut kept = self.lock();
        match &made {
            Ok(made) => {
                *held = Some(made.clone());
                // It may have been left out meanwhile.
                if kept.entries.get(&chunk).is_some_and(|(own, _)| Arc::ptr_eq(own, &entry)) {
                    kept.bytes += made.bytes();
                }
                kept.shrink(self.bytes_max, chunk);
            }
            Err(_) => drop(kept.entries.remove(&chunk)),
        }
        made
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Kept {
    /// Leaves out the chunks that were not used for longest, but for `newest`.
    fn shrink(&mut self, bytes_max: u64, newest: u32) {
        if self.bytes <= bytes_max {
            return;
        }
        let mut oldest: Vec<(u64, u32)> =
            self.entries.iter().map(|(&chunk, &(_, used))| (used, chunk)).collect();
        oldest.sort_unstable();
        for (_, chunk) in oldest {
            if self.bytes <= bytes_max || chunk == newest {
                continue;
            }
            let Some((entry, _)) = self.entries.get(&chunk) else { continue };
            // Those that are being made are in use.
            let Ok(made) = entry.try_lock() else { continue };
            let bytes = made.as_ref().map_or(0, |made| made.bytes());
            drop(made);
            self.bytes -= bytes.min(self.bytes);
            self.entries.remove(&chunk);
        }
    }
}
