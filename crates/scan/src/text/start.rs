//! Reads the beginning of a text file and unifies its lines: bytes in any encoding in, lines that
//! end with LF out, in UTF-8 or an encoding that contains ASCII, without a byte order mark.

use super::blocks::LineBlocks;
use super::encoding::{Encoding, Utf16ToUtf8, encoding_of};
use crate::error::ScanError;
use crate::packed::open_stream;
use crate::runs::{Region, Runs};
use crate::source::HEAD_BYTES;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

/// Reads the first bytes of a file, from which its format is recognised.
///
/// # Errors
/// If the system refuses the read.
pub(crate) fn read_head(file: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::new();
    file.take(HEAD_BYTES).read_to_end(&mut head)?;
    Ok(head)
}

/// The lines in `head`, the beginning of a file. The last one is whole, unless it is the only one.
pub(crate) fn first_lines(head: &[u8]) -> Vec<u8> {
    let mut lines = in_utf_8(head);
    if ends_lines_with_cr(&lines) {
        to_lf(&mut lines);
    }
    if head.len() as u64 == HEAD_BYTES {
        let end = lines.iter().rposition(|&b| b == b'\n').unwrap_or(lines.len());
        lines.truncate(end);
    }
    lines
}

/// The lines of a file in blocks, from its beginning.
///
/// # Errors
/// If the file cannot be read.
pub(crate) fn lines_of(path: &Path) -> Result<LineBlocks<Box<dyn Read>>, ScanError> {
    let io = |e| ScanError::io(path, e);
    let (mut file, _) = open_stream(path)?;
    let head = read_head(&mut file).map_err(io)?;
    let is_cr = ends_lines_with_cr(&in_utf_8(&head));
    let (encoding, mark) = encoding_of(&head);
    let bytes = Cursor::new(head[mark..].to_vec()).chain(file);
    let input: Box<dyn Read> = match encoding {
        Encoding::Bytes => Box::new(bytes),
        Encoding::Utf16 { is_big } => Box::new(Utf16ToUtf8::new(bytes, is_big)),
    };
    let input = if is_cr { Box::new(CrToLf(input)) } else { input };
    Ok(LineBlocks::new(input, path.to_owned(), 1))
}

/// About one in `one_in` of the lines of a file from line `first_line` on, spread over all of it.
/// Their numbers count on from `first_line` as if no others were there.
///
/// # Errors
/// If the file cannot be read; if its characters have more than one byte.
pub(crate) fn some_lines_of(
    path: &Path,
    first_line: u64,
    one_in: u32,
) -> Result<LineBlocks<Box<dyn Read>>, ScanError> {
    let io = |e| ScanError::io(path, e);
    let mut file = File::open(path).map_err(io)?;
    let end = file.metadata().map_err(io)?.len();
    let head = read_head(&mut file).map_err(io)?;
    let (Encoding::Bytes, byte_order_mark) = encoding_of(&head) else {
        let what = "cannot be read in part: its text is UTF-16; write it as UTF-8";
        return Err(ScanError::unsupported(path, what));
    };
    let is_cr = ends_lines_with_cr(&head);
    let mark = if is_cr { b'\r' } else { b'\n' };
    file.rewind().map_err(io)?;
    let mut lines = BufReader::new(&file);
    let mut start = 0;
    for _ in 1..first_line {
        start += lines.skip_until(mark).map_err(io)? as u64;
    }
    let start = start.max(byte_order_mark as u64);
    let runs = Runs::new(file, Region::Lines { start, end, mark }, one_in);
    let input: Box<dyn Read> = if is_cr { Box::new(CrToLf(runs)) } else { Box::new(runs) };
    Ok(LineBlocks::new(input, path.to_owned(), first_line))
}

/// The text of `head` behind the byte order mark; UTF-16 as UTF-8.
fn in_utf_8(head: &[u8]) -> Vec<u8> {
    let (encoding, mark) = encoding_of(head);
    let bytes = &head[mark..];
    let mut text = Vec::new();
    match encoding {
        Encoding::Bytes => text.extend_from_slice(bytes),
        // Reading from memory does not fail.
        Encoding::Utf16 { is_big } => {
            let _ = Utf16ToUtf8::new(bytes, is_big).read_to_end(&mut text);
        }
    }
    text
}

/// Whether the lines of a file that begins with `head` end with CR alone.
fn ends_lines_with_cr(head: &[u8]) -> bool {
    head.contains(&b'\r') && !head.contains(&b'\n')
}

fn to_lf(text: &mut [u8]) {
    text.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
}

/// A stream with LF for each CR.
struct CrToLf<R>(R);

impl<R: Read> Read for CrToLf<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let bytes = self.0.read(buffer)?;
        to_lf(&mut buffer[..bytes]);
        Ok(bytes)
    }
}
