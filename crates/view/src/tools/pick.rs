//! Picks points of the file: a click finds the nearest point that is shown there. A click waits for
//! the picture of this frame, which has its depth, then a thread looks for the point. A click on
//! nothing removes the points, a double click is none.

use super::measure::Measure;
use super::search::{Outcome, Search};
use super::tool::{Clicked, Depth, Shown, Tool, share_of};
use crate::camera::Camera;
use eframe::egui::{Context, CursorIcon, Painter, Rect, Response, Ui};
use esker_engine::View;
use glam::DVec2;
use std::mem::take;

/// Picks points of the file, and measures between them.
#[derive(Default)]
pub struct Pick {
    /// Places that were clicked, and whose depth is not known yet.
    places: Vec<DVec2>,
    /// Places whose point is still to be found.
    clicked: Vec<Clicked>,
    search: Option<Search>,
    fault: Option<String>,
    /// Whether the last click was the first one of a double click.
    undoes_click: bool,
    measure: Measure,
}

impl Pick {
    /// The picked points.
    pub fn measure(&self) -> &Measure {
        &self.measure
    }

    /// Replaces the picked points.
    pub fn set_measure(&mut self, measure: Measure) {
        self.measure = measure;
    }

    /// Error of the last search for a point.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}

impl Tool for Pick {
    fn input(&mut self, ui: &Ui, response: &Response, _camera: &mut Camera) {
        let Some(at) = response.interact_pointer_pos() else { return };
        if response.double_clicked() {
            // Its first click picks nothing.
            self.undoes_click = true;
        } else if response.clicked() && ui.input(|i| i.modifiers.is_none()) {
            self.places.push(share_of(response.rect, at));
        }
    }

    fn needs_depth(&self) -> bool {
        !self.places.is_empty()
    }

    fn needs_exact_depth(&self) -> bool {
        self.needs_depth()
    }

    fn take_depths(&mut self, _camera: &mut Camera, picture: &mut Depth<'_>) {
        for at in self.places.drain(..) {
            match (picture.at)(at) {
                Some(depth) => self.clicked.push(Clicked { at, depth }),
                None => self.measure.clear(),
            }
        }
    }

    fn advance(&mut self, ctx: &Context, seen: Option<&Shown>) {
        if take(&mut self.undoes_click) && self.search.take().is_none() {
            self.measure.pop();
        }
        for clicked in take(&mut self.clicked) {
            self.fault = None;
            self.search = seen.map(|seen| Search::start(ctx, seen, clicked));
        }
        match self.search.as_ref().map(Search::poll) {
            None | Some(Outcome::Open) => return,
            Some(Outcome::Found(Some(picked))) => self.measure.push(*picked),
            Some(Outcome::Found(None)) => {}
            Some(Outcome::Failed(fault)) => self.fault = Some(fault),
        }
        self.search = None;
    }

    fn is_busy(&self) -> bool {
        self.search.is_some()
    }

    fn paint(&self, painter: &Painter, rect: Rect, seen: &View) {
        self.measure.paint(painter, rect, seen);
    }

    fn clear(&mut self) {
        self.places.clear();
        self.clicked.clear();
        self.search = None;
        self.measure.clear_all();
    }

    fn cursor(&self) -> CursorIcon {
        CursorIcon::Crosshair
    }
}
