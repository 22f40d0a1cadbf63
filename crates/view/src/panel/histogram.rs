//! A histogram with two handles that choose a range of values: the bars within it have the colours
//! of their values. The handles are dragged, or moved by the arrow keys, and the numbers below are
//! edited.

use super::names;
use super::widgets::note;
use crate::theme;
use eframe::egui::{
    Color32, CursorIcon, DragValue, EventFilter, Id, Key, Modifiers, Rect, Sense, Stroke, Ui,
    WidgetInfo, pos2, vec2,
};
use esker_engine::cameras::histogram::Histogram;
use esker_engine::io::quantity::grouped;

/// Height of the bars, points.
const HEIGHT: f32 = 54.0;
/// Width of what can be grabbed of a handle, points.
const GRIP: f32 = 12.0;
/// Height of the visible grip, points.
const KNOB: f32 = 14.0;
/// Shares of the histogram's width: between the handles at least, and a step of an arrow key.
const GAP: f64 = 0.002;
const STEP: f64 = 0.01;
/// Names of the ends.
const ENDS: [&str; 2] = ["lower", "upper"];

/// Shows `histogram`, called `name`, with the colours of the range from its first to its last
/// value. Changes `range` as the user moves its ends, and returns whether it has changed.
pub fn show(
    ui: &mut Ui,
    (name, unit): (&str, Option<&str>),
    histogram: &Histogram,
    colours: &[[u8; 3]],
    range: &mut [f64; 2],
) -> bool {
    let before = *range;
    // Handles at the ends stay within the panel.
    let size = vec2(ui.available_width(), HEIGHT);
    let (all, _) = ui.allocate_exact_size(size, Sense::hover());
    let extent = histogram.range[1] - histogram.range[0];
    // A key moves an end of whole numbers to the next one at least.
    let step = (extent * STEP).max(if histogram.is_whole { 1.0 } else { 0.0 });
    let axis = Axis { rect: all.shrink2(vec2(GRIP / 2.0, 0.0)), of: histogram.range, step };
    bars(ui, &axis, histogram, colours, *range);
    for end in [0, 1] {
        handle(ui, &axis, (name, end), range);
    }
    numbers(ui, name, histogram, range);
    let what = match histogram.sample {
        Some(points) => format!("of a sample of {} points", grouped(points)),
        None => "of all points".to_owned(),
    };
    let unit = unit.map_or(String::new(), |unit| format!(", {}", names::plural(unit)));
    note(ui, &format!("{name}{unit}, {what}"));
    *range != before
}

/// Where values lie in the window.
struct Axis {
    rect: Rect,
    of: [f64; 2],
    /// What an arrow key moves an end by.
    step: f64,
}

impl Axis {
    fn x(&self, value: f64) -> f32 {
        let share = (value - self.of[0]) / (self.of[1] - self.of[0]);
        self.rect.left() + self.rect.width() * share.clamp(0.0, 1.0) as f32
    }

    fn value(&self, x: f32) -> f64 {
        let share = f64::from((x - self.rect.left()) / self.rect.width().max(1.0));
        self.of[0] + (self.of[1] - self.of[0]) * share.clamp(0.0, 1.0)
    }

    fn extent(&self) -> f64 {
        self.of[1] - self.of[0]
    }
}

fn bars(ui: &Ui, axis: &Axis, histogram: &Histogram, colours: &[[u8; 3]], [low, high]: [f64; 2]) {
    let (painter, inks) = (ui.painter(), theme::inks(ui));
    painter.rect_filled(axis.rect.expand2(vec2(GRIP / 2.0, 0.0)), 3.0, inks.ground);
    let most = histogram.counts.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let bins = histogram.counts.len().max(1) as f64;
    let width = axis.extent() / bins;
    for (i, &count) in histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
        let from = axis.of[0] + width * i as f64;
        // A root shows bins of few points too.
        let height = (HEIGHT - 6.0) * (count / most).sqrt() as f32;
        let bar = Rect::from_min_max(
            pos2(axis.x(from), axis.rect.bottom() - height.max(1.0)),
            pos2(axis.x(from + width), axis.rect.bottom()),
        );
        let middle = from + width / 2.0;
        let share = (middle - low) / (high - low);
        let colour = match colours.len() {
            _ if !(low..=high).contains(&middle) => inks.faint.gamma_multiply(0.5),
            0 => inks.cool,
            n => {
                let at = (share.clamp(0.0, 1.0) * (n - 1) as f64).round() as usize;
                let [r, g, b] = colours[at];
                Color32::from_rgb(r, g, b)
            }
        };
        painter.rect_filled(bar, 0.0, colour);
    }
}

/// A handle at an end of the range, 0 for the lower one.
fn handle(ui: &Ui, axis: &Axis, (name, end): (&str, usize), range: &mut [f64; 2]) {
    let at = axis.x(range[end]);
    let grip = Rect::from_x_y_ranges(at - GRIP / 2.0..=at + GRIP / 2.0, axis.rect.y_range());
    let id = ui.scope_id().with(("range", name, end));
    let response = ui.interact(grip, id, Sense::click_and_drag());
    let what = format!("{} end of {name}", ENDS[end]);
    let value = range[end];
    response.widget_info(|| WidgetInfo::slider(ui.is_enabled(), value, what.as_str()));
    let mut wanted = None;
    if response.dragged()
        && let Some(pointer) = response.interact_pointer_pos()
    {
        wanted = Some(axis.value(pointer.x));
    }
    let steps = steps_of_keys(ui, id);
    if steps != 0.0 {
        wanted = Some(value + steps * axis.step);
    }
    if let Some(wanted) = wanted {
        let gap = axis.extent() * GAP;
        let (least, most) = match end {
            0 => (axis.of[0], (range[1] - gap).max(axis.of[0])),
            _ => ((range[0] + gap).min(axis.of[1]), axis.of[1]),
        };
        range[end] = rounded(wanted.clamp(least, most), axis.extent());
    }
    let inks = theme::inks(ui);
    let is_used = response.hovered() || response.dragged() || response.has_focus();
    let ink = if is_used { inks.accent } else { inks.text };
    let painter = ui.painter();
    painter.vline(at, axis.rect.y_range(), Stroke::new(1.5, ink));
    let knob = Rect::from_center_size(axis.rect.center(), vec2(6.0, KNOB));
    painter.rect_filled(knob.translate(vec2(at - axis.rect.center().x, 0.0)), 3.0, ink);
    let response = response.on_hover_and_drag_cursor(CursorIcon::ResizeHorizontal);
    response.on_hover_text(format!("{what}: drag it, or move it by the arrow keys"));
}

/// Steps of the arrow keys, if the widget has the focus.
fn steps_of_keys(ui: &Ui, id: Id) -> f64 {
    if !ui.memory(|memory| memory.has_focus(id)) {
        return 0.0;
    }
    let horizontal_arrows = true;
    let filter = EventFilter { horizontal_arrows, ..EventFilter::default() };
    ui.memory_mut(|memory| memory.set_focus_lock_filter(id, filter));
    ui.input_mut(|input| {
        let mut count = |key| input.count_and_consume_key(Modifiers::NONE, key) as f64;
        count(Key::ArrowRight) - count(Key::ArrowLeft)
    })
}

/// The ends as numbers.
fn numbers(ui: &mut Ui, name: &str, histogram: &Histogram, range: &mut [f64; 2]) {
    let extent = histogram.range[1] - histogram.range[0];
    let decimals = if histogram.is_whole { 0 } else { decimals(extent) };
    ui.horizontal(|ui| {
        let gap = extent * GAP;
        let [low, high] = *range;
        let limits = [f64::MIN..=high - gap, low + gap..=f64::MAX];
        for ((value, limits), end) in range.iter_mut().zip(limits).zip(ENDS) {
            let number = DragValue::new(value).range(limits).speed(extent / 300.0);
            let number = number.clamp_existing_to_range(false).fixed_decimals(decimals);
            let about = format!("The {end} end of {name}: drag it, or click it and type");
            ui.add(number).on_hover_text(about);
        }
    });
}

/// Digits after the decimal point that show a hundredth of an extent.
fn decimals(extent: f64) -> usize {
    (2.0 - extent.log10()).ceil().clamp(0.0, 9.0) as usize
}

/// The value, rounded to a step that is invisible in a histogram of this extent.
fn rounded(value: f64, extent: f64) -> f64 {
    let steps = 10f64.powi(decimals(extent) as i32);
    (value * steps).round() / steps
}
