//! Files at addresses are read as those on this machine, with few requests; a server that
//! misbehaves gives a clear error or, where it does so now and then, the right bytes.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod server;

use esker_points::read_at::ReadAt;
use esker_remote::{Disk, Limits, Remote};
use server::{Faults, Server};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A megabyte and a half, of which no two blocks are equal.
fn bytes() -> Vec<u8> {
    (0..1_500_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()
}

fn limits() -> Limits {
    Limits { answer: Duration::from_millis(300), ..Limits::default() }
}

/// Reads with the same random places each time.
fn places(size: usize) -> impl Iterator<Item = (usize, usize)> {
    let mut state = 1u64;
    std::iter::repeat_with(move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let start = (state >> 33) as usize % size;
        (start, ((state >> 20) as usize % 200_000).min(size - start))
    })
}

fn read(remote: &Remote, (start, length): (usize, usize)) -> std::io::Result<Vec<u8>> {
    let mut read = vec![0; length];
    remote.read_exact_at(&mut read, start as u64)?;
    Ok(read)
}

#[test]
fn reads_give_the_bytes_of_the_file_and_the_rest_of_a_read_over_its_end_is_an_error() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("a b/town.esker", bytes.clone()).replace(' ', "%20");
    let remote = Remote::open(&address, None, limits()).unwrap();
    assert_eq!(remote.bytes().unwrap(), bytes.len() as u64);
    for place in places(bytes.len()).take(200) {
        assert_eq!(read(&remote, place).unwrap(), bytes[place.0..place.0 + place.1]);
    }
    assert_eq!(read(&remote, (bytes.len(), 0)).unwrap(), [0; 0]);
    assert!(read(&remote, (bytes.len() - 1, 2)).is_err());
    let mut one = [0];
    assert!(remote.read_exact_at(&mut one, u64::MAX).is_err());
    for size in [0, 1, 65_535, 65_536, 65_537] {
        let address = server.put("small", bytes[..size].to_vec());
        let remote = Remote::open(&address, None, limits()).unwrap();
        assert_eq!(remote.bytes().unwrap(), size as u64);
        assert_eq!(read(&remote, (0, size)).unwrap(), bytes[..size]);
    }
}

#[test]
fn what_is_said_beforehand_comes_in_few_requests_and_nothing_is_fetched_twice() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes.clone());
    let remote = Remote::open(&address, None, limits()).unwrap();
    // Gaps of less than a block are fetched along, others are not.
    let block = 65_536;
    remote.will_read(&[2 * block..3 * block, 4 * block..5 * block, 9 * block..9 * block + 10]);
    for place in [(2 * block, block), (4 * block, block), (9 * block, 10)] {
        let place = (place.0 as usize, place.1 as usize);
        assert_eq!(read(&remote, place).unwrap(), bytes[place.0..place.0 + place.1]);
    }
    // The first block, the end, and two runs.
    assert_eq!(remote.counts()[0], 4);
    read(&remote, (2 * 65_536, 65_536 * 3)).unwrap();
    assert_eq!(remote.counts()[0], 4);
    assert_eq!(server.answers(), 4);
    // Threads that want the same block wait for one request.
    std::thread::scope(|scope| {
        (0..8).for_each(|_| drop(scope.spawn(|| read(&remote, (12 * 65_536, 10)).unwrap())));
    });
    assert_eq!(server.answers(), 5);
}

#[test]
fn what_was_fetched_stays_on_the_disk_until_the_file_changes() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes.clone());
    let folder = tempfile::tempdir().unwrap();
    let open = || {
        let disk = Arc::new(Disk::new(folder.path().to_owned(), 64 << 20));
        Remote::open(&address, Some(disk), limits()).unwrap()
    };
    let all = (0, bytes.len());
    assert_eq!(read(&open(), all).unwrap(), bytes);
    // Blocks are written beside the reads.
    std::thread::sleep(Duration::from_millis(300));
    let again = open();
    assert_eq!(read(&again, all).unwrap(), bytes);
    assert_eq!(again.counts()[0], 1, "only the first block tells the version");
    let other: Vec<u8> = bytes.iter().map(|byte| !byte).collect();
    server.put("town.esker", other.clone());
    server.set(Faults { changes_after: Some(0), ..Faults::default() });
    assert_eq!(read(&open(), all).unwrap(), other);
}

#[test]
fn memory_is_bounded_and_reads_beyond_it_are_right() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes.clone());
    let limits = Limits { memory_bytes: 4 * 65_536, blocks: 3, ..limits() };
    let remote = Remote::open(&address, None, limits).unwrap();
    assert_eq!(read(&remote, (0, bytes.len())).unwrap(), bytes);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (remote, bytes) = (&remote, &bytes);
            scope.spawn(move || {
                for place in places(bytes.len()).skip(thread * 10).take(40) {
                    assert_eq!(read(remote, place).unwrap(), bytes[place.0..place.0 + place.1]);
                }
            });
        }
    });
}

#[test]
fn servers_that_fail_now_and_then_give_the_right_bytes() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes.clone());
    server.set(Faults { one_in: 11, ..Faults::default() });
    let limits = Limits { blocks: 2, memory_bytes: 6 * 65_536, ..limits() };
    let remote = Remote::open(&address, None, limits).unwrap();
    for place in places(bytes.len()).take(60) {
        assert_eq!(read(&remote, place).unwrap(), bytes[place.0..place.0 + place.1]);
    }
    assert!(server.answers() > 60);
}

#[test]
fn other_servers_are_refused_in_plain_words() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes.clone());
    let refused = |address: &str| {
        let error = Remote::open(address, None, limits()).err().unwrap().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    assert!(refused(&server.at("other.esker")).contains("no such file"));
    server.set(Faults { ignores_ranges: true, ..Faults::default() });
    let error = refused(&address);
    assert!(
        error.contains("does not send parts of files") && error.contains("download"),
        "{error}"
    );
    server.set(Faults { one_in: 1, ..Faults::default() });
    let error = refused(&address);
    assert!(error.contains("does not answer"), "{error}");
    drop(server);
    let start = Instant::now();
    let error = refused("http://127.0.0.1:9/town.esker");
    assert!(error.contains("does not answer"), "{error}");
    assert!(start.elapsed() < Duration::from_secs(30));
}

#[test]
fn a_file_that_changes_while_it_is_read_is_named() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes);
    for has_no_tag in [false, true] {
        server.set(Faults { changes_after: Some(1), has_no_tag, ..Faults::default() });
        let remote = Remote::open(&address, None, limits()).unwrap();
        let read = read(&remote, (10 * 65_536, 10));
        if has_no_tag {
            // Its time is the same, as that of a file that has not changed.
            assert!(read.is_ok());
        } else {
            let error = read.unwrap_err().to_string();
            assert!(error.contains("has changed"), "{error}");
        }
    }
}
