//! Steps of a divided build as processes: killed, doubled, out of order, interrupted; run by `esker
//! job run`, and by the variables of schedulers.

use crate::folder::Folder;
use crate::program::{ESKER, Outcome, build, esker, finish, run, sample, start};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::{Value, json};
use std::process::Command;
use std::time::{Duration, Instant};

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("jobs: killed and doubled takes give one cut", killed_and_doubled));
    trials.push(trial("jobs: each step killed once gives the file of one process", each_killed));
    trials.push(trial("jobs: run does all steps, and what is left of them", run_does_all));
    #[cfg(unix)]
    trials.push(trial("jobs: Ctrl-C is passed on and nothing is half done", interrupted));
}

const SCAN: &str = "synthetic:terrain:3M:1";
const NUMBERS: [&str; 4] = ["0", "1", "2", "3"];

/// Runs `esker job` for the folder `work`.
fn job(folder: &Folder, words: &[&str]) -> Outcome {
    let work = folder.file("work");
    let words = ["job"].iter().chain(words).map(|word| (*word).to_owned());
    esker(words.chain(["--to".into(), work.display().to_string()]))
}

fn plan(folder: &Folder, inputs: &[&str]) -> Value {
    let words = [&["plan"], inputs, &["--jobs", "4", "--json", "--ignore-crs"]].concat();
    job(folder, &words).json()
}

fn status(folder: &Folder) -> Value {
    job(folder, &["status", "--json"]).json()
}

/// Starts a take without waiting for it.
fn take(folder: &Folder, index: &str) -> Command {
    let mut command = Command::new(ESKER);
    command.args(["job", "take", "--json", "--progress", "none", "--to"]).arg(folder.file("work"));
    command.args(["--memory", "256MiB"]).env("JOB_COMPLETION_INDEX", index);
    command
}

/// Waits until a job has begun to write.
fn wait_for_object(folder: &Folder) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while !folder.file("work/take").is_dir() {
        assert!(Instant::now() < deadline, "the take never began to write");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn killed_and_doubled() {
    let (alone, folder) = (Folder::new(), Folder::new());
    let sample = sample().display().to_string();
    for folder in [&alone, &folder] {
        let plan = plan(folder, &[SCAN, &sample]);
        assert_eq!(plan["takes"], 4, "{plan}");
    }
    for index in ["0", "1", "2", "3"] {
        job(&alone, &["take", "--job", index]).worked();
    }
    let whole = job(&alone, &["cut", "--json"]).json();

    // A take that is killed as soon as it writes, before or after it is done.
    let (mut child, _outputs) = start(take(&folder, "2"));
    wait_for_object(&folder);
    child.kill().unwrap();
    child.wait().unwrap();
    let error = job(&folder, &["cut"]);
    assert!(error.error().contains("take/0000"), "{}", error.stderr);
    // In another order, each twice at the same time.
    for index in ["3", "0", "2", "1"] {
        let both = [(); 2].map(|()| start(take(&folder, index)));
        for (child, outputs) in both {
            let report = finish(child, outputs, format!("take {index}"), 120).json();
            assert_eq!(report["index"].to_string(), index);
        }
    }
    let killed = job(&folder, &["cut", "--json"]).json();
    assert_eq!(killed, whole);
    let status = status(&folder);
    for step in ["take", "cut"] {
        assert_eq!(status["steps"][step]["missing"], "", "{status}");
    }
    // Only the killed job can have left anything.
    assert!(status["leftovers"].as_array().unwrap().len() <= 1, "{status}");
    // A damaged output is named.
    let record = std::fs::read_to_string(folder.file("work/take/00001")).unwrap();
    let record: Value = serde_json::from_str(&record).unwrap();
    let object = folder.file("work").join(record["object"].as_str().unwrap());
    std::fs::OpenOptions::new().write(true).open(object).unwrap().set_len(1000).unwrap();
    std::fs::remove_file(folder.file("work/cut")).unwrap();
    let error = job(&folder, &["cut"]);
    assert!(error.error().contains("instead of"), "{}", error.stderr);
    let out = folder.file("out.esker").display().to_string();
    let again = job(&folder, &["run", "--local", "2", "-o", &out]);
    assert!(again.error().contains("remove the record take/00001"), "{}", again.stderr);
}

fn each_killed() {
    let folder = Folder::new();
    let out = folder.file("out.esker").display().to_string();
    plan(&folder, &[SCAN]);
    let numbered = |kind| (0..4).map(move |i| vec![kind, "--job"].into_iter().chain([NUMBERS[i]]));
    let steps = numbered("take").map(Iterator::collect::<Vec<_>>);
    let steps = steps.chain([vec!["cut"]]).chain(numbered("build").map(Iterator::collect));
    let steps = steps.chain([vec!["join", "-o", &out]]);
    for (step, words) in (0u64..).zip(steps) {
        let mut command = Command::new(ESKER);
        command.args(["job"]).args(&words).arg("--to").arg(folder.file("work"));
        let (mut child, _outputs) = start(command);
        // Each at another time: before it writes, meanwhile, or when it is done.
        std::thread::sleep(Duration::from_millis(15 + step * 20));
        child.kill().unwrap();
        child.wait().unwrap();
        job(&folder, &words).worked();
    }
    let alone = folder.file("alone.esker");
    build(&[SCAN], &alone, &[]);
    assert!(std::fs::read(alone).unwrap() == std::fs::read(&out).unwrap(), "other bytes");
    assert_eq!(status(&folder)["leftovers"], json!([]));
}

fn run_does_all() {
    let folder = Folder::new();
    let out = folder.file("out.esker").display().to_string();
    let error = job(&folder, &["run", "--local", "2", "-o", &out]);
    assert!(error.error().contains("plan.json: is missing"), "{}", error.stderr);
    plan(&folder, &[SCAN]);
    job(&folder, &["take", "--job", "3/4"]).worked();
    let done = job(&folder, &["run", "--local", "3", "-o", &out, "--json"]).json();
    assert_eq!(done["points_out"], 3_000_000);
    let state = status(&folder);
    for step in ["take", "cut", "build", "join"] {
        let state = &state["steps"][step];
        assert_eq!((&state["missing"], &state["damaged"]), (&"".into(), &json!([])));
    }
    assert_eq!(state["leftovers"], json!([]));
    let cut = job(&folder, &["cut", "--json"]).json();
    assert_eq!((&cut["was_done"], &cut["points"]), (&true.into(), &3_000_000.into()));
    let alone = folder.file("alone.esker");
    build(&[SCAN], &alone, &[]);
    assert!(std::fs::read(alone).unwrap() == std::fs::read(&out).unwrap(), "other bytes");
    // A step that fails is run once more, and then is an error that names it.
    std::fs::remove_file(folder.file("work/take/00000")).unwrap();
    std::fs::remove_file(folder.file("work/cut")).unwrap();
    let nowhere = folder.file("nowhere").display().to_string();
    let failed = job(&folder, &["run", "--local", "1", "--scratch", &nowhere, "-o", &out]);
    assert_eq!(failed.code, Some(1));
    for words in ["take --job 0 failed; it is run again", "take --job 0: failed 2 times"] {
        assert!(failed.stderr.contains(words), "{}", failed.stderr);
    }
}

#[cfg(unix)]
fn interrupted() {
    let folder = Folder::new();
    plan(&folder, &["synthetic:terrain:20M:1"]);
    let mut command = Command::new(ESKER);
    command.args(["job", "run", "--local", "2", "--to"]).arg(folder.file("work"));
    command.arg("-o").arg(folder.file("out.esker"));
    let (child, outputs) = start(command);
    wait_for_object(&folder);
    run(kill(child.id()), 10).worked();
    let outcome = finish(child, outputs, "an interrupted run".into(), 60);
    assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
    // The processes have ended, and what they had begun is removed.
    let status = status(&folder);
    assert_eq!(status["leftovers"], json!([]), "{status}");
    assert_ne!(status["steps"]["take"]["missing"], "", "{status}");
}

#[cfg(unix)]
fn kill(id: u32) -> Command {
    let mut command = Command::new("kill");
    command.args(["-INT", &id.to_string()]);
    command
}
