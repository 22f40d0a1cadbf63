//! Why an input could not be read or an output written: which file, what is wrong, what to do.

use esker_points::Cancelled;
use std::io;
use std::path::{Path, PathBuf};

/// An input could not be read, or an output written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// The system refused a read.
    #[error("{}: cannot read: {source}", path.display())]
    Io {
        /// The input.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file could not be written.
    #[error("{}: cannot write: {source}{}", path.display(), remedy(source))]
    Write {
        /// The final path of the file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The content is of no known format.
    #[error("{}: not a scan file that Esker knows (it reads {known}; if it is text whose points follow other lines, pass over those with --skip-lines N)", path.display())]
    UnknownFormat {
        /// The input.
        path: PathBuf,
        /// Names of the formats that are read.
        known: String,
    },
    /// The file is damaged or contradicts itself.
    #[error("{}: {what}", path.display())]
    Damaged {
        /// The input.
        path: PathBuf,
        /// What is wrong and, if something can be done, what.
        what: String,
    },
    /// The file is sound, but of a kind that is not read.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The input.
        path: PathBuf,
        /// What is not read, and what to do instead.
        what: String,
    },
    /// A point lies outside the lattice chosen from the headers.
    #[error("{}: a point at {world:?} lies outside the bounds that the headers claim", path.display())]
    OffLattice {
        /// The input.
        path: PathBuf,
        /// The point, in the file's coordinates.
        world: [f64; 3],
    },
    /// Cancelled on request.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The sink of the batches failed; carries its error through the reader.
    #[error(transparent)]
    Sink(Box<dyn std::error::Error + Send + Sync>),
}

impl ScanError {
    /// Makes the error of a damaged file.
    pub fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), what: what.into() }
    }

    /// Makes the error of a sound file of a kind that is not read.
    pub fn unsupported(path: &Path, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), what: what.into() }
    }

    /// Makes the error of a refused write.
    pub fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// Makes the error of a refused read.
    pub fn io(path: &Path, source: io::Error) -> Self {
        let source = match source.kind() {
            io::ErrorKind::UnexpectedEof => io::Error::new(
                source.kind(),
                "it ends too early: it is cut short, or was while it was read; copy it again",
            ),
            _ => source,
        };
        Self::Io { path: path.to_owned(), source }
    }
}

fn remedy(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
            "; free space there, or name another place"
        }
        _ => "",
    }
}
