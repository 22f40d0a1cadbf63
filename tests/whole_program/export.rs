//! Exports give the multiset of input points; exports of LAS give the same records to the bit, with
//! header, VLRs and EVLRs of the source. Filters keep the points that a plain reader of the scan
//! keeps.

use crate::folder::Folder;
use crate::program::{Outcome, build, esker, sample, verify};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::ffi::OsStr;
use std::path::Path;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("export: the sample comes back in every format", sample_comes_back));
    trials.push(trial("export: text and PLY come back as they were", small_files_come_back));
    trials.push(trial("export: filters keep the points that a plain reader keeps", filters));
    trials.push(trial(
        "export: a filter that keeps no point is an error and leaves no file",
        nothing_wanted,
    ));
    trials.push(trial("export: threads do not change a byte", threads));
    trials.push(trial("export: reports its fields", reports));
    trials.push(trial("export: a file without points gives a scan without points", no_points));
    trials.push(trial("export: no two columns have the same name", names_are_apart));
    trials.push(trial("export: text and PLY give scan angles in degrees", angles));
}

/// Exports `file` to `out` and returns the outcome.
pub fn export(file: &Path, out: &Path, more: &[&str]) -> Outcome {
    let words = [OsStr::new("export"), file.as_os_str(), OsStr::new("-o"), out.as_os_str()];
    let rest =
        ["--json", "--progress", "none", "--overwrite"].into_iter().chain(more.iter().copied());
    esker(words.into_iter().chain(rest.map(OsStr::new)))
}

/// Asserts that an export of a built file in the scan's own format is its only scan, apart from
/// `refused` points.
pub fn gives_back(scan: &Path, file: &Path, refused: u64) {
    let folder = Folder::new();
    let head = head_of(scan);
    let endings: &[&str] = match &head {
        h if h.starts_with(b"LASF") => &["las", "laz"],
        h if h.starts_with(b"ply") || h.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]) => &["ply"],
        // PLY has types of columns, which text has not.
        h if h.starts_with(b"ASTM") => &["ply"],
        _ if scan.extension().is_some_and(|e| e == "pcd" || e == "ptx") => &["ply"],
        _ => &["xyz", "csv"],
    };
    for ending in endings {
        let out = folder.file(&format!("out.{ending}"));
        let report = export(file, &out, &[]).json();
        assert_eq!(
            (&report["hash_equal"], &report["points_out"]),
            (&true.into(), &report["points_in"])
        );
        assert_eq!(report["bytes_out"], std::fs::metadata(&out).unwrap().len());
        if refused == 0 {
            verify(file, &[&out]).json();
        } else {
            // The scan differs by the points that were refused.
            let again = build(&[&out], &folder.file("again.esker"), &[]);
            assert_eq!(
                (&again["points_in"], &again["points_refused"]),
                (&report["points_in"], &0.into())
            );
            std::fs::remove_file(folder.file("again.esker")).unwrap();
        }
        if head.starts_with(b"LASF") {
            let (source, back) = (las::File::read(scan), las::File::read(&out));
            source.same_head(&back, scan);
            if !source.is_compressed && !back.is_compressed {
                assert!(source.sorted_records() == back.sorted_records(), "{}", scan.display());
            }
        }
    }
    assert_eq!(folder.names().len(), endings.len(), "nothing else is left");
}

/// Asserts that an export of a built file to COPC has its points, or is refused for what COPC
/// cannot hold. Point formats that COPC has come back as they were.
pub fn copc_comes_back(scan: &Path, file: &Path) {
    let folder = Folder::new();
    let out = folder.file("out.copc.laz");
    let mut outcome = export(file, &out, &[]);
    let is_refused =
        |outcome: &Outcome, why: &str| outcome.code != Some(0) && outcome.error().contains(why);
    if is_refused(&outcome, "voxels of COPC are cubes") {
        return assert!(folder.names().is_empty());
    }
    let is_own_crs = !is_refused(&outcome, "give it by --crs");
    if !is_own_crs {
        outcome = export(file, &out, &["--crs", r#"LOCAL_CS["site",UNIT["metre",1]]"#]);
    }
    let report = outcome.json();
    let verified = verify(&out, &[file]).json();
    assert_eq!(verified["points"], report["points_out"], "{}", scan.display());
    let source = las::File::read(scan);
    if is_own_crs && (6..=8).contains(&source.point_format()) {
        verify(file, &[&out]).json();
    }
}

fn head_of(path: &Path) -> Vec<u8> {
    use std::io::Read;
    let mut head = Vec::new();
    std::fs::File::open(path).unwrap().take(8).read_to_end(&mut head).unwrap();
    head
}

/// Reads as much of LAS as is needed to compare two files, after its specification.
pub mod las {
    use std::collections::BTreeMap;
    use std::path::Path;

    pub struct File {
        bytes: Vec<u8>,
        pub is_compressed: bool,
    }

    /// Head and data of a VLR or EVLR.
    type Record = (Vec<u8>, Vec<u8>);

    impl File {
        pub fn read(path: &Path) -> Self {
            let bytes = std::fs::read(path).unwrap();
            let is_compressed = bytes[104] & 0xc0 != 0;
            Self { bytes, is_compressed }
        }

        pub fn point_format(&self) -> u8 {
            self.bytes[104] & 0x3f
        }

        fn number(&self, at: usize, bytes: usize) -> usize {
            self.bytes[at..at + bytes].iter().rev().fold(0, |n, &b| n << 8 | usize::from(b))
        }

        fn float(&self, at: usize) -> f64 {
            f64::from_le_bytes(self.bytes[at..at + 8].try_into().unwrap())
        }

        fn is_1_4(&self) -> bool {
            self.bytes[25] >= 4 && self.number(94, 2) >= 375
        }

        pub fn points(&self) -> usize {
            match if self.is_1_4() { self.number(247, 8) } else { 0 } {
                0 => self.number(107, 4),
                n => n,
            }
        }

        pub fn sorted_records(&self) -> Vec<&[u8]> {
            let (start, stride) = (self.number(96, 4), self.number(105, 2));
            let mut records: Vec<&[u8]> =
                self.bytes[start..].chunks_exact(stride).take(self.points()).collect();
            records.sort_unstable();
            records
        }

        /// VLRs and EVLRs that stay valid: neither the compression of points nor indices into their
        /// order.
        fn records(&self) -> [Vec<Record>; 2] {
            let mut at = self.number(94, 2);
            let mut walk = |number: usize, start: Option<usize>, head: usize, length: usize| {
                at = start.unwrap_or(at);
                let mut found = Vec::new();
                for _ in 0..number {
                    if at + head > self.bytes.len() {
                        break;
                    }
                    let bytes = self.number(at + 20, length);
                    let Some(data) = self.bytes[at + head..].get(..bytes) else { break };
                    found.push((self.bytes[at..at + head].to_vec(), data.to_vec()));
                    at += head + bytes;
                }
                let users = [&b"laszip encoded"[..], b"copc", b"LAStools"];
                found.retain(|(h, _)| !users.iter().any(|u| h[2..].starts_with(u)));
                // Waveform packets.
                found.retain(|(h, _)| h[18..20] != [255, 255]);
                found
            };
            let before = walk(self.number(100, 4), None, 54, 2);
            let (start, number) =
                if self.is_1_4() { (self.number(235, 8), self.number(243, 4)) } else { (0, 0) };
            let behind = if number > 0 { walk(number, Some(start), 60, 8) } else { Vec::new() };
            [before, behind]
        }

        /// Asserts that `other` has all header fields of this file that do not depend on the order
        /// of points.
        pub fn same_head(&self, other: &Self, shown: &Path) {
            let shown = shown.display();
            assert_eq!(self.number(94, 2), other.number(94, 2), "{shown}: bytes of the header");
            assert_eq!(self.bytes[104] & 0x3f, other.bytes[104] & 0x3f, "{shown}: point format");
            // Source id, global encoding, GUID, version, system, program, date; record; scale and
            // offset; and the fields of newer versions behind the counts.
            for range in [4..94, 105..107, 131..179, 375..self.number(94, 2).max(375)] {
                assert_eq!(
                    self.bytes[range.clone()],
                    other.bytes[range.clone()],
                    "{shown}: {range:?}"
                );
            }
            assert_eq!(self.points(), other.points(), "{shown}");
            let [a, b] = [self.records(), other.records()];
            assert!(a == b, "{shown}: VLRs {:?}", [a, b].map(|r| r.map(|r| r.len())));
            for axis in 0..3 {
                let bound = |f: &Self, at: usize| f.float(at + 16 * axis);
                if other.points() > 0 {
                    assert!(bound(other, 187) <= bound(other, 179), "{shown}");
                }
            }
        }

        /// Asserts that the counts by return and the bounds of the header are those of the points.
        pub fn hold_counts_and_bounds(&self) {
            let records = self.sorted_records();
            let mask = if self.bytes[104] & 0x3f < 6 { 7 } else { 15 };
            let mut counts = BTreeMap::<u8, usize>::new();
            let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
            for r in &records {
                *counts.entry(r[14] & mask).or_default() += 1;
                for axis in 0..3 {
                    let raw = i32::from_le_bytes(r[4 * axis..][..4].try_into().unwrap());
                    let world =
                        f64::from(raw) * self.float(131 + 8 * axis) + self.float(155 + 8 * axis);
                    bounds[0][axis] = bounds[0][axis].min(world);
                    bounds[1][axis] = bounds[1][axis].max(world);
                }
            }
            for n in 1..=5usize {
                let told = match self.bytes[104] & 0x3f {
                    0..6 => self.number(107 + 4 * n, 4),
                    _ => self.number(247 + 8 * n, 8),
                };
                assert_eq!(told, counts.get(&(n as u8)).copied().unwrap_or(0));
            }
            assert_eq!([187, 203, 219].map(|at| self.float(at)), bounds[0]);
            assert_eq!([179, 195, 211].map(|at| self.float(at)), bounds[1]);
        }
    }
}

fn built_sample(folder: &Folder) -> std::path::PathBuf {
    let out = folder.file("built.esker");
    build(&[sample()], &out, &["--node-capacity", "8192"]);
    out
}

fn sample_comes_back() {
    let folder = Folder::new();
    let built = built_sample(&folder);
    gives_back(&sample(), &built, 0);
    copc_comes_back(&sample(), &built);
    // Another plane that is drawn does not change the points.
    let compact = folder.file("compact.esker");
    let report = build(&[sample()], &compact, &["--compact", "--tangents"]);
    assert!(report["palette_misfit"]["mean"].as_f64().is_some_and(|mean| mean < 6.0), "{report}");
    // The error of compact colours is reported.
    let bounds = &report["code_error_bounds"];
    assert!(bounds["normal_degrees"].as_f64().is_some_and(|e| e < 0.01), "{report}");
    assert!(bounds["shape"]["axis_degrees"].as_f64().is_some_and(|e| e < 1.0), "{report}");
    gives_back(&sample(), &compact, 0);
    // The points stay the same through another format.
    let las = folder.file("out.las");
    export(&built, &las, &[]).json();
    las::File::read(&las).hold_counts_and_bounds();
    let ply = folder.file("out.ply");
    export(&built, &ply, &["--colour-bits", "16"]).json();
    verify(&built, &[&ply]).json();
    // A build from the export gives the same points again.
    let again = folder.file("again.esker");
    let report = build(&[&las], &again, &["--node-capacity", "8192"]);
    assert_eq!(report["multiset_hash"], verify::<&str>(&built, &[]).json()["multiset_hash"]);
}

fn small_files_come_back() {
    let folder = Folder::new();
    let built = folder.file("built.esker");
    let ply = "ply\nformat ascii 1.0\ncomment a note\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float nx\n\
        property float ny\nproperty float nz\nproperty double my value\nend_header\n\
        0.1 -2.25 3 1 2 255 0 0.6 -0.8 nan\n1e-3 4 5 0 0 0 1 0 0 1e300\n0.1 -2.25 3 1 2 255 0 0.6 -0.8 -0.0\n";
    let csv = "x,y,z,Echo Ratio,count\n1.25,-2,3.125,-0.5,70000\n-1e3,2,0.001,1e-7,-1\n";
    for (name, text) in [
        ("a.ply", ply),
        ("a.csv", csv),
        ("a.xyz", "1 2 3\n-4.5 5.25 6\n1 2 3\n"),
        ("b.xyz", "0.000000000001 2 3 7\n0 0 0 8\n"),
        ("c.xyz", "500000.125 6000000.5 30.25 12 34 56\n500001 6000001 31 1 2 3\n"),
    ] {
        let scan = folder.write(name, text);
        build(&[&scan], &built, &[]);
        gives_back(&scan, &built, 0);
        // As LAS, coordinates are exact if its integers are those of the lattice.
        let las = folder.file("out.las");
        let report = export(&built, &las, &[]).json();
        assert_eq!(report["points_out"], report["points_in"]);
        las::File::read(&las).hold_counts_and_bounds();
    }
    build(&[folder.write("a.ply", ply)], &built, &[]);
    let out = folder.file("out.ply");
    export(&built, &out, &[]).json();
    let bytes = std::fs::read(&out).unwrap();
    let head = String::from_utf8_lossy(&bytes);
    assert!(head.contains("\ncomment a note\n") && head.contains("\nproperty double my value\n"));
}

/// The points of the sample as text, each line a point.
fn lines_of(built: &Path, folder: &Folder, more: &[&str]) -> Vec<String> {
    let out = folder.file("out.csv");
    let report = export(built, &out, more).json();
    let text = std::fs::read_to_string(&out).unwrap();
    let mut lines: Vec<String> = text.lines().skip(1).map(str::to_owned).collect();
    assert_eq!(report["points_out"], lines.len());
    lines.sort();
    lines
}

fn filters() {
    let folder = Folder::new();
    let built = built_sample(&folder);
    let all = lines_of(&built, &folder, &[]);
    let position = |line: &String| -> Vec<f64> {
        line.split(',').take(3).map(|n| n.parse().unwrap()).collect()
    };
    // A box through the middle, its faces at coordinates that points have.
    let some: Vec<Vec<f64>> = all.iter().step_by(all.len() / 9).map(position).collect();
    let (a, b) = (&some[2], &some[6]);
    let (lo, hi): (Vec<f64>, Vec<f64>) = (0..3).map(|i| (a[i].min(b[i]), a[i].max(b[i]))).unzip();
    let inside = |p: &[f64], axes: usize| (0..axes).all(|i| lo[i] <= p[i] && p[i] <= hi[i]);
    let wanted = |axes: usize| -> Vec<String> {
        all.iter().filter(|l| inside(&position(l), axes)).cloned().collect()
    };
    let bounds = |n: usize| {
        let list = |v: &[f64]| v[..n].iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        format!("{},{}", list(&lo), list(&hi))
    };
    let flat = wanted(2);
    assert!(flat.len() > 100 && flat.len() < all.len() / 2, "{}", flat.len());
    assert!(lines_of(&built, &folder, &["--box", &bounds(2)]) == flat);
    assert!(lines_of(&built, &folder, &["--box", &bounds(3)]) == wanted(3));
    // The same region as a polygon.
    let ring = format!("{0},{1} {2},{1} {2},{3} {0},{3}", lo[0], lo[1], hi[0], hi[1]);
    assert!(lines_of(&built, &folder, &["--polygon", &ring]) == flat);
    // The same region as a clip, and the rest; and a box around its middle, turned by 30 degrees.
    let corners = format!("box={},{},-1e5,{},{},1e5", lo[0], lo[1], hi[0], hi[1]);
    assert!(lines_of(&built, &folder, &["--clip", &corners]) == flat);
    let rest = lines_of(&built, &folder, &["--clip", &format!("{corners};keep=outside")]);
    let mut both = [flat.clone(), rest].concat();
    both.sort();
    assert!(both == all);
    let centre = [0, 1].map(|i| f64::midpoint(lo[i], hi[i]));
    let turned = format!("centre={},{},0;size=150,90,1e5;rotation=30", centre[0], centre[1]);
    let (sin, cos) = 30f64.to_radians().sin_cos();
    let beyond = |line: &&String| {
        let p = position(line);
        let [x, y] = [p[0] - centre[0], p[1] - centre[1]];
        ((x * cos + y * sin).abs() - 75.0).max((y * cos - x * sin).abs() - 45.0)
    };
    let clipped = lines_of(&built, &folder, &["--clip", &turned]);
    // Faces lie within a 256th of a step, of which one is a hundredth.
    let surely: Vec<_> = all.iter().filter(|line| beyond(line) < -1e-4).collect();
    assert!(surely.len() > 100 && clipped.len() >= surely.len());
    assert!(clipped.iter().all(|line| beyond(&line) < 1e-4));
    assert!(surely.iter().all(|line| clipped.binary_search(line).is_ok()));
    // Of two clips both must hold.
    let between_steps = format!("{:.2}5", centre[0]);
    let half = format!("point={between_steps},0,0;normal=1,0,0");
    let two = lines_of(&built, &folder, &["--clip", &turned, "--clip", &half]);
    let end: f64 = between_steps.parse().unwrap();
    let common: Vec<_> = clipped.iter().filter(|line| position(line)[0] < end).cloned().collect();
    assert!(two == common && two.len() < clipped.len() && two.len() > 50, "{}", two.len());
    // A sample holds points of the scan; it is even, and denser for a smaller spacing.
    let coarse = lines_of(&built, &folder, &["--max-spacing", "60"]);
    let fine = lines_of(&built, &folder, &["--max-spacing", "15"]);
    assert!(coarse.len() > 100 && coarse.len() * 8 < fine.len(), "{} {}", coarse.len(), fine.len());
    assert!(fine.len() * 4 < all.len() && fine.iter().all(|l| all.binary_search(l).is_ok()));
    // Nodes outside the filter are not read.
    let out = folder.file("out.las");
    let report = export(&built, &out, &["--box", &bounds(2)]).json();
    let n = |name: &str| report[name].as_u64().unwrap();
    assert!(n("nodes_read") < n("nodes") * 2 / 3, "{report}");
    let sampled = export(&built, &out, &["--max-spacing", "60"]).json();
    assert!(sampled["bytes_read"].as_u64().unwrap() < n("bytes_read") / 2, "{sampled} {report}");
    // Values of attributes: red is the tenth column, return numbers the eleventh.
    let value = |line: &str, column: usize| -> f64 {
        line.split(',').nth(column).unwrap().parse().unwrap()
    };
    let ranges = ["--where", "red:20000..30000", "--where", "return:..0"];
    let of_ranges = |l: &&String| (20e3..=30e3).contains(&value(l, 9)) && value(l, 10) == 0.0;
    let reds: Vec<String> = all.iter().filter(of_ranges).cloned().collect();
    assert!(reds.len() > 1000 && reds.len() < all.len() / 2, "{}", reds.len());
    assert!(lines_of(&built, &folder, &ranges) == reds);
    // Classes, in a scan that has them.
    let rows: String = (0..3000)
        .map(|i| format!("{},{},{},{}\n", i % 83, i / 83, i % 7, [2, 6, 9][i / 1000]))
        .collect();
    let scan = folder.write("classes.csv", &("x,y,z,classification\n".to_owned() + &rows));
    let classes = folder.file("classes.esker");
    build(&[scan], &classes, &["--node-capacity", "64"]);
    let buildings = lines_of(&classes, &folder, &["--classes", "building,40"]);
    assert!(buildings.len() == 1000 && buildings.iter().all(|l| l.ends_with(",6")));
    let report = export(&classes, &out, &["--classes", "6"]).json();
    assert!(report["nodes_read"].as_u64() < report["nodes"].as_u64(), "{report}");
}

fn nothing_wanted() {
    let folder = Folder::new();
    let built = built_sample(&folder);
    let out = folder.file("out.las");
    for more in [["--box", "0,0,1,1"], ["--classes", "77"], ["--polygon", "0,0 1,0 0,1"]] {
        let outcome = export(&built, &out, &more);
        assert!(outcome.error().contains("is wanted; nothing was written"), "{}", outcome.stderr);
        assert_eq!(folder.names(), ["built.esker"]);
    }
}

fn threads() {
    let folder = Folder::new();
    let built = built_sample(&folder);
    for ending in ["las", "laz", "ply", "csv"] {
        let files = ["1", "3"].map(|n| {
            let out = folder.file(&format!("out.{ending}"));
            export(&built, &out, &["--threads", n]).json();
            std::fs::read(&out).unwrap()
        });
        assert!(files[0] == files[1], "{ending}");
    }
}

fn reports() {
    let folder = Folder::new();
    let built = built_sample(&folder);
    let out = folder.file("out.laz");
    let report = export(&built, &out, &[]).json();
    for name in [
        "points_in",
        "points_out",
        "nodes",
        "nodes_read",
        "bytes_read",
        "bytes_out",
        "seconds",
        "points_per_second",
    ] {
        assert!(report[name].is_number(), "`{name}` is no number: {report}");
    }
    assert_eq!(report["format"], "LAZ 1.2, point format 2");
    assert_eq!((&report["filtered"], &report["hash_equal"]), (&false.into(), &true.into()));
    let part = export(&built, &out, &["--max-spacing", "30"]).json();
    assert_eq!((&part["filtered"], &part["hash_equal"]), (&true.into(), &Value::Null));
    let words = ["export", built.to_str().unwrap(), "-o", out.to_str().unwrap(), "--overwrite"];
    assert!(esker(words).worked().stdout.contains("proof: all points"));
}

fn no_points() {
    let folder = Folder::new();
    let scan = folder.write("none.csv", "x,y,z,intensity\n");
    let built = folder.file("built.esker");
    build(&[&scan], &built, &[]);
    for ending in ["las", "laz", "ply", "csv"] {
        let out = folder.file(&format!("out.{ending}"));
        assert_eq!(export(&built, &out, &[]).json()["points_out"], 0);
        let again = folder.file("again.esker");
        assert_eq!(build(&[&out], &again, &[])["points_out"], 0, "{ending}");
    }
}

fn names_are_apart() {
    let folder = Folder::new();
    // One input has whole numbers, one has fractions, and both tell their types; neither is the
    // intensity of LAS.
    let ply = |name: &str, ty: &str, points: &str| {
        let places = ["x", "y", "z"].map(|axis| format!("property double {axis}\n")).concat();
        let values = ["intensity", "X"].map(|value| format!("property {ty} {value}\n")).concat();
        let head = format!("ply\nformat ascii 1.0\nelement vertex 2\n{places}{values}end_header\n");
        folder.write(name, &(head + points))
    };
    let whole = ply("a.ply", "int", "1 2 3 70000 5\n4 5 7 70001 6\n");
    let parts = ply("b.ply", "double", "1 2 4 0.5 0.25\n2 5 7 0.75 0.5\n");
    let built = folder.file("built.esker");
    build(&[&whole, &parts], &built, &[]);
    for ending in ["las", "ply", "csv"] {
        let out = folder.file(&format!("out.{ending}"));
        let report = export(&built, &out, &[]).json();
        assert!(report["notes"].to_string().contains("names are taken"), "{ending}: {report}");
        let info = esker([OsStr::new("info"), out.as_os_str(), OsStr::new("--json")]).json();
        let attributes = info["attributes"].as_array().unwrap().iter();
        let names: Vec<_> = attributes.map(|a| a["name"].as_str().unwrap().to_owned()).collect();
        let mut once = names.clone();
        once.sort();
        once.dedup();
        assert_eq!(once.len(), names.len(), "{ending}: {names:?}");
        let extra = names.iter().filter(|n| n.starts_with("intensity_") || n.starts_with("X"));
        assert!(extra.count() >= 3, "{ending}: {names:?}");
        assert!(!names.contains(&"x".to_owned()), "{ending}: {names:?}");
    }
}

fn angles() {
    let folder = Folder::new();
    let built = folder.file("built.esker");
    let words = ["build", "synthetic:terrain:5000:1", "-o", built.to_str().unwrap()];
    esker(words).worked();
    let out = folder.file("out.csv");
    let report = export(&built, &out, &[]).json();
    assert!(report["notes"].to_string().contains("scan_angle"), "{report}");
    let text = std::fs::read_to_string(&out).unwrap();
    let (head, lines) = text.split_once('\n').unwrap();
    let column = head.split(',').position(|name| name == "scan_angle").unwrap();
    let angles: Vec<f64> =
        lines.lines().map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
    assert!(angles.iter().all(|a| a.abs() <= 90.0), "degrees");
    assert!(angles.iter().any(|a| a.abs() > 1.0 && a.fract() != 0.0));
}
