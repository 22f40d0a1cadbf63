//! The kind of an input, from its first bytes.

use anyhow::{Context, Result};
use esker_format::footer::HEADER_MAGIC;
use esker_points::place::no_file_at;
use esker_points::read_at::{self, Input, is_remote};
use std::path::Path;

/// Whether a file is an `.esker` file; false for generated scans, and for folders of scans.
///
/// # Errors
/// If the file cannot be read.
pub fn is_esker(path: &Path) -> Result<bool> {
    use std::io::Read;
    if esker_scan::synthetic::is_spec(path) || path.is_dir() {
        return Ok(false);
    }
    let mut head = Vec::new();
    let context = || format!("{}: cannot open", path.display());
    if !is_remote(path)
        && let Some(what) = no_file_at(path).with_context(context)?
    {
        anyhow::bail!("{}: {what}", path.display());
    }
    let file = read_at::open(path).and_then(Input::new).with_context(context)?;
    file.take(HEADER_MAGIC.len() as u64)
        .read_to_end(&mut head)
        .with_context(|| format!("{}: cannot read", path.display()))?;
    Ok(head == HEADER_MAGIC)
}
