//! Text: numbers are exact to their digits, columns get the narrowest types, and files that are not
//! a table of points are refused with a reason in one line.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

use esker_points::lattice::GridKind;
use esker_points::{AttrType, ColourDepth};
use proptest::prelude::*;
use std::fmt::Write;

mod cloud;
mod data;

use cloud::{error, is_error_one_line, read, read_path};
use data::Entry;

#[test]
fn whole_numbers_keep_all_digits_that_64_bits_hold() {
    let column = |value: &str| {
        let cloud = read(format!("x,y,z,id,at\n0,0,0,{value},5\n1,1,1,7,1e30\n")).unwrap();
        let is_noted = cloud
            .info
            .notes
            .iter()
            .any(|n| n == "id: 1 whole numbers from 2^53 on are rounded to doubles");
        let ty = cloud.column("id").0;
        (ty, is_noted, cloud.bytes("id")[..ty.size()].to_vec())
    };
    for value in ["1700000000123456789", "18446744073709551615", "\"9007199254740993\""] {
        let want = value.trim_matches('"').parse::<u64>().unwrap().to_le_bytes().to_vec();
        assert_eq!(column(value), (AttrType::U64, false, want));
    }
    for value in ["-9007199254740993", "-9223372036854775808"] {
        let want = value.parse::<i64>().unwrap().to_le_bytes().to_vec();
        assert_eq!(column(value), (AttrType::I64, false, want));
    }
    for value in ["18446744073709551617", "-9223372036854775809", "123456789012345678901"] {
        assert!(column(value).1, "{value}");
    }
    for value in ["9007199254740991", "18446744073709551616", "1e30", "0.5", "17.5"] {
        assert!(!column(value).1, "{value}");
    }
    // Beside fractions, and beside missing values, which whole numbers cannot stand for.
    for other in ["0.5", ""] {
        let rows = "2,3,4,9007199254740993\n3,4,5,9007199254740992\n4,5,6,9007199254740995.0\n";
        let cloud = read(format!("x,y,z,id\n1,2,3,{other}\n{rows}")).unwrap();
        let want = "id: 2 whole numbers from 2^53 on are rounded to doubles".to_owned();
        assert!(cloud.info.notes.contains(&want), "{:?}", cloud.info.notes);
    }
}

#[test]
fn infinite_values_are_counted() {
    let cloud = read("x,y,z,a,b\n1,2,3,1e400,5\n2,3,4,-1.#INF,6\n3,4,5,0.5,7\n4,5,1e999,0.5,7\n");
    let cloud = cloud.unwrap();
    assert_eq!(cloud.column("a").1, [f64::INFINITY, f64::NEG_INFINITY, 0.5]);
    let want = "a: 2 values are infinite, or too large for a double".to_owned();
    assert!(cloud.info.notes.contains(&want), "{:?}", cloud.info.notes);
    assert_eq!(cloud.refused("coordinate is not a finite number"), 1);
}

#[test]
fn a_line_of_names_decides_the_columns() {
    for header in
        ["Intensity;R;G;B;Nx;Ny;Nz;Z;Y;X;Label\n", "//Intensity R G B Nx Ny Nz Z Y X Label\n"]
    {
        let cloud = read(format!(
            "{header}7 1 2 3 0.6 0 0.8 1.25 2.5 1e3 -4\n# in between\n\n9 0 0 256 0 0 1 0 0 0 1\n"
        ))
        .unwrap();
        assert_eq!(cloud.world, [[1000.0, 2.5, 1.25], [0.0; 3]]);
        assert_eq!(
            cloud.keys(),
            [
                ("Label", AttrType::I32),
                ("blue", AttrType::U16),
                ("green", AttrType::U16),
                ("intensity", AttrType::U16),
                ("nx", AttrType::F32),
                ("ny", AttrType::F32),
                ("nz", AttrType::F32),
                ("red", AttrType::U16),
            ]
        );
        assert_eq!(cloud.column("intensity").1, [7.0, 9.0]);
        assert_eq!(cloud.column("Label").1, [-4.0, 1.0]);
        assert_eq!(cloud.info.colour_depth, Some(ColourDepth::Sixteen));
        assert_eq!(cloud.report.colour_max, 256);
        assert_eq!(cloud.info.grid.grid.scale, [1.0, 0.1, 0.01]);
    }
}

#[test]
fn fields_of_las_are_recognised_in_any_spelling() {
    let text = "//X Y Z Classification GPS_Time Point_Source_ID b\n1 2 3 2 100 7 5\n";
    let want = [
        ("b", AttrType::U8),
        ("classification", AttrType::U8),
        ("gps_time", AttrType::F64),
        ("point_source_id", AttrType::U16),
    ];
    assert_eq!(read(text).unwrap().keys(), want);
    // A column that does not fit the type of LAS keeps its name.
    assert_eq!(read("X,Y,Z,Classification\n1,2,3,2.5\n").unwrap().keys()[0].0, "Classification");
}

#[test]
fn columns_without_names_get_the_narrowest_type() {
    let cloud =
        read("\u{FEFF}0 0 0 255 65535 -1 0.1 -0 3000000000\r\n1 1 1 0 0 0 1 0 0\r\n").unwrap();
    let want = [
        ("column_4", AttrType::U8),
        ("column_5", AttrType::U16),
        ("column_6", AttrType::I32),
        ("column_7", AttrType::F64),
        ("column_8", AttrType::F64),
        ("column_9", AttrType::F64),
    ];
    assert_eq!(cloud.keys(), want);
    assert_eq!(cloud.column("column_7").1, [0.1, 1.0]);
    assert!(cloud.column("column_8").1[0].is_sign_negative());
}

#[test]
fn colours_and_intensity_are_guessed_where_the_values_allow() {
    let names = |text: &str| -> Vec<String> {
        let cloud = read(text).unwrap();
        let names: Vec<_> = cloud.info.notes[0].split(", ").skip(3).collect();
        assert!(cloud.info.notes[0].starts_with("no line names the columns; they are taken for x"));
        assert!(cloud.names().iter().all(|name| names.contains(name)), "{names:?}");
        cloud.keys().iter().map(|(n, t)| format!("{n}:{}", t.name())).collect()
    };
    assert_eq!(names("1 2 3 4"), ["intensity:u16"]);
    assert_eq!(names("1 2 3 4.5"), ["column_4:f64"]);
    assert_eq!(names("1 2 3 4 5"), ["column_4:u8", "column_5:u8"]);
    assert_eq!(names("1 2 3 255 0 1"), ["blue:u8", "green:u8", "red:u8"]);
    assert_eq!(names("1 2 3 256 0 1"), ["column_4:u16", "column_5:u8", "column_6:u8"]);
    assert_eq!(names("1 2 3 0.6 0 0.8\n1 2 3 0 0 0\n"), ["nx:f32", "ny:f32", "nz:f32"]);
    assert_eq!(names("1 2 3 0.6 0 0.8\n1 2 3 0 .5 0\n")[1], "column_5:f64");
    assert_eq!(names("1 2 3 255 0 1 900"), ["blue:u8", "green:u8", "intensity:u16", "red:u8"]);
    assert_eq!(names("1 2 3 -900 255 0 1"), ["blue:u8", "column_4:i32", "green:u8", "red:u8"]);
    assert_eq!(names("1 2 3 900 255 0 1"), ["blue:u8", "green:u8", "intensity:u16", "red:u8"]);
    assert_eq!(names("1 2 3 9 255 0 1")[0], "column_4:u8");
    assert_eq!(names("1 2 3 255 0 1 .5"), ["blue:u8", "column_7:f64", "green:u8", "red:u8"]);
}

#[test]
fn a_table_of_names_only_is_a_cloud_of_no_points() {
    let cloud = read("x,y,z,intensity\n").unwrap();
    assert_eq!((cloud.report.points, cloud.info.grid.bounds), (0, None));
    assert_eq!(cloud.info.notes, ["has no points"]);
}

#[test]
fn a_few_bad_lines_are_refused_and_counted() {
    let mut text = "1 2 3\n".repeat(200);
    text += "4 5\nnan 5 6\n1 1e999 0\n1 2 3 4\n";
    let cloud = read(&text).unwrap();
    assert_eq!(cloud.report.points, 200);
    let refused: Vec<_> = cloud.report.refused.iter().map(|(r, n)| (r.as_str(), *n)).collect();
    assert_eq!(
        refused,
        [
            ("coordinate is not a finite number", 2),
            ("line has too few values", 1),
            ("line has too many values", 1)
        ]
    );
    assert_eq!(
        cloud.info.notes[1..],
        [
            "line has too few values: line 201 (`4 5`)",
            "line has too many values: line 204 (`1 2 3 4`)",
            "coordinate is not a finite number: 2 lines, the first is line 202 (`nan 5 6`)",
        ]
    );
    assert_eq!(read("1 2 3\n4 5 6\n7 8").unwrap().report.points, 2);
}

#[test]
fn quotes_comments_and_empty_fields_behind_the_numbers_lose_no_point() {
    let text = "\"x\",\"y\",\"z\",\"i\",,\n\"1.25\",\"2\",\"3\",\"4\",,\n1.5,2,3,4 # seen twice\n1,2,3,4,,\n";
    let cloud = read(text).unwrap();
    assert_eq!(cloud.world, [[1.25, 2.0, 3.0], [1.5, 2.0, 3.0], [1.0, 2.0, 3.0]]);
    assert_eq!(cloud.column("i").1, [4.0; 3]);
    assert!(cloud.report.refused.is_empty());
    assert_eq!(cloud.info.grid.grid.scale, [0.01, 1.0, 1.0]);
}

#[test]
fn many_bad_lines_are_an_error_that_names_the_first() {
    let one = error("1 2 3\n4 5\n6 7 8 9\n");
    assert!(one.contains("line 2 is not 3 numbers (`4 5`), and so are 1 more"), "{one}");
    let two_in_a_hundred = "1 2 3\n".repeat(100) + "x\n" + &"1 2 3\n".repeat(99) + "y\nz\n";
    assert!(error(&two_in_a_hundred).contains("line 101"));
    let thousand = "1 2 3\n".repeat(200_000) + &"4 5\n".repeat(1000);
    assert!(error(&thousand).contains("line 200001"));
}

#[test]
fn unsupported_texts_are_refused_with_the_reason() {
    for (text, want) in [
        ("a,b,c\n1,2,3\n", "no column is known as x, y, z by its name (`a`, `b`, `c`)"),
        ("x,lat,height\n1,2,3\n", "no column is known as x, y by its name"),
        ("x,y,i\n1,2,3\n", "no column is known as z by its name (`x`, `y`, `i`); name them with"),
        ("# nothing here\n", "not a scan file that Esker knows"),
        ("x,y,z\n1,,3\n", "line 2 has an empty field"),
        ("v 1 2 3\nf 1 1 1\n", "not a scan file that Esker knows"),
    ] {
        let error = error(text);
        assert!(error.contains(want), "{error}");
    }
    assert!(error(format!("1 2 3\n{}", "1".repeat(70_000))).contains("line 2 is longer"));
}

#[test]
fn a_long_beginning_without_points_is_read() {
    let names: Vec<String> = (0..1000).map(|i| format!("a_name_with_number_{i}")).collect();
    let (names, values) = (names.join(","), vec!["1"; 1000].join(","));
    let cloud = read(format!("x,y,z,{names}\n1,2,3,{values}\n")).unwrap();
    assert_eq!((cloud.report.points, cloud.keys().len()), (1, 1000));
    // The first bytes end within some line, whatever the length of lines.
    for line in ["# comment", "// a comment of another length"] {
        let text = format!("{line}\n").repeat(1000) + &"1 2 3\n".repeat(20_000);
        assert_eq!(read(&text).unwrap().report.points, 20_000);
    }
}

#[test]
fn lines_that_end_with_cr_are_lines() {
    let text = "\u{FEFF}x y z i\n# one\n1.5 2 3 7\n\n".to_owned() + &"4 5 6 8\n".repeat(50_000);
    let (lf, cr) = (read(&text).unwrap(), read(text.replace('\n', "\r")).unwrap());
    assert_eq!(cr.report.points, 50_001);
    assert_eq!((&lf.world, &lf.columns), (&cr.world, &cr.columns));
    assert_eq!(lf.keys(), cr.keys());
    let error = error("1 2 3\r4 5\r6 7\r");
    assert!(error.contains("line 2 is not 3 numbers"), "{error}");
}

#[test]
fn many_columns_and_short_lines_cost_no_memory() {
    let wide = vec!["1"; 1024].join(" ");
    let text = format!("{wide}\n").repeat(500) + "\n2\n2\n";
    let cloud = read(&text).unwrap();
    assert_eq!((cloud.report.points, cloud.keys().len()), (500, 1021));
}

/// A coordinate as an integer and the number of its decimals, in the notation `style`.
fn decimal(value: i64, decimals: u32, style: u8) -> String {
    let digits = format!("{:0>1$}", value.abs(), decimals as usize + 1);
    let sign = if value < 0 { "-" } else { "" };
    let (whole, part) = digits.split_at(digits.len() - decimals as usize);
    match style {
        0 => format!("{sign}{whole}.{part}"),
        1 => format!("{sign}{whole}.{part}000"),
        _ => format!("{value}e-{decimals}"),
    }
}

/// Steps of axes are shortened to differ by ten at most, but not below what doubles resolve.
#[test]
fn a_large_whole_number_beside_small_decimals_is_not_rounded() {
    let cloud = read("0 728635937 0.000001\n").unwrap();
    let [x, y, z] = cloud.world[0];
    assert_eq!([x, z], [0.0, 1e-6]);
    assert!((y - 728_635_937.0).abs() < 2e-7, "{y}");
    assert_eq!(cloud.report.rounding_error_max, 0.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn decimals_are_exact(
        decimals in [0u32..8, 0u32..8, 0u32..8],
        base in [-1_000_000_000i64..1_000_000_000, 0..1, -5..5],
        points in prop::collection::vec(([0i64..2_000_000_000, 0..2_000_000_000, 0..2_000_000_000], 0u8..3), 1..60),
        mark in 0usize..5,
    ) {
        let mut text = String::new();
        let marks = [" ", "\t", ", ", ";", " , "];
        for (p, style) in &points {
            let [x, y, z] = [0, 1, 2].map(|i| decimal(base[i] + p[i], decimals[i], *style));
            let m = marks[mark];
            writeln!(text, "{x}{m}{y}{m}{z}").unwrap();
        }
        let cloud = read(&text).unwrap();
        prop_assert_eq!(cloud.info.grid.kind, GridKind::Decimal);
        for (got, (p, _)) in cloud.world.iter().zip(&points) {
            for i in 0..3 {
                let d = decimals[i] as usize;
                let want: f64 = decimal(base[i] + p[i], decimals[i], 0).parse().unwrap();
                prop_assert_eq!(format!("{:.*}", d, got[i]), format!("{want:.d$}"));
            }
        }
        prop_assert_eq!(cloud.report.rounding_error_max, 0.0);
    }

    #[test]
    fn attributes_are_the_nearest_double(values in prop::collection::vec(any::<f64>().prop_filter("finite", |v| v.is_finite()), 1..50)) {
        let mut text = "x y z value\n".to_owned();
        for v in &values {
            writeln!(text, "0 0 0 {v:e}").unwrap();
        }
        prop_assert_eq!(read(&text).unwrap().column("value").1, values);
    }

    #[test]
    fn random_bytes_never_panic(start in 0usize..4, tail in prop::collection::vec(any::<u8>(), 0..200)) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cloud");
        let mut bytes = ["", "1 2 3\n4 5 6\n", "x y z\n", "# .PCD"][start].as_bytes().to_vec();
        bytes.extend(tail);
        std::fs::write(&path, &bytes).unwrap();
        prop_assert!(is_error_one_line(read_path(&path)));
    }

    #[test]
    fn random_tables_never_panic(text in "([-+0-9.eE,; \\txn]{0,12}\n){0,12}") {
        let text = format!("1 2 3\n{text}");
        prop_assert!(is_error_one_line(read(text)));
    }
}

#[test]
fn real_files_have_the_points_of_the_manifest() {
    let Some(data) = data::folder() else { return };
    let mut files = 0;
    for Entry { name, points, .. } in data::manifest(&data) {
        if !name.starts_with("xyz/") {
            continue;
        }
        let cloud = read_path(&data.join(&name)).unwrap();
        assert_eq!(Some(cloud.report.points), points, "{name}");
        // Two files have six digits for every magnitude and exceed 2^32 steps of their last digit.
        // Steps coarsen by tens, so a step is at most ten times the finest that fits.
        let [lo, hi] = cloud.info.grid.bounds.unwrap();
        let extent = (0..3).map(|i| hi[i] - lo[i]).fold(0.0, f64::max);
        let allowed = extent * 10.0 / 2f64.powi(33);
        assert!(cloud.report.rounding_error_max <= allowed, "{name}");
        assert_eq!(name == "xyz/tree-tls.txt", cloud.report.rounding_error_max == 0.0);
        assert!(cloud.report.refused.is_empty(), "{name}");
        files += 1;
    }
    assert_eq!(files, 3);
}

#[test]
fn an_obj_file_is_no_scan() {
    let Some(data) = data::folder() else { return };
    let error = read_path(&data.join("bad/obj-no-vertex.obj")).err().unwrap().to_string();
    assert!(error.contains("obj-no-vertex.obj: not a scan file"), "{error}");
}
