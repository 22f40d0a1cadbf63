//! Pictures of the scene or of the whole window as PNG files: they are requested, taken from the
//! next complete picture, and written by threads.

use crate::fault;
use anyhow::Result;
use eframe::egui::{Color32, ColorImage, Context, ScreenshotCallback, ViewportCommand};
use esker_engine::Picture;
use esker_engine::io::picture;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pictures that are written at the same time at most.
const WRITING_MAX: usize = 4;
/// How long it is shown that a picture was written.
const MESSAGE: Duration = Duration::from_secs(10);
/// Failures that are kept at most.
const FAILURES_MAX: usize = 16;
/// Largest number in the name of a picture.
const NUMBER_MAX: u32 = 9999;

/// Outcome of the last file that was written, in words.
pub type Message = Result<String, String>;

/// Where egui leaves the picture of the window.
type SharedScreenshot = Arc<Mutex<Option<Arc<ColorImage>>>>;

/// Pictures that are requested or being written. Dropping it waits until they are written.
#[derive(Default)]
pub struct Shots {
    requested: Option<PathBuf>,
    /// File for a picture of the window, and the picture once there is one.
    window: Option<(PathBuf, SharedScreenshot)>,
    writing: Vec<JoinHandle<()>>,
    outcomes: Arc<Mutex<Vec<Result<String, String>>>>,
    /// The last outcome, and when it came.
    message: Option<(Message, Instant)>,
    failures: Vec<String>,
    failed: u64,
}

impl Shots {
    /// Requests a picture at `path`, or under a free name made from `name`, that of the scan.
    pub fn request(&mut self, path: Option<&Path>, name: &str) {
        self.message = None;
        self.requested = path.map(Path::to_owned).or_else(|| free_name(name));
        if self.requested.is_none() {
            self.add_failure(format!(
                "{name}-*.png: {NUMBER_MAX} pictures exist already; remove some"
            ));
        }
    }

    /// Requests a picture of the whole window.
    pub fn request_window(&mut self, ctx: &Context, path: PathBuf) {
        let image = Arc::new(Mutex::new(None));
        let shared = Arc::clone(&image);
        let callback = ScreenshotCallback::new(move |taken| {
            *shared.lock().unwrap_or_else(PoisonError::into_inner) = Some(taken);
        });
        ctx.send_viewport_cmd(ViewportCommand::Screenshot(callback));
        self.window = Some((path, image));
    }

    /// Whether a picture is requested or being written.
    pub fn is_busy(&self) -> bool {
        let is_writing = self.writing.iter().any(|thread| !thread.is_finished());
        self.requested.is_some() || self.window.is_some() || is_writing
    }

    /// Whether a picture of the scene is requested.
    pub fn is_requested(&self) -> bool {
        self.requested.is_some()
    }

    /// Takes the picture that was requested, if there was a request.
    pub fn take(&mut self, picture: Result<Picture>) {
        match (self.requested.take(), picture) {
            (Some(path), Ok(picture)) => self.write(picture, path),
            (Some(path), Err(error)) => {
                self.failed += 1;
                self.add_failure(format!("{}: cannot draw the picture: {error:#}", path.display()));
            }
            (None, _) => {}
        }
    }

    fn write(&mut self, picture: Picture, path: PathBuf) {
        self.writing.retain(|thread| !thread.is_finished());
        if self.writing.len() >= WRITING_MAX {
            self.say(Err(
                "not written, because earlier pictures are still being written; try again".into(),
            ));
            return;
        }
        let outcomes = Arc::clone(&self.outcomes);
        let name = path.display().to_string();
        let write = move || {
            let line = match picture::write_png(&picture, &path) {
                Ok(()) => Ok(format!("picture: {}", full(&path).display())),
                Err(error) => Err(fault::in_words(&format!("{error:#}"))),
            };
            outcomes.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        };
        match std::thread::Builder::new().name("esker-picture".into()).spawn(write) {
            Ok(thread) => self.writing.push(thread),
            Err(error) => {
                self.failed += 1;
                self.add_failure(format!(
                    "{name}: cannot start a thread to write the picture: {error}"
                ));
            }
        }
    }

    /// Outcome of the last picture, in words.
    pub fn message(&self) -> Option<&Message> {
        let (message, since) = self.message.as_ref()?;
        (message.is_err() || since.elapsed() < MESSAGE).then_some(message)
    }

    /// How long the last outcome is still shown, if that is not for ever: failures are.
    pub fn message_left(&self) -> Option<Duration> {
        let (message, since) = self.message.as_ref()?;
        let left = MESSAGE.checked_sub(since.elapsed());
        left.filter(|left| message.is_ok() && !left.is_zero())
    }

    /// Shows a message, such as the outcome of another file that was written.
    pub fn say(&mut self, message: Message) {
        self.message = Some((message, Instant::now()));
    }

    /// The first failures.
    pub fn failures(&self) -> &[String] {
        &self.failures
    }

    /// Shows a failure, and keeps it for the report.
    pub fn add_failure(&mut self, line: String) {
        if self.failures.len() < FAILURES_MAX {
            self.failures.push(line.clone());
        }
        self.say(Err(line));
    }

    /// Checks whether the picture of the window has arrived, and collects the outcomes of the
    /// threads.
    pub fn poll(&mut self) {
        let take =
            |image: &Mutex<Option<_>>| image.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some((path, image)) = self.window.take() {
            match take(&image) {
                Some(image) => self.write(picture_of(&image), path),
                None => self.window = Some((path, image)),
            }
        }
        let outcomes =
            std::mem::take(&mut *self.outcomes.lock().unwrap_or_else(PoisonError::into_inner));
        for line in outcomes {
            match line {
                Ok(line) => self.say(Ok(line)),
                Err(line) => {
                    self.failed += 1;
                    self.add_failure(line);
                }
            }
        }
    }

    /// Waits until all pictures are written. Returns the number of failures.
    pub fn finish(&mut self) -> u64 {
        for thread in self.writing.drain(..) {
            // A panic was already reported by the thread.
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

/// First name that is free in the current folder.
fn free_name(name: &str) -> Option<PathBuf> {
    let stem = Path::new(name).file_stem().map_or("scan".into(), |s| s.to_string_lossy());
    (1..=NUMBER_MAX).map(|i| PathBuf::from(format!("{stem}-{i:04}.png"))).find(|p| !p.exists())
}
