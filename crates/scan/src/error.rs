//! Why an input could not be read: which file, what is wrong, what to do.

use esker_points::Cancelled;
use std::path::{Path, PathBuf};

/// An input could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// The system refused a read.
    #[error("{}: cannot read: {source}", path.display())]
    Io {
        /// The input.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("{}: cannot write: {source}{}", path.display(), remedy(source))]
    Write {
        /// The file as it was to be called.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Its content is of no known format.
    #[error("{}: not a scan file that Esker knows (it reads {known})", path.display())]
    UnknownFormat {
        /// The input.
        path: PathBuf,
        /// The formats read.
        known: String,
    },
    /// The file is damaged, or lies about itself.
    #[error("{}: {what}", path.display())]
    Damaged {
        /// The input.
        path: PathBuf,
        /// What is wrong and, where something can be done, what.
        what: String,
    },
    /// The file is sound but of a kind that is not read.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The input.
        path: PathBuf,
        /// What is not read, and a way out.
        what: String,
    },
    /// A point lies outside the lattice chosen from the headers.
    #[error("{}: a point at {world:?} lies outside the bounds that the headers claim", path.display())]
    OffLattice {
        /// The input.
        path: PathBuf,
        /// The point.
        world: [f64; 3],
    },
    /// Stopped on request.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The taker of the batches failed; carries its error through the reader.
    #[error(transparent)]
    Sink(Box<dyn std::error::Error + Send + Sync>),
}

impl ScanError {
    /// A damaged file.
    pub fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), what: what.into() }
    }

    /// A sound file of a kind that is not read.
    pub fn unsupported(path: &Path, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), what: what.into() }
    }

    /// A refused write.
    pub fn write(path: &Path, source: std::io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// A refused read.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }
}

fn remedy(source: &std::io::Error) -> &'static str {
    match source.kind() {
        std::io::ErrorKind::StorageFull => "; free space there, or name another place",
        _ => "",
    }
}
