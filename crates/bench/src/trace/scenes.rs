//! The scenes of the benchmark: generated meshes in place of those of `bauszat2011`, and scans;
//! more where `ESKER_DATA` names a folder of real scans. Each has a camera and lights of its own.

use super::scans::OpenScan;
use super::scene::TraceScene;
use super::{meshes, scans};
use anyhow::{Result, bail};
use esker_points::Task;
use esker_scan::mesh::generated::MODELS;

/// Names of the scenes that every machine has, meshes first.
pub const SCENES: [&str; 5] = ["bust", "knot", "hall", "office", "terrain"];
/// Names of the scenes that need `ESKER_DATA`.
const SCENES_OF_DATA: [&str; 2] = ["bunny", "indoor"];

/// Names of the scenes that are measured by default.
pub(super) fn defaults() -> Vec<String> {
    let more = std::env::var_os("ESKER_DATA").map_or(&[][..], |_| &SCENES_OF_DATA);
    SCENES.iter().chain(more).map(|&name| name.to_owned()).collect()
}

/// Makes the scene of this name for pictures of this size, and the scan that it is of, if it is of
/// one. A quick one has fewer surfaces.
///
/// # Errors
/// If there is no such scene, or its files cannot be read.
pub(super) fn make(
    name: &str,
    size: [u32; 2],
    is_quick: bool,
    task: &dyn Task,
) -> Result<(TraceScene, Option<OpenScan>)> {
    task.phase(&format!("making {name}"), None, "surfaces");
    if let Some(model) = MODELS.iter().find(|model| model.name == name) {
        return Ok((meshes::generated(model, size, is_quick), None));
    }
    match name {
        "office" | "terrain" | "indoor" => {
            let (scene, scan) = scans::scene(name, size, is_quick, task)?;
            Ok((scene, Some(scan)))
        }
        "bunny" => Ok((meshes::bunny(size, task)?, None)),
        _ => {
            let known: Vec<_> = SCENES.iter().chain(&SCENES_OF_DATA).copied().collect();
            bail!("there is no scene `{name}`; scenes are {}", known.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;

    #[test]
    fn an_unknown_scene_is_refused_with_the_names_of_the_others() {
        let error = make("teapot", [8, 8], true, &Silent).err().unwrap().to_string();
        assert!(error.contains("bust, knot, hall, office, terrain"), "{error}");
    }

    #[test]
    fn cameras_of_generated_meshes_see_surfaces_in_most_pixels() {
        for model in &MODELS {
            let (scene, _) = make(model.name, [24, 18], true, &Silent).unwrap();
            let camera = &scene.camera;
            let sees = |i: usize| {
                let (x, y) = ((i % camera.width) as f32, (i / camera.width) as f32);
                scene.scene.hit(&camera.ray(x + 0.5, y + 0.5)).is_some()
            };
            let seen = (0..camera.pixels()).filter(|&i| sees(i)).count();
            assert!(seen * 10 > camera.pixels() * 6, "{}: {seen}", model.name);
        }
    }

    #[test]
    fn the_same_scene_has_the_same_content_and_another_size_another() {
        let content = |size| make("hall", size, true, &Silent).unwrap().0.content;
        assert_eq!(content([24, 18]), content([24, 18]));
        assert_ne!(content([24, 18]), content([18, 24]));
    }
}
