//! Links shaders: a line `// include common/frame.wgsl` stands for that file of `shaders/`, once. Used when
//! the crate is built (`build.rs`) and, in debug runs, when a shader has changed on the disk.

use std::path::{Path, PathBuf};

/// What starts a line that includes a file.
const INCLUDE: &str = "// include ";

/// The text of `file` (relative to `root`) with everything that it includes before it; and the files that
/// went in.
///
/// # Errors
/// Which file cannot be read, and which file asked for it.
pub fn link(root: &Path, file: &str) -> Result<(String, Vec<PathBuf>), String> {
    let (mut text, mut files) = (String::new(), Vec::new());
    append(root, file, "the host", &mut text, &mut files)?;
    Ok((text, files))
}

fn append(
    root: &Path,
    file: &str,
    asker: &str,
    text: &mut String,
    files: &mut Vec<PathBuf>,
) -> Result<(), String> {
    let path = root.join(file);
    if files.contains(&path) {
        return Ok(());
    }
    let source = std::fs::read_to_string(&path)
        .map_err(|e| format!("{}: {e} (included by {asker})", path.display()))?;
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
