//! What is named as input and output by mistake: scans of which no point can be taken, outputs that are something else.
//! Each is told in words, and leaves all files as they were.

use crate::folder::Folder;
use crate::program::{Outcome, build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;
use std::path::Path;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("inputs: scans without a point that can be taken make no file", all_refused));
    trials.push(trial("inputs: points that were refused are told by verify", some_refused));
}

/// Runs `esker` with a command, inputs and an output.
fn run(command: &str, inputs: &[&Path], out: &Path) -> Outcome {
    let words = [command.as_ref()].into_iter().chain(inputs.iter().map(|i| i.as_os_str()));
    esker(words.chain(["-o".as_ref(), out.as_os_str()]))
}

/// A PLY of these lines of x, y and z.
fn ply(points: &[&str]) -> String {
    let axes = ["x", "y", "z"].map(|axis| format!("property float {axis}\n")).concat();
    let count = points.len();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\n{axes}end_header\n{}\n",
        points.join("\n")
    )
}

fn all_refused() {
    let folder = Folder::new();
    let (a, b) = (folder.file("a.esker"), folder.file("b.esker"));
    let near = folder.write("near.xyz", "0.01 0.02 0.03\n1.11 1.12 1.13\n");
    let far = folder.write("far.xyz", "1e9 0 0\n2e9 0 0\n");
    let unmeasured = folder.write("nan.ply", &ply(&["nan nan nan", "1 nan 2"]));
    build(&[&near], &a, &[]);
    let (before, names) = (std::fs::read(&a).unwrap(), folder.names());
    let outcome = run("append", &[&a, &far], &b);
    for word in ["far.xyz", "all of the 2 points", "outside of the lattice", "of their own"] {
        assert!(outcome.error().contains(word), "{word}: {}", outcome.stderr);
    }
    for out in [&a, &b] {
        let outcome = run("build", &[&unmeasured], out);
        for word in ["nan.ply", "all of the 2 points", "not a finite number"] {
            assert!(outcome.error().contains(word), "{word}: {}", outcome.stderr);
        }
    }
    assert_eq!((std::fs::read(&a).unwrap(), folder.names()), (before, names));
    // A scan that has no point is no mistake.
    let none = folder.write("none.ply", &ply(&[]));
    assert_eq!(build(&[&none], &b, &[])["points_out"], 0);
}

fn some_refused() {
    let folder = Folder::new();
    let scan = folder.write("some.ply", &ply(&["0 0 0", "1 nan 2", "1 2 3"]));
    let out = folder.file("out.esker");
    let report = build(&[&scan], &out, &[]);
    assert_eq!((&report["points_in"], &report["points_out"]), (&3.into(), &2.into()), "{report}");
    let verified = verify(&out, &[&scan]).json();
    assert_eq!((&verified["points"], &verified["against_refused"]), (&2.into(), &1.into()));
    let words = ["verify".as_ref(), out.as_os_str(), "--against".as_ref(), scan.as_os_str()];
    let outcome = esker(words);
    let told = &outcome.worked().stdout;
    assert!(
        told.contains("2 points, the points of the scans; 1 points of the scans were refused"),
        "{told}"
    );
}
