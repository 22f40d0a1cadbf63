//! The polygon of a filter, from the command line: corners, or a file of corners or of GeoJSON
//! (RFC 7946).

use anyhow::{Context, Result, bail, ensure};
use esker_points::filter::{Polygon, Ring};
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of a file.
const FILE_BYTES_MAX: u64 = 64 << 20;

/// Parses the polygon of `word`: corners (`x,y x,y x,y`), or a file of such lines or of GeoJSON.
///
/// # Errors
/// If `word` is neither corners nor a readable file of corners.
pub fn read(word: &str) -> Result<Polygon> {
    read_in(word, Path::new(""))
}

/// As [`read`], with files relative to `folder`.
///
/// # Errors
/// If `word` is neither corners nor a readable file of corners.
pub fn read_in(word: &str, folder: &Path) -> Result<Polygon> {
    let has_corners = word.split_whitespace().filter(|w| w.contains(',')).count() > 1;
    let path = folder.join(word);
    if has_corners && !path.exists() {
        return Ok(word.parse()?);
    }
    let word = path.display();
    let file = File::open(&path).with_context(|| {
        format!("{word}: cannot read the polygon; name a file, or corners as \"x,y x,y x,y\"")
    })?;
    let mut text = String::new();
    let result = file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text);
    result.with_context(|| format!("{word}: cannot read the polygon"))?;
    ensure!(text.len() as u64 <= FILE_BYTES_MAX, "{word}: is too long for a polygon");
    let text = text.trim_start_matches('\u{feff}');
    let polygon = if text.trim_start().starts_with('{') { geo_json(text) } else { lines(text) };
    polygon.with_context(|| format!("{word}: is no polygon"))
}

/// Parses lines of x, y and an optional height, which is ignored; or a single line of all corners.
/// An empty line begins another ring (a hole, or an island), `#` a comment; a first line without a
/// number is a heading.
fn lines(text: &str) -> Result<Polygon> {
    let words = |line: &'_ str| -> Vec<String> {
        let line = line.split('#').next().unwrap_or_default();
        let words = line.split(|c: char| c.is_whitespace() || c == ',' || c == ';');
        words.filter(|word| !word.is_empty()).map(str::to_owned).collect()
    };
    let rows = (1..).zip(text.lines()).filter(|(_, line)| !line.trim_start().starts_with('#'));
    let mut rows: Vec<(usize, Vec<String>)> = rows.map(|(n, line)| (n, words(line))).collect();
    let first = rows.iter().position(|(_, words)| !words.is_empty());
    let is_heading = |i: &usize| rows[*i].1.iter().all(|word| word.parse::<f64>().is_err());
    if let Some(heading) = first.filter(is_heading) {
        rows.remove(heading);
    }
    if let [(_, words)] =
        &rows.iter().filter(|(_, words)| !words.is_empty()).collect::<Vec<_>>()[..]
    {
        return Ok(words.join(" ").parse()?);
    }
    let rings = rows.split(|(_, words)| words.is_empty()).filter(|ring| !ring.is_empty());
    let rings = rings.map(|ring| ring.iter().map(|(n, words)| corner(*n, words)).collect());
    Ok(Polygon::new(rings.collect::<Result<_>>()?)?)
}

/// Corner on a line.
fn corner(line: usize, words: &[String]) -> Result<[f64; 2]> {
    let number = |word: &String| {
        word.parse().with_context(|| format!("line {line} has `{word}`, which is no number"))
    };
    match words {
        [x, y] | [x, y, _] => Ok([number(x)?, number(y)?]),
        _ => {
            let shown: String = words.join(" ").chars().take(40).collect();
            bail!("line {line} is `{shown}`, not x and y")
        }
    }
}

/// All polygons of a GeoJSON object, in the coordinates of the scan.
fn geo_json(text: &str) -> Result<Polygon> {
    let value: Value = serde_json::from_str(text)?;
    let mut polygons = Vec::new();
    gather(&value, &mut polygons)?;
    Ok(Polygon::any_of(polygons)?)
}

fn gather(value: &Value, polygons: &mut Vec<Vec<Ring>>) -> Result<()> {
    let each = |list: &Value, polygons: &mut _| -> Result<()> {
        list.as_array().into_iter().flatten().try_for_each(|v| gather(v, polygons))
    };
    match value["type"].as_str() {
        // A feature may have no geometry.
        None if value.is_null() => Ok(()),
        Some("FeatureCollection") => each(&value["features"], polygons),
        Some("GeometryCollection") => each(&value["geometries"], polygons),
        Some("Feature") => gather(&value["geometry"], polygons),
        Some("Polygon") => {
            polygons.push(rings(&value["coordinates"])?);
            Ok(())
        }
        Some("MultiPolygon") => {
            for polygon in value["coordinates"].as_array().into_iter().flatten() {
                polygons.push(rings(polygon)?);
            }
            Ok(())
        }
        Some(other) => bail!("it has a `{other}`; only polygons have an inside"),
        None => bail!("an object of GeoJSON has no type"),
    }
}

fn rings(polygon: &Value) -> Result<Vec<Ring>> {
    let ring = |ring: &Value| {
        let corner = |c: &Value| Some([c.get(0)?.as_f64()?, c.get(1)?.as_f64()?]);
        let corners: Option<Ring> = ring.as_array().into_iter().flatten().map(corner).collect();
        corners.context("a corner is not two numbers")
    };
    polygon.as_array().into_iter().flatten().map(ring).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_is_corners_or_a_file_of_lines_or_of_geo_json() {
        let square = read("0,0 4,0 4,4 0,4").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = |text: &str| {
            let path = folder.path().join("polygon");
            std::fs::write(&path, text).unwrap();
            read(path.to_str().unwrap())
        };
        for text in [
            "# a square\n0 0\n4 0\n4 4\n0 4\n",
            "x,y,z\r\n0,0,7\r\n4,0,7\r\n4,4,8 # high\r\n0,4,7\r\n",
            "\u{feff}0 0 4 0 4 4 0 4\n",
        ] {
            assert_eq!(file(text).unwrap(), square, "{text}");
        }
        let hole = "0 0\n9 0\n9 9\n0 9\n\n3 3\n3 5\n5 5\n";
        let outer = vec![[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]];
        let inner = vec![[3.0, 3.0], [3.0, 5.0], [5.0, 5.0]];
        assert_eq!(file(hole).unwrap(), Polygon::new(vec![outer, inner]).unwrap());
        let ring = "[[0,0],[4,0],[4,4],[0,4]]";
        for text in [
            format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#),
            format!(r#"{{"type":"MultiPolygon","coordinates":[[{ring}]]}}"#),
            format!(
                r#"{{"type":"FeatureCollection","features":[{{"type":"Feature","properties":{{}},
                "geometry":{{"type":"Polygon","coordinates":[{ring}]}}}},
                {{"type":"Feature","properties":{{}},"geometry":null}}]}}"#
            ),
        ] {
            assert_eq!(file(&text).unwrap(), square, "{text}");
        }
        for (text, word) in [
            ("", "three corners"),
            ("0 0\n1 1\n2", "line 3 is `2`, not x and y"),
            ("0 0\n1 x\n2 2", "line 2 has `x`"),
            ("{", "EOF"),
            (r#"{"type":"Point","coordinates":[1,2]}"#, "`Point`"),
            (r#"{"type":"Polygon","coordinates":[[[1],[2],[3]]]}"#, "two numbers"),
            (r#"{"type":"Polygon"}"#, "three corners"),
        ] {
            let error = format!("{:#}", file(text).unwrap_err());
            assert!(error.contains(word), "{error}");
        }
        assert!(format!("{:#}", read("nowhere.geojson").unwrap_err()).contains("nowhere.geojson"));
    }
}
