//! A window without a graphics driver: winit opens it, the CPU paints egui's meshes where they have
//! changed, softbuffer shows the pixels.

pub(crate) mod clip;
mod damage;
pub(crate) mod painter;

use crate::app::App;
use crate::device::WindowPainter;
use crate::fit;
use crate::theme;
use anyhow::{Context as _, Result, anyhow};
use clip::Clip;
use damage::{add, damage};
use eframe::egui::epaint::ClippedPrimitive;
use eframe::egui::{
    ColorImage, Context, FullOutput, ScreenshotCallback, Vec2, ViewportBuilder, ViewportCommand,
    ViewportId, vec2,
};
use egui_winit::accesskit_winit;
use esker_engine::machine::system;
use painter::{Painter, Target};
use softbuffer::Surface;
use std::num::NonZeroU32;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{
    ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy, OwnedDisplayHandle,
};
use winit::window::{Window, WindowId};

/// Error if no window can be opened, with what to do.
pub(crate) const NO_DISPLAY: &str = "cannot open a window: it needs a display (DISPLAY or WAYLAND_DISPLAY), and on X11 the packages \
    libxkbcommon-x11-0, libxcursor1 and libxi6; without one: esker render FILE -o picture.png";

/// Shows the window until it is closed. Returns the result of the application.
///
/// # Errors
/// If there is no display, or if the application fails.
pub fn run(app: App, viewport: ViewportBuilder) -> Result<()> {
    let event_loop = EventLoop::with_user_event().build();
    // What winit says ends in a path of its own source.
    let event_loop = event_loop.map_err(|_| anyhow!(NO_DISPLAY))?;
    let accessibility = event_loop.create_proxy();
    let (ctx, outcome) = (Context::default(), Ok(()));
    let mut shell = Shell { app, viewport, ctx, accessibility, open: None, outcome };
    event_loop.run_app(&mut shell).context("the window's events ended")?;
    let Shell { mut app, open, outcome, .. } = shell;
    let ended = app.end();
    drop(open);
    outcome.and(ended)
}

/// Request of a screen reader or of another assistive program.
struct Assistive(accesskit_winit::Event);

impl From<accesskit_winit::Event> for Assistive {
    fn from(event: accesskit_winit::Event) -> Self {
        Self(event)
    }
}

/// The application and its window.
struct Shell {
    app: App,
    viewport: ViewportBuilder,
    ctx: Context,
    accessibility: EventLoopProxy<Assistive>,
    open: Option<OpenWindow>,
    outcome: Result<()>,
}

/// A window that is open.
struct OpenWindow {
    window: Rc<Window>,
    surface: Surface<OwnedDisplayHandle, Rc<Window>>,
    state: egui_winit::State,
    painter: Painter,
    last: Option<LastFrame>,
    /// Whether the next frame was requested here, not by the system.
    is_requested: bool,
    /// When the next pass of egui is due.
    due: Option<Instant>,
}

/// What the last frame showed.
struct LastFrame {
    primitives: Vec<ClippedPrimitive>,
    scale: f32,
    /// Size, pixels.
    size: [usize; 2],
    /// What was painted in the last frame that was presented.
    presented: Vec<Clip>,
}

impl ApplicationHandler<Assistive> for Shell {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.open.is_some() {
            return;
        }
        let opened = OpenWindow::open(&self.ctx, event_loop, &self.viewport, &self.accessibility);
        match opened.context(NO_DISPLAY) {
            Ok(open) => {
                let window_painter = WindowPainter { name: "CPU".into(), driver: None };
                self.app.set_window_painter(&self.ctx, window_painter);
                let open = self.open.insert(open);
                open.request_redraw();
            }
            Err(error) => self.stop(event_loop, error),
        }
    }

    fn new_events(&mut self, _event_loop: &ActiveEventLoop, _cause: StartCause) {
        let Some(open) = &mut self.open else { return };
        if open.due.is_some_and(|due| due <= Instant::now()) {
            open.due = None;
            open.request_redraw();
        }
    }

    fn user_event(&mut self, _event_loop: &ActiveEventLoop, Assistive(event): Assistive) {
        let Some(open) = &mut self.open else { return };
        match event.window_event {
            accesskit_winit::WindowEvent::InitialTreeRequested => self.ctx.enable_accesskit(),
            accesskit_winit::WindowEvent::ActionRequested(request) => {
                open.state.on_accesskit_action_request(request);
            }
            accesskit_winit::WindowEvent::AccessibilityDeactivated => self.ctx.disable_accesskit(),
        }
        open.window.request_redraw();
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _id: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => {
                if !std::mem::take(&mut open.is_requested) {
                    // A part of the window has come into view, and has to be shown again.
                    open.last = None;
                }
                if let Err(error) = self.pass(event_loop) {
                    self.stop(event_loop, error);
                }
            }
            event => {
                if matches!(event, WindowEvent::Occluded(_) | WindowEvent::Focused(_)) {
                    open.last = None;
                }
                if open.state.on_window_event(&open.window, &event).repaint {
                    open.request_redraw();
                }
            }
        }
    }
}

impl Shell {
    fn stop(&mut self, event_loop: &ActiveEventLoop, error: anyhow::Error) {
        self.outcome = Err(error);
        event_loop.exit();
    }

    fn pass(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
        let Some(open) = &mut self.open else { return Ok(()) };
        let began_ms = system::cpu_ms();
        let mut input = open.state.take_egui_input(&open.window);
        self.app.input(&self.ctx, &mut input);
        let app = &mut self.app;
        let output = self.ctx.run_ui(input, |ui| app.pass(ui));
        let mut shots = Vec::new();
        for command in
            output.viewport_output.get(&ViewportId::ROOT).iter().flat_map(|v| &v.commands)
        {
            match command {
                ViewportCommand::Close => event_loop.exit(),
                ViewportCommand::Title(title) => open.window.set_title(title),
                ViewportCommand::Screenshot(callback) => shots.push(callback.clone()),
                _ => {}
            }
        }
        let delay = output.viewport_output.get(&ViewportId::ROOT).map(|v| v.repaint_delay);
        let pixels = open.paint(&self.ctx, output, shots)?;
        if let (Some(began), Some(ended)) = (began_ms, system::cpu_ms()) {
            self.app.painted(ended - began, pixels);
        }
        open.repaint_after(event_loop, delay.unwrap_or(Duration::MAX));
        Ok(())
    }
}

impl OpenWindow {
    fn open(
        ctx: &Context,
        event_loop: &ActiveEventLoop,
        viewport: &ViewportBuilder,
        accessibility: &EventLoopProxy<Assistive>,
    ) -> Result<Self> {
        let monitor = monitor_points(event_loop);
        let wanted = viewport.inner_size.unwrap_or_default();
        let viewport = viewport.clone().with_inner_size(fit::within(wanted, monitor));
        // Assistive programs must know a window before it is shown.
        let viewport = viewport.with_visible(false);
        let window = Rc::new(egui_winit::create_window(ctx, event_loop, &viewport)?);
        let fault = |e: softbuffer::SoftBufferError| anyhow!("cannot show pixels in a window: {e}");
        let display = softbuffer::Context::new(event_loop.owned_display_handle()).map_err(fault)?;
        let surface = Surface::new(&display, Rc::clone(&window)).map_err(fault)?;
        let scale = window.scale_factor() as f32;
        let mut state = egui_winit::State::new(
            ctx.clone(),
            ViewportId::ROOT,
            event_loop,
            Some(scale),
            event_loop.system_theme(),
            None,
        );
        let info = state.egui_input_mut().viewports.entry(ViewportId::ROOT).or_default();
        info.monitor_size = (monitor != Vec2::ZERO).then_some(monitor);
        state.init_accesskit(event_loop, &window, accessibility.clone());
        window.set_visible(true);
        Ok(Self {
            window,
            surface,
            state,
            painter: Painter::default(),
            last: None,
            is_requested: false,
            due: None,
        })
    }

    fn request_redraw(&mut self) {
        self.is_requested = true;
        self.window.request_redraw();
    }

    /// Paints what has changed since the last frame. Returns the number of pixels.
    fn paint(
        &mut self,
        ctx: &Context,
        output: FullOutput,
        shots: Vec<ScreenshotCallback>,
    ) -> Result<usize> {
        self.state.handle_platform_output(&self.window, output.platform_output);
        let mut textures = output.textures_delta;
        let changed = self.painter.take(&mut textures);
        let scale = output.pixels_per_point;
        let primitives = ctx.tessellate(output.shapes, scale);
        let mut painted = 0;
        let size = self.window.inner_size();
        if let (Some(width), Some(height)) =
            (NonZeroU32::new(size.width), NonZeroU32::new(size.height))
        {
            let fault =
                |e: softbuffer::SoftBufferError| anyhow!("cannot show pixels in the window: {e}");
            self.surface.resize(width, height).map_err(fault)?;
            let mut buffer = self.surface.buffer_mut().map_err(fault)?;
            let [r, g, b, _] = theme::of(ctx).ground.to_array().map(u32::from);
            let [width, height] = [size.width as usize, size.height as usize];
            let size = [width, height];
            let last = self.last.take().filter(|last| (last.scale, last.size) == (scale, size));
            // A buffer of age 1 has the last frame, and one of age 2 that before it.
            let has_frame = buffer.age() == 1 || (buffer.age() == 2 && shots.is_empty());
            let mut damaged = match last.as_ref().filter(|_| has_frame) {
                Some(last) => damage(&last.primitives, &primitives, &changed, scale, size),
                None => vec![Clip::whole(size)],
            };
            let presented = last.map_or_else(Vec::new, |last| last.presented);
            let own = damaged.clone();
            if buffer.age() == 2 && !own.is_empty() {
                presented.iter().for_each(|clip| add(&mut damaged, *clip));
            }
            let mut target = Target { width, height, pixels: &mut buffer };
            for clip in &damaged {
                target.clear(*clip, r << 16 | g << 8 | b);
                self.painter.paint(&primitives, scale, *clip, &mut target);
                painted += clip.pixels();
            }
            if !shots.is_empty() {
                let image = Arc::new(image_of(&buffer, size));
                shots.into_iter().for_each(|shot| shot.complete(Arc::clone(&image)));
            }
            let rects: Vec<softbuffer::Rect> = damaged.into_iter().filter_map(rect_of).collect();
            let presented = if rects.is_empty() { presented } else { own };
            if !rects.is_empty() {
                buffer.present_with_damage(&rects).map_err(fault)?;
            }
            self.last = Some(LastFrame { primitives, scale, size, presented });
        }
        self.painter.free(&mut textures);
        Ok(painted)
    }

    /// Schedules the next pass after `delay`.
    fn repaint_after(&mut self, event_loop: &ActiveEventLoop, delay: Duration) {
        if delay.is_zero() {
            self.request_redraw();
            return;
        }
        self.due = Instant::now().checked_add(delay);
        event_loop.set_control_flow(self.due.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }
}

/// A rectangle for softbuffer; `None` if it has no pixel.
fn rect_of(clip: Clip) -> Option<softbuffer::Rect> {
    let [x, y] = [clip.x, clip.y].map(|[from, to]| (from, to - from));
    let length = |length: i64| u32::try_from(length).ok().and_then(NonZeroU32::new);
    Some(softbuffer::Rect {
        x: u32::try_from(x.0).ok()?,
        y: u32::try_from(y.0).ok()?,
        width: length(x.1)?,
        height: length(y.1)?,
    })
}

/// Size of the monitor on which windows open, points; zero if it is unknown.
fn monitor_points(event_loop: &ActiveEventLoop) -> Vec2 {
    let monitor = event_loop.primary_monitor().or_else(|| event_loop.available_monitors().next());
    monitor.map_or(Vec2::ZERO, |monitor| {
        let size = monitor.size().to_logical::<f32>(monitor.scale_factor());
        vec2(size.width, size.height)
    })
}

fn image_of(pixels: &[u32], size: [usize; 2]) -> ColorImage {
    let rgb =
        pixels.iter().flat_map(|p| [(p >> 16) as u8, (p >> 8) as u8, *p as u8]).collect::<Vec<_>>();
    ColorImage::from_rgb(size, &rgb)
}
