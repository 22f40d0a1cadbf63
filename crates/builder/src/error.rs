//! Why a build failed: which file, which phase, what to do.

use esker_format::FormatError;
use esker_points::Cancelled;
use esker_points::lattice::LatticeError;
use esker_scan::ScanError;
use std::path::{Path, PathBuf};

/// A build, or a comparison of a file with its inputs, failed. Nothing is left under the final
/// name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// An input could not be read.
    #[error(transparent)]
    Scan(#[from] ScanError),
    /// No lattice fits the inputs.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// The `.esker` file could not be written or read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Scratch space failed.
    #[error("{}: {phase}: {source}; free space there, or name another place with --scratch", path.display())]
    Scratch {
        /// The scratch file or folder.
        path: PathBuf,
        /// What was being done.
        phase: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// A disk has too little space for what is about to be done.
    #[error("{}: {what} at least {} MiB, {} MiB are free: {remedy}", path.display(), needed_bytes.div_ceil(1 << 20), free_bytes >> 20)]
    Space {
        /// The folder.
        path: PathBuf,
        /// What needs it.
        what: &'static str,
        /// How much it needs at least.
        needed_bytes: u64,
        /// How much is free.
        free_bytes: u64,
        /// What to do.
        remedy: &'static str,
    },
    /// The options contradict themselves or the inputs.
    #[error("{0}")]
    Options(String),
    /// The inputs have points, and none of them can be in a file.
    #[error("{inputs}: all of the {points} points were refused, so nothing was written ({why})")]
    Refused {
        /// The inputs, as far as they are few.
        inputs: String,
        /// How many points they have.
        points: u64,
        /// The reasons, and what to do.
        why: String,
    },
    /// The points that were written are not those that were read. Never seen; a defect of Esker.
    #[error("the points written are not the points read: {0}; please report this with the input")]
    Proof(String),
    /// The file's points are not those of the inputs.
    #[error("{0}")]
    Differs(String),
    /// An earlier build cannot be gone on with.
    #[error("{}: an earlier build cannot be resumed: {why}; give what it was given, or start afresh without --resume", path.display())]
    Resume {
        /// Its journal.
        path: PathBuf,
        /// What is in the way.
        why: String,
    },
    /// Cut short, with what is done kept.
    #[error("{0}; what is done is kept: the same command with --resume goes on from there")]
    Kept(#[source] Box<Self>),
    /// Stopped on request.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl BuildError {
    pub(crate) fn scratch(path: &Path, phase: &'static str, source: std::io::Error) -> Self {
        Self::Scratch { path: path.to_owned(), phase, source }
    }

    /// The system has no thread to give.
    pub(crate) fn no_thread(why: impl std::fmt::Display) -> Self {
        Self::Options(format!("cannot start a thread ({why}): ask for fewer"))
    }

    /// Whether what is done is of use to a build that goes on, once what is in its way is gone.
    pub(crate) fn is_passing(&self) -> bool {
        match self {
            Self::Scratch { .. } | Self::Cancelled(_) | Self::Resume { .. } => true,
            Self::Format(e) => matches!(e, FormatError::Io { .. }),
            Self::Scan(e) => matches!(e, ScanError::Io { .. }),
            _ => false,
        }
    }

    /// Carries an error through a reader's sink.
    pub(crate) fn through_sink(self) -> ScanError {
        match self {
            Self::Scan(e) => e,
            Self::Cancelled(c) => ScanError::Cancelled(c),
            other => ScanError::Sink(Box::new(other)),
        }
    }

    /// The inverse of [`BuildError::through_sink`].
    pub(crate) fn from_sink(error: ScanError) -> Self {
        match error {
            ScanError::Sink(inner) => match inner.downcast::<Self>() {
                Ok(ours) => *ours,
                Err(other) => Self::Scan(ScanError::Sink(other)),
            },
            ScanError::Cancelled(c) => Self::Cancelled(c),
            other => Self::Scan(other),
        }
    }
}
