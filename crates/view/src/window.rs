//! Who shows the window: eframe on a real GPU, by Vulkan (or Metal, Direct3D) before OpenGL; where
//! there is none, the CPU, which is several times faster than a software driver. A machine without
//! a display gets a message that says what to do.

use crate::app::App;
use crate::args::{Args, Backend, WindowBy};
use crate::device::{ShownBy, device_of};
use crate::soft;
use crate::soft::NO_DISPLAY;
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

/// The window's title.
pub const TITLE: &str = "Esker";

/// Shows the window until it is closed.
///
/// # Errors
/// Where there is no display, or no driver and one was asked for; and those of the app.
pub fn run(args: Args, start: Instant) -> Result<ExitCode> {
    let wanted = args.window;
    if wanted == WindowBy::Cpu {
        let viewport = viewport(&args);
        soft::run(App::new(args, start)?, viewport)?;
        return Ok(ExitCode::SUCCESS);
    }
    match by_driver(args, start) {
        Err(Fault::Driver(fault)) if wanted == WindowBy::Auto => {
            eprintln!("note: {fault}; the window is painted by the CPU");
            again_by_cpu()
        }
        Err(fault) => Err(fault.into()),
        Ok(()) => Ok(ExitCode::SUCCESS),
    }
}

/// The same command with a window that needs no driver, in a process of its own: a process has its
/// connection to the display once.
fn again_by_cpu() -> Result<ExitCode> {
    let program = std::env::current_exe().context("cannot find the program itself")?;
    let mut command = Command::new(program);
    command.args(["--window", "cpu"]).args(rest());
    run_instead(command).context("cannot start the program again")
}

/// In this process's place, so that whoever stops it stops the window.
#[cfg(unix)]
fn run_instead(mut command: Command) -> std::io::Result<ExitCode> {
    Err(std::os::unix::process::CommandExt::exec(&mut command))
}

#[cfg(not(unix))]
fn run_instead(mut command: Command) -> std::io::Result<ExitCode> {
    let status = command.status()?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}

/// The arguments but for `--window`, which is told once.
fn rest() -> Vec<OsString> {
    let mut arguments: Vec<_> = std::env::args_os().skip(1).collect();
    if let Some(at) = arguments.iter().position(|argument| argument == "--window") {
        arguments.drain(at..(at + 2).min(arguments.len()));
    }
    arguments.retain(|argument| argument != "--window=auto");
    arguments
}

/// Why there was no window, or what came of it.
enum Fault {
    /// No graphics driver can show it.
    Driver(String),
    /// Anything else.
    Other(anyhow::Error),
}

/// Through eframe, on a driver.
fn by_driver(args: Args, start: Instant) -> Result<(), Fault> {
    let options = options(&args);
    let app = App::new(args, start).map_err(Fault::Other)?;
    // The window takes the app; what came of it is left here.
    let verdict = Arc::new(Mutex::new(Ok(())));
    let left = Arc::clone(&verdict);
    let shell = |cc: &CreationContext<'_>| -> Result<Box<dyn eframe::App>, _> {
        Ok(Box::new(Shell::new(app, left, cc)) as Box<dyn eframe::App>)
    };
    eframe::run_native(TITLE, options, Box::new(shell))?;
    let mut verdict = verdict.lock().unwrap_or_else(PoisonError::into_inner);
    std::mem::replace(&mut *verdict, Ok(())).map_err(Fault::Other)
}

impl From<eframe::Error> for Fault {
    fn from(error: eframe::Error) -> Self {
        match error {
            eframe::Error::Wgpu(error) => Self::Driver(format!("no graphics driver: {error}")),
            error => Self::Other(anyhow!("{NO_DISPLAY}: {error}")),
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
    if args.window == WindowBy::Gl {
        setup.instance_descriptor.backends = wgpu::Backends::GL;
    }
    setup.device_descriptor = Arc::new(device_of);
    // A software driver paints a window several times slower than the CPU alone does.
    let is_real = args.window == WindowBy::Auto && args.backend != Backend::Gpu;
    setup.native_adapter_selector =
        Some(Arc::new(move |adapters, surface| choose(adapters, surface, is_real)));
    let wgpu_options = WgpuConfiguration {
        surface: SurfaceConfig::LOW_LATENCY,
        wgpu_setup: WgpuSetup::CreateNew(setup),
        ..WgpuConfiguration::default()
    };
    NativeOptions { viewport: viewport(args), wgpu_options, ..NativeOptions::default() }
}

/// The adapter to show the window by: one that can show it, real GPUs first, OpenGL last; no
/// software driver where `is_real`.
fn choose(
    adapters: &[wgpu::Adapter],
    surface: Option<&wgpu::Surface<'_>>,
    is_real: bool,
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
    let best = best.ok_or("none can show a window")?;
    let info = best.get_info();
    if is_real && is_software(&info) {
        return Err(format!("there is only {}, a software driver", info.name));
    }
    Ok(best.clone())
}

/// What came of the app.
type Verdict = Arc<Mutex<Result<()>>>;

/// The app as eframe runs it.
struct Shell {
    app: App,
    verdict: Verdict,
}

impl Shell {
    fn new(mut app: App, verdict: Verdict, cc: &CreationContext<'_>) -> Self {
        let shown_by = cc.wgpu_render_state.as_ref().map(ShownBy::driver).unwrap_or_default();
        app.show_by(&cc.egui_ctx, shown_by);
        Self { app, verdict }
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
        let verdict = self.app.end();
        *self.verdict.lock().unwrap_or_else(PoisonError::into_inner) = verdict;
    }

    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        crate::theme::GROUND.to_normalized_gamma_f32()
    }
}
