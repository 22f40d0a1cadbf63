//! What a tool is: it gets the input on the picture and the depths that it asks for, works on, and
//! paints what it has made over the picture.

use crate::camera::Camera;
use eframe::egui::{Context, CursorIcon, Painter, Pos2, Rect, Response, Ui};
use esker_engine::{Forest, ForestFilter, View};
use glam::DVec2;
use std::sync::Arc;

/// What the pointer does on the picture.
pub trait Tool {
    /// Takes the input of a pass; the rectangle of `response` is that of the picture.
    fn input(&mut self, ui: &Ui, response: &Response, camera: &mut Camera);

    /// Whether the tool needs depths of the next picture.
    fn needs_depth(&self) -> bool;

    /// Whether these depths have to come from the newest picture, which on a GPU means waiting for
    /// it. Else those of the picture before are enough.
    fn needs_exact_depth(&self) -> bool {
        false
    }

    /// Gets the depths that it needs from a picture of the present pose of `camera`.
    fn take_depths(&mut self, camera: &mut Camera, picture: &mut Depth<'_>);

    /// Goes on with work on other threads; `seen` is what the picture shows, once one is drawn.
    fn advance(&mut self, _ctx: &Context, _seen: Option<&Shown>) {}

    /// Whether it waits for work on another thread.
    fn is_busy(&self) -> bool {
        false
    }

    /// Whether the user is dragging the scene.
    fn is_dragging(&self) -> bool {
        false
    }

    /// Paints what it has made over a picture of the view `seen` that fills `rect`.
    fn paint(&self, _painter: &Painter, _rect: Rect, _seen: &View) {}

    /// Removes what it has made.
    fn clear(&mut self) {}

    /// The pointer over the picture.
    fn cursor(&self) -> CursorIcon {
        CursorIcon::Default
    }
}

/// Depths of a picture.
pub struct Depth<'a> {
    /// Size of the picture, pixels.
    pub size: DVec2,
    /// Depth at a position of the picture, 0 to 1 from its top left corner, from the eye of the
    /// camera; `None` where the picture is empty.
    pub at: &'a mut dyn FnMut(DVec2) -> Option<f64>,
}

/// What a picture shows.
pub struct Shown {
    /// The file.
    pub file: Arc<Forest>,
    /// The view.
    pub view: View,
    /// The points that are drawn.
    pub shown: Arc<ForestFilter>,
    /// Depth from the eye of the camera less that of the view.
    pub depth_offset: f64,
}

/// A place that was clicked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clicked {
    /// Position in the picture, 0 to 1 from its top left corner.
    pub at: DVec2,
    /// Depth that the picture shows there, from the eye of the camera.
    pub depth: f64,
}

/// Position of the pointer in the picture, 0 to 1 from its top left corner.
pub fn share_of(rect: Rect, pointer: Pos2) -> DVec2 {
    let at = pointer - rect.min;
    let share = |v: f32, side: f32| f64::from(v / side.max(1.0)).clamp(0.0, 1.0);
    DVec2::new(share(at.x, rect.width()), share(at.y, rect.height()))
}
