//! The plot of frame times of the last seconds, with their median and 99th percentile.

use crate::theme;
use crate::times::Times;
use eframe::egui::{Rangef, RichText, Ui};
use egui_plot::{HLine, Line, Plot, PlotPoints};

/// Upper end of the plot at least, milliseconds.
const MS_MIN: f64 = 20.0;

/// Shows the frame times.
pub fn show(ui: &mut Ui, times: &Times) {
    let inks = theme::inks(ui);
    let [median, late] = [0.5, 0.99].map(|share| times.quantile_ms(share));
    ui.horizontal(|ui| {
        let about = "Times from picture to picture: half are below p50, 99 of 100 below p99";
        ui.label(RichText::new("frames").color(inks.faint)).on_hover_text(about);
        ui.label(RichText::new(format!("p50 {median:.1}")).monospace().color(inks.accent));
        ui.label(RichText::new(format!("p99 {late:.1} ms")).monospace().color(inks.cool));
    });
    let last = times.frames().last().map_or(0.0, |f| f.at_s);
    let points: PlotPoints<'_> = times.frames().map(|f| [f.at_s - last, f.interval_ms]).collect();
    let work: PlotPoints<'_> = times.frames().map(|f| [f.at_s - last, f.work_ms]).collect();
    Plot::new("frames")
        .height(84.0)
        .grid_color(inks.text.gamma_multiply(0.18))
        .show_axes([false, true])
        .y_axis_min_width(24.0)
        .grid_spacing(Rangef::new(8.0, 40.0))
        .include_y(0.0)
        .include_y(MS_MIN)
        .include_x(-times.window_s())
        .include_x(0.0)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .show_x(false)
        .show_y(false)
        .show(ui, |plot| {
            plot.hline(HLine::new("p99", late).color(inks.cool).width(1.0));
            plot.line(Line::new("work", work).color(inks.faint).width(1.0));
            plot.line(Line::new("frame", points).color(inks.accent).width(1.4));
        });
}
