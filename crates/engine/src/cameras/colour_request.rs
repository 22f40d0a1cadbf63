//! The source of colours that the user requests: `NAME`, or `NAME:MIN..MAX` with either end open;
//! `:MAP` may follow, the name of a colour map.

use crate::cameras::legend::short;
use anyhow::{Context, Result, bail, ensure};
use esker_render::Gradient;

/// A requested source of colours.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ColourRequest<'a> {
    /// Name of the source.
    pub(crate) name: &'a str,
    range: [Option<f64>; 2],
    /// The requested colour map.
    pub(crate) gradient: Option<Gradient>,
}

/// Parts of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parts<'a> {
    /// Name of the source.
    pub name: &'a str,
    /// Ends of the range; none where it is open.
    pub range: [Option<f64>; 2],
    /// The colour map; none for the one that suits the source.
    pub gradient: Option<Gradient>,
}

impl Parts<'_> {
    /// The text that requests these parts.
    pub fn text(&self) -> String {
        let end = |end: Option<f64>| end.map_or(String::new(), |end| end.to_string());
        let [low, high] = self.range.map(end);
        let has_range = self.range != [None; 2];
        let range = if has_range { format!(":{low}..{high}") } else { String::new() };
        let map = self.gradient.map_or(String::new(), |map| format!(":{}", map.name()));
        format!("{}{range}{map}", self.name)
    }
}

/// The parts of the request `text`.
///
/// # Errors
/// If the range is invalid.
pub fn parts(text: &str) -> Result<Parts<'_>> {
    let ColourRequest { name, range, gradient } = ColourRequest::parse(text)?;
    Ok(Parts { name, range, gradient })
}

impl<'a> ColourRequest<'a> {
    pub(crate) fn parse(text: &'a str) -> Result<Self> {
        let mapped = text.rsplit_once(':').map(|(text, map)| (text, Gradient::of_name(map)));
        let (text, gradient) = match mapped {
            Some((text, Some(gradient))) => (text, Some(gradient)),
            _ => (text, None),
        };
        let plain = Self { name: text, range: [None; 2], gradient };
        let Some((name, range)) = text.rsplit_once(':') else { return Ok(plain) };
        let Some((low, high)) = range.split_once("..") else { return Ok(plain) };
        let end = |word: &str| -> Result<Option<f64>> {
            if word.trim().is_empty() {
                return Ok(None);
            }
            let value = word.trim().parse().ok().filter(|v: &f64| v.is_finite());
            value.map(Some).with_context(|| {
                format!("`{word}` in `{text}` is no number; a range is given as NAME:MIN..MAX")
            })
        };
        let range = [end(low)?, end(high)?];
        if range[0].is_some() && range[0] == range[1] {
            bail!("the range of `{text}` has no extent; its ends are two numbers");
        }
        Ok(Self { name, range, gradient })
    }

    /// The requested range; open ends come from `find`.
    pub(crate) fn range(&self, find: impl FnOnce() -> Result<(f64, f64)>) -> Result<[f64; 2]> {
        if let [Some(low), Some(high)] = self.range {
            return Ok([low, high]);
        }
        let (low, high) = find()?;
        let range = [self.range[0].unwrap_or(low), self.range[1].unwrap_or(high)];
        let is_beyond = self.has_range() && range[0] > range[1];
        ensure!(
            !is_beyond,
            "all values of `{}` lie beyond that end of the range: they are {} .. {}; give both ends",
            self.name,
            short(low),
            short(high)
        );
        Ok(range)
    }

    /// Whether an end of the range is requested.
    pub(crate) fn has_range(&self) -> bool {
        self.range != [None; 2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_a_name_and_perhaps_a_range() {
        let parse = |text| ColourRequest::parse(text).map(|r| (r.name.to_owned(), r.range));
        assert_eq!(parse("intensity").unwrap(), ("intensity".into(), [None; 2]));
        let name = "gps_time";
        for range in [[None; 2], [Some(-1.5), Some(2e3)], [None, Some(7.0)]] {
            for gradient in [None, Some(Gradient::Turbo)] {
                let known = Parts { name, range, gradient };
                assert_eq!(parts(&known.text()).unwrap(), known, "{}", known.text());
            }
        }
        assert_eq!(parts("a:b:Turbo").unwrap().name, "a:b");
        assert_eq!(parts("a:rainbow").unwrap(), Parts { name: "a:rainbow", ..Parts::default() });
        let both = ("gps_time".into(), [Some(-1.5), Some(2e3)]);
        assert_eq!(parse("gps_time:-1.5..2e3").unwrap(), both);
        assert_eq!(parse("z:..7").unwrap(), ("z".into(), [None, Some(7.0)]));
        assert_eq!(parse("z:7..").unwrap(), ("z".into(), [Some(7.0), None]));
        assert_eq!(parse("odd:name").unwrap().0, "odd:name");
        for wrong in ["z:a..7", "z:1..nan"] {
            assert!(parse(wrong).unwrap_err().to_string().contains("MIN..MAX"), "{wrong}");
        }
        assert!(parse("z:5..5").unwrap_err().to_string().contains("no extent"));
    }
}
