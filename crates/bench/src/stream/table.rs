//! The report of the benchmark of streaming for people: table 3 of `kanzok2015` with the times of
//! its table 2, a line for each run with and without the depth test; and below it what the paper
//! does not report.

use crate::stream::report::{StreamReport, StreamRun, ViewFigures};
use esker_engine::io::quantity::{grouped, readable_bytes};
use esker_engine::io::stages;

/// Table of all runs, then details of each.
pub fn text(report: &StreamReport) -> String {
    let runs = report.runs();
    let mut lines = Vec::new();
    // Runs over other views get a table of their own.
    for same_views in runs.chunk_by(|a, b| names(a) == names(b)) {
        lines.extend(table(same_views));
        lines.push(String::new());
    }
    for run in runs {
        lines.extend(details(run));
    }
    lines.join("\n")
}

fn names(run: &StreamRun) -> Vec<&str> {
    run.views.iter().map(|v| v.figures.name.as_str()).collect()
}

/// Writes 12345678 points as `12.3 m`, like the paper.
fn readable_points(points: u64) -> String {
    match points as f64 {
        n if n < 1e3 => format!("{n:.0}"),
        n if n < 1e6 => format!("{:.0} k", n / 1e3),
        n => format!("{:.1} m", n / 1e6),
    }
}

/// Lines of a table: for each view the time until it was complete, nodes, points, time of choosing,
/// time of drawing, and frames a second.
fn table(runs: &[StreamRun]) -> Vec<String> {
    let mut head = vec![format!("{:<12}", "")];
    let mut columns = vec![format!("{:<12}", "")];
    for name in runs.first().map(names).unwrap_or_default() {
        head.push(format!("{:>8} | {name:<36}", "loading"));
        columns.push(format!(
            "{:>8} | {:>6} {:>8} {:>6} {:>7} {:>5}",
            "s", "nodes", "points", "LOD ms", "draw ms", "fps"
        ));
    }
    let mut lines = vec![head.concat(), columns.concat()];
    for run in runs {
        let title = if run.depth_test { "with z-test" } else { "w/o z-test" };
        lines.push(format!(
            "{}, {} points a node, {} settings",
            run.file,
            run.node_capacity,
            run.settings.name(),
        ));
        lines.push(row(title, run.views.iter().map(|v| &v.figures)));
        let without = run.views.iter().map(|v| v.without_depth_test.as_ref());
        if let Some(without) = without.collect::<Option<Vec<_>>>() {
            lines.push(row("w/o z-test", without.into_iter()));
        }
    }
    lines
}

fn row<'a>(title: &str, views: impl Iterator<Item = &'a ViewFigures>) -> String {
    let mut row = format!("{title:<12}");
    for view in views {
        // A view that never became complete is marked.
        let mark = if view.is_complete { "" } else { ">" };
        row += &format!(
            "{:>8} | {:>6} {:>8} {:>6.2} {:>7.1} {:>5.1}",
            format!("{mark}{:.2}", view.complete_ms / 1e3),
            grouped(view.nodes),
            readable_points(view.points),
            view.lod_ms,
            view.render_ms,
            view.fps,
        );
    }
    row
}

/// Lines about a run that the paper has no columns for.
fn details(run: &StreamRun) -> Vec<String> {
    let rate = |bytes_per_s: f64| readable_bytes(bytes_per_s as u64);
    let mut lines = vec![
        format!(
            "{}: {} points in {} nodes of {} ({} settings); structure {} ({} bytes a node), file {}",
            run.file,
            grouped(run.points),
            grouped(run.nodes as u64),
            run.node_capacity,
            run.settings.name(),
            readable_bytes(run.structure_bytes),
            run.table_bytes_a_node,
            readable_bytes(run.file_bytes),
        ),
        format!("  drawn    by {}, {}", drawn_by(run), passes(run)),
        format!(
            "  frames   {}; p50 {:.1} ms, p99 {:.1}, longest {:.1}; {} waits of the render thread; {:.0} % within 100 ms",
            run.frames,
            run.frame_ms_p50,
            run.frame_ms_p99,
            run.frame_ms_max,
            run.render_stalls,
            run.frames_within_100_ms * 100.0,
        ),
        format!(
            "  choices  p50 {:.2} ms, p99 {:.2}, longest {:.2}",
            run.lod_ms_p50, run.lod_ms_p99, run.lod_ms_max,
        ),
        format!(
            "  memory   {} resident, {} the empty program; budgets {} + {} ({} of the latter used){}",
            readable_bytes(run.peak_rss_bytes),
            readable_bytes(run.empty_rss_bytes),
            readable_bytes(run.budget_ram_bytes),
            readable_bytes(run.budget_gpu_bytes),
            readable_bytes(run.peak_gpu_bytes),
            if run.budget_exceeded { ": EXCEEDED" } else { "" },
        ),
        format!(
            "  disk     {} read in {} reads, {} of it requested, {}/s while frames were drawn; {}/s a plain sequential read",
            readable_bytes(run.read_bytes),
            run.reads,
            readable_bytes(run.useful_bytes),
            rate(run.flight_bytes_per_s),
            rate(run.sequential_bytes_per_s),
        ),
    ];
    let loading = &run.loading;
    lines.push(format!(
        "  loading  `{}` ({}) {} at {}/s; plain reads of its ranges, 8 in flight, {}/s: ratio {:.2} (median of {})",
        loading.view,
        readable_bytes(loading.bytes),
        if loading.from_cold { "from cold" } else { "again" },
        rate(loading.streamed_bytes_per_s),
        rate(loading.plain_bytes_per_s),
        loading.ratio,
        loading.runs,
    ));
    if let Some(line) = &run.line {
        lines.push(format!(
            "  line     `{}` {} after {:.2} s, {} in {} requests; {} needed over {} Mbit/s are {:.2} s, {} levels {:.2} s: ratio {:.2}",
            line.view,
            if line.is_complete { "complete" } else { "NOT complete" },
            line.complete_ms / 1e3,
            readable_bytes(line.received_bytes),
            line.requests,
            readable_bytes(line.needed_bytes),
            line.mbit_s,
            line.transfer_ms / 1e3,
            line.levels,
            line.trips_ms / 1e3,
            line.ratio,
        ));
    }
    for t in &run.transitions {
        lines.push(format!(
            "  to {:<10} {} frames; p50 {:.1} ms, p99 {:.1}, longest {:.1}; {} read",
            t.to,
            t.frames,
            t.frame_ms_p50,
            t.frame_ms_p99,
            t.frame_ms_max,
            readable_bytes(t.read_bytes),
        ));
    }
    lines.extend(run.fault.as_ref().map(|fault| format!("  fault    {fault}")));
    lines
}

fn drawn_by(run: &StreamRun) -> String {
    match (&run.adapter, &run.backend_note) {
        (Some(adapter), _) => format!("{adapter}, {}", run.gpu_path),
        (None, Some(note)) => format!("the CPU ({note})"),
        (None, None) => "the CPU".into(),
    }
}

/// Times of the passes of the last view.
fn passes(run: &StreamRun) -> String {
    let last = run.views.last().map(|view| view.figures.passes_ms).unwrap_or_default();
    format!("last view, ms: {}", stages::text(&[], &last, "all"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::report::ViewReport;

    fn run(file: &str) -> StreamRun {
        let figures = |nodes: u64| ViewFigures {
            name: "overview".into(),
            nodes,
            points: 12_345_678,
            lod_ms: 1.5,
            render_ms: 40.0,
            complete_ms: 2500.0,
            is_complete: true,
            fps: 24.0,
            ..ViewFigures::default()
        };
        let without_depth_test = Some(figures(2000));
        StreamRun {
            file: file.into(),
            node_capacity: 65536,
            depth_test: true,
            views: vec![ViewReport { figures: figures(1234), without_depth_test }],
            fault: Some("a.esker: cut short".into()),
            ..StreamRun::default()
        }
    }

    #[test]
    fn a_table_has_a_row_with_and_one_without_the_depth_test() {
        let text = text(&StreamReport::One(Box::new(run("a.esker"))));
        let rows: Vec<_> = text.lines().filter(|l| l.contains("z-test")).collect();
        assert_eq!(rows.len(), 2, "{text}");
        assert!(
            rows[0].contains("1,234") && rows[0].contains("12.3 m") && rows[0].contains("2.50")
        );
        assert!(rows[1].contains("2,000"), "{text}");
        assert!(text.contains("cut short"));
    }

    #[test]
    fn several_runs_are_one_table() {
        let text = text(&StreamReport::Several { runs: vec![run("a.esker"), run("b.esker")] });
        assert_eq!(text.matches("draw ms").count(), 1, "{text}");
        assert_eq!(text.matches("with z-test").count(), 2, "{text}");
        assert!(!text.contains("EXCEEDED"));
    }
}
