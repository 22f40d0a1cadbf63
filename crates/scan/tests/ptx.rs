//! PTX and PTS: points have the pose of their scan, with their attributes; directions without a
//! return and lines of counts are no points; what is truncated or damaged is noted and counted, and
//! the rest is kept.

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
fn files_of_which_nothing_can_be_read_are_refused_with_the_line() {
    let one = head(2, 1, moved([0.0; 3]));
    for (text, want) in [
        (one.clone(), "scan 1 says that 2 lines follow, 0 do"),
        (format!("{one}1 2 3\n5 6 7\n"), "line 11 is not four or seven numbers (`1 2 3`)"),
        (format!("{one}1 2 3 4 5 6 256\n"), "scan 1 says that 2 lines follow, 1 do"),
        (format!("{one}1 2 x 4\n5 6 x 8\n"), "line 11 is not four or seven numbers"),
        (format!("{one}1 2 x 4\n5 6 x 8\n0 0 0 0\n"), "scan 1 says that 2 lines follow, 3 do"),
    ] {
        let error = error(text);
        assert!(error.contains(want), "{error} / {want}");
    }
}

const MALFORMED: &str = "line is not four numbers, or seven with colours of 0 to 255";

#[test]
fn scans_of_different_columns_are_read() {
    let one = head(2, 1, moved([0.0; 3]));
    let text = format!("{one}1 2 3 0.5\n4 5 6 0.25\n{one}7 8 9 0.5 255 0 9\n0 0 0 0.5\n");
    let cloud = read(text).unwrap();
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    assert_eq!(cloud.types(), "blue:u8 green:u8 intensity:f32 point_source_id:u16 red:u8");
    assert_eq!(cloud.column("red").1, [0.0, 0.0, 255.0]);
    assert_eq!(cloud.column("blue").1, [0.0, 0.0, 9.0]);
    assert_eq!(cloud.column("point_source_id").1, [1.0, 1.0, 2.0]);
    assert_eq!(cloud.refused("no return"), 1);
    let numbered = "point_source_id is the number of the scan within this file, from 1: \
        scans of other files may have the same numbers";
    assert_eq!(cloud.info.notes, ["2 of 3 points have no colours: they are black", numbered]);
    let empty = read(head(0, 0, moved([0.0; 3])) + &one + "1 2 3 0.5\n4 5 6 0.25\n").unwrap();
    assert_eq!((empty.world.len(), empty.info.notes.len()), (2, 0));
}

#[test]
fn lines_that_are_not_points_are_refused_and_counted() {
    let one = head(4, 1, moved([0.0; 3]));
    let cloud = read(format!("{one}1 2 3 4\n5 6 7\n5 6 x 8\n9 9 9 9\n")).unwrap();
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0], [9.0, 9.0, 9.0]]);
    assert_eq!((cloud.refused(MALFORMED), cloud.report.refused.len()), (2, 1));
    assert_eq!(cloud.info.notes, ["line 12 is the first that is not a point (`5 6 7`)"]);
}

#[test]
fn counts_that_are_wrong_are_noted_and_all_scans_are_read() {
    let one = head(2, 1, moved([0.0; 3]));
    let cloud = read(format!("{one}1 2 3 4\n{one}5 6 7 8\n9 9 9 9\n8 8 8 8\n")).unwrap();
    assert_eq!(cloud.world.len(), 4);
    assert_eq!(cloud.column("point_source_id").1, [1.0, 2.0, 2.0, 2.0]);
    let notes = cloud.info.notes.join("; ");
    assert!(notes.contains("scan 1 says that 2 lines follow, 1 do; the file is cut"), "{notes}");
    assert!(notes.contains("scan 2 says that 2 lines follow, 3 do"), "{notes}");
}

#[test]
fn a_file_that_is_cut_keeps_its_whole_lines() {
    let one = head(2, 2, moved([0.0; 3]));
    let cloud = read(format!("{one}1 2 3 4\n5 6 7 8\n9 9 9 9.2")).unwrap();
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0], [5.0, 6.0, 7.0]]);
    assert_eq!(cloud.refused("line that the end of the file cuts"), 1);
    assert_eq!(
        cloud.info.notes,
        ["scan 1 says that 4 lines follow, 2 do; the file is cut or the head wrong"]
    );
    let points = "1 2 3 4\n".repeat(4);
    let cloud = read(format!("{one}{points}{}", &one[..20])).unwrap();
    assert_eq!(cloud.world.len(), 4);
    assert!(cloud.info.notes[0].contains("the head of scan 2 has "), "{:?}", cloud.info.notes);
}

#[test]
fn one_bad_head_does_not_cost_the_other_scans() {
    let one = head(1, 1, moved([0.0; 3]));
    let bad = one.replace("0 0 1 0\n", "0 0 1\n");
    let cloud = read(format!("{one}1 2 3 4\n{bad}5 6 7 8\n9 9 9 9\n")).unwrap();
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0]]);
    assert_eq!(cloud.refused("line behind a malformed head of a scan"), 2);
    assert!(cloud.info.notes[0].contains("line 20 is not four numbers"), "{:?}", cloud.info.notes);
}

#[test]
fn poses_that_are_none_are_replaced_and_noted() {
    let flat = head(1, 1, [[0.0; 3], [0.0; 3], [0.0; 3], [10.0, 20.0, 30.0]]);
    let cloud = read(format!("{flat}1 2 3 4\n")).unwrap();
    assert_eq!(cloud.world, [[11.0, 22.0, 33.0]]);
    assert_eq!(
        cloud.info.notes,
        ["scan 1 has a matrix that is no rotation: it is kept as not turned"]
    );
    let astray = head(1, 1, moved([f64::NAN; 3])).replacen("0 0 0\n", "7.5 8 9\n", 1);
    let cloud = read(format!("{astray}1 2 3 4\n")).unwrap();
    assert_eq!(cloud.world, [[8.5, 10.0, 12.0]]);
    assert!(cloud.info.notes[0].contains("the scanner's position is taken"));
}

#[test]
fn matrices_that_scale_or_mirror_are_applied_and_noted() {
    let [x, y, z] = STRAIGHT;
    let times = |factor: f64, row: [f64; 3]| row.map(|c| c * factor);
    for (matrix, want, does) in [
        (
            [times(0.001, x), times(0.001, y), times(0.001, z)],
            [0.001, 0.002, 0.003],
            "scales points by 0.001",
        ),
        ([times(-1.0, x), y, z], [-1.0, 2.0, 3.0], "mirrors points"),
        (
            [times(2.0, x), y, times(-1.0, z)],
            [2.0, 2.0, -3.0],
            "mirrors points and scales points by 2, 1 and 1 along its axes",
        ),
        ([x, [0.6, 0.8, 0.0], z], [2.2, 1.6, 3.0], "shears points"),
    ] {
        let [a, b, c] = matrix;
        let cloud = read(head(1, 1, [a, b, c, [0.0; 3]]) + "1 2 3 4\n").unwrap();
        assert!(cloud.lies_at(&[want]), "{:?}", cloud.world);
        let want = format!("scan 1 has a matrix that {does}: it is applied as it is");
        assert_eq!(cloud.info.notes, [want]);
    }
    // A scan of no returns is no error because of its matrix.
    let none = head(1, 1, [times(2.0, x), times(2.0, y), times(2.0, z), [0.0; 3]]) + "0 0 0 4\n";
    assert_eq!(read(none).unwrap().world.len(), 0);
}

#[test]
fn a_matrix_written_by_columns_is_transposed() {
    let of = |axes: &str, matrix: &str| {
        read(format!("1\n1\n100.5 200 5\n{axes}\n{matrix}\n10 20 30 0.5\n")).unwrap()
    };
    let axes = "0 1 0\n-1 0 0\n0 0 1";
    let by_rows = of(axes, "0 1 0 0\n-1 0 0 0\n0 0 1 0\n100.5 200 5 1");
    let by_columns = of(axes, "0 -1 0 100.5\n1 0 0 200\n0 0 1 5\n0 0 0 1");
    for cloud in [&by_rows, &by_columns] {
        assert!(cloud.lies_at(&[[80.5, 210.0, 35.0]]), "{:?}", cloud.world);
        assert_eq!(cloud.info.scanner, Some(Scanner::At([100.5, 200.0, 5.0])));
    }
    assert!(by_rows.info.notes.is_empty());
    let note = "scan 1 has a matrix written by columns: it is transposed";
    let agrees = format!("{note}, as its axes and its position say");
    assert_eq!(by_columns.info.notes, [agrees]);
    // Without a turn, decimals stay decimals: the digits are those of the column.
    let straight = of(axes, "1 0 0 100.5\n0 1 0 200\n0 0 1 5\n0 0 0 1");
    assert_eq!(straight.world, [[110.5, 220.0, 35.0]]);
    assert_eq!(straight.info.grid.grid.scale, [0.1, 1.0, 1.0]);
    assert_eq!(straight.info.notes, [note]);
    // Both readings are sound where there is no position: the matrix is applied as written.
    let unplaced = of("0 -1 0\n1 0 0\n0 0 1", "0 1 0 0\n-1 0 0 0\n0 0 1 0\n0 0 0 1");
    assert!(unplaced.lies_at(&[[-20.0, 10.0, 30.0]]));
    assert!(unplaced.info.notes[0].contains("axes of the transposed matrix"));
    let odd = of(axes, "0 1 0 7\n-1 0 0 0\n0 0 1 0\n100.5 200 5 1");
    assert!(odd.lies_at(&[[80.5, 210.0, 35.0]]));
    assert!(odd.info.notes[0].contains("fourth column is not 0 0 0 1"));
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
    fn any_cut_is_an_error_or_fewer_points(cut in 0usize..400) {
        let scan = |x: usize| head(2, 2, moved([1.0, 2.0, 3.0])) + &format!("{x} 1 2 0.5\n").repeat(4);
        let text = (1..4).map(scan).collect::<String>();
        let cut = text[..cut.min(text.len())].to_owned();
        let whole = text.match_indices("2\n2\n0 0 0").filter(|(at, _)| *at <= cut.len()).count();
        if let Ok(cloud) = read(&cut) {
            // Whole scans are kept, and whole lines of the one that is cut.
            let least = 4 * whole.saturating_sub(1);
            prop_assert!((least..=4 * whole).contains(&cloud.world.len()), "{}", cut.len());
        }
    }
}
