//! Errors of builds, exports and verification: which file, which phase, what to do.

use esker_format::FormatError;
use esker_points::Cancelled;
use esker_points::lattice::LatticeError;
use esker_scan::ScanError;
use std::path::{Path, PathBuf};

/// Why a build, an export or a comparison of a file with its inputs failed. There is no file under
/// the final name.
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
        /// Scratch file or folder.
        path: PathBuf,
        /// Operation that failed.
        phase: &'static str,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A disk has less free space than the build needs.
    #[error("{}: {what} at least {} MiB, {} MiB are free: {remedy}", path.display(), needed_bytes.div_ceil(1 << 20), free_bytes >> 20)]
    Space {
        /// The folder.
        path: PathBuf,
        /// Subject and verb of the message, such as "scratch files need".
        what: &'static str,
        /// Least bytes needed.
        needed_bytes: u64,
        /// Free bytes.
        free_bytes: u64,
        /// Advice for the user.
        remedy: &'static str,
    },
    /// The options contradict themselves or the inputs.
    #[error("{0}")]
    Options(String),
    /// The inputs have points, but all were refused.
    #[error("{inputs}: all of the {points} points were refused, so nothing was written ({why})")]
    Refused {
        /// Names of the inputs, or of the first ones.
        inputs: String,
        /// Number of points.
        points: u64,
        /// The reasons, and what to do.
        why: String,
    },
    /// Some points were refused, which the options do not allow.
    #[error("{inputs}: {points} points were refused, so nothing was written ({why})")]
    Lost {
        /// Names of the inputs, or of the first ones.
        inputs: String,
        /// Number of points.
        points: u64,
        /// The reasons.
        why: String,
    },
    /// The points written are not the points read, because of a defect of Esker.
    #[error("the points written are not the points read: {0}; please report this with the input")]
    Proof(String),
    /// The file's points are not those of the inputs.
    #[error("{0}")]
    Differs(String),
    /// An earlier build cannot be resumed.
    #[error("{}: an earlier build cannot be resumed: {why}; give what it was given, or start afresh without --resume", path.display())]
    Resume {
        /// Journal of the earlier build.
        path: PathBuf,
        /// The reason.
        why: String,
    },
    /// The build was interrupted, and its finished steps are kept.
    #[error("{0}; what is done is kept: the same command with --resume goes on from there")]
    Kept(#[source] Box<Self>),
    /// An output of a step of a divided build could not be written or read.
    #[error("{name}: {phase}: {source}")]
    Place {
        /// Name of the object, with that of the place.
        name: String,
        /// Operation that failed.
        phase: &'static str,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A step of a divided build cannot be done, or has done something else than was planned.
    #[error("{name}: {why}")]
    Step {
        /// Name of the output or input, with that of the place.
        name: String,
        /// The reason, and what to do.
        why: String,
    },
    /// Stopped on request.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl BuildError {
    pub(crate) fn scratch(path: &Path, phase: &'static str, source: std::io::Error) -> Self {
        Self::Scratch { path: path.to_owned(), phase, source }
    }

    /// The error for a point of the input `path` at `world` that the lattice of the file that is
    /// appended to does not hold.
    pub(crate) fn misfit(path: &Path, world: [f64; 3]) -> Self {
        let [x, y, z] = world;
        Self::Options(format!(
            "{}: the point at {x} {y} {z} is outside of the coordinates that the file appended to can hold: build both anew into one file, or leave such points out with --drop-outside",
            path.display()
        ))
    }

    /// The error for a thread that the system did not start.
    pub(crate) fn no_thread(why: impl std::fmt::Display) -> Self {
        Self::Options(format!("cannot start a thread ({why}): ask for fewer"))
    }

    /// Whether the build can be resumed once the cause of this error is removed.
    pub(crate) fn is_resumable(&self) -> bool {
        match self {
            Self::Scratch { .. } | Self::Cancelled(_) | Self::Resume { .. } => true,
            Self::Format(e) => matches!(e, FormatError::Io { .. }),
            Self::Scan(e) => matches!(e, ScanError::Io { .. }),
            _ => false,
        }
    }

    /// Wraps an error to pass it through the sink of a reader.
    pub(crate) fn through_sink(self) -> ScanError {
        match self {
            Self::Scan(e) => e,
            Self::Cancelled(c) => ScanError::Cancelled(c),
            other => ScanError::Sink(Box::new(other)),
        }
    }

    /// Unwraps an error that [`BuildError::through_sink`] has wrapped.
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
