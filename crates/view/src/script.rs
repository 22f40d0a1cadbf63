//! Scripts that control the window, read from JSON: steps of keys, drags, wheel and clicks,
//! pictures to write, and a flight that is repeated until the scene is resident. `README.md` of
//! this crate describes the format for users.

use crate::commands::Command;
use anyhow::{Context, Result, ensure};
use eframe::egui::{Key, PointerButton};
use serde::Deserialize;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes of a script at most.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Steps of a list at most.
const STEPS_MAX: usize = 1000;
/// Seconds of a step at most.
const SECONDS_MAX: f64 = 3600.0;
/// Largest `flights_max` of a script.
pub const FLIGHTS_MAX: u32 = 20;

/// A script.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// Steps that are played first, once.
    #[serde(default)]
    pub before: Vec<Step>,
    /// Steps that are repeated from the same pose until a repetition reads nothing; their frames
    /// are timed.
    #[serde(default)]
    pub flight: Vec<Step>,
    /// Repetitions of the flight at most.
    #[serde(default = "flights_max")]
    pub flights_max: u32,
    /// Steps that are played last, once.
    #[serde(default)]
    pub after: Vec<Step>,
    /// File of the report; standard output by default.
    #[serde(default)]
    pub report: Option<PathBuf>,
    /// Whether the file is first removed from the system's cache, so that it is read from the disk.
    #[serde(default)]
    pub cold: bool,
    /// Whether the steps begin with the preview of a scan that is being built, not with all of it.
    #[serde(default)]
    pub preview: bool,
    /// Whether pictures are coarser while the camera moves.
    #[serde(default)]
    pub coarser_moving: bool,
}

/// A step of a script. Positions are fractions of the picture's width and height, from its top left
/// corner.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Step {
    /// Holds keys.
    Hold {
        /// Names of the keys, such as `W` or `ArrowUp`.
        keys: Vec<String>,
        /// Duration.
        seconds: f64,
    },
    /// Presses a key once.
    Press {
        /// Name of the key.
        key: String,
    },
    /// Drags with a mouse button.
    Drag {
        /// The button.
        #[serde(default)]
        button: Button,
        /// Position at which the button is pressed.
        from: [f64; 2],
        /// Position at which the button is released.
        to: [f64; 2],
        /// Whether Ctrl (Command on a Mac) is held.
        #[serde(default)]
        command: bool,
        /// Duration.
        seconds: f64,
    },
    /// Moves the pointer, without a button.
    Point {
        /// Position at the start.
        from: [f64; 2],
        /// Position at the end.
        to: [f64; 2],
        /// Duration.
        seconds: f64,
    },
    /// Turns the wheel.
    Wheel {
        /// Position of the pointer.
        at: [f64; 2],
        /// Points to scroll by; positive zooms in.
        points: f64,
        /// Duration.
        seconds: f64,
    },
    /// Clicks once.
    Click {
        /// Position of the pointer.
        at: [f64; 2],
    },
    /// Clicks twice.
    DoubleClick {
        /// Position of the pointer.
        at: [f64; 2],
    },
    /// Brings a widget into view and clicks its middle.
    Widget {
        /// Its accessible name.
        name: String,
        /// Longest time to wait for it.
        #[serde(default = "ten")]
        seconds: f64,
    },
    /// Types a text into the widget that has the focus.
    Type {
        /// The text.
        text: String,
    },
    /// Follows a camera path (`bench/README.md`) by keys, mouse and wheel.
    Path {
        /// File of the path; by default one is derived from the scan.
        #[serde(default)]
        file: Option<PathBuf>,
        /// Factor of the path's own speed.
        #[serde(default = "one")]
        faster: f64,
    },
    /// Does nothing.
    Wait {
        /// Duration.
        seconds: f64,
    },
    /// Waits until the view is complete.
    Settle {
        /// Longest wait.
        seconds: f64,
    },
    /// Writes the picture of the scene.
    Picture {
        /// PNG file to write.
        path: PathBuf,
    },
    /// Writes the whole window.
    Window {
        /// PNG file to write.
        path: PathBuf,
    },
    /// Gives a command.
    Command {
        /// Its identifier, such as `fit` ([`crate::commands::COMMANDS`]).
        id: String,
    },
    /// Closes the window at once.
    Close,
}

/// A mouse button.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Button {
    /// Orbits.
    #[default]
    Left,
    /// Looks around.
    Middle,
    /// Moves sideways.
    Right,
}

impl From<Button> for PointerButton {
    fn from(button: Button) -> Self {
        match button {
            Button::Left => Self::Primary,
            Button::Middle => Self::Middle,
            Button::Right => Self::Secondary,
        }
    }
}

fn flights_max() -> u32 {
    5
}

fn ten() -> f64 {
    10.0
}

fn one() -> f64 {
    1.0
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// If the file cannot be read or is no valid script.
    pub fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let mut text = String::new();
        std::fs::File::open(path)
            .and_then(|f| f.take(FILE_BYTES_MAX).read_to_string(&mut text))
            .with_context(|| format!("{shown}: cannot read the script"))?;
        Self::parse(&text).with_context(|| format!("{shown}: not a valid script"))
    }

    /// Parses the text of a script.
    ///
    /// # Errors
    /// If the text is no valid script.
    pub fn parse(text: &str) -> Result<Self> {
        let script: Self = serde_json::from_str(text).context("see crates/view/README.md")?;
        ensure!(
            (1..=FLIGHTS_MAX).contains(&script.flights_max),
            "`flights_max` must be 1 to {FLIGHTS_MAX}"
        );
        for steps in [&script.before, &script.flight, &script.after] {
            ensure!(steps.len() <= STEPS_MAX, "a list has {STEPS_MAX} steps at most");
            steps.iter().try_for_each(Step::check)?;
        }
        Ok(script)
    }
}

impl Step {
    fn check(&self) -> Result<()> {
        let (seconds, positions): (f64, &[[f64; 2]]) = match self {
            Self::Hold { keys, seconds } => {
                keys.iter().try_for_each(|name| key(name).map(drop))?;
                (*seconds, &[])
            }
            Self::Press { key: name } => (key(name).map(|_| 0.0)?, &[]),
            Self::Drag { from, to, seconds, .. } | Self::Point { from, to, seconds } => {
                (*seconds, &[*from, *to])
            }
            Self::Wheel { at, points, seconds } => {
                ensure!(points.is_finite(), "the `points` of a wheel must be a finite number");
                (*seconds, &[*at])
            }
            Self::Click { at } | Self::DoubleClick { at } => (0.0, &[*at]),
            Self::Wait { seconds } | Self::Settle { seconds } | Self::Widget { seconds, .. } => {
                (*seconds, &[])
            }
            Self::Path { faster, .. } => {
                ensure!((0.01..=100.0).contains(faster), "`faster` must be 0.01 to 100");
                (0.0, &[])
            }
            Self::Picture { .. } | Self::Window { .. } | Self::Type { .. } | Self::Close => {
                (0.0, &[])
            }
            Self::Command { id } => {
                let known = Command::of(id).map(|_| 0.0);
                (known.with_context(|| format!("`{id}` is no command of the window"))?, &[])
            }
        };
        ensure!(
            (0.0..=SECONDS_MAX).contains(&seconds),
            "`seconds` must be 0 to {SECONDS_MAX}, not {seconds}"
        );
        let within = |p: &[f64; 2]| p.iter().all(|v| (0.0..=1.0).contains(v));
        ensure!(positions.iter().all(within), "positions must be fractions of the picture, 0 to 1");
        Ok(())
    }
}

/// Finds a key by its name.
///
/// # Errors
/// If there is no key of that name.
pub fn key(name: &str) -> Result<Key> {
    Key::from_name(name).with_context(|| format!("there is no key `{name}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_valid_script_is_parsed_and_others_are_refused() {
        let script = Script::parse(
            r#"{"before": [{"do": "settle", "seconds": 5}],
                "flight": [{"do": "hold", "keys": ["W", "D"], "seconds": 1},
                           {"do": "drag", "from": [0.5, 0.5], "to": [0.6, 0.5], "seconds": 0.5, "button": "right"},
                           {"do": "wheel", "at": [0.5, 0.5], "points": 200, "seconds": 0.2},
                           {"do": "path"}],
                "after": [{"do": "picture", "path": "a.png"}, {"do": "close"}], "cold": true}"#,
        )
        .unwrap();
        assert_eq!((script.flight.len(), script.flights_max, script.cold), (4, 5, true));
        for text in [
            "",
            "7",
            r#"{"flight": [{"do": "fly"}]}"#,
            r#"{"flight": [{"do": "wait", "seconds": -1}]}"#,
            r#"{"flight": [{"do": "wait", "seconds": 1e9}]}"#,
            r#"{"flight": [{"do": "press", "key": "no such key"}]}"#,
            r#"{"flight": [{"do": "double_click", "at": [0.5, 1.5]}]}"#,
            r#"{"flight": [{"do": "path", "faster": 0}]}"#,
            r#"{"flights_max": 0}"#,
            r#"{"speed": 2}"#,
        ] {
            assert!(Script::parse(text).is_err(), "{text}");
        }
    }
}
