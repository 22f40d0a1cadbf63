//! Ctrl-C while a build runs gives an exit code other than 0, a message, and leaves no file:
//! neither under the final name nor beside it nor in the scratch folder.

use libtest_mimic::Trial;

#[cfg(not(unix))]
pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(crate::missing("interrupt: Ctrl-C leaves no file"));
}

#[cfg(unix)]
pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(crate::trial("interrupt: Ctrl-C leaves no file", unix::leaves_no_file));
}

#[cfg(unix)]
mod unix {
    use crate::folder::Folder;
    use crate::program::{ESKER, finish, start};
    use std::fmt::Write;
    use std::process::Command;
    use std::time::{Duration, Instant};

    pub fn leaves_no_file() {
        let folder = Folder::new();
        let mut text = String::new();
        for i in 0u64..3_000_000 {
            // Scattered by a multiplicative hash, in millimetres.
            let at = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            writeln!(text, "{}.{:03} {} {}", at >> 54, i % 1000, at >> 44 & 1023, at >> 34 & 1023)
                .unwrap();
        }
        let scan = folder.write("scan.xyz", &text);
        let scratch = folder.file("scratch");
        std::fs::create_dir(&scratch).unwrap();
        let mut early = 0;
        for wait_ms in [0, 100, 400, 900] {
            let mut command = Command::new(ESKER);
            command.arg("build").arg(&scan).arg("-o").arg(folder.file("out.esker"));
            command.arg("--scratch").arg(&scratch);
            let (child, outputs) = start(command);
            wait_for_partial(&folder);
            std::thread::sleep(Duration::from_millis(wait_ms));
            let id = child.id().to_string();
            let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
            let outcome = finish(child, outputs, format!("stopped after {wait_ms} ms"), 30);
            if outcome.code == Some(0) {
                // The build ended before the signal.
                std::fs::remove_file(folder.file("out.esker")).unwrap();
                continue;
            }
            assert!(sent.success());
            early += 1;
            assert!(outcome.error().contains("stopped"), "{}", outcome.stderr);
            assert_eq!(folder.names(), ["scan.xyz", "scratch"], "after {wait_ms} ms");
            assert_eq!(std::fs::read_dir(&scratch).unwrap().count(), 0, "scratch is empty");
        }
        assert!(early > 0, "no build was stopped");
    }

    /// Waits until the build has begun to write; it reads the scan from then on.
    fn wait_for_partial(folder: &Folder) {
        let deadline = Instant::now() + Duration::from_secs(60);
        while !folder.names().iter().any(|n| n.contains("partial")) {
            assert!(Instant::now() < deadline, "the build never began to write");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}
