//! Plots error against samples as SVG, with logarithmic axes.

use super::report::{Part, TraceRow};
use std::fmt::Write;

/// Size of the plot, and of the room around the curves, pixels.
const WIDE: f64 = 460.0;
const HIGH: f64 = 300.0;
const ROOM: f64 = 60.0;
/// A curve: filter and sequence of its rows, title, colour, dashes.
const CURVES: [(&str, &str, &str, &str, &str); 5] = [
    ("none", "independent", "unfiltered, independent", "#e80", "5 3"),
    ("none", "z-order", "unfiltered, Z-order", "#e80", ""),
    ("nested", "independent", "nested, independent", "#2a6", "5 3"),
    ("nested", "z-order", "nested, Z-order", "#2a6", ""),
    ("nested-mixed", "z-order", "nested, mixed with the mean", "#26a", ""),
];

/// Square root of the mean square error over samples, from the rows of convergence. A grey line
/// falls with the square root of the number of samples.
pub(super) fn convergence(rows: &[TraceRow]) -> String {
    let of = |filter: &str, sequence: &str| -> Vec<(f64, f64)> {
        let rows = rows.iter().filter(|row| row.part == Part::Convergence);
        let rows = rows.filter(|row| row.filter == filter && row.sequence == sequence);
        let point = |row: &TraceRow| (f64::from(row.samples), row.mse.unwrap_or(0.0));
        let points = rows.map(point).filter(|(_, mse)| *mse > 0.0);
        points.map(|(samples, mse)| (samples, mse.sqrt())).collect()
    };
    let curves: Vec<_> = CURVES.iter().map(|c| (c, of(c.0, c.1))).collect();
    let points = || curves.iter().flat_map(|(_, points)| points);
    let most = points().map(|p| p.0).fold(2.0, f64::max);
    let low = points().map(|p| p.1).fold(f64::MAX, f64::min).log10().floor();
    let high = points().map(|p| p.1).fold(0.0, f64::max).log10().ceil().max(low + 1.0);
    let (width, height) = (WIDE + 2.0 * ROOM, HIGH + 2.0 * ROOM);
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' \
         font-family='sans-serif' font-size='11'>\
         <rect width='100%' height='100%' fill='white'/>\n"
    );
    if points().next().is_none() {
        return svg + "</svg>\n";
    }
    let x = |samples: f64| ROOM + samples.ln() / most.ln() * WIDE;
    let y = |error: f64| ROOM + (high - error.log10()) / (high - low) * HIGH;
    for power in low as i32..=high as i32 {
        let error = 10f64.powi(power);
        line(&mut svg, "#ddd", "", &[(x(1.0), y(error)), (x(most), y(error))]);
        text(&mut svg, 8.0, y(error) + 4.0, "#000", &format!("{error}"));
    }
    let mut samples = 1.0;
    while samples <= most {
        line(&mut svg, "#ddd", "", &[(x(samples), ROOM), (x(samples), ROOM + HIGH)]);
        text(&mut svg, x(samples) - 4.0, ROOM + HIGH + 14.0, "#000", &format!("{samples}"));
        samples *= 2.0;
    }
    text(&mut svg, ROOM + WIDE * 0.4, height - 26.0, "#000", "samples a pixel");
    text(&mut svg, 8.0, 14.0, "#000", "error of 255 (root of the mean square)");
    if let Some((_, first)) = curves[0].1.first() {
        let end = (x(most), y(first / most.sqrt()));
        line(&mut svg, "#999", "2 3", &[(x(1.0), y(*first)), end]);
    }
    for (number, ((_, _, title, colour, dashes), points)) in curves.iter().enumerate() {
        let points: Vec<_> = points.iter().map(|p| (x(p.0), y(p.1))).collect();
        line(&mut svg, colour, dashes, &points);
        let at = 30.0 + 13.0 * (number / 3) as f64;
        text(&mut svg, ROOM + 165.0 * (number % 3) as f64, at, colour, title);
    }
    svg + "</svg>\n"
}

fn line(svg: &mut String, colour: &str, dashes: &str, points: &[(f64, f64)]) {
    let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    // Writing to a string does not fail.
    let _ = writeln!(
        svg,
        "<polyline points='{}' fill='none' stroke='{colour}' stroke-width='1.4' \
         stroke-dasharray='{dashes}'/>",
        path.join(" ")
    );
}

fn text(svg: &mut String, x: f64, y: f64, colour: &str, text: &str) {
    let _ = writeln!(svg, "<text x='{x:.1}' y='{y:.1}' fill='{colour}'>{text}</text>");
}
