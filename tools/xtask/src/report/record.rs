//! The folder of `bench/results` that reports go to, `DATE-MACHINE`, with its list of files, and
//! what names date, machine and commit.

use crate::shell::output;
use anyhow::{Context, Result};
use std::path::Path;
use std::time::SystemTime;

/// Folder of all results.
const RESULTS: &str = "bench/results";
/// Files that what is measured depends on.
const MEASURED: [&str; 4] = ["crates", "shaders", "Cargo.toml", "Cargo.lock"];

/// Where and of what results are.
#[derive(Clone, Debug)]
pub struct Record {
    /// Day of the run, `YYYY-MM-DD`.
    pub date: String,
    /// Number and type of the cores, such as `2core-epyc`.
    pub machine: String,
    /// Identifier in `bench/machines.md`.
    pub id: String,
    /// Commit that is measured.
    pub commit: String,
}

impl Record {
    /// Names of this run.
    ///
    /// # Errors
    /// If git or the clock fail.
    pub fn new() -> Result<Self> {
        let mut commit = git(&["rev-parse", "--short=7", "HEAD"])?.trim().to_owned();
        let mut words = vec!["status", "--porcelain", "--"];
        words.extend(MEASURED);
        if !git(&words)?.trim().is_empty() {
            println!("report: the working tree differs from commit {commit}");
            commit.push_str("-changed");
        }
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?;
        let machine = machine();
        Ok(Self { date: date(since.as_secs()), id: id_of(&machine)?, machine, commit })
    }

    /// Saves a report by its name without the commit, and lists it with the command that made it;
    /// returns its path.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn save(&self, what: &str, report: &str, command: &str) -> Result<String> {
        let folder = format!("{RESULTS}/{}-{}", self.date, self.machine);
        std::fs::create_dir_all(&folder).with_context(|| folder.clone())?;
        let name = format!("{what}-{}.json", self.commit);
        let path = format!("{folder}/{name}");
        std::fs::write(&path, format!("{report}\n")).with_context(|| path.clone())?;
        let list = format!("{folder}/README.md");
        let before = match Path::new(&list).exists() {
            true => std::fs::read_to_string(&list).with_context(|| list.clone())?,
            false => self.head(),
        };
        let row = format!("| [{name}]({name}) | {} | `{command}` |", self.commit);
        std::fs::write(&list, with_row(&before, &name, &row)).with_context(|| list.clone())?;
        Ok(path)
    }

    /// The list of a folder that has no files yet.
    fn head(&self) -> String {
        format!(
            "# {}, {}\n\nThe machine is described in [machines.md](../../machines.md), the scans in\n\
             [the list of scenes](../../../docs/evidence/scenes.json).\n\n\
             | file | commit | command |\n|---|---|---|\n",
            self.date, self.id
        )
    }
}

/// The list with the row of a file, in place of an older one.
fn with_row(list: &str, name: &str, row: &str) -> String {
    let is_old = |line: &&str| line.starts_with(&format!("| [{name}]"));
    let mut lines: Vec<&str> = list.lines().filter(|line| !is_old(line)).collect();
    let end = lines.iter().rposition(|line| line.starts_with('|')).map_or(lines.len(), |at| at + 1);
    lines.insert(end, row);
    lines.join("\n") + "\n"
}

fn git(words: &[&str]) -> Result<String> {
    output("git".as_ref(), words)
}

/// Number of the cores and their type, from the description of the processor.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let processor = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    named(cores, &processor)
}

fn named(cores: usize, processor: &str) -> String {
    let field = |name: &str| {
        let line = processor.lines().find(|line| line.starts_with(name));
        line.and_then(|line| line.split_once(':')).map_or("", |(_, value)| value)
    };
    let model = field("model name").to_lowercase();
    let kind = ["epyc", "xeon", "ryzen", "core"].into_iter().find(|kind| model.contains(kind));
    let kind = kind.unwrap_or(std::env::consts::ARCH);
    let has_avx512 = field("flags").split_whitespace().any(|flag| flag == "avx512f");
    format!("{cores}core-{kind}{}", if has_avx512 { "-avx512" } else { "" })
}

/// Identifier of a machine, by the heading of the newest folder of results from it.
fn id_of(machine: &str) -> Result<String> {
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(RESULTS).context(RESULTS)? {
        folders.push(entry?.path());
    }
    folders.sort();
    let is_own = |path: &&std::path::PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.get("2026-01-01-".len()..) == Some(machine)
    };
    let heading = |path: &std::path::PathBuf| {
        let text = std::fs::read_to_string(path.join("README.md")).ok()?;
        Some(text.lines().next()?.rsplit_once(", ")?.1.to_owned())
    };
    let id = folders.iter().rev().filter(is_own).find_map(heading);
    Ok(id.unwrap_or_else(|| {
        println!("report: {machine} is new: add it to bench/machines.md");
        machine.to_owned()
    }))
}

/// The day of a time in seconds since 1970, in the proleptic Gregorian calendar.
fn date(seconds: u64) -> String {
    // Days since the first of March of the year 0; years begin in March.
    let days = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = era * 400 + year + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        assert_eq!(date(0), "1970-01-01");
        assert_eq!(date(951_782_400), "2000-02-29");
        assert_eq!(date(951_782_400 + 86_400), "2000-03-01");
        assert_eq!(date(1_798_675_199), "2026-12-30");
        assert_eq!(date(1_798_761_600), "2027-01-01");
    }

    #[test]
    fn machines_are_named_by_cores_and_processor() {
        let text = "model name\t: AMD EPYC 7B13\nflags\t\t: fpu avx2\n";
        assert_eq!(named(2, text), "2core-epyc");
        assert_eq!(
            named(16, "model name : Intel(R) Xeon(R)\nflags : avx512f\n"),
            "16core-xeon-avx512"
        );
    }

    #[test]
    fn a_file_has_one_row() {
        let list = "# A\n\n| file |\n|---|\n| [a.json](a.json) | old |\n\nafter\n";
        let once = with_row(list, "b.json", "| [b.json](b.json) |");
        assert_eq!(once.lines().nth(5), Some("| [b.json](b.json) |"));
        assert_eq!(with_row(&once, "b.json", "| [b.json](b.json) |"), once);
        assert!(once.ends_with("\nafter\n"));
    }
}
