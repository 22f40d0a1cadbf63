//! Files at addresses are drawn with a part of their node table: pictures and picks are those of
//! the file on this machine, also from a server that fails now and then, and of a table of
//! 10^10 points at the usual 24,000 a node little is read before the first picture.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod large;
mod server;
#[path = "../../engine/tests/with_parts/mod.rs"]
mod with_parts;

use esker_builder::{NormalsMode, build};
use esker_engine::calls::pick::report::pick_in;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::path::Path as CameraPath;
use esker_engine::draw::scene::{PictureRequest, completed};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{BuildOptions, View};
use esker_format::{Forest, PartSizes, verify};
use esker_points::task::Silent;
use esker_remote::{Limits, Pool};
use server::{Faults, Server};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Time after which a view counts as hanging.
const HANGS: Duration = Duration::from_secs(100);

/// Files at addresses are opened, without a disk.
fn install() {
    static ONCE: Once = Once::new();
    let limits = Limits { answer: Duration::from_millis(1000), ..Limits::default() };
    ONCE.call_once(|| drop(esker_remote::install(None, Pool::new(limits, Arc::default()))));
}

fn bytes(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(path).unwrap(), &mut bytes).unwrap();
    bytes
}

fn request(camera: &str, size: [u32; 2]) -> PictureRequest {
    PictureRequest {
        size,
        camera: Camera::parse(camera).unwrap(),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::default()
    }
}

#[test]
fn pictures_and_picks_at_an_address_are_those_of_the_file_on_this_machine() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = town(folder.path());
    let server = Server::start();
    let local = Forest::open(&path).unwrap();
    for (number, one_in) in [(0, 0), (1, 40)] {
        let address = server.put(&format!("{number}/town.esker"), bytes(&path));
        let (seed, latency) = (Some(54), Duration::from_millis(1));
        server.set(Faults { one_in, seed, latency, ..Faults::default() });
        let opened = || Forest::open_in_parts(Path::new(&address)).unwrap();
        assert!(opened().is_partial() && opened().readers().is_some());
        for camera in ["", "direction=1,0.3,-0.5"] {
            let request = request(camera, [160, 120]);
            let [own, other] = [&opened(), &local].map(|f| draw(f, &request, &Silent).unwrap().0);
            assert!(own.rgba == other.rgba && own.depth == other.depth, "{camera}");
            let mut picks = 0;
            for pixel in [[80, 60], [50, 70], [100, 80], [60, 40]] {
                let pick = |file: &Forest| pick_in(file, &request, pixel, &Silent).unwrap().point;
                let [own, other] = [pick(&opened()), pick(&local)];
                picks += usize::from(own.is_some());
                let named = |point: Option<esker_engine::calls::pick::Picked>| {
                    point.map(|point| format!("{:?}", (point.node, point.point, point.rows())))
                };
                assert_eq!(named(own), named(other), "{camera} {pixel:?}");
            }
            assert!(picks > 0, "{camera}");
        }
    }
    // What needs all nodes reads the whole table.
    let address = server.put("whole/town.esker", bytes(&path));
    server.set(Faults::default());
    let whole = Forest::open(Path::new(&address)).unwrap();
    assert_eq!((whole.is_partial(), whole.table()), (false, local.table()));
    verify(whole.files().next().unwrap(), &Silent).unwrap();
}

/// The sample scan in many small nodes, with a table of small parts.
fn town(folder: &Path) -> PathBuf {
    let [built, path] = ["built.esker", "town.esker"].map(|name| folder.join(name));
    let options = BuildOptions {
        node_capacity: 512,
        normals: NormalsMode::Estimate,
        ..BuildOptions::default()
    };
    build(&[PathBuf::from("../../tests/sample/creek.laz")], &built, &options, &Silent).unwrap();
    let sizes = PartSizes { from_nodes: 1, part_nodes: 8, top_nodes: 24 };
    with_parts::with_parts(&built, &path, sizes);
    path
}

fn session(path: &Path) -> Session {
    // What hides what depends on the views before.
    let settings = Settings { occlusion: false, ..Settings::default() };
    let size = [160, 120];
    let options = Options { settings, backend: Backend::Cpu, size, ..Options::default() };
    Session::open(Arc::new(Forest::open_in_parts(path).unwrap()), options).unwrap()
}

/// The picture of a settled view.
fn settled(session: &mut Session, view: &View) -> Vec<u8> {
    let cut = session.settle(view, HANGS).unwrap();
    assert!(cut.settled && cut.complete, "{:?}", session.status());
    session.frame(view).unwrap();
    session.picture().unwrap().rgba
}

#[test]
fn sessions_go_on_by_themselves_after_faults_while_parts_are_read() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = town(folder.path());
    let server = Server::start();
    let address = server.put("session/town.esker", bytes(&path));
    let (mut local, mut remote) = (session(&path), session(Path::new(&address)));
    let views = CameraPath::of(local.file(), [160, 120]);
    let seed = Some(54);
    server.set(Faults { one_in: 40, seed, ..Faults::default() });
    let known = |session: &Session| session.file().table().nodes.len();
    let before = known(&remote);
    for number in 0..views.views.len() - 1 {
        let view = views.between(number + 1, 0.5);
        let (one, two) = (settled(&mut local, &view), settled(&mut remote, &view));
        assert!(one == two, "view {number} differs");
    }
    assert!(before < known(&remote) && known(&remote) < known(&local), "{before}");
    // Nothing comes but the roots: the view waits, says why, and goes on.
    let again = server.put("again/town.esker", bytes(&path));
    server.set(Faults::default());
    let mut remote = session(Path::new(&again));
    server.set(Faults { one_in: 1, ..Faults::default() });
    let (view, start) = (views.between(1, 1.0), Instant::now());
    let fault = loop {
        remote.frame(&view).unwrap();
        if let Some(fault) = remote.status().fault {
            break fault;
        }
        assert!(start.elapsed() < HANGS, "no fault is reported");
    };
    assert!(fault.contains(&again) && fault.contains("500"), "{fault}");
    server.set(Faults::default());
    assert!(settled(&mut remote, &view) == settled(&mut local, &view));
    assert_eq!(remote.status().nodes_failed, 0, "{:?}", remote.status());
}

#[test]
fn of_a_table_of_ten_thousand_million_points_little_is_read_before_the_first_picture() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("land.esker");
    let nodes = large::write(&path);
    let points = nodes as u64 * 24_000;
    assert!((9_900_000_000..10_200_000_000).contains(&points), "{nodes} nodes");
    let file = Forest::open(&path).unwrap();
    verify(file.files().next().unwrap(), &Silent).unwrap();
    let server = Server::start();
    let all = bytes(&path);
    let middle = large::place([0.5, 0.5]);
    let [x, y, z] = middle;
    let near = format!("eye={},{},{};target={x},{y},{z}", x - 60.0, y - 80.0, z + 50.0);
    // The picture from nearby draws 120 MB of such nodes as they are.
    let views = [("", 2_000_000), ("direction=1,0.3,-0.5", 2_000_000), (&*near, 4_000_000)];
    for (number, (camera, most)) in views.into_iter().enumerate() {
        let address = server.put(&format!("{number}/land.esker"), all.clone());
        let plain = request(camera, [1920, 1080]);
        // Each node has one point in place of 24,000.
        let request =
            PictureRequest { budget_points: plain.budget_points.div_ceil(24_000), ..plain };
        let (before, answers) = (server.sent(), server.answers());
        let forest = Forest::open_in_parts(Path::new(&address)).unwrap();
        let opened = server.sent() - before;
        let grown = completed(&forest, &request, &Silent).unwrap().unwrap_or(forest.clone());
        let chosen = server.sent() - before;
        println!(
            "`{camera}`: {opened} bytes to open, {chosen} bytes in {} requests until the nodes of \
             the picture are known; {} of {nodes} nodes are",
            server.answers() - answers,
            grown.table().nodes.len()
        );
        assert!(opened < 1_000_000 && chosen < most, "{camera}: {opened} {chosen}");
        let [own, other] = [&grown, &file].map(|f| draw(f, &request, &Silent).unwrap().0);
        assert!(own.rgba == other.rgba && own.depth == other.depth, "{camera}");
        assert!(own.rgba.as_chunks::<4>().0.iter().any(|pixel| pixel != &own.rgba[..4]));
    }
    let before = server.sent();
    Forest::open(Path::new(&server.at("0/land.esker"))).unwrap();
    let whole = server.sent() - before;
    println!("{whole} bytes to open it with its whole table");
    assert!(whole > nodes as u64 * 160);
}
