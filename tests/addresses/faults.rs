//! Views of a file at an address while its server fails at random: each picture is bit for bit that
//! of the file on this machine once its view has settled, memory stays within its bound, and faults
//! that last are named until they end.

use crate::folder::Folder;
use crate::server::{Faults, Server};
use crate::{built, bytes};
use esker_engine::cameras::path::Path as CameraPath;
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::Backend;
use esker_engine::{Forest, View};
use esker_remote::{Limits, Pool};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Views that are drawn.
const VIEWS: u64 = 1000;
const SIZE: [u32; 2] = [64, 48];
/// Views after which another session begins with nothing in drawing memory.
const VIEWS_OF_SESSION: u64 = 20;
/// Bytes of blocks in memory: less than the file, so that they are fetched again and again.
const MEMORY: u64 = 512 << 10;
/// Time after which a view counts as hanging.
const HANGS: Duration = Duration::from_secs(100);

/// Opens a session. Opening is not repeated by itself where a server fails again and again.
fn session(path: &Path) -> Session {
    let start = Instant::now();
    loop {
        match try_session(path) {
            Ok(session) => return session,
            Err(fault) => assert!(start.elapsed() < HANGS, "{fault}"),
        }
    }
}

/// A session with so little drawing memory that nodes leave it.
fn try_session(path: &Path) -> Result<Session, String> {
    let file = Arc::new(Forest::open(path).map_err(|e| e.to_string())?);
    let settings = Settings {
        budget_gpu_bytes: 8 << 20,
        budget_ram_bytes: 64 << 20,
        // What hides what depends on the views before.
        occlusion: false,
        ..Settings::default()
    };
    let options = Options { settings, backend: Backend::Cpu, size: SIZE, ..Options::default() };
    Session::open(file, options).map_err(|e| format!("{e:#}"))
}

/// The picture of a settled view.
fn settled(session: &mut Session, view: &View) -> Vec<u8> {
    let cut = session.settle(view, HANGS).unwrap();
    assert!(cut.settled && cut.complete, "{:?}", session.status());
    session.frame(view).unwrap();
    session.picture().unwrap().rgba
}

#[test]
fn a_thousand_views_from_a_failing_server_have_no_wrong_pixel() {
    let (folder, server) = (Folder::new(), Server::start());
    let path = built(&folder, "town.esker");
    let address = server.put("town.esker", bytes(&path));
    let limits =
        Limits { answer: Duration::from_millis(60), memory_bytes: MEMORY, ..Limits::default() };
    let pool = esker_remote::install(None, Pool::new(limits, Arc::default()));
    let mut local = session(&path);
    let mut remote = session(Path::new(&address));
    let views = CameraPath::of(local.file(), SIZE);
    server.set(Faults { one_in: 40, seed: Some(54), ..Faults::default() });
    let mut state = 54u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 33) as f64 / (1u64 << 31) as f64
    };
    for number in 0..VIEWS {
        if number % VIEWS_OF_SESSION == 0 {
            remote = session(Path::new(&address));
        }
        let to = 1 + (random() * (views.views.len() - 1) as f64) as usize;
        let view = views.between(to, random());
        let (one, two) = (settled(&mut local, &view), settled(&mut remote, &view));
        assert!(one == two, "view {number} differs");
        // Requests that have just landed are put one run at a time.
        let most = MEMORY + limits.blocks * 65_536;
        assert!(pool.memory_bytes() <= most, "{} bytes", pool.memory_bytes());
    }
    assert!(server.answers() > VIEWS, "only {} answers", server.answers());
    drop((local, remote));
    faults_that_last_are_named_until_they_end(&server, &path, &views);
}

fn faults_that_last_are_named_until_they_end(server: &Server, path: &Path, views: &CameraPath) {
    let address = server.put("again.esker", bytes(path));
    server.set(Faults::default());
    let mut remote = session(Path::new(&address));
    server.set(Faults { one_in: 1, ..Faults::default() });
    let view = views.between(2, 1.0);
    let start = Instant::now();
    let fault = loop {
        remote.frame(&view).unwrap();
        if let Some(fault) = remote.status().fault {
            break fault;
        }
        assert!(start.elapsed() < HANGS, "no fault is reported");
    };
    assert!(fault.contains(&address) && fault.contains("500"), "{fault}");
    assert!(fault.contains("it is tried again"), "{fault}");
    server.set(Faults::default());
    let mut local = session(path);
    assert!(settled(&mut remote, &view) == settled(&mut local, &view));
}
