//! Hostile clouds and machines. Whatever the shape of a cloud, a build keeps within its memory
//! under a limit that the system enforces (`RLIMIT_DATA`); it works with more inputs than may be
//! open, and leaves no file on a full disk. Wrong or contradictory inputs are reported.

use crate::export::export;
use crate::folder::Folder;
use crate::las;
use crate::program::{build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub fn trials(trials: &mut Vec<Trial>) {
    #[cfg(unix)]
    unix::trials(trials);
    trials.push(trial("hostile: wrong counts are reported with the true one", counts));
    trials.push(trial("hostile: inputs of two reference systems are refused by name", systems));
    trials.push(trial("hostile: GPS times of different epochs are reported", gps_times));
}

/// Random number from 0 to `n - 1` for each `seed` (splitmix64).
fn below(seed: u64, n: u32) -> i32 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((((z ^ (z >> 31)) >> 32) * u64::from(n)) >> 32) as i32
}

fn scattered(i: u64) -> [i32; 3] {
    [0, 1, 2].map(|axis| below(3 * i + axis, 1_000_000))
}

fn counts() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    for (name, is_compressed) in [("a.las", false), ("a.laz", true)] {
        let scan = folder.file(name);
        las::write(&scan, "", is_compressed, 10_000, scattered);
        for claimed in [0, 1, 9_999, 10_001, 4_000_000_000_000] {
            las::claim(&scan, claimed);
            let report = build(&[&scan], &out, &[]);
            assert_eq!(report["points_out"], 10_000, "{name}, {claimed} claimed");
            let notes = report["notes"].to_string();
            assert!(notes.contains("10000") && notes.contains(&claimed.to_string()), "{notes}");
            assert_eq!(verify(&out, &[&scan]).json()["points"], 10_000);
        }
    }
}

fn systems() {
    let folder = Folder::new();
    let [a, b] = [("a.las", "Lambert"), ("b.las", "Mercator")].map(|(name, system)| {
        let scan = folder.file(name);
        las::write(&scan, &format!("PROJCS[\"{system}\"]"), false, 100, scattered);
        scan
    });
    let out = folder.file("out.esker");
    let words = ["build".as_ref(), a.as_os_str(), b.as_os_str(), "-o".as_ref(), out.as_os_str()];
    let outcome = esker(words);
    let error = outcome.error();
    for word in ["a.las", "b.las", "`Lambert`", "`Mercator`", "--ignore-crs"] {
        assert!(error.contains(word), "{error}");
    }
    assert_eq!(folder.names(), ["a.las", "b.las"]);
    let report = build(&[&a, &b], &out, &["--ignore-crs"]);
    assert_eq!(report["points_out"], 200);
    assert!(report["notes"].to_string().contains("different coordinate"), "{report}");
    verify(&out, &[&a, &b]).json();
}

fn gps_times() {
    let folder = Folder::new();
    let [week, adjusted] = ["a-week.las", "b-adjusted.las"].map(|name| {
        let scan = folder.file(name);
        las::write(&scan, "", false, 100, scattered);
        scan
    });
    las::count_from_week(&week);
    let (both, out) = (folder.file("both.esker"), folder.file("out.las"));
    let has_note = |report: &Value, words: &[&str]| {
        let notes = report["notes"].to_string();
        assert!(words.iter().all(|word| notes.contains(word)), "{notes}");
    };
    let report = build(&[&week, &adjusted], &both, &[]);
    has_note(
        &report,
        &["a-week.las and", "b-adjusted.las count GPS times from different beginnings"],
    );
    let info = esker(["info".as_ref(), both.as_os_str(), "--json".as_ref()]).json();
    let times = [0, 1].map(|i| info["sources"][i]["gps_times"].as_str().unwrap());
    assert_eq!(times, ["week", "adjusted standard"]);
    // Global encodings: WKT; the second scan also has adjusted times.
    let encoding = |path: &Path| std::fs::read(path).unwrap()[6..8].to_vec();
    let report = export(&both, &out, &[]).json();
    has_note(&report, &["GPS times of 1 sources", "which the global encoding gives (week)"]);
    assert_eq!(encoding(&out), [16, 0]);
    // Each scan alone is exported with its own encoding.
    for (scan, bits) in [(&week, 16), (&adjusted, 17)] {
        let file = folder.file("one.esker");
        let report = build(&[scan], &file, &[]);
        let unit_of = |scan: &PathBuf| {
            format!("{}: the unit of length is not stated; --unit sets it", scan.display())
        };
        assert_eq!(report["notes"], json!([unit_of(scan)]));
        assert_eq!(export(&file, &out, &[]).json()["notes"], json!([]));
        assert_eq!((encoding(&out), encoding(scan)), (vec![bits, 0], vec![bits, 0]));
        let more = folder.file("more.esker");
        let appended = ["append", "--json", "--progress", "none", "-o"].map(PathBuf::from);
        let words = appended.into_iter().chain([more, file, adjusted.clone()]);
        let report = esker(words).json();
        match bits {
            16 => has_note(&report, &["a-week.las and", "b-adjusted.las count GPS times"]),
            _ => assert_eq!(report["notes"], json!([unit_of(&adjusted)])),
        }
    }
}

#[cfg(unix)]
mod unix {
    use super::*;
    use crate::program::{Outcome, empty_kib, esker_under, esker_within};

    /// Number of points whose rows exceed the least memory.
    const POINTS: u64 = 2_000_000;
    /// The least `--memory`.
    const MEMORY_KIB: u64 = 256 << 10;

    type Position = fn(u64) -> [i32; 3];

    const CLOUDS: [(&str, Position); 5] = [
        ("one place", |_| [77, -5, 9]),
        ("a volume", scattered),
        ("all of the lattice", anywhere),
        ("two places, and points far apart", |i| match i % 3 {
            0 => [i32::MIN; 3],
            1 => [i32::MAX; 3],
            _ => [below(i, 1000), i32::MIN + (i >> 3) as i32, 0],
        }),
        ("a plane of pairs and one far point", |i| match i {
            0 => [i32::MAX, 3, i32::MIN],
            _ => [(i / 2 % 1000) as i32, (i / 2000) as i32, 0],
        }),
    ];

    fn anywhere(i: u64) -> [i32; 3] {
        [0, 1, 2].map(|axis| below(3 * i + axis, u32::MAX).wrapping_mul(2))
    }

    pub fn trials(trials: &mut Vec<Trial>) {
        for (name, position) in CLOUDS {
            let name = format!("hostile: {name} within its memory");
            trials.push(trial(&name, move || {
                keeps_within(false, POINTS, position);
            }));
        }
        let name = "hostile: one chunk of all points within its memory";
        trials.push(trial(name, || {
            keeps_within(true, POINTS, scattered);
        }));
        let name = "hostile: one chunk of a third of its memory within it";
        trials.push(trial(name, || {
            let bytes = keeps_within(true, 7 * POINTS / 2, anywhere);
            assert!(bytes > (MEMORY_KIB << 10) / 3, "the chunk has only {bytes} bytes");
        }));
        trials.push(trial("hostile: more inputs than may be open", many_inputs));
        trials.push(trial("hostile: a full disk leaves nothing behind", full_disk));
        trials.push(trial("hostile: planted links are not written through", planted_links));
        trials.push(trial("hostile: pictures over a limit are refused before work", large_picture));
    }

    fn words(scans: &[PathBuf], out: &Path, scratch: &Path) -> Vec<PathBuf> {
        let memory = format!("{MEMORY_KIB}KiB");
        let mut words: Vec<PathBuf> = vec!["build".into()];
        words.extend(scans.iter().cloned());
        let more = ["--memory", &memory, "--json", "--progress", "none", "-o"];
        words.extend(more.map(PathBuf::from));
        words.extend([out.to_owned(), "--scratch".into(), scratch.to_owned()]);
        words
    }

    /// Builds `points` points within the least memory. Returns the bytes of the file.
    fn keeps_within(is_compressed: bool, points: u64, position: Position) -> u64 {
        let folder = Folder::new();
        let (scan, out) = (folder.file("scan"), folder.file("out.esker"));
        las::write(&scan, "", is_compressed, points, position);
        let limit_kib = empty_kib() + MEMORY_KIB + MEMORY_KIB / 20;
        let words = words(std::slice::from_ref(&scan), &out, &folder.file(""));
        let report = esker_within(limit_kib, 300, words).json();
        assert_eq!(report["points_out"], points, "{report}");
        let peak = report["peak_anon_bytes"].as_u64().unwrap();
        assert!(peak <= (MEMORY_KIB + MEMORY_KIB / 20) << 10, "{peak} bytes at the peak");
        let verified = verify(&out, &[&scan]).json();
        assert_eq!((&verified["points"], &verified["ok"]), (&points.into(), &true.into()));
        assert_eq!(folder.names(), ["out.esker", "scan"], "nothing else is left");
        scan.metadata().unwrap().len()
    }

    /// Links under the hidden names that outputs have until they are finished.
    fn planted_links() {
        let folder = Folder::new();
        let (scan, file) = (folder.write("scan.xyz", "1 2 3\n4 5 6\n"), folder.file("a.esker"));
        build(&[&scan], &file, &[]);
        let victim = folder.write("victim", "precious");
        let file = file.to_str().unwrap();
        let scan = scan.to_str().unwrap();
        for (hidden, out, words) in [
            (".b.esker.partial", "b.esker", ["build", scan].as_slice()),
            (".b.esker.journal", "b.esker", &["build", scan]),
            (".c.esker.partial", "c.esker", &["append", file, scan]),
            (".d.esker.partial", "d.esker", &["build", "--merge", file]),
            (".e.ply.partial", "e.ply", &["export", file]),
            (".e.laz.partial", "e.laz", &["export", file]),
        ] {
            let (planted, out) = (folder.file(hidden), folder.file(out));
            std::os::unix::fs::symlink(&victim, &planted).unwrap();
            let words = words.iter().copied().chain(["-o", out.to_str().unwrap()]);
            let outcome = esker(words);
            assert!(outcome.error().contains("is a link"), "{hidden}: {}", outcome.stderr);
            assert_eq!(std::fs::read_to_string(&victim).unwrap(), "precious", "{hidden}");
            assert!(!out.exists(), "{hidden}");
            std::fs::remove_file(planted).unwrap();
        }
    }

    fn large_picture() {
        let folder = Folder::new();
        let (scan, png) = (folder.write("scan.xyz", "1 2 3\n4 5 6\n"), folder.file("p.png"));
        let words = ["render".as_ref(), scan.as_os_str(), "-o".as_ref(), png.as_os_str()];
        let words = words.into_iter().chain(["--size".as_ref(), "8192x8192".as_ref()]);
        let outcome =
            esker_under("ulimit -d 4000000", words.map(PathBuf::from).collect::<Vec<_>>());
        let error = outcome.error();
        assert!(error.contains("8192x8192 pixels") && error.contains("are granted"), "{error}");
        assert_eq!(folder.names(), ["scan.xyz"]);
    }

    fn many_inputs() {
        let folder = Folder::new();
        let scans: Vec<_> = (0..300).map(|i| folder.file(&format!("{i}.laz"))).collect();
        for (i, scan) in scans.iter().enumerate() {
            las::write(scan, "", true, 50, |j| scattered(50 * i as u64 + j));
        }
        let out = folder.file("out.esker");
        let report = esker_under("ulimit -n 64", words(&scans, &out, &folder.file(""))).json();
        assert_eq!(report["points_out"], 15_000, "{report}");
        let mut words = ["verify".into(), out, "--json".into(), "--against".into()].to_vec();
        words.extend(scans);
        assert_eq!(esker_under("ulimit -n 64", words).json()["points"], 15_000);
    }

    /// Simulates a full disk by a limit on the size of files: the write that exceeds it fails.
    fn full_disk() {
        let folder = Folder::new();
        let (scan, out) = (folder.file("scan"), folder.file("out.esker"));
        let scratch = folder.file("scratch");
        std::fs::create_dir(&scratch).unwrap();
        let fails = |kib: u64| -> Outcome {
            // The limit counts blocks of 512 bytes; without the trap a signal would end the
            // program.
            let limit = format!("trap '' XFSZ && ulimit -f {}", kib * 2);
            let outcome = esker_under(&limit, words(std::slice::from_ref(&scan), &out, &scratch));
            outcome.error();
            assert!(!out.exists(), "after {kib} KiB");
            outcome
        };
        let is_clean = |names: &[&str], kib| {
            assert_eq!(folder.names(), names, "after {kib} KiB");
            let left = std::fs::read_dir(&scratch).unwrap().count();
            assert_eq!(left, 0, "scratch is left after {kib} KiB");
        };
        // Only the output file is on the disk; limits from its first page to its footer. Printed
        // text goes to files too.
        las::write(&scan, "", false, 100_000, scattered);
        let bytes = build(&[&scan], &out, &[])["bytes_out"].as_u64().unwrap();
        std::fs::remove_file(&out).unwrap();
        for kib in [16, bytes >> 12, bytes >> 11, (bytes >> 10) - 1] {
            let outcome = fails(kib);
            assert!(outcome.error().contains("out.esker"), "{}", outcome.stderr);
            is_clean(&["scan", "scratch"], kib);
        }
        // Scratch exceeds the limit first; the next build deletes the scratch that is kept.
        las::write(&scan, "", false, POINTS, scattered);
        let outcome = fails(10 << 10);
        let error = outcome.error();
        assert!(error.contains("scratch") && error.contains("free space"), "{error}");
        esker(words(&[scan], &out, &scratch)).json();
        is_clean(&["out.esker", "scan", "scratch"], 0);
    }
}
