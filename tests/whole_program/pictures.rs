//! Pictures of the sample scan: the same from the scan and from its file, of any size, by any attribute; and
//! never empty.

use crate::folder::Folder;
use crate::program::{build, esker, sample};
use crate::trial;
use libtest_mimic::Trial;
use std::ffi::OsStr;
use std::path::Path;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("pictures: the scan and its file give the same", same_from_scan));
    trials.push(trial("pictures: every attribute colours them", every_attribute));
    trials.push(trial("pictures: every size and method", sizes));
    trials.push(trial("pictures: a camera that sees nothing gives a background", nothing_seen));
}

/// Draws `input`; the picture's width and height and colours, and the pixels covered.
fn picture(folder: &Folder, input: &Path, more: &[&str]) -> ([u32; 2], Vec<u8>, u64) {
    let out = folder.file("p.png");
    let words = [OsStr::new("render"), input.as_os_str(), OsStr::new("-o"), out.as_os_str()];
    let rest = ["--json", "--progress", "none"].iter().chain(more).map(OsStr::new);
    let report = esker(words.into_iter().chain(rest)).json();
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
    // The channels are drawn together.
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
    // Closed surfaces cover more than points do.
    let cover =
        |method| picture(&folder, &file, &["--budget-points", "20000", "--method", method]).2;
    assert!(cover("pull-push") > cover("points"));
}

fn nothing_seen() {
    let folder = Folder::new();
    let file = built(&folder);
    for camera in ["eye=1e7,1e7,1e9;target=1e7,1e7,2e9;up=0,1,0", "eye=1e30,0,0"] {
        let (_, _, covered) = picture(&folder, &file, &["--camera", camera]);
        assert_eq!(covered, 0, "{camera}");
    }
    let (_, _, covered) = picture(&folder, &file, &["--budget-points", "0"]);
    assert_eq!(covered, 0);
}
