//! What is painted over the picture so that one knows where one is: a compass, a scale bar, and the
//! coordinates under the pointer. The camera and the depths of the newest picture go in; a click on
//! the compass comes out.

mod compass;
mod coordinates;
mod label;
mod scale_bar;

use crate::camera::Camera;
use crate::depth::Depths;
use coordinates::Coordinates;
use eframe::egui::{Align2, Painter, Rect, Ui, vec2};
use esker_engine::{Forest, View};
use glam::{DVec2, DVec3};
use label::boxed;

/// Smallest picture that has a compass and a scale bar, points.
const SMALLEST: [f32; 2] = [220.0, 160.0];
/// Pictures narrower than this have the coordinates above the scale bar, points.
const NARROW: f32 = 680.0;
/// Squares on each side of a picture on a GPU, for which it reports a depth.
const TILES: f64 = 128.0;

/// What is known of the file and of the newest picture.
pub struct Hud {
    coordinates: Coordinates,
    /// Whether nothing is painted.
    pub is_hidden: bool,
    /// View of the newest picture, and depth in its middle.
    drawn: Option<(View, Option<f64>)>,
    /// Depths of the newest picture, row by row, if it is final and in main memory.
    depth: Vec<f32>,
    /// Whether pictures are on a GPU, whose depths are coarse.
    is_coarse: bool,
}

impl Hud {
    /// Prepares for the pictures of a file.
    pub fn new(file: &Forest) -> Self {
        let coordinates = Coordinates::new(file);
        Self { coordinates, is_hidden: false, drawn: None, depth: Vec::new(), is_coarse: false }
    }

    /// Takes the depths of a picture in main memory. They are kept if it is final, or if the camera
    /// rests.
    pub fn drew_memory(&mut self, depths: Depths<'_>, view: View, is_final: bool) {
        let rests = self.drawn.is_some_and(|(last, _)| last == view);
        self.drawn = Some((view, depths.near(DVec2::splat(0.5))));
        self.is_coarse = false;
        self.depth.clear();
        if is_final || rests {
            self.depth.extend_from_slice(depths.depth);
        }
    }

    /// Takes the depth in the middle of a picture that is on a GPU.
    pub fn drew_texture(&mut self, view: View, middle: Option<f64>) {
        self.drawn = Some((view, middle));
        self.is_coarse = true;
        self.depth.clear();
    }

    /// Paints over the picture of `camera` that fills `rect`. `coarse` gives the depth at a place
    /// of a picture that is on a GPU. Returns the axis of the compass that was clicked.
    pub fn show(
        &self,
        ui: &Ui,
        rect: Rect,
        camera: &Camera,
        coarse: impl Fn(DVec2) -> Option<f64>,
    ) -> Option<DVec3> {
        if self.is_hidden || rect.width() < SMALLEST[0] || rect.height() < SMALLEST[1] {
            return None;
        }
        let painter = ui.painter_at(rect);
        let (view, middle) = self.drawn?;
        let depth = middle.map_or(camera.distance(), |depth| depth + camera.depth_offset(&view));
        let corner = rect.right_bottom() - vec2(14.0, 12.0);
        let pixel = camera.pixel_at(depth, f64::from(rect.height()));
        let units = &self.coordinates;
        scale_bar::show(ui, &painter, corner, pixel, units.unit(), camera.is_parallel());
        self.pointed(ui, &painter, rect, camera, coarse);
        compass::show(ui, &painter, rect.left_bottom() + vec2(50.0, -50.0), camera)
    }

    /// Writes the coordinates of what the pointer is at, if the picture is that of the camera.
    fn pointed(
        &self,
        ui: &Ui,
        painter: &Painter,
        rect: Rect,
        camera: &Camera,
        coarse: impl Fn(DVec2) -> Option<f64>,
    ) -> Option<()> {
        if !ui.rect_contains_pointer(rect) {
            return None;
        }
        let pointer = ui.input(|input| input.pointer.hover_pos())?;
        let at = DVec2::new(
            f64::from((pointer.x - rect.left()) / rect.width()),
            f64::from((pointer.y - rect.top()) / rect.height()),
        );
        let (place, pixel) = self.place(at, camera, coarse)?;
        let text = self.coordinates.text(place, pixel);
        let corner = if rect.width() < NARROW {
            (rect.right_bottom() - vec2(14.0, 46.0), Align2::RIGHT_BOTTOM)
        } else {
            (rect.left_bottom() + vec2(104.0, -12.0), Align2::LEFT_BOTTOM)
        };
        boxed(painter, corner.0, corner.1, &text);
        Some(())
    }

    /// What is shown at a position of the picture (0 to 1 from its top left corner), and the length
    /// to which it is known. `None` if nothing is shown there, or the picture is not that of the
    /// camera.
    fn place(
        &self,
        at: DVec2,
        camera: &Camera,
        coarse: impl Fn(DVec2) -> Option<f64>,
    ) -> Option<(DVec3, f64)> {
        let (view, _) = self.drawn?;
        if view != camera.view([view.width, view.height]) {
            return None;
        }
        let kept = Depths { width: view.width as usize, depth: &self.depth };
        let depth = if self.is_coarse { coarse(at) } else { kept.near(at) }?;
        let depth = depth + camera.depth_offset(&view);
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let pixels = if self.is_coarse { (size.max_element() / TILES).max(1.0) } else { 1.0 };
        let place = camera.point_at(at * size, size, depth);
        Some((place, camera.pixel_at(depth, size.y) * pixels))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_engine::Lattice;

    const SIZE: [u32; 2] = [200, 100];

    #[test]
    fn the_place_under_the_pointer_is_the_point_that_is_drawn_there() {
        let lattice =
            Lattice { scale: [0.001; 3], offset: [0.0; 3], shift: [0; 3], factor: [1.0; 3] };
        let point = DVec3::new(1e6 + 3.0, 2e6 + 4.0, 7.0);
        let (eye, bounds) = (point - DVec3::new(20.0, 30.0, -5.0), [point - 9.0, point + 9.0]);
        let target = point + DVec3::new(2.0, 0.0, 1.0);
        let mut camera = Camera::new(eye, target, DVec3::Z, 1.0).with_scene(bounds);
        for is_parallel in [false, true] {
            camera.set_parallel(is_parallel, camera.distance());
            let view = camera.view(SIZE);
            let on = view.project(point).unwrap();
            let mut depth = vec![f32::INFINITY; 200 * 100];
            depth[on.y as usize * 200 + on.x as usize] = on.z as f32;
            let coordinates = Coordinates::of(lattice);
            let mut hud = Hud {
                coordinates,
                is_hidden: false,
                drawn: None,
                depth: Vec::new(),
                is_coarse: false,
            };
            let depths = Depths { width: 200, depth: &depth };
            let size = DVec2::new(200.0, 100.0);
            let at = on.truncate() / size;
            hud.drew_memory(depths, view, false);
            assert_eq!(hud.place(at, &camera, |_| None), None, "more may be drawn");
            hud.drew_memory(depths, view, true);
            let (place, pixel) = hud.place(at, &camera, |_| None).unwrap();
            assert!(place.distance(point) < 0.01, "{is_parallel}: {place} is not {point}");
            let length = camera.pixel_at(point.distance(eye), size.y);
            assert!((pixel / length - 1.0).abs() < 0.1);
            assert_eq!(hud.place(DVec2::new(0.02, 0.02), &camera, |_| None), None, "empty");
            hud.drew_texture(view, None);
            let (place, coarser) = hud.place(at, &camera, |_| Some(on.z)).unwrap();
            assert!(place.distance(point) < 1e-6 && coarser > pixel, "{place}");
            camera.look(0.1, 0.0);
            assert_eq!(hud.place(at, &camera, |_| Some(on.z)), None, "the camera has moved");
            camera.look(-0.1, 0.0);
        }
    }
}
