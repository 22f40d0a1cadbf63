//! Exceptions. What the system refuses is an `OSError` of the kind that Python has for it; all else
//! that the engine refuses is an `EskerError`. Both have the engine's message: which file, what is
//! wrong, what to do.

use anyhow::Error;
use esker_engine::BuildError;
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyOSError, PyValueError};
use pyo3::prelude::*;
use std::io::{self, ErrorKind};

create_exception!(esker, EskerError, PyException, "What Esker refuses, and what to do.");
create_exception!(esker, LossError, EskerError, "Points of an input would be lost.");

/// Numbers of errors that differ between systems in nothing that matters here.
const NO_SUCH_FILE: i32 = 2;
const NOT_PERMITTED: i32 = 13;

/// The exception for an error of the engine.
pub fn exception(error: &Error) -> PyErr {
    let message = esker_engine::one_line(error);
    let of_build = error.chain().find_map(|cause| cause.downcast_ref::<BuildError>());
    if let Some(BuildError::Lost { .. }) = of_build {
        let remedy = "with allow_loss=True they are left out and counted";
        return LossError::new_err(format!("{message}; {remedy}"));
    }
    if let Some(BuildError::Refused { .. } | BuildError::Proof(_)) = of_build {
        return LossError::new_err(message);
    }
    let fault = error.chain().find_map(|cause| cause.downcast_ref::<io::Error>());
    let number = fault.and_then(|fault| match (fault.raw_os_error(), fault.kind()) {
        (Some(number), _) => Some(number),
        (None, ErrorKind::NotFound) => Some(NO_SUCH_FILE),
        (None, ErrorKind::PermissionDenied) => Some(NOT_PERMITTED),
        _ => None,
    });
    match (number, fault.map(io::Error::kind)) {
        // Python chooses the class by the number, such as FileNotFoundError.
        (Some(number), _) => PyOSError::new_err((number, message)),
        // A file that ends too early, or has other bytes than it should, is damaged.
        (None, None | Some(ErrorKind::UnexpectedEof | ErrorKind::InvalidData)) => {
            EskerError::new_err(message)
        }
        (None, Some(_)) => PyOSError::new_err(message),
    }
}

/// The exception for an argument.
pub fn wrong(what: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(what.to_string())
}
