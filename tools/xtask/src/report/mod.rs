//! `cargo xtask report [SCENE...] [--program FILE]`: measures error against run time on the scenes
//! of `docs/evidence/scenes.json` and, as the scene `stability`, relations and conditions. Writes
//! the page and the plots of each scene to `docs/evidence`, JSON to a folder of `bench/results`,
//! and the figures that the README's table and the overview need to `docs/evidence/evidence.json`.
//! [`scenes`] has the scenes, [`record`] the folder of results, [`overview`] the page over all
//! scenes. Scenes whose scan is only in `ESKER_DATA` are left as they are where it is not set.

mod overview;
mod record;
mod scenes;

use crate::figures;
use crate::shell::{Scratch, build_esker, output};
use anyhow::{Context, Result, bail, ensure};
use record::Record;
use scenes::Scene;
use serde_json::{Map, Value, json};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Folder of pages and plots.
const FOLDER: &str = "docs/evidence";
/// Figures of all scenes, as last measured.
const EVIDENCE: &str = "docs/evidence/evidence.json";
/// Page over all scenes.
const OVERVIEW: &str = "docs/evidence/README.md";
/// What names the test of relations and conditions among the scenes.
const STABILITY: &str = "stability";
/// Time that the whole may take on two idle cores.
const LIMIT: Duration = Duration::from_secs(600);

/// What was asked for.
#[derive(Debug, Default, PartialEq)]
struct Asked {
    /// Scenes; all if there is none.
    scenes: Vec<String>,
    /// The `esker` program; built if there is none.
    program: Option<PathBuf>,
}

/// Measures and writes the evidence.
///
/// # Errors
/// If there is no scene of a name, a scan is missing, the program fails, or a file cannot be
/// written.
pub fn run(arguments: &[String]) -> Result<()> {
    let asked = Asked::of(arguments)?;
    let all = scenes::read()?;
    for name in &asked.scenes {
        let known = || all.iter().map(|scene| scene.name.as_str()).collect::<Vec<_>>().join(", ");
        let is_known = name == STABILITY || all.iter().any(|scene| scene.name == *name);
        ensure!(is_known, "no scene is called {name}; there are {}", known());
    }
    let program = match asked.program {
        Some(program) => program.canonicalize().context("--program")?,
        None => build_esker()?,
    };
    let data = std::env::var_os("ESKER_DATA").map(PathBuf::from);
    let record = Record::new()?;
    let mut evidence = read_evidence()?;
    let start = Instant::now();
    for scene in &all {
        if !asked.scenes.is_empty() && !asked.scenes.contains(&scene.name) {
            continue;
        }
        let Some(scan) = scene.path(data.as_deref()) else {
            println!("report: {} is left as it is: ESKER_DATA is not set", scene.name);
            continue;
        };
        let since = Instant::now();
        let figures = measured(scene, &scan, &program, &record)?;
        evidence.insert(scene.name.clone(), figures);
        // What is measured stays, should a later scene fail.
        write(&all, &evidence)?;
        println!("report: {} took {:.0} s", scene.name, since.elapsed().as_secs_f64());
    }
    if asked.scenes.is_empty() || asked.scenes.iter().any(|name| name == STABILITY) {
        let since = Instant::now();
        stability(&program, &record)?;
        println!("report: {STABILITY} took {:.0} s", since.elapsed().as_secs_f64());
    }
    write(&all, &evidence)?;
    println!("report: all took {:.0} s", start.elapsed().as_secs_f64());
    if start.elapsed() > LIMIT {
        println!("report: more than {} s: the machine is slow or not idle", LIMIT.as_secs());
    }
    figures::write()
}

/// Writes the figures of all scenes and the overview.
fn write(scenes: &[Scene], evidence: &Map<String, Value>) -> Result<()> {
    let text = serde_json::to_string_pretty(&json!({ "scenes": evidence }))?;
    std::fs::write(EVIDENCE, text + "\n").context(EVIDENCE)?;
    std::fs::write(OVERVIEW, overview::text(scenes, evidence)?).context(OVERVIEW)
}

/// Compares the overview with what it is made from.
///
/// # Errors
/// If the two differ, or a file cannot be read.
pub fn check() -> Result<()> {
    let text = overview::text(&scenes::read()?, &read_evidence()?)?;
    let written = std::fs::read_to_string(OVERVIEW).context(OVERVIEW)?;
    ensure!(
        text == written,
        "{OVERVIEW} differs from {EVIDENCE} and {}; run `cargo xtask report`",
        scenes::LIST
    );
    Ok(())
}

impl Asked {
    fn of(arguments: &[String]) -> Result<Self> {
        let mut asked = Self::default();
        let mut words = arguments.iter();
        while let Some(word) = words.next() {
            match word.as_str() {
                "--program" => {
                    let program = words.next().context("--program needs the name of a file")?;
                    asked.program = Some(program.into());
                }
                option if option.starts_with('-') => bail!("there is no option {option}"),
                _ => asked.scenes.push(word.clone()),
            }
        }
        Ok(asked)
    }
}

/// Figures of the scenes that were measured before; none if there is no file yet.
fn read_evidence() -> Result<Map<String, Value>> {
    if !Path::new(EVIDENCE).exists() {
        return Ok(Map::new());
    }
    let text = std::fs::read_to_string(EVIDENCE).context(EVIDENCE)?;
    let all: Value = serde_json::from_str(&text).context(EVIDENCE)?;
    all["scenes"].as_object().cloned().with_context(|| format!("{EVIDENCE} has no scenes"))
}

/// Measures a scene, moves its page and plots to their folder, and records the report. Returns the
/// figures for the overview.
fn measured(scene: &Scene, scan: &Path, program: &Path, record: &Record) -> Result<Value> {
    let place = Scratch::new(&format!("report-{}", scene.name))?;
    let mut words: Vec<OsString> = ["bench", "error-time"].map(OsString::from).to_vec();
    words.push(scan.into());
    words.extend(scene.words().iter().map(OsString::from));
    words.extend(
        ["--backend", "cpu", "--quick", "--json", "--progress", "none"].map(OsString::from),
    );
    words.extend(["--out".into(), place.folder().into()]);
    let text = output(program.as_os_str(), &words)?;
    let line = text.lines().last().context("the benchmark printed no report")?;
    let report: Value = serde_json::from_str(line).context("the report of the benchmark")?;
    take_pages(scene, &report, place.folder())?;
    let result = record.save(&format!("error-time-{}", scene.name), line, &scene.command())?;
    figures_of(&report, &result, record)
}

/// Tests relations and conditions, and records the report.
fn stability(program: &Path, record: &Record) -> Result<()> {
    let words = ["bench", "stability", "--quick", "--json", "--progress", "none"];
    let text = output(program.as_os_str(), &words)?;
    let line = text.lines().last().context("the benchmark printed no report")?;
    record.save(STABILITY, line, "esker bench stability --quick --json")?;
    Ok(())
}

/// Copies the page, the plots and the pictures of a scene, which have its name in their names.
fn take_pages(scene: &Scene, report: &Value, from: &Path) -> Result<()> {
    let file = report.pointer("/scans/0/file").and_then(Value::as_str);
    let file = file.context("the report names no scan")?;
    let own: String =
        file.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    for entry in std::fs::read_dir(from)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(end) = name.strip_prefix(&own) else { continue };
        let to = Path::new(FOLDER).join(format!("{}{end}", scene.name));
        if name.ends_with(".html") {
            let page = std::fs::read_to_string(&path)?;
            // Links of the page are to files beside it.
            let page = page.replace(&format!("src='{own}"), &format!("src='{}", scene.name));
            std::fs::write(&to, page).with_context(|| to.display().to_string())?;
        } else {
            std::fs::copy(&path, &to).with_context(|| to.display().to_string())?;
        }
    }
    Ok(())
}

/// What the overview and the README's table need of a report.
fn figures_of(report: &Value, result: &str, record: &Record) -> Result<Value> {
    let scan = report.pointer("/scans/0").context("the report has no scan")?;
    let rows = report["rows"].as_array().context("the report has no rows")?;
    let mut methods = Map::new();
    for row in rows.iter().filter(|row| is_default(row)) {
        let method = row["method"].as_str().context("a row has no method")?;
        let kept = ["ms", "cpu_ms", "flip", "off_share", "hole_share", "bleeding_share"];
        let kept = kept.map(|key| (key.to_owned(), row[key].clone()));
        methods.entry(method).or_insert_with(|| Value::Object(Map::from_iter(kept)));
    }
    let mut figures = scan.as_object().cloned().context("the scan of the report is none")?;
    figures.insert("methods".into(), Value::Object(methods));
    figures.insert("threads".into(), report["threads"].clone());
    figures.insert("result".into(), json!(result));
    figures.insert("commit".into(), json!(record.commit));
    figures.insert("date".into(), json!(record.date));
    figures.insert("machine".into(), json!(record.machine));
    Ok(Value::Object(figures))
}

/// Whether a row has the default settings of its method and of the build.
fn is_default(row: &Value) -> bool {
    let build = row.pointer("/build/options").and_then(Value::as_str).unwrap_or("default");
    row["what"] == "default" && build == "default"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_and_a_program_can_be_named() {
        let words = ["creek", "--program", "a/esker", "cube"].map(String::from);
        let asked = Asked::of(&words).expect("valid");
        assert_eq!(asked.scenes, ["creek", "cube"]);
        assert_eq!(asked.program, Some("a/esker".into()));
        assert!(Asked::of(&["--full".into()]).is_err());
        assert!(Asked::of(&["--program".into()]).is_err());
    }

    #[test]
    fn figures_are_those_of_default_settings() {
        let record = Record {
            date: "2026-11-29".into(),
            machine: "2core".into(),
            id: "m3".into(),
            commit: "0a1b2c3".into(),
        };
        let row = |method: &str, what: &str, ms: f64| {
            json!({"method": method, "what": what, "ms": ms, "flip": 0.1,
                   "build": {"options": "default"}})
        };
        let report = json!({"threads": 2, "scans": [{"file": "creek", "points": 5}], "rows": [
            row("ewa", "spacing 2 px", 1.0), row("ewa", "default", 2.0), row("auto", "default", 3.0)
        ]});
        let figures = figures_of(&report, "a.json", &record).expect("figures");
        assert_eq!(figures["methods"]["ewa"]["ms"], 2.0);
        assert_eq!(figures["methods"]["auto"]["ms"], 3.0);
        assert_eq!(figures["points"], 5);
        assert_eq!(figures["result"], "a.json");
        assert!(figures_of(&json!({}), "a.json", &record).is_err());
    }
}
