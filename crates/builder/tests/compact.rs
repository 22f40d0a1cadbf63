//! Compact planes: the palette is a function of the points alone, whatever the threads, the memory
//! and the interruptions; appended scans share the palette of the old file; scans without colours
//! have none.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod given;

use esker_builder::{
    BuildError, Options, Resume, Shares, append_sources, build_shared, build_sources, merge,
};
use esker_format::{EskerFile, Forest, PlaneKind, verify};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth, Task};
use given::{Given, boxed, given, whole_by};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

fn below(i: u64, n: u64) -> u64 {
    let mixed = |x: u64, by| (x ^ (x >> 29)).wrapping_mul(by);
    let x = mixed(i.wrapping_mul(0x9e37_79b9_7f4a_7c15), 0xbf58_476d_1ce4_e5b9);
    (mixed(x, 0x94d0_49bb_1331_11eb) >> 33) % n
}

/// Hills of many colours in two inputs, of 16 bits (in the high byte, which the first points hide)
/// and of 8 bits; and one input without colours.
fn coloured() -> Vec<Given> {
    let hills = |from: u64, n: u64| {
        let at = move |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), below(i, 300)];
        (from..from + n).map(move |i| at(i).map(|c| c as i32)).collect::<Vec<_>>()
    };
    let wide = |k: u64| move |i: u64| below(i * 3 + k, 200) << 8;
    let narrow = |k: u64| move |i: u64| below(i * 3 + k, 90);
    let a = given("a", [0.001; 3], hills(0, 30_000))
        .with("red", AttrType::U16, wide(0))
        .with("green", AttrType::U16, wide(1))
        .with("blue", AttrType::U16, wide(2))
        .coloured(ColourDepth::Eight);
    let b = given("b", [0.001; 3], hills(30_000, 20_000))
        .with("red", AttrType::U8, narrow(0))
        .with("green", AttrType::U8, narrow(1))
        .with("blue", AttrType::U8, narrow(2));
    vec![a, b, plain()]
}

fn plain() -> Given {
    let at = |i: u64| [below(i, 50_000) as i32, 7, 7];
    given("c", [0.001; 3], (0..5000).map(at).collect()).with("intensity", AttrType::U16, |i| i)
}

fn options() -> Options {
    Options { node_capacity: 512, compact: true, ..Options::default() }
}

const LITTLE: Shares = Shares { buffer_bytes_max: 200_000, chunk_bytes_max: 300_000 };

fn bytes_of(sources: &[Given], shares: Shares, threads: usize) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| build_shared(boxed(sources), &out, &options(), shares, &Silent)).unwrap();
    std::fs::read(out).unwrap()
}

#[test]
fn threads_and_the_order_of_inputs_write_the_same_bytes() {
    let mut sources = coloured();
    let one = bytes_of(&sources, LITTLE, 1);
    assert!(one == bytes_of(&sources, LITTLE, 3));
    sources.reverse();
    assert!(one == bytes_of(&sources, LITTLE, 2));
}

#[test]
fn the_palette_is_the_same_under_another_memory_bound_and_near_its_colours() {
    let sources = coloured();
    let built = [Shares::of(1 << 30), LITTLE].map(|shares| {
        whole_by(&sources, |out: &Path| {
            build_shared(boxed(&sources), out, &options(), shares, &Silent).unwrap()
        })
    });
    let [(ample, a), (little, b)] = &built;
    assert!(ample.scratch_bytes == 0 && little.scratch_bytes > 0);
    assert!(a.metadata().palette.is_some());
    assert_eq!(a.metadata().palette, b.metadata().palette);
    assert_eq!(ample.palette_misfit, little.palette_misfit);
    // Colours fill a cube of 200 steps a side and one of 90: 255 cells of it have edges of some 32
    // steps.
    let misfit = ample.palette_misfit.unwrap();
    assert!(misfit.mean > 5.0 && misfit.mean < 18.0 && misfit.worst < 64.0, "{misfit:?}");
    assert!(misfit.mean < misfit.most && misfit.most <= misfit.worst, "{misfit:?}");
}

/// Cancels the task after `after` checks; keeps its notes.
#[derive(Default)]
struct Stops {
    checks: AtomicU64,
    after: u64,
    notes: Mutex<String>,
}

impl Task for Stops {
    fn is_cancelled(&self) -> bool {
        self.checks.fetch_add(1, Relaxed) >= self.after
    }

    fn note(&self, line: &str) {
        self.notes.lock().unwrap().push_str(line);
    }
}

#[test]
fn a_resumed_build_has_the_same_palette() {
    let sources = coloured();
    let expected = bytes_of(&sources, LITTLE, 2);
    let mut kept = 0;
    for after in (40..400).step_by(40) {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let out = folders[0].path().join("out.esker");
        let run = |resume, after| {
            let task = Stops { after, ..Stops::default() };
            let scratch = Some(folders[1].path().into());
            let options = Options { resume, scratch, ..options() };
            build_shared(boxed(&sources), &out, &options, LITTLE, &task)
        };
        let cut = run(Resume::Later, after);
        kept += u32::from(matches!(cut, Err(BuildError::Kept(_))));
        let report = cut.or_else(|_| run(Resume::Now, u64::MAX)).unwrap();
        assert!(std::fs::read(&out).unwrap() == expected, "other bytes after {after} checks");
        assert!(report.palette_misfit.is_some_and(|m| m.mean > 5.0), "{report:?}");
    }
    assert!(kept > 3, "{kept} builds were cut short");
}

#[test]
fn without_colours_there_is_no_compact_plane() {
    let black = |given: Given| {
        ["red", "green", "blue"].iter().fold(given, |g, name| g.with(name, AttrType::U8, |_| 0))
    };
    for source in [plain(), black(plain())] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out.esker");
        let task = Stops { after: u64::MAX, ..Stops::default() };
        let report = build_sources(vec![source.boxed()], &out, &options(), &task).unwrap();
        let file = EskerFile::open(&out).unwrap();
        assert!(!file.layout().has(PlaneKind::Compact) && report.palette_misfit.is_none());
        assert!(task.notes.lock().unwrap().contains("no colours"));
        verify(&file, &Silent).unwrap();
    }
}

#[test]
fn appending_keeps_the_palette_and_merging_trains_a_new_one() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a.esker", "b.esker", "c.esker"].map(|name| folder.path().join(name));
    let sources = coloured();
    build_sources(boxed(&sources[..1]), &a, &options(), &Silent).unwrap();
    let forest = |path| Forest::open(path).unwrap();
    let old = forest(&a);
    let report = append_sources(&old, boxed(&sources[1..2]), &b, &options(), &Silent).unwrap();
    assert!(report.palette_misfit.is_some());
    let both = forest(&b);
    assert_eq!(both.palette(), old.palette());
    assert!(both.palette().is_some());
    both.files().for_each(|file| assert!(verify(file, &Silent).is_ok()));
    // If one tree has no compact plane, the forest has no palette.
    let bare = Options { compact: false, ..options() };
    append_sources(&old, boxed(&sources[1..2]), &c, &bare, &Silent).unwrap();
    assert_eq!(forest(&c).palette(), None);
    let merged = folder.path().join("merged.esker");
    merge(std::slice::from_ref(&b), &merged, &options(), &Silent).unwrap();
    let merged = forest(&merged);
    assert!(merged.palette().is_some() && merged.palette() != old.palette());
}
