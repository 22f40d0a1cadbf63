//! The kind of an input, from its first bytes, and COPC files that are drawn as they are.

use anyhow::{Context, Result};
use esker_builder::Options;
use esker_format::Forest;
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

/// Whether a file is COPC, which is drawn as it is.
///
/// # Errors
/// If it cannot be read.
pub fn is_copc(path: &Path) -> Result<bool> {
    if esker_scan::synthetic::is_spec(path) || path.is_dir() {
        return Ok(false);
    }
    let context = || format!("{}: cannot open it", path.display());
    esker_builder::copc::is_copc(path).with_context(context)
}

/// Opens a COPC file as a tree, without building it; `None` for all other inputs, and if the
/// options ask for what only a build gives.
///
/// # Errors
/// If it cannot be read, or is damaged.
pub fn open_copc(path: &Path, options: &Options) -> Result<Option<Forest>> {
    if options.ask_for_build() || !is_copc(path)? {
        return Ok(None);
    }
    let file = esker_builder::copc::open(path, &options.open_options(), COPC_CACHE_BYTES)?;
    Ok(Some(file.into()))
}

/// Opens what has a tree: an `.esker` file with the files that it names, or a COPC file, with all
/// of its octree.
///
/// # Errors
/// If it cannot be read, is damaged, or has no tree.
pub fn open_tree(path: &Path) -> Result<Forest> {
    match open_copc(path, &Options::default())? {
        Some(forest) => Ok(forest.grown(false)?),
        None => Ok(Forest::open(path)?),
    }
}

/// Most bytes of decoded chunks of a COPC file that are kept.
const COPC_CACHE_BYTES: u64 = esker_builder::copc::CACHE_BYTES;
