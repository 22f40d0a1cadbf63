//! Injected faults: `cargo xtask faults` shows that the bounds of `esker bench stability` are not
//! empty. Each fault changes one place of a copy of the working tree, as a mistake would; a part of
//! the benchmark must then break a bound. The unchanged copy must pass the same parts. With words
//! as arguments only the faults run that have one in their names; without, the table is written to
//! `docs/evidence/faults.md`. The copy and what is built of it stay in the target folder, so that
//! little is compiled for the next fault.

use crate::shell::{cargo, output, run};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The page with the table.
const PAGE: &str = "docs/evidence/faults.md";
/// Bytes of a file of the working tree that are read at most.
const FILE_BYTES_MAX: u64 = 1 << 28;
/// Settings of builds: compiling takes long, checks take seconds.
const PROFILE: [&str; 6] = [
    "profile.release.debug=0",
    "profile.release.incremental=true",
    "profile.release.codegen-units=16",
    "profile.release.package.esker-builder.codegen-units=16",
    "profile.release.package.esker-render.codegen-units=16",
    "profile.release.package.esker-trace.codegen-units=16",
];

/// A mistake, and what has to find it.
struct Fault {
    /// What is wrong.
    name: &'static str,
    /// File of the working tree.
    file: &'static str,
    /// Text of the file, which occurs once, and what replaces it.
    old: &'static str,
    new: &'static str,
    /// Part of `esker bench stability` that must break a bound.
    part: &'static str,
}

/// The faults.
const FAULTS: [Fault; 6] = [
    Fault {
        name: "sign of the displacement in pull",
        file: "crates/render/src/passes/pull.rs",
        old: "[pixels.front[2] + right, pixels.front[3] + down]",
        new: "[pixels.front[2] - right, pixels.front[3] - down]",
        part: "eye-height",
    },
    Fault {
        name: "weights of push not divided by their sum",
        file: "crates/render/src/passes/push.rs",
        old: "weights.iter_mut().for_each(|weight| *weight /= sum);",
        new: "",
        part: "noise",
    },
    Fault {
        name: "place of a point rounded to f16",
        file: "crates/render/src/inputs/camera.rs",
        old: "high as f32 * 65_536.0 + low as f32 + self.bias_steps[axis]",
        // Keeps the ten bits of the fraction of an f16.
        new: "f32::from_bits((high as f32 * 65_536.0 + low as f32 + self.bias_steps[axis]).to_bits() & !0x1fff)",
        part: "narrow-view",
    },
    Fault {
        name: "box of a cell twice as large",
        file: "crates/lod/src/oriented_box.rs",
        old: "half: (high - low) * 0.5,",
        new: "half: high - low,",
        part: "close-up",
    },
    Fault {
        name: "radius of the next point",
        file: "crates/builder/src/sample/cell.rs",
        old: "let radius = pending.radii[i as usize];",
        new: "let radius = pending.radii[(i as usize + 1) % pending.radii.len()];",
        part: "patches",
    },
    Fault {
        name: "near plane ten times as far",
        file: "crates/engine/src/draw/frame.rs",
        old: "const NEAR_SPACINGS: f64 = 0.1;",
        new: "const NEAR_SPACINGS: f64 = 1.0;",
        part: "eye-height",
    },
];

/// Runs the faults whose names have one of `words`; all if there are none.
///
/// # Errors
/// If the working tree breaks a bound, a fault cannot be injected or built, or breaks no bound.
pub fn inject(words: &[String]) -> Result<()> {
    let is_wanted = |f: &&Fault| words.is_empty() || words.iter().any(|w| f.name.contains(w));
    let faults: Vec<&Fault> = FAULTS.iter().filter(is_wanted).collect();
    ensure!(!faults.is_empty(), "no fault has a name with {}", words.join(" or "));
    let tree = Tree::copy()?;
    let mut parts: Vec<&str> = faults.iter().map(|fault| fault.part).collect();
    parts.sort_unstable();
    parts.dedup();
    let broken = tree.broken(&parts.join(","))?;
    ensure!(broken.is_empty(), "bounds are broken without a fault: {}", broken.join("; "));
    println!("without a fault: {} hold", parts.join(", "));
    let (mut rows, mut missed) = (Vec::new(), Vec::new());
    for fault in &faults {
        println!("-- {}", fault.name);
        tree.replace(fault.file, &injected(fault)?)?;
        let broken = tree.broken(fault.part)?;
        let first = broken.first().cloned().unwrap_or_else(|| "NOT CAUGHT".into());
        println!("{first}");
        rows.push(format!(
            "| {} | `{}` | `{}` | {} | {first} |",
            fault.name,
            fault.file,
            fault.part,
            broken.len()
        ));
        if broken.is_empty() {
            missed.push(fault.name);
        }
        tree.replace(fault.file, &text(Path::new(fault.file))?)?;
    }
    let table = [
        "| fault | file | part | bounds broken | the farthest beyond |\n|---|---|---|---:|---|",
        &rows.join("\n"),
    ]
    .join("\n");
    println!("{table}");
    ensure!(missed.is_empty(), "no bound is broken by: {}", missed.join(", "));
    if words.is_empty() {
        std::fs::write(PAGE, page(&table)).with_context(|| PAGE.to_owned())?;
    }
    Ok(())
}

/// The page of a table.
fn page(table: &str) -> String {
    format!(
        "# Injected faults\n\n\
         Bounds are of use only if mistakes break them. Each row is a mistake that was made on \
         purpose in\na copy of the project, the part of `esker bench stability` that has to find \
         it, the number of\nbounds that broke there, and the one that was exceeded by the greatest \
         factor. Without a fault all\nof them hold; [limits](../limits.md) explains them.\n\n\
         {table}\n\n`cargo xtask faults` makes the mistakes anew and writes this page; it fails if \
         one breaks no bound.\n"
    )
}

/// Text of a file of the working tree.
fn text(path: &Path) -> Result<String> {
    let mut text = String::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(FILE_BYTES_MAX).read_to_string(&mut text))
        .with_context(|| path.display().to_string())?;
    Ok(text)
}

/// The file of a fault with the mistake.
fn injected(fault: &Fault) -> Result<String> {
    let before = text(Path::new(fault.file))?;
    let found = before.matches(fault.old).count();
    ensure!(found == 1, "{}: `{}` occurs {found} times, not once", fault.file, fault.old);
    Ok(before.replacen(fault.old, fault.new, 1))
}

/// A copy of the working tree, in the target folder.
struct Tree {
    tree: PathBuf,
    target: PathBuf,
}

impl Tree {
    /// Copies what git tracks and has changed since the last copy. Files that are equal are not
    /// written, so that they are not compiled again.
    fn copy() -> Result<Self> {
        let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
        let root = std::env::current_dir()?.join(target).join("faults");
        let copy = Self { tree: root.join("tree"), target: root.join("target") };
        let listed = output(OsStr::new("git"), &["ls-files", "-z"])?;
        let files: Vec<&str> = listed.split('\0').filter(|name| is_copied(name)).collect();
        for file in files {
            let from = Path::new(file);
            // Deleted in the working tree, not yet in the index.
            if from.is_file() {
                copy.update(from)?;
            }
        }
        Ok(copy)
    }

    /// Copies a file if it differs.
    fn update(&self, file: &Path) -> Result<()> {
        let to = self.tree.join(file);
        let wanted = bytes(file)?;
        if bytes(&to).is_ok_and(|own| own == wanted) {
            return Ok(());
        }
        let folder = to.parent().context("a file without a folder")?;
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        std::fs::write(&to, wanted).with_context(|| to.display().to_string())
    }

    /// Writes a file of the copy.
    fn replace(&self, file: &str, text: &str) -> Result<()> {
        let to = self.tree.join(file);
        std::fs::write(&to, text).with_context(|| to.display().to_string())
    }

    /// Builds the copy and measures parts of the benchmark. Returns the bounds that are broken, the
    /// farthest exceeded first.
    fn broken(&self, parts: &str) -> Result<Vec<String>> {
        let manifest = self.tree.join("Cargo.toml");
        let mut words: Vec<&OsStr> =
            ["build", "--release", "--bin", "esker", "--quiet", "--manifest-path"]
                .map(OsStr::new)
                .to_vec();
        words.push(manifest.as_os_str());
        words.extend(["--target-dir".as_ref(), self.target.as_os_str()]);
        words.extend(PROFILE.iter().flat_map(|setting| ["--config", setting]).map(OsStr::new));
        run("cargo", &cargo(), &words)?;
        let out = Command::new(self.target.join("release/esker"))
            .args(["bench", "stability", "--progress", "none", "--json", "--parts", parts])
            .stdin(Stdio::null())
            .output()?;
        // A crash is no bound: there must be a report, and it must agree with the exit code.
        let report = serde_json::from_slice(&out.stdout).with_context(|| {
            format!("no report of {parts}: {}", String::from_utf8_lossy(&out.stderr).trim())
        })?;
        let broken = broken_of(&report);
        ensure!(
            broken.is_empty() == out.status.success(),
            "{parts}: {} with {} broken bounds",
            out.status,
            broken.len()
        );
        Ok(broken)
    }
}

/// Whether a tracked file is needed to build and run the program.
fn is_copied(file: &str) -> bool {
    !file.is_empty() && !file.starts_with("docs/") && !file.starts_with("bench/")
}

fn bytes(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(FILE_BYTES_MAX).read_to_end(&mut bytes))
        .with_context(|| path.display().to_string())?;
    Ok(bytes)
}

/// The broken bounds of a report, the farthest exceeded first. A missing measure is beyond all.
fn broken_of(report: &Value) -> Vec<String> {
    let rows = ["relations", "cases"].into_iter().filter_map(|name| report[name].as_array());
    let broken = rows.flatten().filter(|row| row["verdict"] == "broken");
    let mut all: Vec<(f64, String)> = broken.map(described).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.into_iter().map(|(_, row)| row).collect()
}

/// How many times the bound is exceeded, and the row in words.
fn described(row: &Value) -> (f64, String) {
    let word = |name: &str| row[name].as_str().unwrap_or_default().to_owned();
    let condition = match row["value"].as_f64() {
        Some(value) => format!("{} {value}", word("axis")),
        None => format!("{} of {}", word("relation"), word("scan")),
    };
    let bound = row["bound"].as_f64().unwrap_or(0.0);
    let measured = row["measured"].as_f64();
    let text = measured.map_or("none".into(), |m| format!("{m:.3}"));
    let what =
        format!("{condition}, {}, {}: {text}, at most {bound}", word("method"), word("measure"));
    (measured.map_or(f64::INFINITY, |m| m / bound.max(f64::MIN_POSITIVE)), what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fault_changes_one_place_of_the_working_tree() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for fault in &FAULTS {
            let before = text(&root.join(fault.file)).expect("the file of a fault");
            assert_eq!(before.matches(fault.old).count(), 1, "{}: {}", fault.file, fault.old);
            assert_ne!(fault.old, fault.new, "{}", fault.name);
            assert!(is_copied(fault.file), "{}", fault.file);
        }
    }

    #[test]
    fn broken_bounds_are_listed_by_how_far_they_are_exceeded() {
        let row = |measured: Value, verdict: &str| {
            serde_json::json!({
                "axis": "noise", "value": 0.5, "method": "ewa", "measure": "FLIP", "bound": 0.1,
                "measured": measured, "verdict": verdict,
            })
        };
        let report = serde_json::json!({ "relations": [], "cases": [
            row(0.2.into(), "broken"), row(9.0.into(), "breaks"), row(0.05.into(), "holds"),
            row(0.3.into(), "broken"), row(Value::Null, "broken"),
        ]});
        let broken = broken_of(&report);
        let ends: Vec<&str> = broken.iter().filter_map(|row| row.split(": ").last()).collect();
        assert_eq!(ends, ["none, at most 0.1", "0.300, at most 0.1", "0.200, at most 0.1"]);
        assert!(broken[0].starts_with("noise 0.5, ewa, FLIP"), "{}", broken[0]);
    }
}
