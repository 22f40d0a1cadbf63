//! Files at addresses are read as those on this machine, with few requests; a server that
//! misbehaves gives a clear error or, where it does so now and then, the right bytes.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod server;

use esker_points::read_at::ReadAt;
use esker_remote::{Disk, Limits, Pool, Remote};
use server::{Faults, Odd, Server, Tag};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// A megabyte and a half, of which no two blocks are equal.
fn bytes() -> Vec<u8> {
    (0..1_500_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()
}

fn odd(odd: Odd) -> Faults {
    Faults { odd, ..Faults::default() }
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
    server.set(odd(Odd::Whole));
    let error = refused(&address);
    assert!(
        error.contains("does not send parts of files") && error.contains("download"),
        "{error}"
    );
    for (kind, words) in [
        (Odd::Loops, "redirect"),
        (Odd::Compressed, "compresses it on the way (`Content-Encoding: gzip`)"),
        (Odd::OtherRange, "does not answer as it should: Requested 0..65536, got 1..65537"),
        (Odd::NoSize, "CONTENT_RANGE"),
        (Odd::EndsAtMost, ""),
        (Odd::Endless, "bytes came where 65536 should"),
        (Odd::Refused(400), "status code: 400"),
        (Odd::Refused(401), "credentials"),
        (Odd::Refused(403), "credentials"),
        (Odd::Refused(410), "status code: 410"),
        (Odd::Refused(503), "status code: 503"),
    ] {
        server.set(odd(kind));
        let error = refused(&address);
        assert!(error.contains(words) && !error.contains("secret"), "{kind:?}: {error}");
        // Refusals that stay are not repeated.
        let is_repeated = !matches!(kind, Odd::Loops | Odd::Compressed | Odd::Refused(..=499));
        assert_eq!(server.answers() > 1 && kind != Odd::Loops, is_repeated, "{kind:?}");
    }
    server.set(Faults { one_in: 1, ..Faults::default() });
    assert!(refused(&address).contains("does not answer"));
    drop(server);
    assert!(refused("http://127.0.0.1:9/town.esker").contains("does not answer"));
    let error = refused("https://127.0.0.1:9/town.esker?signature=top-secret");
    assert!(error.contains("does not answer") && !error.contains("secret"), "{error}");
}

#[test]
fn servers_that_stall_or_send_hardly_anything_are_given_up_in_time() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes);
    server.set(odd(Odd::Stalls));
    let start = Instant::now();
    let error = Remote::open(&address, None, limits()).err().unwrap().to_string();
    assert!(error.contains("does not answer as it should: operation timed out"), "{error}");
    // Two or three waits for an answer, and what lies between.
    let most = Duration::from_secs(20);
    assert!(start.elapsed() < most);
    server.set(odd(Odd::Nothing));
    let remote = Remote::open(&address, None, limits()).unwrap();
    server.set(odd(Odd::Trickles));
    let error = read(&remote, (10 * 65_536, 10)).unwrap_err().to_string();
    assert!(error.contains("too slowly"), "{error}");
}

#[test]
fn a_line_that_is_slow_but_steady_is_no_fault() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes.clone());
    let remote = Remote::open(&address, None, limits()).unwrap();
    // All of it takes several times as long as the wait for an answer.
    server.set(Faults { bytes_a_second: Some(1_000_000), ..Faults::default() });
    assert_eq!(read(&remote, (0, bytes.len())).unwrap(), bytes);
    assert!(server.answers() < 8, "{}", server.answers());
}

#[test]
fn reads_from_a_server_that_stalls_end_when_they_are_told_to() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes);
    let limits = Limits { answer: Duration::from_secs(600), ..Limits::default() };
    let stop = Arc::new(AtomicBool::new(false));
    let pool = Arc::new(Pool::new(limits, stop.clone()));
    let remote = Remote::open_in(&address, None, &pool).unwrap();
    server.set(odd(Odd::Stalls));
    std::thread::scope(|scope| {
        let reading = scope.spawn(|| read(&remote, (10 * 65_536, 10)));
        // Reads that begin after an interrupt wait for the next one.
        while !reading.is_finished() {
            remote.interrupt();
            std::thread::sleep(Duration::from_millis(1));
        }
        let error = reading.join().unwrap().unwrap_err().to_string();
        assert!(error.contains("stopped"), "{error}");
        let [reading, opening] = [true, false].map(|is_read| {
            let (address, pool, remote) = (&address, &pool, &remote);
            scope.spawn(move || match is_read {
                true => read(remote, (15 * 65_536, 10)).map(drop),
                false => Remote::open_in(address, None, pool).map(drop),
            })
        });
        std::thread::sleep(Duration::from_millis(100));
        stop.store(true, Relaxed);
        for waiting in [reading, opening] {
            let error = waiting.join().unwrap().unwrap_err().to_string();
            assert!(error.contains("stopped"), "{error}");
        }
    });
}

#[test]
fn a_size_beyond_all_files_and_empty_files_are_no_trouble() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("town.esker", bytes);
    server.set(odd(Odd::Huge));
    let remote = Remote::open(&address, None, limits()).unwrap();
    assert_eq!(remote.bytes().unwrap(), u64::MAX);
    let mut some = [0; 100];
    for offset in [u64::MAX - 100, u64::MAX - 70_000, 1 << 60] {
        assert!(remote.read_exact_at(&mut some, offset).is_err());
    }
    let empty = server.put("empty", Vec::new());
    server.set(odd(Odd::Nothing));
    assert_eq!(Remote::open(&empty, None, limits()).unwrap().bytes().unwrap(), 0);
    // An empty file of a server that ignores ranges.
    server.set(odd(Odd::Whole));
    assert_eq!(Remote::open(&empty, None, limits()).unwrap().bytes().unwrap(), 0);
    server.set(odd(Odd::NoHead));
    let error = Remote::open(&empty, None, limits()).err().unwrap().to_string();
    assert!(error.contains("416"), "{error}");
    // Nothing but an empty file needs `HEAD`.
    Remote::open(&address, None, limits()).unwrap();
}

#[test]
fn addresses_lead_on_and_have_queries_and_hosts_of_all_kinds() {
    let (server, bytes) = (Server::start(), bytes());
    let address = server.put("a b/50%#1.esker", bytes.clone());
    let moved = address.replace("/a b/50%#1", "/moved/a%20b/50%25%231");
    server.set(odd(Odd::Redirects));
    let remote = Remote::open(&format!("{moved}?signature=a%2Fb%3D&x=1"), None, limits()).unwrap();
    assert_eq!(read(&remote, (0, bytes.len())).unwrap(), bytes);
    let lines = server.lines();
    let asked = "GET /moved/a%20b/50%25%231.esker?signature=a%2Fb%3D&x=1 HTTP/1.1";
    assert!(lines.iter().any(|line| line == asked), "{lines:?}");
    let Ok(listener) = std::net::TcpListener::bind("[::1]:0") else {
        eprintln!("skipped: this machine has no IPv6");
        return;
    };
    drop(listener);
    let server = Server::start_at("[::1]:0");
    let address = server.put("town.esker", bytes.clone());
    let remote = Remote::open(&address, None, limits()).unwrap();
    assert_eq!(read(&remote, (70_000, 10)).unwrap(), bytes[70_000..70_010]);
}

#[test]
fn a_file_that_changes_while_it_is_read_is_named() {
    let bytes = bytes();
    for tag in [Tag::Strong, Tag::Weak, Tag::Time] {
        let server = Server::start();
        let address = server.put("town.esker", bytes.clone());
        server.set(Faults { tag, changes_after: Some(1), ..Faults::default() });
        let remote = Remote::open(&address, None, limits()).unwrap();
        let error = read(&remote, (10 * 65_536, 10)).unwrap_err();
        assert!(error.to_string().contains("has changed"), "{error}");
        assert_eq!(error.kind(), std::io::ErrorKind::StaleNetworkFileHandle);
        // Parts of it that are there already are of no use either.
        assert!(remote.has_changed() && read(&remote, (0, 10)).is_err());
    }
    // Without tag and time, by its size alone.
    let server = Server::start();
    let address = server.put("town.esker", bytes.clone());
    server.set(Faults { tag: Tag::None, ..Faults::default() });
    let remote = Remote::open(&address, None, limits()).unwrap();
    server.put("town.esker", bytes[..700_000].to_vec());
    for place in [600_000, 900_000] {
        let error = read(&remote, (place, 10)).unwrap_err().to_string();
        assert!(error.contains("has changed"), "{error}");
    }
}

#[test]
fn bytes_are_kept_on_the_disk_only_where_the_version_is_certain() {
    let (server, bytes) = (Server::start(), bytes());
    for (tag, is_kept) in [
        (Tag::Strong, true),
        (Tag::Weak, true),
        (Tag::Time, true),
        (Tag::Now, false),
        (Tag::None, false),
    ] {
        let address = server.put("town.esker", bytes.clone());
        let folder = tempfile::tempdir().unwrap();
        let disk = Arc::new(Disk::new(folder.path().join("ranges"), 64 << 20));
        server.set(Faults { tag, ..Faults::default() });
        Remote::open(&address, Some(disk), limits()).unwrap();
        assert_eq!(folder.path().join("ranges").exists(), is_kept, "{tag:?}");
    }
}

#[test]
fn many_files_take_no_more_memory_than_one() {
    let (server, bytes) = (Server::start(), bytes());
    let limits = Limits { memory_bytes: 32 * 65_536, blocks: 3, ..limits() };
    let pool = Arc::new(Pool::new(limits, Arc::default()));
    let files: Vec<_> = (0..8)
        .map(|i| {
            let address = server.put(&format!("{i}.esker"), bytes.clone());
            let file = Remote::open_in(&address, None, &pool).unwrap();
            assert_eq!(read(&file, (0, bytes.len())).unwrap(), bytes);
            file
        })
        .collect();
    for file in &files {
        assert_eq!(read(file, (0, bytes.len())).unwrap(), bytes);
        // A megabyte each in any case, and what the last runs had more.
        assert!(pool.memory_bytes() <= 8 * (16 + 3) * 65_536, "{}", pool.memory_bytes());
    }
    drop(files);
    // Requests that were on their way end by themselves.
    let end = Instant::now() + Duration::from_secs(10);
    while pool.memory_bytes() > 0 && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(pool.memory_bytes(), 0);
}
