//! Table 1 for people.

use esker_engine::io::quantity::grouped;
use serde_json::Value;

/// A line for each model, size, method and backend.
pub fn text(report: &Value) -> String {
    let rows = report["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let mut lines = vec![format!(
        "{:<18} {:>11} {:>10} {:<14} {:<7} {:>9} {:>9} {:>8} {:>9} {:>9} {:>14} {:>10} {:>9}",
        "model",
        "points",
        "size",
        "method",
        "backend",
        "project",
        "pull-push",
        "shade",
        "total ms",
        "copy",
        "GPU floor",
        "Mpoints/s",
        "paper ms"
    )];
    lines.extend(rows.iter().map(row));
    lines.extend(rows.iter().filter_map(beside_full_screen));
    lines.extend(report["adapter"].as_str().map(|name| format!("gpu: {name}")));
    lines.extend(report["note"].as_str().map(|note| format!("the CPU alone is measured: {note}")));
    lines.join("\n")
}

fn row(row: &Value) -> String {
    let number = |name: &str| row[name].as_f64().unwrap_or(0.0);
    let word = |name: &str| row[name].as_str().unwrap_or("?");
    format!(
        "{:<18} {:>11} {:>10} {:<14} {:<7} {:>9.2} {:>9.2} {:>8.2} {:>9.2} {:>9.2} {:>14} {:>10.1} {:>9}",
        word("model"),
        grouped(row["points"].as_u64().unwrap_or(0)),
        format!("{}x{}", row["width"], row["height"]),
        method(row),
        word("backend"),
        number("project_ms"),
        number("pull_push_ms"),
        number("shade_ms"),
        number("total_ms"),
        number("copy_floor_ms"),
        floor(row),
        number("mpoints_per_s"),
        row["paper_total_ms"].as_f64().map_or("-".into(), |ms| ms.to_string()),
    )
}

/// The floor of a GPU, and how many times as long the frame takes.
fn floor(row: &Value) -> String {
    match [&row["gpu_floor_ms"], &row["over_floor"]].map(Value::as_f64) {
        [Some(floor), Some(over)] => format!("{floor:.2} (x{over:.1})"),
        _ => "-".into(),
    }
}

/// A line a radius: how much of the picture it covers, and its time beside that of a full screen.
fn beside_full_screen(row: &Value) -> Option<String> {
    let full = row["full_screen_ms"].as_f64()?;
    let number = |name: &str| row[name].as_f64().unwrap_or(0.0);
    let pixels = number("width") * number("height");
    let (factor, total) = (number("radius_factor"), number("total_ms"));
    Some(format!(
        "{} {}x{} {} {}: radii x{factor} cover {:.1} % of the pixels in {total:.2} ms, {:.2} of a full screen's {full:.2}",
        row["model"].as_str().unwrap_or("?"),
        row["width"],
        row["height"],
        row["method"].as_str().unwrap_or("?"),
        row["backend"].as_str().unwrap_or("?"),
        number("pixels_covered") / pixels.max(1.0) * 100.0,
        total / full.max(1e-9),
    ))
}

/// The method, and how large points are drawn where they do not have their own radii.
fn method(row: &Value) -> String {
    let name = row["method"].as_str().unwrap_or("?");
    match row["radius_factor"].as_f64().filter(|&factor| factor != 1.0) {
        Some(factor) => format!("{name} x{factor}"),
        None => name.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_without_fields_is_no_reason_to_panic() {
        assert_eq!(text(&serde_json::json!({})).lines().count(), 1);
        assert_eq!(text(&serde_json::json!({"rows": [{}], "note": "a"})).lines().count(), 3);
    }
}
