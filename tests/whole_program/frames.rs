//! The cost of a frame as scripts query it: `esker render --explain`, `esker bench render`,
//! `esker bench leave-out`, `esker bench error-time`, `esker bench stability`, and the filters of
//! `esker render`.

use crate::folder::Folder;
use crate::program::esker;
#[cfg(unix)]
use crate::program::esker_under;
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::ffi::OsStr;
use std::path::PathBuf;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("frames: table 1 has its fields for every method and backend", table));
    trials.push(trial("frames: radii are measured beside a full screen", radii));
    trials.push(trial("frames: what is left out is reported with bytes and times", omissions));
    trials.push(trial("frames: only what a view has is reported as left out", no_omissions));
    trials.push(trial("frames: errors against exact surfaces and against all points", errors));
    #[cfg(unix)]
    trials.push(trial("frames: a budget of time is met by a coarser picture", paces));
    trials.push(trial("frames: stability tests relations and sweeps conditions", stability));
    trials.push(trial("frames: --explain reports the plan and draws nothing", plan));
    trials.push(trial("frames: filters and ranges are applied", filters));
    trials.push(trial("frames: values that mean no data are in no range of colours", ranges));
}

/// A small generated scan with every attribute and normals.
fn terrain(folder: &Folder) -> PathBuf {
    let file = folder.file("terrain.esker");
    let build =
        ["build", "synthetic:terrain:20000:3", "--normals", "estimate", "--node-capacity", "2048"];
    let words = build.map(OsStr::new).into_iter().chain([OsStr::new("-o"), file.as_os_str()]);
    esker(words.chain([OsStr::new("--json")])).json();
    file
}

fn table() {
    let words =
        ["bench", "render", "--points", "3000,9k", "--size", "64x64,97x33", "--gpu-software"];
    let report = esker(words.iter().chain(&["--json", "--progress", "none"])).json();
    let rows = report["rows"].as_array().unwrap();
    let backends = if report["adapter"].is_null() { 1 } else { 2 };
    assert_eq!(rows.len(), 2 * 2 * 3 * backends, "{report}");
    for row in rows {
        for field in ["points", "width", "height", "total_ms", "copy_floor_ms"] {
            assert!(row[field].as_f64().is_some_and(|n| n > 0.0), "`{field}` of {row}");
        }
        for field in ["project_ms", "pull_push_ms", "shade_ms"] {
            assert!(row[field].as_f64().is_some_and(|n| n >= 0.0), "`{field}` of {row}");
        }
        for field in ["model", "backend", "method"] {
            assert!(row[field].is_string(), "`{field}` of {row}");
        }
    }
    for row in rows {
        let number = |field: &str| row[field].as_f64();
        let fields = ["dispatches", "gpu_floor_ms", "over_floor"];
        if row["backend"] == "cpu" {
            assert!(fields.iter().all(|field| row[field].is_null()), "{row}");
            continue;
        }
        let [dispatches, floor, over] = fields.map(|field| number(field).unwrap());
        assert!(dispatches >= 2.0 && floor > 0.01 * dispatches, "{row}");
        assert!((over * floor / number("total_ms").unwrap() - 1.0).abs() < 1e-6, "{row}");
    }
    let points: Vec<_> = rows.iter().map(|row| row["points"].as_u64().unwrap()).collect();
    assert!(points.iter().all(|n| [3000, 9000].contains(n)), "all points are drawn: {points:?}");
}

/// So few points are dense at no size: omissions of dense views are reported as not applicable.
fn no_omissions() {
    let folder = Folder::new();
    let rows: String = (0..100)
        .map(|i| format!("{}.0001 {}.0001 {}.0001\n", i % 10 * 10, i / 10 * 10, i % 3 * 30))
        .collect();
    let scan = folder.write("few.xyz", &rows);
    let words = |more: &[&str]| {
        let words = ["bench", "leave-out", "--size", "24x24", "--backend", "cpu"].iter();
        let words = words.chain(more).map(OsStr::new).chain([scan.as_os_str()]);
        esker(words.collect::<Vec<_>>())
    };
    let report = words(&["--json"]).json();
    let rows = report["rows"].as_array().unwrap();
    let applies = |name: &str| &rows.iter().find(|row| row["left_out"] == name).unwrap()["applies"];
    assert_eq!(applies("pull and push of a dense view"), false, "{report}");
    assert_eq!(applies("means of the points that share a pixel"), false, "{report}");
    assert_eq!(applies("surfaces: points alone"), true, "{report}");
    let idle = rows.iter().filter(|row| row["applies"] == false);
    assert!(idle.clone().count() > 1, "{report}");
    for row in idle {
        assert!(row["changed_share"] == 0.0 && row["verdict"] == "not needed, left out", "{row}");
    }
    let text = words(&[]);
    for part in ["not in this view", "silhouettes", "nothing that it does not need"] {
        assert!(text.worked().stdout.contains(part), "{part}: {}", text.stdout);
    }
}

/// The report compares the time of larger radii with that of a full screen in the same run.
fn radii() {
    let words = ["bench", "render", "--points", "3000", "--size", "96x64", "--method", "pull-push"];
    let words = words.into_iter().chain(["--radii", "0.5,4", "--gpu-software"]);
    let report = esker(words.clone().chain(["--json", "--progress", "none"])).json();
    let rows = report["rows"].as_array().unwrap();
    let backends = if report["adapter"].is_null() { 1 } else { 2 };
    assert_eq!(rows.len(), 2 * backends, "{report}");
    let covered = |row: &Value| row["pixels_covered"].as_u64().unwrap();
    for (small, large) in rows[..backends].iter().zip(&rows[backends..]) {
        assert_eq!(small["backend"], large["backend"]);
        assert!(0 < covered(small) && covered(small) < covered(large), "{report}");
        assert!(covered(large) < 96 * 64, "{report}");
        for row in [small, large] {
            assert!(row["full_screen_ms"].as_f64().is_some_and(|ms| ms > 0.0), "{report}");
        }
    }
    let text = esker(words.chain(["--progress", "none"]));
    let lines = text.worked().stdout.lines();
    let lines = lines.filter(|l| l.contains("of a full screen's") && l.contains("cover "));
    assert_eq!(lines.count(), 2 * backends, "{}", text.stdout);
}

fn omissions() {
    let folder = Folder::new();
    let file = terrain(&folder);
    let words = ["--size", "64x64", "--backend", "cpu", "--json", "--progress", "none"];
    let words = ["bench", "leave-out"]
        .map(OsStr::new)
        .into_iter()
        .chain([file.as_os_str()])
        .chain(words.map(OsStr::new));
    let report = esker(words).json();
    let rows = report["rows"].as_array().unwrap();
    assert!(rows.len() >= 6, "{report}");
    let pair = |name: &str, field: &str| -> [f64; 2] {
        let row = rows.iter().find(|row| row["left_out"] == name).unwrap();
        ["with", "without"].map(|side| row[side][field].as_f64().unwrap())
    };
    for row in rows {
        let name = row["left_out"].as_str().unwrap();
        for field in ["bytes_read", "bytes_resident", "cpu_ms"] {
            assert!(pair(name, field).iter().all(|&n| n > 0.0), "`{field}` of {row}");
        }
    }
    let saves = |name, field| {
        let [with, without] = pair(name, field);
        assert!(without < with, "{name} saves no {field}: {with} and {without}");
    };
    saves("normal plane of points alone", "bytes_resident");
    saves("colour plane", "bytes_resident");
    saves("values beyond a byte of code", "bytes_resident");
    saves("what lies outside a box", "bytes_resident");
    // The two frames of each row differ; omissions of dense views are measured at a small enough
    // size.
    assert!(rows.iter().all(|row| row["applies"] == true), "{report}");
    let row = |name: &str| rows.iter().find(|row| row["left_out"] == name).unwrap();
    let side = |name: &str| row(name)["width"].as_u64().unwrap();
    let dense = side("pull and push of a dense view");
    assert!(dense <= 64 && side("means of the points that share a pixel") >= dense, "{report}");
    assert_eq!(side("highlights"), 64, "{report}");
    judges_parts(&report);
}

/// Each omission, pass and bare picture has a verdict that follows from its figures; some passes
/// are needed, and what plans leave out changes no pixel.
fn judges_parts(report: &Value) {
    let rows = |name: &str| report[name].as_array().unwrap();
    let share = |row: &Value, field: &str| {
        row[field].as_f64().filter(|share| (0.0..=1.0).contains(share)).unwrap()
    };
    let by_rule = ["pull and push of a dense view", "values beyond a byte of code"];
    for row in rows("rows").iter().chain(rows("passes")) {
        let [changed, off, flip] = ["changed_share", "off_share", "flip"].map(|f| share(row, f));
        assert!(off <= changed && (flip > 0.0) == (changed > 0.0), "{row}");
        let is_left_out = row["runs"] == false
            || row["left_out"].as_str().is_some_and(|name| by_rule.contains(&name));
        let verdict = match (is_left_out, changed) {
            (true, 0.0) => "not needed, left out",
            (true, _) => "fault",
            (false, changed) if changed >= 1e-3 => "needed",
            (false, _) => "ran, not needed",
        };
        assert_eq!(row["verdict"], verdict, "{row}");
    }
    let of = |view: &str, part: &str| {
        let is = |row: &&Value| row["view"] == view && row["part"] == part;
        rows("passes").iter().find(is).unwrap_or_else(|| panic!("{view}, {part}: {report}"))
    };
    for part in ["pull and push", "silhouettes", "antialiasing", "highlights"] {
        let row = of("surfaces", part);
        assert!(row["verdict"] == "needed" && row["cpu_ms"].is_number(), "{row}");
    }
    assert_eq!(of("surfaces, dense view", "silhouettes")["verdict"], "not needed, left out");
    assert_eq!(of("surfaces, exposure evened", "exposure")["verdict"], "needed");
    assert_eq!(of("surfaces and dots", "dots among surfaces")["verdict"], "ran, not needed");
    for row in rows("loaded") {
        assert_eq!(
            (&row["kind"], &row["verdict"]),
            (&"loaded".into(), &"not needed, left out".into())
        );
        let planes: Vec<_> = row["planes"].as_object().unwrap().keys().collect();
        let wanted: &[&str] = match row["picture"].as_str().unwrap() {
            "points in one colour" => &["position"],
            "points in the file's colours" => &["colour", "position"],
            _ => &["normal", "position"],
        };
        assert_eq!(planes, wanted, "{row}");
    }
    assert_eq!(rows("loaded").len(), 4);
}

/// Pictures are the better the more their setting takes of the scan; pages have plots and pictures.
fn errors() {
    let folder = Folder::new();
    let out = folder.file("pages");
    let file = terrain(&folder);
    let words = ["bench", "error-time", "--size", "96x64", "--backend", "cpu", "truth:sphere"];
    let report = esker(
        words
            .map(OsStr::new)
            .into_iter()
            .chain([file.as_os_str(), OsStr::new("--out"), out.as_os_str()])
            .chain(["--json", "--progress", "none"].map(OsStr::new)),
    )
    .json();
    let rows = report["rows"].as_array().unwrap();
    let is = |row: &Value, method: &str, field: &str, value: Value| {
        row["method"] == method && row["settings"][field] == value
    };
    for scan in ["sphere", "terrain"] {
        let rows: Vec<&Value> = rows.iter().filter(|row| row["file"] == scan).collect();
        for row in &rows {
            for field in ["ms", "flip"] {
                assert!(row[field].as_f64().is_some_and(|n| n > 0.0), "`{field}` of {row}");
            }
            for field in ["off_share", "hole_share", "bleeding_share", "depth_px", "flicker"] {
                assert!(row[field].as_f64().is_some_and(|n| n >= 0.0), "`{field}` of {row}");
            }
        }
        let of = |row: &Value, field: &str| row[field].as_f64().unwrap();
        let front: Vec<_> = rows.iter().filter(|row| row["on_front"] == true).collect();
        assert!(!front.is_empty());
        for row in &front {
            let beats = |other: &&&Value| {
                of(other, "ms") < of(row, "ms") && of(other, "flip") < of(row, "flip")
            };
            assert_eq!(rows.iter().filter(beats).count(), 0, "{row}");
        }
        let flip = |field: &str, value: Value| {
            let row = rows.iter().find(|row| is(row, "pull-push", field, value.clone())).unwrap();
            of(row, "flip")
        };
        assert!(flip("scale", 0.5.into()) > 1.1 * flip("scale", 1.0.into()), "{report}");
        let holes = |method: &str| {
            let row = rows.iter().find(|row| row["method"] == method).unwrap();
            of(row, "hole_share")
        };
        assert!(holes("points") > 0.02 && holes("ewa") < 0.01, "{report}");
        let page = std::fs::read_to_string(out.join(format!("{scan}.html"))).unwrap();
        assert!(page.contains("On this machine at 33 ms"), "{page}");
        for plot in [format!("{scan}.svg"), format!("{scan}-loading.svg")] {
            assert!(page.contains(&format!("<img src='{plot}'")), "{page}");
            assert!(std::fs::read_to_string(out.join(plot)).unwrap().starts_with("<svg"));
        }
        assert!(page.contains("<td>density-jump</td>"), "{page}");
        assert!(out.join(format!("{scan}-reference.png")).exists());
    }
    let loads = report["streaming"].as_array().unwrap();
    for load in loads {
        let curve = load["curve"].as_array().unwrap();
        let path = load["view"] == "path";
        assert!(path || curve.last().unwrap()[1].as_f64().unwrap() < 1e-6, "{load}");
        assert!(load["area_ms"].as_f64().is_some_and(|area| area >= 0.0), "{load}");
    }
    let by = |order: &str| loads.iter().filter(|load| load["priority"] == order).count();
    assert!(by("distance") >= 4 && by("distance") == by("error per byte"), "{report}");
    let sphere = rows.iter().find(|row| row["file"] == "sphere").unwrap();
    assert!(sphere["normal_deg"].as_f64().is_some_and(|n| n < 5.0), "{sphere}");
    let terrain = rows.iter().filter(|row| row["file"] == "terrain");
    assert!(terrain.clone().all(|row| row["normal_deg"].is_null() && row["build"].is_null()));
    let unknown = esker(["bench", "error-time", "truth:moon"]);
    assert!(unknown.error().contains("there are sphere, cube"), "{}", unknown.stderr);
}

/// The model of the machine is measured once, and kept; a budget that is no limit changes nothing.
#[cfg(unix)]
fn paces() {
    let folder = Folder::new();
    let file = terrain(&folder);
    let caches = folder.file("caches");
    let render = |name: &str, more: &[&str]| {
        let out = folder.file(name);
        let limit = format!(
            "XDG_CACHE_HOME='{0}' HOME='{0}'; export XDG_CACHE_HOME HOME",
            caches.display()
        );
        let words = ["render", "--size", "320x200", "--backend", "cpu", "--json"].map(OsStr::new);
        let words = words.into_iter().chain([file.as_os_str(), OsStr::new("-o"), out.as_os_str()]);
        let report = esker_under(&limit, words.chain(more.iter().map(OsStr::new))).json();
        (report, std::fs::read(out).unwrap())
    };
    let (plain, expected) = render("plain.png", &[]);
    assert!(plain["pace"].is_null(), "{plain}");
    let (ample, picture) = render("ample.png", &["--budget-ms", "100000"]);
    assert_eq!(ample["pace"]["scale"], 1.0, "{ample}");
    assert!(picture == expected, "an ample budget changes the picture");
    let (tight, _) = render("tight.png", &["--budget-ms", "0.02"]);
    let scale = tight["pace"]["scale"].as_f64().unwrap();
    assert!(scale < 0.5 && tight["width"] == 320 && tight["height"] == 200, "{tight}");
    assert!(tight["notes"].to_string().contains("--budget-ms"), "{tight}");
    for field in ["predicted_ms", "predicted_cpu_ms", "correction"] {
        assert!(ample["pace"][field].as_f64().is_some_and(|value| value > 0.0), "{field}: {ample}");
    }
    let kept: Vec<_> = std::fs::read_dir(caches.join("esker")).unwrap().collect();
    assert_eq!(kept.len(), 1, "one model is kept: {kept:?}");
    let refused = esker([
        OsStr::new("render"),
        file.as_os_str(),
        OsStr::new("-o"),
        folder.file("x.png").as_os_str(),
        OsStr::new("--budget-ms"),
        OsStr::new("-1"),
    ]);
    assert!(refused.error().contains("milliseconds"), "{}", refused.stderr);
}

fn stability() {
    let parts =
        ["bench", "stability", "synthetic:terrain:20000:3", "--progress", "none", "--parts"];
    let words = |parts_and_more: &[&'static str]| {
        esker(parts.into_iter().chain(parts_and_more.to_vec()).collect::<Vec<_>>())
    };
    let report = words(&["relations,wide-view,same-place", "--json"]).json();
    let relations = report["relations"].as_array().unwrap();
    let of = |name: &str| -> Vec<&Value> {
        relations.iter().filter(|row| row["relation"] == name).collect()
    };
    for exact in ["unit times 2^k", "offset up to 10^9", "order of points", "target at 1 or 10^9"] {
        assert_eq!(of(exact).len(), 4, "{exact}: {report}");
        assert!(of(exact).iter().all(|row| row["measured"] == 0.0), "{exact}: {report}");
    }
    // Another sample is another picture, so the comparison is not of equal files.
    for near in ["step / 10", "LAS or PLY"] {
        assert_eq!(of(near).len(), 4, "{near}: {report}");
        assert!(of(near).iter().all(|row| row["measured"].as_f64() > Some(0.001)), "{report}");
    }
    assert!(relations.iter().all(|row| row["verdict"] == "holds"), "{report}");
    let cases = report["cases"].as_array().unwrap();
    let refused: Vec<_> = cases.iter().filter(|case| case["verdict"] == "refused").collect();
    assert!(!refused.is_empty());
    for case in refused {
        assert!(case["axis"] == "wide-view" && case["value"] == 175.0, "{case}");
        assert!(case["measured"].is_null(), "{case}");
        assert!(case["messages"][0].as_str().unwrap().contains("below 175 degrees"), "{case}");
    }
    // The document has what is rated.
    let limits = include_str!("../../docs/limits.md");
    for axis in report["axes"].as_array().unwrap() {
        let [name, method, measure] =
            ["axis", "method", "measure"].map(|f| axis[f].as_str().unwrap());
        let row = limits.lines().find(|line| {
            line.starts_with(&format!("| {name} |"))
                && line.contains(&format!("| {method} | {measure} |"))
        });
        let rated = format!("| {} |", axis["rated_to"]);
        assert!(row.is_some_and(|row| row.contains(&rated)), "{axis}: {row:?}");
    }
    let table = words(&["same-place", "--markdown"]);
    let lines: Vec<&str> = table.worked().stdout.lines().collect();
    assert_eq!(lines.len(), 4, "{}", table.stdout);
    assert!(lines[2].starts_with("| same-place |"), "{}", table.stdout);
    let unknown = words(&["sideways"]);
    assert!(unknown.error().contains("there are relations, axes"), "{}", unknown.stderr);
}

fn plan() {
    let folder = Folder::new();
    let file = terrain(&folder);
    let explain = |more: &[&str]| -> Value {
        let words = ["render", "--explain", "--json"].iter().chain(more).map(OsStr::new);
        esker(words.chain([file.as_os_str()])).json()
    };
    let names = |report: &Value| -> Vec<String> {
        let planes = report["planes"].as_array().unwrap().iter();
        planes.map(|plane| plane["plane"].as_str().unwrap().to_owned()).collect()
    };
    let surface = explain(&["--colour", "gps_time"]);
    assert_eq!(names(&surface), ["position", "residual", "normal", "gps_time"], "{surface}");
    let points = explain(&["--method", "points", "--colour", "plain"]);
    assert_eq!(names(&points), ["position", "residual"], "{points}");
    assert_eq!(points["passes"], serde_json::json!(["project", "resolve"]));
    let dense = explain(&["--target-spacing", "0", "--size", "24x18"]);
    let passes: Vec<_> = dense["passes"].as_array().unwrap().iter().collect();
    assert!(passes.iter().all(|&pass| pass != "push" && pass != "pull"), "{dense}");
    let left_out = |report: &Value, what: &str| {
        let all = report["left_out"].as_array().unwrap();
        all.iter().any(|line| line.as_str().unwrap().starts_with(what))
    };
    for (report, means, pyramid) in
        [(&surface, true, false), (&dense, false, false), (&points, false, true)]
    {
        assert_eq!(left_out(report, "means of the points that share a pixel"), means, "{report}");
        assert_eq!(left_out(report, "pyramid, lighting, antialiasing"), pyramid, "{report}");
    }
    let splats = explain(&["--method", "ewa"]);
    assert!(left_out(&splats, "pyramid: ") && !left_out(&splats, "pyramid, lighting"), "{splats}");
    let said = esker(["render", "--explain"].map(OsStr::new).into_iter().chain([file.as_os_str()]));
    assert!(said.worked().stdout.contains("left out: "), "{}", said.worked().stdout);
}

fn filters() {
    let folder = Folder::new();
    let file = terrain(&folder);
    let draw = |name: &str, more: &[&str]| -> Value {
        let out = folder.file(name);
        let fixed = ["render", "--json", "--size", "96x72", "--backend", "cpu"];
        let words = fixed.iter().chain(more).map(OsStr::new);
        esker(words.chain([file.as_os_str(), OsStr::new("-o"), out.as_os_str()])).json()
    };
    let all = draw("all.png", &["--colour", "classification", "--target-spacing", "0"]);
    let ground =
        draw("ground.png", &["--colour", "class", "--classes", "ground", "--target-spacing", "0"]);
    let covered = |report: &Value| report["pixels_covered"].as_u64().unwrap();
    assert!(covered(&ground) > 0 && covered(&ground) < covered(&all), "{ground}");
    let entries = ground["colour"]["entries"].as_array().unwrap();
    assert!(entries.len() == 1 && entries[0]["name"] == "ground", "{ground}");
    let ranged = draw("ranged.png", &["--colour", "intensity:10..20"]);
    assert_eq!(ranged["colour"]["range"], serde_json::json!([10.0, 20.0]), "{ranged}");
}

/// Values with no-data entries, which are the greatest number of the type, as in scanner software.
fn ranges() {
    let folder = Folder::new();
    let rows: String = (0..2000)
        .map(|i| {
            let tree =
                if i % 3 == 0 { "1.7976931348623157e308".into() } else { (i % 50).to_string() };
            format!("{},{},{},{tree},0,{},0,0,0\n", i % 40, i / 40, i % 7, 7 + i % 3)
        })
        .collect();
    let head = "x,y,z,treeID,nir,point_source_id,red,green,blue\n".to_owned();
    let scan = folder.write("trees.csv", &(head + &rows));
    let legend = |colour: &str| -> Value {
        let out = folder.file("p.png");
        let words = ["render", "--json", "--size", "64x48", "--colour", colour].map(OsStr::new);
        let words = words.into_iter().chain([scan.as_os_str(), OsStr::new("-o"), out.as_os_str()]);
        esker(words).json()
    };
    // Names of colours ignore case.
    for name in ["treeID", "treeid", "TREEID"] {
        let report = legend(name);
        let range = report["colour"]["range"].as_array().unwrap().clone();
        let [low, high] = [0, 1].map(|i| range[i].as_f64().unwrap());
        assert!((0.0..3.0).contains(&low) && (46.0..50.0).contains(&high), "{report}");
        assert!(report["legend"].as_str().unwrap().len() < 60, "{report}");
    }
    assert_eq!(legend("Elevation")["colour"]["name"], "elevation");
    let ids = legend("source_id");
    assert_eq!(ids["colour"]["range"], serde_json::json!([7.0, 9.0]), "{ids}");
    assert!(ids["legend"].as_str().unwrap().contains("7 .. 9"), "{ids}");
    let cells = legend("level");
    assert!(cells["legend"].as_str().unwrap().contains(" edge "), "{cells}");
    for (name, note) in [("nir", "all values are zero"), ("rgb", "all of them are black")] {
        let report = legend(name);
        assert_eq!(report["colour"]["note"], note, "{report}");
        assert!(report["legend"].as_str().unwrap().contains(note), "{report}");
    }
}
