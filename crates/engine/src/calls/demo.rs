//! The demonstration: the sample scan of the project, from the scan file to the picture.

use crate::calls::build;
use crate::calls::render::{render, text as render_text};
use crate::calls::verify;
use crate::cameras::camera::Camera;
use crate::draw::scene::PictureRequest;
use anyhow::{Context, Result, ensure};
use esker_builder::Options;
use esker_points::Task;
use std::path::{Path, PathBuf};

/// The sample scan, from the project's folder.
const SAMPLE: &str = "tests/sample/creek.laz";
/// A view up the valley of the sample scan.
const CAMERA: &str = "eye=5679750,3769950,1480;target=5679080,3770560,955;fovy=48";

/// Builds the sample scan, verifies the file against it, and draws it into the folder `out`; the
/// lines to show. `project` is where the project's sources lie.
///
/// # Errors
/// Where a step fails.
pub fn demo(project: &Path, out: &Path, task: &dyn Task) -> Result<Vec<String>> {
    let sample = project.join(SAMPLE);
    ensure!(
        sample.is_file(),
        "{}: the sample scan is missing; run this in a clone of the project, or name a scan: esker render SCAN -o picture.png",
        sample.display()
    );
    std::fs::create_dir_all(out)
        .with_context(|| format!("{}: cannot make the folder", out.display()))?;
    let file = out.join("sample.esker");
    let (report, seconds) =
        build::build(std::slice::from_ref(&sample), &file, &Options::default(), 0, task)?;
    let mut lines = vec![build::text(&report, seconds, &file)];
    verify::verify(&file, &[sample], 0, task)?;
    lines.push(
        "verified: every byte, and against the scan every point with all its attributes".into(),
    );
    let picture: PathBuf = out.join("sample.png");
    let camera = Camera::parse(CAMERA)?;
    let request = PictureRequest { size: [1280, 720], camera, ..PictureRequest::default() };
    lines.push(render_text(&render(&[file], &picture, &request, task)?));
    lines.push(format!("look at {}", picture.display()));
    Ok(lines)
}
