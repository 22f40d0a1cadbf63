//! Lights as plain data in world coordinates: what `LIGHTS.json` holds, and what words of the
//! command line become. Points of the scan that shine are named beside the lights, since they are
//! surfaces that rays meet.

use anyhow::{Context, Result, ensure};
use esker_trace::light::{LIGHTS_VERSION, Light, Sky};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::Path;

/// Bytes of a document at most. A sky as numbers takes some 20 bytes a pixel.
const FILE_BYTES_MAX: u64 = 64 << 20;
/// Most lights of a picture: each ray through a pixel sends rays to all of them. And most kinds of
/// points that shine, which are numbered by a byte.
const LIGHTS_MAX: usize = 250;
/// Greatest strength or component of a colour: far above any use, and finite when squared.
pub(crate) const VALUE_MAX: f64 = 1e12;

/// Lights of a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lights {
    /// Version of the data.
    pub version: u32,
    /// The lights.
    pub lights: Vec<Light>,
    /// Points that shine.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub emissive: Vec<Emissive>,
}

/// Points of the scan that shine: those that meet all the conditions stated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Emissive {
    /// Classes of the points; none for any class.
    #[serde(default)]
    pub classes: Vec<u8>,
    /// Least and greatest corner of a box that holds the points; none for anywhere.
    #[serde(default)]
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Radiance of their surface, linear light.
    pub radiance: [f32; 3],
}

impl From<Vec<Light>> for Lights {
    fn from(lights: Vec<Light>) -> Self {
        Self { version: LIGHTS_VERSION, lights, emissive: Vec::new() }
    }
}

impl Lights {
    /// Reads a document.
    ///
    /// # Errors
    /// If it cannot be read, or is no valid document.
    pub fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let mut text = String::new();
        std::fs::File::open(path)
            .and_then(|file| file.take(FILE_BYTES_MAX).read_to_string(&mut text))
            .with_context(|| format!("{shown}: cannot read the lights"))?;
        Self::parse(&text).with_context(|| format!("{shown}: not a valid list of lights"))
    }

    /// Parses and checks the text of a document.
    ///
    /// # Errors
    /// If it is no valid document.
    pub fn parse(text: &str) -> Result<Self> {
        let lights: Self = serde_json::from_str(text).context("see docs/commands.md")?;
        ensure!(
            (1..=LIGHTS_VERSION).contains(&lights.version),
            "its version is {}, and this program reads version {LIGHTS_VERSION}",
            lights.version
        );
        for count in [lights.lights.len(), lights.emissive.len()] {
            ensure!(count <= LIGHTS_MAX, "it has {count} lights, at most {LIGHTS_MAX} are drawn");
        }
        for (index, light) in lights.lights.iter().enumerate() {
            check(light).with_context(|| format!("light {}", index + 1))?;
        }
        for (index, emissive) in lights.emissive.iter().enumerate() {
            emissive.check().with_context(|| format!("emissive {}", index + 1))?;
        }
        Ok(lights)
    }

    /// The lights, and those of `more`.
    pub fn with(mut self, more: Self) -> Self {
        self.lights.extend(more.lights);
        self.emissive.extend(more.emissive);
        self
    }

    /// The lights with `factor` units of length per unit of their places. Directions and edges are
    /// lengths already.
    pub(crate) fn measured(mut self, factor: [f64; 3]) -> Self {
        let measure = |place: &mut [f64; 3]| (0..3).for_each(|i| place[i] *= factor[i]);
        for light in &mut self.lights {
            match light {
                Light::Point { position, .. } | Light::Spot { position, .. } => measure(position),
                Light::Area { corner, .. } => measure(corner),
                Light::Sun { .. } | Light::Sky { .. } => {}
            }
        }
        self.emissive.iter_mut().filter_map(|e| e.bounds.as_mut()).flatten().for_each(measure);
        self
    }

    /// Whether points shine by their classes.
    pub(crate) fn name_classes(&self) -> bool {
        self.emissive.iter().any(|emissive| !emissive.classes.is_empty())
    }

    /// Whether the sky is among the lights.
    pub(crate) fn have_sky(&self) -> bool {
        self.lights.iter().any(|light| matches!(light, Light::Sky { .. }))
    }

    /// Names of the kinds of the lights.
    pub(crate) fn kinds(&self) -> Vec<&'static str> {
        let lights = self.lights.iter().map(|light| match light {
            Light::Sun { .. } => "sun",
            Light::Sky { .. } => "sky",
            Light::Point { .. } => "lamp",
            Light::Spot { .. } => "spot",
            Light::Area { .. } => "area",
        });
        lights.chain(self.emissive.iter().map(|_| "emissive")).collect()
    }
}

/// Checks that `value` is within a range, and returns it.
pub(crate) fn within(name: &str, value: f64, least: f64, greatest: f64) -> Result<f64> {
    ensure!(
        (least..=greatest).contains(&value),
        "{name} is {value}, it must be within {least} and {greatest}"
    );
    Ok(value)
}

fn colour(name: &str, colour: &[f32; 3]) -> Result<()> {
    colour.iter().try_for_each(|&c| within(name, f64::from(c), 0.0, VALUE_MAX).map(drop))
}

fn place(name: &str, place: &[f64; 3]) -> Result<()> {
    place.iter().try_for_each(|&c| within(name, c, -VALUE_MAX, VALUE_MAX).map(drop))
}

impl Emissive {
    fn check(&self) -> Result<()> {
        if let Some([low, high]) = &self.bounds {
            place("the box", low)?;
            place("the box", high)?;
            ensure!((0..3).all(|i| low[i] <= high[i]), "the box has no inside");
        }
        colour("the radiance", &self.radiance)
    }
}

/// Refuses numbers without a meaning.
pub(crate) fn check(light: &Light) -> Result<()> {
    match light {
        Light::Sun { azimuth_deg, elevation_deg, irradiance, angular_diameter_deg } => {
            within("the azimuth", *azimuth_deg, -360.0, 360.0)?;
            within("the elevation", *elevation_deg, -90.0, 90.0)?;
            within("the diameter", *angular_diameter_deg, 0.0, 90.0)?;
            colour("the irradiance", irradiance)
        }
        Light::Sky { sky: Sky::Constant(radiance) } => colour("the radiance", radiance),
        Light::Sky { sky: Sky::Gradient { zenith, horizon, ground } } => {
            [zenith, horizon, ground].into_iter().try_for_each(|c| colour("the radiance", c))
        }
        Light::Sky { sky: Sky::Image(image) } => {
            let pixels = image.width.checked_mul(image.height);
            ensure!(
                pixels == Some(image.pixels.len()) && !image.pixels.is_empty(),
                "the picture of the sky has {} pixels, not {} x {}",
                image.pixels.len(),
                image.width,
                image.height
            );
            image.pixels.iter().try_for_each(|pixel| colour("a pixel", pixel))
        }
        Light::Point { position, intensity } => {
            place("the position", position)?;
            colour("the intensity", intensity)
        }
        Light::Spot { position, direction, intensity, inner_angle_deg, outer_angle_deg } => {
            place("the position", position)?;
            place("the direction", direction)?;
            ensure!(direction.iter().any(|&c| c != 0.0), "the direction is 0,0,0: none");
            within("the outer angle", *outer_angle_deg, 0.0, 180.0)?;
            within("the inner angle", *inner_angle_deg, 0.0, *outer_angle_deg)?;
            colour("the intensity", intensity)
        }
        Light::Area { corner, edges: [a, b], radiance, .. } => {
            [corner, a, b].into_iter().try_for_each(|p| place("a corner or edge", p))?;
            let area = glam::DVec3::from_array(*a).cross((*b).into()).length();
            ensure!(area > 0.0, "the two edges are parallel, so that there is no area");
            colour("the radiance", radiance)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_scaled_to_lengths_and_vectors_are_lengths() {
        let place = [2.0, 3.0, 5.0];
        let edges = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let lights = vec![
            Light::Point { position: place, intensity: [1.0; 3] },
            Light::Area { corner: place, edges, radiance: [1.0; 3], two_sided: false },
        ];
        let bounds = Some([[0.0; 3], place]);
        let emissive = vec![Emissive { classes: vec![], bounds, radiance: [1.0; 3] }];
        let lights = Lights { emissive, ..lights.into() };
        let measured = lights.clone().measured([10.0, 100.0, 1.0]);
        let wanted = [20.0, 300.0, 5.0];
        let [Light::Point { position, .. }, Light::Area { corner, edges: kept, .. }] =
            &measured.lights[..]
        else {
            panic!("the kinds stay");
        };
        assert_eq!((*position, *corner, *kept), (wanted, wanted, edges));
        assert_eq!(measured.emissive[0].bounds, Some([[0.0; 3], wanted]));
        assert_eq!(lights.clone().measured([1.0; 3]), lights);
    }

    #[test]
    fn a_document_is_read_back_and_faults_name_the_light() {
        let lights = vec![
            Light::Point { position: [1.0, 2.0, 3.0], intensity: [1.0; 3] },
            Light::Sky { sky: Sky::Constant([0.5; 3]) },
        ];
        let bounds = Some([[0.0; 3], [1.0; 3]]);
        let emissive = vec![Emissive { classes: vec![6], bounds, radiance: [1.0; 3] }];
        let document = Lights { emissive, ..lights.into() };
        assert_eq!(Lights::parse(&serde_json::to_string(&document).unwrap()).unwrap(), document);
        for (lights, emissive, says) in [
            (r#"{"kind": "moon"}"#, "", "unknown variant `moon`"),
            (r#"{"kind": "point", "position": [0, 0, 0]}"#, "", "missing field `intensity`"),
            (
                r#"{"kind": "point", "position": [0, 0, 1e30], "intensity": [1, 1, 1]}"#,
                "",
                "light 1: the position is 1000000",
            ),
            (
                r#"{"kind": "area", "corner": [0,0,0], "edges": [[1,0,0],[2,0,0]], "radiance": [1,1,1]}"#,
                "",
                "parallel",
            ),
            ("", r#"{"radiance": [1, 1, -1]}"#, "emissive 1: the radiance is -1"),
            ("", r#"{"radiance": [1, 1, 1], "box": 7}"#, "unknown field `box`"),
        ] {
            let text =
                format!(r#"{{"version": 1, "lights": [{lights}], "emissive": [{emissive}]}}"#);
            let fault = format!("{:#}", Lights::parse(&text).unwrap_err());
            assert!(fault.contains(says), "{text}: {fault}");
        }
        let new = Lights::parse(r#"{"version": 99, "lights": []}"#).unwrap_err();
        assert!(new.to_string().contains("version is 99"), "{new}");
    }
}
