//! From runs to rows, for machines and as a table for people.

use crate::build::child::Ran;
use crate::build::program::Program;
use crate::flight::quantile;
use esker_engine::io::quantity::{grouped, readable_bytes};
use serde_json::{Value, json};
use std::path::Path;

/// The row of each program on one input, by its runs; beside those on the first input.
pub fn rows(
    input: &Path,
    programs: &[Program],
    runs: &[Vec<Ran>],
    first: &[Vec<Ran>],
) -> Vec<Value> {
    let (points, first_points) = (counted(runs), counted(first));
    let of = |wanted: fn(&Program) -> bool| {
        let at = programs.iter().position(wanted)?;
        Some(&runs[at]).filter(|runs| sound(runs))
    };
    let rival = of(|p| matches!(p, Program::Rival(_)));
    let floor = of(|p| matches!(p, Program::Decode));
    let row = |(i, program): (usize, &Program)| {
        let mut row = row(program, input, &runs[i], points, rival, floor);
        let per_point = points.zip(first_points).map(|(own, its)| its as f64 / own.max(1) as f64);
        let cpu = over(&runs[i], &first[i], |r| r.cpu_seconds);
        let cpu = cpu.filter(|_| sound(&runs[i]) && sound(&first[i]));
        row["cpu_a_point_over_first"] = json!(cpu.zip(per_point).map(|(cpu, p)| cpu * p));
        row
    };
    programs.iter().enumerate().map(row).collect()
}

/// Whether all of these runs worked.
fn sound(runs: &[Ran]) -> bool {
    !runs.is_empty() && runs.iter().all(|r| r.error.is_none())
}

/// Points of an input: ours has counted them; what a header says is the second best.
fn counted(runs: &[Vec<Ran>]) -> Option<u64> {
    let of = |runs: &Vec<Ran>| runs.iter().find_map(points_of);
    runs.get(1).and_then(of).or(runs.first().and_then(of))
}

/// The median share of `runs` in `others`, of runs beside each other: so what slows the machine for a while slows both.
fn over(others: &[Ran], runs: &[Ran], of: fn(&Ran) -> Option<f64>) -> Option<f64> {
    let each = others.iter().zip(runs);
    let each = each.filter_map(|(o, r)| Some(of(o)? / of(r)?.max(1e-9)));
    Some(quantile(&each.collect::<Vec<_>>(), 0.5)).filter(|ratio| *ratio > 0.0)
}

fn points_of(ran: &Ran) -> Option<u64> {
    ran.report["points_in"].as_u64().or(ran.report["points"].as_u64())
}

fn row(
    program: &Program,
    input: &Path,
    runs: &[Ran],
    points: Option<u64>,
    rival: Option<&Vec<Ran>>,
    floor: Option<&Vec<Ran>>,
) -> Value {
    let mut row = json!({
        "program": program.name(),
        "input": input.display().to_string(),
        "points": points,
        "runs": runs.len(),
    });
    if let Some(error) = runs.iter().find_map(|r| r.error.as_ref()) {
        row["error"] = json!(error);
        return row;
    }
    let median = |of: &dyn Fn(&Ran) -> Option<f64>| {
        let values: Vec<f64> = runs.iter().filter_map(of).collect();
        (!values.is_empty()).then(|| quantile(&values, 0.5))
    };
    let most = |of: &dyn Fn(&Ran) -> Option<u64>| runs.iter().filter_map(of).max();
    let seconds = median(&|r| Some(r.seconds)).unwrap_or(0.0);
    let cpu_seconds = median(&|r| r.cpu_seconds);
    let a_point = |seconds: f64| points.map(|n| seconds * 1e6 / n.max(1) as f64);
    let floor_cpu = floor.and_then(|runs| {
        let values: Vec<f64> = runs.iter().filter_map(|r| r.cpu_seconds).collect();
        (!values.is_empty()).then(|| quantile(&values, 0.5))
    });
    let figures = json!({
        "seconds": seconds,
        "seconds_each": runs.iter().map(|r| r.seconds).collect::<Vec<_>>(),
        "points_per_second": points.map(|n| n as f64 / seconds.max(1e-9)),
        "cpu_seconds": cpu_seconds,
        "cpu_us_a_point": cpu_seconds.and_then(a_point),
        "cpu_us_a_point_over_decode":
            cpu_seconds.zip(floor_cpu).and_then(|(own, floor)| a_point(own - floor)),
        "peak_rss_bytes": most(&|r| r.peak_rss_bytes),
        "peak_anon_bytes": most(&|r| r.report["peak_anon_bytes"].as_u64()),
        "scratch_bytes_peak": most(&|r| Some(scratch_of(r))),
        "bytes_out": most(&|r| Some(r.bytes_out)),
        "ratio": rival.and_then(|rival| over(rival, runs, |r| Some(r.seconds))),
        "cpu_ratio": rival.and_then(|rival| over(rival, runs, |r| r.cpu_seconds)),
    });
    if let (Some(row), Value::Object(figures)) = (row.as_object_mut(), figures) {
        row.extend(figures);
    }
    row
}

/// As the program itself says, which knows of files without names; else as it was seen.
fn scratch_of(ran: &Ran) -> u64 {
    let said = &ran.report;
    let said = said["scratch_bytes_peak"].as_u64().or(said["scratch_bytes"].as_u64());
    said.unwrap_or(ran.scratch_bytes_peak)
}

/// What failed first, where anything did.
pub fn failure(report: &Value) -> Option<String> {
    let rows = report["rows"].as_array()?;
    let failed: Vec<_> = rows.iter().filter(|r| r["error"].is_string()).collect();
    let first = failed.first()?;
    let said = |name: &str| first[name].as_str().unwrap_or("?");
    Some(format!(
        "{} of {} programs failed: {} on {}: {}",
        failed.len(),
        rows.len(),
        said("program"),
        said("input"),
        said("error")
    ))
}

/// What decoding took, for people.
pub fn decode_text(report: &Value) -> String {
    let number = |name: &str| report[name].as_f64().unwrap_or(0.0);
    format!(
        "{} points decoded in {:.2} s, {:.2} million a second",
        grouped(number("points") as u64),
        number("seconds"),
        number("points_per_second") / 1e6
    )
}

/// The report for people: a table an input.
pub fn text(report: &Value) -> String {
    let rows = report["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let mut lines = Vec::new();
    for same in rows.chunk_by(|a, b| a["input"] == b["input"]) {
        let points = same[0]["points"].as_u64().map_or("?".into(), grouped);
        let input = same[0]["input"].as_str().unwrap_or("?");
        lines.push(format!("{input}, {points} points, {} runs", report["runs"]));
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
        lines.extend(same.iter().map(line));
    }
    lines.join("\n")
}

fn line(row: &Value) -> String {
    let program = row["program"].as_str().unwrap_or("?");
    if let Some(error) = row["error"].as_str() {
        return format!("{program:<18}FAILED {error}");
    }
    let number = |name: &str, unit: f64| {
        row[name].as_f64().map_or("-".into(), |v| format!("{:.2}", v / unit))
    };
    let bytes = |name: &str| row[name].as_u64().map_or("-".into(), readable_bytes);
    format!(
        "{program:<18}{:>9}{:>9}{:>9}{:>9}{:>9}{:>12}{:>12}{:>12}{:>8}{:>8}",
        number("seconds", 1.0),
        number("points_per_second", 1e6),
        number("cpu_seconds", 1.0),
        number("cpu_us_a_point", 1.0),
        number("cpu_a_point_over_first", 1.0),
        bytes("peak_rss_bytes"),
        bytes("scratch_bytes_peak"),
        bytes("bytes_out"),
        number("ratio", 1.0),
        number("cpu_ratio", 1.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::program::Against;

    fn ran(seconds: f64, report: Value) -> Ran {
        Ran { seconds, cpu_seconds: Some(seconds * 2.0), bytes_out: 7, report, ..Ran::default() }
    }

    #[test]
    fn ratios_are_of_points_a_second_and_failures_are_rows() {
        let rival = Program::Rival(Against::parse("copc_converter").unwrap());
        let programs = [Program::Decode, Program::Esker, rival];
        let of = |all: [f64; 3], points: Value| all.map(|s| ran(s, points.clone())).to_vec();
        // A quarter of the points, in a sixth to a half of the CPU time.
        let first = [
            of([1.0; 3], json!({"points": 1})),
            of([1.0, 1.0, 0.5], json!({"points_in": 500_000})),
            of([3.0; 3], Value::Null),
        ];
        let mut runs = [
            of([1.0, 1.0, 9.0], json!({"points": 1})),
            of([2.0, 4.0, 3.0], json!({"points_in": 2_000_000, "scratch_bytes": 5})),
            of([6.0, 12.0, 3.0], Value::Null),
        ];
        let report = json!({"runs": 3, "rows": rows("in.las".as_ref(), &programs, &runs, &first)});
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
        assert_eq!(failure(&report), None);

        runs[2][1].error = Some("ended with exit status: 1: no".into());
        let report = json!({"runs": 3, "rows": rows("in.las".as_ref(), &programs, &runs, &first)});
        assert_eq!(report["rows"][1]["ratio"], Value::Null);
        assert_eq!(report["rows"][2]["cpu_a_point_over_first"], Value::Null);
        assert_eq!(report["rows"][2]["seconds"], Value::Null);
        let failure = failure(&report).unwrap();
        assert!(failure.contains("copc_converter on in.las: ended with"), "{failure}");
        assert!(text(&report).contains("FAILED"));
    }
}
