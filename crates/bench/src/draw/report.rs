//! The drawing rate as a table for people.

use esker_engine::io::quantity::{grouped, readable_bytes};
use serde_json::Value;

/// A line for each way, order, number of points and size; then what they are on.
pub fn text(report: &Value) -> String {
    let list = |name: &str| report[name].as_array().map_or(&[][..], Vec::as_slice);
    let rows = list("rows");
    let mut lines = vec![format!(
        "{:>13} {:<7} {:>10} {:<18} {:>10} {:>9} {:>9} {:>9} {:>9} {:>10} {:>7} {:>9}",
        "points",
        "order",
        "size",
        "path",
        "ms",
        "p10",
        "p90",
        "wall ms",
        "Mpoints/s",
        "bytes/s",
        "share",
        "covered"
    )];
    lines.extend(rows.iter().map(row));
    let mut devices: Vec<_> = rows.iter().map(|r| (&r["device"], &r["copy_bytes_per_s"])).collect();
    // A line a device; its copies are measured anew for each cloud.
    devices.sort_by_key(|(device, _)| device.to_string());
    for same in devices.chunk_by(|a, b| a.0 == b.0) {
        let rates = || same.iter().filter_map(|(_, rate)| rate.as_f64());
        let [low, high] = [rates().fold(f64::MAX, f64::min), rates().fold(0.0, f64::max)];
        lines.push(format!(
            "{}: a copy reads and writes {} to {} a second",
            same[0].0.as_str().unwrap_or("?"),
            readable_bytes(low as u64),
            readable_bytes(high as u64),
        ));
    }
    lines.extend(list("notes").iter().filter_map(Value::as_str).map(str::to_owned));
    lines.join("\n")
}

fn row(row: &Value) -> String {
    let number = |name: &str| row[name].as_f64().unwrap_or(0.0);
    let word = |name: &str| row[name].as_str().unwrap_or("?");
    let beside = match row["rate_to_no_pixels"].as_f64() {
        Some(share) => format!("  {:.0} % of its rate without pixels", share * 100.0),
        None => String::new(),
    };
    format!(
        "{:>13} {:<7} {:>10} {:<18} {:>10.3} {:>9.3} {:>9.3} {:>9.3} {:>9.1} {:>10} {:>5.1} % {:>9}{beside}",
        grouped(row["points"].as_u64().unwrap_or(0)),
        word("order"),
        format!("{}x{}", row["size"][0], row["size"][1]),
        word("path"),
        number("ms"),
        number("ms_p10"),
        number("ms_p90"),
        number("wall_ms"),
        number("mpoints_per_s"),
        readable_bytes(number("bytes_per_s") as u64),
        number("share_of_bandwidth") * 100.0,
        row["pixels_covered"].as_u64().map_or("-".into(), |n| n.to_string()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_without_fields_is_no_reason_to_panic() {
        assert_eq!(text(&serde_json::json!({})).lines().count(), 1);
        assert_eq!(text(&serde_json::json!({"rows": [{}], "notes": ["a"]})).lines().count(), 4);
    }
}
