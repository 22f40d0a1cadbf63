//! Plots panels of curves in a grid, as SVG. The horizontal axis is logarithmic, the vertical one
//! begins at zero.

use std::fmt::Write;

/// Width and height of the curves of a panel, and space around them, pixels.
const WIDE: f64 = 170.0;
const HIGH: f64 = 90.0;
const ROOM: [f64; 2] = [50.0, 50.0];
/// Colour and dashes of each curve.
const STYLES: [(&str, &str); 4] = [("#2a6", ""), ("#e80", ""), ("#2a6", "4 3"), ("#e80", "4 3")];

/// Curves over a common axis.
pub struct Panel {
    /// Title of the panel.
    pub title: String,
    /// Name and points of each curve.
    pub curves: Vec<(&'static str, Vec<(f64, f64)>)>,
    /// Title of the horizontal axis.
    pub x: &'static str,
}

/// Draws rows of panels below a legend. Panels without points are left empty.
pub fn grid(rows: &[Vec<Panel>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let [wide, high] = [WIDE + ROOM[0], HIGH + ROOM[1]];
    let (width, height) = (columns as f64 * wide + 20.0, rows.len() as f64 * high + 40.0);
    let mut svg = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' font-family='sans-serif' \
         font-size='10'><rect width='100%' height='100%' fill='white'/>\n"
    );
    let names = rows.iter().flatten().next().map_or(&[][..], |p| &p.curves);
    let mut at = 20.0;
    for ((name, _), style) in names.iter().zip(STYLES) {
        line(&mut svg, style, &format!("M{at} 16H{}", at + 24.0));
        text(&mut svg, at + 30.0, 20.0, name);
        at += 60.0 + 6.0 * name.len() as f64;
    }
    for (y, row) in rows.iter().enumerate() {
        for (x, panel) in row.iter().enumerate() {
            draw(&mut svg, panel, x as f64 * wide + ROOM[0], y as f64 * high + 50.0);
        }
    }
    svg + "</svg>\n"
}

fn draw(svg: &mut String, panel: &Panel, left: f64, top: f64) {
    let places = || panel.curves.iter().flat_map(|c| &c.1);
    let (low, high) = places().fold((f64::MAX, 0f64), |(l, h), p| (l.min(p.0), h.max(p.0)));
    if low > high {
        return;
    }
    let greatest = places().map(|p| p.1).fold(0.0, f64::max).max(1e-9);
    let x = |v: f64| left + (v / low).ln() / (high / low).ln() * WIDE;
    let y = |v: f64| top + HIGH - v.max(0.0) / greatest * HIGH;
    let axes = format!("M{left} {top}V{}H{}", top + HIGH, left + WIDE);
    line(svg, ("#888", ""), &axes);
    text(svg, left, top - 4.0, &panel.title);
    text(svg, left - 34.0, top + 8.0, &short(greatest));
    text(svg, left - 12.0, top + HIGH, "0");
    text(svg, left - 4.0, top + HIGH + 12.0, &short(low));
    text(svg, left + WIDE - 8.0, top + HIGH + 12.0, &short(high));
    text(svg, left + WIDE * 0.3, top + HIGH + 12.0, panel.x);
    for ((_, curve), style) in panel.curves.iter().zip(STYLES) {
        let points = curve
            .iter()
            .enumerate()
            .map(|(i, p)| format!("{}{:.1} {:.1}", if i == 0 { 'M' } else { 'L' }, x(p.0), y(p.1)));
        line(svg, style, &points.collect::<String>());
    }
}

/// Formats a number with three digits.
fn short(value: f64) -> String {
    match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v if v >= 0.1 => format!("{v:.2}"),
        v => format!("{v:.4}"),
    }
}

fn line(svg: &mut String, (colour, dashes): (&str, &str), path: &str) {
    // Writing to a string does not fail.
    let _ = writeln!(
        svg,
        "<path d='{path}' fill='none' stroke='{colour}' stroke-width='1.4' stroke-dasharray='{dashes}'/>"
    );
}

fn text(svg: &mut String, x: f64, y: f64, text: &str) {
    let _ = writeln!(svg, "<text x='{x:.1}' y='{y:.1}'>{text}</text>");
}
