//! Pictures of what is seen, as PNG files: asked for, taken from the next whole picture, written by
//! a thread of their own. The whole window can be had, too.

use anyhow::Result;
use eframe::egui::{Color32, ColorImage, Context, ScreenshotCallback, ViewportCommand};
use esker_engine::Picture;
use esker_engine::io::picture;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Pictures that are written at once at most.
const WRITING_MAX: usize = 4;
/// Failures that are kept.
const FAILURES_MAX: usize = 16;
/// Numbers of pictures beside one another at most.
const NUMBERS: u32 = 9999;

/// What was done last, or could not be.
pub type Said = Result<String, String>;

/// Where a picture of the window is left once it was taken.
type Taken = Arc<Mutex<Option<Arc<ColorImage>>>>;

/// Pictures asked for and being written. Dropping it waits until they are written.
#[derive(Default)]
pub struct Shots {
    asked: Option<PathBuf>,
    /// Where the window goes, and the picture of it once there is one.
    window: Option<(PathBuf, Taken)>,
    writing: Vec<JoinHandle<()>>,
    told: Arc<Mutex<Vec<Result<String, String>>>>,
    said: Option<Said>,
    failures: Vec<String>,
    failed: u64,
}

impl Shots {
    /// Asks for a picture at this path, or under a free name made from that of the file.
    pub fn ask(&mut self, path: Option<&Path>, name: &str) {
        self.asked = path.map(Path::to_owned).or_else(|| free_name(name));
        if self.asked.is_none() {
            self.fails(format!("{name}-*.png: {NUMBERS} pictures are there; remove some"));
        }
    }

    /// Asks for a picture of the whole window.
    pub fn ask_window(&mut self, ctx: &Context, path: PathBuf) {
        let place = Arc::new(Mutex::new(None));
        let taken = Arc::clone(&place);
        let callback = ScreenshotCallback::new(move |image| {
            *taken.lock().unwrap_or_else(PoisonError::into_inner) = Some(image);
        });
        ctx.send_viewport_cmd(ViewportCommand::Screenshot(callback));
        self.window = Some((path, place));
    }

    /// Whether a picture is asked for or being written.
    pub fn is_busy(&self) -> bool {
        let is_writing = self.writing.iter().any(|thread| !thread.is_finished());
        self.asked.is_some() || self.window.is_some() || is_writing
    }

    /// Whether a picture is asked for.
    pub fn wants(&self) -> bool {
        self.asked.is_some()
    }

    /// Takes a picture, where one is asked for.
    pub fn take(&mut self, picture: Result<Picture>) {
        match (self.asked.take(), picture) {
            (Some(path), Ok(picture)) => self.write(picture, path),
            (Some(path), Err(error)) => {
                self.failed += 1;
                self.fails(format!("{}: no picture: {error:#}", path.display()));
            }
            (None, _) => {}
        }
    }

    fn write(&mut self, picture: Picture, path: PathBuf) {
        self.writing.retain(|thread| !thread.is_finished());
        if self.writing.len() >= WRITING_MAX {
            self.said = Some(Err("the last pictures are still being written".into()));
            return;
        }
        let told = Arc::clone(&self.told);
        let shown = path.display().to_string();
        let write = move || {
            let line = match picture::write_png(&picture, &path) {
                Ok(()) => Ok(format!("picture: {}", full(&path).display())),
                Err(error) => Err(format!("no picture: {error:#}")),
            };
            told.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        };
        match std::thread::Builder::new().name("esker-picture".into()).spawn(write) {
            Ok(thread) => self.writing.push(thread),
            Err(error) => {
                self.failed += 1;
                self.fails(format!("{shown}: no thread to write it: {error}"));
            }
        }
    }

    /// What was done last, or could not be.
    pub fn said(&self) -> Option<&Said> {
        self.said.as_ref()
    }

    /// What could not be done, the first ones.
    pub fn failures(&self) -> &[String] {
        &self.failures
    }

    fn fails(&mut self, line: String) {
        if self.failures.len() < FAILURES_MAX {
            self.failures.push(line.clone());
        }
        self.said = Some(Err(line));
    }

    /// Looks whether the window was taken, and what the writers tell.
    pub fn poll(&mut self) {
        let taken =
            |place: &Mutex<Option<_>>| place.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some((path, image)) = self.window.take() {
            match taken(&image) {
                Some(image) => self.write(picture_of(&image), path),
                None => self.window = Some((path, image)),
            }
        }
        let told = std::mem::take(&mut *self.told.lock().unwrap_or_else(PoisonError::into_inner));
        for line in told {
            match line {
                Ok(line) => self.said = Some(Ok(line)),
                Err(line) => {
                    self.failed += 1;
                    self.fails(line);
                }
            }
        }
    }

    /// Waits until all are written; how many could not be.
    pub fn finish(&mut self) -> u64 {
        for thread in self.writing.drain(..) {
            // A thread that panicked has said so itself.
            self.failed += u64::from(thread.join().is_err());
        }
        self.poll();
        self.failed
    }
}

impl Drop for Shots {
    fn drop(&mut self) {
        self.finish();
    }
}

fn picture_of(image: &ColorImage) -> Picture {
    let [width, height] = image.size.map(|side| side as u32);
    let rgba = image.pixels.iter().flat_map(Color32::to_array).collect();
    Picture { width, height, rgba, ..Picture::default() }
}

fn full(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// The first name beside the current folder's pictures that is free.
fn free_name(name: &str) -> Option<PathBuf> {
    let stem = Path::new(name).file_stem().map_or("scan".into(), |s| s.to_string_lossy());
    (1..=NUMBERS).map(|i| PathBuf::from(format!("{stem}-{i:04}.png"))).find(|p| !p.exists())
}
