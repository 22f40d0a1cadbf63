//! Generated scans work as any input does, with the same proof.

use crate::folder::Folder;
use crate::program::{build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;

const SCENES: [&str; 3] = ["bridge", "office", "terrain"];

pub fn trials(trials: &mut Vec<Trial>) {
    for scene in SCENES {
        let name = format!("synthetic: a million points of {scene} come through");
        trials.push(trial(&name, move || comes_through(scene)));
    }
    trials.push(trial("synthetic: info and render take a generated scan", info_and_render));
    trials.push(trial("synthetic: another seed or number of points is another scan", others));
    trials.push(trial("synthetic: unknown scenes are refused", faults));
    #[cfg(unix)]
    trials.push(trial("synthetic: a file of such a name is a file", file_of_that_name));
}

fn comes_through(scene: &str) {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let report = build(&[format!("synthetic:{scene}:1M:1")], &out, &[]);
    assert_eq!(
        (&report["points_in"], &report["points_out"]),
        (&1_000_000.into(), &1_000_000.into())
    );
    assert_eq!(report["rounding_error_max"], 0.0);
    // The default seed is 1.
    let verified = verify(&out, &[format!("synthetic:{scene}:1000000")]).json();
    assert_eq!(verified["multiset_hash"], report["multiset_hash"]);
    let info = esker(["info", out.to_str().unwrap(), "--json"]).json();
    assert_eq!(info["sources"][0]["path"], format!("synthetic:{scene}:1M:1"));
    assert_eq!(info["sources"][0]["format"], format!("synthetic {scene}"));
    assert_eq!(info["unit"], "metre");
    assert_eq!(folder.names(), ["out.esker"], "nothing else is left");
}

fn info_and_render() {
    let folder = Folder::new();
    let info = esker(["info", "synthetic:office:1G:3", "--json"]).json();
    assert_eq!(
        (&info["points"], &info["format"]),
        (&1_000_000_000.into(), &"synthetic office".into())
    );
    let picture = folder.file("p.png");
    let words = ["render", "synthetic:terrain:20k", "--size", "64x64", "--json", "-o"];
    esker(words.into_iter().chain([picture.to_str().unwrap()])).json();
    assert!(picture.is_file());
}

fn others() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let inputs = ["synthetic:terrain:10k:2", "synthetic:office:10k:2"];
    build(&inputs, &out, &[]);
    verify(&out, &[inputs[1], inputs[0]]).json();
    for other in ["synthetic:office:10k:3", "synthetic:office:10001:2", "synthetic:bridge:10k:2"] {
        verify(&out, &[inputs[0], other]).error();
    }
    let empty = folder.file("empty.esker");
    assert_eq!(build(&["synthetic:office:0"], &empty, &[])["points_out"], 0);
}

fn faults() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    for bad in [
        "synthetic:castle:1M",
        "synthetic:office",
        "synthetic:office:9999G",
        "synthetic:office:1M:x",
    ] {
        for words in [vec!["build", bad, "-o", out.to_str().unwrap()], vec!["info", bad]] {
            let outcome = esker(words);
            let error = outcome.error();
            assert!(error.contains(bad) && SCENES.iter().all(|s| error.contains(s)), "{error}");
        }
    }
    assert_eq!(folder.names(), [""; 0], "nothing is left");
}

#[cfg(unix)]
fn file_of_that_name() {
    let folder = Folder::new();
    let scan = folder.write("synthetic:office:1M", "0 0 0\n1 2 3\n");
    let report = build(&[scan], &folder.file("out.esker"), &[]);
    assert_eq!(report["points_out"], 2);
}
