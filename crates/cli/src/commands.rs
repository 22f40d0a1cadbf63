//! The commands: each turns its options into a call of the engine, and prints the report.

use crate::args::{Append, Build, Command, Render, Verify};
use crate::output::{print, write};
use crate::shared::note_built;
use crate::{export, pick, view};
use anyhow::{Result, ensure};
use esker_engine::calls::{build, conditions, demo, explain, info, info_text, render, verify};
use esker_engine::draw::scene::PictureRequest;
use esker_engine::io::progress::{Progress, Style};
use esker_engine::machine::devices;
use esker_engine::{Dots, Method, PointSize};
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
        Command::Render(args) => run_render(*args, stop),
        Command::Pick(args) => pick::run(*args, stop),
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

fn run_render(args: Render, stop: Arc<AtomicBool>) -> Result<()> {
    let mut camera = args.camera;
    if args.fit {
        (camera.eye, camera.target) = (None, None);
    }
    args.light.check(args.method)?;
    let has_dots = args.point_size != PointSize::default() || args.eye_dome.is_some();
    ensure!(
        !has_dots || args.method == Method::Points,
        "--point-size and --eye-dome are for points that are drawn alone: add --method points"
    );
    let request = PictureRequest {
        size: args.size,
        window: args.window,
        method: args.method,
        camera,
        budget_points: args.budget_points,
        budget_ms: args.budget_ms,
        target_spacing_px: args.target_spacing,
        colour_by: args.light.colour_by(args.colour),
        filter: args.filter.into(),
        shines: !args.no_highlights,
        evens_exposure: args.even_exposure,
        culls_back: args.cull_back,
        dots: Dots { size: args.point_size, eye_dome: args.eye_dome.unwrap_or_default() },
        full: args.full,
        light: args.light.into(),
        with: (&args.with).into(),
        threads: args.how.threads.count,
        build: args.how.options_for(args.method),
        ..PictureRequest::default()
    };
    let (inputs, output) = (&args.inputs, &args.output);
    note_built(inputs, &args.how);
    match args.out.filter(|_| !args.explain) {
        None => output.report(stop, |p| explain::explain(inputs, &request, p), explain::text),
        Some(out) => {
            output.report(stop, |p| render::render(inputs, &out, &request, p), render::text)
        }
    }
}

/// Folder of the sample scan: the current folder if it is a clone of the project, else the one that
/// the program was built from.
fn project() -> &'static Path {
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new("."));
    if Path::new("tests/sample").is_dir() { Path::new(".") } else { built }
}
