//! What lies behind the points that a header claims: lines, whole records, or bytes that are none.
//! It is left out, because a header that counts too few may as well describe other records; the
//! note says how much it is. Serves PLY and PCD.

use crate::error::ScanError;
use crate::text::blocks::LineBlocks;
use esker_points::Task;
use std::io::{BufRead, Read};
use std::path::Path;

/// What is left out behind the last point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rest {
    /// Lines that are not blank; `is_whole` if all of them could be counted.
    Lines { lines: u64, is_whole: bool },
    /// Whole records.
    Records(u64),
    /// Bytes that are not whole records.
    Bytes(u64),
}

impl Rest {
    /// Counts the lines to the end of the file, `counted` of which are read already.
    ///
    /// # Errors
    /// [`ScanError::Cancelled`].
    pub fn of_lines<R: Read>(
        counted: u64,
        lines: &mut LineBlocks<R>,
        task: &dyn Task,
    ) -> Result<Option<Self>, ScanError> {
        let (mut found, mut is_whole) = (counted, true);
        loop {
            task.check()?;
            match lines.next() {
                Ok(Some(block)) => found += block.rows,
                Ok(None) => break,
                // Lines that cannot be read are left out as well.
                Err(_) => {
                    (found, is_whole) = (found + 1, false);
                    break;
                }
            }
        }
        Ok((found > 0).then_some(Self::Lines { lines: found, is_whole }))
    }

    /// Counts the bytes to the end of the file; `stride` is the size of a record, if all have one.
    /// Without records, zeros are padding.
    ///
    /// # Errors
    /// If the file cannot be read; [`ScanError::Cancelled`].
    pub fn of_bytes(
        path: &Path,
        input: &mut impl BufRead,
        stride: Option<u64>,
        task: &dyn Task,
    ) -> Result<Option<Self>, ScanError> {
        let (mut bytes, mut are_zeros) = (0, true);
        loop {
            task.check()?;
            let here = match input.fill_buf() {
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
                other => other.map_err(|e| ScanError::io(path, e))?,
            };
            let length = here.len();
            if length == 0 {
                break;
            }
            are_zeros &= here.iter().all(|&byte| byte == 0);
            input.consume(length);
            bytes += length as u64;
        }
        if stride.is_none() && are_zeros {
            return Ok(None);
        }
        let records = stride.filter(|&stride| stride > 0 && bytes.is_multiple_of(stride));
        Ok(match (bytes, records) {
            (0, _) => None,
            (_, Some(stride)) => Some(Self::Records(bytes / stride)),
            (_, None) => Some(Self::Bytes(bytes)),
        })
    }

    /// The note on what is left out behind so many `points`, as the format calls them.
    pub fn note(self, claimed: u64, points: &str) -> String {
        let behind = format!("behind the {claimed} {points} that the header claims");
        match self {
            Self::Lines { lines: 1, is_whole: true } => format!("1 line {behind} is left out"),
            Self::Lines { lines, is_whole: true } => format!("{lines} lines {behind} are left out"),
            Self::Lines { lines, is_whole: false } => {
                format!("{lines} or more lines {behind} are left out")
            }
            Self::Records(1) => {
                format!("1 further record {behind} is left out: correct the header to read it")
            }
            Self::Records(n) => {
                format!(
                    "{n} further records {behind} are left out: correct the header to read them"
                )
            }
            Self::Bytes(1) => format!("1 byte {behind} is left out"),
            Self::Bytes(n) => format!("{n} bytes {behind} are left out: they are no whole records"),
        }
    }
}
