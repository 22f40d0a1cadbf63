//! The part of the tab of filters that keeps or cuts away the points of boxes and of half spaces: a
//! list of clips, each with a switch, the side that is kept, and its numbers.

use super::data::PanelData;
use super::numbers::{Field, number};
use super::widgets::{label, section, tick};
use eframe::egui::{Align, Grid, Layout, Ui};
use esker_engine::{Bounds, Clip, ClipShape, Filter};

/// Width of a field of a coordinate or a length, points.
const WIDE: f32 = 92.0;
/// Width of a field of an angle or of a part of a normal, points.
const NARROW: f32 = 60.0;
/// Most characters of a name that are shown.
const NAMED: usize = 18;
/// Names of the axes.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Shows the clips; changes those of `filter` as the user does.
pub fn show(ui: &mut Ui, data: &PanelData<'_>, filter: &mut Filter) {
    section(ui, "Clips");
    let mut removed = None;
    for (i, clip) in filter.clips.iter_mut().enumerate() {
        ui.push_id(("clip", i), |ui| {
            if row(ui, i, data, clip) {
                removed = Some(i);
            }
        });
    }
    if let Some(i) = removed {
        filter.clips.remove(i);
    }
    let Some(extent) = data.extent else { return };
    ui.horizontal(|ui| {
        let about = "Keep the points in a box around the middle of the scan, which can be moved, \
                     turned, and cut away instead";
        if ui.button("Add a clip").on_hover_text(about).clicked() {
            filter.clips.push(Clip::from(middle(data, extent)));
        }
        let about = "Keep the points below a level plane through the middle of the scan, which can \
                     be moved and turned";
        if ui.button("Add a plane").on_hover_text(about).clicked() {
            let point = extent.map(|[low, high]| low.midpoint(high));
            let plane = ClipShape::Plane { point: tidy(data, point), normal: [0.0, 0.0, 1.0] };
            filter.clips.push(Clip::from(plane));
        }
    });
}

/// A box of half the length and width of the scan, around its middle, as high as it.
fn middle(data: &PanelData<'_>, extent: [[f64; 2]; 3]) -> ClipShape {
    let centre = extent.map(|[low, high]| low.midpoint(high));
    let [x, y, z] = extent.map(|[low, high]| high - low);
    let lattice = data.file.lattice();
    let size = lattice.measure([x / 2.0, y / 2.0, z + 2.0 * lattice.scale[2]]);
    ClipShape::Oriented {
        centre: tidy(data, centre),
        size: size.map(|length| rounded(length, -steps_of_ten(length) + 3)),
        rotation: [0.0; 3],
    }
}

/// Coordinates with no more decimals than those of the scan have.
pub fn tidy(data: &PanelData<'_>, at: [f64; 3]) -> [f64; 3] {
    let scale = data.file.lattice().scale;
    [0, 1, 2].map(|i| rounded(at[i], -steps_of_ten(scale[i])))
}

/// The power of ten at most as great as a length; 0 for none.
fn steps_of_ten(length: f64) -> i32 {
    let power = length.log10().floor();
    if power.is_finite() { power as i32 } else { 0 }
}

/// A number with so many decimals.
fn rounded(value: f64, decimals: i32) -> f64 {
    let text = format!("{value:.*}", decimals.clamp(0, 12) as usize);
    text.parse().unwrap_or(value)
}

/// A name in so few characters that it fits beside a button.
fn shortened(name: &str) -> String {
    match name.char_indices().nth(NAMED) {
        Some((end, _)) => format!("{}...", &name[..end]),
        None => name.to_owned(),
    }
}

/// The controls of a clip. Returns whether it is to be removed.
fn row(ui: &mut Ui, i: usize, data: &PanelData<'_>, clip: &mut Clip) -> bool {
    let name = clip.name.clone().unwrap_or_else(|| format!("clip {}", i + 1));
    let mut is_removed = false;
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let remove = ui.small_button("remove");
            is_removed = remove.on_hover_text("Remove this clip").clicked();
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let shown = shortened(&name);
                tick(ui, &mut clip.is_on, &shown, "Switch this clip on or off");
            });
        });
    });
    let (kept, cut) = match clip.shape {
        ClipShape::Plane { .. } => (
            "Keep the points behind the plane, away from its normal",
            "Cut away the points behind the plane, away from its normal",
        ),
        _ => ("Keep the points in the box", "Cut away the points in the box"),
    };
    ui.horizontal(|ui| {
        ui.selectable_value(&mut clip.keeps_outside, false, "keep inside").on_hover_text(kept);
        ui.selectable_value(&mut clip.keeps_outside, true, "cut away").on_hover_text(cut);
    });
    let speed = speed(data);
    match &mut clip.shape {
        ClipShape::Box(bounds) => box_fields(ui, speed, bounds),
        ClipShape::Oriented { centre, size, rotation } => {
            columns(ui, speed, [("centre", centre, f64::MIN), ("size", size, 0.0)]);
            turns(ui, rotation);
        }
        ClipShape::Plane { point, normal } => {
            let before = *normal;
            columns(ui, speed, [("point", point, f64::MIN)]);
            narrow(ui, ("normal", AXES), 0.01, normal, |axis| {
                format!("Part along {axis} of the direction in which points are cut away")
            });
            // A plane without a direction is none.
            if *normal == [0.0; 3] {
                *normal = before;
            }
        }
    }
    is_removed
}

/// Change of a coordinate by a drag over one point of the screen.
pub fn speed(data: &PanelData<'_>) -> f64 {
    let lengths = data.extent.iter().flatten().map(|[low, high]| high - low);
    lengths.fold(0.0, f64::max).max(f64::MIN_POSITIVE) / 500.0
}

/// Fields for the corners of a box along the axes; heights only if they are bounded.
pub fn box_fields(ui: &mut Ui, speed: f64, bounds: &mut Bounds) {
    Grid::new("corners").num_columns(3).min_col_width(8.0).spacing([6.0, 3.0]).show(ui, |ui| {
        for name in ["", "least", "greatest"] {
            label(ui, name);
        }
        ui.end_row();
        for (i, axis) in AXES.into_iter().enumerate() {
            if !bounds.min[i].is_finite() || !bounds.max[i].is_finite() {
                continue;
            }
            label(ui, axis);
            for (name, is_least) in [("least", true), ("greatest", false)] {
                let field = Field {
                    name: &format!("{name} {axis}"),
                    about: &format!("The {name} {axis} of the points in the box"),
                    speed,
                    range: f64::MIN..=f64::MAX,
                    width: WIDE,
                };
                let (low, high) = (&mut bounds.min[i], &mut bounds.max[i]);
                // The other corner gives way, so that the box keeps an inside.
                if is_least && number(ui, &field, low) {
                    *high = high.max(*low);
                } else if !is_least && number(ui, &field, high) {
                    *low = low.min(*high);
                }
            }
            ui.end_row();
        }
    });
}

/// Columns of a number along each axis, with the least value of each.
fn columns<const N: usize>(ui: &mut Ui, speed: f64, columns: [(&str, &mut [f64; 3], f64); N]) {
    Grid::new("columns").num_columns(N + 1).min_col_width(8.0).spacing([6.0, 3.0]).show(ui, |ui| {
        label(ui, "");
        for (name, ..) in &columns {
            label(ui, name);
        }
        ui.end_row();
        let mut columns = columns;
        for (i, axis) in AXES.into_iter().enumerate() {
            label(ui, axis);
            for (name, values, least) in &mut columns {
                let field = Field {
                    name: &format!("{name} {axis}"),
                    about: &format!("The {name} of this clip along {axis}, in the scan's unit"),
                    speed,
                    range: *least..=f64::MAX,
                    width: WIDE,
                };
                number(ui, &field, &mut values[i]);
            }
            ui.end_row();
        }
    });
}

/// Fields of the degrees by which a box is turned.
fn turns(ui: &mut Ui, rotation: &mut [f64; 3]) {
    narrow(ui, ("turn", ["z", "y", "x"]), 0.5, rotation, |axis| {
        let order = "the box is turned about x first, then about y, then about z";
        format!("Degrees by which the box is turned about {axis}; {order}")
    });
}

/// A name, and three small fields in a row below it.
fn narrow(
    ui: &mut Ui,
    (name, axes): (&str, [&str; 3]),
    speed: f64,
    values: &mut [f64; 3],
    about: impl Fn(&str) -> String,
) {
    label(ui, name);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for (axis, value) in axes.into_iter().zip(values) {
            label(ui, axis);
            let field = Field {
                name: &format!("{name} {axis}"),
                about: &about(axis),
                speed,
                range: f64::MIN..=f64::MAX,
                width: NARROW,
            };
            number(ui, &field, value);
        }
    });
}
