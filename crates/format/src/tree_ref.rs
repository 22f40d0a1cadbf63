//! References of a file to others whose trees belong to it: by relative paths, and by the hashes of
//! their footers. In: the reference and the place of the file that has it; out: the opened file.

use crate::error::FormatError;
use crate::metadata::TreeRef;
use crate::reader::EskerFile;
use esker_points::address::{is_below, is_remote};
use std::path::{Component, Path, PathBuf};

/// Opens a file that another names.
///
/// # Errors
/// If it cannot be opened, or is not the named one.
pub fn open_named(path: &Path, at: &Path, tree: &TreeRef) -> Result<EskerFile, FormatError> {
    let fault = |fault: String| FormatError::Forest { path: path.into(), tree: at.into(), fault };
    if is_remote(path) && !is_below(&tree.path) {
        return Err(fault(
            "is not beside the file that names it or below, which is not opened at addresses"
                .into(),
        ));
    }
    // Opening a pipe or a device may block for ever.
    if at.metadata().is_ok_and(|m| !m.is_file()) {
        return Err(fault("is not a file".into()));
    }
    let file = EskerFile::open(at).map_err(|error| {
        let error = error.to_string();
        let plain = error.strip_prefix(&format!("{}: ", at.display())).unwrap_or(&error);
        fault(format!(
            "does not open: {plain}; keep the files of a forest in the same folders relative to each other"
        ))
    })?;
    let hash = file.footer().name_hash();
    if hash != tree.footer_hash {
        return Err(fault(format!(
            "is not the file that was named (its footer's hash is {hash:032x}, not {:032x}); put the right \
             one in its place, or append again",
            tree.footer_hash
        )));
    }
    Ok(file)
}

impl TreeRef {
    /// Reference to an opened file in a file at `from`: the relative path from the folder of that
    /// file.
    ///
    /// # Errors
    /// If there is no such path, or the name is not Unicode.
    pub fn new(from: &Path, file: &EskerFile) -> Result<Self, FormatError> {
        let unnamed = |fault: &str| FormatError::Forest {
            path: from.into(),
            tree: file.path().into(),
            fault: fault.into(),
        };
        let absolute = |path: &Path| {
            let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
            path.canonicalize().map_err(crate::error::io_error(path, "find it"))
        };
        let folder = absolute(from.parent().unwrap_or(Path::new("")))?;
        let relative = relative_path(&folder, &absolute(file.path())?).ok_or_else(|| {
            unnamed("lies on another drive; write the forest where its files are")
        })?;
        let parts: Option<Vec<_>> = relative.iter().map(|part| part.to_str()).collect();
        let parts = parts.ok_or_else(|| unnamed("has a name that is not Unicode; rename it"))?;
        Ok(Self { path: parts.join("/"), footer_hash: file.footer().name_hash() })
    }
}

/// Relative path from a folder to a file, both absolute.
fn relative_path(folder: &Path, file: &Path) -> Option<PathBuf> {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| Component::ParentDir);
    (common > 0).then(|| up.chain(file.components().skip(common)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relative_path_goes_up_as_far_as_needed() {
        let relative = |folder: &str, file: &str| relative_path(Path::new(folder), Path::new(file));
        assert_eq!(relative("/a/b", "/a/b/x.esker"), Some("x.esker".into()));
        assert_eq!(relative("/a/b", "/a/c/d/x.esker"), Some("../c/d/x.esker".into()));
        assert_eq!(relative("/a/b", "/x.esker"), Some("../../x.esker".into()));
        assert_eq!(relative("a", "b/x.esker"), None);
    }
}
