//! Exporting as a call: an .esker file with all that it names, or the part of it that is wanted, as
//! a scan; the polygon that the user names, and the report as JSON and as text.

use crate::draw::empty_picture;
use crate::io::output;
use crate::io::quantity::{grouped, readable_bytes};
use crate::machine::pool;
use anyhow::{Context, Result, bail, ensure};
use esker_builder::Exported;
use esker_format::Forest;
use esker_points::filter::{Polygon, Ring};
use esker_points::{Filter, Task};
use serde_json::{Value, json};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Instant;

/// Bytes of a polygon's file at most.
const POLYGON_BYTES_MAX: u64 = 64 << 20;

/// Writes the points of `file`, and of those that it names, that `filter` wants to `out`, on so
/// many threads (0: one a core).
///
/// # Errors
/// Where the file is damaged, nothing is wanted, the disk is full, or on request; nothing is left
/// under the final name.
pub fn export(
    file: &Path,
    out: &Path,
    filter: &Filter,
    threads: usize,
    task: &dyn Task,
) -> Result<(Exported, f64)> {
    let start = Instant::now();
    output::may_write(out, &[file.to_owned()])?;
    let report = pool::run(threads, || {
        let forest = Forest::open(file)?;
        let trees: Vec<_> = forest.files().map(|tree| tree.path().to_owned()).collect();
        output::may_write(out, &trees)?;
        let scans = forest.files().flat_map(|tree| &tree.metadata().sources);
        output::may_replace(out, output::folder_of(file), scans.map(|scan| scan.path.as_str()))?;
        empty_picture::check_classes(&forest, filter)?;
        Ok(esker_builder::export(&forest, out, filter, task)?)
    })?;
    Ok((report, start.elapsed().as_secs_f64()))
}

/// Parses the polygon of `word`: corners (`x,y x,y x,y`), or a file of such lines or of GeoJSON.
///
/// # Errors
/// If `word` is neither corners nor a readable file of corners.
pub fn polygon(word: &str) -> Result<Polygon> {
    let has_corners = word.split_whitespace().filter(|w| w.contains(',')).count() > 1;
    if has_corners && !Path::new(word).exists() {
        return Ok(word.parse()?);
    }
    let file = File::open(word).with_context(|| {
        format!("{word}: cannot read the polygon; name a file, or corners as \"x,y x,y x,y\"")
    })?;
    let mut text = String::new();
    let read = file.take(POLYGON_BYTES_MAX + 1).read_to_string(&mut text);
    read.with_context(|| format!("{word}: cannot read the polygon"))?;
    ensure!(text.len() as u64 <= POLYGON_BYTES_MAX, "{word}: is too long for a polygon");
    let text = text.trim_start_matches('\u{feff}');
    let polygon = if text.trim_start().starts_with('{') { geo_json(text) } else { lines(text) };
    polygon.with_context(|| format!("{word}: is no polygon"))
}

/// Lines of x and y, and maybe a height, which does not matter; or all corners on one line. An
/// empty line begins another ring (a hole, or an island), `#` a comment; a first line without a
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

/// The corner that a line names.
fn corner(line: usize, words: &[String]) -> Result<[f64; 2]> {
    let read = |word: &String| {
        word.parse().with_context(|| format!("line {line} has `{word}`, which is no number"))
    };
    match words {
        [x, y] | [x, y, _] => Ok([read(x)?, read(y)?]),
        _ => {
            let shown: String = words.join(" ").chars().take(40).collect();
            bail!("line {line} is `{shown}`, not x and y")
        }
    }
}

/// All polygons in a GeoJSON object (RFC 7946), in the coordinates of the scan.
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
        // A feature may be without a place.
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

/// The report for machines.
pub fn json(report: &Exported, seconds: f64) -> Value {
    json!({
        "points_in": report.points_in,
        "points_out": report.points_out,
        "multiset_hash": report.hash.to_string(),
        "filtered": !report.is_whole,
        "hash_equal": report.is_whole.then_some(true),
        "trees": report.trees,
        "nodes": report.nodes,
        "nodes_read": report.nodes_read,
        "bytes_read": report.bytes_read,
        "bytes_out": report.bytes_out,
        "format": report.format,
        "seconds": seconds,
        "points_per_second": report.points_out as f64 / seconds.max(1e-9),
        "notes": report.notes,
    })
}

/// The report for people.
pub fn text(report: &Exported, seconds: f64, out: &Path) -> String {
    let mut lines = vec![format!(
        "{}: {}, {} points, {} ({:.1} bytes a point), in {seconds:.1} s",
        out.display(),
        report.format,
        grouped(report.points_out),
        readable_bytes(report.bytes_out),
        report.bytes_out as f64 / report.points_out.max(1) as f64,
    )];
    lines.push(if report.is_whole {
        let of = if report.trees > 1 { "of all trees" } else { "of the file" };
        format!("proof: all points {of}, multiset hash {}", report.hash)
    } else {
        format!(
            "filtered: {} of {} points, from {} of {} nodes, multiset hash {}",
            grouped(report.points_out),
            grouped(report.points_in),
            grouped(report.nodes_read),
            grouped(report.nodes),
            report.hash
        )
    });
    lines.extend(report.notes.iter().map(|n| format!("note: {n}")));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_are_corners_or_files_of_lines_or_of_geo_json() {
        let square = polygon("0,0 4,0 4,4 0,4").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = |text: &str| {
            let path = folder.path().join("polygon");
            std::fs::write(&path, text).unwrap();
            polygon(path.to_str().unwrap())
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
        assert!(
            format!("{:#}", polygon("nowhere.geojson").unwrap_err()).contains("nowhere.geojson")
        );
    }
}
