//! `.esker` files at addresses open and read as those on this machine, one alone or with the files
//! that it names, also from a server that fails now and then.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod server;

use esker_format::{Forest, PlaneKind};
use esker_points::task::Silent;
use esker_remote::{Limits, Pool};
use server::{Faults, Server};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::time::Duration;

/// Files at addresses are opened, without a disk.
fn install() {
    static ONCE: Once = Once::new();
    let limits = Limits { answer: Duration::from_millis(300), ..Limits::default() };
    ONCE.call_once(|| {
        esker_remote::install(None, Pool::new(limits, Arc::default()));
    });
}

/// A file of a wavy ground, built in `folder`.
fn ground(folder: &Path, name: &str) -> PathBuf {
    let mut text = String::new();
    for i in 0..300 {
        for j in 0..300 {
            let [x, y] = [i, j].map(|c| f64::from(c) * 0.05);
            writeln!(text, "{x:.2} {y:.2} {:.3}", (x * 0.7).sin() * (y * 0.5).cos()).unwrap();
        }
    }
    let scan = folder.join(format!("{name}.xyz"));
    std::fs::write(&scan, text).unwrap();
    let out = folder.join(format!("{name}.esker"));
    let options = esker_builder::Options { node_capacity: 2048, ..Default::default() };
    esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
    out
}

fn bytes(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(path).unwrap(), &mut bytes).unwrap();
    bytes
}

/// Checks that two files have the same nodes, and planes of all of them.
fn is_same(a: &Forest, b: &Forest) {
    let table = a.table();
    assert_eq!(a.points(), b.points());
    assert_eq!(table.nodes.len(), b.table().nodes.len());
    let kinds = [PlaneKind::Position, PlaneKind::Residual];
    b.will_read_planes(0..table.nodes.len() as u32, &kinds);
    for node in 0..table.nodes.len() as u32 {
        let [one, two] = [a, b].map(|file| file.read_planes(node, &kinds).unwrap());
        let values = |planes: &esker_format::Planes| {
            planes.iter().map(|(kind, bytes)| (kind, bytes.to_vec())).collect::<Vec<_>>()
        };
        assert_eq!(values(&one), values(&two), "node {node}");
    }
}

#[test]
fn files_at_addresses_have_the_nodes_and_points_of_those_on_the_disk() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = ground(folder.path(), "town");
    let server = Server::start();
    let address = server.put("scans/town.esker", bytes(&path));
    let local = Forest::open(&path).unwrap();
    let remote = Forest::open(Path::new(&address)).unwrap();
    is_same(&local, &remote);
    assert!(remote.readers().is_some() && local.readers().is_none());
    // Reading all of it again asks for nothing.
    let before = server.answers();
    is_same(&local, &remote);
    assert_eq!(server.answers(), before);
    // All is read in requests of many blocks.
    assert!(before <= 4 + bytes(&path).len() as u64 / (512 << 10), "{before}");
}

#[test]
fn every_read_from_a_server_that_fails_now_and_then_is_right() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = ground(folder.path(), "town");
    let server = Server::start();
    let address = server.put("faulty/town.esker", bytes(&path));
    server.set(Faults { one_in: 13, latency: Duration::from_millis(2), ..Faults::default() });
    let remote = Forest::open(Path::new(&address)).unwrap();
    is_same(&Forest::open(&path).unwrap(), &remote);
}

#[test]
fn files_that_are_missing_damaged_or_changed_are_named_with_their_address() {
    install();
    let folder = tempfile::tempdir().unwrap();
    let path = ground(folder.path(), "town");
    let server = Server::start();
    let fault = |address: &str| Forest::open(Path::new(address)).unwrap_err().to_string();
    let none = server.at("none.esker");
    let error = fault(&none);
    assert!(error.starts_with(&none) && error.contains("no such file"), "{error}");
    let cut = server.put("cut.esker", bytes(&path)[..10_000].to_vec());
    let error = fault(&cut);
    assert!(error.starts_with(&cut), "{error}");
    let address = server.put("changing.esker", bytes(&path));
    let file = Forest::open(Path::new(&address)).unwrap();
    server.set(Faults { changes_after: Some(0), ..Faults::default() });
    let kinds = [PlaneKind::Position];
    let nodes = 0..file.table().nodes.len() as u32;
    let errors = nodes.filter_map(|node| file.read_planes(node, &kinds).err());
    let error = errors.map(|error| error.to_string()).next().unwrap();
    assert!(error.starts_with(&address) && error.contains("has changed"), "{error}");
}
