//! The independent Python reader, written from the specification alone, agrees with the program on
//! the sample's file.

use crate::degrees::table;
use crate::folder::Folder;
use crate::program::{Outcome, build, esker, run, sample, verify};
use crate::{missing, trial};
use libtest_mimic::Trial;
use std::path::Path;
use std::process::Command;

pub fn trials(trials: &mut Vec<Trial>) {
    let name = "python: the independent reader agrees";
    let python = std::env::var("ESKER_PYTHON").unwrap_or_else(|_| "python3".into());
    let numpy = Command::new(&python).args(["-c", "import numpy"]).output();
    if numpy.is_ok_and(|o| o.status.success()) {
        trials.push(trial(name, move || agrees(&python)));
    } else {
        trials.push(missing(name));
    }
}

fn read(python: &str, file: &Path) -> Outcome {
    let reader = std::path::absolute("../../data-format/reader.py").unwrap();
    let mut command = Command::new(python);
    command.arg("-B").arg(reader).arg(file).arg("--json");
    run(command, 300)
}

fn agrees(python: &str) {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let (creek, degrees) = (sample(), table(&folder));
    let in_degrees: &[&str] = &["--normals", "estimate", "--tangents", "--sharp-features"];
    let builds = [(&creek, &[][..]), (&creek, &["--tangents"]), (&creek, &["--compact"])];
    for (scan, more) in [(&degrees, in_degrees)].into_iter().chain(builds) {
        let built = build(&[scan], &out, more);
        let info = esker(["info", out.to_str().unwrap(), "--json"]).json();
        let verified = verify(&out, &[scan]).json();
        let theirs = read(python, &out).json();
        assert_eq!(theirs["version"], if scan == &degrees { 2 } else { 1 });
        assert_eq!(theirs["points"], info["points"]);
        assert_eq!(theirs["points"], verified["points"]);
        assert_eq!(theirs["nodes"], info["nodes"]);
        assert_eq!(theirs["multiset_hash"], built["multiset_hash"], "{theirs}");
    }
    // It finds the same damage as the program.
    let mut bytes = std::fs::read(&out).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&out, bytes).unwrap();
    assert_ne!(read(python, &out).code, Some(0));
    verify::<&str>(&out, &[]).error();
}
