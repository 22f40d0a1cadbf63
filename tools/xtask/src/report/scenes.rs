//! The scenes of the report, from `docs/evidence/scenes.json`: name, kind, what it shows, scan, and
//! how it is drawn.

use anyhow::{Context, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// List of the scenes.
pub const LIST: &str = "docs/evidence/scenes.json";

/// A scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Name in files and headings.
    pub name: String,
    /// Kind of scan, for people.
    pub kind: String,
    /// What it shows, for people.
    pub about: String,
    /// File, or name of a generated or analytic scan.
    pub scan: String,
    /// Width and height of the picture, as on the command line.
    pub size: String,
    /// Camera and source of colours, as on the command line.
    pub camera: Option<String>,
    pub colour: Option<String>,
}

/// Reads the list.
///
/// # Errors
/// If it cannot be read, or a scene lacks a field.
pub fn read() -> Result<Vec<Scene>> {
    let text = std::fs::read_to_string(LIST).context(LIST)?;
    let all: Vec<Value> = serde_json::from_str(&text).context(LIST)?;
    all.iter().map(Scene::of).collect::<Result<_>>().context(LIST)
}

impl Scene {
    /// A scene of its JSON.
    pub fn of(value: &Value) -> Result<Self> {
        let optional = |key: &str| value[key].as_str().map(String::from);
        let word = |key: &str| optional(key).with_context(|| format!("{value} has no {key}"));
        Ok(Self {
            name: word("name")?,
            kind: word("kind")?,
            about: word("about")?,
            scan: word("scan")?,
            size: word("size")?,
            camera: optional("camera"),
            colour: optional("colour"),
        })
    }

    /// Path of the scan; none if it is in `ESKER_DATA`, and that is not set.
    pub fn path(&self, data: Option<&Path>) -> Option<PathBuf> {
        let is_made = self.scan.starts_with("truth:") || self.scan.starts_with("synthetic:");
        if is_made || self.scan.starts_with("tests/") {
            return Some((&self.scan).into());
        }
        data.map(|folder| folder.join(&self.scan))
    }

    /// Options of the benchmark.
    pub fn words(&self) -> Vec<&str> {
        let mut words = vec!["--size", &self.size];
        words.extend(self.camera.iter().flat_map(|camera| ["--camera", camera]));
        words.extend(self.colour.iter().flat_map(|colour| ["--colour", colour]));
        words
    }

    /// The command line that measures it.
    pub fn command(&self) -> String {
        let quoted = |word: &&str| match word.contains(';') {
            true => format!("\"{word}\""),
            false => (*word).to_owned(),
        };
        let words: Vec<String> = self.words().iter().map(quoted).collect();
        let scan = &self.scan;
        format!("esker bench error-time {scan} {} --backend cpu --quick --json", words.join(" "))
    }
}
