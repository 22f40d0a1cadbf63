//! The journal of a build: what is done, record after record, so that a build that was cut short
//! goes on where it was. It lies beside the output under a hidden name. A record is whole or counts
//! for nothing: each has a length and a CRC-32, and what follows the last whole one is dropped.
//! Records come in the order of the steps of a build, which does not depend on time; so a phase
//! asks for the next record, and where there is none, does the work and tells.

use crate::error::BuildError;
use crate::input::identity::Identity;
use crate::rows::journal_record::{HEAD_BYTES, Kind, Reading, Record};
use esker_format::FormatError;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

/// What becomes of a build that is cut short.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resume {
    /// Nothing of it is kept.
    #[default]
    Never,
    /// What is done is kept, for a build that goes on.
    Later,
    /// As before; and this build goes on with what an earlier one has kept, if there is such.
    Now,
}

/// The journal of one build.
pub struct Journal {
    path: PathBuf,
    resume: Resume,
    /// What is built now.
    identity: Identity,
    /// `None` until it has begun.
    file: Option<File>,
    /// Length of the file, as far as it is whole and was read.
    bytes: u64,
    /// The next record of the earlier build.
    upcoming: Option<(u8, Vec<u8>)>,
    rows: Option<PathBuf>,
    is_resumed: bool,
    is_kept: bool,
    /// What is to be said of an earlier build that is given up.
    given_up: Option<String>,
}

impl Journal {
    /// The journal of a build of `out`: of an earlier one, where this is to go on with it and there
    /// is one. Else what an earlier one has left is deleted. The caller must hold the output's
    /// lock.
    ///
    /// # Errors
    /// Where an earlier build was made of something else, or its journal is damaged.
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
            given_up: None,
        };
        let earlier = OpenOptions::new().read(true).write(true).open(&journal.path);
        journal.file = match earlier {
            Ok(file) => Some(file),
            Err(e) if e.kind() == io::ErrorKind::NotFound => None,
            Err(e) => return Err(journal.failed("read it", e)),
        };
        if journal.file.is_some() {
            journal.is_kept = true;
            let begun = journal.begun();
            if resume == Resume::Now {
                journal.is_resumed = begun?;
            }
            if !journal.is_resumed {
                journal.delete();
            }
        }
        Ok(journal)
    }

    /// Reads the first record, whether there is one; takes over what it says.
    fn begun(&mut self) -> Result<bool, BuildError> {
        self.read()?;
        let Some((kind, content)) = self.upcoming.take() else { return Ok(false) };
        let mut from = Reading(&content);
        let mut read = || Some((from.get_text()?, Identity::get(&mut from)?));
        let (rows, earlier) = read()
            .filter(|_| kind == Kind::Begun as u8)
            .ok_or_else(|| self.damaged("its beginning"))?;
        self.rows = (!rows.is_empty()).then(|| rows.into());
        let difference = earlier.difference(&self.identity);
        if self.resume != Resume::Now {
            self.given_up = Some(match difference {
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

    /// Reads the next record; what is not whole is cut off.
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

    /// What this build, or the earlier one, may use for a chunk, in bytes.
    pub fn chunk_bytes_max(&self) -> u64 {
        self.identity.chunk_bytes_max
    }

    /// Whether this build goes on with an earlier one.
    pub fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// Of an earlier build that this one does not go on with: whether it could have.
    pub fn given_up(&self) -> Option<&str> {
        self.given_up.as_deref()
    }

    /// Whether there is something that a later build can go on with.
    pub fn is_begun(&self) -> bool {
        self.file.is_some()
    }

    /// Whether a record that is told now is kept.
    pub fn is_live(&self) -> bool {
        self.is_begun() && self.upcoming.is_none()
    }

    /// Whether the journal records rows in scratch.
    pub fn keeps_rows(&self) -> bool {
        self.is_live() && self.rows.is_some()
    }

    /// Where rows lie, where they can be gone on with.
    pub fn rows(&self) -> Option<&Path> {
        self.rows.as_deref()
    }

    /// Whether it may yet begin.
    pub fn may_begin(&self) -> bool {
        self.resume != Resume::Never && !self.is_begun()
    }

    /// Begins, with the file that rows will lie in, where they do.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn begin(&mut self, rows: Option<&Path>) -> Result<(), BuildError> {
        let file = File::create(&self.path).map_err(|e| self.failed("create it", e))?;
        (self.file, self.bytes, self.is_kept) = (Some(file), 0, false);
        self.rows = rows.map(Into::into);
        let mut record = Record::new(Kind::Begun);
        record.put_all(rows.and_then(Path::to_str).unwrap_or_default().as_bytes());
        self.identity.put(&mut record);
        self.tell(record)
    }

    /// The next record of the earlier build, where there is one. It must be of this kind.
    ///
    /// # Errors
    /// Where it is not.
    pub fn ask(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, BuildError> {
        match self.ask_if(kind)? {
            None if self.upcoming.is_some() => Err(self.damaged("the order of its records")),
            found => Ok(found),
        }
    }

    /// The next record of the earlier build, if it is of this kind.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn ask_if(&mut self, kind: Kind) -> Result<Option<Vec<u8>>, BuildError> {
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

    /// Keeps a record, where it is live. What the record speaks of must have been handed to the
    /// system before.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn tell(&mut self, record: Record) -> Result<(), BuildError> {
        if !self.is_live() {
            return Ok(());
        }
        let bytes = record.seal();
        let Some(file) = &mut self.file else { return Ok(()) };
        file.write_all(&bytes).map_err(|e| self.failed("write it", e))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Whether it stays when it is dropped.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Deletes what an earlier build has left.
    fn delete(&mut self) {
        if let Some(rows) = self.rows.take().filter(|path| crate::rows::scratch::is_ours(path)) {
            crate::rows::scratch::remove(&rows);
        }
        (self.file, self.upcoming, self.bytes) = (None, None, 0);
        let _ = fs::remove_file(&self.path);
    }

    /// Why it is no use.
    pub fn damaged(&self, what: &str) -> BuildError {
        self.refused(&format!("{what} is damaged"))
    }

    /// Why an earlier build cannot be gone on with.
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

/// Kind and content of the record at an offset, if it is whole.
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
