//! Errors of reading and writing .esker files: the file, the part, what to do.

use std::io;
use std::path::{Path, PathBuf};

/// Reason why an .esker file could not be written, read or trusted.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The system refused.
    #[error("{}: cannot {what}: {source}{}", path.display(), remedy(source))]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Attempted operation.
        what: &'static str,
        /// Error of the system.
        source: io::Error,
    },
    /// There is no valid footer.
    #[error(
        "{}: cut short, or not an .esker file ({fault}); build it again or copy it again",
        path.display()
    )]
    NotEsker {
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        fault: String,
    },
    /// A file that this version does not read.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// Path of the file.
        path: PathBuf,
        /// What the file is, and what to do.
        what: String,
    },
    /// Bytes that contradict their checksum or each other.
    #[error("{}: the {section} is damaged: {fault}; build it again or copy it again", path.display())]
    Damaged {
        /// Path of the file.
        path: PathBuf,
        /// Damaged part.
        section: String,
        /// What is wrong with it.
        fault: String,
    },
    /// Data to write break the rules of the format: a fault of the program, not of the user.
    #[error("{}: cannot be written: {fault}; please report this", path.display())]
    Unwritable {
        /// Path of the file.
        path: PathBuf,
        /// Broken rule.
        fault: String,
    },
    /// A file of a forest that does not belong to it.
    #[error("{}: its tree {} {fault}", path.display(), tree.display())]
    Forest {
        /// File that names it.
        path: PathBuf,
        /// Named file.
        tree: PathBuf,
        /// What is wrong with it, and what to do.
        fault: String,
    },
    /// A cloud that cannot be placed beside another one.
    #[error("{}: cannot be placed beside {}: it {fault}", path.display(), base.display())]
    Clouds {
        /// The cloud.
        path: PathBuf,
        /// The other one.
        base: PathBuf,
        /// What differs, and what to do.
        fault: String,
    },
    /// The user asked to stop.
    #[error("{0}")]
    Cancelled(#[from] esker_points::Cancelled),
}

/// What is wrong with some bytes, before the file is known that they belong to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Faulty part.
    pub section: String,
    /// What is wrong with it.
    pub fault: String,
    /// Whether it is not damaged, but of a later version.
    pub is_later: bool,
}

impl Fault {
    pub(crate) fn new(section: impl Into<String>, fault: impl Into<String>) -> Self {
        Self { section: section.into(), fault: fault.into(), is_later: false }
    }

    pub(crate) fn unknown_encoding(number: u8) -> Self {
        let fault = format!("encoding {number} is of a later version; use a newer Esker");
        Self { is_later: true, ..Self::new("values", fault) }
    }

    /// The same fault, reported for a plane of this name.
    pub(crate) fn of_plane(self, name: &str) -> Self {
        Self { section: format!("{name} plane"), ..self }
    }

    pub(crate) fn damaged(self, path: &Path) -> FormatError {
        if self.is_later {
            let what = format!("{}: {}", self.section, self.fault);
            return FormatError::Unsupported { path: path.into(), what };
        }
        FormatError::Damaged { path: path.into(), section: self.section, fault: self.fault }
    }

    pub(crate) fn unwritable(self, path: &Path) -> FormatError {
        let fault = format!("{}: {}", self.section, self.fault);
        FormatError::Unwritable { path: path.into(), fault }
    }
}

/// What to do about an error of the system.
fn remedy(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
            "; free space there, or name another place"
        }
        _ => "",
    }
}

pub(crate) fn io_error(
    path: &Path,
    what: &'static str,
) -> impl FnOnce(io::Error) -> FormatError + use<> {
    let path = path.to_path_buf();
    move |source| {
        let source = match source.kind() {
            io::ErrorKind::UnexpectedEof => io::Error::new(
                source.kind(),
                "it ends too early: it was cut short since it was opened; copy it again",
            ),
            _ => source,
        };
        FormatError::Io { path, what, source }
    }
}
