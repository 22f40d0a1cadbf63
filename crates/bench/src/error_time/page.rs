//! The page about a scan: plot, advice, pictures at equal time beside their errors, and all rows.

use crate::error_time::columns::{COLUMNS, or_dash};
use crate::error_time::lit::{self, LitRow};
use crate::error_time::perfect::Reference;
use crate::error_time::plot::{error_over_time, error_while_loading};
use crate::error_time::report::{BUDGETS_MS, Scan, streaming_lines};
use crate::error_time::row::Row;
use crate::error_time::streaming::Load;
use anyhow::{Context, Result};
use esker_engine::calls::conditions;
use esker_engine::io::picture::write_png;
use esker_engine::io::quantity::grouped;
use esker_render::Picture;
use esker_truth::flip::flip;
use std::fmt::Write;
use std::path::Path;

/// Width and height of a crop, pixels.
const CROP: [usize; 2] = [240, 160];
/// Pictures that are shown at equal time.
const SHOWN: usize = 3;

/// Pictures at equal time.
pub(super) struct Crops {
    /// Time of a frame that all of them keep, milliseconds.
    pub budget_ms: f64,
    /// What they are compared with.
    pub reference: Reference,
    /// Row of each picture, and the picture.
    pub pictures: Vec<(usize, Picture)>,
}

/// Rows of least error of different methods at the least of the advised times that at least three
/// methods keep, or else at the time that all rows keep. Returns the time and the indices of rows.
pub(super) fn at_equal_time(rows: &[Row]) -> (f64, Vec<usize>) {
    let slowest = rows.iter().map(|row| row.ms).fold(0.0, f64::max);
    let mut chosen = (slowest, Vec::new());
    for budget_ms in BUDGETS_MS.into_iter().chain([slowest]) {
        let mut best: Vec<usize> = Vec::new();
        for (index, row) in rows.iter().enumerate().filter(|(_, row)| row.ms <= budget_ms) {
            match best.iter_mut().find(|other| rows[**other].method == row.method) {
                Some(other) if rows[*other].flip > row.flip => *other = index,
                Some(_) => {}
                None => best.push(index),
            }
        }
        best.sort_by(|a, b| rows[*a].flip.total_cmp(&rows[*b].flip));
        best.truncate(SHOWN);
        let is_enough = best.len() >= SHOWN;
        chosen = (budget_ms, best);
        if is_enough {
            break;
        }
    }
    chosen
}

/// Writes the page and its pictures into `folder`.
///
/// # Errors
/// If a file cannot be written.
pub(super) fn write(
    folder: &Path,
    scan: &Scan,
    (rows, lit): (&[Row], &[LitRow]),
    loads: &[Load],
    crops: &Crops,
) -> Result<()> {
    let name = file_name(&scan.file);
    let plots = [format!("{name}.svg"), format!("{name}-loading.svg")];
    save(&folder.join(&plots[0]), &error_over_time(scan, rows)?)?;
    save(&folder.join(&plots[1]), &error_while_loading(loads)?)?;
    let mut page = String::new();
    // Writing to a string does not fail.
    let _ = write_head(&mut page, scan, &plots[0]);
    let corner = busiest(crops);
    let shown = crop(&crops.reference.rgba, crops.reference.width, corner);
    let file = format!("{name}-reference.png");
    write_png(&shown, &folder.join(&file))?;
    let _ = write!(
        page,
        "<h2>Least errors at {:.0} ms</h2>\n<table>\n<tr><td><img src='{file}'><br>reference: {}\
         </td></tr>\n",
        crops.budget_ms,
        scan.reference()
    );
    for (number, (index, picture)) in crops.pictures.iter().enumerate() {
        let row = &rows[*index];
        let files = [format!("{name}-{number}.png"), format!("{name}-{number}-error.png")];
        let map = flip(&picture.rgba, &crops.reference.rgba, crops.reference.width);
        let map: Vec<u8> = map.into_iter().flat_map(heat).collect();
        let wide = crops.reference.width;
        write_png(&crop(&picture.rgba, wide, corner), &folder.join(&files[0]))?;
        write_png(&crop(&map, wide, corner), &folder.join(&files[1]))?;
        let _ = writeln!(
            page,
            "<tr><td><img src='{}'> <img src='{}'><br>{} ({}, {}): {:.1} ms, FLIP {:.4}</td></tr>",
            files[0], files[1], row.method, row.what, row.backend, row.ms, row.flip
        );
    }
    let _ = write_rows(&mut page, rows);
    let _ = write_lit(&mut page, &lit.iter().collect::<Vec<_>>());
    let _ = write_conditions(&mut page, scan);
    let _ = write_streaming(&mut page, loads, &plots[1]);
    save(&folder.join(format!("{name}.html")), &page)
}

fn save(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| format!("{}: cannot write", path.display()))
}

/// Letters, digits and hyphens of a name.
fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

/// Text in which HTML is not markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn write_head(page: &mut String, scan: &Scan, plot: &str) -> std::fmt::Result {
    let title = escaped(&scan.file);
    write!(
        page,
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'><title>{title}: error against \
         run time</title>\n<style>body {{ font: 15px sans-serif; max-width: 1100px; margin: 2em \
         auto; }} table {{ border-collapse: collapse; }} td, th {{ padding: 2px 8px; text-align: \
         right; }} td:first-child, td:nth-child(2), th:first-child, th:nth-child(2) {{ text-align: \
         left; }} .front {{ background: #fff3d6; }} \
         .beyond {{ background: #fde0dc; }}</style></head><body>\n<h1>{title}: error \
         against run time</h1>\n<p>{} points, pictures of {} x {} pixels.</p>\n<ul>\n",
        grouped(scan.points),
        scan.size[0],
        scan.size[1]
    )?;
    for sentence in scan.sentences() {
        writeln!(page, "<li>{}</li>", escaped(&sentence))?;
    }
    write!(
        page,
        "</ul>\n<img src='{plot}'>\n<p>Each dot is a setting: the mean error of five alignments of the view over \
         the median time of a frame. Bars are quartiles of the time and the range of the errors. \
         Filled dots are drawn by the CPU, rings by the GPU. Vertical lines: 60 and 30 frames a \
         second. Errors near the floor mean nothing.</p>\n"
    )
}

fn write_rows(page: &mut String, rows: &[Row]) -> std::fmt::Result {
    let mut sorted: Vec<&Row> = rows.iter().collect();
    sorted.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
        cells.map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect()
    };
    let titles = COLUMNS.iter().map(|(title, _)| *title).chain(["build s", "MB"]);
    writeln!(page, "</table>\n<h2>All settings</h2>\n<table>")?;
    writeln!(page, "<tr>{}</tr>", cells("th", &mut { titles }))?;
    for row in sorted {
        let build = row.build.as_ref();
        let built = [
            or_dash(build.map(|build| build.seconds)),
            or_dash(build.map(|build| build.bytes as f64 / 1e6)),
        ];
        let front = if row.on_front { " class='front'" } else { "" };
        let own = row.cells();
        let mut all = own.iter().chain(&built).map(String::as_str);
        writeln!(page, "<tr{front}>{}</tr>", cells("td", &mut all))?;
    }
    writeln!(page, "</table>")
}

fn write_lit(page: &mut String, rows: &[&LitRow]) -> std::fmt::Result {
    let Some(heading) = lit::heading(rows) else { return Ok(()) };
    writeln!(page, "<h2>Traced light</h2>\n<p>{heading}.</p>\n<table>")?;
    writeln!(
        page,
        "<tr><th>samples a pixel</th><th>filter</th><th>splats</th><th>ms</th><th>CPU ms</th>\
         <th>FLIP</th><th>off %</th></tr>"
    )?;
    for row in rows {
        writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{:.1}</td><td>{}</td><td>{:.4}</td>\
             <td>{:.2}</td></tr>",
            row.samples,
            row.filter,
            grouped(row.points),
            row.ms,
            or_dash(row.cpu_ms),
            row.flip,
            row.off_share * 100.0
        )?;
    }
    writeln!(page, "</table>")
}

fn write_conditions(page: &mut String, scan: &Scan) -> std::fmt::Result {
    let report = &scan.conditions;
    writeln!(
        page,
        "<h2>How difficult the scan is</h2>\n<p>Conditions of {} cells with {} points, evenly spread \
         over the scan, beside the values up to which pictures are rated. What is beyond them may \
         look wrong, as docs/limits.md of the project says.</p>\n<table>\n<tr><th>condition</th>\
         <th>value</th><th>typical</th><th>hardest cell</th><th>rated to</th></tr>",
        grouped(report.cells_read as u64),
        grouped(report.points_read)
    )?;
    for row in &report.conditions {
        let is_beyond = row.rated.iter().any(|rated| !rated.is_within);
        let class = if is_beyond { " class='beyond'" } else { "" };
        let cells: String = conditions::cells(row)
            .iter()
            .map(|cell| format!("<td>{}</td>", escaped(cell)))
            .collect();
        writeln!(page, "<tr{class}>{cells}</tr>")?;
    }
    writeln!(page, "</table>")
}

fn write_streaming(page: &mut String, loads: &[Load], plot: &str) -> std::fmt::Result {
    writeln!(
        page,
        "<h2>While streaming</h2>\n<p>Error of the shown frame against the finished one, from an \
         empty cache, by order of loading.</p>\n<img src='{plot}'>\n<ul>"
    )?;
    for line in streaming_lines(loads.iter()) {
        writeln!(page, "<li>{}</li>", escaped(&line))?;
    }
    writeln!(page, "</ul>\n</body></html>")
}

/// Corner of the crop in which the pictures differ most from the reference.
fn busiest(crops: &Crops) -> [usize; 2] {
    let width = crops.reference.width;
    let height = crops.reference.depth.len() / width.max(1);
    let mut sums = vec![0u64; (width + 1) * (height + 1)];
    for y in 0..height {
        for x in 0..width {
            let at = (y * width + x) * 4;
            let off = |picture: &Picture| {
                let own = picture.rgba.get(at..at + 3).unwrap_or_default();
                own.iter().zip(&crops.reference.rgba[at..]).map(|(a, b)| a.abs_diff(*b)).max()
            };
            let off: u64 = crops.pictures.iter().filter_map(|(_, p)| off(p)).map(u64::from).sum();
            // Sums of all pixels to the left and above.
            let index = |x: usize, y: usize| y * (width + 1) + x;
            sums[index(x + 1, y + 1)] =
                off + sums[index(x, y + 1)] + sums[index(x + 1, y)] - sums[index(x, y)];
        }
    }
    let [wide, high] = [CROP[0].min(width), CROP[1].min(height)];
    let at = |x: usize, y: usize| sums[y * (width + 1) + x];
    let inside =
        |x: usize, y: usize| at(x + wide, y + high) + at(x, y) - at(x + wide, y) - at(x, y + high);
    let places = (0..=height - high).step_by(8);
    let places = places.flat_map(|y| (0..=width - wide).step_by(8).map(move |x| [x, y]));
    places.max_by_key(|[x, y]| inside(*x, *y)).unwrap_or([0, 0])
}

/// The crop of a picture with rows of `width` pixels, four bytes each.
fn crop(rgba: &[u8], width: usize, [x, y]: [usize; 2]) -> Picture {
    let height = rgba.len() / 4 / width.max(1);
    let [wide, high] = [CROP[0].min(width), CROP[1].min(height)];
    let rows = (y..y + high).flat_map(|row| {
        let first = (row * width + x) * 4;
        rgba[first..first + wide * 4].iter().copied()
    });
    Picture { width: wide as u32, height: high as u32, rgba: rows.collect(), ..Picture::default() }
}

/// Colour of an error from 0 to 1: black, violet, orange, yellow.
fn heat(error: f32) -> [u8; 4] {
    const STOPS: [[f32; 3]; 5] = [
        [0.0, 0.0, 4.0],
        [81.0, 18.0, 124.0],
        [183.0, 55.0, 121.0],
        [252.0, 137.0, 97.0],
        [252.0, 253.0, 191.0],
    ];
    // Errors of a tenth are plainly visible.
    let place = error.clamp(0.0, 1.0).sqrt() * (STOPS.len() - 1) as f32;
    let low = (place as usize).min(STOPS.len() - 2);
    let mix = place - low as f32;
    let value = |i: usize| (STOPS[low][i] * (1.0 - mix) + STOPS[low + 1][i] * mix) as u8;
    [value(0), value(1), value(2), 255]
}
