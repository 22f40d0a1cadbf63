//! Reads exports to COPC with readers of others: laspy and copclib of PyPI, copc of npm. The folder
//! `ESKER_COPC_READERS` has a virtual environment of Python and `node_modules`; `.ci/run` makes it
//! where it can. Without it the step is skipped, which it prints.

use crate::shell::{Scratch, build_esker, run};
use anyhow::{Result, ensure};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// The clouds, by name and how they are made: inhabited on all sides, flat, tall, and with all
/// attributes of a real scan.
const CLOUDS: [(&str, &str); 4] = [
    ("flat", "synthetic:terrain:200K:1"),
    ("room", "synthetic:office:200K:1"),
    ("tall", "tower.xyz"),
    ("creek", "tests/sample/creek.laz"),
];
/// Coordinate reference system of all of them.
const WKT: &str = r#"LOCAL_CS["site",UNIT["metre",1]]"#;

/// Exports the clouds, and has them read.
pub fn check() -> Result<()> {
    let Some(readers) = std::env::var_os("ESKER_COPC_READERS").map(PathBuf::from) else {
        println!("skipped: ESKER_COPC_READERS names no folder with laspy, copclib and copc.js");
        return Ok(());
    };
    let esker = build_esker()?;
    let scratch = Scratch::new("copc")?;
    let tower = scratch.file("tower.xyz");
    std::fs::write(&tower, tower_points())?;
    let mut files: Vec<OsString> = Vec::new();
    for (name, input) in CLOUDS {
        let input = if input == "tower.xyz" { tower.clone() } else { PathBuf::from(input) };
        let built = scratch.file(&format!("{name}.esker"));
        let out = scratch.file(&format!("{name}.copc.laz"));
        let args = |words: &[&OsStr]| words.iter().map(|w| w.to_os_string()).collect::<Vec<_>>();
        let small = ["--node-capacity", "4096", "--normals", "none"].map(OsStr::new);
        let build = ["build".as_ref(), input.as_os_str(), "-o".as_ref(), built.as_os_str()];
        run("esker", esker.as_os_str(), &args(&[&build[..], &small].concat()))?;
        let export = ["export".as_ref(), built.as_os_str(), "-o".as_ref(), out.as_os_str()];
        let crs = ["--crs", WKT].map(OsStr::new);
        run("esker", esker.as_os_str(), &args(&[&export[..], &crs].concat()))?;
        let verify = ["verify".as_ref(), out.as_os_str(), "--against".as_ref(), built.as_os_str()];
        run("esker", esker.as_os_str(), &args(&verify))?;
        files.push(out.into_os_string());
    }
    let program = |path: &str| OsString::from(Path::new("tests/copc").join(path));
    let node = [vec![program("check.mjs"), readers.clone().into_os_string()], files.clone()];
    run("node", "node".as_ref(), &node.concat())?;
    let python = readers.join("venv/bin/python");
    ensure!(python.exists(), "{}: there is no Python", python.display());
    run("python", python.as_os_str(), &[vec![program("check.py")], files].concat())?;
    Ok(())
}

/// A tower of 200 metres on a base of 4, with millimetres.
fn tower_points() -> String {
    let point = |i: u32| {
        let turn = f64::from(i) * 2.399_963;
        let [x, y] = [turn.cos(), turn.sin()].map(|c| 2.0 * c);
        format!("{x:.3} {y:.3} {:.3}\n", f64::from(i) * 0.004)
    };
    (0..50_000).map(point).collect()
}
