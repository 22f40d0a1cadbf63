//! Each command: from its arguments to a call of the engine, and what that returns to standard output.

use crate::args::{
    Append, BenchBuild, Benchmark, Build, BuildHow, Command, Decode, Draw, Render, Stream, Verify,
};
use crate::{export, view};
use anyhow::{Context, Result, bail};
use esker_engine::progress::{Progress, Style};
use esker_engine::{
    BuildOptions, Resume, Value, bench, build, demo, devices, explain, info, quantity, render,
    verify,
};
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Runs a command; `stop` is set when the user wants to stop. The exit code where it worked: that of the window, where
/// that is what was run.
pub fn run(command: Command, stop: Arc<AtomicBool>) -> Result<ExitCode> {
    let done = match command {
        Command::Build(args) => run_build(args, stop),
        Command::Append(args) => run_append(args, stop),
        Command::Info { file: Some(file), json, .. } => {
            let report = info::info(&file, &Progress::new(Style::None, stop))?;
            print(json, &report, || info::text(&report))
        }
        Command::Info { file: None, with, json, .. } => {
            let report = devices::system(&(&with).into());
            print(json, &report, || devices::text(&report))
        }
        Command::Verify(args) => run_verify(args, stop),
        Command::Export(args) => export::run(args, stop),
        Command::Render(args) => run_render(*args, stop),
        Command::View(args) => return view::run(&args),
        Command::Demo { out } => {
            let lines = demo::demo(project(), &out, &Progress::new(Style::Bar, stop))?;
            write(&lines.join("\n"))
        }
        Command::Bench { benchmark: Some(Benchmark::Stream(args)) } => run_stream(*args, stop),
        Command::Bench { benchmark: Some(Benchmark::Draw(args)) } => run_draw(*args, stop),
        Command::Bench { benchmark: Some(Benchmark::Render(args)) } => {
            crate::bench::render(*args, stop)
        }
        Command::Bench { benchmark: Some(Benchmark::LeaveOut(args)) } => {
            crate::bench::leave_out(*args, stop)
        }
        Command::Bench { benchmark: Some(Benchmark::Build(args)) } => run_bench_build(args, stop),
        Command::Bench { benchmark: Some(Benchmark::Decode(args)) } => run_decode(args, stop),
        Command::Bench { benchmark: None } => {
            let line = |(name, what)| format!("esker bench {name:<8} {what}");
            write(&bench::BENCHMARKS.map(line).join("\n"))
        }
    };
    done.map(|()| ExitCode::SUCCESS)
}

fn run_build(args: Build, stop: Arc<AtomicBool>) -> Result<()> {
    let progress = Progress::new(args.progress.into(), stop);
    let build = if args.merge { build::merge } else { build::build };
    let options = resumable(&args.how, args.resume);
    let (report, seconds) = build(&args.inputs, &args.out, &options, args.how.threads, &progress)?;
    drop(progress);
    print(args.json, &build::json(&report, seconds), || build::text(&report, seconds, &args.out))
}

fn run_append(args: Append, stop: Arc<AtomicBool>) -> Result<()> {
    let progress = Progress::new(args.progress.into(), stop);
    let Append { old, inputs, out, how, .. } = &args;
    let mut options = resumable(how, args.resume);
    if how.node_capacity.is_none() {
        options.node_capacity = build::node_capacity(old)?;
    }
    let (report, seconds) = build::append(old, inputs, out, &options, how.threads, &progress)?;
    drop(progress);
    print(args.json, &build::json(&report, seconds), || build::text(&report, seconds, out))
}

fn run_verify(args: Verify, stop: Arc<AtomicBool>) -> Result<()> {
    let progress = Progress::new(args.progress.into(), stop);
    let report = verify::verify(&args.file, &args.against, args.threads, &progress);
    drop(progress);
    if let (Err(error), true) = (&report, args.json) {
        write(&verify::refused(&args.file, error).to_string())?;
    }
    let report = report?;
    print(args.json, &report, || {
        let points = quantity::grouped(report["points"].as_u64().unwrap_or(0));
        let against = if args.against.is_empty() { "" } else { ", the points of the scans" };
        let trees = report["trees"].as_u64().filter(|&trees| trees > 1);
        let trees = trees.map_or(String::new(), |trees| format!(" in {trees} trees"));
        format!("{}: ok, {points} points{trees}{against}", args.file.display())
    })
}

fn run_render(args: Render, stop: Arc<AtomicBool>) -> Result<()> {
    let mut camera = args.camera;
    if args.fit {
        (camera.eye, camera.target) = (None, None);
    }
    let request = render::Request {
        size: args.size,
        method: args.method.into(),
        camera,
        budget_points: args.budget_points,
        target_spacing_px: args.target_spacing,
        colour_by: args.colour,
        filter: args.filter.into(),
        shines: !args.no_highlights,
        with: (&args.with).into(),
        threads: args.how.threads,
        build: options(&args.how),
        ..render::Request::default()
    };
    let progress = Progress::new(args.progress.into(), stop);
    let Some(out) = args.out.filter(|_| !args.explain) else {
        let report = render::explain(&args.inputs, &request, &progress)?;
        drop(progress);
        return print(args.json, &report, || explain::text(&report));
    };
    let report = render::render(&args.inputs, &out, &request, &progress)?;
    drop(progress);
    print(args.json, &report, || render::text(&report))
}

fn run_stream(args: Stream, stop: Arc<AtomicBool>) -> Result<()> {
    let plan = bench::process::Plan {
        request: bench::stream::Request {
            path: args.path,
            with: (&args.with).into(),
            budget_gpu_bytes: args.budget_gpu,
            budget_ram_bytes: args.budget_ram,
            size: args.size,
            occlusion: !args.no_occlusion,
            cold: args.cold,
            settings: args.settings.into(),
            pictures: args.pictures,
            threads: args.how.threads,
        },
        inputs: args.inputs,
        paper_too: args.paper,
        capacities: args.capacities,
        build: options(&args.how),
        program: std::env::current_exe().context("cannot find the program itself")?,
    };
    let progress = Progress::new(args.progress.into(), stop);
    let report = bench::process::stream(&plan, &progress)?;
    drop(progress);
    print(args.json, &report, || bench::report::text(&report))
}

fn run_draw(args: Draw, stop: Arc<AtomicBool>) -> Result<()> {
    let request = bench::draw::Request {
        file: args.file,
        points: args.points,
        sizes: args.size,
        with: (&args.with).into(),
        budget_gpu_bytes: args.budget_gpu,
        budget_ram_bytes: args.budget_ram,
        threads: args.threads,
    };
    let progress = Progress::new(args.progress.into(), stop);
    let report = bench::draw::measure(&request, &progress)?;
    drop(progress);
    print(args.json, &report, || bench::draw::text(&report))
}

fn run_bench_build(args: BenchBuild, stop: Arc<AtomicBool>) -> Result<()> {
    let threads: Vec<_> = args.threads.iter().map(|n| format!("--threads={n}").into()).collect();
    let memory = args.memory.iter().map(|bytes| format!("--memory={bytes}").into());
    let plan = bench::build::Plan {
        inputs: args.inputs,
        against: args.against,
        runs: args.runs,
        folder: args.scratch,
        build_words: memory.chain(threads.clone()).chain(args.options).collect(),
        decode_words: threads,
        esker: std::env::current_exe().context("cannot find the program itself")?,
    };
    let progress = Progress::new(args.progress.into(), stop);
    let report = bench::build::measure(&plan, &progress)?;
    drop(progress);
    print(args.json, &report, || bench::build::text(&report))?;
    match bench::build::failure(&report) {
        Some(failure) => bail!(failure),
        None => Ok(()),
    }
}

fn run_decode(args: Decode, stop: Arc<AtomicBool>) -> Result<()> {
    let progress = Progress::new(args.progress.into(), stop);
    let report = bench::build::decode(&args.inputs, args.threads, &progress)?;
    drop(progress);
    print(args.json, &report, || bench::build::decode_text(&report))
}

/// For a build that is kept where it is cut short.
fn resumable(how: &BuildHow, goes_on: bool) -> BuildOptions {
    let resume = if goes_on { Resume::Now } else { Resume::Later };
    BuildOptions { resume, ..options(how) }
}

fn options(how: &BuildHow) -> BuildOptions {
    let default = BuildOptions::default();
    BuildOptions {
        memory_bytes: how.memory.unwrap_or(default.memory_bytes),
        scratch: how.scratch.clone(),
        node_capacity: how.node_capacity.unwrap_or(default.node_capacity),
        colour_depth: how.colour_bits.map(Into::into),
        compress: how.compress.into(),
        normals: how.normals.into(),
        ignore_crs: how.ignore_crs,
        ..default
    }
}

/// Where the sample scan lies: the current folder where it is a clone of the project, else where the
/// program was built.
fn project() -> &'static Path {
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new("."));
    if Path::new("tests/sample").is_dir() { Path::new(".") } else { built }
}

/// A report for machines or for people, to standard output.
pub fn print(as_json: bool, report: &Value, text: impl FnOnce() -> String) -> Result<()> {
    write(&if as_json { report.to_string() } else { text() })
}

/// To standard output; a reader that went away is no reason to fail loudly.
fn write(text: &str) -> Result<()> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}
