//! Builds scans in a folder of its own, draws them, and collects the messages to the user.

use crate::error_time::analytic::Analytic;
use crate::stability::cloud::Cloud;
use anyhow::{Context, Result};
use esker_builder::Options;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::method::method_of_name;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::io::picture::write_png;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_format::Forest;
use esker_lod::View;
use esker_points::{Cancelled, Task};
use esker_render::Picture;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Bytes of a file that are compared: more than that of the points that are taken.
const FILE_BYTES_MAX: u64 = 1 << 30;

/// What all measurements share.
pub(super) struct Lab<'a> {
    /// Width and height of pictures, pixels.
    pub size: [u32; 2],
    /// Whether more values and points are tried.
    pub is_full: bool,
    pictures: Option<PathBuf>,
    folder: tempfile::TempDir,
    task: &'a dyn Task,
}

/// A file, and the notes of its build.
pub(super) struct Built {
    pub file: Forest,
    pub notes: Vec<String>,
    path: PathBuf,
}

/// A picture, its view, and its notes.
pub(super) struct Shot {
    pub picture: Picture,
    pub view: View,
    pub notes: Vec<String>,
}

impl<'a> Lab<'a> {
    /// A laboratory with a folder for its files; `pictures` is a folder for pictures.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub fn new(
        size: [u32; 2],
        is_full: bool,
        pictures: Option<PathBuf>,
        task: &'a dyn Task,
    ) -> Result<Self> {
        if let Some(folder) = &pictures {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("{}: cannot make the folder", folder.display()))?;
        }
        Ok(Self { size, is_full, pictures, folder: tempfile::tempdir()?, task })
    }

    /// Writes a picture to the folder of pictures, if there is one.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&self, name: &str, picture: &Picture) -> Result<()> {
        match &self.pictures {
            Some(folder) => write_png(picture, &folder.join(format!("{name}.png"))),
            None => Ok(()),
        }
    }

    /// Passes the name of a phase on, and stops if the user wants to.
    ///
    /// # Errors
    /// If the task is cancelled.
    pub fn phase(&self, name: &str) -> Result<()> {
        self.task.check()?;
        self.task.phase(name, None, "cases");
        Ok(())
    }

    /// The folder of the files.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Reads a scan; see [`Cloud::read`].
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(&self, path: &Path, most: u64) -> Result<Cloud> {
        Cloud::read(path, most, self.task)
    }

    /// Builds clouds into a file. It replaces the one of the build before.
    ///
    /// # Errors
    /// If the build fails.
    pub fn build(&self, clouds: &[&Cloud], options: &Options) -> Result<Built> {
        let notes = Notes::new(self.task);
        let path = self.folder.path().join("scan.esker");
        let sources = clouds.iter().map(|cloud| cloud.source()).collect();
        esker_builder::build_sources(sources, &path, options, &notes)?;
        Ok(Built { file: Forest::open(&path)?, notes: notes.into_lines(), path })
    }

    /// Builds a scan file into a file.
    ///
    /// # Errors
    /// If the build fails.
    pub fn build_file(&self, scan: &Path) -> Result<Built> {
        let notes = Notes::new(self.task);
        let path = self.folder.path().join("scan.esker");
        esker_builder::build(&[scan.to_owned()], &path, &Options::default(), &notes)?;
        Ok(Built { file: Forest::open(&path)?, notes: notes.into_lines(), path })
    }

    /// A request for a picture by the method of this name, on the CPU, which every machine has.
    pub fn request(&self, camera: &Camera, method: &str) -> PictureRequest {
        PictureRequest {
            size: self.size,
            method: method_of_name(method).unwrap_or_default(),
            camera: *camera,
            with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
            ..PictureRequest::default()
        }
    }

    /// Draws a picture.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn shot(&self, file: &Forest, request: &PictureRequest) -> Result<Shot> {
        let notes = Notes::new(self.task);
        let (picture, report) = draw(file, request, &notes)?;
        let view = PictureScene::choose(file, request)?.view.with_margin(0);
        let mut lines = notes.into_lines();
        lines.extend(report.notes.into_iter().map(String::from));
        Ok(Shot { picture, view, notes: lines })
    }

    /// Mean error of the normals that a file has, degrees; a missing one counts as a right angle.
    ///
    /// # Errors
    /// If they cannot be drawn.
    pub fn normal_error(&self, file: &Forest, camera: &Camera, truth: &Analytic) -> Result<f64> {
        let colour_by = Some("normal".to_owned());
        let request = PictureRequest { colour_by, ..self.request(camera, "points") };
        let shot = self.shot(file, &request)?;
        let (mean, share) = truth.normal_errors(&shot.view, &shot.picture);
        Ok(mean * share + 90.0 * (1.0 - share))
    }
}

impl Built {
    /// The bytes of the file.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        File::open(&self.path)
            .and_then(|file| file.take(FILE_BYTES_MAX).read_to_end(&mut bytes))
            .with_context(|| self.path.display().to_string())?;
        Ok(bytes)
    }
}

/// Collects notes, and passes on nothing but the wish to stop.
struct Notes<'a> {
    lines: Mutex<Vec<String>>,
    task: &'a dyn Task,
}

impl<'a> Notes<'a> {
    fn new(task: &'a dyn Task) -> Self {
        Self { lines: Mutex::default(), task }
    }

    fn into_lines(self) -> Vec<String> {
        self.lines.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Task for Notes<'_> {
    fn note(&self, line: &str) {
        let mut lines = self.lines.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        lines.push(line.to_owned());
    }

    fn is_cancelled(&self) -> bool {
        self.task.is_cancelled()
    }

    fn check(&self) -> Result<(), Cancelled> {
        self.task.check()
    }
}
