//! Commands do with files at addresses what they do with files on this machine, and print no
//! secret; proxies of the environment are used; Ctrl-C ends a read that stalls.

use crate::folder::Folder;
use crate::server::{Faults, Odd, Server};
use crate::{SECRET, built, bytes, drawn, esker, scan, verified};

#[test]
fn commands_at_signed_addresses_do_what_they_do_with_files_and_show_no_signature() {
    let (folder, server) = (Folder::new(), Server::start());
    let file = built(&folder, "town.esker");
    let local = file.to_str().unwrap();
    let sign = |address: String| format!("{}?signature={SECRET}", address.replace(' ', "%20"));
    let address = sign(server.put("a b/town.esker", bytes(&file)));
    let info = esker(["info", &address, "--json"]).json();
    assert_eq!(info["points"], esker(["info", local, "--json"]).json()["points"]);
    assert_eq!(drawn(&address, &folder, &[]), drawn(local, &folder, &[]));
    assert_eq!(verified(&address, &[]), verified(local, &[]));
    let [one, two] = ["one.laz", "two.laz"].map(|name| folder.file(name));
    esker(["export", &address, "-o", one.to_str().unwrap()]).worked();
    esker(["export", local, "-o", two.to_str().unwrap()]).worked();
    assert_eq!(bytes(&one), bytes(&two));
    let laz = sign(server.put("creek.laz", bytes(&scan())));
    let again = folder.file("again.esker");
    let again = again.to_str().unwrap();
    esker(["build", &laz, "-o", again, "--node-capacity", "4096"]).worked();
    assert_eq!(verified(again, &[]), verified(local, &[]));
    esker(["verify", &address, "--against", &laz]).worked();
    // A scene document names the file, without the signature.
    let scene = folder.file("scene.json");
    let picture = folder.file("scene.png");
    let [scene, picture] = [&scene, &picture].map(|path| path.to_str().unwrap());
    esker(["render", &address, "-o", picture, "--size", "32x20", "--save-scene", scene]).worked();
    let document = std::fs::read_to_string(scene).unwrap();
    assert!(document.contains("/a%20b/town.esker\"") && !document.contains(SECRET), "{document}");
    esker(["render", scene, "-o", picture]).worked();
    let lines = server.lines();
    assert!(lines.iter().filter(|line| line.contains(SECRET)).count() > 10);
}

#[test]
fn addresses_with_passwords_are_refused_without_them() {
    for address in [
        format!("http://user:{SECRET}@127.0.0.1:9/town.esker"),
        format!("http://{SECRET}@127.0.0.1:9/town.esker"),
        format!("http://user:{SECRET}/@127.0.0.1:9/town.esker"),
        format!("s3://bucket/town.esker?key={SECRET}"),
        format!("http://127.0.0.1:9/none.esker?key={SECRET}"),
    ] {
        for words in [vec!["info"], vec!["verify"], vec!["render", "-o", "/dev/null/x.png"]] {
            let outcome = esker(words.into_iter().chain([address.as_str()]));
            assert!(outcome.error().contains(":"), "{}", outcome.stderr);
        }
    }
}

#[test]
fn proxies_of_the_environment_are_used() {
    let (folder, proxy) = (Folder::new(), Server::start());
    let file = built(&folder, "town.esker");
    proxy.put("town.esker", bytes(&file));
    let address = "http://scans.invalid/town.esker";
    let variables = [("http_proxy", &*proxy.at("")), ("no_proxy", "")];
    assert_eq!(verified(address, &variables), verified(file.to_str().unwrap(), &[]));
    assert!(proxy.lines().iter().all(|line| line.contains("http://scans.invalid/town.esker")));
    let error = esker(["info", address]).error().to_owned();
    assert!(error.contains(address), "{error}");
}

#[test]
fn what_was_fetched_is_kept_in_the_cache_of_the_user_for_the_next_time() {
    let (folder, server) = (Folder::new(), Server::start());
    let file = built(&folder, "town.esker");
    let address = server.put("town.esker", bytes(&file));
    let cache = folder.file("cache");
    let variables = [("XDG_CACHE_HOME", cache.to_str().unwrap())];
    let first = verified(&address, &variables);
    let before = server.answers();
    assert_eq!(verified(&address, &variables), first);
    assert_eq!(server.answers() - before, 1, "the first block tells the version");
    // A folder that cannot be written is done without.
    let taken = folder.write("taken", "a file");
    assert_eq!(verified(&address, &[("XDG_CACHE_HOME", taken.to_str().unwrap())]), first);
}

#[test]
#[cfg(unix)]
fn interrupts_end_reads_from_a_server_that_stalls() {
    use crate::program::{ESKER, finish, start};
    use std::process::Command;
    use std::time::Duration;
    let (folder, server) = (Folder::new(), Server::start());
    let file = built(&folder, "town.esker");
    let address = server.put("town.esker", bytes(&file));
    for is_open in [false, true] {
        server.set(Faults {
            odd: if is_open { Odd::StallsAfter(1) } else { Odd::Stalls },
            ..Faults::default()
        });
        let mut command = Command::new(ESKER);
        command.args(["verify", &address]).env("XDG_CACHE_HOME", folder.file("cache"));
        let (child, outputs) = start(command);
        while server.answers() < 1 + u64::from(is_open) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        // Without the signal it waits for a minute, and says that the server does not answer.
        let outcome = finish(child, outputs, "stopped".into(), 100);
        assert!(outcome.error().contains("stopped"), "{}", outcome.stderr);
    }
}

#[test]
fn streaming_is_measured_beside_what_the_line_allows() {
    let (folder, server) = (Folder::new(), Server::start());
    let file = built(&folder, "town.esker");
    let address = server.put("town.esker", bytes(&file));
    server.set(Faults {
        latency: std::time::Duration::from_millis(20),
        bytes_a_second: Some(5_000_000),
        ..Faults::default()
    });
    let path = folder.write(
        "path.json",
        r#"{"coordinates": "bounds", "views": [
            {"name": "near", "eye": [0.4, 0.2, 1.2], "target": [0.6, 0.6, 0.3], "stay_s": 0.1}]}"#,
    );
    let words = ["bench", "stream", "--json", "--progress", "none", "--cold", "--line", "40,20"];
    let path = ["--path", path.to_str().unwrap(), "--size", "160x120", "--backend", "cpu"];
    let report = esker(words.into_iter().chain(path).chain([&*address])).json();
    let line = &report["line"];
    assert_eq!(line["complete"], true, "{line}");
    let number = |field: &str| line[field].as_f64().unwrap();
    assert!(number("levels") >= 2.0 && number("requests") >= 2.0, "{line}");
    assert!(number("needed_bytes") > 0.0 && number("received_bytes") > 0.0, "{line}");
    let transfer_ms = number("needed_bytes") * 8.0 / 40e3;
    assert!((number("transfer_ms") - transfer_ms).abs() < 1e-6, "{line}");
    let most = transfer_ms.max((number("levels") + 2.0) * 20.0);
    assert!((number("ratio") - number("complete_ms") / most).abs() < 1e-6, "{line}");
    // What came over the line took at least as long as it allows.
    assert!(number("complete_ms") >= number("received_bytes") * 0.5 / 5e3, "{line}");
}
