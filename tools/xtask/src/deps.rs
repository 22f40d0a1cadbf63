//! Checks the directions of dependencies: which crate of the project may depend on which, and which
//! outside crates some must never link. Reads the output of `cargo metadata` and `cargo tree`, not
//! the manifests.

use crate::shell::{cargo, output};
use anyhow::{Context, Result, bail};
use serde_json::Value;

/// Crates of the project that each crate may depend on, its tests included. A crate missing from
/// this table fails the check.
const ALLOWED: [(&str, &[&str]); 18] = [
    ("esker-points", &[]),
    ("esker-scan", &["points"]),
    ("esker-format", &["points"]),
    ("esker-builder", &["points", "scan", "format"]),
    ("esker-remote", &["points", "scan", "format", "builder"]),
    ("esker-lod", &["points"]),
    ("esker-scene", &[]),
    ("esker-stream", &["points", "format", "lod"]),
    ("esker-truth", &["lod"]),
    ("esker-render", &["points", "lod", "truth"]),
    ("esker-trace", &["points", "lod", "truth", "render"]),
    (
        "esker-engine",
        &[
            "points", "scan", "format", "builder", "scene", "lod", "truth", "stream", "render",
            "trace",
        ],
    ),
    (
        "esker-bench",
        &[
            "points", "scan", "format", "builder", "lod", "truth", "stream", "render", "trace",
            "engine",
        ],
    ),
    ("esker-view", &["engine", "remote"]),
    ("esker", &["engine", "bench", "remote"]),
    ("esker-python", &["engine", "remote"]),
    // Tools may use any library.
    ("esker-generate", &["points", "scan"]),
    ("xtask", &["points", "scan", "format", "builder", "lod", "stream", "render", "engine"]),
];

/// Edges that tests alone may have beside these: what is read at addresses is drawn.
const IN_TESTS: [(&str, &str); 1] = [("esker-remote", "esker-engine")];

/// Outside crates that open windows.
const WINDOW: [&str; 9] =
    ["winit", "eframe", "egui", "rfd", "softbuffer", "x11rb", "x11-dl", "wayland-client", "glutin"];
/// Outside crates that drive a GPU.
const GPU: [&str; 2] = ["wgpu", "naga"];

/// Outside crates that must not be in the dependency tree of each crate.
const NEVER: [(&str, &[&[&str]]); 9] = [
    ("esker-points", &[&WINDOW, &GPU]),
    ("esker-scan", &[&WINDOW, &GPU]),
    ("esker-format", &[&WINDOW, &GPU]),
    ("esker-builder", &[&WINDOW, &GPU]),
    ("esker-scene", &[&WINDOW, &GPU]),
    ("esker-lod", &[&WINDOW, &GPU]),
    ("esker-stream", &[&WINDOW, &GPU]),
    ("esker", &[&WINDOW]),
    ("esker-python", &[&WINDOW]),
];

/// Refuses every edge that is not in the tables.
pub fn check() -> Result<()> {
    let metadata = output(&cargo(), &["metadata", "--format-version", "1", "--no-deps"])?;
    let metadata: Value = serde_json::from_str(&metadata).context("what cargo metadata says")?;
    let packages = metadata["packages"].as_array().context("cargo metadata names no packages")?;
    let mut faults = Vec::new();
    let mut edges = 0;
    for package in packages {
        let dependencies = package["dependencies"].as_array();
        let is_in_tests = |dependency: &&Value| {
            let edge = (package["name"].as_str(), dependency["name"].as_str());
            let is_allowed = IN_TESTS.iter().any(|of| edge == (Some(of.0), Some(of.1)));
            dependency["kind"] == "dev" && is_allowed
        };
        let others = dependencies.into_iter().flatten().filter(|d| !is_in_tests(d));
        let names = others.filter_map(|d| d["name"].as_str());
        let ours: Vec<&str> = names.filter(|n| is_ours(n)).collect();
        edges += ours.len();
        faults.extend(refused(package["name"].as_str().unwrap_or_default(), &ours));
    }
    for (name, never) in NEVER {
        if !packages.iter().any(|p| p["name"] == name) {
            continue;
        }
        let tree =
            ["tree", "-p", name, "-e", "normal,build", "--prefix", "none", "--target", "all"];
        let tree = output(&cargo(), &tree)?;
        faults.extend(linked(&tree, never).map(|bad| format!("{name} must never link {bad}")));
    }
    if !faults.is_empty() {
        bail!("{}", faults.join("\n  "));
    }
    println!("deps: {} packages, {edges} edges between them, all allowed", packages.len());
    Ok(())
}

fn is_ours(name: &str) -> bool {
    name == "esker" || name == "xtask" || name.starts_with("esker-")
}

/// Faults of a package of the workspace that depends on the project's packages `ours`.
fn refused(package: &str, ours: &[&str]) -> Vec<String> {
    let Some((_, allowed)) = ALLOWED.iter().find(|(name, _)| *name == package) else {
        return vec![format!(
            "{package} is not in the table of directions (tools/xtask/src/deps.rs)"
        )];
    };
    ours.iter()
        .filter(|n| !n.strip_prefix("esker-").is_some_and(|n| allowed.contains(&n)))
        .map(|n| format!("{package} must not depend on {n}"))
        .collect()
}

/// Forbidden crates in a dependency tree as printed by `cargo tree --prefix none`.
fn linked<'a>(tree: &'a str, never: &'a [&'a [&'a str]]) -> impl Iterator<Item = &'a str> {
    let in_tree = move |bad: &str| {
        tree.lines().any(|line| line.split_whitespace().next().is_some_and(|name| name == bad))
    };
    never.iter().flat_map(|group| group.iter().copied()).filter(move |bad| in_tree(bad))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_against_the_direction_are_refused() {
        assert!(refused("esker-builder", &["esker-points", "esker-format"]).is_empty());
        assert_eq!(refused("esker-lod", &["esker-points", "esker-render"]).len(), 1);
        assert_eq!(refused("esker-points", &["esker"]).len(), 1);
        assert_eq!(refused("esker", &["esker-engine", "esker-builder"]).len(), 1);
        assert_eq!(refused("esker-new", &[]).len(), 1);
    }

    #[test]
    fn forbidden_crates_are_found_by_their_whole_name() {
        let tree = "esker v0.1.0 (x)\nwgpu-types v30.0.0\nwinit v0.30.1 (*)\n";
        assert_eq!(linked(tree, &[&WINDOW, &GPU]).collect::<Vec<_>>(), ["winit"]);
    }
}
