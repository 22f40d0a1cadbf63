//! Cuts a byte stream into blocks of whole lines, and processes blocks on all cores with results in
//! order. Blocks have at most 256 KiB, so neither long files nor long lines cost memory. Serves the
//! text reader and the ASCII body of PLY; the ordered processing serves binary PLY as well.

use crate::ahead::Ahead;
use crate::error::ScanError;
use esker_points::Task;
use std::collections::VecDeque;
use std::io::Read;
use std::path::PathBuf;

/// Greatest size of a block, in bytes. A point takes at least 6 (`0 0 0` and the line end), so the
/// points of a block always fit a batch.
pub(crate) const BLOCK_BYTES: usize = 256 << 10;
/// Greatest size of a line, in bytes.
pub(crate) const LINE_BYTES_MAX: usize = 64 << 10;
/// Greatest number of blocks under way, whatever the number of cores: 16 cost a few MiB.
const BLOCKS_AT_ONCE_MAX: usize = 16;

/// A run of whole lines.
pub(crate) struct LineBlock {
    /// The lines with their ends; only the last line of a file may lack one.
    pub bytes: Vec<u8>,
    /// Number of its first line in the file, from 1.
    pub first_line: u64,
    /// Number of its lines that are not blank.
    pub rows: u64,
}

impl LineBlock {
    /// Its lines that are not blank, without blanks at either end, and their numbers.
    pub fn lines(&self) -> impl Iterator<Item = (u64, &[u8])> {
        let numbered = (self.first_line..).zip(self.bytes.split(|&b| b == b'\n'));
        numbered.map(|(n, line)| (n, line.trim_ascii())).filter(|(_, line)| !line.is_empty())
    }

    /// Its lines that are not blank, with the tabs at either end, and their numbers.
    pub fn lines_with_tabs(&self) -> impl Iterator<Item = (u64, &[u8])> {
        let numbered = (self.first_line..).zip(self.bytes.split(|&b| b == b'\n'));
        let numbered = numbered.filter(|(_, line)| !line.iter().all(u8::is_ascii_whitespace));
        numbered.map(|(n, line)| (n, line.strip_suffix(b"\r").unwrap_or(line)))
    }
}

/// Cuts a stream into blocks of whole lines.
pub(crate) struct LineBlocks<R> {
    input: R,
    path: PathBuf,
    carry: Vec<u8>,
    next_line: u64,
    ended: bool,
}

impl<R: Read> LineBlocks<R> {
    /// Reads `input`, whose first line has the number `first_line` in messages.
    pub fn new(input: R, path: PathBuf, first_line: u64) -> Self {
        Self { input, path, carry: Vec::new(), next_line: first_line, ended: false }
    }

    /// The next block; `None` at the end.
    ///
    /// # Errors
    /// If the stream cannot be read or a line is longer than [`LINE_BYTES_MAX`].
    pub fn next(&mut self) -> Result<Option<LineBlock>, ScanError> {
        if self.ended {
            return Ok(None);
        }
        let mut bytes = std::mem::take(&mut self.carry);
        let room = (BLOCK_BYTES - bytes.len()) as u64;
        let read = self.input.by_ref().take(room).read_to_end(&mut bytes);
        read.map_err(|e| ScanError::io(&self.path, e))?;
        self.ended = bytes.len() < BLOCK_BYTES;
        if !self.ended {
            let end = bytes.iter().rposition(|&b| b == b'\n').map_or(0, |i| i + 1);
            self.carry = bytes.split_off(end);
        }
        let mut block = LineBlock { bytes, first_line: self.next_line, rows: 0 };
        let mut lines = 0;
        for line in block.bytes.split(|&b| b == b'\n') {
            if line.len() > LINE_BYTES_MAX {
                return Err(self.line_too_long(block.first_line + lines));
            }
            lines += 1;
            block.rows += u64::from(!line.trim_ascii().is_empty());
        }
        // After the last line end, the first line of the next block begins, still empty.
        self.next_line += lines - 1;
        if self.carry.len() > LINE_BYTES_MAX {
            return Err(self.line_too_long(self.next_line));
        }
        Ok(Some(block).filter(|b| !b.bytes.is_empty()))
    }

    fn line_too_long(&self, line: u64) -> ScanError {
        let limit = LINE_BYTES_MAX >> 10;
        ScanError::damaged(
            &self.path,
            format!("line {line} is longer than {limit} KiB; lines end with LF or CR LF"),
        )
    }
}

/// Takes blocks from `next`, runs `work` on several at once on the threads of the current pool, and
/// passes the results to `each` in the order of the blocks.
///
/// # Errors
/// The first error of any of the three; [`ScanError::Cancelled`].
pub(crate) fn in_order<B: Send, T: Send>(
    task: &dyn Task,
    mut next: impl FnMut() -> Result<Option<B>, ScanError>,
    work: impl Fn(B) -> Result<T, ScanError> + Sync,
    mut each: impl FnMut(T) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let at_once = (2 * rayon::current_num_threads()).min(BLOCKS_AT_ONCE_MAX);
    let work = &work;
    rayon::in_place_scope_fifo(|scope| {
        let (mut under_way, mut end) = (VecDeque::with_capacity(at_once), None);
        loop {
            task.check()?;
            while end.is_none() && under_way.len() < at_once {
                match next() {
                    Ok(Some(block)) => {
                        under_way.push_back(Ahead::begin(scope, move || work(block)));
                    }
                    Ok(None) => end = Some(Ok(())),
                    // Earlier blocks are passed on first; their errors take precedence.
                    Err(error) => end = Some(Err(error)),
                }
            }
            match under_way.pop_front().map(Ahead::wait) {
                // If the task has panicked, the scope panics, too.
                Some(result) => each(
                    result.unwrap_or(Err(ScanError::Cancelled(esker_points::task::Cancelled)))?,
                )?,
                None => return end.unwrap_or(Ok(())),
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;

    fn blocks(text: &[u8]) -> Result<Vec<LineBlock>, ScanError> {
        let mut reader = LineBlocks::new(text, "f.txt".into(), 1);
        let mut all = Vec::new();
        while let Some(block) = reader.next()? {
            all.push(block);
        }
        Ok(all)
    }

    #[test]
    fn lines_are_never_cut_and_keep_their_numbers() {
        let lines: Vec<String> =
            (0..90_000).map(|i| if i % 7 == 0 { String::new() } else { i.to_string() }).collect();
        let text = lines.join("\r\n");
        let blocks = blocks(text.as_bytes()).unwrap();
        assert!(blocks.len() > 2);
        let got: Vec<(u64, Vec<u8>)> =
            blocks.iter().flat_map(|b| b.lines().map(|(n, l)| (n, l.to_vec()))).collect();
        let want: Vec<(u64, Vec<u8>)> = (1..)
            .zip(&lines)
            .filter(|(_, l)| !l.is_empty())
            .map(|(n, l)| (n, l.clone().into_bytes()))
            .collect();
        assert_eq!(got, want);
        assert_eq!(blocks.iter().map(|b| b.rows).sum::<u64>(), want.len() as u64);
    }

    #[test]
    fn a_line_without_end_is_refused_by_number() {
        for length in [LINE_BYTES_MAX + 1, BLOCK_BYTES, 3 * BLOCK_BYTES] {
            let mut text = b"1 2 3\n".to_vec();
            text.resize(text.len() + length, b'7');
            let error = blocks(&text).err().unwrap().to_string();
            assert!(error.contains("line 2 is longer than 64 KiB"), "{error}");
        }
    }

    #[test]
    fn results_come_in_the_order_of_the_blocks() {
        let mut blocks = 0..1000u32;
        let mut got = Vec::new();
        let each = |b| {
            got.push(b);
            Ok(())
        };
        in_order(&Silent, || Ok(blocks.next()), |b| Ok(b * 2), each).unwrap();
        assert_eq!(got, (0..1000).map(|b| b * 2).collect::<Vec<_>>());
    }
}
