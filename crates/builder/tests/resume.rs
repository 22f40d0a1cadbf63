//! A build that is cut short goes on where it was, and the file is the same to the byte; or it says why not.
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
/// Rows fit memory, chunks do not.
const NO_SCRATCH: Shares = Shares { buffer_bytes_max: 1 << 30, ..LITTLE };

fn below(i: u64, n: u64) -> i32 {
    ((i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33) % n) as i32
}

/// Hills in two inputs of other attributes, stacks larger than a chunk, and a far point.
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

/// Stops after so many questions whether to stop; keeps what is noted.
#[derive(Default)]
struct Stops {
    asked: AtomicU64,
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
        self.asked.fetch_add(1, Ordering::Relaxed) >= self.after
    }

    fn note(&self, line: &str) {
        self.notes.lock().unwrap().push(line.into());
    }
}

/// A folder for the output and one for scratch.
struct Place {
    out: tempfile::TempDir,
    scratch: tempfile::TempDir,
    normals: NormalsMode,
}

impl Place {
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

    /// Builds, and stops after so many questions; how many there were.
    fn run(&self, sources: &[Given], resume: Resume, shares: Shares, after: u64) -> (Ended, u64) {
        let scratch = Some(self.scratch.path().into());
        let options = Options { scratch, normals: self.normals, ..options(resume) };
        let task = Stops::after(after);
        let result = build_shared(boxed(sources), &self.out(), &options, shares, &task);
        let ended = match result {
            Ok(_) => Ended::Done,
            Err(BuildError::Kept(error)) => {
                assert!(matches!(*error, BuildError::Cancelled(_)), "{error}");
                Ended::Kept
            }
            Err(BuildError::Cancelled(_)) => Ended::Nothing,
            Err(other) => Ended::Refused(other.to_string()),
        };
        (ended, task.asked.into_inner())
    }

    /// Holds that the file alone is there; its bytes.
    fn file(&self) -> Vec<u8> {
        assert_eq!(names_in(self.out.path()), ["out.esker"]);
        assert_eq!(names_in(self.scratch.path()), [""; 0]);
        std::fs::read(self.out()).unwrap()
    }
}

#[derive(Debug, PartialEq)]
enum Ended {
    Done,
    Kept,
    Nothing,
    Refused(String),
}

fn cut_and_resumed(sources: &[Given], shares: Shares, cuts: u64) -> u64 {
    cut_and_resumed_with(NormalsMode::Keep, sources, shares, cuts)
}

/// Builds, cut at so many moments, and gone on with; how many had something kept.
fn cut_and_resumed_with(normals: NormalsMode, sources: &[Given], shares: Shares, cuts: u64) -> u64 {
    let place = Place::with(normals);
    let (ended, questions) = place.run(sources, Resume::Never, shares, u64::MAX);
    assert_eq!(ended, Ended::Done);
    let whole = place.file();
    let mut kept = 0;
    for cut in 0..cuts {
        let place = Place::with(normals);
        let after = cut * (questions - 1) / (cuts - 1);
        let (ended, _) = place.run(sources, Resume::Later, shares, after);
        assert!(!place.out().exists());
        match ended {
            Ended::Kept => kept += 1,
            Ended::Nothing => assert_eq!(names_in(place.out.path()), [""; 0]),
            other => panic!("{after} of {questions}: {other:?}"),
        }
        // Cut again in what is left, then to its end.
        place.run(sources, Resume::Now, shares, (questions - after) / 2);
        let (ended, _) = place.run(sources, Resume::Now, shares, u64::MAX);
        assert_eq!(ended, Ended::Done, "{after} of {questions}");
        assert!(place.file() == whole, "other bytes after a cut at {after} of {questions}");
    }
    kept
}

#[test]
fn a_build_that_is_cut_anywhere_goes_on_to_the_same_bytes() {
    let kept = cut_and_resumed(&sources(), LITTLE, 32);
    assert!(kept > 20, "{kept} were kept");
}

#[test]
fn a_cell_that_was_parted_halfway_goes_on_there() {
    let point = |i: u64| [below(3 * i, 900), below(3 * i + 1, 900), below(3 * i + 2, 900)];
    let far = (0..300_000u64).map(point).chain([[i32::MAX; 3]]).collect();
    let sources = [given("far", [0.001; 3], far)];
    let shares = Shares { chunk_bytes_max: 4_000_000, ..LITTLE };
    let place = Place::new();
    // One thread parts one block of five between two questions.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        place.run(&sources, Resume::Never, shares, u64::MAX);
        let whole = place.file();
        // Reading ends before, building begins behind.
        for after in 8..20 {
            let place = Place::new();
            let (ended, _) = place.run(&sources, Resume::Later, shares, after);
            assert_eq!(ended, Ended::Kept, "cut at {after}");
            let (ended, _) = place.run(&sources, Resume::Now, shares, u64::MAX);
            assert_eq!(ended, Ended::Done, "cut at {after}");
            assert!(place.file() == whole, "other bytes after a cut at {after}");
        }
    });
}

#[test]
fn normals_are_estimated_as_if_nothing_had_been() {
    for shares in [LITTLE, NO_SCRATCH] {
        assert!(cut_and_resumed_with(NormalsMode::Estimate, &sources(), shares, 6) > 2);
    }
}

#[test]
fn inputs_that_lie_are_not_found_out_again() {
    // Bounds that are wrong, and colours that turn out to be of another depth.
    let mut sources = sources();
    sources[1] = sources[1].clone().claiming(Some([[0.0; 3], [1.0; 3]]));
    let colours =
        given("d", [0.001; 3], vec![[9; 3]; 15_000]).with("red", AttrType::U16, |i| i % 256);
    sources.push(colours.coloured(ColourDepth::Sixteen));
    assert!(cut_and_resumed(&sources, LITTLE, 12) > 5);
}

#[test]
fn chunks_are_kept_also_where_all_rows_are_in_memory() {
    assert!(cut_and_resumed(&sources(), NO_SCRATCH, 12) > 4);
    // Few chunks are not worth a journal.
    assert_eq!(cut_and_resumed(&sources()[2..], NO_SCRATCH, 3), 0);
}

/// A build cut in the middle.
fn cut() -> (Place, Vec<u8>) {
    let place = Place::new();
    let (_, questions) = place.run(&sources(), Resume::Later, LITTLE, u64::MAX);
    let whole = place.file();
    std::fs::remove_file(place.out()).unwrap();
    let (ended, _) = place.run(&sources(), Resume::Later, LITTLE, questions * 3 / 4);
    assert_eq!(ended, Ended::Kept);
    (place, whole)
}

#[test]
fn work_that_is_done_is_not_done_again() {
    let place = Place::new();
    let (_, questions) = place.run(&sources(), Resume::Later, LITTLE, u64::MAX);
    std::fs::remove_file(place.out()).unwrap();
    place.run(&sources(), Resume::Later, LITTLE, questions * 9 / 10);
    let (ended, left) = place.run(&sources(), Resume::Now, LITTLE, u64::MAX);
    assert_eq!(ended, Ended::Done);
    assert!(left < questions / 2, "{left} of {questions}");
}

#[test]
fn what_was_cut_and_is_begun_afresh_is_told() {
    let (_, questions) = Place::new().run(&sources(), Resume::Never, LITTLE, u64::MAX);
    let (place, whole) = cut();
    let run = |change: fn(&mut Options), resume, after| {
        let scratch = Some(place.scratch.path().to_path_buf());
        let mut options = Options { scratch, ..options(resume) };
        change(&mut options);
        let task = Stops::after(after);
        let result = build_shared(boxed(&sources()), &place.out(), &options, LITTLE, &task);
        (result, task.notes.into_inner().unwrap())
    };
    // With other options, cut again; what is then gone on with is that build, not the one before.
    let small = |options: &mut Options| options.compress = esker_format::Codec::Small;
    let (result, notes) = run(small, Resume::Later, questions / 2);
    assert!(matches!(result, Err(BuildError::Kept(_))), "{result:?}");
    assert!(notes[0].contains("out.esker: an earlier build of it was cut"), "{notes:?}");
    assert!(notes[0].contains("--compress was fast, and is small"), "{notes:?}");
    let (result, _) = run(|_| (), Resume::Now, u64::MAX);
    assert!(result.unwrap_err().to_string().contains("--compress was small, and is fast"));
    let (result, notes) = run(small, Resume::Now, u64::MAX);
    result.unwrap();
    assert_eq!(notes, [""; 0]);
    let of_small = place.file();
    assert!(of_small.len() < whole.len());
    // With the same options: there was something to go on with.
    let (place, _) = cut();
    let options = Options { scratch: Some(place.scratch.path().into()), ..options(Resume::Later) };
    let task = Stops::after(u64::MAX);
    build_shared(boxed(&sources()), &place.out(), &options, LITTLE, &task).unwrap();
    let notes = task.notes.into_inner().unwrap();
    assert!(notes[0].contains("--resume would have gone on"), "{notes:?}");
    assert!(place.file() == whole);
    // Over a finished file nothing is to be told.
    let task = Stops::after(u64::MAX);
    build_shared(boxed(&sources()), &place.out(), &options, LITTLE, &task).unwrap();
    assert_eq!(task.notes.into_inner().unwrap(), [""; 0]);
}

#[test]
fn what_has_changed_is_named() {
    let (place, whole) = cut();
    let scratch = Some(place.scratch.path().to_path_buf());
    let with = |sources: &[Given], options: Options, shares| {
        let options = Options { scratch: scratch.clone(), ..options };
        let task = Stops::after(u64::MAX);
        build_shared(boxed(sources), &place.out(), &options, shares, &task)
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
    // In which order they are named does not matter, nor does more memory, and nothing of all this has done harm.
    let more = Shares { buffer_bytes_max: 1 << 30, chunk_bytes_max: 1 << 30 };
    let reversed: Vec<_> = sources().into_iter().rev().collect();
    with(&reversed, now(), more).unwrap();
    assert!(place.file() == whole);
}

#[test]
fn a_file_that_has_changed_is_named() {
    let place = Place::new();
    let scan = place.out.path().join("a.xyz");
    let line = |i: u64| format!("{} {} {}\n", below(2 * i, 5000), below(2 * i + 1, 5000), i % 7);
    std::fs::write(&scan, (0..60_000).map(line).collect::<String>()).unwrap();
    let options = |resume| Options { node_capacity: 256, resume, ..Default::default() };
    let sources =
        || vec![esker_scan::open(&scan, &Default::default(), &esker_points::task::Silent).unwrap()];
    let task = Stops::after(40);
    let cut = build_shared(sources(), &place.out(), &options(Resume::Later), LITTLE, &task);
    assert!(matches!(cut, Err(BuildError::Kept(_))), "{cut:?}");
    let earlier = std::time::SystemTime::UNIX_EPOCH;
    std::fs::File::options().write(true).open(&scan).unwrap().set_modified(earlier).unwrap();
    let task = Stops::after(u64::MAX);
    let error = build_shared(sources(), &place.out(), &options(Resume::Now), LITTLE, &task);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("the time of change of") && error.contains("a.xyz was"), "{error}");
    // Without it the leftovers are deleted.
    build(std::slice::from_ref(&scan), &place.out(), &options(Resume::Never), &task).unwrap();
    let mut names = names_in(place.out.path());
    names.sort();
    assert_eq!(names, ["a.xyz", "out.esker"]);
}

#[test]
fn with_nothing_to_resume_a_build_starts_afresh_and_says_so() {
    let place = Place::new();
    let task = Stops::after(u64::MAX);
    let options = options(Resume::Now);
    build_shared(boxed(&sources()), &place.out(), &options, LITTLE, &task).unwrap();
    place.file();
    assert!(task.notes.lock().unwrap()[0].contains("nothing to resume"));
}

#[test]
fn a_build_that_took_its_name_but_kept_its_journal_is_built_again() {
    let (place, whole) = cut();
    let journal = std::fs::read(place.journal()).unwrap();
    assert_eq!(place.run(&sources(), Resume::Now, LITTLE, u64::MAX).0, Ended::Done);
    assert!(place.file() == whole);
    std::fs::write(place.journal(), journal).unwrap();
    assert_eq!(place.run(&sources(), Resume::Now, LITTLE, u64::MAX).0, Ended::Done);
    assert!(place.file() == whole);
}

#[test]
fn damage_is_told_or_harmless() {
    let restore = |from: &Path, to: &Path| {
        for name in names_in(from) {
            std::fs::copy(from.join(&name), to.join(&name)).unwrap();
        }
    };
    let (place, whole) = cut();
    let keep = Place::new();
    restore(place.out.path(), keep.out.path());
    restore(place.scratch.path(), keep.scratch.path());
    let journal = std::fs::read(place.journal()).unwrap();
    let mut refused = 0;
    for i in 0..30 {
        let at = i * (journal.len() - 1) / 29;
        restore(keep.out.path(), place.out.path());
        restore(keep.scratch.path(), place.scratch.path());
        let damaged = if i % 2 == 0 {
            journal[..at].to_vec()
        } else {
            let mut damaged = journal.clone();
            damaged[at] ^= 0x10;
            damaged
        };
        std::fs::write(place.journal(), damaged).unwrap();
        match place.run(&sources(), Resume::Now, LITTLE, u64::MAX).0 {
            Ended::Done => assert!(std::fs::read(place.out()).unwrap() == whole, "{i}"),
            Ended::Refused(error) => {
                assert!(error.contains("cannot be resumed"), "{error}");
                refused += 1;
            }
            other => panic!("{other:?}"),
        }
        let _ = std::fs::remove_file(place.out());
    }
    // Rows are given back once they are built, so what was forgotten of that cannot be built again.
    assert!(refused > 0);
    // Pages that are not what they were; scratch that is gone.
    restore(keep.out.path(), place.out.path());
    restore(keep.scratch.path(), place.scratch.path());
    let partial = place.out.path().join(".out.esker.partial");
    let mut pages = std::fs::read(&partial).unwrap();
    pages[5000] ^= 1;
    std::fs::write(&partial, pages).unwrap();
    let (ended, _) = place.run(&sources(), Resume::Now, LITTLE, u64::MAX);
    assert!(matches!(&ended, Ended::Refused(e) if e.contains("is damaged")), "{ended:?}");
    restore(keep.out.path(), place.out.path());
    for name in names_in(place.scratch.path()) {
        std::fs::remove_file(place.scratch.path().join(name)).unwrap();
    }
    let (ended, _) = place.run(&sources(), Resume::Now, LITTLE, u64::MAX);
    assert!(matches!(&ended, Ended::Refused(e) if e.contains(".rows")), "{ended:?}");
}

#[test]
fn two_builds_of_one_output_do_not_meet() {
    let place = Place::new();
    let held = esker_format::FileWriter::create(&place.out()).unwrap();
    for resume in [Resume::Never, Resume::Now] {
        let (ended, _) = place.run(&sources(), resume, LITTLE, u64::MAX);
        assert!(matches!(&ended, Ended::Refused(e) if e.contains("another build")), "{ended:?}");
    }
    drop(held);
    assert_eq!(place.run(&sources(), Resume::Never, LITTLE, u64::MAX).0, Ended::Done);
    place.file();
}
