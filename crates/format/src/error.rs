//! What can be wrong with an .esker file or with writing one: the file, the part, what to do.

use crate::layout::PlaneKind;
use std::io;
use std::path::{Path, PathBuf};

/// Why an .esker file could not be written, read or trusted.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The system refused.
    #[error("{}: cannot {what}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        what: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// No valid footer.
    #[error(
        "{}: cut short, or not an .esker file ({fault}); build it again or copy it again",
        path.display()
    )]
    NotEsker {
        /// The file.
        path: PathBuf,
        /// What gave it away.
        fault: String,
    },
    /// A valid file that this version does not read.
    #[error("{}: {what}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it is, and what to do.
        what: String,
    },
    /// Bytes that contradict their checksum or each other.
    #[error("{}: the {section} is damaged: {fault}; build it again or copy it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Which part.
        section: String,
        /// What is wrong with it.
        fault: String,
    },
    /// What was to be written breaks the format's rules: a fault of the program, not of the user.
    #[error("{}: cannot be written: {fault}; please report this", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Which rule.
        fault: String,
    },
    /// A file of a forest that does not belong to it.
    #[error("{}: its tree {} {fault}", path.display(), tree.display())]
    Forest {
        /// The file that names it.
        path: PathBuf,
        /// What is named.
        tree: PathBuf,
        /// What is wrong with it, and what to do.
        fault: String,
    },
    /// The user asked to stop.
    #[error("{0}")]
    Cancelled(#[from] esker_points::Cancelled),
}

/// What is wrong with some bytes, before it is known which file they belong to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Which part.
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

    /// The same fault, told of a plane.
    pub(crate) fn of_plane(self, kind: PlaneKind) -> Self {
        Self { section: format!("{} plane", kind.name()), ..self }
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

pub(crate) fn io_error(
    path: &Path,
    what: &'static str,
) -> impl FnOnce(io::Error) -> FormatError + use<> {
    let path = path.to_path_buf();
    move |source| FormatError::Io { path, what, source }
}
