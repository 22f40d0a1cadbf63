//! Pictures of the sample scan are the same from the scan and from its file, in any size and by any
//! attribute, and never empty without a note.

use crate::folder::Folder;
use crate::program::{Outcome, build, esker, sample};
use crate::trial;
use libtest_mimic::Trial;
use std::ffi::OsStr;
use std::path::Path;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("pictures: the scan and its file give the same picture", same_from_scan));
    trials.push(trial("pictures: a folder is drawn as the scans in it", folder_of_scans));
    trials.push(trial("pictures: every attribute colours them", every_attribute));
    trials.push(trial("pictures: every size and method", sizes));
    trials.push(trial("pictures: one stray does not change the colour range", strays));
    trials.push(trial(
        "pictures: a camera that sees nothing gives a background and says why",
        nothing_seen,
    ));
    trials.push(trial(
        "pictures: a filter that leaves nothing is an error, as in exports",
        nothing_left,
    ));
    trials
        .push(trial("pictures: exposures that cannot be compensated are reported", nothing_evened));
    trials.push(trial("pictures: errors name the scan, not the temporary file", scans_are_named));
    trials.push(trial("pictures: ranges of values draw what an export of them draws", ranges));
    trials.push(trial("pictures: sources are named in the legend", sources_are_in_the_legend));
}

/// Draws `input` and returns the outcome.
fn render(input: &Path, out: &Path, more: &[&str]) -> Outcome {
    let words = [OsStr::new("render"), input.as_os_str(), OsStr::new("-o"), out.as_os_str()];
    esker(words.into_iter().chain(["--progress", "none"].iter().chain(more).map(OsStr::new)))
}

/// Draws `input`. Returns width and height, colours, and the number of covered pixels.
fn picture(folder: &Folder, input: &Path, more: &[&str]) -> ([u32; 2], Vec<u8>, u64) {
    let out = folder.file("p.png");
    let report = render(input, &out, &[&["--json"], more].concat()).json();
    let file = std::io::BufReader::new(std::fs::File::open(&out).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(
        (report["width"].as_u64(), report["height"].as_u64()),
        (Some(frame.width.into()), Some(frame.height.into()))
    );
    ([frame.width, frame.height], pixels, report["pixels_covered"].as_u64().unwrap())
}

fn built(folder: &Folder) -> std::path::PathBuf {
    let out = folder.file("out.esker");
    build(&[sample()], &out, &[]);
    out
}

fn folder_of_scans() {
    let folder = Folder::new();
    let scans = folder.file("scans");
    std::fs::create_dir(&scans).unwrap();
    let scan = sample();
    std::fs::copy(&scan, scans.join(scan.file_name().unwrap())).unwrap();
    let more = ["--size", "200x150"];
    assert!(picture(&folder, &scans, &more) == picture(&folder, &sample(), &more));
}

fn same_from_scan() {
    let folder = Folder::new();
    let file = built(&folder);
    for more in [&["--size", "300x200"][..], &["--method", "points", "--threads", "1"]] {
        let (from_file, from_scan) =
            (picture(&folder, &file, more), picture(&folder, &sample(), more));
        assert!(from_file == from_scan, "{more:?}");
        assert!(from_file.2 > 1000, "{} pixels are covered", from_file.2);
    }
}

fn every_attribute() {
    let folder = Folder::new();
    let file = built(&folder);
    let info = esker([OsStr::new("info"), file.as_os_str(), OsStr::new("--json")]).json();
    let attributes = info["attributes"].as_array().unwrap();
    let mut names: Vec<_> = attributes.iter().map(|a| a["name"].as_str().unwrap()).collect();
    let has_colours = names.contains(&"red");
    // The colour channels are drawn together as `rgb`.
    names.retain(|name| !["red", "green", "blue"].contains(name));
    names.extend(["elevation", "level", "depth", "plain"]);
    names.extend(has_colours.then_some("rgb"));
    let mut seen = std::collections::HashSet::new();
    for name in &names {
        let (_, pixels, covered) =
            picture(&folder, &file, &["--size", "160x120", "--colour", name]);
        assert!(covered > 1000, "{name}: {covered} pixels");
        seen.insert(pixels);
    }
    assert!(seen.len() > 5, "{} of {} pictures differ", seen.len(), names.len());
}

/// Range of the values that a picture maps to colours.
fn range(folder: &Folder, input: &Path, colour: &str) -> [f64; 2] {
    let words = ["--size", "40x30", "--colour", colour, "--json"];
    let report = render(input, &folder.file("p.png"), &words).json();
    [0, 1].map(|end| report["colour"]["range"][end].as_f64().unwrap())
}

fn strays() {
    let folder = Folder::new();
    let mut lines = String::from("x,y,z,intensity,time,echo\n");
    for i in 0..20_000 {
        let (x, y) = (i % 200, i / 200);
        let time = 3e8 + f64::from(i) * 0.01;
        lines +=
            &format!("{x},{y},{:.2},{},{time:.2},{}\n", 90.0 + f64::from(x) * 0.1, i % 32, i % 200);
    }
    let even = folder.write("even.csv", &lines);
    let stray = folder.write("stray.csv", &format!("{lines}5,5,1000000,65535,1,1e12\n"));
    for colour in ["elevation", "intensity", "time", "echo"] {
        let [even, stray] = [&even, &stray].map(|scan| range(&folder, scan, colour));
        let extent = even[1] - even[0];
        for end in [0, 1] {
            assert!(
                (stray[end] - even[end]).abs() < 0.05 * extent,
                "{colour}: {even:?}, {stray:?}"
            );
        }
    }
}

fn sizes() {
    let folder = Folder::new();
    let file = built(&folder);
    for method in ["points", "pull-push"] {
        for size in [[1, 1], [1, 7], [17, 3], [333, 501], [1024, 1], [2000, 1100]] {
            let shown = format!("{}x{}", size[0], size[1]);
            let (real, pixels, covered) =
                picture(&folder, &file, &["--size", &shown, "--method", method]);
            assert_eq!(real, size);
            assert_eq!(pixels.len(), (size[0] * size[1] * 4) as usize);
            assert!(covered <= u64::from(size[0] * size[1]), "{shown}: {covered}");
            assert!(size[1] < 100 || covered > 1000, "{shown}: {covered}");
        }
    }
    // Closed surfaces cover more pixels than points do.
    let cover =
        |method| picture(&folder, &file, &["--budget-points", "20000", "--method", method]).2;
    assert!(cover("pull-push") > cover("points"));
}

fn nothing_seen() {
    let folder = Folder::new();
    let file = built(&folder);
    let camera = "eye=1e7,1e7,1e9;target=1e7,1e7,2e9;up=0,1,0";
    let (_, _, covered) = picture(&folder, &file, &["--camera", camera]);
    assert_eq!(covered, 0, "{camera}");
    let away = folder.file("away.png");
    let words = ["render".as_ref(), file.as_os_str(), "-o".as_ref(), away.as_os_str()];
    let outcome = esker(words.into_iter().chain(["--camera", "eye=1e30,0,0"].map(OsStr::new)));
    assert!(outcome.error().contains("2^46 steps") && !away.exists(), "{}", outcome.stderr);
    let (_, _, covered) = picture(&folder, &file, &["--budget-points", "0"]);
    assert_eq!(covered, 0);
    // The report has a note with the reason.
    let out = folder.file("p.png");
    let none = folder.file("none.esker");
    build(&[folder.write("none.csv", "x,y,z\n")], &none, &[]);
    for (input, more, why) in [
        (&file, &["--camera", "eye=1e7,1e7,1e9;target=1e7,1e7,2e9;up=0,1,0"][..], "--fit"),
        (&file, &["--budget-points", "0"], "--budget-points 0"),
        (&none, &[], "there are no points"),
    ] {
        let said = render(input, &out, more);
        let note = said.worked().stdout.lines().last().unwrap_or_default();
        assert!(note.starts_with("note: nothing is seen: ") && note.contains(why), "{note}");
        let report = render(input, &out, &[more, &["--json"]].concat()).json();
        assert!(report["notes"][0].as_str().is_some_and(|n| n.contains(why)), "{report}");
    }
    let seen = render(&file, &out, &["--json"]).json();
    assert_eq!(seen["notes"], serde_json::json!([]), "{seen}");
}

fn ranges() {
    let folder = Folder::new();
    let file = built(&folder);
    let wanted = ["--where", "red:16000..26000", "--where", "green:30000.."];
    let words = [OsStr::new("export"), file.as_os_str(), OsStr::new("-o")];
    let las = folder.file("part.las");
    let words = words.into_iter().chain([las.as_os_str()]).chain(wanted.map(OsStr::new));
    let exported = esker(words.chain([OsStr::new("--json")])).json();
    let [all, part] = ["points_in", "points_out"].map(|name| exported[name].as_u64().unwrap());
    assert!(part > all / 20 && part < all / 2, "{exported}");
    let again = folder.file("again.esker");
    build(&[&las], &again, &[]);
    let eye = "eye=5678000,3769800,1900;target=5678984,3770632,980;fovy=50";
    let same = ["--method", "points", "--target-spacing", "0", "--size", "320x240"];
    let same = [&same[..], &["--camera", eye, "--backend", "cpu"]].concat();
    let (_, chosen, covered) = picture(&folder, &file, &[&same[..], &wanted].concat());
    let (_, rebuilt, _) = picture(&folder, &again, &same);
    // Hot positions drop a bit where the box of a node is wide, and the boxes differ: a point at
    // the border of a pixel may lie in the next one, as with a box in place of the ranges.
    let at = |pixels: &[u8], x: usize, y: usize| pixels[(y * 320 + x) * 4..][..4].to_vec();
    let pixels = (1..239).flat_map(|y| (1..319).map(move |x| (x, y)));
    let differ = pixels.filter(|&(x, y)| at(&chosen, x, y) != at(&rebuilt, x, y));
    let off = differ.count() as u64;
    assert!(covered > 10_000 && off * 100 < covered, "{off} of {covered}");
}

fn nothing_left() {
    let folder = Folder::new();
    let file = built(&folder);
    let plain = folder.file("plain.esker");
    build(&[folder.write("plain.xyz", "0 0 0\n1 2 3\n4 5 6\n")], &plain, &[]);
    let none = "none of its 3 points is wanted";
    for (input, more, word) in [
        (&file, ["--classes", "99"], "is wanted"),
        (&file, ["--box", "0,0,1,1"], "is wanted"),
        (&file, ["--polygon", "0,0 1,0 0,1"], "is wanted"),
        (&file, ["--clip", "centre=0,0,0;size=1,1,1;rotation=30"], "is wanted"),
        (&file, ["--clip", "box=1,2"], "six numbers"),
        (&file, ["--clip", "point=1e30,-1e30,0;normal=1,1,0"], "so far from the points"),
        (&file, ["--where", "red:70000.."], "is wanted"),
        (&file, ["--where", "red:9..1"], "holds no value"),
        (&file, ["--where", "red"], "ATTRIBUTE:MIN..MAX"),
        (
            &file,
            ["--where", "nonsense:1.."],
            "no attribute `nonsense` to choose points by; there are",
        ),
        // Within the box of a node, but without a point in it.
        (&plain, ["--box", "2,3,3,4"], none),
        (&plain, ["--classes", "2"], "plain.esker: has no classification"),
    ] {
        let (png, las) = (folder.file("p.png"), folder.file("out.las"));
        let words = [OsStr::new("export"), input.as_os_str(), OsStr::new("-o"), las.as_os_str()];
        let exported = esker(words.into_iter().chain(more.map(OsStr::new)));
        for outcome in [render(input, &png, &more), exported] {
            assert!(outcome.error().contains(word), "{more:?}: {}", outcome.stderr);
        }
        assert_eq!(folder.names(), ["out.esker", "plain.esker", "plain.xyz"], "{more:?}");
    }
    let words = ["render", "--explain", "--classes", "99"].map(OsStr::new);
    let explained = esker(words.into_iter().chain([file.as_os_str()]));
    assert!(explained.error().contains("is wanted"), "{}", explained.stderr);
}

fn nothing_evened() {
    let folder = Folder::new();
    let out = folder.file("P.PNG");
    // Points of one scan and of two scans in a plane.
    for (scans, note) in [(1, "all points are of one scan"), (2, "scans' own colours")] {
        let rows: String =
            (0..400).map(|i| format!("{},{},0,{},90,80,70\n", i % 20, i / 20, i % scans)).collect();
        let head = "x,y,z,point_source_id,red,green,blue\n".to_owned();
        let scan = folder.write("scan.csv", &(head + &rows));
        let more = ["--even-exposure", "--colour", if scans == 1 { "rgb" } else { "elevation" }];
        let said = render(&scan, &out, &more);
        let last = said.worked().stdout.lines().last().unwrap_or_default();
        assert!(last.starts_with("note: exposure compensation: ") && last.contains(note), "{last}");
        let report = render(&scan, &out, &["--json", "--even-exposure", "--colour", "rgb"]).json();
        assert_eq!(report["notes"].as_array().unwrap().len(), usize::from(scans == 1), "{report}");
        let words = ["render", "--explain", "--json", "--even-exposure", "--colour", "rgb"];
        let words = words.map(OsStr::new).into_iter().chain([scan.as_os_str()]);
        let passes = esker(words).json()["passes"].as_array().unwrap().clone();
        assert_eq!(passes.contains(&"exposure".into()), scans == 2, "{passes:?}");
    }
}

fn sources_are_in_the_legend() {
    let folder = Folder::new();
    let out = folder.file("p.png");
    for sources in [[3, 7, 5], [1, 300, 40_000]] {
        let rows: String =
            (0..300).map(|i| format!("{},{},0,{}\n", i % 20, i / 20, sources[i % 3])).collect();
        let scan = folder.write("scan.csv", &("x,y,z,point_source_id\n".to_owned() + &rows));
        let report = render(&scan, &out, &["--json", "--colour", "source"]).json();
        let entries = report["colour"]["entries"].as_array().unwrap();
        let mut values: Vec<_> = entries.iter().map(|e| e["value"].as_i64().unwrap()).collect();
        values.sort_unstable();
        let mut wanted = sources.map(i64::from);
        wanted.sort_unstable();
        assert_eq!(values, wanted, "{report}");
        assert!(report["colour"]["note"].is_null(), "{report}");
    }
}

fn scans_are_named() {
    let folder = Folder::new();
    let scan = folder.write("three.xyz", "0 0 0\n1 2 3\n4 5 6\n");
    let out = folder.file("p.png");
    for more in [["--colour", "rgb"], ["--colour", "nonsense"], ["--classes", "2"]] {
        let outcome = render(&scan, &out, &more);
        assert!(outcome.error().contains("three.xyz: has no "), "{}", outcome.stderr);
    }
    let outcome = render(&scan, &out, &["--colour", "rgb", scan.to_str().unwrap()]);
    assert!(outcome.error().contains("three.xyz and 1 more: has no "), "{}", outcome.stderr);
}
