//! What may be wrong with a scene document.

use crate::limits::{BYTES_MAX, VERSION};
use std::io;
use thiserror::Error;

/// Why a text is no scene document of this version.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The file cannot be read.
    #[error("cannot read the scene document")]
    Read(#[from] io::Error),
    /// The file is longer than documents may be.
    #[error("is longer than {} MiB, too long for a scene document", BYTES_MAX >> 20)]
    TooLong,
    /// The text is not a JSON object with the field `esker_scene`.
    #[error("is no scene document: it needs \"esker_scene\": {version}", version = VERSION)]
    NoScene,
    /// The document has another version.
    #[error(
        "is a scene document of version {found}, and this program reads version {version}: \
         update Esker, or write the document for version {version}",
        version = VERSION
    )]
    Version {
        /// Version of the document, as it stands there.
        found: String,
    },
    /// A field is unknown, missing, or has a value that it cannot have.
    #[error("`{field}`: {fault}")]
    Field {
        /// Path of the field, such as `clouds[0].file`.
        field: String,
        /// What is wrong with it.
        fault: String,
    },
}

impl SceneError {
    /// The fault of a field.
    pub(crate) fn of(field: impl Into<String>, fault: impl Into<String>) -> Self {
        Self::Field { field: field.into(), fault: fault.into() }
    }
}
