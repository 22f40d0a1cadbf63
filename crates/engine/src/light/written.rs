//! Writes lights as words of the command line ([`crate::light::lights`]), where a word means
//! exactly the same light.

use crate::light::lights::{SUN_IRRADIANCE, ZENITH, clear_sky, sun_at};
use anyhow::{Result, ensure};
use esker_trace::light::{Light, Panorama, PanoramaFile, SUN_DIAMETER_DEG, Sky};
use std::path::Path;

/// The word for a light; none if there is no such word. `name` gives the name of a file.
///
/// # Errors
/// If `name` fails, or a word cannot hold the name.
pub(crate) fn word(
    light: &Light,
    name: impl Fn(&Path) -> Result<String>,
) -> Result<Option<String>> {
    Ok(match light {
        Light::Sun { azimuth_deg, elevation_deg, irradiance, angular_diameter_deg } => {
            let (azimuth, elevation, diameter) =
                (*azimuth_deg, *elevation_deg, *angular_diameter_deg);
            let is_it = |strength: f64| sun_at(azimuth, elevation, strength, diameter) == *light;
            strength(irradiance[0] / SUN_IRRADIANCE, is_it).map(|strength| {
                let word = format!("sun:{azimuth},{elevation}");
                if diameter != SUN_DIAMETER_DEG {
                    format!("{word},{strength},{diameter}")
                } else {
                    with_strength(word, ',', strength)
                }
            })
        }
        Light::Sky { sky: Sky::Gradient { zenith, .. } } => {
            let is_it = |strength: f64| clear_sky(strength) == *light;
            let strength = strength(zenith[0] / ZENITH[0], is_it);
            strength.map(|strength| with_strength("sky".into(), ':', strength))
        }
        Light::Sky { sky: Sky::Image(Panorama { file: Some(file), .. }) } => {
            let PanoramaFile { path, strength } = file;
            let name = name(path)?;
            let is_clear = name.ends_with(".png") && (!name.contains(',') || *strength == 1.0);
            ensure!(
                is_clear,
                "{name}: a picture of the sky needs a name without commas; rename it"
            );
            Some(with_strength(format!("sky:{name}"), ',', *strength))
        }
        Light::Point { position: [x, y, z], intensity } => {
            let is_it = |strength: f64| *intensity == [strength as f32 * SUN_IRRADIANCE; 3];
            strength(intensity[0] / SUN_IRRADIANCE, is_it)
                .map(|strength| with_strength(format!("lamp:{x},{y},{z}"), ',', strength))
        }
        Light::Sky { .. } | Light::Spot { .. } | Light::Area { .. } => None,
    })
}

/// The strength near `about` with which a light is the wanted one. Dividing by a constant may miss
/// it by one unit in the last place.
fn strength(about: f32, is_it: impl Fn(f64) -> bool) -> Option<f64> {
    let decimal = |value: f32| value.to_string().parse::<f64>().ok();
    let near = [about, about.next_up(), about.next_down()];
    near.into_iter().filter_map(decimal).filter(|s| s.is_finite()).find(|s| is_it(*s))
}

fn with_strength(word: String, separator: char, strength: f64) -> String {
    if strength == 1.0 { word } else { format!("{word}{separator}{strength}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::lights::{one_in, parse};

    #[test]
    fn a_word_is_read_as_the_light_that_it_was_written_from() {
        for text in [
            "sun:225,40",
            "sun:-0.1,12.5,0.3",
            "sun:1,2,1,0",
            "sun:1,2,1e-30",
            "sky",
            "sky:0.35",
            "sky:0",
            "lamp:1,-2.5,3e6",
            "lamp:637000.125,5000000,2.2,7.7",
        ] {
            let lights = parse(text).unwrap().lights;
            let word = word(&lights[0], |_| panic!("no file")).unwrap().unwrap();
            assert_eq!(one_in(&word, Path::new("")).unwrap().lights, lights, "{text}: {word}");
        }
    }

    #[test]
    fn lights_that_no_word_means_are_data() {
        let constant = Light::Sky { sky: Sky::Constant([0.5; 3]) };
        let reddish = Light::Point { position: [0.0; 3], intensity: [1.0, 0.5, 0.5] };
        let numbers = Panorama { width: 1, height: 1, pixels: vec![[1.0; 3]], file: None };
        for light in [constant, reddish, Light::Sky { sky: Sky::Image(numbers) }] {
            assert_eq!(word(&light, |_| panic!("no file")).unwrap(), None);
        }
    }

    #[test]
    fn a_picture_of_the_sky_is_named_by_its_file() {
        let file = Some(PanoramaFile { path: "my sky.png".into(), strength: 0.5 });
        let image = Panorama { width: 1, height: 1, pixels: vec![[1.0; 3]], file };
        let light = Light::Sky { sky: Sky::Image(image) };
        let named = |to: &'static str| word(&light, move |_| Ok(to.into()));
        assert_eq!(named("../my sky.png").unwrap().unwrap(), "sky:../my sky.png,0.5");
        assert!(named("a,b.png").unwrap_err().to_string().contains("without commas"));
    }
}
