//! The demonstration as a call: builds, verifies and draws the sample scan of the project.

use crate::calls::build;
use crate::calls::render;
use crate::calls::verify;
use crate::cameras::camera::Camera;
use crate::draw::method::Method;
use crate::draw::scene::PictureRequest;
use anyhow::{Context, Result, ensure};
use esker_builder::Options;
use esker_points::Task;
use esker_scan::OpenOptions;
use std::path::{Path, PathBuf};

/// The sample scan, relative to the project's folder.
const SAMPLE: &str = "tests/sample/creek.laz";
/// A view up the valley of the sample scan.
const CAMERA: &str = "eye=5679750,3769950,1480;target=5679080,3770560,955;fovy=48";

/// What the demonstration did.
#[derive(Clone, Debug)]
pub struct DemoReport {
    /// What was built.
    pub build: build::BuildReport,
    /// What was drawn.
    pub render: render::RenderReport,
    file: PathBuf,
    picture: PathBuf,
}

/// Builds the sample scan, verifies the file against it, and draws it, all into the folder `out`.
/// `project` is the folder of the project's sources.
///
/// # Errors
/// If the sample scan is missing, or a step fails.
pub fn demo(project: &Path, out: &Path, task: &dyn Task) -> Result<DemoReport> {
    let sample = project.join(SAMPLE);
    ensure!(
        sample.is_file(),
        "{}: the sample scan is missing; run this in a clone of the project, or name a scan: esker render SCAN -o picture.png",
        sample.display()
    );
    std::fs::create_dir_all(out)
        .with_context(|| format!("{}: cannot make the folder", out.display()))?;
    let file = out.join("sample.esker");
    let options = Options::default();
    let build = build::build(std::slice::from_ref(&sample), &file, &options, 0, task)?;
    verify::verify(&file, &[sample], &OpenOptions::default(), 0, task)?;
    let picture = out.join("sample.png");
    let camera = Camera::parse(CAMERA)?;
    let (size, method) = ([1280, 720], Method::default());
    let request = PictureRequest { size, camera, method, ..PictureRequest::default() };
    let render = render::render(std::slice::from_ref(&file), &picture, &request, task)?;
    Ok(DemoReport { build, render, file, picture })
}

/// Text of a report.
pub fn text(report: &DemoReport) -> String {
    let lines = [
        build::text(&report.build, &report.file),
        "verified: every byte, and against the scan every point with all its attributes".into(),
        render::text(&report.render),
        format!("look at {}", report.picture.display()),
    ];
    lines.join("\n")
}
