//! What is done in place of a hand, as a JSON file says: steps of keys, drags, wheel and clicks,
//! pictures at given places, a flight that is repeated until all of it is resident. `README.md`
//! beside this crate has the format for people.

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
/// Flights at most.
pub const FLIGHTS_MAX: u32 = 20;

/// A script.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Script {
    /// Done first, once.
    #[serde(default)]
    pub before: Vec<Step>,
    /// Done at least once and then, from the same pose, until a flight reads nothing: its frames
    /// are timed.
    #[serde(default)]
    pub flight: Vec<Step>,
    /// Flights at most.
    #[serde(default = "flights_max")]
    pub flights_max: u32,
    /// Done last, once.
    #[serde(default)]
    pub after: Vec<Step>,
    /// Where the report goes; standard output where not said.
    #[serde(default)]
    pub report: Option<PathBuf>,
    /// Whether the system forgets the file first, so that it is read from the disk.
    #[serde(default)]
    pub cold: bool,
    /// Whether pictures are coarser while the camera moves.
    #[serde(default)]
    pub coarser_moving: bool,
}

/// Something that a hand does, or that is looked at. Places are shares of the picture from its top
/// left corner.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Step {
    /// Holds keys down.
    Hold {
        /// Their names, such as `W`, `ArrowUp`.
        keys: Vec<String>,
        /// How long.
        seconds: f64,
    },
    /// Presses a key once.
    Press {
        /// Its name.
        key: String,
    },
    /// Drags with a button.
    Drag {
        /// The button.
        #[serde(default)]
        button: Button,
        /// From here.
        from: [f64; 2],
        /// To here.
        to: [f64; 2],
        /// In so much time.
        seconds: f64,
    },
    /// Turns the wheel.
    Wheel {
        /// The pointer.
        at: [f64; 2],
        /// Points of scrolling; above zero towards what is seen.
        points: f64,
        /// In so much time.
        seconds: f64,
    },
    /// Clicks once.
    Click {
        /// The pointer.
        at: [f64; 2],
    },
    /// Clicks twice.
    DoubleClick {
        /// The pointer.
        at: [f64; 2],
    },
    /// Follows a camera path (`bench/README.md`) by keys, mouse and wheel.
    Path {
        /// The path's file; where not said, one is made from the scan.
        #[serde(default)]
        file: Option<PathBuf>,
        /// How much faster than the path says.
        #[serde(default = "one")]
        faster: f64,
    },
    /// Does nothing.
    Wait {
        /// So long.
        seconds: f64,
    },
    /// Does nothing until nothing more comes for the view.
    Settle {
        /// At most so long.
        seconds: f64,
    },
    /// Writes the picture.
    Picture {
        /// Where.
        path: PathBuf,
    },
    /// Writes the whole window.
    Window {
        /// Where.
        path: PathBuf,
    },
    /// Closes the window, whatever it is doing.
    Close,
}

/// A button of the mouse.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Button {
    /// Orbits.
    #[default]
    Left,
    /// Moves sideways.
    Middle,
    /// Looks around.
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

fn one() -> f64 {
    1.0
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// Where the file cannot be read or is no script.
    pub fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let mut text = String::new();
        std::fs::File::open(path)
            .and_then(|f| f.take(FILE_BYTES_MAX).read_to_string(&mut text))
            .with_context(|| format!("{shown}: cannot read the script"))?;
        Self::parse(&text).with_context(|| format!("{shown}: no script"))
    }

    /// As [`Script::read`], from text.
    ///
    /// # Errors
    /// As [`Script::read`].
    pub fn parse(text: &str) -> Result<Self> {
        let script: Self = serde_json::from_str(text).context("see crates/view/README.md")?;
        ensure!((1..=FLIGHTS_MAX).contains(&script.flights_max), "1 to {FLIGHTS_MAX} flights");
        for steps in [&script.before, &script.flight, &script.after] {
            ensure!(steps.len() <= STEPS_MAX, "{STEPS_MAX} steps at most");
            steps.iter().try_for_each(Step::check)?;
        }
        Ok(script)
    }
}

impl Step {
    fn check(&self) -> Result<()> {
        let (seconds, places): (f64, &[[f64; 2]]) = match self {
            Self::Hold { keys, seconds } => {
                keys.iter().try_for_each(|name| key(name).map(drop))?;
                (*seconds, &[])
            }
            Self::Press { key: name } => (key(name).map(|_| 0.0)?, &[]),
            Self::Drag { from, to, seconds, .. } => (*seconds, &[*from, *to]),
            Self::Wheel { at, points, seconds } => {
                ensure!(points.is_finite(), "the wheel turns by no number");
                (*seconds, &[*at])
            }
            Self::Click { at } | Self::DoubleClick { at } => (0.0, &[*at]),
            Self::Wait { seconds } | Self::Settle { seconds } => (*seconds, &[]),
            Self::Path { faster, .. } => {
                ensure!(
                    (0.01..=100.0).contains(faster),
                    "a path is flown 0.01 to 100 times as fast"
                );
                (0.0, &[])
            }
            Self::Picture { .. } | Self::Window { .. } | Self::Close => (0.0, &[]),
        };
        ensure!((0.0..=SECONDS_MAX).contains(&seconds), "{seconds} s are out of range");
        let within = |p: &[f64; 2]| p.iter().all(|v| (0.0..=1.0).contains(v));
        ensure!(places.iter().all(within), "places are shares of the picture, 0 to 1");
        Ok(())
    }
}

/// A key by its name.
///
/// # Errors
/// Where there is none of that name.
pub fn key(name: &str) -> Result<Key> {
    Key::from_name(name).with_context(|| format!("there is no key `{name}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_is_read_and_nonsense_is_refused() {
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
