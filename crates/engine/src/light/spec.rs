//! Lights from the command line: `sun:AZ,EL`, `sky`, `lamp:X,Y,Z` and the like, or the name of a
//! document. An error says what is wrong and shows the form.

use crate::light::document::{Light, LightDocument, SUN_DIAMETER_DEG};
use anyhow::{Context, Result, bail, ensure};
use std::path::{Path, PathBuf};

/// Forms of lights, for errors.
const FORMS: &str = "sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]], sky[:STRENGTH], \
                     sky:PICTURE.png[,STRENGTH], lamp:X,Y,Z[,POWER] or LIGHTS.json";
const SUN: &str = "sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]], such as sun:225,40";
const SKY: &str = "sky[:STRENGTH] or sky:PICTURE.png[,STRENGTH], such as sky:0.5";
const LAMP: &str = "lamp:X,Y,Z[,POWER], such as lamp:10.5,3,2.2";

/// Lights that one word of the command line asks for. Several may stand in one argument, separated
/// by `|` or blanks.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSpec(pub Vec<Light>);

impl std::str::FromStr for LightSpec {
    type Err = String;

    /// [`parse`] for command lines: an error has its causes in one line.
    fn from_str(text: &str) -> Result<Self, String> {
        parse(text).map(Self).map_err(|e| format!("{e:#}"))
    }
}

/// Parses lights, and reads the documents that are named.
///
/// # Errors
/// If a light is unknown or incomplete, a number is invalid, or a document cannot be read.
pub fn parse(text: &str) -> Result<Vec<Light>> {
    let is_file = |text: &str| Path::new(text).extension().is_some_and(|e| e == "json");
    if is_file(text) {
        return Ok(LightDocument::read(Path::new(text))?.lights);
    }
    let mut lights = Vec::new();
    for word in text.split(['|', ' ']).filter(|word| !word.is_empty()) {
        match is_file(word) {
            true => lights.extend(LightDocument::read(Path::new(word))?.lights),
            false => lights.push(light(word).with_context(|| format!("light `{word}`"))?),
        }
    }
    ensure!(!lights.is_empty(), "no light is named: {FORMS}");
    Ok(lights)
}

fn light(word: &str) -> Result<Light> {
    let (kind, values) = word.split_once(':').unwrap_or((word, ""));
    let light = match kind {
        "sun" => sun(values).context(SUN)?,
        "sky" => sky(values).context(SKY)?,
        "lamp" => lamp(values).context(LAMP)?,
        _ => bail!("is none of {FORMS}"),
    };
    light.check()?;
    Ok(light)
}

fn sun(values: &str) -> Result<Light> {
    let values = numbers(values)?;
    let (&[azimuth, elevation], rest) =
        values.split_first_chunk().context("azimuth and elevation are missing")?;
    ensure!(rest.len() <= 2, "there are {} numbers, at most 4 have a meaning", values.len());
    let strength = rest.first().copied().unwrap_or(1.0);
    let diameter = rest.get(1).copied().unwrap_or(SUN_DIAMETER_DEG);
    Ok(Light::Sun { azimuth, elevation, strength, diameter, colour: [1.0; 3] })
}

fn sky(values: &str) -> Result<Light> {
    let (picture, values) = match values.split_once(',') {
        _ if values.ends_with(".png") => (Some(PathBuf::from(values)), ""),
        Some((name, values)) if name.ends_with(".png") => (Some(PathBuf::from(name)), values),
        _ => (None, values),
    };
    let values = numbers(values)?;
    ensure!(values.len() <= 1, "there are {} numbers, one has a meaning", values.len());
    let wanted = values.first().copied().unwrap_or(1.0);
    let mut light = Light::sky();
    if let Light::Sky { strength, image, .. } = &mut light {
        (*strength, *image) = (wanted, picture);
    }
    Ok(light)
}

fn lamp(values: &str) -> Result<Light> {
    let values = numbers(values)?;
    let (&at, rest) = values.split_first_chunk().context("x, y and z are missing")?;
    ensure!(rest.len() <= 1, "there are {} numbers, at most 4 have a meaning", values.len());
    Ok(Light::Lamp { at, power: rest.first().copied(), colour: [1.0; 3] })
}

fn numbers(text: &str) -> Result<Vec<f64>> {
    if text.is_empty() {
        return Ok(Vec::new());
    }
    let number = |word: &str| {
        let value = word.trim().parse::<f64>().ok().filter(|value| value.is_finite());
        value.with_context(|| format!("`{word}` is no number"))
    };
    text.split(',').map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_parsed() {
        let [sun, sky] = [Light::sun(225.0, 40.0), Light::sky()];
        assert_eq!(parse("sun:225,40").unwrap(), [sun.clone()]);
        assert_eq!(parse("sun:225,40|sky").unwrap(), [sun.clone(), sky.clone()]);
        assert_eq!(parse("sky sun:225,40").unwrap(), [sky, sun]);
        let lamp = Light::Lamp { at: [1.0, -2.5, 3e6], power: Some(7.0), colour: [1.0; 3] };
        assert_eq!(parse("lamp:1,-2.5,3e6,7").unwrap(), [lamp]);
        let image = Some(PathBuf::from("a.png"));
        assert!(matches!(
            &parse("sky:a.png,0.5").unwrap()[..],
            [Light::Sky { strength: 0.5, image: found, .. }] if *found == image
        ));
    }

    #[test]
    fn an_error_shows_the_form() {
        for (text, says) in [
            ("", "no light is named: sun:"),
            ("moon:1,2", "light `moon:1,2`: is none of sun:AZIMUTH"),
            ("sun", "sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]], such as sun:225,40: azimuth and"),
            ("sun:1,2,3,4,5", "there are 5 numbers"),
            ("sun:a,2", "`a` is no number"),
            ("sun:10,100", "`elevation` is 100, it must be within -90 and 90"),
            ("sky:1,2", "sky[:STRENGTH]"),
            ("sky:-1", "`strength` is -1"),
            ("lamp:1,2", "lamp:X,Y,Z[,POWER]"),
            ("lamp:1,2,nan", "`nan` is no number"),
            ("missing.json", "missing.json: cannot read the lights"),
        ] {
            let fault = format!("{:#}", parse(text).unwrap_err());
            assert!(fault.contains(says), "{text}: {fault}");
        }
    }
}
