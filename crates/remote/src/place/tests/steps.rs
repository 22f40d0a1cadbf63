//! The steps of a divided build over object storage give the bytes of a build in one process, also
//! if the file is written there.

use super::faulty::Faulty;
use super::{Answer, at_times, place, place_in, pool};
use esker_builder::jobs::Resources;
use esker_builder::jobs::build::build_parts;
use esker_builder::jobs::cut::cut;
use esker_builder::jobs::join::join;
use esker_builder::jobs::plan::{PlanHow, plan};
use esker_builder::jobs::status::status;
use esker_builder::jobs::take::take;
use esker_builder::{BuildError, Options, build};
use esker_points::objects::{self, Place};
use esker_points::read_at;
use esker_points::task::Silent;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn options() -> Options {
    Options { node_capacity: 1024, memory_bytes: 512 << 20, ..Options::default() }
}

fn generated() -> [PathBuf; 1] {
    ["synthetic:terrain:100k:1".into()]
}

/// A table in degrees, of which files of the second version are built.
fn in_degrees(folder: &Path) -> [PathBuf; 1] {
    let mut rows = "lat,lon,height\n".to_owned();
    for i in 0..4000 {
        let [x, y] = [0.754_877_666, 0.569_840_291].map(|k: f64| (f64::from(i) * k).fract());
        writeln!(rows, "{:.7},{:.7},{:.3}", 47.0 + 0.004 * y, 8.5 + 0.008 * x, 400.0 + x).unwrap();
    }
    let path = folder.join("hills.csv");
    std::fs::write(&path, rows).unwrap();
    [path]
}

fn file_bytes(path: &Path) -> Vec<u8> {
    let file = read_at::open(path).unwrap();
    let mut bytes = vec![0; file.bytes().unwrap() as usize];
    file.read_exact_at(&mut bytes, 0).unwrap();
    bytes
}

/// Runs all steps, each one but the last twice at the same time.
fn divided(inputs: &[PathBuf], place: &dyn Place, out: &Path) -> Result<(), BuildError> {
    let resources = Resources { memory_bytes: 256 << 20, scratch: None };
    let how = PlanHow { jobs: Some(3), ..PlanHow::default() };
    let twice = |step: &(dyn Fn() + Sync)| {
        std::thread::scope(|scope| [0, 1].map(|_| scope.spawn(step)).map(|one| one.join().unwrap()))
    };
    let planned = plan(inputs, place, &options(), &how, &Silent).unwrap();
    for index in 0..planned.takes {
        twice(&|| assert_eq!(take(place, index, &resources, &Silent).unwrap().index, index));
    }
    twice(&|| drop(cut(place, &resources, &Silent).unwrap()));
    for index in 0..cut(place, &resources, &Silent).unwrap().builds {
        twice(&|| assert_eq!(build_parts(place, index, &resources, &Silent).unwrap().index, index));
    }
    join(place, out, &resources, &Silent)?;
    let status = status(place).unwrap();
    assert!(status.join.is_done() && status.leftovers.is_empty(), "{status:?}");
    Ok(())
}

#[test]
fn steps_over_a_store_that_fails_at_times_give_the_bytes_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.esker");
    build(&generated(), &whole, &options(), &Silent).unwrap();
    let whole = file_bytes(&whole);
    let out = folder.path().join("joined.esker");
    divided(&generated(), &place(|_| Answer::Works).0, &out).unwrap();
    assert!(file_bytes(&out) == whole, "other bytes");
    divided(&generated(), &place(at_times(9)).0, &out).unwrap();
    assert!(file_bytes(&out) == whole, "other bytes where requests fail");
}

#[test]
fn files_are_joined_to_object_storage_and_are_not_there_before_their_end() {
    let store = Arc::new(Faulty::new(|_| Answer::Works));
    let (pool, of_address) = (pool(), store.clone());
    let place = place_in(&store, &pool);
    objects::set_remote(Box::new(move |address| {
        assert_eq!(address, "memory://some/jobs");
        Ok(Box::new(place_in(&of_address, &pool)))
    }));
    let folder = tempfile::tempdir().unwrap();
    let inputs = [(generated(), 1), (in_degrees(folder.path()), 2)];
    for (i, (inputs, version)) in inputs.into_iter().enumerate() {
        let whole = folder.path().join("whole.esker");
        build(&inputs, &whole, &options(), &Silent).unwrap();
        let whole = file_bytes(&whole);
        // The header ends with the version.
        assert_eq!(whole[8..12], u32::to_le_bytes(version));
        let steps = super::place(|_| Answer::Works).0;
        let name = format!("town{i}.esker");
        divided(&inputs, &steps, Path::new(&format!("memory://some/jobs/{name}"))).unwrap();
        let joined = place.read(&name, u64::MAX).unwrap().unwrap();
        assert!(joined == whole, "other bytes in version {version}");
    }
    // The store refuses what would be the file.
    store.set(|request| if request == "put" { Answer::Refused } else { Answer::Works });
    let steps = super::place(|_| Answer::Works).0;
    let out = Path::new("memory://some/jobs/other.esker");
    let error = divided(&generated(), &steps, out).unwrap_err().to_string();
    assert!(error.contains("other.esker") && error.contains("refuses"), "{error}");
    assert_eq!(place.read("other.esker", u64::MAX).unwrap(), None);
    assert!(!status(&steps).unwrap().join.is_done());
}

#[test]
fn storage_that_cannot_say_who_is_first_is_refused_by_the_plan() {
    let (place, _) = place(|_| Answer::Unconditional);
    let planned = plan(&generated(), &place, &options(), &PlanHow::default(), &Silent);
    let error = planned.unwrap_err().to_string();
    assert!(error.contains("plan.json") && error.contains("another place"), "{error}");
    assert_eq!(place.list("").unwrap(), []);
}
