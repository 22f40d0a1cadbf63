//! Opens the window: eframe on a real GPU, with Vulkan (or Metal, Direct3D) preferred to OpenGL;
//! without a real GPU the CPU paints it, which is several times faster than a software driver. On a
//! machine without a display the error says what to do.

use crate::app::App;
use crate::args::{Args, Backend, WindowBackend};
use crate::device::{WindowPainter, device_of};
use crate::soft;
use crate::soft::NO_DISPLAY;
use crate::theme::TITLE;
use anyhow::{Context, Result, anyhow};
use eframe::egui::{self, ViewportBuilder};
use eframe::egui_wgpu::{SurfaceConfig, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use eframe::wgpu;
use eframe::{CreationContext, NativeOptions};
use esker_engine::draw::options::is_software;
use std::ffi::OsString;
use std::process::{Command, ExitCode};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Shows the window until it is closed.
///
/// # Errors
/// If there is no display, or no driver although one was requested; or if the application fails.
pub fn run(args: Args, start: Instant) -> Result<ExitCode> {
    let wanted = args.window;
    if wanted == WindowBackend::Cpu {
        let viewport = viewport(&args);
        soft::run(App::new(args, start)?, viewport)?;
        return Ok(ExitCode::SUCCESS);
    }
    match run_on_driver(args, start) {
        Err(Fault::Driver(fault)) if wanted == WindowBackend::Auto => {
            eprintln!("note: {fault}; the window is painted by the CPU");
            restart_on_cpu()
        }
        Err(fault) => Err(fault.into()),
        Ok(()) => Ok(ExitCode::SUCCESS),
    }
}

/// Runs the same command in a new process with a window that needs no driver, because a process can
/// connect to the display only once.
fn restart_on_cpu() -> Result<ExitCode> {
    let program = std::env::current_exe().context("cannot find the program itself")?;
    let mut command = Command::new(program);
    command.args(["--window", "cpu"]).args(arguments_without_window());
    replace_process(command).context("cannot start the program again")
}

/// Replaces this process, so that a signal to it reaches the window.
#[cfg(unix)]
fn replace_process(mut command: Command) -> std::io::Result<ExitCode> {
    Err(std::os::unix::process::CommandExt::exec(&mut command))
}

#[cfg(not(unix))]
fn replace_process(mut command: Command) -> std::io::Result<ExitCode> {
    let status = command.status()?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}

/// The arguments of this process without `--window`, which may be given only once.
fn arguments_without_window() -> Vec<OsString> {
    let mut arguments: Vec<_> = std::env::args_os().skip(1).collect();
    if let Some(at) = arguments.iter().position(|argument| argument == "--window") {
        arguments.drain(at..(at + 2).min(arguments.len()));
    }
    arguments.retain(|argument| argument != "--window=auto");
    arguments
}

/// Error of a window that cannot be opened. What winit says ends in a path of its own source.
fn no_display(error: &eframe::Error) -> anyhow::Error {
    match error {
        eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_) => anyhow!(NO_DISPLAY),
        error => anyhow!("{NO_DISPLAY}: {error}"),
    }
}

/// Why the window failed.
enum Fault {
    /// No graphics driver can show the window.
    Driver(String),
    /// Any other error.
    Other(anyhow::Error),
}

/// Runs the application in eframe, on a graphics driver.
fn run_on_driver(args: Args, start: Instant) -> Result<(), Fault> {
    let options = options(&args);
    let app = App::new(args, start).map_err(Fault::Other)?;
    // eframe owns the application; its result is left here.
    let result = Arc::new(Mutex::new(Ok(())));
    let left = Arc::clone(&result);
    let shell = |cc: &CreationContext<'_>| -> Result<Box<dyn eframe::App>, _> {
        Ok(Box::new(Shell::new(app, left, cc)) as Box<dyn eframe::App>)
    };
    eframe::run_native(TITLE, options, Box::new(shell))?;
    let mut result = result.lock().unwrap_or_else(PoisonError::into_inner);
    std::mem::replace(&mut *result, Ok(())).map_err(Fault::Other)
}

impl From<eframe::Error> for Fault {
    fn from(error: eframe::Error) -> Self {
        match error {
            eframe::Error::Wgpu(error) => Self::Driver(format!("no graphics driver: {error}")),
            error => Self::Other(no_display(&error)),
        }
    }
}

impl From<Fault> for anyhow::Error {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Driver(fault) => anyhow!(
                "{fault}; install one (on Debian and Ubuntu: mesa-vulkan-drivers), or start with --window cpu"
            ),
            Fault::Other(error) => error,
        }
    }
}

fn viewport(args: &Args) -> ViewportBuilder {
    let [width, height] = args.size.map(|s| s as f32);
    ViewportBuilder::default()
        .with_title(TITLE)
        .with_app_id("esker-view")
        .with_inner_size([width, height])
        .with_min_inner_size([320.0, 240.0])
}

fn options(args: &Args) -> NativeOptions {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    if args.window == WindowBackend::Gl {
        setup.instance_descriptor.backends = wgpu::Backends::GL;
    }
    setup.device_descriptor = Arc::new(device_of);
    // Painting with a software driver is several times slower than painting with the CPU.
    let must_be_real = args.window == WindowBackend::Auto && args.backend != Backend::Gpu;
    setup.native_adapter_selector =
        Some(Arc::new(move |adapters, surface| choose(adapters, surface, must_be_real)));
    let wgpu_options = WgpuConfiguration {
        surface: SurfaceConfig::LOW_LATENCY,
        wgpu_setup: WgpuSetup::CreateNew(setup),
        ..WgpuConfiguration::default()
    };
    // Fonts of the system are asked for by `fonts`, on demand.
    let viewport = viewport(args);
    NativeOptions {
        viewport,
        wgpu_options,
        system_font_fallback: false,
        ..NativeOptions::default()
    }
}

/// Chooses the adapter that paints the window: one that can show it, real GPUs first, OpenGL last.
/// If `must_be_real`, a software driver is an error.
fn choose(
    adapters: &[wgpu::Adapter],
    surface: Option<&wgpu::Surface<'_>>,
    must_be_real: bool,
) -> Result<wgpu::Adapter, String> {
    let fits = |a: &&wgpu::Adapter| surface.is_none_or(|s| a.is_surface_supported(s));
    let rank = |a: &&wgpu::Adapter| {
        let info = a.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        (kind, info.backend == wgpu::Backend::Gl)
    };
    let best = adapters.iter().filter(fits).min_by_key(rank);
    let best = best.ok_or("no adapter can show a window")?;
    let info = best.get_info();
    if must_be_real && is_software(&info) {
        return Err(format!("there is only {}, a software driver", info.name));
    }
    Ok(best.clone())
}

/// Result of the application.
type AppResult = Arc<Mutex<Result<()>>>;

/// The application as eframe runs it.
struct Shell {
    app: App,
    result: AppResult,
}

impl Shell {
    fn new(mut app: App, result: AppResult, cc: &CreationContext<'_>) -> Self {
        let window_painter =
            cc.wgpu_render_state.as_ref().map(WindowPainter::driver).unwrap_or_default();
        app.set_window_painter(&cc.egui_ctx, window_painter);
        Self { app, result }
    }
}

impl eframe::App for Shell {
    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        self.app.pass(ui);
    }

    fn raw_input_hook(&mut self, ctx: &egui::Context, raw: &mut egui::RawInput) {
        self.app.input(ctx, raw);
    }

    fn on_exit(&mut self) {
        let result = self.app.end();
        *self.result.lock().unwrap_or_else(PoisonError::into_inner) = result;
    }

    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        crate::theme::DARK.ground.to_normalized_gamma_f32()
    }
}
