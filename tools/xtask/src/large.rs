//! Builds that take too long for the gate: `cargo xtask large`. `ESKER_LARGE=stack` runs only those
//! that have this word in their names; 1,000 million points are built with `ESKER_LARGE=1G` only.
//! Each is built by the program as users run it, under a limit of anonymous memory that the system
//! enforces where it can, and verified. Prints a table; fails if a bound is exceeded. Files go to
//! the system's temporary folder (`TMPDIR`): 60 bytes a point at most.

use crate::shell::{Scratch, build_esker};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

/// Most bytes a point that scratch and output take together at any time.
const BYTES_A_POINT_MAX: f64 = 60.0;
/// Factor by which anonymous memory may exceed `--memory`.
const MARGIN: f64 = 1.05;
/// Lattice step of the generated files, metres, and places of their points: one point is so far
/// away that the rest of the scan is within one cell.
const SCALE: f64 = 0.001;
const NEAR: [i32; 3] = [123_456, -5, 99];
const FAR: [i32; 3] = [2_000_000_000, 2_000_000_000, 99];
/// A mebibyte.
const MIB: u64 = 1 << 20;

/// A build and its bounds.
struct Case {
    /// A generated scan, with a point far outside if `far`; or a stack of coincident points.
    input: &'static str,
    points: u64,
    memory_mib: u64,
}

/// Builds in the order in which they run.
const CASES: [Case; 6] = [
    Case { input: "synthetic:terrain:20M:1", points: 20_000_000, memory_mib: 512 },
    Case { input: "synthetic:terrain:100M:1", points: 100_000_000, memory_mib: 1024 },
    Case { input: "synthetic:office:20M:1", points: 20_000_000, memory_mib: 512 },
    Case { input: "stack", points: 50_000_000, memory_mib: 512 },
    Case { input: "synthetic:terrain:20M:1 far", points: 20_000_001, memory_mib: 512 },
    Case { input: "synthetic:terrain:1G:1", points: 1_000_000_000, memory_mib: 4096 },
];
/// Builds of more points run only if `ESKER_LARGE` names them.
const POINTS_MAX: u64 = 100_000_000;

/// Runs all builds.
///
/// # Errors
/// If a build fails or exceeds a bound; the other builds are run all the same.
pub fn run() -> Result<()> {
    let wanted = std::env::var("ESKER_LARGE").ok();
    let is_wanted = |case: &&Case| match &wanted {
        Some(word) => case.input.contains(word.as_str()),
        None => case.points <= POINTS_MAX,
    };
    let cases: Vec<&Case> = CASES.iter().filter(is_wanted).collect();
    ensure!(!cases.is_empty(), "ESKER_LARGE={}: no build is named so", wanted.unwrap_or_default());
    let program = build_esker()?;
    let place = Scratch::new("large")?;
    let empty_mib = empty_mib(&program, &place)?;
    println!("the empty program: {empty_mib} MiB");
    println!(
        "{:<28}{:>9}{:>9}{:>9}{:>10}{:>10}{:>9}{:>9}",
        "", "memory", "s", "Mpts/s", "anon MiB", "verify s", "disk", "out"
    );
    let mut failed = 0;
    for case in cases {
        if let Err(error) = case.run(&program, &place, empty_mib) {
            println!("{:<28}FAILED {error:#}", case.input);
            failed += 1;
        }
    }
    ensure!(failed == 0, "{failed} builds failed or broke a bound");
    Ok(())
}

impl Case {
    fn run(&self, program: &Path, place: &Scratch, empty_mib: u64) -> Result<()> {
        let out = place.file("out.esker");
        let inputs = match self.input.split_once(' ') {
            Some((generated, _)) => {
                vec![generated.into(), stack(&place.file("far.las"), FAR, 1)?]
            }
            None if self.input == "stack" => {
                vec![stack(&place.file("stack.las"), NEAR, self.points)?]
            }
            None => vec![self.input.into()],
        };
        let memory = format!("--memory={}MiB", self.memory_mib);
        let mut words: Vec<&OsStr> = vec![
            "build".as_ref(),
            "-o".as_ref(),
            out.as_os_str(),
            memory.as_ref(),
            "--scratch".as_ref(),
            place.folder().as_os_str(),
            "--json".as_ref(),
            "--progress=none".as_ref(),
        ];
        words.extend(inputs.iter().map(|input| input.as_os_str()));
        let limit_mib = empty_mib + (self.memory_mib as f64 * MARGIN) as u64;
        let start = Instant::now();
        let report = esker(program, limit_mib, &words)?;
        let seconds = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let words = ["verify".as_ref(), out.as_os_str(), "--json".as_ref()];
        let verified = esker(program, limit_mib, &words)?;
        let verify_seconds = start.elapsed().as_secs_f64();
        std::fs::remove_file(&out)?;
        let number = |name: &str| report[name].as_u64().unwrap_or(0);
        let disk = report["disk_bytes_peak"].as_u64().context("no disk_bytes_peak reported")?;
        let a_point = |bytes: u64| bytes as f64 / self.points as f64;
        println!(
            "{:<28}{:>5} MiB{seconds:>9.1}{:>9.2}{:>10}{verify_seconds:>10.1}{:>9.1}{:>9.1}",
            self.input,
            self.memory_mib,
            self.points as f64 / seconds / 1e6,
            number("peak_anon_bytes") / MIB,
            a_point(disk),
            a_point(number("bytes_out")),
        );
        ensure!(
            number("points_out") == self.points && verified["points"] == self.points,
            "{} points out, {} verified, of {}",
            number("points_out"),
            verified["points"],
            self.points
        );
        let anon_mib = number("peak_anon_bytes") / MIB;
        ensure!(
            anon_mib as f64 <= self.memory_mib as f64 * MARGIN,
            "{anon_mib} MiB of anonymous memory, of {}",
            self.memory_mib
        );
        let bytes = a_point(disk);
        ensure!(bytes <= BYTES_A_POINT_MAX, "{bytes:.1} bytes a point of scratch and output");
        let (scratch, estimated) =
            (number("scratch_bytes_peak"), number("scratch_bytes_estimated"));
        ensure!(scratch <= estimated, "{scratch} bytes of scratch, {estimated} estimated");
        Ok(())
    }
}

/// Runs the program within a limit of memory and returns its report.
fn esker(program: &Path, limit_mib: u64, words: &[&OsStr]) -> Result<Value> {
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        let line = format!("ulimit -d {} && exec \"$0\" \"$@\"", limit_mib << 10);
        shell.arg("-c").arg(OsString::from(line)).arg(program);
        shell
    } else {
        Command::new(program)
    };
    let output = command.args(words).stdin(Stdio::null()).output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{}: {}", output.status, said.trim());
    let printed = String::from_utf8_lossy(&output.stdout);
    let last = printed.lines().last().unwrap_or_default();
    serde_json::from_str(last).with_context(|| format!("no report: {last}"))
}

/// Least limit under which the program builds three points, MiB.
fn empty_mib(program: &Path, place: &Scratch) -> Result<u64> {
    let (tiny, out) = (place.file("tiny.xyz"), place.file("tiny.esker"));
    std::fs::write(&tiny, "0 0 0\n1 2 3\n4 5 6\n")?;
    let words: [&OsStr; 6] = [
        "build".as_ref(),
        tiny.as_os_str(),
        "-o".as_ref(),
        out.as_os_str(),
        "--json".as_ref(),
        "--progress=none".as_ref(),
    ];
    let (mut fails, mut works) = (0, 1024);
    while works - fails > 1 {
        let middle = u64::midpoint(fails, works);
        let outcome = esker(program, middle, &words);
        *(if outcome.is_ok() { &mut works } else { &mut fails }) = middle;
    }
    ensure!(works < 1024, "three points are not built in a gibibyte");
    Ok(works)
}

/// Writes a LAS file of coincident points with different records; the place is in millimetres.
fn stack(path: &Path, place: [i32; 3], points: u64) -> Result<PathBuf> {
    const HEADER_BYTES: usize = 227;
    let mut head = vec![0; HEADER_BYTES];
    let mut put = |at: usize, bytes: &[u8]| head[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"LASF");
    put(24, &[1, 2]);
    put(94, &(HEADER_BYTES as u16).to_le_bytes());
    put(96, &(HEADER_BYTES as u32).to_le_bytes());
    // Point format 0 and its record.
    put(105, &20u16.to_le_bytes());
    put(107, &u32::try_from(points)?.to_le_bytes());
    for (axis, c) in place.into_iter().enumerate() {
        put(131 + 8 * axis, &SCALE.to_le_bytes());
        // Greatest and least coordinate.
        (0..2).for_each(|i| put(179 + 16 * axis + 8 * i, &(f64::from(c) * SCALE).to_le_bytes()));
    }
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    file.write_all(&head)?;
    let mut record = [0; 20];
    for (axis, c) in place.into_iter().enumerate() {
        record[4 * axis..][..4].copy_from_slice(&c.to_le_bytes());
    }
    for i in 0..points {
        // Intensity, user data and source id hold 32 bits of the point's index.
        record[12..14].copy_from_slice(&(i as u16).to_le_bytes());
        record[17] = (i >> 16) as u8;
        record[18..20].copy_from_slice(&((i >> 24) as u16).to_le_bytes());
        file.write_all(&record)?;
    }
    file.flush()?;
    Ok(path.to_owned())
}
