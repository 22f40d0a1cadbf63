//! Links shaders: replaces a line `// include common/frame.wgsl` by that file of `shaders/`, once a
//! shader. Used when the crate is built (`build.rs`) and, in debug runs, when a shader has changed
//! on disk.

use std::path::{Path, PathBuf};

/// Start of a line that includes a file.
const INCLUDE: &str = "// include ";

/// The text of `file` (relative to `root`) with the files that it includes, and the paths of all of
/// them.
///
/// # Errors
/// If a file cannot be read; the message names the file that includes it.
pub fn link(root: &Path, file: &str) -> Result<(String, Vec<PathBuf>), String> {
    let (mut text, mut files) = (String::new(), Vec::new());
    append(root, file, "the host", &mut text, &mut files)?;
    Ok((text, files))
}

fn append(
    root: &Path,
    file: &str,
    includer: &str,
    text: &mut String,
    files: &mut Vec<PathBuf>,
) -> Result<(), String> {
    let path = root.join(file);
    if files.contains(&path) {
        return Ok(());
    }
    let source = std::fs::read_to_string(&path)
        .map_err(|e| format!("{}: {e} (included by {includer})", path.display()))?;
    files.push(path);
    for line in source.lines() {
        match line.strip_prefix(INCLUDE) {
            Some(included) => append(root, included.trim(), file, text, files)?,
            None => {
                text.push_str(line);
                text.push('\n');
            }
        }
    }
    Ok(())
}
