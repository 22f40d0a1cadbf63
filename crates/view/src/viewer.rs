//! The view of an open file: its camera, the session that draws it, the picture as a texture, and
//! the frozen cut.

use crate::args::Args;
use crate::camera::{Camera, Pose, Seen};
use crate::canvas::Canvas;
use crate::clouds::Clouds;
use crate::counters::Counters;
use crate::depth::{Depths, typical};
use crate::device::{Device, WindowPainter};
use crate::hud::Hud;
use crate::pacing::Pacing;
use crate::scene::{FrameOutcome, FrameViews, Scene};
use crate::settings::Settings;
use crate::sharpness::{Drawn, Sharpness};
use crate::shots::Shots;
use crate::source::Opened;
use crate::tools::measure::{Measure, Over};
use crate::tools::tool::{Depth, Shown};
use crate::tools::{ToolName, Tools};
use crate::views::{Side, Views};
use crate::{fault, frustum, progress, theme};
use eframe::egui::{Color32, Context, FontId, Rect, Response, Ui, vec2};
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera as CameraRequest;
use esker_engine::cameras::classes::{self, ClassCount};
use esker_engine::cameras::colour;
use esker_engine::cameras::legend::Legend;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::document::Annotation;
use esker_engine::draw::pace::Load;
use esker_engine::draw::session::Image;
use esker_engine::io::quantity::grouped;
use esker_engine::{Forest, Method, View};
use glam::{DVec2, DVec3};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Seconds that a new size of the window must last before a session is opened for it.
const RESIZE_S: f64 = 0.4;

/// A picture that is requested.
#[derive(Clone, Copy)]
struct Shot {
    /// What the camera saw when it was requested.
    seen: Seen,
    /// Whether nothing more was to come then. The picture then has the points of hidden nodes too,
    /// which gaps between others may show: it is that of `esker render`. It waits for them until
    /// the camera moves.
    is_whole: bool,
}

/// The view of an open file. Fields are dropped in their order: the session before the file that it
/// reads.
pub struct Viewer {
    scene: Option<Scene>,
    camera: Camera,
    views: Views,
    tools: Tools,
    /// Texts of the scene document, and their places.
    annotations: Vec<(String, DVec3)>,
    canvas: Canvas,
    sharpness: Sharpness,
    pacing: Pacing,
    /// Method that the user has chosen; moving pictures may have another.
    method: Method,
    /// The view that the frozen cut is chosen for, and the distance to which its frustum is
    /// painted.
    frozen: Option<(View, f64)>,
    sources: Vec<String>,
    classes: Vec<ClassCount>,
    /// Whether normals tell the front of surfaces from the back.
    has_fronts: bool,
    name: String,
    about: String,
    clouds: Clouds,
    notes: Vec<String>,
    unit: Option<String>,
    hud: Hud,
    /// What the scene is drawn on.
    device: Device,
    /// Rectangle of the picture in the window, points; the size of the picture is in pixels.
    picture_rect: Option<Rect>,
    size: [u32; 2],
    /// Size of the picture with all pixels of the window.
    full_px: [u32; 2],
    /// The picture that is requested.
    shot: Option<Shot>,
    /// When the window got another size, seconds, and that size, pixels.
    resized: Option<(f64, [u32; 2])>,
    fault: Option<String>,
    opened: Opened,
}

impl Viewer {
    /// Makes a viewer of an opened file, with the first view that the command line requests.
    pub fn new(
        opened: Opened,
        args: &Args,
        window_painter: &WindowPainter,
        is_coarser_moving: bool,
    ) -> Self {
        let file = &opened.file;
        let views = Views::new(file, &args.camera, opened.scene.hidden());
        let first = args.inputs.first();
        let name = first.and_then(|p| p.file_name()).map(|n| n.to_string_lossy().into_owned());
        let name = name.map(|name| match args.inputs.len() {
            1 => name,
            n => format!("{name} and {} more", n - 1),
        });
        let built = opened.built_in();
        let notes = opened.preview_note().into_iter();
        let notes = notes.chain(opened.scene.note().map(String::from));
        let mut sharpness = Sharpness::new(is_coarser_moving, args.frame_ms);
        let (pacing, pace) = Pacing::new();
        pace.into_iter().for_each(|pace| sharpness.set_pace(pace));
        let mut tools = Tools::default();
        let measurements = opened.scene.measurements();
        tools.pick.set_measure(Measure::of(measurements, |p| file.lattice().measure(p)));
        let annotations = opened.scene.annotations();
        let placed = |of: &Annotation| (of.text.clone(), file.lattice().measure(of.at).into());
        let [points, nodes] = [file.points(), file.nodes()].map(grouped);
        Self {
            scene: None,
            camera: views.first(args.size),
            tools,
            annotations: annotations.iter().map(placed).collect(),
            canvas: Canvas::new(window_painter.driver.clone()),
            device: window_painter.device(args.backend),
            sharpness,
            pacing,
            method: Method::default(),
            frozen: None,
            // A file whose statistics are damaged shows that when it is drawn.
            sources: colour::offered(file).unwrap_or_else(|_| colour::choices(file)),
            classes: classes::occurring(file).unwrap_or_default(),
            has_fronts: file.has_oriented_normals() && !file.is_closed(),
            name: name.unwrap_or_else(|| "scan".into()),
            about: match (file.points(), file.nodes()) {
                (0, _) => format!("no points{built}"),
                (1, _) => format!("1 point{built}"),
                (_, 1) => format!("{points} points in 1 node{built}"),
                _ => format!("{points} points in {nodes} nodes{built}"),
            },
            clouds: Clouds::of(file),
            notes: notes.chain(info::notes(file)).collect(),
            views,
            hud: Hud::new(file),
            unit: info::unit(file),
            picture_rect: None,
            size: [1, 1],
            full_px: args.size,
            shot: None,
            resized: None,
            fault: None,
            opened,
        }
    }

    /// Goes on where the viewer of a preview was: camera, measurements, and the last picture until
    /// there is another one.
    pub fn replace(&mut self, preview: Self) {
        if preview.vertical() != self.vertical() {
            self.views.set_vertical(preview.vertical());
        }
        self.camera = preview.camera.on_lattice(self.file().lattice());
        self.tools = preview.tools;
        self.sharpness = preview.sharpness;
        self.pacing = preview.pacing;
        self.frozen = preview.frozen;
        self.picture_rect = preview.picture_rect;
        self.size = preview.size;
        self.canvas = preview.canvas;
    }

    /// Says that the preview is all there will be, since the build of the whole file has ended with
    /// `fault`.
    pub fn stay_preview(&mut self, fault: &str) {
        if let Some(note) = self.notes.first_mut().filter(|_| self.opened.preview_note().is_some())
        {
            let points = grouped(self.opened.file.points());
            *note = format!("preview of {points} points alone: {fault}");
        }
    }

    /// The open file.
    pub fn file(&self) -> &Arc<Forest> {
        &self.opened.file
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The present view as a request of pictures, in the scan's coordinates.
    pub fn camera_request(&self) -> CameraRequest {
        self.camera.request()
    }

    /// Size of the picture with all pixels of the window, at most that which the session draws.
    pub fn full_size(&self) -> [u32; 2] {
        let size = self.full_px;
        self.scene.as_ref().map_or(size, |scene| within(size, scene.drawn_size()))
    }

    /// Rectangle of the picture in the window, points; `None` before the first pass.
    pub fn picture_rect(&self) -> Option<Rect> {
        self.picture_rect
    }

    /// Name of the file; for several scans also their number.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Numbers of points and nodes, in words.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// Scans, extent and coordinate system of the file.
    pub fn clouds(&self) -> &Clouds {
        &self.clouds
    }

    /// Notes on what was left out of the file or is unusual in it.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Unit of the file's lengths, if the file names one.
    pub fn unit(&self) -> Option<&str> {
        self.unit.as_deref()
    }

    /// Path of the file that was built from scans, unless it is a preview of them.
    pub fn built_file(&self) -> Option<PathBuf> {
        let is_whole = self.opened.is_built() && self.opened.preview_note().is_none();
        let file = self.file().files().next().filter(|_| is_whole)?;
        Some(file.path().to_owned())
    }

    /// The axis that points upwards.
    pub fn vertical(&self) -> Vertical {
        self.views.vertical()
    }

    /// Why it does, if that was guessed.
    pub fn up_note(&self) -> Option<&'static str> {
        self.views.note()
    }

    /// Names of the colour sources that the file offers.
    pub fn sources(&self) -> &[String] {
        &self.sources
    }

    /// Whether normals tell the front of surfaces from the back.
    pub fn has_fronts(&self) -> bool {
        self.has_fronts
    }

    /// Classes that occur in the file.
    pub fn classes(&self) -> &[ClassCount] {
        &self.classes
    }

    /// Legend of the colours, while a session runs.
    pub fn legend(&self) -> Option<Legend> {
        self.scene.as_ref()?.legend()
    }

    /// Whether the session has these settings, or will have them next; a change of the panel waits
    /// until the pointer is let go. The method of moving pictures may be another one.
    pub fn has(&self, wanted: &Settings) -> bool {
        self.scene.as_ref().is_some_and(|scene| {
            let method = scene.settings().method;
            *scene.settings() == Settings { method, ..wanted.clone() }
        })
    }

    /// Settings of the session.
    #[cfg(test)]
    pub fn settings(&self) -> Option<&Settings> {
        self.scene.as_ref().map(Scene::settings)
    }

    /// Size of the picture that is shown, pixels.
    pub fn picture_size(&self) -> [u32; 2] {
        self.canvas.size()
    }

    /// Names what draws the scene and what paints the window.
    pub fn drawn_by(&self, window_painter: &WindowPainter) -> String {
        let drawer = self.scene.as_ref().and_then(Scene::drawer);
        let scene = match drawer {
            None => "none yet".to_owned(),
            Some(drawer) => match (&drawer.adapter, &drawer.note) {
                (Some(adapter), _) => format!("{adapter}, {}", drawer.path_name()),
                (None, Some(note)) => format!("CPU renderer ({note})"),
                (None, None) => "CPU renderer".to_owned(),
            },
        };
        format!("scene: {scene}; window: {}", window_painter.name)
    }

    /// Fault that prevents new pictures.
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

    /// Moves the camera to `pose` at once.
    pub fn set_pose(&mut self, pose: Pose) {
        self.camera.set_pose(pose);
    }

    /// Starts the flight back to the first view, which fits the window as it is now.
    pub fn go_home(&mut self) {
        let home = self.views.home(self.camera.is_parallel(), self.size);
        if self.picture_rect.is_some() {
            self.camera.set_home(&home);
        }
        self.camera.go_home();
    }

    /// Starts the flight to a view of all of the scan from a side.
    pub fn look_from(&mut self, side: Side) {
        self.camera.glide_as(&self.views.seen_from(side, self.camera.is_parallel(), self.size));
    }

    /// Starts the flight to a view along an axis, from the side to which it points.
    fn look_along(&mut self, axis: DVec3) {
        self.camera.glide_as(&self.views.along_axis(axis, self.camera.is_parallel(), self.size));
    }

    /// Shows or hides compass, scale bar and coordinates.
    pub fn toggle_hud(&mut self) {
        self.hud.is_hidden = !self.hud.is_hidden;
    }

    /// Makes pictures parallel (orthographic) ones, or perspective ones.
    pub fn toggle_parallel(&mut self) {
        self.tools.navigate.set_parallel(!self.camera.is_parallel());
    }

    /// Keeps the speed of flying, or lets it follow the viewing distance again.
    pub fn toggle_fixed_pace(&mut self) {
        self.camera.fix_pace(!self.camera.has_fixed_pace());
    }

    /// The active tool.
    pub fn tool(&self) -> ToolName {
        self.tools.active
    }

    /// Chooses a tool.
    pub fn set_tool(&mut self, name: ToolName) {
        self.tools.active = name;
    }

    /// Measurements, in words.
    pub fn measured(&self) -> Vec<String> {
        self.measure().lines(self.unit())
    }

    /// Names and values of the point that was picked last.
    pub fn about_picked(&self) -> Vec<(String, String)> {
        self.measure().about_last()
    }

    /// Error of the last search for a picked point.
    pub fn pick_fault(&self) -> Option<&str> {
        self.tools.pick.fault()
    }

    /// What the picture shows, while a session runs.
    fn shown(&self) -> Option<Shown> {
        let shown = self.scene.as_ref().and_then(Scene::shown)?;
        let (file, view) = (Arc::clone(self.file()), self.view());
        let shown = shown.grown(&file).ok().flatten().map_or(shown, Arc::new);
        Some(Shown { file, view, shown, depth_offset: self.camera.depth_offset(&view) })
    }

    /// Movement of the sun since the last call, in shares of the height of the picture.
    #[cfg(feature = "light")]
    pub fn take_sun_drag(&mut self) -> Option<[f64; 2]> {
        self.tools.navigate.take_sun_drag()
    }

    /// The measured points.
    pub fn measure(&self) -> &Measure {
        self.tools.pick.measure()
    }

    /// Replaces the measured points.
    pub fn set_measure(&mut self, measure: Measure) {
        self.tools.pick.set_measure(measure);
    }

    /// Removes the measurements.
    pub fn clear_measurements(&mut self) {
        self.tools.clear();
    }

    /// Whether the cut is frozen.
    pub fn is_frozen(&self) -> bool {
        self.frozen.is_some()
    }

    /// Freezes the cut, or releases it.
    pub fn toggle_frozen(&mut self) {
        self.frozen = match self.frozen {
            Some(_) => None,
            None => {
                let view = self.view();
                let far = self.camera.distance() - self.camera.depth_offset(&view);
                Some((view, far))
            }
        };
    }

    /// Gives the input of this pass to the tools, which move the camera.
    pub fn handle_input(&mut self, ui: &Ui, response: &Response, now_s: f64) {
        if self.picture_rect.is_none() {
            // The aspect ratio of the picture is known only now.
            let size = pixels(response.rect, ui.ctx().pixels_per_point(), 1.0);
            self.camera = self.views.first(size);
        }
        let before = self.camera.pose();
        self.tools.navigate.has_sun = self.scene.as_ref().is_some_and(Scene::is_lit);
        self.tools.input(ui, response, &mut self.camera);
        let is_dragging = self.tools.is_dragging();
        if !is_dragging {
            self.sharpness.let_go();
        }
        if self.camera.pose() != before {
            self.sharpness.moved(now_s, is_dragging);
        } else if !self.camera.is_moving() && !self.tools.needs_depth() {
            self.sharpness.rests();
        }
        self.picture_rect = Some(response.rect);
        self.full_px = pixels(response.rect, ui.ctx().pixels_per_point(), 1.0);
        if response.hovered() || is_dragging {
            ui.ctx().set_cursor_icon(self.tools.cursor());
        }
    }

    /// Keeps a session with the settings `wanted`, for pictures up to the size of the window. While
    /// the camera moves the method may be a faster one, unless a screenshot is requested.
    pub fn update_session(&mut self, ctx: &Context, wanted: &Settings, has_shot: bool, now_s: f64) {
        self.method = wanted.method;
        let (is_at_rest, is_by_cpu) = (!self.needs_redraw(now_s), self.is_by_cpu());
        let pace = self.pacing.update(ctx, now_s, is_at_rest, is_by_cpu);
        pace.into_iter().for_each(|pace| self.sharpness.set_pace(pace));
        let moving = self.sharpness.method(now_s, wanted.method);
        let method = if has_shot { wanted.method } else { moving };
        let shot = has_shot.then(|| {
            let new = || Shot { seen: self.camera.seen(), is_whole: self.is_at_rest() };
            self.shot.unwrap_or_else(new)
        });
        self.shot = shot;
        let occlusion = wanted.occlusion && !shot.is_some_and(|shot| shot.is_whole);
        let wanted = &Settings { method, occlusion, ..wanted.clone() };
        let window = pixels(ctx.content_rect(), ctx.pixels_per_point(), 1.0);
        if wanted.vertical != self.views.vertical() {
            self.views.set_vertical(wanted.vertical);
            self.camera = self.views.home(self.camera.is_parallel(), self.size);
        }
        let Some(scene) = &mut self.scene else {
            let file = self.opened.file.clone();
            self.scene = Some(Scene::new(file, wanted.clone(), self.device.clone(), window));
            return;
        };
        // The value of a slider changes in each pass while it is dragged. Light follows it.
        let light = wanted.light.clone();
        let is_light_alone = Settings { light, ..scene.settings().clone() } == *wanted;
        if !ctx.egui_is_using_pointer() || self.tools.is_dragging() || is_light_alone {
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

    /// Draws a frame if it would show something new. Returns the milliseconds that this took.
    pub fn draw(
        &mut self,
        ui: &Ui,
        now_s: f64,
        counters: &mut Counters,
        shots: &mut Shots,
    ) -> Option<f64> {
        let (ctx, rect) = (ui.ctx(), self.picture_rect?);
        let scale = if shots.is_requested() { 1.0 } else { self.sharpness.scale(now_s) };
        let has = self.scene.as_ref()?.drawn_size();
        self.size = within(pixels(rect, ctx.pixels_per_point(), scale), has);
        if let Some(boxes) = self.scene.as_ref().and_then(Scene::boxes) {
            self.camera.set_boxes(*boxes);
        }
        let views = self.views();
        let scene = self.scene.as_mut()?;
        if self.tools.needs_depth() || shots.is_requested() {
            scene.invalidate();
        }
        let method = scene.settings().method;
        let drawn = match scene.frame(&views) {
            FrameOutcome::New(frame) => {
                counters.lit = frame.light;
                counters.take_frame(&frame.cut, frame.stats.points_drawn, frame.times.draw_ms);
                let (start, drawn_ms) = (Instant::now(), frame.times.total_ms);
                // GPU time of the newest finished frame, if a GPU draws.
                let rendered_ms = frame.stats.stages.total_ms;
                let (tools, camera) = (&mut self.tools, &mut self.camera);
                let offset = camera.depth_offset(&views.seen);
                let from_eye = |depth: Option<f64>| depth.map(|depth| depth + offset);
                let size = DVec2::new(f64::from(self.size[0]), f64::from(self.size[1]));
                let load = Load {
                    points: frame.stats.points_drawn as f64,
                    pixels: size.x * size.y,
                    covered: frame.stats.pixels_covered as f64,
                };
                match frame.image {
                    Image::Memory(picture) => {
                        self.canvas.upload(ctx, picture);
                        let depths =
                            Depths { width: picture.width as usize, depth: &picture.depth };
                        self.hud.drew_memory(depths, views.seen, frame.is_final);
                        let at = &mut |at| from_eye(depths.near(at));
                        tools.take_depths(camera, &mut Depth { size, at });
                        let far = typical(|at| depths.exactly(at));
                        far.iter().for_each(|&far| camera.follow_depth(far, drawn_ms / 1e3));
                    }
                    Image::Texture(view) => {
                        if !self.canvas.show(view, self.size) {
                            self.canvas.upload(ctx, &scene.picture().ok()?);
                        }
                        if tools.needs_exact_depth() {
                            let picture = scene.picture().ok()?;
                            let depths =
                                Depths { width: picture.width as usize, depth: &picture.depth };
                            let at = &mut |at| from_eye(depths.near(at));
                            tools.take_depths(camera, &mut Depth { size, at });
                        } else {
                            let at = &mut |at| from_eye(scene.depth_at(at));
                            tools.take_depths(camera, &mut Depth { size, at });
                        }
                        self.hud.drew_texture(views.seen, scene.depth_at(DVec2::splat(0.5)));
                        let far = typical(|at| scene.depth_at(at));
                        far.iter().for_each(|&far| camera.follow_depth(far, rendered_ms / 1e3));
                    }
                }
                let work_ms = drawn_ms + start.elapsed().as_secs_f64() * 1e3;
                let ms = work_ms.max(rendered_ms);
                self.sharpness.drew(Drawn { method, scale, load, ms }, self.method);
                self.fault = None;
                let is_seen = |shot: Shot| shot.is_whole && shot.seen == self.camera.seen();
                let waits = self.shot.is_some_and(is_seen)
                    && (scene.settings().occlusion || !scene.is_at_rest(&views));
                if shots.is_requested() && !waits {
                    shots.take(scene.picture());
                }
                Some(work_ms)
            }
            FrameOutcome::Unchanged => None,
            FrameOutcome::Waiting => {
                // New settings were tried, which may have removed the fault.
                self.fault = None;
                None
            }
            FrameOutcome::Failed(fault) => {
                // The name of the temporary file means nothing to a user who opened a scan.
                let built = self.opened.file.path().display().to_string();
                let is_built = self.opened.is_built();
                let fault = fault::in_words(&fault);
                self.fault = Some(if is_built { fault.replace(&built, &self.name) } else { fault });
                None
            }
        };
        counters.take_status(scene.status(), now_s);
        counters.gpu_bytes = scene.gpu_bytes();
        let shown = self.shown();
        self.tools.advance(ctx, shown.as_ref());
        drawn
    }

    /// Paints the picture, and over it the frozen frustum, measurements, faults, compass, scale bar
    /// and coordinates; a click on the compass turns the camera.
    pub fn paint(&mut self, ui: &Ui) {
        let Some(rect) = self.picture_rect else { return };
        self.canvas.paint(ui, rect);
        let painter = ui.painter_at(rect);
        if let Some((frozen, depth)) = &self.frozen {
            frustum::paint(&painter, rect, frozen, &self.view(), *depth, theme::ACCENT);
            let corner = rect.left_top() + vec2(14.0, 12.0);
            let text =
                "frozen: the nodes are those for the view of these lines; Space releases them";
            let font = FontId::proportional(13.0);
            let text = painter.layout_no_wrap(text.into(), font, theme::ACCENT);
            let behind = Rect::from_min_size(corner, text.size()).expand(6.0);
            painter.rect_filled(behind, 4.0, Color32::from_black_alpha(170));
            painter.galley(corner, text, theme::ACCENT);
        }
        let seen = &self.view();
        let over = Over { painter: &painter, rect, seen };
        for (text, at) in &self.annotations {
            over.text(*at, text.clone());
            over.mark(*at);
        }
        self.tools.paint(&painter, rect, seen);
        if let Some(fault) = &self.fault {
            progress::fault_over(ui, rect, fault);
            return;
        }
        let scene = self.scene.as_ref();
        let at = |at: DVec2| scene.and_then(|scene| scene.depth_at(at));
        if let Some(axis) = self.hud.show(ui, rect, &self.camera, at) {
            self.look_along(axis);
            ui.ctx().request_repaint();
        }
    }

    /// Whether the CPU draws the scene.
    fn is_by_cpu(&self) -> bool {
        let drawer = self.scene.as_ref().and_then(Scene::drawer);
        drawer.is_some_and(|drawer| drawer.adapter.is_none())
    }

    /// Whether the picture is final: nothing more is loaded for the view.
    pub fn is_at_rest(&self) -> bool {
        self.scene.as_ref().is_some_and(|scene| scene.is_at_rest(&self.views()))
    }

    /// Whether the next frame may differ although there is no input.
    pub fn needs_redraw(&self, now_s: f64) -> bool {
        let is_done = self.is_at_rest() || self.fault.is_some();
        let is_moving = self.camera.is_moving() || self.sharpness.is_moving(now_s);
        !is_done || is_moving || self.resized.is_some() || self.tools.is_busy()
    }

    /// View of the camera for a picture of the present size.
    fn view(&self) -> View {
        self.camera.view(self.size)
    }

    fn views(&self) -> FrameViews {
        let seen = self.view();
        FrameViews { chosen: self.frozen.map_or(seen, |(view, _)| view), seen }
    }
}

/// Size in pixels of a rectangle of the window, scaled by `scale` on each side; at least one pixel.
pub fn pixels(rect: Rect, pixels_per_point: f32, scale: f64) -> [u32; 2] {
    let side = |points: f32| ((f64::from(points * pixels_per_point) * scale).round() as u32).max(1);
    [side(rect.width()), side(rect.height())]
}

/// Scales `size` down to fit within `most`, with the same aspect ratio: size of the pictures of a
/// window that has grown, until a session of that size is open.
fn within(size: [u32; 2], most: [u32; 2]) -> [u32; 2] {
    let share = |i: usize| f64::from(most[i]) / f64::from(size[i]);
    let share = share(0).min(share(1)).min(1.0);
    size.map(|side| ((f64::from(side) * share) as u32).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_window_shows_a_picture_of_its_aspect_ratio_that_the_session_can_draw() {
        assert_eq!(within([640, 400], [1280, 800]), [640, 400]);
        assert_eq!(within([2560, 1600], [1280, 900]), [1280, 800]);
        assert_eq!(within([10_000, 1], [100, 100]), [100, 1]);
    }
}
