//! Reports of benchmarks for people: the table that kanzok2015 has as table 3 (with the times of its
//! table 2), a line for each run with and without the depth test; and below it what the paper does not
//! say.

use esker_engine::io::quantity::{grouped, readable_bytes};
use esker_engine::io::stages::taken;
use serde_json::Value;

/// The report of one run, or of several (`runs`).
pub fn text(report: &Value) -> String {
    let one = std::slice::from_ref(report);
    let runs = report["runs"].as_array().map_or(one, Vec::as_slice);
    let mut lines = Vec::new();
    // Runs over other views are another table.
    for same in runs.chunk_by(|a, b| names(a) == names(b)) {
        lines.extend(table(same));
        lines.push(String::new());
    }
    for run in runs {
        lines.extend(details(run));
    }
    lines.join("\n")
}

fn names(run: &Value) -> Vec<&str> {
    list(&run["views"]).iter().filter_map(|v| v["name"].as_str()).collect()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(0.0)
}

fn bytes(value: &Value) -> String {
    readable_bytes(number(value) as u64)
}

/// `12345678` as `12.3 m`: the paper's way.
fn points(value: &Value) -> String {
    match number(value) {
        n if n < 1e3 => format!("{n:.0}"),
        n if n < 1e6 => format!("{:.0} k", n / 1e3),
        n => format!("{:.1} m", n / 1e6),
    }
}

/// Each view: nodes, points, choosing, drawing, frames a second, and before it the time until it was
/// complete.
fn table(runs: &[Value]) -> Vec<String> {
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
        let with = if run["depth_test"] == false { "w/o z-test" } else { "with z-test" };
        lines.push(format!(
            "{}, {} points a node, {} settings",
            run["file"].as_str().unwrap_or("?"),
            run["node_capacity"],
            run["settings"].as_str().unwrap_or("?"),
        ));
        lines.push(row(with, list(&run["views"]).iter()));
        let without: Vec<_> =
            list(&run["views"]).iter().map(|v| &v["without_depth_test"]).collect();
        if without.iter().all(|v| v.is_object()) {
            lines.push(row("w/o z-test", without.into_iter()));
        }
    }
    lines
}

fn row<'a>(title: &str, views: impl Iterator<Item = &'a Value>) -> String {
    let mut row = format!("{title:<12}");
    for v in views {
        // What never became complete is marked.
        let mark = if v["complete"] == false { ">" } else { "" };
        row += &format!(
            "{:>8} | {:>6} {:>8} {:>6.2} {:>7.1} {:>5.1}",
            format!("{mark}{:.2}", number(&v["complete_ms"]) / 1e3),
            grouped(number(&v["nodes"]) as u64),
            points(&v["points"]),
            number(&v["lod_ms"]),
            number(&v["render_ms"]),
            number(&v["fps"]),
        );
    }
    row
}

/// What the paper does not say.
fn details(run: &Value) -> Vec<String> {
    let n = |name: &str| number(&run[name]);
    let mut lines = vec![
        format!(
            "{}: {} points in {} nodes of {} ({} settings); structure {} ({} bytes a node), file {}",
            run["file"].as_str().unwrap_or("?"),
            grouped(n("points") as u64),
            grouped(n("nodes") as u64),
            run["node_capacity"],
            run["settings"].as_str().unwrap_or("?"),
            bytes(&run["structure_bytes"]),
            run["table_bytes_a_node"],
            bytes(&run["file_bytes"]),
        ),
        format!("  drawn    by {}, {}", drawn_by(run), passes(run)),
        format!(
            "  frames   {}; p50 {:.1} ms, p99 {:.1}, longest {:.1}; {} waits of the render thread; {:.0} % within 100 ms",
            run["frames"],
            n("frame_ms_p50"),
            n("frame_ms_p99"),
            n("frame_ms_max"),
            run["render_stalls"],
            n("frames_within_100_ms") * 100.0,
        ),
        format!(
            "  choices  p50 {:.2} ms, p99 {:.2}, longest {:.2}",
            n("lod_ms_p50"),
            n("lod_ms_p99"),
            n("lod_ms_max"),
        ),
        format!(
            "  memory   {} resident, {} the empty program; budgets {} + {} ({} of the latter used){}",
            bytes(&run["peak_rss_bytes"]),
            bytes(&run["empty_rss_bytes"]),
            bytes(&run["budget_ram_bytes"]),
            bytes(&run["budget_gpu_bytes"]),
            bytes(&run["peak_gpu_bytes"]),
            if run["budget_exceeded"] == true { ": EXCEEDED" } else { "" },
        ),
        format!(
            "  disk     {} read in {} reads, {} of it asked for, {}/s while frames were drawn; {}/s a plain sequential read",
            bytes(&run["read_bytes"]),
            run["reads"],
            bytes(&run["useful_bytes"]),
            bytes(&run["flight_bytes_per_s"]),
            bytes(&run["sequential_bytes_per_s"]),
        ),
    ];
    let loading = &run["loading"];
    if loading.is_object() {
        lines.push(format!(
            "  loading  `{}` ({}) {} at {}/s; plain reads of its ranges, 8 in flight, {}/s: ratio {:.2} (median of {})",
            loading["view"].as_str().unwrap_or("?"),
            bytes(&loading["bytes"]),
            if loading["from_cold"] == true { "from cold" } else { "again" },
            bytes(&loading["streamed_bytes_per_s"]),
            bytes(&loading["plain_bytes_per_s"]),
            number(&loading["ratio"]),
            loading["runs"],
        ));
    }
    for t in list(&run["transitions"]) {
        lines.push(format!(
            "  to {:<10} {} frames; p50 {:.1} ms, p99 {:.1}, longest {:.1}; {} read",
            t["to"].as_str().unwrap_or("?"),
            t["frames"],
            number(&t["frame_ms_p50"]),
            number(&t["frame_ms_p99"]),
            number(&t["frame_ms_max"]),
            bytes(&t["read_bytes"]),
        ));
    }
    if let Some(fault) = run["fault"].as_str() {
        lines.push(format!("  fault    {fault}"));
    }
    lines
}

fn drawn_by(run: &Value) -> String {
    match (run["adapter"].as_str(), run["backend_note"].as_str()) {
        (Some(adapter), _) => format!("{adapter}, {}", run["gpu_path"].as_str().unwrap_or("?")),
        (None, Some(note)) => format!("the CPU ({note})"),
        (None, None) => "the CPU".into(),
    }
}

/// Times of the passes of the last view.
fn passes(run: &Value) -> String {
    let last = list(&run["views"]).last().map_or(&Value::Null, |v| &v["passes_ms"]);
    format!("last view, ms: {}", taken(last, &[], "all"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn run(file: &str) -> Value {
        let figures = |nodes: u64| {
            json!({
                "name": "overview", "nodes": nodes, "points": 12_345_678, "lod_ms": 1.5, "render_ms": 40.0,
                "complete_ms": 2500.0, "complete": true, "fps": 24.0,
            })
        };
        let mut view = figures(1234);
        view["without_depth_test"] = figures(2000);
        json!({
            "file": file, "node_capacity": 65536, "settings": "own", "depth_test": true, "views": [view],
            "budget_exceeded": false, "fault": "a.esker: cut short",
        })
    }

    #[test]
    fn a_table_has_a_row_with_and_one_without_the_depth_test() {
        let text = text(&run("a.esker"));
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
        let text = text(&json!({"runs": [run("a.esker"), run("b.esker")]}));
        assert_eq!(text.matches("draw ms").count(), 1, "{text}");
        assert_eq!(text.matches("with z-test").count(), 2, "{text}");
        assert!(!text.contains("EXCEEDED"));
    }

    #[test]
    fn an_object_without_fields_is_no_reason_to_panic() {
        assert!(!text(&json!({})).is_empty());
    }
}
