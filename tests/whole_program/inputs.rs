//! Inputs and outputs that are named by mistake: scans without a usable point, outputs that are
//! other files. Each gives a clear error and leaves all files as they were.

use crate::folder::Folder;
use crate::program::{Outcome, build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;
use std::path::{Path, PathBuf};

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("inputs: scans without a usable point make no file", all_refused));
    trials.push(trial("inputs: verify reports refused points", some_refused));
    trials.push(trial("inputs: a build replaces .esker files only", others_stay));
    trials.push(trial("inputs: a folder stands for the scans in it", folders));
    trials.push(trial("inputs: a scan that is named twice is reported", named_twice));
    #[cfg(unix)]
    trials.push(trial("inputs: pipes and devices are refused without waiting", pipes));
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
    for word in ["far.xyz", "build both anew", "--drop-outside"] {
        assert!(outcome.error().contains(word), "{word}: {}", outcome.stderr);
    }
    let words = ["append", "--drop-outside", "-o"].map(PathBuf::from);
    let outcome = esker(words.into_iter().chain([b.clone(), a.clone(), far]));
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
    // A scan without any point is valid.
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
        told.contains(
            "2 points, the points of the scans, coordinates exact; 1 points of the scans"
        ),
        "{told}"
    );
}

fn others_stay() {
    let folder = Folder::new();
    let text = "0 0 0\n1 2 3\n4 5 6\n";
    let (scan, other) = (folder.write("scan.xyz", text), folder.write("other.xyz", text));
    let [a, b] = ["a.esker", "b.esker"].map(|name| folder.file(name));
    build(&[&scan], &a, &[]);
    let merge = |out: &Path| {
        let words = ["build".as_ref(), "--merge".as_ref(), a.as_os_str(), "-o".as_ref()];
        esker(words.into_iter().chain([out.as_os_str()]))
    };
    let names = folder.names();
    let outcomes =
        [run("build", &[&scan], &other), run("append", &[&a, &scan], &other), merge(&other)];
    for outcome in outcomes {
        for word in ["other.xyz", "no .esker file", "another output", "remove it"] {
            assert!(outcome.error().contains(word), "{word}: {}", outcome.stderr);
        }
        assert_eq!(std::fs::read_to_string(&other).unwrap(), text);
        assert_eq!(folder.names(), names);
    }
    // Empty files, which tools for temporary names make, and .esker files, damaged ones too, are
    // replaced.
    folder.write("b.esker", "");
    run("append", &[&a, &scan], &b).worked();
    let bytes = std::fs::read(&b).unwrap();
    std::fs::write(&b, &bytes[..100]).unwrap();
    run("build", &[&scan], &b).worked();
    merge(&b).worked();
    // An export never replaces a file that it reads: neither the input nor one that the input
    // names.
    let [old, new] = ["old.las", "new.las"].map(|name| folder.file(name));
    std::fs::rename(&a, &old).unwrap();
    std::fs::remove_file(&b).unwrap();
    run("append", &[&old, &scan], &b).worked();
    std::fs::rename(&b, &new).unwrap();
    let overwrite = |out: &Path| {
        let words = ["export".as_ref(), new.as_os_str(), "--overwrite".as_ref(), "-o".as_ref()];
        esker(words.into_iter().chain([out.as_os_str()]))
    };
    for out in [&old, &new] {
        let before = std::fs::read(out).unwrap();
        let outcome = overwrite(out);
        assert!(outcome.error().contains("input and output at once"), "{}", outcome.stderr);
        assert!(std::fs::read(out).unwrap() == before);
    }
    // It does not replace the scan that the file was built from.
    let outcome = overwrite(&scan);
    assert!(outcome.error().contains("one of the scans"), "{}", outcome.stderr);
    // It replaces no other scan either, unless --overwrite is given.
    let outcome = run("export", &[&new], &other);
    assert!(outcome.error().contains("replace it with --overwrite"), "{}", outcome.stderr);
    assert_eq!(std::fs::read_to_string(&other).unwrap(), text);
    overwrite(&other).worked();
    assert_eq!(std::fs::read_to_string(&scan).unwrap(), text);
}

#[cfg(unix)]
fn pipes() {
    let folder = Folder::new();
    let scan = folder.write("scan.xyz", "0 0 0\n1 2 3\n4 5 6\n");
    let (a, pipe) = (folder.file("a.esker"), folder.file("pipe.las"));
    build(&[&scan], &a, &[]);
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let (names, out) = (folder.names(), folder.file("out"));
    let device = Path::new("/dev/null");
    for (what, word) in [(pipe.as_path(), "is a pipe"), (device, "is a device")] {
        let shown = what.to_str().unwrap();
        let outcomes = [
            run("build", &[what], &out),
            run("build", &[&scan, what], &out),
            run("append", &[&a, what], &out),
            run("append", &[what, &scan], &out),
            run("render", &[what], &out),
            run("export", &[what], &folder.file("out.las")),
            verify(&a, &[what]),
            verify::<&str>(what, &[]),
            esker(["info", shown]),
        ];
        for outcome in outcomes {
            let error = outcome.error();
            assert!(error.contains(shown) && error.contains(word), "{error}");
        }
        assert_eq!(folder.names(), names);
    }
}

fn folders() {
    let folder = Folder::new();
    let scans = folder.file("scans");
    let place = |name: &str, text: &str| std::fs::write(scans.join(name), text).unwrap();
    std::fs::create_dir_all(scans.join("deeper.las")).unwrap();
    let out = scans.join("out.esker");
    let outcome = run("build", &[&scans], &out);
    for word in ["scans", "folder without a scan", ".laz"] {
        assert!(outcome.error().contains(word), "{word}: {}", outcome.stderr);
    }
    place("b.XYZ", "1 2 3\n");
    place("a.ply", &ply(&["4 5 6", "7 8 9"]));
    place("notes.md", "no scan");
    place(".hidden.xyz", "0 0 0\n");
    place("deeper.las/c.xyz", "0 0 0\n");
    let more = folder.write("more.xyz", "2 2 2\n");
    let report = build(&[&scans, &more], &out, &[]);
    assert_eq!(report["points_out"], 4, "{report}");
    assert_eq!(verify(&out, &[&more, &scans]).json()["against_points"], 4);
    let info = esker(["info".as_ref(), out.as_os_str(), "--json".as_ref()]).json();
    let names = info["sources"].as_array().unwrap().iter().map(|s| s["path"].as_str().unwrap());
    let names: Vec<_> =
        names.map(|n| Path::new(n).file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["more.xyz", "a.ply", "b.XYZ"]);
    let grown = folder.file("grown.esker");
    run("append", &[&out, &scans], &grown).worked();
    assert_eq!(verify(&grown, &[&scans]).json()["points"], 7);
}

fn named_twice() {
    let folder = Folder::new();
    let (scan, out) = (folder.write("scan.xyz", "0 0 0\n1 2 3\n"), folder.file("out.esker"));
    let roundabout = folder.file(".").join("scan.xyz");
    let outcome = run("build", &[&scan, &roundabout], &out);
    let told = &outcome.worked().stderr;
    assert!(told.contains("note:") && told.contains("scan.xyz: is named 2 times"), "{told}");
    assert_eq!(verify(&out, &[&scan, &scan]).json()["points"], 4);
    let spec = Path::new("synthetic:cube:100");
    let outcome = run("build", &[spec, spec, &scan], &out);
    assert_eq!(outcome.worked().stderr.matches("is named").count(), 1, "{}", outcome.stderr);
}
