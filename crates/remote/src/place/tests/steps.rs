//! The steps of a divided build over object storage give the bytes of a build in one process.

use super::{Answer, at_times, place};
use esker_builder::jobs::Resources;
use esker_builder::jobs::build::build_parts;
use esker_builder::jobs::cut::cut;
use esker_builder::jobs::join::join;
use esker_builder::jobs::plan::{PlanHow, plan};
use esker_builder::jobs::status::status;
use esker_builder::jobs::take::take;
use esker_builder::{Options, build};
use esker_points::objects::Place;
use esker_points::read_at;
use esker_points::task::Silent;
use std::path::{Path, PathBuf};

fn options() -> Options {
    Options { node_capacity: 1024, memory_bytes: 512 << 20, ..Options::default() }
}

fn inputs() -> [PathBuf; 1] {
    ["synthetic:terrain:100k:1".into()]
}

fn file_bytes(path: &Path) -> Vec<u8> {
    let file = read_at::open(path).unwrap();
    let mut bytes = vec![0; file.bytes().unwrap() as usize];
    file.read_exact_at(&mut bytes, 0).unwrap();
    bytes
}

/// Runs all steps, each one twice at the same time.
fn divided(place: &dyn Place, out: &Path) {
    let resources = Resources { memory_bytes: 256 << 20, scratch: None };
    let how = PlanHow { jobs: Some(3), ..PlanHow::default() };
    let twice = |step: &(dyn Fn() + Sync)| {
        std::thread::scope(|scope| [0, 1].map(|_| scope.spawn(step)).map(|one| one.join().unwrap()))
    };
    let planned = plan(&inputs(), place, &options(), &how, &Silent).unwrap();
    for index in 0..planned.takes {
        twice(&|| drop(take(place, index, &resources, &Silent).unwrap()));
    }
    twice(&|| drop(cut(place, &resources, &Silent).unwrap()));
    for index in 0..cut(place, &resources, &Silent).unwrap().builds {
        twice(&|| drop(build_parts(place, index, &resources, &Silent).unwrap()));
    }
    join(place, out, &resources, &Silent).unwrap();
    let status = status(place).unwrap();
    assert!(status.join.is_done() && status.leftovers.is_empty(), "{status:?}");
}

#[test]
fn steps_over_a_store_that_fails_at_times_give_the_bytes_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.esker");
    build(&inputs(), &whole, &options(), &Silent).unwrap();
    let whole = file_bytes(&whole);
    let out = folder.path().join("joined.esker");
    divided(&place(|_| Answer::Works).0, &out);
    assert!(file_bytes(&out) == whole, "other bytes");
    divided(&place(at_times(9)).0, &out);
    assert!(file_bytes(&out) == whole, "other bytes where requests fail");
}
