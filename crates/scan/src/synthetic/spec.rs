//! Parses the name of a generated scan: `synthetic:SCENE:POINTS` or `synthetic:SCENE:POINTS:SEED`.

use super::model::MODELS;
use super::scenes::SCENES;
use crate::error::ScanError;
use std::path::Path;

/// Prefix of the name of every generated scan. A file of such a name is `./synthetic:...`.
pub const PREFIX: &str = "synthetic:";
/// Greatest number of points of a generated scan.
pub const POINTS_MAX: u64 = 1 << 40;

/// A generated scan according to its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spec {
    /// Index into [`SCENES`], followed by [`MODELS`].
    pub scene: usize,
    /// Number of points, at most [`POINTS_MAX`].
    pub points: u64,
    /// Seed of the random numbers; 1 by default.
    pub seed: u64,
}

/// Whether an input names a generated scan and not a file.
pub fn is_spec(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().starts_with(PREFIX.as_bytes())
}

impl Spec {
    /// Parses a name.
    ///
    /// # Errors
    /// If it is not such a name; the message says what is wrong and which scans there are.
    pub fn parse(path: &Path) -> Result<Self, ScanError> {
        let text = path.to_string_lossy();
        let rest = text.strip_prefix(PREFIX).unwrap_or(&text);
        Self::parts(rest).map_err(|what| {
            let scenes: Vec<_> = all().collect();
            ScanError::unsupported(
                path,
                format!(
                    "{what}; a generated scan is synthetic:SCENE:POINTS[:SEED], SCENE one of {}, POINTS such as 250000, 100k, 10M or 1G (a file of that name is ./{PREFIX}...)",
                    scenes.join(", ")
                ),
            )
        })
    }

    fn parts(rest: &str) -> Result<Self, String> {
        let mut parts = rest.split(':');
        let name = parts.next().unwrap_or_default();
        let scene = all().position(|scene| scene == name);
        let scene = scene.ok_or_else(|| format!("there is no scene `{name}`"))?;
        let points = parts.next().ok_or("the number of points is missing")?;
        let points = parse_points(points)?;
        let seed = match parts.next() {
            None => 1,
            Some(seed) => seed
                .parse()
                .map_err(|_| format!("the seed `{seed}` is no whole number from 0 to 2^64 - 1"))?,
        };
        match parts.next() {
            None => Ok(Self { scene, points, seed }),
            Some(more) => Err(format!("`{more}` follows the seed")),
        }
    }
}

/// The names of all scenes and models.
fn all() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|s| s.name).chain(MODELS.iter().map(|m| m.name))
}

/// Parses a number of points, such as 250000, 100k, 10M or 1G; the unit is case-insensitive.
///
/// # Errors
/// If `text` is not a number of points, or is more than [`POINTS_MAX`].
pub fn parse_points(text: &str) -> Result<u64, String> {
    let (digits, unit) = match text.as_bytes().last() {
        Some(b'k' | b'K') => (&text[..text.len() - 1], 1_000),
        Some(b'm' | b'M') => (&text[..text.len() - 1], 1_000_000),
        Some(b'g' | b'G') => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return Err(format!("`{text}` is no number of points, such as 20M"));
    }
    let points = digits.parse::<u64>().ok().and_then(|n| n.checked_mul(unit));
    points.filter(|&n| n <= POINTS_MAX).ok_or_else(|| {
        format!("{text} points are more than the {POINTS_MAX} that can be generated")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Spec, String> {
        Spec::parse(Path::new(text)).map_err(|e| e.to_string())
    }

    #[test]
    fn points_are_read_with_and_without_a_unit() {
        for (text, points, seed) in [
            ("synthetic:office:1000000:7", 1_000_000, 7),
            ("synthetic:office:100k", 100_000, 1),
            ("synthetic:office:100K", 100_000, 1),
            ("synthetic:office:10M:0", 10_000_000, 0),
            ("synthetic:office:1G:18446744073709551615", 1_000_000_000, u64::MAX),
            ("synthetic:office:0", 0, 1),
            ("synthetic:office:1099511627776", POINTS_MAX, 1),
        ] {
            let spec = parse(text).unwrap();
            assert_eq!((spec.points, spec.seed), (points, seed), "{text}");
        }
    }

    #[test]
    fn malformed_names_are_refused_with_the_known_scenes() {
        for (text, what) in [
            ("synthetic:", "there is no scene ``"),
            ("synthetic:castle:1M", "there is no scene `castle`"),
            ("synthetic:office", "the number of points is missing"),
            ("synthetic:office:", "`` is no number of points"),
            ("synthetic:office:k", "`k` is no number of points"),
            ("synthetic:office:-5", "`-5` is no number of points"),
            ("synthetic:office:1.5M", "`1.5M` is no number of points"),
            ("synthetic:office:1099511627777", "are more than the 1099511627776"),
            ("synthetic:office:99999999999999999999G", "are more than"),
            ("synthetic:office:1M:x", "the seed `x` is no whole number"),
            ("synthetic:office:1M:1:2", "`2` follows the seed"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.starts_with(&format!("{text}: ")), "{error}");
            assert!(error.contains(what) && !error.contains('\n'), "{error}");
            assert!(all().all(|name| error.contains(name)), "{error}");
        }
    }

    #[test]
    fn a_file_of_that_name_is_still_a_file() {
        assert!(is_spec(Path::new("synthetic:office:1M")));
        assert!(!is_spec(Path::new("./synthetic:office:1M")));
        assert!(!is_spec(Path::new("synthetic")));
    }
}
