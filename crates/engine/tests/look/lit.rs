//! Lit pictures of the sample scan: golden ones, sessions that refine theirs until they are final,
//! what is read around the view, and the share of main memory.

use super::look::{is_golden, request};
use esker_engine::calls::explain::explain;
use esker_engine::calls::info;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::budget::{GpuShares, Shares};
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::light::document::{Emissive, Lights};
use esker_engine::light::settings::LightSettings;
use esker_engine::light::spec::parse;
use esker_engine::light::status::LitStatus;
use esker_engine::machine::backend::{Backend, GpuRequest};
use esker_engine::{Method, NormalsMode, Picture};
use esker_format::Forest;
use esker_lod::View;
use esker_points::task::Silent;
use esker_render::gpu::Gpu;
use esker_render::gpu::device::all_interfaces;
use esker_truth::flip::mean_flip;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

const SIZE: [u32; 2] = [128, 96];
/// Class of all points of the sample.
const CLASS: u8 = 0;
/// A view up the valley.
const CAMERA: &str = "eye=5679750,3769950,1480;target=5679080,3770560,955;fovy=48";

/// The project's sample scan with normals; built once for all tests.
fn creek() -> Forest {
    static CREEK: OnceLock<PathBuf> = OnceLock::new();
    let path = CREEK.get_or_init(|| {
        let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("creek-normals.esker");
        let normals = NormalsMode::Estimate;
        let options = esker_builder::Options { node_capacity: 2048, normals, ..Default::default() };
        esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
        out
    });
    Forest::open(path).unwrap()
}

fn lit(lights: &str) -> PictureRequest {
    PictureRequest {
        size: SIZE,
        method: Method::Lit,
        camera: Camera::parse(CAMERA).unwrap(),
        light: light(lights),
        ..request()
    }
}

fn light(lights: &str) -> LightSettings {
    let lights = Some(parse(lights).unwrap());
    LightSettings { lights, exposure: Some(1.0), ..LightSettings::default() }
}

fn settings(lights: &str) -> Settings {
    Settings {
        method: Method::Lit,
        light: light(lights),
        budget_gpu_bytes: 64 << 20,
        budget_ram_bytes: 128 << 20,
        ..Settings::default()
    }
}

fn session(settings: Settings) -> Session {
    let backend = Backend::Cpu;
    let options = Options { settings, backend, size: SIZE, ..Options::default() };
    Session::open(Arc::new(creek()), options).unwrap()
}

fn view(file: &Forest) -> View {
    Camera::parse(CAMERA).unwrap().view(info::bounds(file), SIZE)
}

/// Draws frames until one is final. Returns its picture and state, and the number of frames.
fn settle(session: &mut Session, view: &View) -> (Picture, LitStatus, u32) {
    let deadline = Instant::now() + Duration::from_secs(240);
    for frames in 1.. {
        let frame = session.frame(view).unwrap();
        let light = frame.light.unwrap();
        let picture = frame.image.in_memory().unwrap();
        assert_eq!([picture.width, picture.height], SIZE);
        if frame.is_final {
            assert!(frame.cut.settled && frame.is_of_view);
            return (picture.clone(), light, frames);
        }
        assert!(Instant::now() < deadline, "{light:?}");
    }
    unreachable!()
}

/// Mean of all colours, 0 to 255.
fn mean(picture: &Picture) -> f64 {
    let colours = picture.rgba.chunks_exact(4).flat_map(|pixel| &pixel[..3]);
    colours.map(|&c| f64::from(c)).sum::<f64>() / (picture.rgba.len() / 4 * 3) as f64
}

#[test]
fn lit_pictures_have_their_golden_pictures() {
    let file = creek();
    is_golden(&file, &lit("sun:225,40|sky"), "lit-creek-day.png");
    let dim = LightSettings { exposure: Some(4.0), ..light("sun:300,8|sky:0.3") };
    let colour_by = Some("plain".into());
    let low = PictureRequest { colour_by, light: dim, ..lit("sky") };
    is_golden(&file, &low, "lit-creek-evening.png");
}

#[test]
fn a_session_refines_its_picture_to_the_one_of_a_still() {
    let mut session = session(settings("sun:225,40|sky"));
    let view = view(session.file());
    let (picture, light, frames) = settle(&mut session, &view);
    assert_eq!(light.samples, light.samples_final);
    assert!(frames > 2, "a final picture takes a coarse one and a fine one");
    assert!(light.splats > 1000 && !light.is_bounded, "{light:?}");
    let (still, report) = draw(session.file(), &lit("sun:225,40|sky"), &Silent).unwrap();
    assert_eq!(report.light.unwrap().splats, light.splats);
    let flip = mean_flip(&picture.rgba, &still.rgba, SIZE[0] as usize);
    assert!(flip < 0.1, "FLIP {flip} between a session and a still");
    // The same view again is the same picture, at once.
    let frame = session.frame(&view).unwrap();
    assert!(frame.is_final);
    assert!(frame.image.in_memory().unwrap().rgba == picture.rgba);
}

#[test]
fn moving_the_sun_begins_a_picture_without_opening_a_session() {
    let mut session = session(settings("sun:225,40"));
    let view = view(session.file());
    let (day, ..) = settle(&mut session, &view);
    session.set_light(light("sun:225,2"));
    let frame = session.frame(&view).unwrap();
    assert!(!frame.is_final);
    assert_eq!(frame.light.unwrap().samples, 0, "the first picture is a coarse one");
    let (evening, ..) = settle(&mut session, &view);
    assert!(mean(&evening) < mean(&day) - 5.0, "{} after {}", mean(&evening), mean(&day));
    assert!(!session.set_method(Method::Ewa), "a session of light draws nothing else");
}

#[test]
fn points_shine_by_their_classes_in_sessions_as_in_stills() {
    let shining = Emissive { classes: vec![CLASS], bounds: None, radiance: [0.5, 0.4, 0.2] };
    let lights = Lights { emissive: vec![shining], ..Lights::from(Vec::new()) };
    let light = LightSettings { lights: Some(lights), ..light("sky") };
    let settings = Settings { light: light.clone(), ..settings("sky") };
    // Colours are made of classes along a range, so that their plane is read in another way.
    for colour_by in [None, Some("classification:-8..8".to_owned())] {
        let mut session = session(Settings { colour_by: colour_by.clone(), ..settings.clone() });
        let view = view(session.file());
        let (picture, ..) = settle(&mut session, &view);
        let light = LightSettings { samples: 64, ..light.clone() };
        let request = PictureRequest { light, colour_by, ..lit("sky") };
        let (still, _) = draw(session.file(), &request, &Silent).unwrap();
        let flip = mean_flip(&picture.rgba, &still.rgba, SIZE[0] as usize);
        assert!(flip < 0.1, "FLIP {flip} between a session and a still");
        let dark = PictureRequest { light: self::light("sun:0,-45"), ..request };
        let (dark, _) = draw(session.file(), &dark, &Silent).unwrap();
        assert!(mean(&picture) > mean(&dark) + 20.0, "{} {}", mean(&picture), mean(&dark));
    }
}

#[test]
fn pictures_that_are_not_lit_have_no_pipeline_and_no_memory_of_light() {
    let file = creek();
    for method in [Method::Points, Method::PullPush, Method::Ewa] {
        let request = PictureRequest { method, ..lit("sky") };
        let plan = explain(&[file.path().into()], &request, &Silent).unwrap();
        let shaders: Vec<&str> = plan.variants.iter().map(|variant| variant.shader).collect();
        let of_light = |shader: &&str| {
            ["trace", "filter", "splats"].iter().any(|folder| shader.starts_with(folder))
        };
        assert!(!shaders.is_empty() && !shaders.iter().any(of_light), "{shaders:?}");
        let mut session = session(Settings { method, ..settings("sky") });
        let view = view(session.file());
        assert!(session.frame(&view).unwrap().light.is_none(), "{method:?}");
    }
}

#[test]
fn only_lit_sessions_and_pictures_read_what_lies_around_the_view() {
    let file = creek();
    let near = "eye=5679750,3769950,1480;target=5679080,3770560,955;fovy=4";
    let camera = Camera::parse(near).unwrap();
    let around = |method| {
        let request = PictureRequest { camera, method, ..lit("sky") };
        let scene = PictureScene::read(&file, &request, &Silent).unwrap();
        (scene.selection.surroundings.len(), scene.planes.len() - scene.selection.drawn.len())
    };
    let (chosen, read) = around(Method::Lit);
    assert!(chosen > 0 && chosen == read, "{chosen} nodes around the view, {read} read");
    assert_eq!(around(Method::Ewa), (0, 0));
    let view = camera.view(info::bounds(&file), SIZE);
    let mut has = [Method::Ewa, Method::Lit].map(|method| {
        let mut session = session(Settings { method, ..settings("sky") });
        let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
        cut.surroundings.as_ref().map(|around| around.nodes.len())
    });
    assert!(has[0].take().is_none() && has[1] > Some(0), "{has:?}");
}

#[test]
fn the_scene_of_a_session_is_within_its_share_of_main_memory() {
    let file = creek();
    let of = |budget_ram_bytes: u64| {
        let settings = Settings { budget_ram_bytes, ..settings("sky") };
        Shares::of(&file, &Options { settings, size: SIZE, ..Options::default() })
    };
    let splats = |bytes: u64| of(bytes).unwrap().lit.unwrap().0;
    assert!(splats(1 << 30) > 4 * splats(128 << 20), "more memory takes more splats");
    assert!(splats(1 << 30) * 128 < 1 << 30);
    let fault = of(16 << 20).unwrap_err().to_string();
    assert!(fault.contains("is too small") && fault.contains("--budget-ram"), "{fault}");
    let unlit = Settings { method: Method::Ewa, ..settings("sky") };
    let options = Options { settings: unlit, size: SIZE, ..Options::default() };
    assert_eq!(Shares::of(&file, &options).unwrap().lit, None);
    // Fewer points than the view wants are drawn, and that is reported.
    let mut session = session(Settings { points_budget: 3000, ..settings("sky") });
    let view = view(session.file());
    session.settle(&view, Duration::from_secs(60)).unwrap();
    assert!(session.frame(&view).unwrap().light.unwrap().is_bounded);
}

/// Requests for each software or real GPU of this machine, with only what WebGPU guarantees.
fn minimal_gpus() -> Vec<GpuRequest> {
    let request = |&backends| GpuRequest {
        backends,
        allow_software: true,
        is_minimal: true,
        ..GpuRequest::default()
    };
    let all: Vec<_> = all_interfaces().iter().map(request).collect();
    let all: Vec<_> = all.into_iter().filter(|request| Gpu::open(request).is_ok()).collect();
    if all.is_empty() {
        eprintln!("no adapter");
    }
    all
}

/// A lit session of small pictures: software drivers trace slowly.
fn small(settings: Settings, backend: Backend, gpu: GpuRequest) -> anyhow::Result<Session> {
    let options = Options { settings, backend, gpu, size: SMALL, ..Options::default() };
    Session::open(Arc::new(creek()), options)
}

const SMALL: [u32; 2] = [32, 24];

/// The final picture of a session and its state.
fn final_picture(session: &mut Session, view: &View) -> (Picture, LitStatus) {
    let deadline = Instant::now() + Duration::from_secs(240);
    loop {
        let frame = session.frame(view).unwrap();
        let (light, is_final) = (frame.light.unwrap(), frame.is_final);
        if is_final {
            return (session.picture().unwrap(), light);
        }
        assert!(Instant::now() < deadline, "{light:?}");
    }
}

#[test]
fn a_gpu_lights_the_frames_of_a_session_as_the_cpu_does() {
    let view = Camera::parse(CAMERA).unwrap().view(info::bounds(&creek()), SMALL);
    let settings = || Settings { budget_gpu_bytes: 256 << 20, ..settings("sun:225,40|sky") };
    let mut on_cpu = small(settings(), Backend::Cpu, GpuRequest::default()).unwrap();
    let (want, of_cpu) = final_picture(&mut on_cpu, &view);
    for request in minimal_gpus() {
        let mut session = small(settings(), Backend::Gpu, request).unwrap();
        let first = session.frame(&view).unwrap();
        assert!(!first.is_final && first.light.unwrap().samples == 0, "a coarse picture is first");
        let (picture, state) = final_picture(&mut session, &view);
        assert_eq!(session.drawer().backend(), "gpu");
        assert_eq!((state.samples, state.splats), (of_cpu.samples, of_cpu.splats));
        assert!(state.bytes > 0 && !state.is_bounded, "{state:?}");
        let flip = mean_flip(&picture.rgba, &want.rgba, SMALL[0] as usize);
        assert!(flip <= 0.01, "FLIP {flip} between the GPU and the CPU");
        let deep = |d: f32| if d.is_finite() { d } else { 1e9 };
        let differs = |(a, b): &(&f32, &f32)| (deep(**a) / deep(**b) - 1.0).abs() > 1e-3;
        let other_depths = picture.depth.iter().zip(&want.depth).filter(differs).count();
        assert!(other_depths <= 8, "{other_depths} depths differ");
        // Another sun begins a new picture.
        session.set_light(light("sun:225,2"));
        assert_eq!(session.frame(&view).unwrap().light.unwrap().samples, 0);
        assert!(session.gpu_bytes().unwrap().peak_bytes <= 256 << 20);
    }
}

#[test]
fn what_a_gpu_does_not_light_is_lit_by_the_cpu_with_a_reason_or_refused() {
    let shining = Emissive { classes: Vec::new(), bounds: None, radiance: [1.0; 3] };
    let mut shines = light("sky");
    shines.lights.as_mut().unwrap().emissive.push(shining);
    for request in minimal_gpus().into_iter().take(1) {
        let settings = |light: LightSettings| Settings { light, ..settings("sky") };
        let session = small(settings(shines.clone()), Backend::Auto, request).unwrap();
        let note = session.drawer().note.clone().unwrap();
        assert_eq!(session.drawer().backend(), "cpu");
        assert!(note.contains("emit"), "{note}");
        let fault = small(settings(shines.clone()), Backend::Gpu, request).err().unwrap();
        let fault = fault.to_string();
        assert!(fault.contains("emit") && fault.contains("--backend cpu"), "{fault}");
        // Lights that come later go to the CPU too.
        let view = Camera::parse(CAMERA).unwrap().view(info::bounds(&creek()), SMALL);
        let settings = Settings { budget_gpu_bytes: 256 << 20, ..settings(light("sky")) };
        let mut session = small(settings, Backend::Auto, request).unwrap();
        session.frame(&view).unwrap();
        assert_eq!(session.drawer().backend(), "gpu");
        session.set_light(shines.clone());
        session.frame(&view).unwrap();
        assert_eq!(session.drawer().backend(), "cpu");
    }
}

#[test]
fn scene_and_pictures_that_a_gpu_lights_are_within_its_budget() {
    let size = [96, 72];
    let view = Camera::parse(CAMERA).unwrap().view(info::bounds(&creek()), size);
    for request in minimal_gpus().into_iter().take(1) {
        let open = |budget_gpu_bytes| {
            let settings = Settings { budget_gpu_bytes, ..settings("sun:225,40|sky") };
            let backend = Backend::Gpu;
            let options = Options { settings, backend, gpu: request, size, ..Options::default() };
            Session::open(Arc::new(creek()), options)
        };
        let fault = open(16 << 20).err().unwrap().to_string();
        assert!(fault.contains("--budget-gpu") && fault.contains("MiB is the least"), "{fault}");
        let least = fault.split(" MiB is the least").next().unwrap().rsplit(' ').next().unwrap();
        let least = least.parse::<u64>().unwrap() << 20;
        let mut session = open(least).unwrap();
        session.settle(&view, Duration::from_secs(60)).unwrap();
        // The second sample takes the most memory, and filters a picture of two halves.
        while session.frame(&view).unwrap().light.unwrap().samples < 2 {}
        let bytes = session.gpu_bytes().unwrap();
        assert!(bytes.peak_bytes <= least, "{bytes:?} of {least}");
        let light = session.frame(&view).unwrap().light.unwrap();
        assert!(light.splats > 1000 && light.splats as u64 <= light.splats_max, "{light:?}");
        drop(session);
        let splats_max =
            |budget| open(budget).unwrap().frame(&view).unwrap().light.unwrap().splats_max;
        assert!(splats_max(4 * least) > 2 * splats_max(least), "more memory takes more splats");
    }
}

#[test]
fn the_default_budget_of_a_gpu_lights_the_default_window() {
    // The picture of a window of 1280 x 800 beside its panel.
    let options = |size| {
        let settings = Settings { method: Method::Lit, ..Settings::default() };
        Options { settings, size, ..Options::default() }
    };
    let shares = GpuShares::of(&creek(), &options([1000, 800])).unwrap();
    assert!(shares.splats_max > 500_000, "{shares:?}");
    let larger = GpuShares::of(&creek(), &options([1100, 800])).unwrap();
    assert!(larger.splats_max < shares.splats_max, "pictures take memory of scenes");
}

#[test]
fn lit_pictures_that_the_budgets_do_not_hold_are_smaller_on_request() {
    let view = |size| Camera::parse(CAMERA).unwrap().view(info::bounds(&creek()), size);
    let on = |backend, gpu, method, size: [u32; 2], shrinks_lit| {
        let settings = Settings { method, budget_gpu_bytes: 256 << 20, ..settings("sky") };
        let options = Options { settings, backend, gpu, size, shrinks_lit, ..Options::default() };
        Session::open(Arc::new(creek()), options)
    };
    let of_cpu = [(Backend::Cpu, GpuRequest::default())];
    let of_gpu = minimal_gpus().into_iter().take(1).map(|request| (Backend::Gpu, request));
    for (backend, gpu) in of_cpu.into_iter().chain(of_gpu) {
        let lit = |size, shrinks| on(backend, gpu, Method::Lit, size, shrinks);
        let size = [3840, 2160];
        let fault = lit(size, false).err().unwrap().to_string();
        assert!(fault.contains("is too small"), "{fault}");
        let mut session = lit(size, true).unwrap();
        let [width, height] = session.size().map(f64::from);
        assert!(width > 400.0 && width < 3000.0, "{width}");
        assert!((width / height * 9.0 / 16.0 - 1.0).abs() < 0.01, "{width} x {height}");
        let status = session.frame(&view(SMALL)).unwrap().light.unwrap();
        assert!(status.is_smaller && status.splats_max >= status.splats as u64, "{status:?}");
        // Pictures that fit, and those of other methods, keep their size.
        assert_eq!(lit([320, 240], true).unwrap().size(), [320, 240]);
    }
    let points = on(Backend::Cpu, GpuRequest::default(), Method::PullPush, [1000, 800], true);
    assert_eq!(points.unwrap().size(), [1000, 800]);
}
