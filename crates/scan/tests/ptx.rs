//! PTX and PTS: points have the pose of their scan, with their attributes; directions without a
//! return and lines of counts are no points; truncated or damaged files are refused with a reason
//! in one line.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

mod cloud;

use cloud::{error, read};
use esker_points::AttrType;
use esker_points::lattice::GridKind;
use esker_scan::Scanner;
use proptest::prelude::*;

/// The head of a scan whose matrix has these rows.
fn head(columns: usize, rows: usize, matrix: [[f64; 3]; 4]) -> String {
    let [a, b, c, d] = matrix.map(|[x, y, z]| format!("{x} {y} {z}"));
    let axes = "0 0 0\n1 0 0\n0 1 0\n0 0 1";
    format!("{columns}\n{rows}\n{axes}\n{a} 0\n{b} 0\n{c} 0\n{d} 1\n")
}

const STRAIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn moved(by: [f64; 3]) -> [[f64; 3]; 4] {
    let [a, b, c] = STRAIGHT;
    [a, b, c, by]
}

#[test]
fn decimals_stay_decimals_if_scans_are_only_translated() {
    let points = "1.25 0 -3 0.5 255 0 7\n0 0 0 0.5 0 0 0\n0.5 0.125 0 0.034912 1 2 3\n";
    let cloud = read(head(3, 1, moved([100.5, 0.0, -2.0])) + points).unwrap();
    assert_eq!(cloud.world, [[101.75, 0.0, -5.0], [101.0, 0.125, -2.0]]);
    assert_eq!(cloud.info.grid.kind, GridKind::Decimal);
    assert_eq!(cloud.info.grid.grid.scale, [0.01, 0.001, 1.0]);
    assert_eq!(cloud.types(), "blue:u8 green:u8 intensity:f32 red:u8");
    assert_eq!(cloud.column("intensity").1, [0.5, f64::from(0.034_912f32)]);
    assert_eq!((cloud.column("red").1, cloud.column("blue").1), (vec![255.0, 1.0], vec![7.0, 3.0]));
    assert_eq!((cloud.refused("no return"), cloud.report.refused.len()), (1, 1));
    assert_eq!(cloud.info.scanner, Some(Scanner::At([100.5, 0.0, -2.0])));
    assert_eq!((cloud.info.format.as_str(), cloud.info.points_hint), ("PTX, one scan", 3));
}

#[test]
fn scans_are_numbered_and_rotated() {
    // A quarter turn to the left: x becomes y, y becomes -x.
    let turned = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [10.0, 20.0, 30.0]];
    let first = head(1, 2, moved([0.0; 3])) + "1 2 3 0.1234567\n4 5 6 0\n";
    let cloud = read(first + &head(2, 1, turned) + "1 2 3 1\n0 0 0 0.5\n").unwrap();
    assert!(cloud.lies_at(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [8.0, 21.0, 33.0]]));
    assert_eq!(cloud.info.grid.kind, GridKind::Float);
    // Seven digits are more than a single holds.
    assert_eq!(cloud.types(), "intensity:f64 point_source_id:u16");
    assert_eq!(cloud.column("point_source_id").1, [1.0, 1.0, 2.0]);
    let at = [(1, [0.0; 3]), (2, [10.0, 20.0, 30.0])];
    assert_eq!(cloud.info.scanner, Some(Scanner::BySource(at.into_iter().collect())));
    assert_eq!(cloud.info.format, "PTX, 2 scans");
}

#[test]
fn truncated_or_damaged_files_are_refused_with_the_line() {
    let one = head(2, 1, moved([0.0; 3]));
    for (text, want) in [
        (format!("{one}1 2 3 4\n"), "scan 1 says that 2 lines follow, 1 do"),
        (format!("{one}1 2 3 4\n5 6 7\n"), "line 12 is not 4 numbers (`5 6 7`)"),
        (format!("{one}1 2 3 4\n5 6 7 8 9\n"), "line 12 is not 4 numbers"),
        (format!("{one}1 2 3\n5 6 7\n"), "line 11 is not four or seven numbers (`1 2 3`)"),
        (format!("{one}1 2 3 4 5 6 7\n1 2 3 4 5 6 256\n"), "line 12 is not 7 numbers, the last"),
        (format!("{one}1 2 3 4\n5 6 x 8\n"), "line 12 is not 4 numbers"),
        (format!("{one}1 2 3 4\n5 6 7 8\n9\n"), "the head of scan 2 has 1 lines of 10"),
    ] {
        let error = error(text);
        assert!(error.contains(want), "{error} / {want}");
    }
}

#[test]
fn a_scan_of_no_returns_is_a_cloud_of_no_points() {
    let cloud = read(head(1, 2, moved([5.0; 3])) + "0 0 0 0.5\n0 0 0 0.5\n").unwrap();
    assert!(cloud.world.is_empty() && cloud.info.notes == ["has no points"]);
    assert_eq!(cloud.refused("no return"), 2);
    let nan = read(head(1, 2, moved([5.0; 3])) + "nan 0 0 0.5\n1 2 3 0.5\n").unwrap();
    assert_eq!(nan.refused("coordinate is not a finite number"), 1);
}

#[test]
fn wrong_counts_of_pts_files_are_noted() {
    let cloud = read("2\n1.5 2 3 -1613 52 70 64\n4 5 6 12 0 255 1\n1\n7 8 9 0 1 2 3\n").unwrap();
    assert_eq!(cloud.world, [[1.5, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    assert_eq!(cloud.types(), "blue:u8 green:u8 intensity:i32 red:u8");
    assert_eq!(cloud.column("intensity"), (AttrType::I32, vec![-1613.0, 12.0, 0.0]));
    assert!(cloud.info.notes.len() == 1 && cloud.info.format == "PTS, 7 columns");
    let cloud = read("5\n1 2 3\n4 5 6\n").unwrap();
    assert_eq!(cloud.info.notes[1..], ["its counts say 5 points, 2 are there"]);
    assert!(error("5\n7\n1 2\n").contains("line 3 has fewer than three numbers"));
}

proptest! {
    #[test]
    fn any_cut_is_an_error_or_fewer_scans(cut in 0usize..400) {
        let scan = |x: usize| head(2, 2, moved([1.0, 2.0, 3.0])) + &format!("{x} 1 2 0.5\n").repeat(4);
        let text = (1..4).map(scan).collect::<String>();
        let cut = text[..cut.min(text.len())].to_owned();
        let whole = text.match_indices("2\n2\n0 0 0").filter(|(at, _)| *at <= cut.len()).count();
        if let Ok(cloud) = read(&cut) {
            // The last number of a truncated line may lack digits.
            prop_assert!(cloud.world.len() == 4 * whole || cloud.world.len() + 4 == 4 * whole, "{}", cut.len());
        }
    }
}
