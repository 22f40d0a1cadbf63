//! Places in object storage keep what places in folders keep; requests that fail or whose answers
//! are lost change nothing of that; and what cannot be written leaves nothing.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod faulty;
mod steps;

use super::ObjectPlace;
use super::upload::part_bytes;
use crate::pool::{Limits, Pool};
use esker_builder::jobs::place::Folder;
use esker_points::objects::{Listed, Place};
use esker_points::read_at::ReadAt;
use faulty::{Answer, Faulty};
use object_store::path::Path;
use std::io::{ErrorKind, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

/// Bytes of a megabyte.
const MB: usize = 1 << 20;

fn pool() -> Arc<Pool> {
    let limits = Limits { answer: Duration::from_millis(300), ..Limits::default() };
    Arc::new(Pool::new(limits, Arc::default()))
}

fn place_in(store: &Arc<Faulty>, pool: &Arc<Pool>) -> ObjectPlace {
    let base = Path::from("some/jobs");
    let shown = "memory://some/jobs".into();
    ObjectPlace::over(store.clone(), store.clone(), base, shown, pool)
}

/// A place in a store in memory.
fn place(
    answers: impl FnMut(&'static str) -> Answer + Send + 'static,
) -> (ObjectPlace, Arc<Faulty>) {
    let store = Arc::new(Faulty::new(answers));
    (place_in(&store, &pool()), store)
}

/// Numbers that look random.
fn numbers(seed: u64) -> impl Iterator<Item = u64> + Send {
    let mut state = seed;
    std::iter::repeat_with(move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    })
}

/// One of twenty requests fails, and the answer to another is lost; never more than two in a row.
fn at_times(seed: u64) -> impl FnMut(&'static str) -> Answer + Send + 'static {
    let (mut numbers, mut in_row) = (numbers(seed), 0);
    move |_| {
        let answer = match numbers.next().unwrap() % 20 {
            0 if in_row < 2 => Answer::Fails,
            1 if in_row < 2 => Answer::Lost,
            _ => Answer::Works,
        };
        in_row = if answer == Answer::Works { 0 } else { in_row + 1 };
        answer
    }
}

/// Bytes without a period.
fn bytes(count: usize) -> Vec<u8> {
    (0..count as u64).map(|i| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8).collect()
}

fn written(place: &dyn Place, name: &str, bytes: &[u8]) {
    let mut upload = place.begin(name).unwrap();
    bytes.chunks(700_001).for_each(|part| upload.write_all(part).unwrap());
    upload.finish().unwrap();
}

fn read(object: &dyn ReadAt, offset: u64, count: usize) -> std::io::Result<Vec<u8>> {
    let mut read = vec![0; count];
    object.read_exact_at(&mut read, offset).map(|()| read)
}

/// All of what steps expect of a place that is empty.
fn keeps_what_steps_need(place: &dyn Place) {
    // Small objects: the first one stays.
    assert_eq!(place.read("plan.json", 10).unwrap(), None);
    assert!(place.create("plan.json", b"first").unwrap());
    assert!(!place.create("plan.json", b"other").unwrap());
    assert_eq!(place.read("plan.json", 5).unwrap().unwrap(), b"first");
    assert!(place.read("plan.json", 4).unwrap_err().to_string().contains("longer than 4 bytes"));

    // Of several creators at once, one is first.
    let created = std::thread::scope(|scope| {
        let creators: Vec<_> = (0..8u8)
            .map(|own| scope.spawn(move || place.create("take/00000", &[own; 100]).unwrap()))
            .collect();
        creators.into_iter().map(|creator| creator.join().unwrap()).collect::<Vec<_>>()
    });
    assert_eq!(created.iter().filter(|&&is_first| is_first).count(), 1, "{created:?}");
    let first = created.iter().position(|&is_first| is_first).unwrap() as u8;
    assert_eq!(place.read("take/00000", 100).unwrap().unwrap(), [first; 100]);

    // Large objects.
    assert_eq!(place.open("take/00000-a.rows").err().unwrap().kind(), ErrorKind::NotFound);
    let own = bytes(20 * MB + 12_345);
    written(place, "take/00000-a.rows", &own);
    let object = place.open("take/00000-a.rows").unwrap();
    assert_eq!(object.bytes().unwrap(), own.len() as u64);
    for (offset, count) in [(0, 10), (8 * MB - 5, 10), (3 * MB, 9 * MB), (own.len() - 7, 7)] {
        let read = read(&*object, offset as u64, count).unwrap();
        assert!(read == own[offset..offset + count], "{count} bytes from {offset}");
    }
    assert!(read(&*object, own.len() as u64 - 7, 8).is_err());
    for (name, count) in [("cut-a.parts", 0), ("cut-b.parts", 8 * MB), ("cutlery", 3)] {
        written(place, name, &own[..count]);
        assert_eq!(place.open(name).unwrap().bytes().unwrap(), count as u64);
    }
    let mut dropped = place.begin("take/00000-b.rows").unwrap();
    dropped.write_all(&own[..9 * MB]).unwrap();
    drop(dropped);

    // Lists, which look into no other folder, and removal.
    let names = |prefix: &str| {
        let listed = place.list(prefix).unwrap();
        listed.into_iter().map(|Listed { name, bytes }| (name, bytes)).collect::<Vec<_>>()
    };
    let parts = [("cut-a.parts".to_owned(), 0), ("cut-b.parts".to_owned(), 8 << 20)];
    assert_eq!(names("cut-"), parts);
    let rows = ("take/00000-a.rows".to_owned(), own.len() as u64);
    assert_eq!(names("take/"), [("take/00000".to_owned(), 100), rows.clone()]);
    assert_eq!(names("take/00000-"), [rows]);
    assert_eq!(names("build/"), []);
    place.remove("cut-a.parts").unwrap();
    place.remove("cut-a.parts").unwrap();
    assert_eq!(names("cut-"), parts[1..]);
    place.remove("plan.json").unwrap();
    assert!(place.create("plan.json", b"other").unwrap());
}

#[test]
fn folders_and_object_storage_keep_the_same() {
    let folder = tempfile::tempdir().unwrap();
    keeps_what_steps_need(&Folder::new(&folder.path().join("work")));
    let (place, store) = place(|_| Answer::Works);
    keeps_what_steps_need(&place);
    assert_eq!(store.uploads(), 0);
}

#[test]
fn requests_that_fail_at_times_and_lost_answers_change_nothing() {
    let all = ["put", "get", "head", "list", "begin", "part", "complete"];
    let sound = place(|_| Answer::Works);
    keeps_what_steps_need(&sound.0);
    for seed in 0..4 {
        let (place, store) = place(at_times(seed));
        keeps_what_steps_need(&place);
        assert!(store.count(&all) > sound.1.count(&all), "nothing was repeated");
        // Two uploads have more than a part. One whose number was lost cannot be ended.
        assert!(store.uploads() <= store.count(&["begin"]) - 2);
    }
}

#[test]
fn an_answer_that_was_lost_counts_for_the_creator_alone() {
    let mut is_lost = [true].into_iter();
    let lose_one = move |_| if is_lost.next().is_some() { Answer::Lost } else { Answer::Works };
    let (one, store) = place(lose_one);
    assert!(one.create("cut", b"own").unwrap());
    let other = place_in(&store, &pool());
    assert!(!other.create("cut", b"own").unwrap(), "the same bytes of another creator");
    // Another one was first while an answer was awaited.
    let mut fails = [true].into_iter();
    store.set(move |_| if fails.next().is_some() { Answer::Fails } else { Answer::Works });
    assert!(!one.create("cut", b"mine").unwrap());
}

#[test]
fn a_store_that_refuses_or_fails_leaves_nothing_and_says_so_without_secrets() {
    for failing in [Answer::Fails, Answer::Refused] {
        for request in ["put", "begin", "part", "complete"] {
            let (place, store) =
                place(move |of| if of == request { failing } else { Answer::Works });
            let own = bytes(if request == "put" { 1000 } else { 50 * MB });
            let mut upload = place.begin("build/00001-a.pages").unwrap();
            let written = upload.write_all(&own);
            let error = match written {
                Err(error) => {
                    assert_eq!(upload.write(&own).unwrap_err().kind(), ErrorKind::BrokenPipe);
                    assert_eq!(upload.finish().unwrap_err().kind(), ErrorKind::BrokenPipe);
                    error
                }
                Ok(()) => upload.finish().unwrap_err(),
            };
            let error = error.to_string();
            assert!(!error.contains("secret"), "{error}");
            let words = if failing == Answer::Fails { "connection reset" } else { "refuses" };
            assert!(error.contains(words), "{request}: {error}");
            assert_eq!(store.uploads(), 0, "{request}: what was sent stays");
            assert_eq!(place.list("build/").unwrap(), [], "{request}");
            if request == "put" {
                place.create("build/00001", b"record").unwrap_err();
                assert_eq!(place.read("build/00001", 100).unwrap(), None);
            }
        }
    }
}

#[test]
fn parts_are_as_many_as_stores_take_and_few_are_in_memory() {
    let total = |parts: usize| (0..parts).map(|i| part_bytes(i) as u64).sum::<u64>();
    assert!(total(10_000) > 1_500_000_000_000 && part_bytes(0) >= 5 << 20);
    let (place, store) = place(|_| Answer::Works);
    let own = bytes(8 * MB);
    let mut upload = place.begin("a").unwrap();
    (0..40).for_each(|_| upload.write_all(&own).unwrap());
    upload.finish().unwrap();
    let mut parts = store.parts();
    parts.sort_unstable();
    assert_eq!(parts.len(), 40, "the first parts have the same size, and 32 fill before they grow");
    assert_eq!(place.open("a").unwrap().bytes().unwrap(), 320 << 20);
    // An object of one part needs one request.
    let before = store.count(&["put", "begin", "part", "complete"]);
    written(&place, "b", &own);
    assert_eq!(store.count(&["put", "begin", "part", "complete"]), before + 1);
}

#[test]
fn many_open_objects_share_the_memory_of_a_few() {
    let store = Arc::new(Faulty::new(|_| Answer::Works));
    let pool = pool();
    let place = place_in(&store, &pool);
    let own = bytes(3 * MB);
    let objects: Vec<_> = (0..40)
        .map(|i| {
            let name = format!("take/{i:05}-a.rows");
            written(&place, &name, &own[i..]);
            place.open(&name).unwrap()
        })
        .collect();
    let (heads, gets) = (store.count(&["head"]), store.count(&["get"]));
    assert_eq!((heads, gets), (40, 0), "opening fetches no bytes");
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (objects, own) = (&objects, &own);
            scope.spawn(move || {
                for at in numbers(thread).take(60) {
                    let (i, offset) = (at as usize % 40, at as usize % (2 * MB));
                    let count = 200_000;
                    let read = read(&*objects[i], offset as u64, count).unwrap();
                    assert!(read == own[i + offset..][..count]);
                }
            });
        }
    });
    let limit = Limits::default().memory_bytes;
    assert!(pool.memory_bytes() <= limit + limit / 4, "{}", pool.memory_bytes());
}

#[test]
fn an_object_that_is_replaced_while_it_is_read_is_an_error() {
    let (place, _) = place(|_| Answer::Works);
    written(&place, "take/00000-a.rows", &bytes(MB));
    let object = place.open("take/00000-a.rows").unwrap();
    written(&place, "take/00000-a.rows", &bytes(MB - 1));
    let error = read(&*object, 0, 10).unwrap_err().to_string();
    assert!(error.contains("has changed"), "{error}");
    let again = place.open("take/00000-a.rows").unwrap();
    assert_eq!(read(&*again, 0, MB - 1).unwrap(), bytes(MB - 1));
}

#[test]
fn waiting_ends_when_the_program_is_stopped() {
    let stop = Arc::new(AtomicBool::new(false));
    let store = Arc::new(Faulty::new(|_| Answer::Fails));
    let pool = Arc::new(Pool::new(Limits::default(), stop.clone()));
    let place = place_in(&store, &pool);
    stop.store(true, Relaxed);
    let error = place.create("cut", b"own").unwrap_err().to_string();
    assert!(error.contains("stopped"), "{error}");
}

#[test]
fn only_object_storage_is_written_and_addresses_are_checked() {
    let refused = |address: &str| ObjectPlace::open(address, &pool()).err().unwrap().to_string();
    assert!(refused("https://host/work").contains("s3, gs or az"));
    assert!(refused("s3://bucket/work?a=secret").contains("`?`"));
    assert!(!refused("ftp://host/secret").contains("secret"));
    let place = ObjectPlace::open("s3://bucket/a%20b/jobs/", &pool()).unwrap();
    assert_eq!(place.shown(), "s3://bucket/a%20b/jobs/");
    assert_eq!(
        place.store.path("take/00000-a.rows").unwrap().as_ref(),
        "a b/jobs/take/00000-a.rows"
    );
}
