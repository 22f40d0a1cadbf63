//! Positioned reads and writes that transfer all bytes, for each operating system.

#[cfg(unix)]
mod calls {
    use std::fs::File;
    use std::io::Result;
    use std::os::unix::fs::FileExt;

    /// Fills `buf` from `offset` on.
    ///
    /// # Errors
    /// If the file ends before, or cannot be read.
    pub fn read_exact_at(file: &File, buf: &mut [u8], offset: u64) -> Result<()> {
        file.read_exact_at(buf, offset)
    }

    /// Writes all of `bytes` from `offset` on.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> Result<()> {
        file.write_all_at(bytes, offset)
    }
}

#[cfg(windows)]
mod calls {
    use std::fs::File;
    use std::io::{Error, ErrorKind, Result};
    use std::os::windows::fs::FileExt;

    /// Fills `buf` from `offset` on.
    ///
    /// # Errors
    /// If the file ends before, or cannot be read.
    pub fn read_exact_at(file: &File, buf: &mut [u8], offset: u64) -> Result<()> {
        let mut done = 0;
        while done < buf.len() {
            let read = file.seek_read(&mut buf[done..], offset + done as u64);
            done += progress(read, ErrorKind::UnexpectedEof)?;
        }
        Ok(())
    }

    /// Writes all of `bytes` from `offset` on.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> Result<()> {
        let mut done = 0;
        while done < bytes.len() {
            let written = file.seek_write(&bytes[done..], offset + done as u64);
            done += progress(written, ErrorKind::WriteZero)?;
        }
        Ok(())
    }

    /// Bytes that a call transferred: 0 if it was interrupted, an error at the end.
    fn progress(result: Result<usize>, end: ErrorKind) -> Result<usize> {
        match result {
            Ok(0) => Err(Error::from(end)),
            Err(error) if error.kind() == ErrorKind::Interrupted => Ok(0),
            result => result,
        }
    }
}

pub use calls::{read_exact_at, write_all_at};
