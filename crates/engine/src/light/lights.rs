//! Makes lights out of words of the command line, and of pictures of the sky, which become linear
//! light. Gives the lights of pictures that name none.

use crate::light::document::{Lights, VALUE_MAX, check, within};
use crate::light::tone::srgb_to_linear;
use anyhow::{Context, Result, bail, ensure};
use esker_trace::light::{Light, Panorama, PanoramaFile, SUN_DIAMETER_DEG, Sky};
use std::f32::consts::PI;
use std::io::BufReader;
use std::path::Path;

/// Forms of lights, for errors.
const FORMS: &str = "sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]], sky[:STRENGTH], \
                     sky:PICTURE.png[,STRENGTH], lamp:X,Y,Z[,STRENGTH] or LIGHTS.json";
const SUN: &str = "sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]], such as sun:225,40";
const SKY: &str = "sky[:STRENGTH] or sky:PICTURE.png[,STRENGTH], such as sky:0.5";
const LAMP: &str = "lamp:X,Y,Z[,STRENGTH], such as lamp:10.5,3,2.2";

/// Pixels of a picture of the sky at most: 16384 x 8192.
const SKY_PIXELS_MAX: u64 = 1 << 27;
/// Irradiance of a surface that faces the sun of strength 1: a white one then has a radiance of 1.
pub(crate) const SUN_IRRADIANCE: f32 = PI;
/// Radiance of the sky of strength 1, straight above: a clear sky gives about a fifth of the light
/// of the sun, and its zenith is bluer than its horizon.
pub(crate) const ZENITH: [f32; 3] = [0.11, 0.17, 0.30];
const HORIZON: [f32; 3] = [0.26, 0.30, 0.36];
/// Radiance from below the horizon: what the land around the scan reflects.
const GROUND: [f32; 3] = [0.10, 0.09, 0.08];

/// Lights of pictures that name none: the sun in the south-west, and the sky.
pub fn defaults() -> Lights {
    vec![sun_at(225.0, 40.0, 1.0, SUN_DIAMETER_DEG), clear_sky(1.0)].into()
}

/// The sun, `strength` times as bright as the sun of lights that name none.
pub fn sun_at(azimuth_deg: f64, elevation_deg: f64, strength: f64, diameter_deg: f64) -> Light {
    Light::Sun {
        azimuth_deg,
        elevation_deg,
        irradiance: [strength as f32 * SUN_IRRADIANCE; 3],
        angular_diameter_deg: diameter_deg,
    }
}

/// A clear sky.
pub fn clear_sky(strength: f64) -> Light {
    let [zenith, horizon, ground] =
        [ZENITH, HORIZON, GROUND].map(|colour| colour.map(|c| c * strength as f32));
    Light::Sky { sky: Sky::Gradient { zenith, horizon, ground } }
}

/// Parses lights, and reads the documents and pictures that are named.
///
/// # Errors
/// As for [`crate::light::spec::parse`].
pub fn parse(text: &str) -> Result<Lights> {
    let here = Path::new("");
    let is_file = |text: &str| Path::new(text).extension().is_some_and(|e| e == "json");
    if is_file(text) {
        return Lights::read(Path::new(text));
    }
    let mut lights = Lights::from(Vec::new());
    for word in text.split(['|', ' ']).filter(|word| !word.is_empty()) {
        match is_file(word) {
            true => lights = lights.with(Lights::read(Path::new(word))?),
            false => {
                lights.lights.push(light(word, here).with_context(|| format!("light `{word}`"))?)
            }
        }
    }
    let count = lights.lights.len() + lights.emissive.len();
    ensure!(count > 0, "no light is named: {FORMS}");
    Ok(lights)
}

/// Parses one light, or reads a document; files are relative to `folder`, and their names may hold
/// blanks.
///
/// # Errors
/// As for [`parse`].
pub fn one_in(word: &str, folder: &Path) -> Result<Lights> {
    if Path::new(word).extension().is_some_and(|e| e == "json") {
        return Lights::read(&folder.join(word));
    }
    Ok(vec![light(word, folder).with_context(|| format!("light `{word}`"))?].into())
}

fn light(word: &str, folder: &Path) -> Result<Light> {
    let (kind, values) = word.split_once(':').unwrap_or((word, ""));
    let light = match kind {
        "sun" => sun(values).context(SUN)?,
        "sky" => sky(values, folder).context(SKY)?,
        "lamp" => lamp(values).context(LAMP)?,
        _ => bail!("is none of {FORMS}"),
    };
    check(&light)?;
    Ok(light)
}

fn sun(values: &str) -> Result<Light> {
    let values = numbers(values)?;
    let (&[azimuth, elevation], rest) =
        values.split_first_chunk().context("azimuth and elevation are missing")?;
    ensure!(rest.len() <= 2, "there are {} numbers, at most 4 have a meaning", values.len());
    let strength = within("the strength", rest.first().copied().unwrap_or(1.0), 0.0, VALUE_MAX)?;
    Ok(sun_at(azimuth, elevation, strength, rest.get(1).copied().unwrap_or(SUN_DIAMETER_DEG)))
}

fn sky(values: &str, folder: &Path) -> Result<Light> {
    let (picture, values) = match values.split_once(',') {
        _ if values.ends_with(".png") => (Some(values), ""),
        Some((name, values)) if name.ends_with(".png") => (Some(name), values),
        _ => (None, values),
    };
    let values = numbers(values)?;
    ensure!(values.len() <= 1, "there are {} numbers, one has a meaning", values.len());
    let strength = within("the strength", values.first().copied().unwrap_or(1.0), 0.0, VALUE_MAX)?;
    match picture {
        Some(path) => Ok(Light::Sky { sky: Sky::Image(panorama(&folder.join(path), strength)?) }),
        None => Ok(clear_sky(strength)),
    }
}

fn lamp(values: &str) -> Result<Light> {
    let values = numbers(values)?;
    let (&position, rest) = values.split_first_chunk().context("x, y and z are missing")?;
    ensure!(rest.len() <= 1, "there are {} numbers, at most 4 have a meaning", values.len());
    let strength = within("the strength", rest.first().copied().unwrap_or(1.0), 0.0, VALUE_MAX)?;
    Ok(Light::Point { position, intensity: [strength as f32 * SUN_IRRADIANCE; 3] })
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

/// Reads a picture of all directions (equirectangular PNG) as linear light.
fn panorama(path: &Path, strength: f64) -> Result<Panorama> {
    let context = || format!("{}: cannot read the picture of the sky", path.display());
    let file = std::fs::File::open(path).with_context(context)?;
    let mut decoder = png::Decoder::new(BufReader::new(file));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().with_context(context)?;
    let (width, height) = reader.info().size();
    ensure!(
        u64::from(width) * u64::from(height) <= SKY_PIXELS_MAX,
        "{}: the picture of the sky has {width} x {height} pixels, more than {SKY_PIXELS_MAX}",
        path.display()
    );
    let bytes = reader.output_buffer_size().with_context(context)?;
    let mut samples = vec![0; bytes];
    let info = reader.next_frame(&mut samples).with_context(context)?;
    let channels = info.color_type.samples();
    let linear = |byte: u8| (srgb_to_linear(f32::from(byte) / 255.0)) * strength as f32;
    let pixels = samples[..info.buffer_size()].chunks_exact(channels).map(|pixel| {
        let [r, g, b] = if channels < 3 { [pixel[0]; 3] } else { [pixel[0], pixel[1], pixel[2]] };
        [r, g, b].map(linear)
    });
    Ok(Panorama {
        width: width as usize,
        height: height as usize,
        pixels: pixels.collect(),
        file: Some(PanoramaFile { path: path.to_owned(), strength }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_parsed() {
        let of = |text: &str| parse(text).unwrap().lights;
        let [sun, sky] = [sun_at(225.0, 40.0, 1.0, SUN_DIAMETER_DEG), clear_sky(1.0)];
        assert_eq!(of("sun:225,40")[0], sun);
        assert_eq!(of("sun:225,40|sky"), [sun.clone(), sky.clone()]);
        assert_eq!(of("sky sun:225,40"), [sky, sun]);
        assert_eq!(of("sky:0.5"), [clear_sky(0.5)]);
        let lamp = Light::Point { position: [1.0, -2.5, 3e6], intensity: [2.0 * PI; 3] };
        assert_eq!(of("lamp:1,-2.5,3e6,2"), [lamp]);
    }

    #[test]
    fn an_error_shows_the_form() {
        for (text, says) in [
            ("", "no light is named: sun:"),
            ("moon:1,2", "light `moon:1,2`: is none of sun:AZIMUTH"),
            ("sun", "sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]], such as sun:225,40: azimuth and"),
            ("sun:1,2,3,4,5", "there are 5 numbers"),
            ("sun:a,2", "`a` is no number"),
            ("sun:10,100", "the elevation is 100, it must be within -90 and 90"),
            ("sky:1,2", "sky[:STRENGTH]"),
            ("sky:-1", "the strength is -1"),
            ("sky:missing.png", "missing.png: cannot read the picture of the sky"),
            ("lamp:1,2", "lamp:X,Y,Z[,STRENGTH]"),
            ("lamp:1,2,nan", "`nan` is no number"),
            ("missing.json", "missing.json: cannot read the lights"),
        ] {
            let fault = format!("{:#}", parse(text).unwrap_err());
            assert!(fault.contains(says), "{text}: {fault}");
        }
    }

    #[test]
    fn a_picture_of_the_sky_becomes_linear_light() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.png");
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 2, 1);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[255, 188, 0, 0, 0, 255]).unwrap();
        drop(writer);
        let image = panorama(&path, 2.0).unwrap();
        assert_eq!((image.width, image.height), (2, 1));
        let [r, g, b] = image.pixels[0];
        assert!((r - 2.0).abs() < 1e-6 && (g - 1.0).abs() < 0.01 && b == 0.0, "{r} {g} {b}");
        assert_eq!(image.pixels[1], [0.0, 0.0, 2.0]);
    }
}
