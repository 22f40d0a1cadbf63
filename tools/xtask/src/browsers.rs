//! Compiles all linked shaders as browsers do, with Dawn (Chromium's WebGPU), which refuses WGSL
//! that naga accepts. `ESKER_DAWN` names a folder with `node_modules/webgpu` and, in `icd.json`, a
//! Vulkan driver that Dawn accepts; `.ci/run` makes one where it can. Without it the step is
//! skipped, which it prints.

#[path = "../../../crates/render/src/gpu/device/link.rs"]
mod link;

use crate::shaders::collect;
use crate::shell::Scratch;
use anyhow::{Context, Result, bail, ensure};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The program that compiles.
const PROGRAM: &str = "tools/xtask/src/browsers.mjs";
/// Shaders that browsers lack a feature for: atomic minima of 64 bits.
const NATIVE: [&str; 1] = ["project/atomics.wgsl"];
/// Exit status of the program without an adapter.
const NO_ADAPTER: i32 = 3;

/// Compiles all shaders but [`NATIVE`].
pub fn check() -> Result<()> {
    let skip = |why: &str| {
        println!("skipped: {why}; browsers may refuse shaders that are accepted here");
        Ok(())
    };
    let Some(dawn) = std::env::var_os("ESKER_DAWN").map(PathBuf::from) else {
        return skip("ESKER_DAWN names no folder with the package webgpu of npm");
    };
    if Command::new("node").arg("--version").stdout(Stdio::null()).status().is_err() {
        return skip("there is no node");
    }
    let root = Path::new("shaders");
    let mut all = Vec::new();
    collect(root, &mut all)?;
    let scratch = Scratch::new("browsers")?;
    let mut linked = Vec::new();
    for path in &all {
        let file = path.strip_prefix(root)?.to_string_lossy().replace('\\', "/");
        if file.starts_with("common/") || NATIVE.contains(&file.as_str()) {
            continue;
        }
        let (text, _) = link::link(root, &file).map_err(anyhow::Error::msg)?;
        let name = file.replace('/', "-");
        std::fs::write(scratch.folder().join(&name), text)?;
        linked.push(name);
    }
    linked.sort();
    ensure!(!linked.is_empty(), "no shader was found");
    let mut node = Command::new("node");
    node.arg(std::path::absolute(PROGRAM)?).arg(&dawn).args(&linked);
    node.current_dir(scratch.folder()).stdin(Stdio::null());
    let driver = dawn.join("icd.json");
    if driver.exists() {
        node.env("VK_ICD_FILENAMES", driver);
    }
    let status = node.status().context("node")?;
    match status.code() {
        Some(0) => {
            println!("browsers: {} shaders make pipelines in Dawn", linked.len());
            Ok(())
        }
        Some(NO_ADAPTER) => skip("Dawn finds no adapter"),
        _ => bail!("Dawn refuses shaders ({status})"),
    }
}
