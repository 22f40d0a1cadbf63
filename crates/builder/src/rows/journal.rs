//! The journal of a build: the finished steps, record after record, from which an interrupted build
//! is resumed. It lies beside the output under a hidden name. Each record has a length and a
//! CRC-32; bytes after the last whole record are dropped. Records come in the order of the steps,
//! which does not depend on time: a phase reads the next record, or does the work and appends one.

use crate::error::BuildError;
use crate::input::identity::Identity;
use crate::options::Resume;
use crate::rows::journal_record::{HEAD_BYTES, Kind, Record, RecordReader};
use crate::rows::scratch;
use esker_format::FormatError;
use esker_points::place::{create_own, open_own};
use esker_points::unfinished;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

/// The journal of one build.
pub struct Journal {
    path: PathBuf,
    resume: Resume,
    /// Identity of this build, or of the one that it resumes.
    identity: Identity,
    /// `None` until the journal begins.
    file: Option<File>,
    /// Length of the whole records that were read or written.
    bytes: u64,
    /// Next record of the earlier build.
    upcoming: Option<(u8, Vec<u8>)>,
    /// Path of the first scratch file, if its rows can be resumed from.
    rows: Option<PathBuf>,
    is_resumed: bool,
    is_kept: bool,
    /// Why an earlier build was abandoned, for the user.
    abandoned: Option<String>,
}

impl Journal {
    /// Opens the journal of an interrupted build of `out` if `resume` is
    /// [`Resume::Now`] and there is one; if not, deletes what an earlier build has
    /// left. The caller must hold the output's lock.
    ///
    /// # Errors
    /// If the earlier build had other options or inputs, or its journal is damaged.
    pub fn open(out: &Path, resume: Resume, identity: Identity) -> Result<Self, BuildError> {
        let mut name = OsString::from(".");
        name.push(out.file_name().unwrap_or_default());
        name.push(".journal");
        let path = out.with_file_name(name);
        let mut journal = Self {
            path,
            resume,
            identity,
            file: None,
            bytes: 0,
            upcoming: None,
            rows: None,
            is_resumed: false,
            is_kept: false,
            abandoned: None,
        };
        let earlier = open_own(&journal.path);
        journal.file = match earlier {
            Ok(file) => Some(file),
            Err(e) if e.kind() == io::ErrorKind::NotFound => None,
            Err(e) => return Err(journal.failed("read it", e)),
        };
        if journal.file.is_some() {
            unfinished::keep_all();
            journal.is_kept = true;
            let has_start = journal.read_start();
            if resume == Resume::Now {
                journal.is_resumed = has_start?;
            }
            if !journal.is_resumed {
                journal.delete();
            }
        }
        Ok(journal)
    }

    /// A journal that keeps nothing.
    pub fn none() -> Self {
        Self {
            path: PathBuf::new(),
            resume: Resume::Never,
            identity: Identity::default(),
            file: None,
            bytes: 0,
            upcoming: None,
            rows: None,
            is_resumed: false,
            is_kept: false,
            abandoned: None,
        }
    }

    /// Reads and restores the first record; returns whether there is one.
    fn read_start(&mut self) -> Result<bool, BuildError> {
        self.read()?;
        let Some((kind, content)) = self.upcoming.take() else { return Ok(false) };
        let mut from = RecordReader(&content);
        let mut read = || Some((from.get_text()?, Identity::get(&mut from)?));
        let (rows, earlier) = read()
            .filter(|_| kind == Kind::Start as u8)
            .ok_or_else(|| self.damaged("its beginning"))?;
        self.rows = (!rows.is_empty()).then(|| rows.into());
        let difference = earlier.difference(&self.identity);
        if self.resume != Resume::Now {
            self.abandoned = Some(match difference {
                None => "--resume would have gone on with it".into(),
                Some(difference) => format!("it was of other things: {difference}"),
            });
            return Ok(true);
        }
        if let Some(difference) = difference {
            return Err(self.refused(&difference));
        }
        self.identity = earlier;
        self.read()?;
        Ok(true)
    }

    /// Reads the next record; bytes after the last whole record are cut off.
    fn read(&mut self) -> Result<(), BuildError> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let next = next_record(file, self.bytes);
        self.upcoming = match next {
            Ok(next) => next,
            Err(e) => return Err(self.failed("read it", e)),
        };
        if let Some((_, content)) = &self.upcoming {
            self.bytes += (HEAD_BYTES + content.len()) as u64;
            return Ok(());
        }
        let cut = file.set_len(self.bytes).and_then(|()| file.seek(io::SeekFrom::End(0)));
        cut.map(|_| ()).map_err(|e| self.failed("write it", e))
    }

    /// Memory for chunks of this build, or of the one that it resumes, in bytes.
    pub fn chunk_bytes_max(&self) -> u64 {
        self.identity.chunk_bytes_max
    }

    /// Whether this build resumes an earlier one.
    pub fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// Why an earlier build was abandoned, for the user.
    pub fn abandoned(&self) -> Option<&str> {
        self.abandoned.as_deref()
    }

    /// Whether there is anything that a later build can resume.
    pub fn is_begun(&self) -> bool {
        self.file.is_some()
    }

    /// Whether records are appended: the journal has begun, and no record of
    /// an earlier build is left.
    pub fn is_recording(&self) -> bool {
        self.is_begun() && self.upcoming.is_none()
    }

    /// Whether records of rows in scratch are appended.
    pub fn keeps_rows(&self) -> bool {
        self.is_recording() && self.rows.is_some()
    }

    /// Path of the first scratch file, if its rows can be resumed from.
    pub fn rows(&self) -> Option<&Path> {
        self.rows.as_deref()
    }

    /// Whether the journal has not begun, and may.
    pub fn may_begin(&self) -> bool {
        self.resume != Resume::Never && !self.is_begun()
    }

    /// Begins the journal. `rows` is the path of the first scratch file, if it has a name.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn begin(&mut self, rows: Option<&Path>) -> Result<(), BuildError> {
        let file = create_own(&self.path).map_err(|e| self.failed("create it", e))?;
        (self.file, self.bytes, self.is_kept) = (Some(file), 0, false);
        unfinished::keep_all();
        self.rows = rows.map(Into::into);
        let mut record = Record::new(Kind::Start);
        record.put_all(rows.and_then(Path::to_str).unwrap_or_default().as_bytes());
        self.identity.put(&mut record);
        self.append(record)
    }

    /// Content of the next record of the earlier build, which must be of this kind; `None` if no
    /// record is left.
    ///
    /// # Errors
    /// If the next record is of another kind, or the disk fails.
    pub fn next(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, BuildError> {
        match self.next_if(kind)? {
            None if self.upcoming.is_some() => Err(self.damaged("the order of its records")),
            content => Ok(content),
        }
    }

    /// Content of the next record of the earlier build, if it is of this kind.
    ///
    /// # Errors
    /// If the disk fails.
    pub fn next_if(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, BuildError> {
        match self.upcoming.take() {
            Some((k, content)) if k == kind as u8 => {
                self.read()?;
                Ok(Some(content))
            }
            other => {
                self.upcoming = other;
                Ok(None)
            }
        }
    }

    /// Appends a record if [`Self::is_recording`]. The rows or pages that it describes must have
    /// been written to their file before.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn append(&mut self, record: Record) -> Result<(), BuildError> {
        if !self.is_recording() {
            return Ok(());
        }
        let bytes = record.seal();
        let Some(file) = &mut self.file else { return Ok(()) };
        file.write_all(&bytes).map_err(|e| self.failed("write it", e))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Sets whether the file stays when the journal is dropped.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Deletes the journal and the scratch files of an earlier build.
    fn delete(&mut self) {
        if let Some(rows) = self.rows.take().filter(|path| scratch::has_scratch_name(path)) {
            scratch::remove(&rows);
        }
        (self.file, self.upcoming, self.bytes) = (None, None, 0);
        let _ = fs::remove_file(&self.path);
    }

    /// The error for damaged data of an earlier build.
    pub fn damaged(&self, what: &str) -> BuildError {
        self.refused(&format!("{what} is damaged"))
    }

    /// The error for an earlier build that cannot be resumed.
    pub fn refused(&self, why: &str) -> BuildError {
        BuildError::Resume { path: self.path.clone(), why: why.into() }
    }

    fn failed(&self, what: &'static str, source: io::Error) -> BuildError {
        FormatError::Io { path: self.path.clone(), what, source }.into()
    }
}

impl Drop for Journal {
    fn drop(&mut self) {
        if self.file.take().is_some() && !self.is_kept {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Kind and content of the record at `offset`, if it is whole.
fn next_record(file: &mut File, offset: u64) -> io::Result<Option<(u8, Vec<u8>)>> {
    let left = file.metadata()?.len().saturating_sub(offset);
    if left < HEAD_BYTES as u64 {
        return Ok(None);
    }
    file.seek(io::SeekFrom::Start(offset))?;
    let mut head = [0; HEAD_BYTES];
    file.read_exact(&mut head)?;
    let [b @ .., _, _, _, _, kind] = head;
    let bytes = u64::from_le_bytes(b);
    if bytes > left - HEAD_BYTES as u64 {
        return Ok(None);
    }
    let mut content = vec![0; bytes as usize];
    file.read_exact(&mut content)?;
    let mut crc = crc32fast::Hasher::new();
    crc.update(&[kind]);
    crc.update(&content);
    Ok((crc.finalize().to_le_bytes() == head[8..12]).then_some((kind, content)))
}
