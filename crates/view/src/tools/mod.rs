//! Tools: what the pointer does on the picture, a file each. Navigation works under every tool: it
//! moves the camera by dragging, by the wheel, by keys and by a double click. The active tool gets
//! the input too, and what it has made stays in the picture when another one is chosen.

pub mod measure;
mod navigate;
pub mod pick;
mod search;
pub mod tool;

use crate::camera::Camera;
use eframe::egui::{Context, CursorIcon, Painter, Rect, Response, Ui};
use esker_engine::View;
use tool::{Depth, Shown, Tool};

pub use navigate::{Navigate, SPEED_A_POINT, TURN_RAD};
pub use pick::Pick;

/// Names of the tools.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToolName {
    /// [`Navigate`].
    Navigate,
    /// [`Pick`].
    #[default]
    Pick,
}

/// The tools, one of which is active.
#[derive(Default)]
pub struct Tools {
    /// Moves the camera, whichever tool is active.
    pub navigate: Navigate,
    /// Picks points of the file.
    pub pick: Pick,
    /// The active one.
    pub active: ToolName,
}

impl Tools {
    fn all(&self) -> [&dyn Tool; 2] {
        [&self.navigate, &self.pick]
    }

    fn all_mut(&mut self) -> [&mut dyn Tool; 2] {
        [&mut self.navigate, &mut self.pick]
    }

    fn active(&self) -> &dyn Tool {
        match self.active {
            ToolName::Navigate => &self.navigate,
            ToolName::Pick => &self.pick,
        }
    }

    /// Moves the camera, and gives the input to the active tool.
    pub fn input(&mut self, ui: &Ui, response: &Response, camera: &mut Camera) {
        self.navigate.input(ui, response, camera);
        match self.active {
            ToolName::Navigate => {}
            ToolName::Pick => self.pick.input(ui, response, camera),
        }
    }

    /// Whether a tool needs depths of the next picture.
    pub fn needs_depth(&self) -> bool {
        self.all().iter().any(|tool| tool.needs_depth())
    }

    /// Whether a tool needs exact depths.
    pub fn needs_exact_depth(&self) -> bool {
        self.all().iter().any(|tool| tool.needs_exact_depth())
    }

    /// Gives depths of a picture of the present pose of `camera` to the tools that need them. Those
    /// that move the camera come last.
    pub fn take_depths(&mut self, camera: &mut Camera, picture: &mut Depth<'_>) {
        for tool in self.all_mut().into_iter().rev() {
            if tool.needs_depth() {
                tool.take_depths(camera, picture);
            }
        }
    }

    /// Goes on with work on other threads.
    pub fn advance(&mut self, ctx: &Context, seen: Option<&Shown>) {
        self.all_mut().into_iter().for_each(|tool| tool.advance(ctx, seen));
    }

    /// Whether a tool waits for work on another thread.
    pub fn is_busy(&self) -> bool {
        self.all().iter().any(|tool| tool.is_busy())
    }

    /// Whether the user is dragging the scene.
    pub fn is_dragging(&self) -> bool {
        self.all().iter().any(|tool| tool.is_dragging())
    }

    /// Paints what the tools have made over a picture of the view `seen` that fills `rect`.
    pub fn paint(&self, painter: &Painter, rect: Rect, seen: &View) {
        self.all().iter().for_each(|tool| tool.paint(painter, rect, seen));
    }

    /// Removes what the tools have made.
    pub fn clear(&mut self) {
        self.all_mut().into_iter().for_each(|tool| tool.clear());
    }

    /// The pointer over the picture.
    pub fn cursor(&self) -> CursorIcon {
        if self.is_dragging() { CursorIcon::Grabbing } else { self.active().cursor() }
    }
}
