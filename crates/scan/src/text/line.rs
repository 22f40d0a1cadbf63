//! Lines of text: whether they are text, whether they are a count, and their beginning for a
//! message.

use super::encoding::decoded;

/// The beginning of a line, or of a part of one, for a message.
pub(crate) fn excerpt(line: &[u8]) -> String {
    excerpt_of(line, 40)
}

/// The beginning of a line, of at most so many bytes, for a message.
pub(crate) fn excerpt_of(line: &[u8], bytes: usize) -> String {
    let line = line.trim_ascii();
    let cut = if line.len() > bytes { "..." } else { "" };
    let mut end = line.len().min(bytes);
    // No character of UTF-8 is cut.
    while end < line.len() && end > bytes - 3 && line[end] & 0xC0 == 0x80 {
        end -= 1;
    }
    let text = decoded(&line[..end]);
    format!("{}{cut}", text.escape_debug())
}

/// The number in a line that has only a count.
pub(crate) fn count(line: &[u8]) -> Option<u64> {
    let is_one = !line.is_empty() && line.iter().all(u8::is_ascii_digit);
    std::str::from_utf8(line).ok().filter(|_| is_one)?.parse().ok()
}

/// Whether bytes are text: form feeds and the end mark of DOS (0x1A) occur in real files.
pub(crate) fn is_text(bytes: &[u8]) -> bool {
    bytes.iter().all(|b| *b >= 0x20 || b.is_ascii_whitespace() || *b == 0x1A)
}
