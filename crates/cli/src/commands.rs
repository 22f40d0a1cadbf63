//! The commands: each turns its options into a call of the engine, and prints the report.

use crate::args::{Append, Build, Command, Verify};
use crate::output::{print, write};
use crate::{export, pick, render, view};
use anyhow::Result;
use esker_engine::calls::{build, conditions, demo, info, info_text, verify};
use esker_engine::document::{self, Document, SceneInfo};
use esker_engine::io::progress::{Progress, Style};
use esker_engine::machine::devices;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Runs a command; `stop` is set when the user interrupts it. Returns the exit code: 0, or that of
/// the window.
pub fn run(command: Command, stop: Arc<AtomicBool>) -> Result<ExitCode> {
    let done = match command {
        Command::Build(args) => run_build(args, stop),
        Command::Append(args) => run_append(args, stop),
        Command::Info { file: Some(file), conditions: true, json, .. } => {
            let report = conditions::conditions(&file, &Progress::new(Style::None, stop))?;
            print(json, &report, || conditions::text(&report))
        }
        Command::Info { file: Some(file), json, .. } if document::is_document(&file)? => {
            let report = SceneInfo::of(&Document::read(&file)?);
            print(json, &report, || report.text())
        }
        Command::Info { file: Some(file), reading, json, .. } => {
            let report =
                info::info(&file, &reading.open_options(), &Progress::new(Style::None, stop))?;
            print(json, &report, || info_text::text(&report))
        }
        Command::Info { file: None, with, json, .. } => {
            let report = devices::system(&(&with).into());
            print(json, &report, || devices::text(&report))
        }
        Command::Verify(args) => run_verify(args, stop),
        Command::Export(args) => export::run(args, stop),
        Command::Render(args) => render::run(*args, stop),
        Command::Pick(args) => pick::run(*args, stop),
        Command::Job(job) => crate::job::run(job, stop),
        Command::View(args) => return view::run(&args),
        Command::Demo { out } => {
            let report = demo::demo(project(), &out, &Progress::new(Style::Bar, stop))?;
            write(&demo::text(&report))
        }
        Command::Bench { benchmark: Some(benchmark) } => crate::bench::run(benchmark, stop),
        Command::Bench { benchmark: None } => {
            let line = |(name, what): &(_, _)| format!("esker bench {name:<9} {what}");
            write(&esker_bench::BENCHMARKS.iter().map(line).collect::<Vec<_>>().join("\n"))
        }
    };
    done.map(|()| ExitCode::SUCCESS)
}

fn run_build(args: Build, stop: Arc<AtomicBool>) -> Result<()> {
    let build = if args.merge { build::merge } else { build::build };
    let (how, out) = (&args.how, &args.out);
    let options = how.resumable(args.resume);
    args.output.report(
        stop,
        |progress| build(&args.inputs, out, &options, how.threads.count, progress),
        |report| build::text(report, out),
    )
}

fn run_append(args: Append, stop: Arc<AtomicBool>) -> Result<()> {
    let Append { old, inputs, out, how, output, .. } = &args;
    let mut options = how.resumable(args.resume);
    options.drop_outside = args.drop_outside;
    if how.node_capacity.is_none() {
        options.node_capacity = build::node_capacity(old)?;
    }
    output.report(
        stop,
        |progress| build::append(old, inputs, out, &options, how.threads.count, progress),
        |report| build::text(report, out),
    )
}

fn run_verify(args: Verify, stop: Arc<AtomicBool>) -> Result<()> {
    let report = args.output.watch(stop, |progress| {
        let reading = args.reading.open_options();
        verify::verify(&args.file, &args.against, &reading, args.threads.count, progress)
    });
    if let (Err(error), true) = (&report, args.output.json) {
        print(true, &verify::fault(&args.file, error), String::new)?;
    }
    let report = report?;
    args.output.print(&report, || verify::text(&args.file, &report))
}

/// Folder of the sample scan: the current folder if it is a clone of the project, else the one that
/// the program was built from.
fn project() -> &'static Path {
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new("."));
    if Path::new("tests/sample").is_dir() { Path::new(".") } else { built }
}
