//! Draws the gallery anew: `cargo xtask gallery`. `docs/gallery/pictures.json` lists the pictures
//! with their scans and cameras; scans are in `ESKER_DATA`, or are generated. Each scan is built
//! once, and drawn on the CPU by the program as users run it, so that pictures are the same on
//! every machine. The captions in `docs/gallery/README.md` are written by a person.

use crate::shell::{Scratch, build_esker, run};
use anyhow::{Context, Result};
use serde_json::Value;
use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Folder of the pictures and of their list.
const FOLDER: &str = "docs/gallery";

/// Draws all pictures.
///
/// # Errors
/// If a scan is missing, or cannot be built or drawn.
pub fn draw() -> Result<()> {
    let data =
        std::env::var_os("ESKER_DATA").context("ESKER_DATA is not set: say where scans are")?;
    let list = Path::new(FOLDER).join("pictures.json");
    let text = std::fs::read_to_string(&list).with_context(|| format!("{}", list.display()))?;
    let pictures: Vec<Value> =
        serde_json::from_str(&text).with_context(|| format!("{}", list.display()))?;
    let (program, place) = (build_esker()?, Scratch::new("gallery")?);
    esker(&program, &["demo".as_ref(), "-o".as_ref(), place.file("demo").as_ref()])?;
    std::fs::copy(place.file("demo").join("sample.png"), Path::new(FOLDER).join("sample.png"))?;
    let mut files = HashMap::new();
    for picture in &pictures {
        let scans = words(picture, "scans")?;
        let normals = picture["normals"].as_str().unwrap_or("keep");
        let next = place.file(&format!("{}.esker", files.len()));
        let file: &mut PathBuf = files.entry((scans.clone(), normals)).or_default();
        if file.as_os_str().is_empty() {
            build(&program, &data, &scans, normals, &next)?;
            *file = next;
        }
        draw_one(&program, file, picture)?;
    }
    Ok(())
}

/// Builds `scans` into one file.
fn build(program: &Path, data: &OsStr, scans: &[&str], normals: &str, file: &Path) -> Result<()> {
    // Generated scans, and those of the project.
    let is_here = |scan: &str| scan.starts_with("synthetic:") || scan.starts_with("tests/");
    let path = |scan: &&str| match is_here(scan) {
        true => PathBuf::from(scan),
        false => Path::new(data).join(scan),
    };
    let scans: Vec<PathBuf> = scans.iter().map(path).collect();
    let mut words: Vec<&OsStr> = vec!["build".as_ref()];
    words.extend(scans.iter().map(|scan| scan.as_os_str()));
    words.extend(["-o".as_ref(), file.as_os_str(), "--normals".as_ref(), normals.as_ref()]);
    esker(program, &words)
}

/// Draws one entry of the list, one picture a method.
fn draw_one(program: &Path, file: &Path, picture: &Value) -> Result<()> {
    let word = |key: &str| picture[key].as_str().with_context(|| format!("{picture} has no {key}"));
    let methods = words(picture, "methods").unwrap_or_else(|_| vec!["auto"]);
    for method in &methods {
        let name = match methods.len() {
            1 => format!("{}.png", word("name")?),
            _ => format!("{}-{method}.png", word("name")?),
        };
        let out = Path::new(FOLDER).join(name);
        let mut words: Vec<&OsStr> = vec!["render".as_ref(), file.as_os_str()];
        words.extend(["-o".as_ref(), out.as_os_str(), "--method".as_ref(), method.as_ref()]);
        words.extend(["--size", word("size")?, "--camera", word("camera")?].map(OsStr::new));
        words.extend(["--backend", "cpu"].map(OsStr::new));
        if let Some(colour) = picture["colour"].as_str() {
            words.extend(["--colour", colour].map(OsStr::new));
        }
        let options = words_of_options(picture)?;
        words.extend(options.into_iter().map(OsStr::new));
        esker(program, &words)?;
    }
    Ok(())
}

/// More options of `esker render` for a picture.
fn words_of_options(picture: &Value) -> Result<Vec<&str>> {
    if picture["options"].is_null() { Ok(Vec::new()) } else { words(picture, "options") }
}

/// The list of strings `key` of a picture.
fn words<'a>(picture: &'a Value, key: &str) -> Result<Vec<&'a str>> {
    let all = picture[key].as_array().with_context(|| format!("{picture} has no {key}"))?;
    all.iter().map(|word| word.as_str().context("not a word")).collect()
}

/// Runs the `esker` program.
fn esker(program: &Path, words: &[&OsStr]) -> Result<()> {
    run("esker", program.as_os_str(), words)
}
