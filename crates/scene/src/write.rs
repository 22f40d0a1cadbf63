//! Writes documents for people: two blanks a level, a field a line, and lists of numbers or words
//! in one line.

use crate::document::Scene;
use crate::error::SceneError;
use crate::read::parse;
use serde::Serialize;
use serde_json::ser::{Formatter, Serializer};
use std::io::{self, Write};

impl Scene {
    /// The document as JSON text. Reading it gives the same document.
    ///
    /// # Errors
    /// If the document cannot be read back: a number is not finite, or a check fails.
    pub fn to_json(&self) -> Result<String, SceneError> {
        let mut text = Vec::new();
        let fault = |what: String| SceneError::of(".", what);
        self.serialize(&mut Serializer::with_formatter(&mut text, Lines::default()))
            .map_err(|error| fault(error.to_string()))?;
        let text = String::from_utf8(text).map_err(|error| fault(error.to_string()))?;
        // Strings have no line ends in JSON.
        let text = text.replace(", \n", ",\n") + "\n";
        // A number that is not finite is written as null.
        let is_same = parse(&text)? == *self;
        if is_same { Ok(text) } else { Err(fault("has a number that is not finite".into())) }
    }
}

/// Open lists and objects, the innermost last.
#[derive(Default)]
struct Lines(Vec<Level>);

/// An open list or object.
struct Level {
    is_list: bool,
    /// Whether its end stands in a line of its own.
    is_broken: bool,
}

impl Lines {
    fn new_line<W: ?Sized + Write>(&self, out: &mut W) -> io::Result<()> {
        out.write_all(b"\n")?;
        (0..self.0.len()).try_for_each(|_| out.write_all(b"  "))
    }

    /// Begins a list or an object; one in a list begins in a new line.
    fn begin<W: ?Sized + Write>(&mut self, out: &mut W, is_list: bool) -> io::Result<()> {
        if let Some(level) = self.0.last_mut().filter(|level| level.is_list) {
            level.is_broken = true;
            self.new_line(out)?;
        }
        self.0.push(Level { is_list, is_broken: false });
        out.write_all(if is_list { b"[" } else { b"{" })
    }

    fn end<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        let Some(level) = self.0.pop() else { return Ok(()) };
        if level.is_broken {
            self.new_line(out)?;
        }
        out.write_all(if level.is_list { b"]" } else { b"}" })
    }
}

impl Formatter for Lines {
    fn begin_array<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.begin(out, true)
    }

    fn end_array<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.end(out)
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        if first { Ok(()) } else { out.write_all(b", ") }
    }

    fn begin_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.begin(out, false)
    }

    fn end_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.end(out)
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        if let Some(level) = self.0.last_mut() {
            level.is_broken = true;
        }
        if !first {
            out.write_all(b",")?;
        }
        self.new_line(out)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        out.write_all(b": ")
    }
}
