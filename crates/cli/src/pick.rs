//! `esker pick`: its options, and the call that they become.

use crate::output::Output;
use crate::shared::{BuildHow, FilterArgs, note_built};
use anyhow::Result;
use clap::Args as ClapArgs;
use esker_engine::calls::pick::report;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::io::quantity;
use esker_engine::{Filter, Method};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(ClapArgs)]
pub struct Pick {
    /// An .esker file, or scans, or folders of scans.
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// Pixel of the picture: column and row, from 0 at its top left corner.
    #[arg(long, value_name = "X,Y", value_parser = quantity::pixel)]
    pub at: [u32; 2],
    /// Width and height of the picture in pixels.
    #[arg(long, default_value = "1024x1024", value_parser = quantity::picture_size)]
    pub size: [u32; 2],
    /// Camera of the picture, as in render.
    #[arg(long, default_value = "", hide_default_value = true)]
    pub camera: Camera,
    /// Axis that points upwards, as in render.
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub up: Option<Vertical>,
    #[command(flatten)]
    pub filter: FilterArgs,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

/// Picks the point and prints it.
pub fn run(args: Pick, stop: Arc<AtomicBool>) -> Result<()> {
    note_built(&args.inputs, &args.how);
    let request = PictureRequest {
        size: args.size,
        method: Method::default(),
        camera: args.camera.with_up(args.up)?,
        filter: args.filter.over(Filter::default()),
        threads: args.how.threads.count,
        build: args.how.options(),
        ..PictureRequest::default()
    };
    args.output.report(
        stop,
        |progress| report::pick_pixel(&args.inputs, &request, args.at, progress),
        report::text,
    )
}
