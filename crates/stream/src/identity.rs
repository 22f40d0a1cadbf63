//! Whether the file is still the one that was opened: its footer, read again, at most once a second
//! while loading and whenever a read fails. Bytes that are read may be anything after a change; the
//! picture is then wrong but nothing else is.

use esker_format::EskerFile;
use esker_format::footer::FOOTER_BYTES;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

/// Between two looks at the footer, milliseconds: a read of 192 bytes then costs nothing.
const PAUSE_MS: u64 = 1000;

/// Looks at the footer.
#[derive(Debug)]
pub(crate) struct Identity {
    file: Arc<EskerFile>,
    opened: Instant,
    /// When the next look is due, milliseconds after opening.
    due_ms: AtomicU64,
}

impl Identity {
    pub(crate) fn new(file: Arc<EskerFile>) -> Self {
        Self { file, opened: Instant::now(), due_ms: AtomicU64::new(PAUSE_MS) }
    }

    /// As [`Identity::fault`], where nobody has looked for a while.
    pub(crate) fn fault_if_due(&self) -> Option<String> {
        let now_ms = self.opened.elapsed().as_millis() as u64;
        let due_ms = self.due_ms.load(Relaxed);
        let is_mine = now_ms >= due_ms
            && self.due_ms.compare_exchange(due_ms, now_ms + PAUSE_MS, Relaxed, Relaxed).is_ok();
        if is_mine { self.fault() } else { None }
    }

    /// What has become of the file; `None` where its footer is in its place, or cannot be read for
    /// other reasons than its end.
    pub(crate) fn fault(&self) -> Option<String> {
        let footer = self.file.footer();
        let offset = footer.file_bytes.checked_sub(FOOTER_BYTES as u64)?;
        let mut bytes = [0; FOOTER_BYTES];
        let what = match self.file.read_exact_at(&mut bytes, offset) {
            Ok(()) if bytes == footer.encode() => return None,
            Ok(()) => "it was changed or replaced since it was opened",
            Err(esker_format::FormatError::Io { source, .. })
                if source.kind() == std::io::ErrorKind::UnexpectedEof =>
            {
                "it was cut short since it was opened"
            }
            Err(_) => return None,
        };
        let path = self.file.path().display();
        Some(format!("{path}: {what}; what is loaded stays, open it again for the rest"))
    }
}
