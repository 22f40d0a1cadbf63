//! Builds that are ended by `kill -9`, by Ctrl-C or by a full disk continue with `--resume`: the
//! file is byte-identical, and no other file is left.

use libtest_mimic::Trial;

#[cfg(not(unix))]
pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(crate::missing("resume: killed builds go on"));
}

#[cfg(unix)]
pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(crate::trial("resume: killed at twenty moments", unix::killed));
    trials.push(crate::trial(
        "resume: Ctrl-C, then a changed input, then continued",
        unix::interrupted,
    ));
    trials.push(crate::trial("resume: after a full disk", unix::full_disk));
}

#[cfg(unix)]
mod unix {
    use crate::folder::Folder;
    use crate::program::{ESKER, esker, esker_under, finish, start};
    use std::io::Write;
    use std::path::PathBuf;
    use std::process::Command;
    use std::time::{Duration, Instant};

    /// Points with so many attributes of eight bytes that their rows exceed the least memory.
    const POINTS: u64 = 700_000;
    const ATTRIBUTES: u64 = 16;

    fn mixed(i: u64) -> u64 {
        let z = i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (z ^ z >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11
    }

    /// A scan, the folder of its output, and its scratch folder.
    struct Place {
        folder: Folder,
        scan: PathBuf,
    }

    impl Place {
        fn new() -> Self {
            let folder = Folder::new();
            let mut head =
                format!("ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\n");
            ["x", "y", "z"].iter().for_each(|c| head += &format!("property float {c}\n"));
            (0..ATTRIBUTES).for_each(|a| head += &format!("property double a{a}\n"));
            let mut bytes = (head + "end_header\n").into_bytes();
            for i in 0..POINTS {
                let at = [mixed(3 * i) % 4096, mixed(3 * i + 1) % 4096, mixed(3 * i + 2) % 64];
                at.iter().for_each(|c| bytes.extend((*c as f32).to_le_bytes()));
                (0..ATTRIBUTES).for_each(|a| bytes.extend(((i + a) as f64).to_le_bytes()));
            }
            let scan = folder.file("scan.ply");
            std::fs::File::create(&scan).unwrap().write_all(&bytes).unwrap();
            std::fs::create_dir(folder.file("scratch")).unwrap();
            Self { folder, scan }
        }

        fn words(&self, more: &[&str]) -> Vec<PathBuf> {
            let mut words = vec!["build".into(), self.scan.clone(), "-o".into(), self.out()];
            let how = ["--memory", "256MiB", "--node-capacity", "4096", "--json", "--scratch"];
            words.extend(how.map(PathBuf::from));
            words.push(self.folder.file("scratch"));
            words.extend(["--progress", "none"].iter().chain(more).map(PathBuf::from));
            words
        }

        fn out(&self) -> PathBuf {
            self.folder.file("out.esker")
        }

        /// Asserts that only the output file exists; reads and deletes it.
        fn take(&self) -> Vec<u8> {
            assert_eq!(self.folder.names(), ["out.esker", "scan.ply", "scratch"]);
            assert_eq!(std::fs::read_dir(self.folder.file("scratch")).unwrap().count(), 0);
            let bytes = std::fs::read(self.out()).unwrap();
            std::fs::remove_file(self.out()).unwrap();
            bytes
        }

        /// Starts a build and waits until its journal has `bytes` bytes.
        fn started(
            &self,
            more: &[&str],
            journal_bytes: u64,
        ) -> (std::process::Child, [std::fs::File; 2]) {
            let mut command = Command::new(ESKER);
            command.args(self.words(more));
            let (mut child, outputs) = start(command);
            let journal = self.folder.file(".out.esker.journal");
            let deadline = Instant::now() + Duration::from_secs(100);
            while journal.metadata().map_or(0, |m| m.len()) < journal_bytes {
                assert!(Instant::now() < deadline, "the build never got so far");
                assert!(child.try_wait().unwrap().is_none(), "the build ended before");
                std::thread::sleep(Duration::from_millis(2));
            }
            (child, outputs)
        }
    }

    pub fn killed() {
        let place = Place::new();
        let start_time = Instant::now();
        let report = esker(place.words(&[])).json();
        let whole_ms = start_time.elapsed().as_millis() as u64;
        assert!(report["scratch_bytes"].as_u64() > Some(0), "rows fit memory: {report}");
        let [disk, scratch, out] = ["disk_bytes_peak", "scratch_bytes_peak", "bytes_out"]
            .map(|name| report[name].as_u64().unwrap());
        assert!(disk >= scratch.max(out) && disk <= scratch + out, "{report}");
        let whole = place.take();
        let (mut kills, mut begun) = (0, 0);
        while kills < 20 {
            // The same build is killed later and later, until it finishes first.
            for more in [&[][..], &["--resume"]].into_iter().chain([&["--resume"][..]; 6]) {
                let mut command = Command::new(ESKER);
                command.args(place.words(more));
                let (mut child, outputs) = start(command);
                std::thread::sleep(Duration::from_millis(mixed(kills) % (whole_ms / 2)));
                if child.try_wait().unwrap().is_some() {
                    finish(child, outputs, "a killed build".into(), 1).json();
                    break;
                }
                child.kill().unwrap();
                child.wait().unwrap();
                kills += 1;
                begun += u32::from(place.folder.file(".out.esker.journal").exists());
                assert!(!place.out().exists() || std::fs::read(place.out()).unwrap() == whole);
            }
            if !place.out().exists() {
                esker(place.words(&["--resume"])).json();
            }
            // If it was killed after the file got its name, hidden files may be left; the next
            // build deletes them.
            if place.folder.names().len() > 3 {
                esker(place.words(&[])).json();
            }
            assert!(place.take() == whole, "other bytes after {kills} kills");
        }
        assert!(begun > 0, "no build was killed after it had something to keep");
    }

    pub fn interrupted() {
        let place = Place::new();
        let (child, outputs) = place.started(&[], 1000);
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        let outcome = finish(child, outputs, "interrupted".into(), 60);
        assert!(outcome.error().contains("stopped"), "{}", outcome.stderr);
        assert!(outcome.error().contains("--resume"), "{}", outcome.stderr);
        assert!(!place.out().exists());
        // Other options, another modification time, another size.
        let error = |more: &[&str]| esker(place.words(more)).error().to_string();
        let other = error(&["--resume", "--compress", "small"]);
        assert!(other.contains("--compress was fast, and is small"), "{other}");
        let scan = std::fs::File::options().write(true).open(&place.scan).unwrap();
        let time = scan.metadata().unwrap().modified().unwrap();
        scan.set_modified(time + Duration::from_secs(7)).unwrap();
        let other = error(&["--resume"]);
        assert!(other.contains("the time of change of") && other.contains("scan.ply"), "{other}");
        let length = scan.metadata().unwrap().len();
        scan.set_len(length + 1).unwrap();
        let other = error(&["--resume"]);
        assert!(other.contains("the size of") && other.contains("scan.ply"), "{other}");
        scan.set_len(length).unwrap();
        scan.set_modified(time).unwrap();
        esker(place.words(&["--resume"])).json();
        let resumed = place.take();
        // Without --resume the build starts from the beginning, and says what is lost.
        let (mut child, _) = place.started(&[], 1000);
        child.kill().unwrap();
        child.wait().unwrap();
        let afresh = esker(place.words(&[]));
        afresh.json();
        let note = "out.esker: an earlier build of it was cut; it is begun afresh (--resume would";
        assert!(afresh.stderr.contains(note), "{}", afresh.stderr);
        assert!(place.take() == resumed);
    }

    pub fn full_disk() {
        let place = Place::new();
        esker(place.words(&[])).json();
        let whole = place.take();
        // Limits of the size of a file, KiB: scratch files need more on few cores, the output on
        // any number.
        for kib in [20 << 10, 40 << 10] {
            // The limit counts blocks of 512 bytes; without the trap a signal would end the
            // program.
            let limit = format!("trap '' XFSZ && ulimit -f {}", kib * 2);
            let outcome = esker_under(&limit, place.words(&["--resume"]));
            assert!(outcome.error().contains("--resume"), "{}", outcome.stderr);
            assert!(!place.out().exists());
        }
        esker(place.words(&["--resume"])).json();
        assert!(place.take() == whole);
    }
}
