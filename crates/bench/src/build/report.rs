//! The report of the benchmark of building: from runs to rows, and a table of them for people.

use crate::build::child::ChildRun;
use crate::build::program::Program;
use crate::quantile::quantile;
use esker_engine::io::quantity::{grouped, readable_bytes};
use serde::Serialize;
use std::path::Path;

/// Rows of all programs and inputs.
#[derive(Clone, Debug, Serialize)]
pub struct BuildBenchReport {
    /// Runs of each row that did not fail.
    pub(super) runs: usize,
    /// A row for each program, input by input.
    pub(super) rows: Vec<BuildRow>,
}

/// One program on one input.
#[derive(Clone, Debug, Serialize)]
pub(super) struct BuildRow {
    program: String,
    input: String,
    /// Points of the input, if a program counted them.
    points: Option<u64>,
    /// Runs, up to the one that failed.
    runs: usize,
    /// CPU time a point over that of the same program on the first input.
    cpu_a_point_over_first: Option<f64>,
    #[serde(flatten)]
    outcome: Outcome,
}

/// What came of the runs of a row.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
enum Outcome {
    /// A run failed.
    Failed {
        /// Why.
        error: String,
    },
    /// All runs succeeded.
    Measured(Figures),
}

/// Medians of times and maxima of bytes over the runs of a row.
#[derive(Clone, Debug, Serialize)]
struct Figures {
    seconds: f64,
    /// Time of each run.
    seconds_each: Vec<f64>,
    points_per_second: Option<f64>,
    cpu_seconds: Option<f64>,
    cpu_us_a_point: Option<f64>,
    /// CPU time a point beyond that of decoding.
    cpu_us_a_point_over_decode: Option<f64>,
    peak_rss_bytes: Option<u64>,
    /// Greatest anonymous memory, reported by `esker build` alone.
    peak_anon_bytes: Option<u64>,
    scratch_bytes_peak: Option<u64>,
    bytes_out: Option<u64>,
    /// Time of the rival over the time of this program.
    ratio: Option<f64>,
    /// CPU time of the rival over that of this program.
    cpu_ratio: Option<f64>,
}

/// Runs of the other programs on the same input, if all of them succeeded.
#[derive(Clone, Copy)]
struct References<'a> {
    rival: Option<&'a [ChildRun]>,
    decode: Option<&'a [ChildRun]>,
}

/// Makes a row of each program on `input` from its `runs`; `first` are the runs on the first input.
pub(super) fn rows(
    input: &Path,
    programs: &[Program],
    runs: &[Vec<ChildRun>],
    first: &[Vec<ChildRun>],
) -> Vec<BuildRow> {
    let (points, first_points) = (counted_points(runs), counted_points(first));
    let runs_of = |is_it: fn(&Program) -> bool| {
        let at = programs.iter().position(is_it)?;
        Some(&runs[at][..]).filter(|runs| succeeded(runs))
    };
    let references = References {
        rival: runs_of(|p| matches!(p, Program::Rival(_))),
        decode: runs_of(|p| matches!(p, Program::Decode)),
    };
    let row = |(i, program): (usize, &Program)| {
        let per_point = points.zip(first_points).map(|(own, its)| its as f64 / own.max(1) as f64);
        let cpu = median_ratio(&runs[i], &first[i], |r| r.cpu_seconds);
        let cpu = cpu.filter(|_| succeeded(&runs[i]) && succeeded(&first[i]));
        BuildRow {
            program: program.name().into(),
            input: input.display().to_string(),
            points,
            runs: runs[i].len(),
            cpu_a_point_over_first: cpu.zip(per_point).map(|(cpu, p)| cpu * p),
            outcome: match runs[i].iter().find_map(|r| r.error.clone()) {
                Some(error) => Outcome::Failed { error },
                None => Outcome::Measured(figures(&runs[i], points, references)),
            },
        }
    };
    programs.iter().enumerate().map(row).collect()
}

/// Whether there are runs and none of them failed.
fn succeeded(runs: &[ChildRun]) -> bool {
    !runs.is_empty() && runs.iter().all(|r| r.error.is_none())
}

/// Points of an input: as Esker counted them, else as the headers claim.
fn counted_points(runs: &[Vec<ChildRun>]) -> Option<u64> {
    let of =
        |runs: &Vec<ChildRun>| runs.iter().find_map(|r| r.report.points_in.or(r.report.points));
    runs.get(1).and_then(of).or(runs.first().and_then(of))
}

/// Median of `of` in `others` over `of` in `runs`, pair by pair: a load of the machine that lasts a
/// while slows both runs of a pair.
fn median_ratio(
    others: &[ChildRun],
    runs: &[ChildRun],
    of: fn(&ChildRun) -> Option<f64>,
) -> Option<f64> {
    let pairs = others.iter().zip(runs);
    let ratios = pairs.filter_map(|(o, r)| Some(of(o)? / of(r)?.max(1e-9)));
    Some(quantile(&ratios.collect::<Vec<_>>(), 0.5)).filter(|ratio| *ratio > 0.0)
}

/// Median of a value over those runs that have it.
fn median(runs: &[ChildRun], of: fn(&ChildRun) -> Option<f64>) -> Option<f64> {
    let values: Vec<f64> = runs.iter().filter_map(of).collect();
    (!values.is_empty()).then(|| quantile(&values, 0.5))
}

fn figures(runs: &[ChildRun], points: Option<u64>, references: References<'_>) -> Figures {
    let most = |of: fn(&ChildRun) -> Option<u64>| runs.iter().filter_map(of).max();
    let seconds = median(runs, |r| Some(r.seconds)).unwrap_or(0.0);
    let cpu_seconds = median(runs, |r| r.cpu_seconds);
    let a_point = |seconds: f64| points.map(|n| seconds * 1e6 / n.max(1) as f64);
    let decode_cpu = references.decode.and_then(|runs| median(runs, |r| r.cpu_seconds));
    let rival_over = |of| references.rival.and_then(|rival| median_ratio(rival, runs, of));
    Figures {
        seconds,
        seconds_each: runs.iter().map(|r| r.seconds).collect(),
        points_per_second: points.map(|n| n as f64 / seconds.max(1e-9)),
        cpu_seconds,
        cpu_us_a_point: cpu_seconds.and_then(a_point),
        cpu_us_a_point_over_decode: cpu_seconds
            .zip(decode_cpu)
            .and_then(|(own, decode)| a_point(own - decode)),
        peak_rss_bytes: most(|r| r.peak_rss_bytes),
        peak_anon_bytes: most(|r| r.report.peak_anon_bytes),
        scratch_bytes_peak: most(|r| Some(scratch_bytes(r))),
        bytes_out: most(|r| Some(r.bytes_out)),
        ratio: rival_over(|r| Some(r.seconds)),
        cpu_ratio: rival_over(|r| r.cpu_seconds),
    }
}

/// Bytes of scratch files: as the program reports them, which counts files without names; else as
/// they were seen.
fn scratch_bytes(run: &ChildRun) -> u64 {
    let reported = run.report.scratch_bytes_peak.or(run.report.scratch_bytes);
    reported.unwrap_or(run.scratch_bytes_peak)
}

/// Describes the first failure, if there is one.
pub fn failure(report: &BuildBenchReport) -> Option<String> {
    let failed = report.rows.iter().filter_map(|row| match &row.outcome {
        Outcome::Failed { error } => Some((row, error)),
        Outcome::Measured(_) => None,
    });
    let (first, error) = failed.clone().next()?;
    Some(format!(
        "{} of {} programs failed: {} on {}: {error}",
        failed.count(),
        report.rows.len(),
        first.program,
        first.input,
    ))
}

/// Writes the report for people: a table an input.
pub fn text(report: &BuildBenchReport) -> String {
    let mut lines = Vec::new();
    for same_input in report.rows.chunk_by(|a, b| a.input == b.input) {
        let BuildRow { input, points, .. } = &same_input[0];
        let points = points.map_or("?".into(), grouped);
        lines.push(format!("{input}, {points} points, {} runs", report.runs));
        lines.push(format!(
            "{:<18}{:>9}{:>9}{:>9}{:>9}{:>9}{:>12}{:>12}{:>12}{:>8}{:>8}",
            "",
            "s",
            "Mpts/s",
            "CPU s",
            "us/pt",
            "to 1st",
            "resident",
            "scratch",
            "out",
            "ratio",
            "CPU"
        ));
        lines.extend(same_input.iter().map(line));
    }
    lines.join("\n")
}

fn line(row: &BuildRow) -> String {
    let program = &row.program;
    let figures = match &row.outcome {
        Outcome::Failed { error } => return format!("{program:<18}FAILED {error}"),
        Outcome::Measured(figures) => figures,
    };
    let number = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.2}"));
    let bytes = |value: Option<u64>| value.map_or("-".into(), readable_bytes);
    format!(
        "{program:<18}{:>9}{:>9}{:>9}{:>9}{:>9}{:>12}{:>12}{:>12}{:>8}{:>8}",
        number(Some(figures.seconds)),
        number(figures.points_per_second.map(|n| n / 1e6)),
        number(figures.cpu_seconds),
        number(figures.cpu_us_a_point),
        number(row.cpu_a_point_over_first),
        bytes(figures.peak_rss_bytes),
        bytes(figures.scratch_bytes_peak),
        bytes(figures.bytes_out),
        number(figures.ratio),
        number(figures.cpu_ratio),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::child::ChildReport;
    use crate::build::rival::Rival;
    use serde_json::{Value, json};

    fn child_run(seconds: f64, report: ChildReport) -> ChildRun {
        let cpu_seconds = Some(seconds * 2.0);
        ChildRun { seconds, cpu_seconds, bytes_out: 7, report, ..ChildRun::default() }
    }

    fn report_of(
        programs: &[Program],
        runs: &[Vec<ChildRun>],
        first: &[Vec<ChildRun>],
    ) -> BuildBenchReport {
        BuildBenchReport { runs: 3, rows: rows("in.las".as_ref(), programs, runs, first) }
    }

    #[test]
    fn ratios_are_of_points_a_second_and_failures_are_rows() {
        let rival = Program::Rival(Rival::parse("copc_converter").unwrap());
        let programs = [Program::Decode, Program::Esker, rival];
        let of = |all: [f64; 3], report: Value| {
            let report: ChildReport = serde_json::from_value(report).unwrap();
            all.map(|seconds| child_run(seconds, report.clone())).to_vec()
        };
        // A quarter of the points, in a sixth to a half of the CPU time.
        let first = [
            of([1.0; 3], json!({"points": 1})),
            of([1.0, 1.0, 0.5], json!({"points_in": 500_000})),
            of([3.0; 3], json!({})),
        ];
        let mut runs = [
            of([1.0, 1.0, 9.0], json!({"points": 1})),
            of([2.0, 4.0, 3.0], json!({"points_in": 2_000_000, "scratch_bytes": 5})),
            of([6.0, 12.0, 3.0], json!({})),
        ];
        let typed = report_of(&programs, &runs, &first);
        let report = serde_json::to_value(&typed).unwrap();
        let row = |i: usize| &report["rows"][i];
        assert_eq!((&row(1)["ratio"], &row(2)["ratio"]), (&json!(3.0), &json!(1.0)));
        assert_eq!(
            (&row(1)["seconds"], &row(1)["points_per_second"]),
            (&json!(3.0), &json!(2e6 / 3.0))
        );
        assert_eq!(
            (&row(1)["scratch_bytes_peak"], &row(2)["scratch_bytes_peak"]),
            (&json!(5), &json!(0))
        );
        assert_eq!(row(1)["cpu_us_a_point_over_decode"], 2.0);
        assert_eq!(row(2)["points"], 2_000_000);
        let over = [1, 2].map(|i| row(i)["cpu_a_point_over_first"].as_f64());
        assert_eq!(over, [Some(1.0), Some(0.5)]);
        assert_eq!(failure(&typed), None);

        runs[2][1].error = Some("ended with exit status: 1: no".into());
        let typed = report_of(&programs, &runs, &first);
        let report = serde_json::to_value(&typed).unwrap();
        assert_eq!(report["rows"][1]["ratio"], Value::Null);
        assert_eq!(report["rows"][2]["cpu_a_point_over_first"], Value::Null);
        assert_eq!(report["rows"][2]["seconds"], Value::Null);
        let failure = failure(&typed).unwrap();
        assert!(failure.contains("copc_converter on in.las: ended with"), "{failure}");
        assert!(text(&typed).contains("FAILED"));
    }
}
