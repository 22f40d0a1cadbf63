//! Tells scene documents from other files by their content: a JSON object with the field
//! `esker_scene`. A file that does not begin with `{` is a scan; the rest of it is not read.

use crate::limits::{BOM, BYTES_MAX};
use serde::de::{Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::io::{self, BufRead, BufReader, Read};

/// What a text is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Found {
    /// A scene document; its version as it stands there. The rest may be damaged.
    Scene(String),
    /// It begins as a JSON object, without the field of scene documents as far as it is JSON.
    OtherObject,
    /// Anything else.
    Other,
}

/// Tells what a text is. Reads at most [`BYTES_MAX`] bytes, and of texts that do not begin with a
/// brace only the blanks before the first other character.
///
/// # Errors
/// If the text cannot be read.
pub fn detect(text: impl Read) -> io::Result<Found> {
    let mut text = BufReader::new(text.take(BYTES_MAX));
    let start = text.fill_buf()?;
    if start.starts_with(BOM.as_bytes()) {
        text.consume(BOM.len());
    }
    loop {
        let bytes = text.fill_buf()?;
        let blanks = bytes.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        match bytes.get(blanks) {
            Some(b'{') => break,
            Some(_) => return Ok(Found::Other),
            None if bytes.is_empty() => return Ok(Found::Other),
            None => text.consume(blanks),
        }
    }
    let mut version = None;
    let mut json = serde_json::Deserializer::from_reader(text);
    let result = json.deserialize_map(Seek(&mut version));
    match (version, result) {
        (Some(version), _) => Ok(Found::Scene(version)),
        (None, Err(error)) if error.is_io() => Err(error.into()),
        (None, _) => Ok(Found::OtherObject),
    }
}

/// Looks for the version among the fields of an object, and stops there.
struct Seek<'a>(&'a mut Option<String>);

impl<'de> Visitor<'de> for Seek<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            if key == "esker_scene" {
                // The field is there, whatever follows it.
                *self.0 = Some("?".into());
                *self.0 = Some(map.next_value::<Shown>()?.0);
                return Ok(());
            }
            map.next_value::<IgnoredAny>()?;
        }
        Ok(())
    }
}

/// A value as text, without keeping lists and objects.
struct Shown(String);

impl<'de> Deserialize<'de> for Shown {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ShownVisitor)
    }
}

struct ShownVisitor;

impl<'de> Visitor<'de> for ShownVisitor {
    type Value = Shown;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Shown, E> {
        Ok(Shown(value.to_string()))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Shown, E> {
        Ok(Shown(value.to_string()))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Shown, E> {
        Ok(Shown(value.to_string()))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Shown, E> {
        Ok(Shown(format!("{value:?}")))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Shown, E> {
        Ok(Shown(format!("{:?}", value.chars().take(40).collect::<String>())))
    }

    fn visit_unit<E: Error>(self) -> Result<Shown, E> {
        Ok(Shown("null".into()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Shown, A::Error> {
        IgnoredAny.visit_seq(seq).map(|_| Shown("[...]".into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Shown, A::Error> {
        IgnoredAny.visit_map(map).map(|_| Shown("{...}".into()))
    }
}
