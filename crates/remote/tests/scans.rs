//! LAS and LAZ at addresses are built as those on this machine; other formats are refused.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod server;

use esker_builder::Options;
use esker_format::EskerFile;
use esker_points::task::Silent;
use esker_remote::{Limits, Pool};
use server::{Faults, Server};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

fn bytes(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    std::fs::File::open(path).unwrap().read_to_end(&mut bytes).unwrap();
    bytes
}

fn pool() -> Pool {
    Pool::new(Limits { answer: Duration::from_millis(300), ..Limits::default() }, Arc::default())
}

/// The points of a built file: their number and the hash of the multiset.
fn built(scan: &Path, folder: &Path) -> (u64, String) {
    let out = folder.join("built.esker");
    let _ = std::fs::remove_file(&out);
    esker_builder::build(&[scan.to_owned()], &out, &Options::default(), &Silent).unwrap();
    let file = EskerFile::open(&out).unwrap();
    (file.footer().points, format!("{:?}", file.footer().hash))
}

#[test]
fn scans_at_addresses_are_built_with_all_their_points_also_by_faulty_servers() {
    esker_remote::install(None, pool());
    let folder = tempfile::tempdir().unwrap();
    let scan = PathBuf::from("../../tests/sample/creek.laz");
    let local = built(&scan, folder.path());
    let server = Server::start();
    let address = server.put("creek.laz", bytes(&scan));
    assert_eq!(built(Path::new(&address), folder.path()), local);
    // Read from front to back: most requests are long ones.
    let size = bytes(&scan).len() as u64;
    assert!(server.answers() < 20 + size / (256 << 10), "{} answers", server.answers());
    server.set(Faults { one_in: 17, ..Faults::default() });
    let again = server.put("again.laz", bytes(&scan));
    assert_eq!(built(Path::new(&again), folder.path()), local);
    let ply = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    let ply = server.put("one.ply", ply.to_vec());
    server.set(Faults::default());
    let out = folder.path().join("none.esker");
    let error = esker_builder::build(&[ply.into()], &out, &Options::default(), &Silent);
    let error = error.unwrap_err().to_string();
    assert!(error.contains("only LAS and LAZ are read at addresses"), "{error}");
    assert!(!out.exists());
}
