//! Several files as one, at addresses: opened, drawn and verified as on this machine; files that
//! lie elsewhere are refused.

use crate::folder::Folder;
use crate::server::Server;
use crate::{built, bytes, drawn, esker, scan, verified};
use std::path::Path;

/// Appends the sample scan to `old`; the new file names the old one.
fn appended(folder: &Folder, old: &Path, name: &str) -> String {
    let out = folder.file(name);
    std::fs::create_dir_all(out.parent().unwrap()).unwrap();
    let [append, to] = ["append", "-o"].map(Path::new);
    esker([append, old, &scan(), to, &out]).worked();
    out.to_str().unwrap().to_owned()
}

#[test]
fn files_that_name_others_are_drawn_and_verified_with_them() {
    let (folder, server) = (Folder::new(), Server::start());
    let old = built(&folder, "older ones/50% #1.esker");
    let local = appended(&folder, &old, "town.esker");
    let address = server.put("city/town.esker", bytes(Path::new(&local)));
    server.put("city/older ones/50% #1.esker", bytes(&old));
    assert_eq!(drawn(&address, &folder, &[]), drawn(&local, &folder, &[]));
    assert_eq!(verified(&address, &[]), verified(&local, &[]));
    let points = |file: &str| esker(["info", file, "--json"]).json()["points"].as_u64().unwrap();
    assert_eq!(points(&address), 2 * points(old.to_str().unwrap()));
    let lines = server.lines();
    let named = "GET /city/older%20ones/50%25%20%231.esker HTTP/1.1";
    assert!(lines.iter().any(|line| line == named), "{lines:?}");
}

#[test]
fn files_in_other_folders_are_refused_also_where_a_server_would_find_them() {
    let (folder, server) = (Folder::new(), Server::start());
    let outer = built(&folder, "outer.esker");
    let encoded = built(&folder, "%2e%2e/outer.esker");
    for (old, name) in [(&outer, "city/town.esker"), (&encoded, "town.esker")] {
        let local = appended(&folder, old, name);
        let address = server.put("city/town.esker", bytes(Path::new(&local)));
        server.put("outer.esker", bytes(old));
        server.put("city/%2e%2e/outer.esker", bytes(old));
        let before = server.answers();
        let error = esker(["info", &address]).error().to_owned();
        assert!(error.contains("is not beside the file that names it"), "{error}");
        let lines = server.lines();
        let later = &lines[before as usize..];
        assert!(later.iter().all(|line| line.contains(" /city/town.esker ")), "{later:?}");
    }
}
