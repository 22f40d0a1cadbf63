//! `esker bench render` and `esker bench leave-out`: their arguments and the calls.

use crate::args::{DrawWithArgs, MethodArg, ProgressArg, parse_camera, parse_points};
use crate::commands::print;
use anyhow::Result;
use clap::Args as ClapArgs;
use esker_engine::bench::{leave_out, render, splats};
use esker_engine::camera::Camera;
use esker_engine::progress::Progress;
use esker_engine::quantity;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(ClapArgs)]
pub struct BenchRender {
    /// .esker files or scans; generated models of as many points as the paper's where not said.
    #[arg(value_name = "MODEL", conflicts_with = "points")]
    pub models: Vec<PathBuf>,
    /// Numbers of points of generated models, such as 25k,5M.
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = parse_points)]
    pub points: Vec<u64>,
    /// Widths and heights in pixels.
    #[arg(
        long,
        value_name = "WxH,WxH",
        value_delimiter = ',',
        value_parser = quantity::picture_size
    )]
    pub size: Vec<[u32; 2]>,
    /// With ewa: splats of one size a second, in one pass and three (table 1 of zwicker2004).
    #[arg(long, value_enum, conflicts_with = "models")]
    pub method: Option<MethodArg>,
    #[command(flatten)]
    pub with: DrawWithArgs,
    /// Threads; one a core where not said.
    #[arg(long, value_parser = quantity::threads, default_value = "0", hide_default_value = true)]
    pub threads: usize,
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

#[derive(ClapArgs)]
pub struct LeaveOut {
    /// .esker files, or scans.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Width and height in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// As of `esker render`.
    #[arg(long, value_parser = parse_camera, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    #[command(flatten)]
    pub with: DrawWithArgs,
    /// Threads; one a core where not said.
    #[arg(long, value_parser = quantity::threads, default_value = "0", hide_default_value = true)]
    pub threads: usize,
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

/// Table 1.
pub fn render(mut args: BenchRender, stop: Arc<AtomicBool>) -> Result<()> {
    if args.method.is_some_and(|method| method == MethodArg::Ewa) {
        return splats(args, stop);
    }
    if args.size.is_empty() {
        args.size = vec![[512, 512], [1024, 1024]];
    }
    let request = render::Request {
        models: args.models,
        points: args.points,
        sizes: args.size,
        with: (&args.with).into(),
        threads: args.threads,
    };
    let progress = Progress::new(args.progress.into(), stop);
    let report = render::measure(&request, &progress)?;
    drop(progress);
    print(args.json, &report, || render::text(&report))
}

/// Table 1 of the other paper.
fn splats(args: BenchRender, stop: Arc<AtomicBool>) -> Result<()> {
    let request = splats::Request {
        splats: args.points,
        sizes: args.size,
        with: (&args.with).into(),
        threads: args.threads,
    };
    let progress = Progress::new(args.progress.into(), stop);
    let report = splats::measure(&request, &progress)?;
    drop(progress);
    print(args.json, &report, || splats::text(&report))
}

/// What leaving out saves.
pub fn leave_out(args: LeaveOut, stop: Arc<AtomicBool>) -> Result<()> {
    let request = leave_out::Request {
        files: args.files,
        size: args.size,
        camera: args.camera,
        with: (&args.with).into(),
        threads: args.threads,
    };
    let progress = Progress::new(args.progress.into(), stop);
    let report = leave_out::measure(&request, &progress)?;
    drop(progress);
    print(args.json, &report, || leave_out::text(&report))
}
