//! Checks that no shader escapes validation. The build scripts of `esker-render` and `esker-trace`
//! link all shaders and validate them with naga (`crates/render/build/shaders.rs`).

use anyhow::{Result, ensure};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Fails if a shader is in a folder that nothing links, or is included by no other.
pub fn check() -> Result<()> {
    let root = Path::new("shaders");
    let mut all = Vec::new();
    collect(root, &mut all)?;
    let mut included = BTreeSet::new();
    for path in &all {
        let text = std::fs::read_to_string(path)?;
        let files = text.lines().filter_map(|l| l.strip_prefix("// include "));
        included.extend(files.map(|f| root.join(f.trim())));
    }
    for path in &all {
        let folders = path.strip_prefix(root)?.components().count() - 1;
        ensure!(folders == 1, "{}: shaders lie in shaders/PASS/NAME.wgsl", path.display());
        let is_common = path.starts_with(root.join("common"));
        ensure!(
            !is_common || included.contains(path),
            "{}: is included by no shader",
            path.display()
        );
    }
    println!(
        "shaders: {} files; linked and validated where esker-render and esker-trace are built",
        all.len()
    );
    Ok(())
}

/// Adds all files in a folder and the folders in it.
pub fn collect(folder: &Path, all: &mut Vec<PathBuf>) -> Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(&path, all)?;
        } else {
            all.push(path);
        }
    }
    Ok(())
}
