//! Validation of the shaders. There is none yet; as soon as there is one this fails until a validator
//! stands here, so that it cannot be forgotten.

use anyhow::{Result, ensure};
use std::path::Path;

/// Fails where there is a shader that nothing validates.
pub fn check() -> Result<()> {
    let shaders = count(Path::new("shaders"))?;
    ensure!(
        shaders == 0,
        "shaders/ has {shaders} WGSL files and nothing validates them: do it here"
    );
    println!("shaders: none yet, nothing to validate");
    Ok(())
}

fn count(folder: &Path) -> Result<usize> {
    if !folder.is_dir() {
        return Ok(0);
    }
    let mut shaders = 0;
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            shaders += count(&path)?;
        } else if path.extension().is_some_and(|e| e == "wgsl") {
            shaders += 1;
        }
    }
    Ok(shaders)
}
