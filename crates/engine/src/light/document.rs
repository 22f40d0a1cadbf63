//! Lights as plain data, in the coordinates of the scan: what `LIGHTS.json` holds, and what the
//! command line and the window make. The document names its version, and what it holds is checked
//! when it is read, so that what is traced has finite numbers.

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Version of the document.
pub const VERSION: u32 = 1;
/// Bytes of a document at most.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Most lights of a picture: each ray through a pixel sends rays to all of them.
pub const LIGHTS_MAX: usize = 64;
/// Greatest strength, power or component of a colour: far above any use, and finite when squared.
const VALUE_MAX: f64 = 1e12;
/// Angular diameter of the sun, degrees.
pub const SUN_DIAMETER_DEG: f64 = 0.53;

/// Lights of a scene, as a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightDocument {
    /// Version of the format, [`VERSION`].
    pub version: u32,
    /// The lights.
    pub lights: Vec<Light>,
}

/// A light. Colours are linear red, green and blue. A strength of 1 lights a white surface that
/// faces the light to white at an exposure of 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// The sun.
    Sun {
        /// Direction, degrees clockwise from north (the y axis).
        azimuth: f64,
        /// Angle above the horizon, degrees.
        elevation: f64,
        /// Factor of the light.
        #[serde(default = "one")]
        strength: f64,
        /// Angular diameter, degrees; 0 for sharp shadows.
        #[serde(default = "sun_diameter")]
        diameter: f64,
        /// Colour.
        #[serde(default = "white")]
        colour: [f64; 3],
    },
    /// The sky: light from all directions that nothing blocks.
    Sky {
        /// Factor of the light.
        #[serde(default = "one")]
        strength: f64,
        /// Radiance straight above.
        #[serde(default = "zenith")]
        zenith: [f64; 3],
        /// Radiance at the horizon.
        #[serde(default = "horizon")]
        horizon: [f64; 3],
        /// Radiance from below the horizon.
        #[serde(default = "ground")]
        ground: [f64; 3],
        /// Picture of all directions (equirectangular PNG, north in its middle) in place of these
        /// colours.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<PathBuf>,
    },
    /// A lamp, which lights in all directions.
    Lamp {
        /// Place.
        at: [f64; 3],
        /// Emitted power: a white surface that faces the lamp at distance `d` is lit as by a sun of
        /// strength `power / d^2`. Without it, as by a sun of strength 1 at a tenth of the diagonal
        /// of the scan.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<f64>,
        /// Colour.
        #[serde(default = "white")]
        colour: [f64; 3],
    },
    /// A lamp that lights a cone.
    Spot {
        /// Place.
        at: [f64; 3],
        /// Point on the axis of the cone.
        target: [f64; 3],
        /// Angle between the opposite sides of the cone, degrees.
        angle: f64,
        /// Power as of a lamp.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<f64>,
        /// Colour.
        #[serde(default = "white")]
        colour: [f64; 3],
    },
    /// A lit parallelogram, which lights both of its sides.
    Area {
        /// A corner.
        corner: [f64; 3],
        /// The two sides that leave the corner.
        sides: [[f64; 3]; 2],
        /// Emitted radiance, as seen; 1 is white at an exposure of 1.
        #[serde(default = "one")]
        strength: f64,
        /// Colour.
        #[serde(default = "white")]
        colour: [f64; 3],
    },
    /// Points that emit light: those in a box.
    Points {
        /// The box: least, then greatest coordinates.
        #[serde(rename = "box")]
        bounds: [[f64; 3]; 2],
        /// Emitted radiance, as seen; it is multiplied by the colours of the points.
        #[serde(default = "one")]
        strength: f64,
    },
}

fn one() -> f64 {
    1.0
}

fn sun_diameter() -> f64 {
    SUN_DIAMETER_DEG
}

fn white() -> [f64; 3] {
    [1.0; 3]
}

/// Radiance of the default sky: a clear sky gives a fifth of the light of the sun, and is bluer
/// towards the zenith.
pub fn zenith() -> [f64; 3] {
    [0.11, 0.17, 0.30]
}

/// Radiance of the default sky at the horizon.
pub fn horizon() -> [f64; 3] {
    [0.26, 0.30, 0.36]
}

/// Radiance of the default sky below the horizon: what the ground around a scan reflects.
pub fn ground() -> [f64; 3] {
    [0.10, 0.09, 0.08]
}

impl Light {
    /// The sun at a place in the sky, degrees.
    pub fn sun(azimuth: f64, elevation: f64) -> Self {
        Self::Sun { azimuth, elevation, strength: 1.0, diameter: SUN_DIAMETER_DEG, colour: white() }
    }

    /// The clear sky.
    pub fn sky() -> Self {
        Self::Sky {
            strength: 1.0,
            zenith: zenith(),
            horizon: horizon(),
            ground: ground(),
            image: None,
        }
    }

    /// Lights of pictures that name none: the sun in the south-west and the sky.
    pub fn defaults() -> Vec<Self> {
        vec![Self::sun(225.0, 40.0), Self::sky()]
    }

    /// Refuses numbers that cannot be traced.
    ///
    /// # Errors
    /// If a number is not finite, negative where only positive ones have a meaning, or too large.
    pub fn check(&self) -> Result<()> {
        let colour = |name: &str, values: &[f64; 3]| {
            values.iter().try_for_each(|&v| within(name, v, 0.0, VALUE_MAX))
        };
        let place = |name: &str, values: &[f64; 3]| {
            values.iter().try_for_each(|&v| within(name, v, -VALUE_MAX, VALUE_MAX))
        };
        let power = |power: &Option<f64>| {
            power.iter().try_for_each(|&power| within("power", power, 0.0, VALUE_MAX))
        };
        match self {
            Self::Sun { azimuth, elevation, strength, diameter, colour: own } => {
                within("azimuth", *azimuth, -360.0, 360.0)?;
                within("elevation", *elevation, -90.0, 90.0)?;
                within("strength", *strength, 0.0, VALUE_MAX)?;
                within("diameter", *diameter, 0.0, 90.0)?;
                colour("colour", own)
            }
            Self::Sky { strength, zenith, horizon, ground, image: _ } => {
                within("strength", *strength, 0.0, VALUE_MAX)?;
                colour("zenith", zenith)?;
                colour("horizon", horizon)?;
                colour("ground", ground)
            }
            Self::Lamp { at, power: own, colour: of } => {
                place("at", at)?;
                power(own)?;
                colour("colour", of)
            }
            Self::Spot { at, target, angle, power: own, colour: of } => {
                place("at", at)?;
                place("target", target)?;
                ensure!(at != target, "`at` and `target` are the same point");
                within("angle", *angle, 0.1, 179.0)?;
                power(own)?;
                colour("colour", of)
            }
            Self::Area { corner, sides: [a, b], strength, colour: own } => {
                place("corner", corner)?;
                place("sides", a)?;
                place("sides", b)?;
                let area = glam::DVec3::from_array(*a).cross((*b).into()).length();
                ensure!(area > 0.0, "the two `sides` are parallel, so that there is no area");
                within("strength", *strength, 0.0, VALUE_MAX)?;
                colour("colour", own)
            }
            Self::Points { bounds: [low, high], strength } => {
                place("box", low)?;
                place("box", high)?;
                ensure!((0..3).all(|i| low[i] <= high[i]), "the `box` has no inside");
                within("strength", *strength, 0.0, VALUE_MAX)
            }
        }
    }

    /// Name of the kind of light, as documents and reports have it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sun { .. } => "sun",
            Self::Sky { .. } => "sky",
            Self::Lamp { .. } => "lamp",
            Self::Spot { .. } => "spot",
            Self::Area { .. } => "area",
            Self::Points { .. } => "points",
        }
    }
}

fn within(name: &str, value: f64, least: f64, greatest: f64) -> Result<()> {
    ensure!(
        (least..=greatest).contains(&value),
        "`{name}` is {value}, it must be within {least} and {greatest}"
    );
    Ok(())
}

impl LightDocument {
    /// Reads a document. Paths of images are relative to its folder.
    ///
    /// # Errors
    /// If the file cannot be read, or is no valid document.
    pub fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let mut text = String::new();
        std::fs::File::open(path)
            .and_then(|file| file.take(FILE_BYTES_MAX).read_to_string(&mut text))
            .with_context(|| format!("{shown}: cannot read the lights"))?;
        let mut document =
            Self::parse(&text).with_context(|| format!("{shown}: not a valid list of lights"))?;
        for light in &mut document.lights {
            if let Light::Sky { image: Some(image), .. } = light {
                *image = path.parent().unwrap_or(Path::new("")).join(&*image);
            }
        }
        Ok(document)
    }

    /// Parses the text of a document.
    ///
    /// # Errors
    /// If it is no valid document.
    pub fn parse(text: &str) -> Result<Self> {
        let document: Self = serde_json::from_str(text).context("see docs/commands.md")?;
        ensure!(
            document.version == VERSION,
            "its version is {}, and this program reads version {VERSION}",
            document.version
        );
        for (index, light) in document.lights.iter().enumerate() {
            light.check().with_context(|| format!("light {} ({})", index + 1, light.kind()))?;
        }
        Ok(document)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_of_every_kind_survives_writing_and_reading() {
        let power = None;
        let lights = vec![
            Light::sun(120.0, 35.0),
            Light::sky(),
            Light::Lamp { at: [1.0, 2.0, 3.0], power: Some(5.0), colour: [1.0, 0.9, 0.8] },
            Light::Spot {
                at: [0.0; 3],
                target: [0.0, 0.0, -1.0],
                angle: 40.0,
                power,
                colour: white(),
            },
            Light::Area {
                corner: [0.0; 3],
                sides: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                strength: 2.0,
                colour: white(),
            },
            Light::Points { bounds: [[0.0; 3], [1.0; 3]], strength: 3.0 },
        ];
        let document = LightDocument { version: VERSION, lights };
        let text = serde_json::to_string(&document).unwrap();
        assert_eq!(LightDocument::parse(&text).unwrap(), document);
    }

    #[test]
    fn invalid_documents_are_refused_with_the_light_at_fault() {
        let fault = |lights: &str| {
            let text = format!(r#"{{"version": 1, "lights": [{lights}]}}"#);
            format!("{:#}", LightDocument::parse(&text).unwrap_err())
        };
        for (lights, says) in [
            (r#"{"kind": "moon"}"#, "unknown variant `moon`"),
            (r#"{"kind": "sun", "azimuth": 1}"#, "missing field `elevation`"),
            (r#"{"kind": "sun", "azimuth": 1, "elevation": 2, "size": 3}"#, "unknown field `size`"),
            (r#"{"kind": "sky"}, {"kind": "sun", "azimuth": 1, "elevation": 91}"#, "light 2 (sun)"),
            (r#"{"kind": "lamp", "at": [0, 0, 1e300]}"#, "`at` is 1e300"),
            (r#"{"kind": "spot", "at": [0,0,0], "target": [0,0,0], "angle": 9}"#, "same point"),
            (r#"{"kind": "area", "corner": [0,0,0], "sides": [[1,0,0],[2,0,0]]}"#, "parallel"),
            (r#"{"kind": "points", "box": [[1,0,0],[0,1,1]]}"#, "no inside"),
        ] {
            let fault = fault(lights);
            assert!(fault.contains(says), "{lights}: {fault}");
        }
        let old = LightDocument::parse(r#"{"version": 2, "lights": []}"#).unwrap_err();
        assert!(old.to_string().contains("version is 2"), "{old}");
    }
}
