//! Quantities on the command line and in texts: bytes with units, numbers of points, sizes of
//! pictures, lengths.

use anyhow::{Context, Result, bail, ensure};
use esker_lod::Window;
use esker_render::{POINT_SIZE_MAX, PointSize};
use esker_scan::synthetic::parse_points;

/// Most points of a generated model or cloud: renderers number points by 32 bits.
pub const POINTS_MAX: u64 = 4_000_000_000;

/// Parses `4GiB`, `512M`, `1.5 GB` or plain bytes. Binary units (KiB, K) are powers of 1024,
/// decimal ones (KB) of 1000.
///
/// # Errors
/// If `text` is neither.
pub fn bytes(text: &str) -> Result<u64> {
    let text = text.trim();
    let digits = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let number: f64 =
        text[..digits].parse().with_context(|| format!("`{text}` is no size, such as 4GiB"))?;
    let unit = text[digits..].trim().to_ascii_lowercase();
    let factor = match unit.as_str() {
        "" | "b" => 1u64,
        "k" | "kib" => 1 << 10,
        "m" | "mib" => 1 << 20,
        "g" | "gib" => 1 << 30,
        "t" | "tib" => 1 << 40,
        "kb" => 1_000,
        "mb" => 1_000_000,
        "gb" => 1_000_000_000,
        "tb" => 1_000_000_000_000,
        _ => bail!("`{unit}` is no unit of bytes: use MiB or GiB"),
    };
    Ok((number * factor as f64) as u64)
}

/// Parses the number of points of a generated model: `250000`, `25k` or `20M`.
///
/// # Errors
/// If `text` is not a number from 1 to [`POINTS_MAX`].
pub fn points(text: &str) -> Result<u64> {
    let points = parse_points(text).map_err(anyhow::Error::msg)?;
    ensure!(
        (1..=POINTS_MAX).contains(&points),
        "`{text}` is no number of points from 1 to {POINTS_MAX}, such as 20M"
    );
    Ok(points)
}

/// Most pixels of a picture: passes number them, margins included, by 28 bits.
const PIXELS_MAX: u64 = 250_000_000;

/// Parses the most points of a picture, such as `500000` or `20M`; 0 draws none.
///
/// # Errors
/// If `text` is not a number.
pub fn points_budget(text: &str) -> Result<u64> {
    text.parse().or_else(|_| parse_points(text)).map_err(anyhow::Error::msg)
}

/// Parses `1920x1080`.
///
/// # Errors
/// If `text` is not a size, a side is 0 or over 16,384 pixels, or there are more than 250 million
/// pixels.
pub fn picture_size(text: &str) -> Result<[u32; 2]> {
    let parse = |side: &str| side.trim().parse::<u32>().ok();
    let (width, height) = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some((parse(w)?, parse(h)?)))
        .with_context(|| format!("`{text}` is no picture size, such as 1024x1024"))?;
    ensure!(
        (1..=16_384).contains(&width) && (1..=16_384).contains(&height),
        "a picture's sides are 1 to 16384 pixels, not {text}"
    );
    ensure!(
        u64::from(width) * u64::from(height) <= PIXELS_MAX,
        "a picture has 250 million pixels at most, {text} has more"
    );
    Ok([width, height])
}

/// Parses a part of a picture: first column and row, width and height, pixels.
///
/// # Errors
/// If `text` is not four whole numbers.
pub fn window(text: &str) -> Result<Window> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, width, height]) => Ok(Window { x, y, width, height }),
        _ => bail!("`{text}` is no part of a picture, such as 0,0,512,512: x, y, width, height"),
    }
}

/// Parses a pixel of a picture: column and row, from 0.
///
/// # Errors
/// If `text` is not two whole numbers.
pub fn pixel(text: &str) -> Result<[u32; 2]> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y]) => Ok([x, y]),
        _ => bail!("`{text}` is no pixel, such as 512,300: column and row, from 0"),
    }
}

/// Greatest distance of points in a picture, pixels.
const SPACING_PX_MAX: f64 = 1e6;

/// Parses a distance of points in a picture, pixels.
///
/// # Errors
/// If `text` is not a number in the range.
pub fn spacing_px(text: &str) -> Result<f64> {
    let pixels: f64 = text.trim().parse().with_context(|| format!("`{text}` is no number"))?;
    ensure!(
        (0.0..=SPACING_PX_MAX).contains(&pixels),
        "{pixels} pixels are out of range; give a number from 0, which draws all points, to {SPACING_PX_MAX}"
    );
    Ok(pixels)
}

/// Parses a time, milliseconds.
///
/// # Errors
/// If `text` is no positive number.
pub fn milliseconds(text: &str) -> Result<f64> {
    let ms: f64 = text.trim().parse().with_context(|| format!("`{text}` is no number"))?;
    ensure!(ms > 0.0 && ms.is_finite(), "{ms} milliseconds are no time; give a number above 0");
    Ok(ms)
}

/// Parses a diameter of points, pixels, or `adaptive`.
///
/// # Errors
/// If `text` is neither, or the diameter is out of range.
pub fn point_size(text: &str) -> Result<PointSize> {
    if text.trim() == "adaptive" {
        return Ok(PointSize::Adaptive);
    }
    let pixels = text.trim().parse().ok().filter(|p| (1.0..=POINT_SIZE_MAX).contains(p));
    let pixels = pixels.with_context(|| {
        format!("`{text}` is no size of points: give `adaptive`, or 1 to {POINT_SIZE_MAX} pixels")
    })?;
    Ok(PointSize::Pixels(pixels))
}

/// Greatest strength of an effect.
const STRENGTH_MAX: f32 = 10.0;

/// Parses the strength of an effect; 0 is none.
///
/// # Errors
/// If `text` is not a number in the range.
pub fn strength(text: &str) -> Result<f32> {
    let strength = text.trim().parse().ok().filter(|s| (0.0..=STRENGTH_MAX).contains(s));
    strength
        .with_context(|| format!("`{text}` is no strength: give 0, for none, to {STRENGTH_MAX}"))
}

/// Parses the factor from light to a picture.
///
/// # Errors
/// If `text` is not a number above 0.
pub fn exposure(text: &str) -> Result<f64> {
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite() && *value > 0.0);
    value.with_context(|| format!("`{text}` is no number above 0"))
}

/// Most threads: far more than are useful, far fewer than would exhaust a machine.
const THREADS_MAX: usize = 1024;

/// Parses a number of threads; 0 is one a core.
///
/// # Errors
/// If `text` is not a number, or too great.
pub fn threads(text: &str) -> Result<usize> {
    let threads: usize = text.trim().parse().with_context(|| format!("`{text}` is no number"))?;
    ensure!(threads <= THREADS_MAX, "{threads} threads are more than {THREADS_MAX}");
    Ok(threads)
}

/// Parses a length in the scan's unit.
///
/// # Errors
/// If `text` is not a number above 0.
pub fn length(text: &str) -> Result<f64> {
    let length = text.trim().parse().ok().filter(|l: &f64| l.is_finite() && *l > 0.0);
    length.with_context(|| {
        format!("`{text}` is no length: it must be above 0, such as 0.05, in the scan's unit")
    })
}

/// Writes 1234567 as `1,234,567`.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

/// Writes bytes as `1.5 GiB`.
pub fn readable_bytes(n: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = n as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < units.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{n} B") } else { format!("{value:.1} {}", units[unit]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_people_write_them() {
        assert_eq!(bytes("4GiB").unwrap(), 4 << 30);
        assert_eq!(bytes("512m").unwrap(), 512 << 20);
        assert_eq!(bytes("1.5 GB").unwrap(), 1_500_000_000);
        assert_eq!(bytes("123").unwrap(), 123);
        assert!(bytes("GiB").is_err() && bytes("4 parsecs").is_err() && bytes("-1").is_err());
        assert_eq!([points("25k").unwrap(), points("25K").unwrap()], [25_000; 2]);
        assert_eq!([points("20M").unwrap(), points("250000").unwrap()], [20_000_000, 250_000]);
        assert!(["0", "k", "1.5M", "9G", "many"].iter().all(|text| points(text).is_err()));
        assert_eq!(points_budget(&u64::MAX.to_string()).unwrap(), u64::MAX);
        assert_eq!([points_budget("1M").unwrap(), points_budget("0").unwrap()], [1_000_000, 0]);
        assert!(points_budget("-1").is_err() && points_budget("all").is_err());
        assert_eq!(threads("3").unwrap(), 3);
        assert!(threads("100000").is_err() && threads("-1").is_err());
        assert_eq!(length("0.05").unwrap(), 0.05);
        assert!(["0", "-1", "nan", "inf", "far"].iter().all(|text| length(text).is_err()));
        assert_eq!(picture_size("640x480").unwrap(), [640, 480]);
        assert!(
            picture_size("0x480").is_err()
                && picture_size("99999x1").is_err()
                && picture_size("16384x16384").is_err()
                && picture_size("big").is_err()
        );
    }

    #[test]
    fn a_window_is_four_numbers() {
        let window = Window { x: 1, y: 20, width: 300, height: 4 };
        assert_eq!(super::window("1,20, 300,4").unwrap(), window);
        for text in ["", "1,2,3", "1,2,3,4,5", "-1,2,3,4", "a,2,3,4"] {
            assert!(super::window(text).is_err(), "{text}");
        }
    }

    #[test]
    fn numbers_are_grouped() {
        assert_eq!(
            (grouped(1), grouped(999), grouped(1_234_567)),
            ("1".into(), "999".into(), "1,234,567".into())
        );
        assert_eq!(readable_bytes(3 << 29), "1.5 GiB");
    }
}
