//! An interrupted build resumes where it was, and the file is the same to the byte; or the error
//! says why it cannot.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod given;

use esker_builder::{BuildError, NormalsMode, Options, Resume, Shares, build, build_shared};
use esker_points::{AttrType, ColourDepth, Task};
use given::{Given, boxed, given, names_in};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

const LITTLE: Shares = Shares { buffer_bytes_max: 150_000, chunk_bytes_max: 300_000 };
/// Rows fit into memory, chunks do not.
const NO_SCRATCH: Shares = Shares { buffer_bytes_max: 1 << 30, ..LITTLE };

fn below(i: u64, n: u64) -> i32 {
    ((i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33) % n) as i32
}

/// Hills in two inputs of different attributes, stacks larger than a chunk, and a distant point.
fn sources() -> Vec<Given> {
    let hill = |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), below(i, 300)];
    let a = (0..45_000).map(|i| if i % 3 == 0 { [7; 3] } else { hill(i) });
    let b = (0..35_000u64).map(|i| if i == 0 { [2_000_000_000; 3] } else { hill(i + 100_000) });
    let b = given("b", [0.001; 3], b.collect()).with("intensity", AttrType::U16, |i| i);
    let c = given("c", [0.001; 3], vec![[5; 3]; 10]).with("user_data", AttrType::U8, |i| i);
    vec![given("a", [0.001; 3], a.collect()).with("user_data", AttrType::U8, |i| i), b, c]
}

fn options(resume: Resume) -> Options {
    Options { node_capacity: 256, resume, ..Default::default() }
}

/// Cancels the task after `after` checks; keeps its notes.
#[derive(Default)]
struct Stops {
    checks: AtomicU64,
    after: u64,
    notes: Mutex<Vec<String>>,
}

impl Stops {
    fn after(after: u64) -> Self {
        Self { after, ..Self::default() }
    }
}

impl Task for Stops {
    fn is_cancelled(&self) -> bool {
        self.checks.fetch_add(1, Ordering::Relaxed) >= self.after
    }

    fn note(&self, line: &str) {
        self.notes.lock().unwrap().push(line.into());
    }
}

/// A folder for the output and one for scratch.
struct Workspace {
    out: tempfile::TempDir,
    scratch: tempfile::TempDir,
    normals: NormalsMode,
}

impl Workspace {
    fn new() -> Self {
        Self::with(NormalsMode::Keep)
    }

    fn with(normals: NormalsMode) -> Self {
        let [out, scratch] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        Self { out, scratch, normals }
    }

    fn out(&self) -> PathBuf {
        self.out.path().join("out.esker")
    }

    fn journal(&self) -> PathBuf {
        self.out.path().join(".out.esker.journal")
    }

    /// Builds, and cancels after `after` checks. Returns the outcome and the number of checks.
    fn run(&self, sources: &[Given], resume: Resume, shares: Shares, after: u64) -> (Outcome, u64) {
        let scratch = Some(self.scratch.path().into());
        let options = Options { scratch, normals: self.normals, ..options(resume) };
        let task = Stops::after(after);
        let result = build_shared(boxed(sources), &self.out(), &options, shares, &task);
        let outcome = match result {
            Ok(_) => Outcome::Done,
            Err(BuildError::Kept(error)) => {
                assert!(matches!(*error, BuildError::Cancelled(_)), "{error}");
                Outcome::Kept
            }
            Err(BuildError::Cancelled(_)) => Outcome::Nothing,
            Err(other) => Outcome::Refused(other.to_string()),
        };
        (outcome, task.checks.into_inner())
    }

    /// Asserts that only the output is left, and returns its bytes.
    fn file(&self) -> Vec<u8> {
        assert_eq!(names_in(self.out.path()), ["out.esker"]);
        assert_eq!(names_in(self.scratch.path()), [""; 0]);
        std::fs::read(self.out()).unwrap()
    }
}

#[derive(Debug, PartialEq)]
enum Outcome {
    Done,
    Kept,
    Nothing,
    Refused(String),
}

fn cut_and_resumed(sources: &[Given], shares: Shares, cuts: u64) -> u64 {
    cut_and_resumed_with(NormalsMode::Keep, sources, shares, cuts)
}

/// Builds, interrupted at `cuts` moments, and resumes. Returns how many of the builds had kept
/// something.
fn cut_and_resumed_with(normals: NormalsMode, sources: &[Given], shares: Shares, cuts: u64) -> u64 {
    let workspace = Workspace::with(normals);
    let (outcome, checks) = workspace.run(sources, Resume::Never, shares, u64::MAX);
    assert_eq!(outcome, Outcome::Done);
    let whole = workspace.file();
    let mut kept = 0;
    for cut in 0..cuts {
        let workspace = Workspace::with(normals);
        let after = cut * (checks - 1) / (cuts - 1);
        let (outcome, _) = workspace.run(sources, Resume::Later, shares, after);
        assert!(!workspace.out().exists());
        match outcome {
            Outcome::Kept => kept += 1,
            Outcome::Nothing => assert_eq!(names_in(workspace.out.path()), [""; 0]),
            other => panic!("{after} of {checks}: {other:?}"),
        }
        // Interrupts the rest again, then resumes to the end.
        workspace.run(sources, Resume::Now, shares, (checks - after) / 2);
        let (outcome, _) = workspace.run(sources, Resume::Now, shares, u64::MAX);
        assert_eq!(outcome, Outcome::Done, "{after} of {checks}");
        assert!(workspace.file() == whole, "other bytes after a cut at {after} of {checks}");
    }
    kept
}

#[test]
fn a_build_interrupted_anywhere_resumes_to_the_same_bytes() {
    let kept = cut_and_resumed(&sources(), LITTLE, 32);
    assert!(kept > 20, "{kept} were kept");
}

#[test]
fn a_cell_that_was_parted_halfway_is_resumed_there() {
    let point = |i: u64| [below(3 * i, 900), below(3 * i + 1, 900), below(3 * i + 2, 900)];
    let far = (0..300_000u64).map(point).chain([[i32::MAX; 3]]).collect();
    let sources = [given("far", [0.001; 3], far)];
    let shares = Shares { chunk_bytes_max: 4_000_000, ..LITTLE };
    let workspace = Workspace::new();
    // One thread parts one block of five between two checks.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        workspace.run(&sources, Resume::Never, shares, u64::MAX);
        let whole = workspace.file();
        // Reading ends before this range, sampling begins after it.
        for after in 8..20 {
            let workspace = Workspace::new();
            let (outcome, _) = workspace.run(&sources, Resume::Later, shares, after);
            assert_eq!(outcome, Outcome::Kept, "cut at {after}");
            let (outcome, _) = workspace.run(&sources, Resume::Now, shares, u64::MAX);
            assert_eq!(outcome, Outcome::Done, "cut at {after}");
            assert!(workspace.file() == whole, "other bytes after a cut at {after}");
        }
    });
}

#[test]
fn estimated_normals_of_a_resumed_build_are_the_same() {
    for shares in [LITTLE, NO_SCRATCH] {
        assert!(cut_and_resumed_with(NormalsMode::Estimate, &sources(), shares, 6) > 2);
        assert!(cut_and_resumed_with(NormalsMode::Fast, &sources(), shares, 6) > 2);
    }
}

#[test]
fn wrong_headers_are_not_measured_again_after_a_resume() {
    // Wrong bounds, and colours that turn out to have another depth.
    let mut sources = sources();
    sources[1] = sources[1].clone().claiming(Some([[0.0; 3], [1.0; 3]]));
    let colours =
        given("d", [0.001; 3], vec![[9; 3]; 15_000]).with("red", AttrType::U16, |i| i % 256);
    sources.push(colours.coloured(ColourDepth::Sixteen));
    assert!(cut_and_resumed(&sources, LITTLE, 12) > 5);
}

#[test]
fn finished_chunks_are_kept_also_where_all_rows_are_in_memory() {
    assert!(cut_and_resumed(&sources(), NO_SCRATCH, 12) > 4);
    // Few chunks are not worth a journal.
    assert_eq!(cut_and_resumed(&sources()[2..], NO_SCRATCH, 3), 0);
}

/// A build interrupted in the middle.
fn cut() -> (Workspace, Vec<u8>) {
    let workspace = Workspace::new();
    let (_, checks) = workspace.run(&sources(), Resume::Later, LITTLE, u64::MAX);
    let whole = workspace.file();
    std::fs::remove_file(workspace.out()).unwrap();
    let (outcome, _) = workspace.run(&sources(), Resume::Later, LITTLE, checks * 3 / 4);
    assert_eq!(outcome, Outcome::Kept);
    (workspace, whole)
}

#[test]
fn finished_work_is_not_repeated() {
    let workspace = Workspace::new();
    let (_, checks) = workspace.run(&sources(), Resume::Later, LITTLE, u64::MAX);
    std::fs::remove_file(workspace.out()).unwrap();
    workspace.run(&sources(), Resume::Later, LITTLE, checks * 9 / 10);
    let (outcome, left) = workspace.run(&sources(), Resume::Now, LITTLE, u64::MAX);
    assert_eq!(outcome, Outcome::Done);
    assert!(left < checks / 2, "{left} of {checks}");
}

#[test]
fn starting_over_an_interrupted_build_is_noted() {
    let (_, checks) = Workspace::new().run(&sources(), Resume::Never, LITTLE, u64::MAX);
    let (workspace, whole) = cut();
    let run = |change: fn(&mut Options), resume, after| {
        let scratch = Some(workspace.scratch.path().to_path_buf());
        let mut options = Options { scratch, ..options(resume) };
        change(&mut options);
        let task = Stops::after(after);
        let result = build_shared(boxed(&sources()), &workspace.out(), &options, LITTLE, &task);
        (result, task.notes.into_inner().unwrap())
    };
    // With other options, interrupted again: from then on that build is resumed, not the one
    // before.
    let small = |options: &mut Options| options.compress = esker_format::Codec::Small;
    let (result, notes) = run(small, Resume::Later, checks / 2);
    assert!(matches!(result, Err(BuildError::Kept(_))), "{result:?}");
    assert!(notes[0].contains("out.esker: an earlier build of it was cut"), "{notes:?}");
    assert!(notes[0].contains("--compress was fast, and is small"), "{notes:?}");
    let (result, _) = run(|_| (), Resume::Now, u64::MAX);
    assert!(result.unwrap_err().to_string().contains("--compress was small, and is fast"));
    let (result, notes) = run(small, Resume::Now, u64::MAX);
    result.unwrap();
    assert_eq!(notes, [""; 0]);
    let of_small = workspace.file();
    assert!(of_small.len() < whole.len());
    // With the same options: there was something to resume.
    let (workspace, _) = cut();
    let options =
        Options { scratch: Some(workspace.scratch.path().into()), ..options(Resume::Later) };
    let task = Stops::after(u64::MAX);
    build_shared(boxed(&sources()), &workspace.out(), &options, LITTLE, &task).unwrap();
    let notes = task.notes.into_inner().unwrap();
    assert!(notes[0].contains("--resume would have gone on"), "{notes:?}");
    assert!(workspace.file() == whole);
    // Over a finished file nothing is noted.
    let task = Stops::after(u64::MAX);
    build_shared(boxed(&sources()), &workspace.out(), &options, LITTLE, &task).unwrap();
    assert_eq!(task.notes.into_inner().unwrap(), [""; 0]);
}

#[test]
fn changed_options_and_inputs_are_named() {
    let (workspace, whole) = cut();
    let scratch = Some(workspace.scratch.path().to_path_buf());
    let with = |sources: &[Given], options: Options, shares| {
        let options = Options { scratch: scratch.clone(), ..options };
        let task = Stops::after(u64::MAX);
        build_shared(boxed(sources), &workspace.out(), &options, shares, &task)
    };
    let refused = |sources: &[Given], options: Options, shares, words: &[&str]| {
        let error = with(sources, options, shares).unwrap_err();
        assert!(matches!(error, BuildError::Resume { .. }), "{error}");
        let error = error.to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
        assert!(error.contains("without --resume"), "{error}");
    };
    let now = || options(Resume::Now);
    let capacity = Options { node_capacity: 512, ..now() };
    refused(&sources(), capacity, LITTLE, &["--node-capacity was 256", "is 512"]);
    let codec = Options { compress: esker_format::Codec::Small, ..now() };
    refused(&sources(), codec, LITTLE, &["--compress was fast", "is small"]);
    let depth = Options { colour_depth: Some(ColourDepth::Eight), ..now() };
    refused(&sources(), depth, LITTLE, &["--colour-bits was detected", "eight"]);
    let crs = Options { ignore_crs: true, ..now() };
    refused(&sources(), crs, LITTLE, &["--ignore-crs"]);
    let less = Shares { chunk_bytes_max: LITTLE.chunk_bytes_max - 1, ..LITTLE };
    refused(&sources(), now(), less, &["--memory"]);
    refused(&sources()[..2], now(), LITTLE, &["the input c was given, and is not now"]);
    let mut more = sources();
    more.push(given("new", [0.001; 3], vec![[1; 3]]));
    refused(&more, now(), LITTLE, &["the input new was not given"]);
    let mut other = sources();
    other[1].info.bytes = 77;
    refused(&other, now(), LITTLE, &["the size of b was 0 bytes, and is 77 bytes"]);
    let twice = [sources(), sources()[1..2].to_vec()].concat();
    refused(&twice, now(), LITTLE, &["the input b was given 1 times, and is 2 times now"]);
    // The order of inputs and more memory do not matter, and the refused builds have done no harm.
    let more = Shares { buffer_bytes_max: 1 << 30, chunk_bytes_max: 1 << 30 };
    let reversed: Vec<_> = sources().into_iter().rev().collect();
    with(&reversed, now(), more).unwrap();
    assert!(workspace.file() == whole);
}

#[test]
fn a_changed_input_file_is_named() {
    let workspace = Workspace::new();
    let scan = workspace.out.path().join("a.xyz");
    let line = |i: u64| format!("{} {} {}\n", below(2 * i, 5000), below(2 * i + 1, 5000), i % 7);
    std::fs::write(&scan, (0..60_000).map(line).collect::<String>()).unwrap();
    let options = |resume| Options { node_capacity: 256, resume, ..Default::default() };
    let sources =
        || vec![esker_scan::open(&scan, &Default::default(), &esker_points::task::Silent).unwrap()];
    let task = Stops::after(40);
    let cut = build_shared(sources(), &workspace.out(), &options(Resume::Later), LITTLE, &task);
    assert!(matches!(cut, Err(BuildError::Kept(_))), "{cut:?}");
    let earlier = std::time::SystemTime::UNIX_EPOCH;
    std::fs::File::options().write(true).open(&scan).unwrap().set_modified(earlier).unwrap();
    let task = Stops::after(u64::MAX);
    let error = build_shared(sources(), &workspace.out(), &options(Resume::Now), LITTLE, &task);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("the time of change of") && error.contains("a.xyz was"), "{error}");
    // A build without `--resume` deletes the leftovers.
    build(std::slice::from_ref(&scan), &workspace.out(), &options(Resume::Never), &task).unwrap();
    let mut names = names_in(workspace.out.path());
    names.sort();
    assert_eq!(names, ["a.xyz", "out.esker"]);
}

#[test]
fn with_nothing_to_resume_a_build_starts_over_and_notes_it() {
    let workspace = Workspace::new();
    let task = Stops::after(u64::MAX);
    let options = options(Resume::Now);
    build_shared(boxed(&sources()), &workspace.out(), &options, LITTLE, &task).unwrap();
    workspace.file();
    assert!(task.notes.lock().unwrap()[0].contains("nothing to resume"));
}

#[test]
fn a_finished_build_whose_journal_was_left_is_built_again() {
    let (workspace, whole) = cut();
    let journal = std::fs::read(workspace.journal()).unwrap();
    assert_eq!(workspace.run(&sources(), Resume::Now, LITTLE, u64::MAX).0, Outcome::Done);
    assert!(workspace.file() == whole);
    std::fs::write(workspace.journal(), journal).unwrap();
    assert_eq!(workspace.run(&sources(), Resume::Now, LITTLE, u64::MAX).0, Outcome::Done);
    assert!(workspace.file() == whole);
}

#[test]
fn damage_is_reported_or_harmless() {
    let restore = |from: &Path, to: &Path| {
        for name in names_in(from) {
            std::fs::copy(from.join(&name), to.join(&name)).unwrap();
        }
    };
    let (workspace, whole) = cut();
    let keep = Workspace::new();
    restore(workspace.out.path(), keep.out.path());
    restore(workspace.scratch.path(), keep.scratch.path());
    let journal = std::fs::read(workspace.journal()).unwrap();
    let mut refused = 0;
    for i in 0..30 {
        let at = i * (journal.len() - 1) / 29;
        restore(keep.out.path(), workspace.out.path());
        restore(keep.scratch.path(), workspace.scratch.path());
        let damaged = if i % 2 == 0 {
            journal[..at].to_vec()
        } else {
            let mut damaged = journal.clone();
            damaged[at] ^= 0x10;
            damaged
        };
        std::fs::write(workspace.journal(), damaged).unwrap();
        match workspace.run(&sources(), Resume::Now, LITTLE, u64::MAX).0 {
            Outcome::Done => assert!(std::fs::read(workspace.out()).unwrap() == whole, "{i}"),
            Outcome::Refused(error) => {
                assert!(error.contains("cannot be resumed"), "{error}");
                refused += 1;
            }
            other => panic!("{other:?}"),
        }
        let _ = std::fs::remove_file(workspace.out());
    }
    // Rows are freed once they are built, so those whose record was lost cannot be built again.
    assert!(refused > 0);
    // Damaged pages; missing scratch files.
    restore(keep.out.path(), workspace.out.path());
    restore(keep.scratch.path(), workspace.scratch.path());
    let partial = workspace.out.path().join(".out.esker.partial");
    let mut pages = std::fs::read(&partial).unwrap();
    pages[5000] ^= 1;
    std::fs::write(&partial, pages).unwrap();
    let (outcome, _) = workspace.run(&sources(), Resume::Now, LITTLE, u64::MAX);
    assert!(matches!(&outcome, Outcome::Refused(e) if e.contains("is damaged")), "{outcome:?}");
    restore(keep.out.path(), workspace.out.path());
    for name in names_in(workspace.scratch.path()) {
        std::fs::remove_file(workspace.scratch.path().join(name)).unwrap();
    }
    let (outcome, _) = workspace.run(&sources(), Resume::Now, LITTLE, u64::MAX);
    assert!(matches!(&outcome, Outcome::Refused(e) if e.contains(".rows")), "{outcome:?}");
}

#[test]
fn two_builds_cannot_write_one_output_at_once() {
    let workspace = Workspace::new();
    let held = esker_format::FileWriter::create(&workspace.out()).unwrap();
    for resume in [Resume::Never, Resume::Now] {
        let (outcome, _) = workspace.run(&sources(), resume, LITTLE, u64::MAX);
        assert!(
            matches!(&outcome, Outcome::Refused(e) if e.contains("another build")),
            "{outcome:?}"
        );
    }
    drop(held);
    assert_eq!(workspace.run(&sources(), Resume::Never, LITTLE, u64::MAX).0, Outcome::Done);
    workspace.file();
}
