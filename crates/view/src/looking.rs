//! A scene that is looked at: its camera, the session behind it, the picture as a texture, the
//! frozen cut.

use crate::args::Args;
use crate::camera::{Camera, Pose};
use crate::canvas::Canvas;
use crate::counters::Counters;
use crate::depth::{Depths, typical};
use crate::device::{Device, ShownBy};
use crate::gestures::Gestures;
use crate::scene::{Look, Scene, Shown};
use crate::settings::Settings;
use crate::sharpness::Sharpness;
use crate::shots::Shots;
use crate::source::Opened;
use crate::{frustum, progress, theme};
use eframe::egui::{Color32, Context, FontId, Rect, Response, Ui, vec2};
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera as Asked;
use esker_engine::cameras::colour;
use esker_engine::cameras::legend::Legend;
use esker_engine::draw::session::Image;
use esker_engine::io::quantity::grouped;
use esker_engine::{Forest, View};
use glam::{DVec2, DVec3};
use std::sync::Arc;
use std::time::Instant;

/// Seconds that a window of another size must stay before a session is opened for it.
const RESIZE_S: f64 = 0.4;

/// A scene that is looked at. The session is dropped before the file that it reads.
pub struct Looking {
    scene: Option<Scene>,
    camera: Camera,
    /// What the arguments say of the first view.
    asked: Asked,
    gestures: Gestures,
    canvas: Canvas,
    sharpness: Sharpness,
    /// The view that the cut stays chosen for, and how far it saw.
    frozen: Option<(View, f64)>,
    sources: Vec<String>,
    name: String,
    about: String,
    notes: Vec<String>,
    unit: Option<String>,
    /// What draws.
    device: Device,
    /// Where the picture is shown, points, and its size, pixels.
    place: Option<Rect>,
    size: [u32; 2],
    /// Since when the window has another size, seconds, and which.
    resized: Option<(f64, [u32; 2])>,
    fault: Option<String>,
    opened: Opened,
}

/// A camera as it is asked for, in a picture of so many pixels.
fn camera_at(file: &Forest, asked: &Asked, size: [u32; 2]) -> Camera {
    let bounds = info::bounds(file);
    let view = asked.view(bounds, size);
    let [low, high] = bounds.map(DVec3::from_array);
    let target = match (asked.eye, asked.target) {
        (Some(_), Some(target)) => target,
        _ => view.eye + view.forward() * view.eye.distance(low.midpoint(high)).max(1e-6),
    };
    let up = asked.up.unwrap_or(DVec3::Z);
    Camera::new(view.eye, target, up, view.fovy_rad).around([low, high])
}

impl Looking {
    /// At what was opened, from where the arguments say.
    pub fn new(opened: Opened, args: &Args, shown: &ShownBy, is_coarser_moving: bool) -> Self {
        let file = &opened.file;
        let first = args.inputs.first();
        let name = first.and_then(|p| p.file_name()).map(|n| n.to_string_lossy().into_owned());
        let name = name.map(|name| match args.inputs.len() {
            1 => name,
            n => format!("{name} and {} more", n - 1),
        });
        let built = if opened.is_temporary() { "; built for this window alone" } else { "" };
        let [points, nodes] = [file.points(), file.table().nodes.len() as u64].map(grouped);
        Self {
            scene: None,
            camera: camera_at(file, &args.camera, args.size),
            asked: args.camera,
            gestures: Gestures::default(),
            canvas: Canvas::new(shown.painter.clone()),
            device: shown.device(args.backend),
            sharpness: Sharpness::new(is_coarser_moving),
            frozen: None,
            sources: colour::choices(file),
            name: name.unwrap_or_else(|| "scan".into()),
            about: match (file.points(), file.table().nodes.len()) {
                (0, _) => format!("no points{built}"),
                (1, _) => format!("1 point{built}"),
                (_, 1) => format!("{points} points in 1 node{built}"),
                _ => format!("{points} points in {nodes} nodes{built}"),
            },
            notes: info::notes(file),
            unit: info::unit(file),
            place: None,
            size: [1, 1],
            resized: None,
            fault: None,
            opened,
        }
    }

    /// The file.
    pub fn file(&self) -> &Arc<Forest> {
        &self.opened.file
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Where the picture is shown, points; `None` before the first pass.
    pub fn place(&self) -> Option<Rect> {
        self.place
    }

    /// The file's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What else there is to say of the file.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// What reading the file has left out or found odd.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The unit of the file's lengths, where it tells one.
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Where colours can come from.
    pub fn sources(&self) -> &[String] {
        &self.sources
    }

    /// What the colours mean, once a session draws.
    pub fn legend(&self) -> Option<Legend> {
        self.scene.as_ref()?.legend()
    }

    /// Size of the picture that is shown, pixels.
    pub fn picture_size(&self) -> [u32; 2] {
        self.canvas.size()
    }

    /// What draws the scene and the window, in words.
    pub fn drawn_by(&self, shown: &ShownBy) -> String {
        let drawer = self.scene.as_ref().and_then(Scene::drawer);
        let scene = match drawer {
            None => "none yet".to_owned(),
            Some(drawer) => match (&drawer.adapter, &drawer.note) {
                (Some(adapter), _) => format!("{adapter}, {}", drawer.path_name()),
                (None, Some(note)) => format!("CPU renderer ({note})"),
                (None, None) => "CPU renderer".to_owned(),
            },
        };
        format!("scene: {scene}; window: {}", shown.name)
    }

    /// Why there is no new picture.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Whether pictures may be coarser while the camera moves.
    pub fn is_coarser_moving(&self) -> bool {
        self.sharpness.is_on
    }

    /// Sets whether pictures may be coarser while the camera moves.
    pub fn set_coarser_moving(&mut self, is_on: bool) {
        self.sharpness.is_on = is_on;
    }

    /// How often the session was opened again, and how often its render thread waited.
    pub fn reopened_and_stalls(&self) -> (u64, u64) {
        self.scene.as_ref().map_or((0, 0), |scene| (scene.reopened(), scene.stalls()))
    }

    /// Stands at a pose at once.
    pub fn stand(&mut self, pose: Pose) {
        self.camera.stand(pose);
    }

    /// Goes back to where the camera stood first.
    pub fn go_home(&mut self) {
        self.camera.go_home();
    }

    /// What was measured, in words.
    pub fn measured(&self) -> Vec<String> {
        self.gestures.measure().lines(self.unit())
    }

    /// Forgets what was measured.
    pub fn forget(&mut self) {
        self.gestures.forget();
    }

    /// Whether the cut is frozen.
    pub fn is_frozen(&self) -> bool {
        self.frozen.is_some()
    }

    /// Freezes the cut, or lets it go.
    pub fn toggle_frozen(&mut self) {
        self.frozen = match self.frozen {
            Some(_) => None,
            None => Some((self.view(), self.camera.distance())),
        };
    }

    /// Lets the input of this pass move the camera; whether the hand holds the scene.
    pub fn follow(&mut self, ui: &Ui, response: &Response, now_s: f64) -> bool {
        if self.place.is_none() {
            // Only now is it known how wide the picture is.
            let size = pixels(response.rect, ui.ctx().pixels_per_point(), 1.0);
            self.camera = camera_at(self.file(), &self.asked, size);
        }
        let before = self.camera.pose();
        self.gestures.update(ui, response, &mut self.camera);
        if self.camera.pose() != before {
            self.sharpness.moved(now_s);
        }
        self.place = Some(response.rect);
        self.gestures.is_dragging()
    }

    /// Has a session of these settings, for pictures up to the size of the window.
    pub fn fit(&mut self, ctx: &Context, wanted: &Settings, now_s: f64) {
        let window = pixels(ctx.content_rect(), ctx.pixels_per_point(), 1.0);
        let Some(scene) = &mut self.scene else {
            let file = self.opened.file.clone();
            self.scene = Some(Scene::new(file, wanted.clone(), self.device.clone(), window));
            return;
        };
        // A slider that is held changes all the time.
        if !ctx.egui_is_using_pointer() || self.gestures.is_dragging() {
            scene.set(wanted.clone());
        }
        let has = scene.size();
        if window[0] <= has[0] && window[1] <= has[1] {
            self.resized = None;
            return;
        }
        match self.resized {
            Some((since, size)) if size == window => {
                if now_s - since > RESIZE_S {
                    scene.resize([window[0].max(has[0]), window[1].max(has[1])]);
                    self.resized = None;
                }
            }
            _ => self.resized = Some((now_s, window)),
        }
    }

    /// Draws, where there is anything new; milliseconds of it.
    pub fn draw(
        &mut self,
        ui: &Ui,
        now_s: f64,
        counters: &mut Counters,
        shots: &mut Shots,
    ) -> Option<f64> {
        let (ctx, place) = (ui.ctx(), self.place?);
        let scale = if shots.wants() { 1.0 } else { self.sharpness.scale(now_s) };
        let has = self.scene.as_ref()?.size();
        self.size = within(pixels(place, ctx.pixels_per_point(), scale), has);
        let look = self.look();
        let scene = self.scene.as_mut()?;
        if !self.gestures.picks().is_empty() || shots.wants() {
            scene.disturb();
        }
        let drawn = match scene.frame(&look) {
            Shown::New(frame) => {
                counters.take_frame(&frame.cut, frame.stats.points_drawn, frame.times.draw_ms);
                let (start, drawn_ms) = (Instant::now(), frame.times.total_ms);
                // What the newest finished frame took of the GPU, where it is one that draws.
                let rendered_ms = frame.stats.stages.total_ms;
                let (hand, camera) = (&mut self.gestures, &mut self.camera);
                let size = DVec2::new(f64::from(self.size[0]), f64::from(self.size[1]));
                match frame.image {
                    Image::Memory(picture) => {
                        self.canvas.upload(ctx, picture);
                        let depths =
                            Depths { width: picture.width as usize, depth: &picture.depth };
                        hand.told(camera, size, |at| depths.near(at));
                        let far = typical(|at| depths.exactly(at));
                        far.iter().for_each(|&far| camera.sees(far, drawn_ms / 1e3));
                    }
                    Image::Texture(view) => {
                        if !self.canvas.show(view, self.size) {
                            self.canvas.upload(ctx, &scene.picture().ok()?);
                        }
                        if hand.is_telling() {
                            let picture = scene.picture().ok()?;
                            let depths =
                                Depths { width: picture.width as usize, depth: &picture.depth };
                            hand.told(camera, size, |at| depths.near(at));
                        } else {
                            hand.told(camera, size, |at| scene.depth_at(at));
                        }
                        let far = typical(|at| scene.depth_at(at));
                        far.iter().for_each(|&far| camera.sees(far, rendered_ms / 1e3));
                    }
                }
                let work_ms = drawn_ms + start.elapsed().as_secs_f64() * 1e3;
                self.sharpness.drew(work_ms.max(rendered_ms), now_s);
                self.fault = None;
                if shots.wants() {
                    shots.take(scene.picture());
                }
                Some(work_ms)
            }
            Shown::Same => None,
            Shown::Waiting => {
                // What was wrong is tried again, by other settings.
                self.fault = None;
                None
            }
            Shown::Failed(fault) => {
                // A built file's name says nothing to who opened a scan.
                let built = self.opened.file.path().display().to_string();
                let is_built = self.opened.is_temporary();
                self.fault = Some(if is_built { fault.replace(&built, &self.name) } else { fault });
                None
            }
        };
        counters.take_status(scene.status(), now_s);
        counters.gpu_bytes = scene.gpu_bytes();
        drawn
    }

    /// Paints the picture and what lies over it.
    pub fn paint(&self, ui: &Ui) {
        let Some(place) = self.place else { return };
        self.canvas.paint(ui, place);
        let painter = ui.painter_at(place);
        if let Some((frozen, depth)) = &self.frozen {
            frustum::paint(&painter, place, frozen, &self.view(), *depth, theme::ACCENT);
            let corner = place.left_top() + vec2(14.0, 12.0);
            let text = "frozen: drawn as chosen for the eye of these lines; Space lets it go";
            let font = FontId::proportional(13.0);
            let text = painter.layout_no_wrap(text.into(), font, theme::ACCENT);
            let behind = Rect::from_min_size(corner, text.size()).expand(6.0);
            painter.rect_filled(behind, 4.0, Color32::from_black_alpha(170));
            painter.galley(corner, text, theme::ACCENT);
        }
        self.gestures.measure().paint(&painter, place, &self.view());
        if let Some(fault) = &self.fault {
            progress::fault_over(ui, place, fault);
        }
    }

    /// Whether nothing more comes for the view.
    fn is_at_rest(&self) -> bool {
        self.scene.as_ref().is_some_and(|scene| scene.is_at_rest(&self.look()))
    }

    /// Whether there is more to draw without any input.
    pub fn goes_on(&self, now_s: f64) -> bool {
        let is_done = self.is_at_rest() || self.fault.is_some();
        let is_moving = self.camera.is_moving() || self.sharpness.is_moving(now_s);
        !is_done || is_moving || self.resized.is_some()
    }

    /// The camera's view, for the picture.
    fn view(&self) -> View {
        let camera = &self.camera;
        // Only the near plane depends on how far the target is: by powers of two, so that a still
        // camera has one view.
        let far = camera.distance().log2().floor().exp2();
        let target = camera.eye() + camera.forward() * far;
        let [width, height] = self.size;
        View::look_at(camera.eye(), target, camera.up(), camera.fovy_rad(), width, height)
    }

    fn look(&self) -> Look {
        let seen = self.view();
        Look { chosen: self.frozen.map_or(seen, |(view, _)| view), seen }
    }
}

/// Pixels of a place of the window, at this share on a side; at least one.
pub fn pixels(place: Rect, pixels_per_point: f32, scale: f64) -> [u32; 2] {
    let side = |points: f32| ((f64::from(points * pixels_per_point) * scale).round() as u32).max(1);
    [side(place.width()), side(place.height())]
}

/// A size of the same shape within another one: what a window that has grown shows until its
/// session has.
fn within(size: [u32; 2], most: [u32; 2]) -> [u32; 2] {
    let share = |i: usize| f64::from(most[i]) / f64::from(size[i]);
    let share = share(0).min(share(1)).min(1.0);
    size.map(|side| ((f64::from(side) * share) as u32).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grown_window_shows_a_picture_of_its_shape_that_the_session_can_draw() {
        assert_eq!(within([640, 400], [1280, 800]), [640, 400]);
        assert_eq!(within([2560, 1600], [1280, 900]), [1280, 800]);
        assert_eq!(within([10_000, 1], [100, 100]), [100, 1]);
    }
}
