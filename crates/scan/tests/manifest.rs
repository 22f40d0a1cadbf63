//! Real PCD, E57, PTX and PTS files have the points and the bounds that independent readers found
//! (`manifest.csv`).

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;

use cloud::read_path;
use std::path::PathBuf;

/// The fields of a line, some of them in quotes.
fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut is_quoted) = (vec![String::new()], false);
    for c in line.chars() {
        match c {
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(String::new()),
            c => fields.last_mut().unwrap().push(c),
        }
    }
    fields
}

fn place(field: &str) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = field.split(' ').filter_map(|word| word.parse().ok()).collect();
    numbers.try_into().ok()
}

#[test]
fn real_files_lie_where_others_read_them() {
    let Some(data) = std::env::var_os("ESKER_DATA").map(PathBuf::from) else {
        println!("skipped: ESKER_DATA is not set");
        return;
    };
    let manifest = std::fs::read_to_string(data.join("manifest.csv")).unwrap();
    let mut with_bounds = 0;
    for line in manifest
        .lines()
        .filter(|l| ["pcd/", "e57/", "ptx/", "pts/"].iter().any(|folder| l.starts_with(folder)))
    {
        let fields = fields(line);
        let name = &fields[0];
        let cloud = read_path(&data.join(name)).unwrap();
        let points = cloud.report.points + cloud.report.refused.values().sum::<u64>();
        assert_eq!(points, fields[2].parse::<u64>().unwrap(), "{name}");
        let (Some(low), Some(high)) = (place(&fields[4]), place(&fields[5])) else {
            assert!(cloud.world.is_empty(), "{name}");
            continue;
        };
        for i in 0..3 {
            let of =
                |pick: fn(f64, f64) -> f64| cloud.world.iter().map(|p| p[i]).reduce(pick).unwrap();
            // Written with ten digits; one file's singles in text are not, since they need more
            // than a lattice has.
            let digits = if name == "pcd/lamppost.pcd" { 6e-8 } else { 1e-9 };
            let slack =
                cloud.report.rounding_error_max + digits * high[i].abs().max(low[i].abs()) + 1e-9;
            assert!((of(f64::min) - low[i]).abs() <= slack, "{name}: {} {}", of(f64::min), low[i]);
            assert!(
                (of(f64::max) - high[i]).abs() <= slack,
                "{name}: {} {}",
                of(f64::max),
                high[i]
            );
        }
        with_bounds += 1;
    }
    assert!(with_bounds > 25, "{with_bounds}");
}
