//! Tests whether the files are still those that were opened, by reading their footers again: at
//! most once a second while loading, and after each failed read. After a change, the bytes read may
//! be anything; the picture is then wrong, but nothing else fails.

use esker_format::footer::FOOTER_BYTES;
use esker_format::{EskerFile, Forest};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Pause between two reads of the footers, milliseconds.
const PAUSE_MS: u64 = 1000;

/// Compares footers with those read on opening.
#[derive(Debug)]
pub(crate) struct Identity {
    forest: Arc<Forest>,
    opened: Instant,
    /// Time of the next read, milliseconds after opening.
    due_ms: AtomicU64,
}

impl Identity {
    pub(crate) fn new(forest: Arc<Forest>) -> Self {
        Self { forest, opened: Instant::now(), due_ms: AtomicU64::new(PAUSE_MS) }
    }

    /// Calls [`Identity::fault`] if no thread has done so within the pause.
    pub(crate) fn fault_if_due(&self) -> Option<String> {
        let now_ms = self.opened.elapsed().as_millis() as u64;
        let due_ms = self.due_ms.load(Relaxed);
        let is_mine = now_ms >= due_ms
            && self.due_ms.compare_exchange(due_ms, now_ms + PAUSE_MS, Relaxed, Relaxed).is_ok();
        if is_mine { self.fault() } else { None }
    }

    /// Message for the first file that has changed. `None` if all footers are unchanged, or cannot
    /// be read for a reason other than the end of the file.
    pub(crate) fn fault(&self) -> Option<String> {
        self.forest.files().find_map(Self::fault_of)
    }

    fn fault_of(file: &EskerFile) -> Option<String> {
        let is_changed = file.is_changed().unwrap_or_else(|| {
            let footer = file.footer();
            let offset = footer.file_bytes.saturating_sub(FOOTER_BYTES as u64);
            let mut bytes = [0; FOOTER_BYTES];
            file.read_exact_at(&mut bytes, offset)?;
            Ok(bytes != footer.encode())
        });
        let what = match is_changed {
            Ok(false) => return None,
            Ok(true) => "it was changed or replaced since it was opened",
            Err(esker_format::FormatError::Io { source, .. })
                if source.kind() == std::io::ErrorKind::UnexpectedEof =>
            {
                "it was cut short since it was opened"
            }
            // A file at an address says so itself.
            Err(esker_format::FormatError::Io { source, .. })
                if source.kind() == std::io::ErrorKind::StaleNetworkFileHandle =>
            {
                "it was changed or replaced since it was opened"
            }
            Err(_) => return None,
        };
        let path = file.path().display();
        Some(format!("{path}: {what}; what is loaded stays, open it again for the rest"))
    }
}
