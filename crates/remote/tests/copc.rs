//! COPC files at addresses are drawn without converting or downloading them: the first picture
//! takes a few requests, and everything that is read is what a file on this machine has.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod server;

use esker_builder::{ExportOptions, Options, build, copc, export_with};
use esker_format::{EskerFile, Forest};
use esker_points::Filter;
use esker_points::task::Silent;
use esker_remote::{Limits, Pool};
use esker_scan::OpenOptions;
use server::{Faults, Odd, Server};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::time::Duration;

const WKT: &str = r#"LOCAL_CS["site",UNIT["metre",1]]"#;

/// The sample scan as COPC.
fn copc_file(folder: &Path) -> PathBuf {
    let scan = PathBuf::from("../../tests/sample/creek.laz");
    let (built, out) = (folder.join("creek.esker"), folder.join("creek.copc.laz"));
    let options = Options { node_capacity: 4096, ..Options::default() };
    build(&[scan], &built, &options, &Silent).unwrap();
    let crs = ExportOptions { crs: Some(WKT.into()), ..Default::default() };
    let forest = Forest::open(&built).unwrap();
    export_with(&forest, &out, &Filter::default(), crs, &Silent).unwrap();
    out
}

fn open(path: &Path) -> EskerFile {
    assert!(copc::is_copc(path).unwrap());
    copc::open(path, &OpenOptions::default(), copc::CACHE_BYTES).unwrap()
}

/// The exact coordinates and the pages of all nodes.
fn all(file: EskerFile) -> Vec<(Vec<[u32; 3]>, Vec<u8>)> {
    let forest = Forest::from(file).grown(true).unwrap();
    let file = forest.files().next().unwrap();
    let of = |node: u32| {
        let page = file.read_page(node).unwrap().bytes().to_vec();
        (file.exact_positions(node).unwrap().unwrap(), page)
    };
    (0..file.table().nodes.len() as u32).map(of).collect()
}

/// Sets, once for all tests, what opens addresses. Servers that do not answer are waited for long,
/// except by reads that are cancelled.
fn install() {
    static ONCE: Once = Once::new();
    let limits = Limits { answer: Duration::from_secs(20), ..Limits::default() };
    ONCE.call_once(|| drop(esker_remote::install(None, Pool::new(limits, Arc::default()))));
}

#[test]
fn a_read_of_a_server_that_stalls_ends_when_it_is_told_to() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = copc_file(folder.path());
    let mut bytes = Vec::new();
    std::fs::File::open(&path).unwrap().read_to_end(&mut bytes).unwrap();
    let server = Server::start();
    let address = server.put("stalls.copc.laz", bytes);
    let forest = Forest::from(open(Path::new(&address)));
    let [requests, _] = forest.traffic().unwrap();
    assert!(requests > 0);
    server.set(Faults { odd: Odd::Stalls, ..Faults::default() });
    let all: Vec<u32> = (0..forest.table().nodes.len() as u32).collect();
    std::thread::scope(|scope| {
        let reading = scope.spawn(|| forest.complete(&all));
        // Reads that begin after an interrupt wait for the next one.
        while !reading.is_finished() {
            forest.interrupt();
            std::thread::sleep(Duration::from_millis(1));
        }
        let error = reading.join().unwrap().unwrap_err().to_string();
        assert!(error.contains("stopped"), "{error}");
    });
}

#[test]
fn the_first_picture_takes_a_few_requests_and_all_points_are_those_of_the_file() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = copc_file(folder.path());
    let mut bytes = Vec::new();
    std::fs::File::open(&path).unwrap().read_to_end(&mut bytes).unwrap();
    let server = Server::start();
    let address = server.put("creek.copc.laz", bytes.clone());
    let file = open(Path::new(&address));
    // An overview: the root and the nodes right below it.
    let top: Vec<u32> = std::iter::once(0).chain(file.table().nodes[0].children()).collect();
    file.complete(&top).unwrap();
    assert!(top.len() > 2 && server.answers() <= 8, "{:?}", server.lines());
    drop(file);
    let local = all(open(&path));
    assert_eq!(all(open(Path::new(&address))), local);
    server.set(Faults { one_in: 13, ..Faults::default() });
    let again = server.put("again.copc.laz", bytes);
    assert_eq!(all(open(Path::new(&again))), local);
}
