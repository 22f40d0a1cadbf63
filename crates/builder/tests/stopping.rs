//! A build that ends early leaves no file behind, and the error says what happened and where.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::{BuildError, Options, Shares, build, build_shared, build_sources};
use esker_points::lattice::Placement;
use esker_points::task::Silent;
use esker_points::{AttrType, Spread, Task};
use esker_scan::source::Sink;
use esker_scan::{ReadReport, ScanError, Source, SourceInfo};
use given::{Given, boxed, given, names_in};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

fn sources() -> Vec<Given> {
    let hill = |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), below(i, 300)];
    let positions = (0..120_000).map(|i| if i % 3 == 0 { [7; 3] } else { hill(i) });
    vec![given("hill", [0.001; 3], positions.collect()).with("user_data", AttrType::U8, |i| i)]
}

fn options() -> Options {
    Options { node_capacity: 256, ..Default::default() }
}

/// Cancels the task after `after` checks.
struct Stops {
    checks: AtomicU64,
    after: u64,
}

impl Task for Stops {
    fn is_cancelled(&self) -> bool {
        self.checks.fetch_add(1, Ordering::Relaxed) >= self.after
    }
}

#[test]
fn a_build_can_be_cancelled_anywhere() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let little = Shares { buffer_bytes_max: 100_000, chunk_bytes_max: 300_000 };
    for shares in [Shares::of(1 << 30), little] {
        let run = |after| {
            let task = Stops { checks: AtomicU64::new(0), after };
            let result = build_shared(boxed(&sources()), &out, &options(), shares, &task);
            (result, task.checks.into_inner())
        };
        let (result, checks) = run(u64::MAX);
        result.unwrap();
        std::fs::remove_file(&out).unwrap();
        assert!(checks > 100, "{checks}");
        for after in (0..12).map(|i| i * (checks - 1) / 11) {
            let (result, _) = run(after);
            assert!(matches!(result, Err(BuildError::Cancelled(_))), "{after}: {result:?}");
            assert_eq!(names_in(folder.path()), [""; 0]);
        }
    }
}

#[test]
fn cancelling_while_nested_cells_are_sampled_is_harmless() {
    // In one octant of each cell a lone point precedes 400 others, which may be left unsplit; the
    // first octant holds more cells of the kind.
    let mut positions = Vec::new();
    for level in 6..12 {
        let half = 1u32 << level;
        let in_octant = |corner: [u32; 3], i: u64| {
            [0, 1, 2].map(|axis| corner[axis as usize] as i32 + below(3 * i + axis, half))
        };
        positions.push([half as i32; 3]);
        positions.extend(
            (0..400)
                .map(|i| in_octant([half + half / 2; 3], i).map(|c| c.min(2 * half as i32 - 1))),
        );
        positions.extend((0..400).map(|i| in_octant([0, half, 0], i)));
    }
    let sources = [given("nested", [0.001; 3], positions)];
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let run = |after| {
        let task = Stops { checks: AtomicU64::new(0), after };
        let options = Options { node_capacity: 64, ..Default::default() };
        (build_sources(boxed(&sources), &out, &options, &task), task.checks.into_inner())
    };
    let (result, checks) = run(u64::MAX);
    result.unwrap();
    std::fs::remove_file(&out).unwrap();
    for after in 0..checks.min(400) {
        let (result, _) = run(after);
        assert!(matches!(result, Err(BuildError::Cancelled(_))), "{after}: {result:?}");
    }
}

#[test]
fn an_earlier_file_survives_a_build_that_fails() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    std::fs::write(&out, "mine").unwrap();
    let task = Stops { checks: AtomicU64::new(0), after: 3 };
    build_sources(boxed(&sources()), &out, &options(), &task).unwrap_err();
    assert_eq!(names_in(folder.path()), ["out.esker"]);
    assert_eq!(std::fs::read(&out).unwrap(), b"mine");
}

/// An input that ends too early.
struct Broken(Given);

impl Source for Broken {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        self.0.read(placement, task, sink)?;
        Err(ScanError::damaged(&self.0.info.path, "its points break off at byte 77"))
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.0.survey(task)
    }
}

#[test]
fn a_damaged_input_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let broken: Vec<Box<dyn Source>> = vec![Box::new(Broken(sources().remove(0)))];
    let error = build_sources(broken, &out, &options(), &Silent).unwrap_err();
    assert_eq!(error.to_string(), "hill: its points break off at byte 77");
    assert!(names_in(folder.path()).is_empty());
}

#[test]
fn folders_that_do_not_exist_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let nowhere = folder.path().join("nowhere");
    let scratch = Options { scratch: Some(nowhere.clone()), ..options() };
    let error = build_sources(boxed(&sources()), &out, &scratch, &Silent).unwrap_err();
    assert!(matches!(error, BuildError::Scratch { .. }));
    let text = error.to_string();
    assert!(text.contains("nowhere") && text.contains("--scratch"), "{text}");
    assert!(names_in(folder.path()).is_empty());

    let error = build_sources(boxed(&sources()), &nowhere.join("a.esker"), &options(), &Silent);
    let text = error.unwrap_err().to_string();
    assert!(text.contains("nowhere"), "{text}");
    // A folder at the path of the output.
    std::fs::create_dir(&out).unwrap();
    let error = build_sources(boxed(&sources()), &out, &options(), &Silent).unwrap_err();
    assert!(error.to_string().contains("out.esker"), "{error}");
    assert_eq!(names_in(folder.path()), ["out.esker"]);
}

#[test]
#[cfg(unix)]
fn a_folder_without_write_permission_is_named() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let closed = folder.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o555)).unwrap();
    // The superuser may write everywhere; `/proc` refuses files of anyone.
    let closed = if std::fs::File::create(closed.join("probe")).is_ok() {
        PathBuf::from("/proc")
    } else {
        closed
    };
    let out = closed.join("a.esker");
    let error = build_sources(boxed(&sources()), &out, &options(), &Silent).unwrap_err();
    assert!(error.to_string().contains("a.esker"), "{error}");
    let scratch = Options { scratch: Some(closed), ..options() };
    let out = folder.path().join("b.esker");
    let error = build_sources(boxed(&sources()), &out, &scratch, &Silent).unwrap_err();
    assert!(matches!(error, BuildError::Scratch { .. }), "{error}");
    assert!(!out.exists());
}

#[test]
#[cfg(target_os = "linux")]
fn a_device_cannot_be_the_output() {
    let error = build_sources(boxed(&sources()), "/dev/full".as_ref(), &options(), &Silent);
    assert!(error.unwrap_err().to_string().contains("/dev/full"));
}

#[test]
fn an_input_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.xyz");
    std::fs::write(&path, "1 2 3\n4 5 6\n").unwrap();
    let error = build(std::slice::from_ref(&path), &path, &options(), &Silent).unwrap_err();
    assert!(error.to_string().contains("is input and output at once"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"1 2 3\n4 5 6\n");
}
