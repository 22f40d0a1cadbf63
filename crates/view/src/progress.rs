//! What the window shows while there is no picture: the progress of opening and building, or an
//! error.

use crate::source::Opening;
use crate::theme;
use eframe::egui::{
    Align2, Area, Frame, Id, Label, Margin, Order, ProgressBar, Rect, RichText, Ui, vec2,
};
use esker_engine::io::quantity::grouped;
use std::path::PathBuf;
use std::time::Duration;

/// Time between two updates of the progress.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Seconds after which the opening of a file is reported.
const PATIENCE_S: f64 = 0.4;
/// Width of the bar over a preview, points.
const OVER_WIDTH: f32 = 340.0;
/// Width of the box, points.
const WIDTH: f32 = 420.0;

/// Shows the progress of opening and building.
pub fn show(ui: &mut Ui, opening: &Opening, inputs: &[PathBuf]) {
    let progress = opening.progress();
    ui.ctx().request_repaint_after(LOOK_EVERY);
    if progress.phase.is_empty() && progress.seconds < PATIENCE_S {
        return;
    }
    boxed(ui, |ui| {
        let names: Vec<String> = inputs.iter().map(|p| p.display().to_string()).collect();
        let what = if progress.phase.is_empty() { "Opening" } else { "Building" };
        ui.label(RichText::new(format!("{what} {}", names.join(", "))).heading());
        ui.add_space(6.0);
        if progress.phase.is_empty() {
            ui.spinner();
            return;
        }
        let bar = ProgressBar::new(progress.share().unwrap_or(0.0))
            .fill(theme::inks(ui).accent.gamma_multiply(0.7));
        let percent = progress.share().map_or(String::new(), |s| format!("{:.0} %", s * 100.0));
        ui.add(bar.desired_width(WIDTH - 40.0).corner_radius(3.0).text(percent));
        let left = progress.left_s().map_or(String::new(), |s| format!(", {s:.0} s left"));
        let line = format!(
            "{}: {} {}, {} a second{left}",
            progress.phase,
            grouped(progress.done),
            progress.unit,
            grouped(progress.rate() as u64)
        );
        ui.label(RichText::new(line).color(theme::inks(ui).faint));
        if let Some(note) = &progress.note {
            ui.add(Label::new(RichText::new(note).small().color(theme::inks(ui).faint)).wrap());
        }
        ui.add_space(6.0);
        let cancel = ui.button("Cancel").on_hover_text("Stop opening these files");
        if cancel.clicked() {
            opening.cancel();
        }
    });
}

/// Shows the progress of building over the picture of a preview.
pub fn over(ui: &Ui, rect: Rect, opening: &Opening) {
    let progress = opening.progress();
    ui.ctx().request_repaint_after(LOOK_EVERY);
    let area = Area::new(Id::unique("building")).order(Order::Foreground);
    let pivot = rect.center_top() + vec2(0.0, 12.0);
    area.fixed_pos(pivot).pivot(Align2::CENTER_TOP).show(ui.ctx(), |ui| {
        framed(ui).show(ui, |ui| {
            ui.horizontal(|ui| {
                let share = progress.share().unwrap_or(0.0);
                let left = progress.left_s().map_or(String::new(), |s| format!(", {s:.0} s left"));
                let text = format!("preview; {:.0} % of the whole is built{left}", share * 100.0);
                let bar = ProgressBar::new(share).fill(theme::ACCENT.gamma_multiply(0.6));
                ui.add(bar.desired_width(OVER_WIDTH.min(rect.width() * 0.6)).text(text));
                let about = "Stop building, and keep looking at the preview";
                if ui.button("Cancel").on_hover_text(about).clicked() {
                    opening.cancel();
                }
            });
        });
    });
}

/// What the user opens where there is no scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Next {
    /// These files.
    Files(Vec<PathBuf>),
    /// Others, which are still to be chosen.
    Other,
    /// An address, which is still to be typed.
    Address,
}

/// Shows why there is no scene of `inputs`. Returns what the user opens next.
pub fn failed(ui: &mut Ui, fault: &str, inputs: &[PathBuf]) -> Option<Next> {
    let mut next = None;
    boxed(ui, |ui| {
        ui.label(RichText::new("Nothing to show").heading().color(theme::inks(ui).fault));
        ui.add(Label::new(fault).wrap().selectable(true));
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            let again = ui.button("Try again").on_hover_text("Open the same files once more");
            if again.clicked() {
                next = Some(Next::Files(inputs.to_vec()));
            }
            if ui.button("Open another").on_hover_text("Choose other files").clicked() {
                next = Some(Next::Other);
            }
        });
        ui.label(RichText::new("Or drop other files on the window.").color(theme::inks(ui).faint));
    });
    next
}

/// Shows what to do where no file is open. Returns the files that the user has chosen among the
/// `recent` ones.
pub fn start(ui: &mut Ui, recent: &[Vec<PathBuf>]) -> Option<Next> {
    let mut chosen = None;
    boxed(ui, |ui| {
        ui.label(RichText::new("Esker").heading());
        ui.label("Drop scans, folders of scans, an .esker file or a scene on this window.");
        ui.label(
            RichText::new("LAS, LAZ, E57, PTX, PTS, PLY, PCD, XYZ, CSV")
                .color(theme::inks(ui).faint),
        );
        ui.horizontal(|ui| {
            if ui.button("Open\u{2026}").on_hover_text("Choose files (Ctrl+O)").clicked() {
                chosen = Some(Next::Other);
            }
            let about = "Type or paste an address of https, s3, gs or az";
            if cfg!(feature = "remote")
                && ui.button("Open an address\u{2026}").on_hover_text(about).clicked()
            {
                chosen = Some(Next::Address);
            }
        });
        if !recent.is_empty() {
            ui.add_space(8.0);
            ui.label(RichText::new("Opened before").strong());
        }
        for files in recent {
            let name = files.first().and_then(|path| path.file_name());
            let mut name = name.map_or(String::new(), |name| name.to_string_lossy().into_owned());
            if files.len() > 1 {
                name += &format!(" and {} more", files.len() - 1);
            }
            let folder = files.first().and_then(|path| path.parent());
            let folder = folder.map_or(String::new(), |folder| folder.display().to_string());
            if ui.button(name).on_hover_text(folder).clicked() {
                chosen = Some(Next::Files(files.clone()));
            }
        }
    });
    chosen
}

/// Shows over the picture how much of the built file is copied. Returns whether the user stops it.
pub fn keeping(ui: &Ui, rect: Rect, share: f32) -> bool {
    ui.ctx().request_repaint_after(LOOK_EVERY);
    let mut is_stopped = false;
    let area = Area::new(Id::unique("keeping")).order(Order::Foreground);
    let pivot = rect.center_top() + vec2(0.0, 12.0);
    area.fixed_pos(pivot).pivot(Align2::CENTER_TOP).show(ui.ctx(), |ui| {
        framed(ui).show(ui, |ui| {
            ui.horizontal(|ui| {
                let bar = ProgressBar::new(share).fill(theme::ACCENT.gamma_multiply(0.6));
                let text = format!("{:.0} % of the file is copied", share * 100.0);
                ui.add(bar.desired_width(OVER_WIDTH.min(rect.width() * 0.6)).text(text));
                is_stopped = ui.button("Cancel").on_hover_text("Stop copying").clicked();
            });
        });
    });
    is_stopped
}

/// Shows a fault over the picture.
pub fn fault_over(ui: &Ui, rect: Rect, fault: &str) {
    let area = Area::new(Id::unique("fault")).order(Order::Foreground).interactable(false);
    let pivot = rect.center_bottom() - vec2(0.0, 16.0);
    area.fixed_pos(pivot).pivot(Align2::CENTER_BOTTOM).show(ui.ctx(), |ui| {
        framed(ui).show(ui, |ui| {
            ui.set_max_width(rect.width() * 0.8);
            ui.label(RichText::new(fault).color(theme::inks(ui).fault));
        });
    });
}

/// Says over an empty picture that the filter leaves no point in view. Returns whether the user
/// wants to see all points.
pub fn nothing_left(ui: &Ui, rect: Rect) -> bool {
    let area = Area::new(Id::unique("nothing left")).order(Order::Foreground);
    let mut wants_all = false;
    area.fixed_pos(rect.center()).pivot(Align2::CENTER_CENTER).show(ui.ctx(), |ui| {
        framed(ui).show(ui, |ui| {
            ui.label(
                "No point in view passes the filter: classes, flags, values, box, spacing, clips.",
            );
            wants_all = ui.button("Show all").on_hover_text("Remove the filter").clicked();
        });
    });
    wants_all
}

fn framed(ui: &Ui) -> Frame {
    Frame::NONE.fill(theme::inks(ui).panel).inner_margin(Margin::same(12)).corner_radius(6)
}

fn boxed(ui: &mut Ui, add: impl FnOnce(&mut Ui)) {
    let rect = ui.max_rect();
    let area = Area::new(Id::unique("progress")).order(Order::Middle);
    area.fixed_pos(rect.center()).pivot(Align2::CENTER_CENTER).show(ui.ctx(), |ui| {
        Frame::NONE
            .fill(theme::inks(ui).panel)
            .inner_margin(Margin::same(20))
            .corner_radius(8)
            .show(ui, |ui| {
                ui.set_width(WIDTH);
                add(ui);
            });
    });
}
