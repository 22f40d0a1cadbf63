//! Lit pictures of the sample scan: reports, the same bytes for any number of threads, every
//! filter and kind of light, meshes that cast shadows, and errors that show what to write.

use crate::folder::Folder;
use crate::program::{Outcome, build, esker, sample};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("light: a lit picture reports its fields", reports));
    trials.push(trial("light: pictures are the same for any number of threads", same_for_threads));
    trials.push(trial("light: every filter and kind of light draws", every_filter_and_light));
    trials.push(trial("light: gloss and the filter of shadows change pictures", switches));
    trials.push(trial("light: a mesh stands in the scan", mesh_stands));
    trials.push(trial("light: the plan lists its passes and reads no more", plan_lists_passes));
    trials.push(trial("light: errors show what to write", errors_show_forms));
}

/// Size of the pictures.
const SIZE: [usize; 2] = [120, 80];

fn lit(input: &Path, out: &Path, more: &[&str]) -> Outcome {
    let words = [OsStr::new("render"), input.as_os_str(), OsStr::new("-o"), out.as_os_str()];
    let how = ["--method", "lit", "--size", "120x80", "--progress", "none", "--backend", "cpu"];
    esker(words.into_iter().chain(how.iter().chain(more).map(OsStr::new)))
}

/// The sample scan with estimated normals.
fn built(folder: &Folder) -> PathBuf {
    let out = folder.file("out.esker");
    build(&[sample()], &out, &["--normals", "estimate"]);
    out
}

/// Draws a lit picture. Returns its bytes and the report.
fn picture(folder: &Folder, input: &Path, more: &[&str]) -> (Vec<u8>, Value) {
    let out = folder.file("p.png");
    let report = lit(input, &out, &[&["--json"], more].concat()).json();
    let file = std::io::BufReader::new(std::fs::File::open(&out).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    assert_eq!(pixels.len(), SIZE[0] * SIZE[1] * 4);
    (pixels, report)
}

/// Mean of all colours of a picture.
fn mean(pixels: &[u8]) -> f64 {
    let colours = pixels.chunks_exact(4).flat_map(|pixel| &pixel[..3]);
    colours.map(|&c| f64::from(c)).sum::<f64>() / (pixels.len() / 4 * 3) as f64
}

fn reports() {
    let folder = Folder::new();
    let file = built(&folder);
    let (pixels, report) = picture(&folder, &file, &["--exposure", "2", "--seed", "7"]);
    assert!((10.0..245.0).contains(&mean(&pixels)), "{}", mean(&pixels));
    assert!(report["pixels_covered"].as_u64().unwrap() > 3000, "{report}");
    let light = &report["light"];
    assert_eq!(light["lights"], serde_json::json!(["sun", "sky"]));
    assert_eq!((&light["samples"], &light["bounces"]), (&4.into(), &1.into()));
    assert_eq!((&light["filter"], &light["seed"]), (&"nested".into(), &7.into()));
    assert_eq!(light["exposure"], 2.0);
    for field in ["rays", "splats", "splats_max", "scene_bytes"] {
        assert!(light[field].as_u64().unwrap() > 1000, "{field}: {light}");
    }
    for field in ["self_hits", "escaped", "without_guide"] {
        assert!((0.0..=1.0).contains(&light[field].as_f64().unwrap()), "{field}: {light}");
    }
    for field in ["build_ms", "trace_ms", "filter_ms"] {
        assert!(light[field].is_number(), "{field}: {light}");
    }
    assert_eq!(report["drawn_by"]["backend"], "cpu");
    assert_eq!(folder.names(), ["out.esker", "p.png"]);
    let text = lit(&file, &folder.file("p.png"), &[]);
    assert!(text.worked().stdout.contains("light: sun, sky"), "{}", text.stdout);
}

fn same_for_threads() {
    let folder = Folder::new();
    let file = built(&folder);
    let of = |threads: &str, seed: &str| {
        let more = ["--threads", threads, "--seed", seed, "--samples", "2", "--bounces", "2"];
        picture(&folder, &file, &more).0
    };
    let one = of("1", "1");
    assert!(one == of("2", "1"), "pictures of one and two threads differ");
    assert!(one != of("2", "2"), "the seed changes nothing");
    // A scan that is built for the picture gets normals.
    let more = ["--threads", "1", "--seed", "1", "--samples", "2", "--bounces", "2"];
    assert!(one == picture(&folder, &sample(), &more).0, "the scan and its file differ");
}

fn every_filter_and_light() {
    let folder = Folder::new();
    let file = built(&folder);
    let info = esker([OsStr::new("info"), file.as_os_str(), OsStr::new("--json")]).json();
    let at = |axis: usize, share: f64| {
        let [low, high] = [0, 1].map(|end| info["bounds"][end][axis].as_f64().unwrap());
        low + (high - low) * share
    };
    let sky = [60, 90, 160, 20, 20, 20];
    let path = folder.file("sky.png");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 1, 2);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&sky).unwrap();
    let document = serde_json::json!({"version": 1, "lights": [
        {"kind": "spot", "position": [at(0, 0.5), at(1, 0.5), at(2, 3.0)], "direction": [0, 0, -1],
         "intensity": [1e6, 1e6, 1e6], "inner_angle_deg": 20, "outer_angle_deg": 60},
    ], "emissive": [
        {"radiance": [1, 0.5, 0.2], "bounds":
            [[at(0, 0.0), at(1, 0.0), at(2, 0.0)], [at(0, 0.5), at(1, 1.0), at(2, 1.0)]]},
    ]});
    let document = folder.write("lights.json", &document.to_string());
    let lamp = format!("lamp:{},{},{},1000000", at(0, 0.5), at(1, 0.5), at(2, 2.0));
    let sky = format!("sky:{},2", path.display());
    let mut seen = std::collections::HashSet::new();
    for lights in [
        &["sky:1"][..],
        &["sun:90,30,1,5", "sky:0.2"],
        &[&lamp],
        &[&sky],
        &[document.to_str().unwrap()],
    ] {
        let more = [&["--samples", "1", "--lights"], lights].concat();
        let (pixels, report) = picture(&folder, &file, &more);
        let covered = report["pixels_covered"].as_u64().unwrap();
        assert!(covered > 3000, "{lights:?}: {covered} pixels");
        let brightest = pixels.chunks_exact(4).map(|p| p[..3].iter().max().unwrap()).max();
        assert!(brightest > Some(&120), "{lights:?} light nothing");
        assert!(seen.insert(pixels), "{lights:?} look like other lights");
    }
    for filter in ["guided", "nested", "bilateral", "atrous", "none"] {
        let (pixels, report) =
            picture(&folder, &file, &["--samples", "1", "--filter", filter, "--lights", "sky"]);
        assert_eq!(report["light"]["filter"], filter);
        assert!(seen.insert(pixels) || filter == "nested", "{filter} looks like another filter");
    }
    for albedo in ["rgb", "intensity", "plain"] {
        let (_, report) = picture(&folder, &file, &["--samples", "1", "--albedo", albedo]);
        let notes = report["notes"].to_string();
        assert_eq!(notes.contains("hold the light"), albedo == "rgb", "{albedo}: {notes}");
    }
}

fn switches() {
    let folder = Folder::new();
    let file = built(&folder);
    let lights = ["--lights", "sun:225,30,1,20", "--exposure", "1", "--samples", "1"];
    let of = |more: &[&str]| picture(&folder, &file, &[&lights[..], more].concat());
    let (plain, report) = of(&[]);
    assert_eq!(report["light"]["filters_shadows"], false);
    assert!(report["light"].get("gloss").is_none(), "{report}");
    let (glossy, report) = of(&["--gloss", "0.5,0.2"]);
    assert_eq!(report["light"]["gloss"], serde_json::json!([0.5, 0.2f32]));
    assert!(mean(&glossy) != mean(&plain), "gloss changes nothing");
    let (soft, report) = of(&["--filter-shadows"]);
    assert_eq!(report["light"]["filters_shadows"], true);
    // Filtered light is the same on the whole.
    assert!(soft != plain && (mean(&soft) - mean(&plain)).abs() < 3.0, "{}", mean(&soft));
}

fn mesh_stands() {
    let folder = Folder::new();
    let scan = folder.write("plane.csv", &plane());
    let roof = "v 2 2 3\nv 8 2 3\nv 8 8 3\nv 2 8 3\nf 1 2 3 4\n";
    let mesh = folder.write("roof.obj", roof);
    let camera = "eye=5,-12,12;target=5,5,0";
    let common =
        ["--camera", camera, "--lights", "sun:180,80", "--exposure", "1", "--albedo", "plain"];
    let (without, _) = picture(&folder, &scan, &common);
    let more = [&common[..], &["--mesh", mesh.to_str().unwrap()]].concat();
    let (with, report) = picture(&folder, &scan, &more);
    assert_eq!(report["light"]["triangles"], 2);
    assert!(mean(&with) < mean(&without) - 1.0, "the mesh casts no shadow");
    let more = [&common[..], &["--mesh", "none.ply"]].concat();
    assert!(lit(&scan, &folder.file("p.png"), &more).error().contains("none.ply"));
}

/// A plane of 10 x 10 with points 0.1 apart.
fn plane() -> String {
    let rows = (0..100).flat_map(|y| (0..100).map(move |x| (x, y)));
    let line = |(x, y): (i32, i32)| format!("{:.1},{:.1},0\n", x as f64 * 0.1, y as f64 * 0.1);
    std::iter::once("x,y,z\n".to_owned()).chain(rows.map(line)).collect()
}

fn plan_lists_passes() {
    let folder = Folder::new();
    let file = built(&folder);
    let plan = |more: &[&str]| {
        let words = [OsStr::new("render"), file.as_os_str()];
        let how = ["--explain", "--json"];
        esker(words.into_iter().chain(how.iter().chain(more).map(OsStr::new))).json()
    };
    let passes = |plan: &Value| -> Vec<String> {
        let passes = plan["passes"].as_array().unwrap();
        passes.iter().map(|pass| pass.as_str().unwrap().to_owned()).collect()
    };
    let whole = plan(&["--method", "lit"]);
    let all = ["splats", "tree", "guide", "indirect", "filter", "direct", "tone"];
    assert_eq!(passes(&whole), all);
    assert_eq!(whole["variants"], serde_json::json!([]));
    let bare = plan(&["--method", "lit", "--bounces", "0"]);
    assert_eq!(passes(&bare), ["splats", "tree", "guide", "direct", "tone"]);
    // What is not lit has none of it.
    for method in ["points", "pull-push", "ewa"] {
        let plan = plan(&["--method", method]);
        let shaders = plan["variants"].to_string();
        let is_foreign = |pass: &String| all[..6].contains(&pass.as_str());
        assert!(!passes(&plan).iter().any(is_foreign), "{method}: {plan}");
        assert!(!shaders.contains("trace/") && !shaders.contains("filter/"), "{method}: {shaders}");
    }
}

fn errors_show_forms() {
    let folder = Folder::new();
    let file = built(&folder);
    let picture = folder.file("p.png");
    let document = folder.write("lights.json", r#"{"version": 1, "lights": [{"kind": "moon"}]}"#);
    let document = document.to_str().unwrap().to_owned();
    for (more, says) in [
        (vec!["--lights", "moon:1,2"], "sun:AZIMUTH,ELEVATION"),
        (vec!["--lights", "sun:10"], "such as sun:225,40"),
        (vec!["--lights", "lamp:1,2"], "lamp:X,Y,Z"),
        (vec!["--lights", "sky:-1"], "strength"),
        (vec!["--lights", &document], "unknown variant"),
        (vec!["--lights", "none.json"], "none.json"),
        (vec!["--samples", "0"], "--samples"),
        (vec!["--exposure", "0"], "--exposure"),
        (vec!["--filter", "median"], "guided"),
        (vec!["--albedo", "plain", "--colour", "rgb"], "--albedo"),
        (vec!["--gloss", "2"], "REFLECTANCE[,ROUGHNESS]"),
        (vec!["--gloss", "0.1", "--filter-shadows"], "cannot be used with"),
    ] {
        let fault = lit(&file, &picture, &more);
        fault.error();
        assert!(fault.stderr.contains(says), "{more:?}: {}", fault.stderr);
        assert!(!picture.exists(), "{more:?} drew a picture");
    }
    let words = ["render".as_ref(), file.as_os_str(), "-o".as_ref(), picture.as_os_str()];
    let unlit =
        esker(words.into_iter().chain(["--samples", "9", "--mesh", "a.ply"].map(OsStr::new)));
    assert!(unlit.error().contains("--samples, --mesh"), "{}", unlit.stderr);
    assert!(unlit.error().contains("--method lit"), "{}", unlit.stderr);
}
