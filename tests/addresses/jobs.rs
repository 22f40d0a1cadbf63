//! Steps of a divided build that share a bucket of S3 give the bytes of `esker build`, as jobs one
//! by one and as processes that run at the same time; and what is wrong is said.

use crate::folder::Folder;
use crate::moto::Moto;
use crate::{SECRET, bytes, esker, esker_with, scan, verified};

/// Options of the builds.
const HOW: [&str; 2] = ["--node-capacity", "4096"];

#[test]
fn steps_in_a_bucket_give_the_bytes_of_one_process() {
    let Some(moto) = Moto::start(1) else { return };
    let folder = Folder::new();
    moto.call("PUT", "/scans", "", b"");
    let [id, secret] = moto.user();
    let key = [("AWS_ACCESS_KEY_ID", id), ("AWS_SECRET_ACCESS_KEY", secret)];
    let all: Vec<(&str, String)> = moto.variables().into_iter().chain(key).collect();
    let all: Vec<(&str, &str)> = all.iter().map(|(name, value)| (*name, &**value)).collect();
    let job = |words: &[&str]| esker_with(&all, [&["job"], words].concat());
    let scan = scan();
    let scan = scan.to_str().unwrap();
    let whole = folder.file("whole.esker");
    esker([&["build", scan, "-o", whole.to_str().unwrap()][..], &HOW].concat()).worked();
    let whole = bytes(&whole);

    let to = ["--to", "s3://scans/work"];
    let plan = job(&[&["plan", scan, "--jobs", "3", "--json"][..], &to, &HOW].concat()).json();
    assert_eq!(plan["takes"], 3);
    let step = |words: &[&str]| job(&[words, &to, &["--json"]].concat());
    for index in ["2/3", "0/3", "1/3", "1/3"] {
        assert!(step(&["take", "--job", index]).json()["points"].as_u64().unwrap() > 0);
    }
    let builds = step(&["cut"]).json()["builds"].as_u64().unwrap();
    assert!(builds > 1);
    let out = folder.file("joined.esker");
    let join = ["join", "-o", out.to_str().unwrap()];
    let error = step(&join).error().to_owned();
    assert!(error.contains("s3://scans/work: build/00000: and"), "{error}");
    for index in (0..builds).rev() {
        step(&["build", "--job", &index.to_string()]).worked();
    }
    step(&join).worked();
    assert!(bytes(&out) == whole, "other bytes");
    let status = step(&["status"]).json();
    assert!(status.to_string().contains("\"leftovers\":[]"), "{status}");

    // Another plan is refused.
    let error = job(&[&["plan", scan, "--jobs", "2"][..], &to, &HOW].concat());
    assert!(error.error().contains("plan.json: is there already"), "{}", error.stderr);

    // Processes at the same time, objects of more than a part, and a file in the bucket.
    let to = ["--to", "s3://scans/other/work/"];
    let scan = "synthetic:terrain:700k:1";
    let bare = ["--normals", "none"];
    job(&[&["plan", scan, "--jobs", "1"][..], &to, &bare].concat()).worked();
    let out = "s3://scans/towns/joined.esker";
    job(&[&["run", "--local", "2", "--memory", "300MiB", "-o", out][..], &to].concat()).worked();
    let local = folder.file("local.esker");
    let local = local.to_str().unwrap();
    esker([&["build", scan, "-o", local][..], &bare].concat()).worked();
    // The same length and points; `verify` checks every byte.
    let end = |file: &str| {
        let report = esker_with(&all, ["info", file, "--json"]).json();
        (report["bytes"].as_u64().unwrap(), report["points"].clone())
    };
    assert_eq!(end(out), end(local));
    assert!(end(out).0 > 8 << 20, "more than a part");
    assert_eq!(verified(out, &all), verified(local, &[]));

    // No other object is replaced by the file.
    let outcome =
        esker_with(&all, ["job", "join", "-o", "s3://scans/work/plan.json", to[0], to[1]]);
    assert!(outcome.error().contains("is no .esker file"), "{}", outcome.stderr);
    for (id, secret) in [(SECRET, SECRET), ("", "")] {
        let wrong = moto.variables();
        let mut wrong: Vec<(&str, &str)> = wrong.iter().map(|(n, v)| (*n, &**v)).collect();
        if !id.is_empty() {
            wrong.extend([("AWS_ACCESS_KEY_ID", id), ("AWS_SECRET_ACCESS_KEY", secret)]);
        }
        let outcome = esker_with(&wrong, ["job", "status", to[0], to[1]]);
        assert!(outcome.error().contains("credentials"), "{}", outcome.stderr);
    }
    let outcome = esker_with(&all, ["job", "status", "--to", "https://127.0.0.1:9/work"]);
    assert!(outcome.error().contains("s3, gs or az"), "{}", outcome.stderr);
}
