//! The plot of error against time, on logarithmic axes.

use crate::error_time::report::Scan;
use crate::error_time::row::Row;
use crate::error_time::streaming::Load;
use anyhow::{Result, anyhow};
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// Ends of a line on the plot, pixels.
type Ends = std::array::IntoIter<(i32, i32), 2>;

/// Width and height of plots, and width of the list beside the first one, pixels.
const SIZE: (u32, u32) = (860, 540);
const LIST_WIDTH: u32 = 360;
/// Height of a line of the list, and size of its letters and of the numbers at dots, pixels.
const LINE: i32 = 19;
const LETTERS: u32 = 13;
/// Frame times with a line of their own, milliseconds.
const FRAMES_MS: [f64; 2] = [16.0, 33.0];
/// The floor is drawn at most this many times below the least error.
const FLOOR_BELOW: f64 = 2.0;
/// Colour of each method.
const METHODS: [(&str, RGBColor); 5] = [
    ("points", RGBColor(120, 120, 120)),
    ("pull-push", RGBColor(31, 119, 180)),
    ("auto", RGBColor(44, 160, 44)),
    ("ewa", RGBColor(214, 39, 40)),
    ("lit", RGBColor(148, 103, 189)),
];

/// Draws FLIP over milliseconds: quartiles of the time and the range of the alignments as bars, the
/// Pareto front as a line with numbers and a list of its settings, the floor as a dashed line.
///
/// # Errors
/// If the plot cannot be drawn.
pub(super) fn error_over_time(scan: &Scan, rows: &[Row]) -> Result<String> {
    let mut svg = String::new();
    draw(&mut svg, scan, rows).map_err(|fault| anyhow!("cannot draw the plot: {fault}"))?;
    Ok(svg)
}

fn draw(
    svg: &mut String,
    scan: &Scan,
    rows: &[Row],
) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
    let root = SVGBackend::with_string(svg, (SIZE.0 + LIST_WIDTH, SIZE.1)).into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root.split_horizontally(SIZE.0);
    let least = |values: &mut dyn Iterator<Item = f64>| values.fold(f64::MAX, f64::min).max(1e-6);
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(1e-6, f64::max);
    let times = least(&mut rows.iter().map(|r| r.ms_quartiles[0])) / 1.3
        ..most(&mut rows.iter().map(|r| r.ms_quartiles[1]).chain(FRAMES_MS)) * 1.3;
    let lowest = least(&mut rows.iter().map(|r| r.flip_range[0]));
    // A floor far below all errors would leave no room for them.
    let floor = scan.floor_flip.max(lowest / FLOOR_BELOW);
    let errors = lowest.min(floor) / 1.3..most(&mut rows.iter().map(|r| r.flip_range[1])) * 1.3;
    let mut chart = ChartBuilder::on(&left)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d(times.clone().log_scale(), errors.clone().log_scale())?;
    chart
        .configure_mesh()
        .x_desc("milliseconds a frame")
        .y_desc("error (mean FLIP)")
        .x_label_formatter(&|ms| format!("{ms:.0}"))
        .y_label_formatter(&|flip| format!("{flip:.3}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    let upright = |ms: f64| [(ms, errors.start), (ms, errors.end)];
    for ms in FRAMES_MS {
        let style = RGBColor(150, 150, 150).stroke_width(1);
        chart.draw_series([PathElement::new(upright(ms), style)])?;
    }
    let style = BLACK.stroke_width(1);
    chart
        .draw_series(DashedLineSeries::new(
            [(times.start, floor), (times.end, floor)],
            6,
            4,
            style,
        ))?
        .label(format!("floor {:.4}: the reference, a step of the lattice aside", scan.floor_flip))
        .legend(move |(x, y)| dashes(x, y, style));
    let mut front: Vec<&Row> = rows.iter().filter(|row| row.on_front).collect();
    front.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    let line = front.iter().map(|row| (row.ms, row.flip));
    chart
        .draw_series(LineSeries::new(line, RGBColor(255, 160, 0).stroke_width(2)))?
        .label("least error at this time")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], RGBColor(255, 160, 0)));
    for (method, colour) in METHODS {
        let own: Vec<&Row> = rows.iter().filter(|row| row.method == method).collect();
        if own.is_empty() {
            continue;
        }
        let bars = own.iter().flat_map(|row| {
            let [low, high] = row.ms_quartiles;
            let [near, far] = row.flip_range;
            [
                PathElement::new([(low, row.flip), (high, row.flip)], colour),
                PathElement::new([(row.ms, near), (row.ms, far)], colour),
            ]
        });
        chart.draw_series(bars)?;
        let dots = own.iter().map(|row| {
            let fill = if row.backend == "gpu" { colour.stroke_width(2) } else { colour.filled() };
            Circle::new((row.ms, row.flip), if row.on_front { 6 } else { 4 }, fill)
        });
        chart
            .draw_series(dots)?
            .label(method)
            .legend(move |(x, y)| Circle::new((x + 8, y), 4, colour.filled()));
    }
    let numbers = front.iter().enumerate().map(|(at, row)| {
        let number = Text::new((at + 1).to_string(), (5, -18), ("sans-serif", LETTERS));
        EmptyElement::at((row.ms, row.flip)) + number
    });
    chart.draw_series(numbers)?;
    // No setting is fast and close to the reference at once: that corner has room.
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerLeft)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK)
        .draw()?;
    for (at, line) in list(&front).into_iter().enumerate() {
        let place = (6, 16 + LINE * at as i32);
        right.draw(&Text::new(line, place, ("sans-serif", LETTERS)))?;
    }
    root.present()
}

/// Lines about the settings on the front: number, time, error, and options on the command line. Of
/// many the slowest are left out.
fn list(front: &[&Row]) -> Vec<String> {
    let mut lines = vec!["Least error at each time: ms, FLIP, options".to_owned()];
    let most = (SIZE.1 as i32 / LINE) as usize - 2;
    lines.extend(front.iter().take(most).enumerate().map(|(at, row)| {
        let own = || format!("{}, {} (benchmark alone)", row.method, row.what);
        let options = row.options.clone().unwrap_or_else(own);
        format!("{}:  {:.1}  {:.4}  {options}", at + 1, row.ms, row.flip)
    }));
    lines
}

/// Height of the plot of loading, pixels.
const LOADING_HEIGHT: u32 = 360;
/// Colours of views, and of the path.
const VIEWS: [RGBColor; 4] =
    [RGBColor(31, 119, 180), RGBColor(214, 39, 40), RGBColor(44, 160, 44), RGBColor(120, 120, 120)];

/// Draws FLIP against the finished frame over milliseconds, a curve for each view and order of
/// loading; that of the nearest first is dashed.
///
/// # Errors
/// If the plot cannot be drawn.
pub(super) fn error_while_loading(loads: &[Load]) -> Result<String> {
    let mut svg = String::new();
    draw_loading(&mut svg, loads).map_err(|fault| anyhow!("cannot draw the plot: {fault}"))?;
    Ok(svg)
}

fn draw_loading(
    svg: &mut String,
    loads: &[Load],
) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
    let root = SVGBackend::with_string(svg, (SIZE.0, LOADING_HEIGHT)).into_drawing_area();
    root.fill(&WHITE)?;
    let points = || loads.iter().flat_map(|load| &load.curve);
    let most = |i: usize| points().map(|point| point[i]).fold(1e-3, f64::max) * 1.05;
    let first = points().map(|point| point[0]).fold(f64::MAX, f64::min).clamp(0.1, most(0) / 2.0);
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d((first..most(0)).log_scale(), 0.0..most(1))?;
    chart
        .configure_mesh()
        .x_desc("milliseconds since the session was opened")
        .y_desc("error (mean FLIP)")
        .x_label_formatter(&|ms| format!("{ms:.0}"))
        .light_line_style(RGBColor(240, 240, 240))
        .draw()?;
    let mut views: Vec<&str> = loads.iter().map(|load| load.view.as_str()).collect();
    views.dedup();
    for load in loads {
        let view = views.iter().position(|view| *view == load.view).unwrap_or(0);
        let style = VIEWS[view % VIEWS.len()].stroke_width(2);
        let curve = load.curve.iter().map(|[ms, flip]| (ms.max(first), *flip));
        let label = format!("{}, {}", load.view, load.priority);
        if load.priority == "distance" {
            chart
                .draw_series(DashedLineSeries::new(curve, 6, 4, style))?
                .label(label)
                .legend(move |(x, y)| dashes(x, y, style));
        } else {
            chart
                .draw_series(LineSeries::new(curve, style))?
                .label(label)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], style));
        }
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.85)).border_style(BLACK).draw()?;
    root.present()
}

/// The sign of a dashed line in a legend.
fn dashes(x: i32, y: i32, style: ShapeStyle) -> DashedPathElement<Ends, i32> {
    DashedPathElement::new([(x, y), (x + 16, y)], 6, 4, style)
}
