//! A changed shader file is reloaded while the renderer runs; a broken one is reported, and the
//! last valid shader stays in use. An environment variable names the folder of shaders, so the test
//! runs itself again with the variable set.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
mod scene;

use esker_lod::View;
use esker_render::gpu::device::shader::FOLDER;
use esker_render::gpu::{GpuError, GpuRenderer};
use glam::DVec3;
use gpu::{few_gpus, upload, uploaded_frame};
use scene::{Dice, Scene, sheet, sphere};
use std::path::Path;
use std::process::Command;

const TEST: &str = "changed_shaders_are_reloaded_and_broken_ones_are_reported";

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let to = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &to);
        } else {
            std::fs::copy(&path, &to).unwrap();
        }
    }
}

#[test]
fn changed_shaders_are_reloaded_and_broken_ones_are_reported() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        return reload_from(Path::new(&folder));
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("reloaded-shaders");
    let _ = std::fs::remove_dir_all(&folder);
    copy(Path::new("../../shaders"), &folder);
    let mut again = Command::new(std::env::current_exe().unwrap());
    let status = again.args([TEST, "--exact", "--nocapture"]).env(FOLDER, &folder).status();
    assert!(status.unwrap().success());
}

fn reload_from(folder: &Path) {
    let mut dice = Dice(3);
    let mut points = sphere(&mut dice, DVec3::Z, 1.0, 4000, [220, 90, 50]);
    points.extend(sheet(&mut dice, -DVec3::X, DVec3::X, DVec3::Y, 30, [60, 150, 90]));
    let scene = Scene::new(&points, 1e-5, 0.06, 0.06, 3000);
    let view = View::look_at(DVec3::new(2.0, -3.0, 2.0), DVec3::Z, DVec3::Z, 0.9, 96, 80);
    let draws = scene.draws(true, true, true);
    let frame = scene.frame(&view, &draws);
    for gpu in few_gpus() {
        let uploaded = upload(&gpu, frame.draws, 64 << 10);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        let draw = |renderer: &mut GpuRenderer| {
            renderer.render(&uploaded_frame(&frame, &uploaded.draws), &uploaded.pool).unwrap();
            renderer.read().unwrap().rgba
        };
        let first = draw(&mut renderer);
        assert_eq!(renderer.reload(), Ok(false), "nothing has changed");

        let shade = folder.join("shade/shade.wgsl");
        let good = std::fs::read_to_string(&shade).unwrap();
        std::fs::write(&shade, format!("{good}\nfn broken( {{")).unwrap();
        let error = renderer.reload().unwrap_err();
        assert!(matches!(&error, GpuError::Shader(s) if s.contains("shade/shade.wgsl")), "{error}");
        assert!(draw(&mut renderer) == first, "the last valid shader stays in use");
        assert_eq!(renderer.reload(), Ok(false), "an error is reported once");

        std::fs::write(&shade, &good).unwrap();
        assert_eq!(renderer.reload(), Ok(true));
        assert!(draw(&mut renderer) == first);
        let frame_file = folder.join("common/frame.wgsl");
        let common = std::fs::read_to_string(&frame_file).unwrap();
        std::fs::write(&frame_file, format!("{common}// Unchanged code.\n")).unwrap();
        assert_eq!(renderer.reload(), Ok(true), "a changed include is noticed");
        assert!(draw(&mut renderer) == first);
        assert_eq!(gpu.fault(), None);
    }
}
