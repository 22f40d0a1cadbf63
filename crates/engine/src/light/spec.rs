//! Lights from the command line: `sun:AZ,EL`, `sky`, `lamp:X,Y,Z` and the like, or the name of a
//! document. An error says what is wrong and shows the form.

use crate::light::check_built;
#[cfg(feature = "light")]
use crate::light::lights::parse as lights_of;
use crate::light::settings::Lights;
use anyhow::Result;

/// Lights that one argument of the command line names. Several are separated by `|` or blanks.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSpec(pub Lights);

impl std::str::FromStr for LightSpec {
    type Err = String;

    /// [`parse`] for command lines: an error has its causes in one line.
    fn from_str(text: &str) -> Result<Self, String> {
        parse(text).map(Self).map_err(|e| format!("{e:#}"))
    }
}

/// Parses lights, and reads the documents and pictures that are named.
///
/// # Errors
/// If a light is unknown or incomplete, a number is invalid, a file cannot be read, or this program
/// was built without light.
pub fn parse(text: &str) -> Result<Lights> {
    check_built()?;
    lights_of(text)
}

#[cfg(not(feature = "light"))]
fn lights_of(_: &str) -> Result<Lights> {
    Ok(Lights)
}

/// The lights of several arguments together; `None` without an argument.
pub fn joined(specs: Vec<LightSpec>) -> Option<Lights> {
    specs.into_iter().map(|spec| spec.0).reduce(together)
}

#[cfg(feature = "light")]
fn together(lights: Lights, more: Lights) -> Lights {
    lights.with(more)
}

#[cfg(not(feature = "light"))]
fn together(lights: Lights, _: Lights) -> Lights {
    lights
}
