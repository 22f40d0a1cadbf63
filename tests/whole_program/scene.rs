//! Scene documents: a picture from a document is that of the equal options, byte for byte; options
//! replace fields; paths start from the document; documents are recognised by their content;
//! clips are drawn as their options; and what is not drawn yet is an error.

use crate::folder::Folder;
use crate::program::{Outcome, build, esker, sample};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("scene: a saved document draws the picture of its options", saved));
    trials.push(trial("scene: a document of a scan builds it as its options did", saved_of_a_scan));
    trials.push(trial("scene: lights, skies and meshes are found from the document", saved_lights));
    trials.push(trial("scene: fields by hand draw the picture of the options", by_hand));
    trials.push(trial("scene: an option replaces its field, and no other", options_replace));
    trials.push(trial("scene: clips of a document cut as those of the options", clips));
    trials.push(trial("scene: what a picture does not show is kept when it is saved", kept));
    trials.push(trial("scene: documents are recognised by their content", by_content));
    trials.push(trial("scene: what is not drawn yet is an error or a note", not_drawn));
    trials.push(trial("scene: damaged, later and long documents are refused", refused));
    trials.push(trial("scene: no other file is replaced by a document", never_replaces));
    trials.push(trial("scene: info says what a document holds", info));
}

/// The sample as `data/creek.esker` in a folder that also has the folder `my scenes`.
fn built(folder: &Folder) -> PathBuf {
    for name in ["data", "my scenes"] {
        std::fs::create_dir(folder.file(name)).unwrap();
    }
    let out = folder.file("data/creek.esker");
    build(&[sample()], &out, &[]);
    out
}

fn render(input: &Path, more: &[&OsStr]) -> Outcome {
    let words = [OsStr::new("render"), input.as_os_str()];
    let how = ["--progress", "none", "--backend", "cpu"].map(OsStr::new);
    esker(words.iter().chain(&how).chain(more))
}

/// Draws `input`. Returns the bytes of the picture.
fn picture(folder: &Folder, input: &Path, more: &[&str]) -> Vec<u8> {
    let out = folder.file("p.png");
    let words: Vec<&OsStr> = more.iter().map(OsStr::new).collect();
    render(input, &[&[OsStr::new("-o"), out.as_os_str()], &words[..]].concat()).worked();
    std::fs::read(&out).unwrap()
}

/// Writes the document `name` of a picture, and draws the picture, too. Returns its path.
fn save(folder: &Folder, input: &Path, name: &str, more: &[&str]) -> PathBuf {
    let scene = folder.file(name);
    let words: Vec<&OsStr> = more.iter().map(OsStr::new).collect();
    let report = render(
        input,
        &[&[OsStr::new("--save-scene"), scene.as_os_str(), OsStr::new("--json")], &words[..]]
            .concat(),
    );
    assert_eq!(report.json()["scene"], scene.to_str().unwrap());
    scene
}

/// Asserts that the document of a picture draws it, and is saved as it is.
fn draws_the_same(folder: &Folder, input: &Path, more: &[&str]) {
    let wanted = picture(folder, input, more);
    let scene = save(folder, input, "my scenes/a.json", more);
    assert!(picture(folder, &scene, &[]) == wanted, "{more:?}: another picture");
    let again = save(folder, &scene, "b.json", &[]);
    assert!(picture(folder, &again, &[]) == wanted, "{more:?}: another picture, saved twice");
    let back = save(folder, &again, "my scenes/c.json", &[]);
    let [first, last] = [&scene, &back].map(|path| std::fs::read_to_string(path).unwrap());
    assert_eq!(first, last, "{more:?}");
}

/// Bounds of the sample, whole numbers.
fn bounds(file: &Path) -> [[i64; 3]; 2] {
    let info = esker([OsStr::new("info"), file.as_os_str(), OsStr::new("--json")]).json();
    [0, 1].map(|end| [0, 1, 2].map(|i| info["bounds"][end][i].as_f64().unwrap() as i64))
}

fn saved() {
    let folder = Folder::new();
    let file = built(&folder);
    let [[x, y, z], [right, top, _]] = bounds(&file);
    let [middle_x, middle_y] = [i64::midpoint(x, right), i64::midpoint(y, top)];
    let eye = format!("eye={x}.25,{y},{};target={middle_x},{middle_y},{z};fovy=41.7", z + 500);
    let flat = format!("{x},{y}.5,{middle_x},{middle_y}");
    let polygon = format!("{x},{y} {right}.125,{y} {middle_x},{top}");
    let rings = folder.write(
        "data/rings.txt",
        &format!("{x} {y}\n{right} {y}\n{middle_x} {top}\n\n{middle_x} {middle_y}\n{right} {middle_y}\n{right} {top}\n"),
    );
    let small = ["--size", "160x120"];
    for more in [
        &[][..],
        &[
            "--method",
            "points",
            "--point-size",
            "3.3",
            "--eye-dome",
            "0.7",
            "--budget-points",
            "50k",
        ],
        &[
            "--method",
            "pull-push",
            "--colour",
            "elevation:1000..",
            "--no-highlights",
            "--cull-back",
        ],
        &["--camera", &eye, "--target-spacing", "2.5", "--even-exposure", "--full"],
        &["--camera", "direction=0,0,-1;up=1,0,0;ortho=fit", "--colour", "intensity"],
        &["--up", "-y", "--colour", "elevation"],
        &["--method", "ewa", "--box", &flat, "--classes", "0-1,overlap,2", "--max-spacing", "7.5"],
        &["--polygon", &polygon, "--without-flags", "withheld,synthetic"],
        &["--where", "red:20000..40000.5", "--where", "return:..1"],
        &["--polygon", rings.to_str().unwrap(), "--window", "10,20,100,50"],
    ] {
        draws_the_same(&folder, &file, &[&small, more].concat());
    }
}

fn saved_of_a_scan() {
    let folder = Folder::new();
    for name in ["data", "my scenes"] {
        std::fs::create_dir(folder.file(name)).unwrap();
    }
    let rows = (0..4000).map(|i| format!("{}.5;{}.25;{}\n", i % 61, i / 61, (i * 7) % 13));
    let scan = folder.write("data/scan.txt", &rows.collect::<String>());
    for more in [
        &["--normals", "none"][..],
        &["--normals", "estimate", "--sharp-features", "--node-capacity", "256"],
        &["--columns", "x=3,y=2,z=1", "--skip-lines", "7", "--crs", "EPSG:2154+5720"],
    ] {
        let more = [&["--size", "120x90", "--method", "ewa"], more].concat();
        draws_the_same(&folder, &scan, &more);
        let plain = picture(&folder, &scan, &["--size", "120x90", "--method", "ewa"]);
        assert!(picture(&folder, &folder.file("b.json"), &[]) != plain, "{more:?} has no effect");
    }
    draws_the_same(&folder, Path::new("synthetic:office:20k:3"), &["--size", "120x90"]);
    // Light needs normals; the scan has none.
    draws_the_same(&folder, &scan, &["--size", "60x45", "--method", "lit", "--samples", "1"]);
}

fn saved_lights() {
    let folder = Folder::new();
    let file = built(&folder);
    let [[x, y, z], [right, top, _]] = bounds(&file);
    let lamp = format!("lamp:{}.5,{top},{},70000", i64::midpoint(x, right), z + 300);
    let (sky, spot) = (folder.file("data/my sky.png"), folder.file("data/lights.json"));
    let mut encoder = png::Encoder::new(std::fs::File::create(&sky).unwrap(), 2, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[255, 188, 0, 30, 60, 255]).unwrap();
    let lights = json!({"version": 1, "lights": [
        {"kind": "spot", "position": [x, y, z + 200], "direction": [1, 1, -0.3],
         "intensity": [9e4, 8.1e4, 0.1], "inner_angle_deg": 20, "outer_angle_deg": 31.7},
    ], "emissive": [{"classes": [2], "radiance": [0.1, 0.7, 0.3]}]});
    std::fs::write(&spot, lights.to_string()).unwrap();
    let mesh = folder.write(
        "data/mesh.obj",
        &format!("v {x} {y} {z}\nv {right} {y} {z}\nv {x} {top} {}\nf 1 2 3\n", z + 200),
    );
    let [spot, mesh] = [&spot, &mesh].map(|path| path.to_str().unwrap());
    let lit = ["--method", "lit", "--size", "60x45", "--samples", "1"];
    for more in [
        &["--lights", "sun:225,40,0.7,2", "sky:0.35", &lamp][..],
        &["--lights", spot, "--albedo", "plain", "--seed", "7", "--bounces", "0"],
        &["--mesh", mesh, "--gloss", "0.3,0.21", "--exposure", "1.7", "--filter", "guided"],
    ] {
        draws_the_same(&folder, &file, &[&lit, more].concat());
    }
    // On the command line a blank separates lights; in a document it may be part of a name.
    let fields = |lights: Value| {
        json!({
            "esker_scene": 1, "clouds": [{"file": "../data/creek.esker"}], "size": [60, 45],
            "method": "lit", "light": {"lights": lights, "samples": 1},
        })
    };
    let scene = folder
        .write("my scenes/sky.json", &fields(json!(["sky:../data/my sky.png,0.5"])).to_string());
    let drawn = picture(&folder, &scene, &[]);
    let again = save(&folder, &scene, "again.json", &[]);
    assert!(picture(&folder, &again, &[]) == drawn);
    let plain = folder.write("my scenes/plain.json", &fields(json!(["sky:0.5"])).to_string());
    assert!(picture(&folder, &plain, &[]) != drawn);
}

fn by_hand() {
    let folder = Folder::new();
    let file = built(&folder);
    let [[x, y, z], [right, top, _]] = bounds(&file);
    let scene = folder.write(
        "my scenes/hand.json",
        &format!(
            r#"
            {{
              "clouds": [{{"file": "../data/creek.esker"}}, {{"file": "none.laz", "visible": false}}],
              "camera": {{"direction": [1, 0.5, -1], "fovy": 35}},
              "method": "pull-push", "size": [200, 130], "budget_points": 100000,
              "target_spacing": 2, "colour": "elevation:900..1150",
              "filter": {{"box": [{x}, {y}, {right}, {top}], "polygon": "area.txt", "classes": "0-20"}},
              "no_highlights": true,
              "light": {{"samples": 9, "lights": []}},
              "clips": [{{"enabled": false, "plane": {{"point": [0, 0, 0], "normal": [0, 0, 1]}}}}],
              "bookmarks": [{{"name": "top", "camera": "direction=0,0,-1;ortho=fit"}}],
              "camera_path": [{{"time_s": 0, "camera": {{"eye": [{x}, {y}, {z}]}}}}],
              "esker_scene": 1
            }}"#
        ),
    );
    let polygon = format!("{x} {y}\n{right} {y}\n{right} {top}\n");
    let area = folder.write("my scenes/area.txt", &polygon);
    let bounds = format!("{x},{y},{right},{top}");
    let options = [
        "--camera",
        "direction=1,0.5,-1;fovy=35",
        "--method",
        "pull-push",
        "--size",
        "200x130",
        "--budget-points",
        "100k",
        "--target-spacing",
        "2",
        "--colour",
        "elevation:900..1150",
        "--box",
        &bounds,
        "--polygon",
        area.to_str().unwrap(),
        "--classes",
        "0-20",
        "--no-highlights",
    ];
    assert!(picture(&folder, &scene, &[]) == picture(&folder, &file, &options));
    // The plan is that of the options, too.
    let plan = |input: &Path, more: &[&str]| {
        let words: Vec<&OsStr> =
            ["--explain", "--json"].iter().chain(more).map(OsStr::new).collect();
        render(input, &words).json()
    };
    assert_eq!(plan(&scene, &[]), plan(&file, &options));
}

fn options_replace() {
    let folder = Folder::new();
    let file = built(&folder);
    let [[x, y, _], [right, top, _]] = bounds(&file);
    let bounds = format!("{x},{y},{},{top}", i64::midpoint(x, right));
    let base = [
        "--size",
        "120x80",
        "--method",
        "points",
        "--point-size",
        "4",
        "--colour",
        "elevation",
        "--box",
        &bounds,
        "--camera",
        "direction=0,1,-1",
    ];
    let scene = save(&folder, &file, "my scenes/base.json", &base);
    let other_box = format!("{x},{y},{right},{top}");
    let clip = format!("point={},{y},0;normal=1,2,0", i64::midpoint(x, right));
    for (option, value) in [
        ("--size", "90x140"),
        ("--method", "pull-push"),
        ("--colour", "intensity"),
        ("--box", &other_box),
        ("--camera", "direction=1,0,-2;fovy=20"),
        ("--point-size", "9"),
        ("--budget-points", "7k"),
        ("--target-spacing", "6"),
        ("--max-spacing", "25"),
        ("--clip", &clip),
    ] {
        let mut options: Vec<&str> = base.to_vec();
        match options.iter().position(|word| *word == option) {
            Some(at) => options[at + 1] = value,
            None => options.extend([option, value]),
        }
        if option == "--method" {
            // The size of points belongs to points; the document keeps it.
            let at = options.iter().position(|word| *word == "--point-size").unwrap();
            options.drain(at..at + 2);
        }
        let replaced = picture(&folder, &scene, &[option, value]);
        assert!(replaced == picture(&folder, &file, &options), "{option} {value}");
        assert!(replaced != picture(&folder, &scene, &[]), "{option} {value} has no effect");
    }
    let words = ["--point-size", "2", "--method", "ewa"].map(OsStr::new);
    assert!(render(&scene, &words).error().contains("required"), "no output is named");
    let out = folder.file("p.png");
    let refused = render(&scene, &[&[OsStr::new("-o"), out.as_os_str()], &words[..]].concat());
    assert!(refused.error().contains("add --method points"), "{}", refused.stderr);
}

fn clips() {
    let folder = Folder::new();
    let file = built(&folder);
    let [[x, y, z], [right, top, over]] = bounds(&file);
    let [x1, y1] = [x + (right - x) / 4, y + (top - y) / 4];
    let [x2, y2] = [i64::midpoint(x, right), i64::midpoint(y, top)];
    let eye = format!("eye={x1},{y1},{};target={x2},{y2},{z};fovy=60", over + 600);
    let options = ["--camera", &eye, "--size", "160x120"];
    let drawn = |input: &Path, more: &[&str]| picture(&folder, input, &[&options, more].concat());
    let document = |clips: &str| {
        let text = format!(
            r#"{{"esker_scene": 1, "clouds": [{{"file": "../data/creek.esker"}}], "clips": [{clips}]}}"#
        );
        drawn(&folder.write("my scenes/clips.json", &text), &[])
    };
    let all = drawn(&file, &[]);
    let flat = format!("{x1},{y1},{},{x2},{y2},{}", z - 9, over + 9);
    let boxed = drawn(&file, &["--box", &flat]);
    assert!(boxed != all);
    assert!(document(&format!(r#"{{"box": [{flat}]}}"#)) == boxed);
    assert!(drawn(&file, &["--clip", &format!("box={flat}")]) == boxed);
    // The same box, turned by a right angle with its lengths exchanged.
    let half = |a: i64, b: i64| (a + b) as f64 / 2.0;
    let centre = [half(x1, x2), half(y1, y2), half(z, over)];
    let size = [y2 - y1, x2 - x1, over - z + 18];
    let turned = |degrees: f64, more: &str| {
        format!(
            r#"{{"oriented_box": {{"centre": {centre:?}, "size": {size:?},
                "rotation": [{degrees}, 0, 0]}}{more}}}"#
        )
    };
    assert!(document(&turned(90.0, "")) == boxed);
    let rest = document(&turned(90.0, r#", "keep": "outside""#));
    assert!(rest != boxed && rest != all);
    let [[a, b, c], [d, e, f]] = [centre, size.map(|length| length as f64)];
    let clip = format!("centre={a},{b},{c};size={d},{e},{f};rotation=30,5,0;keep=outside");
    let form = turned(30.0, r#", "keep": "outside""#).replace("30, 0, 0", "30, 5, 0");
    assert!(document(&form) == drawn(&file, &["--clip", &clip]));
    // Two clips, one that is switched off, and a half space that has all points.
    let behind = format!(r#"{{"plane": {{"point": [0, 0, {}], "normal": [0, 0, 1]}}}}"#, over + 1);
    assert!(document(&behind) == all);
    assert!(document(&format!("{behind}, {}", turned(90.0, ""))) == boxed);
    assert!(document(&turned(30.0, r#", "enabled": false"#)) == all);
    // Options replace the clips of a document, and a document that is saved keeps its own.
    let scene = folder.file("my scenes/clips.json");
    assert!(drawn(&scene, &["--clip", &format!("box={flat}")]) == boxed);
    let text = std::fs::read_to_string(&scene).unwrap();
    let named = text.replace(r#""enabled": false"#, r#""enabled": false, "name": "roof""#);
    let scene = folder.write("my scenes/clips.json", &named);
    let more = ["--clip", &clip];
    let saved = save(&folder, &scene, "data/other.json", &more);
    assert!(drawn(&saved, &[]) == drawn(&file, &more));
    let saved = save(&folder, &scene, "data/same.json", &["--size", "160x120"]);
    let json = |path: &Path| -> Value {
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    };
    assert_eq!(json(&saved)["clips"][0]["name"], "roof");
    assert_eq!(json(&saved)["clips"][0]["enabled"], false);
}

fn kept() {
    let folder = Folder::new();
    let file = built(&folder);
    let marks = json!({
        "clips": [{"name": "roof", "enabled": false, "keep": "outside", "box": [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]}],
        "measurements": [{"name": "width", "kind": "distance", "points": [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]]}],
        "annotations": [{"text": "creek", "at": [1.0, 2.0, 3.0]}],
        "bookmarks": [{"name": "top", "camera": "direction=0,0,-1"}],
        "camera_path": [{"time_s": 0.0, "camera": {"eye": [1.0, 2.0, 3.0]}}],
    });
    let mut scene = json!({
        "esker_scene": 1, "size": [60, 40],
        "clouds": [{"file": "../data/creek.esker"}, {"file": "../data", "visible": false, "offset": [1.0, 0.0, 0.0]}],
    });
    scene.as_object_mut().unwrap().extend(marks.as_object().unwrap().clone());
    let first = folder.write("my scenes/first.json", &scene.to_string());
    let second = save(&folder, &first, "data/second.json", &["--method", "points"]);
    let saved: Value = serde_json::from_str(&std::fs::read_to_string(&second).unwrap()).unwrap();
    for (field, value) in marks.as_object().unwrap() {
        assert_eq!(&saved[field], value, "{field}");
    }
    assert_eq!(saved["method"], "points");
    assert_eq!(saved["size"], json!([60, 40]));
    assert_eq!(
        saved["clouds"],
        json!([{"file": "creek.esker"}, {"file": ".", "visible": false, "offset": [1.0, 0.0, 0.0]}])
    );
    let wanted = picture(&folder, &file, &["--size", "60x40", "--method", "points"]);
    assert!(picture(&folder, &second, &[]) == wanted);
}

fn by_content() {
    let folder = Folder::new();
    let rows: String = (0..900).map(|i| format!("{} {} {}\n", i % 30, i / 30, i % 7)).collect();
    let scan = folder.write("scan.json", &rows);
    let wanted = picture(&folder, &scan, &["--size", "50x40"]);
    // The name of a document is free.
    let text = r#"{"esker_scene": 1, "size": [50, 40], "clouds": [{"file": "scan.json"}]}"#;
    for name in ["scene.json", "scene.txt", "scene"] {
        let scene = folder.write(name, &format!("\u{feff} \n{text}"));
        assert!(picture(&folder, &scene, &[]) == wanted, "{name}");
    }
    // Scans that speak of documents, or begin like one.
    for head in ["# {\"esker_scene\": 1}\n", "{x y z\n", "{ \"x\", \"y\", \"z\" }\n"] {
        let scan = folder.write("scan.txt", &format!("{head}{rows}"));
        let out = folder.file("q.png");
        let words = ["-o", out.to_str().unwrap(), "--size", "50x40"].map(OsStr::new);
        let outcome = render(&scan, &words);
        assert!(!outcome.stderr.contains("scene document"), "{head:?}: {}", outcome.stderr);
    }
    let out = folder.file("r.png");
    let words = ["-o", out.to_str().unwrap()].map(OsStr::new);
    for (name, text, what) in [
        ("plain.json", "{\"clouds\": []}", "no scene document: it needs \"esker_scene\": 1"),
        ("geo.json", r#"{"type": "Polygon", "coordinates": []}"#, "no scene document"),
    ] {
        let refused = render(&folder.write(name, text), &words);
        assert!(
            refused.error().contains(name) && refused.error().contains(what),
            "{}",
            refused.stderr
        );
    }
    let scene = folder.file("scene.json");
    let both = [words[0], words[1], scan.as_os_str()];
    let refused = render(&scene, &both);
    assert!(refused.error().contains("name no other input"), "{}", refused.stderr);
    assert!(!out.exists());
}

fn not_drawn() {
    let folder = Folder::new();
    built(&folder);
    let rows = |from: u32| {
        (from..from + 400).map(|i| format!("{} {} 1\n", i % 20, i / 20)).collect::<String>()
    };
    let [a, b] = [("data/a.xyz", 0), ("data/b.xyz", 400)]
        .map(|(name, from)| folder.write(name, &rows(from)));
    let creek = r#"{"file": "../data/creek.esker"}"#;
    let draw = |clouds: &str, more: &str| {
        let text = format!(r#"{{"esker_scene": 1, "size": [50, 40], "clouds": [{clouds}]{more}}}"#);
        let scene = folder.write("my scenes/s.json", &text);
        let out = folder.file("p.png");
        render(&scene, &[OsStr::new("-o"), out.as_os_str()])
    };
    for (clouds, more, field, what) in [
        (
            &*format!(r#"{creek}, {{"file": "../data/creek.esker", "offset": [10.005, 0, 0]}}"#),
            "",
            "creek.esker",
            "1000.500 steps of 0.01 beside the other one along x",
        ),
        (&format!(r#"{creek}, {{"file": "../data/a.xyz"}}"#), "", "a.xyz", "build it with"),
        (r#"{"file": "../data/a.xyz", "offset": [1, 0, 0]}"#, "", "a.xyz", "have offsets"),
        (creek, r#", "clips": [{"box": [0, 0, 0, 1, 1, 1]}]"#, "creek.esker", "is wanted"),
        (r#"{"file": "none.laz"}"#, "", "none.laz", "cannot open"),
        ("", "", "`clouds`", "nothing to draw"),
    ] {
        let refused = draw(clouds, more);
        let error = refused.error();
        assert!(error.contains(field) && error.contains(what), "{error}");
    }
    assert!(!folder.file("p.png").exists());
    // Files are drawn beside each other.
    draw(&format!(r#"{creek}, {{"file": "../data/creek.esker", "offset": [1200, 0, 0]}}"#), "")
        .worked();
    let marks = r#", "measurements": [{"kind": "coordinates", "points": [[1, 2, 3]]}],
                  "annotations": [{"text": "a", "at": [1, 2, 3]}]"#;
    let drawn = draw(creek, marks);
    drawn.worked();
    for what in ["measurements", "annotations"] {
        let is_note = |line: &str| line.starts_with("note: ") && line.contains(what);
        assert!(drawn.stderr.lines().any(is_note), "{what}: {}", drawn.stderr);
    }
    // Scans are drawn together, as when they are named on the command line.
    draw(r#"{"file": "../data/a.xyz"}, {"file": "../data/b.xyz"}"#, "").worked();
    let together = std::fs::read(folder.file("p.png")).unwrap();
    let out = folder.file("q.png");
    let words = [
        b.as_os_str(),
        OsStr::new("-o"),
        out.as_os_str(),
        OsStr::new("--size"),
        OsStr::new("50x40"),
    ];
    render(&a, &words).worked();
    assert!(std::fs::read(&out).unwrap() == together);
}

fn refused() {
    let folder = Folder::new();
    let out = folder.file("p.png");
    let long = format!("{{\"esker_scene\": 1}}{}", " ".repeat(17 << 20));
    for (text, what) in [
        (r#"{"esker_scene": 1, "clouds": [{"fi"#, "EOF while parsing"),
        (r#"{"esker_scene": 1, "clouds": [,]}"#, "line 1 column"),
        (r#"{"esker_scene": 1} {}"#, "trailing characters"),
        (r#"{"esker_scene": 1, "fog": 1}"#, "unknown field `fog`"),
        (
            r#"{"esker_scene": 2, "fog": 1}"#,
            "is a scene document of version 2, and this program reads version 1",
        ),
        (r#"{"esker_scene": 1, "size": [0, 1]}"#, "`size`"),
        (&long, "is longer than 16 MiB"),
    ] {
        let scene = folder.write("s.json", text);
        for words in [&[OsStr::new("-o"), out.as_os_str()][..], &[OsStr::new("--explain")]] {
            let refused = render(&scene, words);
            let error = refused.error();
            assert!(error.contains("s.json: ") && error.contains(what), "{error}");
        }
    }
    assert_eq!(folder.names(), ["s.json"]);
}

fn never_replaces() {
    let folder = Folder::new();
    let scan = folder.write("scan.xyz", "0 0 0\n1 2 3\n4 5 6\n");
    let other = folder.write("other.json", "{\"a\": 1}");
    let scene = save(&folder, &scan, "scene.json", &[]);
    for (out, what) in [
        (&scan, "is input and output at once"),
        (&other, "no scene document"),
        (&folder.file("nowhere/s.json"), "there is no folder"),
        (&folder.file(""), "is a folder"),
    ] {
        let refused = render(&scan, &[OsStr::new("--save-scene"), out.as_os_str()]);
        assert!(refused.error().contains(what), "{}", refused.stderr);
    }
    let refused = render(&scene, &[OsStr::new("--save-scene"), scene.as_os_str()]);
    assert!(refused.error().contains("is input and output at once"), "{}", refused.stderr);
    let explained = render(&scan, &["--explain", "--save-scene", "x.json"].map(OsStr::new));
    assert!(explained.error().contains("--save-scene"), "{}", explained.stderr);
    // An older document is replaced.
    let text = std::fs::read_to_string(&scene).unwrap();
    save(&folder, &scan, "scene.json", &["--size", "9x9"]);
    assert_ne!(std::fs::read_to_string(&scene).unwrap(), text);
    assert_eq!(std::fs::read_to_string(&other).unwrap(), "{\"a\": 1}");
    assert_eq!(folder.names(), ["other.json", "scan.xyz", "scene.json"]);
    // The picture and its document in one run.
    let (out, words) = (folder.file("p.png"), ["--size", "30x20", "--json"].map(OsStr::new));
    let both = [OsStr::new("-o"), out.as_os_str(), OsStr::new("--save-scene"), scene.as_os_str()];
    let report = render(&scan, &[&both, &words[..]].concat()).json();
    assert_eq!(report["scene"], scene.to_str().unwrap());
    let drawn = std::fs::read(&out).unwrap();
    assert!(picture(&folder, &scene, &[]) == drawn);
}

fn info() {
    let folder = Folder::new();
    let scene = folder.write(
        "s.json",
        r#"{"esker_scene": 1, "method": "ewa", "clouds": [{"file": "a.laz"}, {"file": "b.laz", "visible": false}],
            "bookmarks": [{"name": "top", "camera": "direction=0,0,-1"}]}"#,
    );
    let report = esker([OsStr::new("info"), scene.as_os_str(), OsStr::new("--json")]).json();
    assert_eq!(report["version"], 1);
    assert_eq!(report["clouds"], json!(["a.laz"]));
    assert_eq!(report["clouds_hidden"], json!(["b.laz"]));
    assert_eq!((&report["method"], &report["bookmarks"]), (&json!("ewa"), &json!(["top"])));
    let text = esker([OsStr::new("info"), scene.as_os_str()]);
    assert!(text.worked().stdout.contains("scene document of version 1"), "{}", text.stdout);
    let damaged = folder.write("t.json", r#"{"esker_scene": 1, "fog": 1}"#);
    let refused = esker([OsStr::new("info"), damaged.as_os_str()]);
    assert!(refused.error().contains("unknown field `fog`"), "{}", refused.stderr);
}
