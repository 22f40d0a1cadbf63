//! Test file for the unit tests of several modules: the hills of `tests/harness`, opened once.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../tests/harness/hills.rs"]
#[allow(dead_code, reason = "one file is enough here")]
mod hills;
#[path = "../tests/harness/random.rs"]
mod random;

use esker_format::{EskerFile, Forest};
use random::Random;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// 30,000 points in nodes of 300.
pub(crate) fn hills() -> Arc<Forest> {
    static FILE: OnceLock<Arc<Forest>> = OnceLock::new();
    let open = || {
        let bytes = Box::new(hills::file(30_000, 300));
        Arc::new(EskerFile::from_source(Path::new("hills"), bytes).unwrap().into())
    };
    Arc::clone(FILE.get_or_init(open))
}
