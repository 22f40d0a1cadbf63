//! Real PCD, E57, PTX and PTS files have the points and the bounds that independent readers found
//! (`manifest.csv`).

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;
mod data;

use cloud::read_path;
use data::Entry;

#[test]
fn real_files_have_the_points_and_bounds_of_the_manifest() {
    let Some(data) = data::folder() else { return };
    let mut with_bounds = 0;
    for Entry { name, points, bounds } in data::manifest(&data) {
        if !["pcd/", "e57/", "ptx/", "pts/"].iter().any(|folder| name.starts_with(folder)) {
            continue;
        }
        let cloud = read_path(&data.join(&name)).unwrap();
        let read = cloud.report.points + cloud.report.refused.values().sum::<u64>();
        assert_eq!(Some(read), points, "{name}");
        let Some([low, high]) = bounds else {
            assert!(cloud.world.is_empty(), "{name}");
            continue;
        };
        for i in 0..3 {
            let of =
                |pick: fn(f64, f64) -> f64| cloud.world.iter().map(|p| p[i]).reduce(pick).unwrap();
            // The manifest has ten digits; the singles of one file in text need more digits than a
            // lattice has.
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
