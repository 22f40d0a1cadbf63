//! Tasks for developers: `cargo xtask ci` is the one gate of the project, and CI runs it; each of
//! its steps can be run alone. After a failed step the others are still run.

mod browsers;
mod compare;
mod copc;
mod deps;
mod faults;
mod figures;
mod fmt;
mod gallery;
mod house;
mod large;
mod light;
mod lint;
mod python;
mod readme;
mod remote;
mod report;
mod shaders;
mod shell;
mod tally;
mod view;

use std::process::ExitCode;
use std::time::{Duration, Instant};
use tally::Tally;

/// A step: its name, a description in a few words, and its function. Tests add to the tally.
struct Step {
    name: &'static str,
    about: &'static str,
    run: fn(&mut Tally) -> anyhow::Result<()>,
}

const STEPS: [Step; 13] = [
    Step { name: "fmt", about: "formatting", run: |_| fmt::check() },
    Step {
        name: "lint",
        about: "clippy and the links in the documentation, warnings are errors",
        run: |_| lint::check(),
    },
    Step { name: "deps", about: "directions of dependencies", run: |_| deps::check() },
    Step { name: "shaders", about: "validation of shaders", run: |_| shaders::check() },
    Step {
        name: "browsers",
        about: "shaders as browsers compile them",
        run: |_| browsers::check(),
    },
    Step { name: "house", about: "house rules of files", run: |_| house::check() },
    Step {
        name: "light",
        about: "programs without light have none of it",
        run: |_| light::check(),
    },
    Step {
        name: "copc",
        about: "exports to COPC as other programs read them",
        run: |_| copc::check(),
    },
    Step { name: "remote", about: "files at addresses", run: remote::check },
    Step { name: "test", about: "the README's test command", run: readme::test },
    Step { name: "view", about: "the viewer's tests, on a display or under Xvfb", run: view::test },
    Step { name: "python", about: "the Python package", run: python::check },
    Step { name: "demo", about: "the README's run command", run: |_| readme::demo() },
];

/// Command of the relations of real scans.
const RELATIONS: [&str; 9] = [
    "test",
    "--release",
    "-p",
    "esker-engine",
    "--test",
    "relations",
    "--",
    "--ignored",
    "--nocapture",
];

/// Tasks outside the gate: they take too long, or write files.
const APART: [Step; 7] = [
    Step {
        name: "large",
        about: "20 to 100 million points within their memory; ESKER_LARGE=1G for more",
        run: |_| large::run(),
    },
    Step {
        name: "relations",
        about: "relations of pictures of the scans in ESKER_DATA",
        run: |_| shell::run_cargo(&RELATIONS),
    },
    Step {
        name: "faults",
        about: "injects faults into a copy; the bounds of esker bench stability must catch them",
        run: |_| faults::inject(&arguments()),
    },
    Step {
        name: "gallery",
        about: "draws docs/gallery anew, of the scans in ESKER_DATA",
        run: |_| gallery::draw(),
    },
    Step {
        name: "figures",
        about: "writes the README's table of figures from bench/results",
        run: |_| figures::write(),
    },
    Step {
        name: "report",
        about: "measures the scenes of docs/evidence anew, or those that are named",
        run: |_| report::run(&arguments()),
    },
    Step {
        name: "compare",
        about: "two folders of bench/results: what became worse beyond noise",
        run: |_| compare::run(&arguments()),
    },
];

/// Words after the name of the task.
fn arguments() -> Vec<String> {
    std::env::args().skip(2).collect()
}

fn main() -> ExitCode {
    let task = std::env::args().nth(1).unwrap_or_default();
    let mut steps: Vec<&Step> = STEPS.iter().filter(|s| task == "ci" || task == s.name).collect();
    steps.extend(APART.iter().filter(|s| task == s.name));
    if steps.is_empty() {
        println!("cargo xtask ci         all of these, in this order:");
        for step in &STEPS {
            println!("cargo xtask {:<11}{}", step.name, step.about);
        }
        println!("not of these:");
        for step in &APART {
            println!("cargo xtask {:<11}{}", step.name, step.about);
        }
        return ExitCode::from(if task.is_empty() { 0 } else { 2 });
    }
    if let Err(error) = shell::enter_root() {
        eprintln!("error: {error:#}");
        return ExitCode::FAILURE;
    }
    run(&steps)
}

/// Runs the steps and prints the closing lines.
fn run(steps: &[&Step]) -> ExitCode {
    let mut tally = Tally::default();
    let mut times: Vec<(&str, bool, Duration)> = Vec::new();
    for step in steps {
        println!("== {}: {}", step.name, step.about);
        let start = Instant::now();
        let result = (step.run)(&mut tally);
        if let Err(error) = &result {
            eprintln!("error in {}: {error:#}", step.name);
        }
        times.push((step.name, result.is_ok(), start.elapsed()));
    }
    println!("== times");
    for (name, ok, time) in &times {
        println!("{name:<8} {:>7.1} s  {}", time.as_secs_f64(), if *ok { "ok" } else { "FAILED" });
    }
    if tally.suites > 0 {
        println!("{tally}");
    }
    if times.iter().all(|(_, ok, _)| *ok) { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
