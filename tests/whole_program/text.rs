//! Text whose columns the user names: every command that opens scans takes the same options, and
//! shows what it guesses without them.

use crate::folder::Folder;
use crate::program::{build, esker};
use crate::trial;
use libtest_mimic::Trial;
use std::ffi::OsStr;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("text: the user says which column is which", columns));
    trials.push(trial("text: guesses are shown before the build", guesses));
}

fn columns() {
    let folder = Folder::new();
    let scan = folder.write("scan.txt", "Station 7\n1 20.5 10.5 3\n2 21.5 11.5 4\n");
    let (out, more) = (folder.file("out.esker"), folder.file("more.esker"));
    let told = esker([OsStr::new("info"), scan.as_os_str()]);
    assert!(told.error().contains("scan.txt"), "{}", told.stderr);
    let options = ["--columns", "x=3,y=2,z=4,id=1", "--skip-lines", "1"];
    build(&[&scan], &out, &options);
    let with = |words: &[&OsStr]| {
        let options = options.iter().map(OsStr::new);
        esker(words.iter().copied().chain(options).chain([OsStr::new("--json")]))
    };
    let info = with(&["info".as_ref(), scan.as_os_str()]).json();
    assert_eq!(info["bounds"], serde_json::json!([[10.5, 20.5, 3.0], [11.5, 21.5, 4.0]]));
    assert_eq!(info["attributes"][0]["name"], "id");
    let verify = |file: &std::path::Path| {
        with(&["verify".as_ref(), file.as_os_str(), "--against".as_ref(), scan.as_os_str()])
    };
    assert_eq!(verify(&out).json()["against_points"], 2);
    let append = ["append".as_ref(), out.as_os_str(), scan.as_os_str()];
    with(&[&append[..], &["-o".as_ref(), more.as_os_str()]].concat()).worked();
    assert_eq!(verify(&more).json()["against_points"], 2);
    let wrong = esker(["build", "a.txt", "-o", "b.esker", "--columns", "x"].map(OsStr::new));
    assert!(wrong.stderr.contains("`x` has no `=`"), "{}", wrong.stderr);
}

fn guesses() {
    let folder = Folder::new();
    let scan = folder.write("scan.xyz", "1 2 3 4\n5 6 7 8\n");
    let other = folder.write("other.xyz", "1 2 3 5\n5 6 7 9\n");
    let out = folder.file("out.esker");
    let words = [scan.as_os_str(), other.as_os_str(), "-o".as_ref(), out.as_os_str()];
    let told = esker([OsStr::new("build")].into_iter().chain(words));
    let told = &told.worked().stderr;
    let want = "taken for x, y, z, intensity: `1 2 3 4`, `5 6 7 8`; name them with --columns";
    assert!(told.contains(want) && told.contains("(and 1 more inputs alike)"), "{told}");
    assert_eq!(told.matches("name them with").count(), 1, "{told}");
}
