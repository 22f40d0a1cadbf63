//! Whether the files are still those that were opened: their footers, read again, at most once a second
//! while loading and whenever a read fails. Bytes that are read may be anything after a change; the
//! picture is then wrong but nothing else is.

use esker_format::footer::FOOTER_BYTES;
use esker_format::{EskerFile, Forest};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Between two looks at the footers, milliseconds: reads of 192 bytes then cost nothing.
const PAUSE_MS: u64 = 1000;

/// Looks at the footers.
#[derive(Debug)]
pub(crate) struct Identity {
    forest: Arc<Forest>,
    opened: Instant,
    /// When the next look is due, milliseconds after opening.
    due_ms: AtomicU64,
}

impl Identity {
    pub(crate) fn new(forest: Arc<Forest>) -> Self {
        Self { forest, opened: Instant::now(), due_ms: AtomicU64::new(PAUSE_MS) }
    }

    /// As [`Identity::fault`], where nobody has looked for a while.
    pub(crate) fn fault_if_due(&self) -> Option<String> {
        let now_ms = self.opened.elapsed().as_millis() as u64;
        let due_ms = self.due_ms.load(Relaxed);
        let is_mine = now_ms >= due_ms
            && self.due_ms.compare_exchange(due_ms, now_ms + PAUSE_MS, Relaxed, Relaxed).is_ok();
        if is_mine { self.fault() } else { None }
    }

    /// What has become of the first file that is not what it was; `None` where all footers are in their
    /// places, or cannot be read for other reasons than a file's end.
    pub(crate) fn fault(&self) -> Option<String> {
        self.forest.files().find_map(Self::fault_of)
    }

    fn fault_of(file: &EskerFile) -> Option<String> {
        let footer = file.footer();
        let offset = footer.file_bytes.checked_sub(FOOTER_BYTES as u64)?;
        let mut bytes = [0; FOOTER_BYTES];
        let what = match file.read_exact_at(&mut bytes, offset) {
            Ok(()) if bytes == footer.encode() => return None,
            Ok(()) => "it was changed or replaced since it was opened",
            Err(esker_format::FormatError::Io { source, .. })
                if source.kind() == std::io::ErrorKind::UnexpectedEof =>
            {
                "it was cut short since it was opened"
            }
            Err(_) => return None,
        };
        let path = file.path().display();
        Some(format!("{path}: {what}; what is loaded stays, open it again for the rest"))
    }
}
