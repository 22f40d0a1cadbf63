//! Text as people bring it: names decide the columns, values where there are none, the user before
//! both; encodings, decimal commas, empty fields and damaged lines lose no point that is there.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

use esker_points::AttrType;
use esker_scan::OpenOptions;
use proptest::prelude::*;

mod cloud;

use cloud::{Cloud, error, is_error_one_line, read, read_with};

fn with_columns(columns: &str) -> OpenOptions {
    OpenOptions { columns: Some(columns.parse().unwrap()), ..OpenOptions::default() }
}

fn notes(cloud: &Cloud) -> String {
    cloud.info.notes.join("\n")
}

fn utf_16(text: &str, is_big: bool) -> Vec<u8> {
    let bytes = |unit: u16| if is_big { unit.to_be_bytes() } else { unit.to_le_bytes() };
    text.encode_utf16().flat_map(bytes).collect()
}

#[test]
fn names_decide_where_x_y_and_z_stand() {
    for (header, row) in [
        ("id,easting,northing,elevation", "7,1.5,2.5,3.5"),
        ("Point ID;X [m];Y [m];Z [m];Intensity", "7;1.5;2.5;3.5;9"),
        ("Time,Latitude,Longitude,Elevation,Amplitude", "7,2.5,1.5,3.5,9"),
        ("Northing Easting Height", "2.5 1.5 3.5"),
        ("lat,lon,height", "2.5,1.5,3.5"),
        ("x,y,z,\"echo, of how many\",amplitude", "1.5,2.5,3.5,7,9"),
        ("OBJECTID,POINT_X,POINT_Y,POINT_Z", "7,1.5,2.5,3.5"),
        ("//X Y Z R G B", "1.5 2.5 3.5 1 2 3"),
        ("# y x h", "2.5 1.5 3.5"),
        ("\"X\",\"Y\",\"Z\",\"Intensity\"", "1.5,2.5,3.5,9"),
        ("Survey of the old town\n3rd of May\nN,E,Z", "2.5,1.5,3.5"),
        ("//X Y Z R G B Scalar\n1", "1.5 2.5 3.5 1 2 3 9"),
        ("1\nY X Z", "2.5 1.5 3.5"),
    ] {
        let cloud = read(format!("{header}\n{row}\n")).unwrap();
        assert_eq!(cloud.world, [[1.5, 2.5, 3.5]], "{header}");
        assert!(!notes(&cloud).contains("taken for"), "{header}: {}", notes(&cloud));
        let is_geographic = header.to_lowercase().contains("lat");
        assert_eq!(notes(&cloud).contains("in degrees"), is_geographic, "{header}");
    }
    let cloud = read("x,y,z,\"echo, of how many\",amplitude\n1.5,2.5,3.5,7,9\n").unwrap();
    assert_eq!(cloud.types(), "amplitude:u8 echo, of how many:u8");
}

#[test]
fn contradictory_names_are_a_guess() {
    let cloud = read("x,y,z,x\n1,2,3,4\n").unwrap();
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0]]);
    let want = "by its name, column 4 (`x`) could be meant, too; they are taken for x, y, z, x";
    assert_eq!(cloud.info.notes[0], want);
}

#[test]
fn the_user_decides_before_names_and_values() {
    let row = "a,b,c,d\n1,2.5,1.5,3.5\n";
    for columns in ["x=3,y=2,z=4", "x=c,y=B,z=4,id=1"] {
        let cloud = read_with(row, &with_columns(columns)).unwrap();
        assert_eq!(cloud.world, [[1.5, 2.5, 3.5]], "{columns}");
        assert_eq!(cloud.names(), [if columns.contains("id") { "id" } else { "a" }]);
        assert!(cloud.info.notes.is_empty());
    }
    let cloud = read_with("x,y,z,e,n,h\n1,2,3,4,5,6\n", &with_columns("x=e,y=n,z=h")).unwrap();
    assert_eq!((cloud.world[0], cloud.types()), ([4.0, 5.0, 6.0], "x:u8 y:u8 z:u8".into()));
    // The file names the others.
    let cloud = read_with("east,y,z,u\n1,2,3,4\n", &with_columns("x=4")).unwrap();
    assert_eq!(cloud.world, [[4.0, 2.0, 3.0]]);
    // Without names, and with words.
    let cloud = read_with("P1,2,1,3,9\nP2,5,4,6,8\n", &with_columns("x=3,y=2,z=4,intensity=5"));
    let cloud = cloud.unwrap();
    assert_eq!(cloud.world, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(cloud.column("intensity"), (AttrType::U16, vec![9.0, 8.0]));
    for (text, columns, want) in [
        (row, "x=1,y=2,z=9", "has no column 9"),
        (row, "x=a,y=b,z=height", "has no column `height`"),
        ("1 2 3\n", "x=a", "no line names the columns"),
        ("1 2 3 4\n", "x=2", "gives some of x, y and z only"),
        (row, "x=1", "no column is known as y, z by its name"),
        (row, "x=1,y=2,z=3,i=3", "is given twice"),
    ] {
        let Ok(columns) = columns.parse() else {
            assert!(want == "is given twice");
            continue;
        };
        let options = OpenOptions { columns: Some(columns), ..OpenOptions::default() };
        let error = read_with(text, &options).err().unwrap().to_string();
        assert!(error.contains(want), "{error}");
    }
}

#[test]
fn lines_that_the_user_skips_are_not_read() {
    let text = "OFF\n8 6 12\n1 2 3\n4 5 6\n";
    let skipped = |skip_lines| {
        read_with(text, &OpenOptions { skip_lines, ..OpenOptions::default() }).map(|c| c.world)
    };
    assert_eq!(skipped(2).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(skipped(3).unwrap(), [[4.0, 5.0, 6.0]]);
    assert!(skipped(4).is_err());
    let bad = read_with("a 1\n1 2 3\nv\nw\n", &OpenOptions { skip_lines: 1, ..Default::default() });
    assert!(bad.err().unwrap().to_string().contains("line 3 is not 3 numbers"));
}

#[test]
fn counts_do_not_hide_what_values_show() {
    let rows = |row: &str| format!("2\n1 2 3 {row}\n4 5 6 {row}\n");
    for (row, want) in [
        ("-12 1 2 3", "blue:u8 green:u8 intensity:i32 red:u8"),
        ("1 2 3 4", "blue:u8 green:u8 intensity:u16 red:u8"),
        ("1 2 3 1000", "blue:u8 green:u8 intensity:u16 red:u8"),
        ("0.6 0 -0.8", "nx:f32 ny:f32 nz:f32"),
        ("0.6 0 -0.9", "column_4:f64 column_5:u8 column_6:f64"),
        ("7", "intensity:u16"),
    ] {
        let cloud = read(rows(row)).unwrap();
        assert_eq!(cloud.types(), want, "{row}");
    }
    assert_eq!(read(rows("1 2 3 1000")).unwrap().column("intensity").1, [1000.0; 2]);
}

#[test]
fn scans_of_a_pts_file_may_differ() {
    let cloud = read("0\n2\n1 2 3 -4 5 6 7\n2 3 4 -5 6 7 8\n").unwrap();
    assert_eq!((cloud.report.points, cloud.column("red").1), (2, vec![5.0, 6.0]));
    // Two counts and three numbers begin PTX, too.
    assert_eq!(read("0\n2\n1 2 3\n2 3 4\n").unwrap().report.points, 2);
    let text = "1\n1 2 3 -4\n0\n2\n2 3 4 -5 6 7 8\n3 4 5 -5 6 7 9\n1\n4 5 6\n";
    let cloud = read(text).unwrap();
    assert_eq!(cloud.report.points, 4);
    assert_eq!(cloud.types(), "blue:u8 green:u8 intensity:i32 red:u8");
    assert_eq!(cloud.column("blue").1, [0.0, 8.0, 9.0, 0.0]);
    assert_eq!(cloud.column("intensity").1, [-4.0, -5.0, -5.0, 0.0]);
    let notes = notes(&cloud);
    assert!(notes.contains("2 of 3 scans have no red: it is 0 there"), "{notes}");
    assert!(notes.contains("1 of 3 scans have no intensity: it is 0 there"), "{notes}");
    // A broken line of a wide scan is no line of a narrow one.
    let wide = "9 9 9 1 2 3 4\n".repeat(200);
    let cloud = read(format!("1\n1 2 3 4\n201\n{wide}7 7 7 7\n")).unwrap();
    assert_eq!((cloud.report.points, cloud.refused("line has too few values")), (201, 1));
    // Scans may be longer than a block.
    let (first, second) = ("1 2 3 4\n".repeat(50_000), "1 2 3 4 5 6 7\n".repeat(50_000));
    let cloud = read(format!("50000\n{first}50000\n{second}")).unwrap();
    assert_eq!((cloud.report.points, cloud.report.refused.len()), (100_000, 0));
    let sum = |name| cloud.column(name).1.iter().sum::<f64>();
    assert_eq!((sum("intensity"), sum("blue")), (4.0 * 100_000.0, 7.0 * 50_000.0));
}

#[test]
fn hostile_counts_cost_no_memory() {
    let widths = |from: usize| {
        let rows = (from..from + 9).map(|n| format!("1\n{}\n", vec!["1"; n].join(" ")));
        rows.collect::<String>()
    };
    assert!(error(widths(3)).contains("more than 8 different numbers of columns"));
    let wide = vec!["1"; 100].join(" ");
    let text = format!("1\n{wide}\n90000\n{}", "0 0 0\n".repeat(90_000));
    assert!(error(text).contains("have more than 32 columns"));
    assert_eq!(read("1\n1 2 3\n".repeat(30_000)).unwrap().report.points, 30_000);
}

#[test]
fn any_encoding_of_windows_programs_is_read() {
    let text = "x,y,z,Höhe über Grund\r\n1.5,2.5,3.5,9\r\n";
    let long = format!("{text}{}", "1.5,2.5,3.5,8\r\n".repeat(40_000));
    let mut latin = b"x,y,z,H\xF6he \xFCber Grund\n1.5,2.5,3.5,9\n".to_vec();
    assert_eq!(read(&latin).unwrap().names(), ["Höhe über Grund"]);
    latin.extend_from_slice(b"1,2,3,4 # \xFC\n");
    assert_eq!(read(&latin).unwrap().report.points, 2);
    for is_big in [false, true] {
        for text in [text, &long] {
            for mark in ["", "\u{FEFF}"] {
                let cloud = read(utf_16(&format!("{mark}{text}"), is_big)).unwrap();
                assert_eq!(cloud.names(), ["Höhe über Grund"]);
                assert_eq!(cloud.world.len() + 1, text.lines().count());
                assert!(cloud.world.iter().all(|p| *p == [1.5, 2.5, 3.5]));
            }
        }
    }
}

#[test]
fn decimal_commas_are_read() {
    for text in [
        "x;y;z;i\n1,5;2,25;-3;4\n",
        "x\ty\tz\ti\n1,5\t2,25\t-3\t4\n",
        "1,5 2,25 -3 4\n",
        "x,y,z,i\n\"1,5\";\"2,25\";-3;4\n",
    ] {
        let cloud = read(text).unwrap();
        assert_eq!(cloud.world, [[1.5, 2.25, -3.0]], "{text}");
        assert!(notes(&cloud).contains("numbers have decimal commas"), "{text}");
        assert_eq!(cloud.info.grid.grid.scale, [0.1, 0.01, 1.0]);
    }
    // Whole numbers first: semicolons leave no other meaning to commas.
    let text = "0;0;0\n".repeat(20_000) + "1,5;2,25;-3\n";
    assert_eq!(read(text).unwrap().world.last(), Some(&[1.5, 2.25, -3.0]));
    let mixed = error("1.5;2,5;3\n1,5;2.5;3\n");
    assert!(mixed.contains("line 1 has `2,5`, which is no number"), "{mixed}");
}

#[test]
fn a_damaged_first_line_does_not_decide() {
    let rows = "1.5,2.5,3.5\n".repeat(150);
    for (first, reason) in [
        ("X,Y,Z\n\n1,2,3,4\n", "line has too many values"),
        ("X,Y,Z\n1,2\n", "line has too few values"),
        ("X,Y,Z\nm,m,m\n", "line has a word in place of a coordinate"),
        ("X,Y,Z\n1,,3\n", "coordinate is missing"),
        ("1,2,3,4\n", "line has too many values"),
        ("1,2\n", "line has too few values"),
        ("1,2,x\n", "line has a word in place of a coordinate"),
        ("# comment\n1,2\n", "line has too few values"),
    ] {
        let cloud = read(format!("{first}{rows}")).unwrap();
        assert_eq!((cloud.report.points, cloud.refused(reason)), (150, 1), "{first}");
        let note = notes(&cloud);
        assert!(note.contains(&format!("{reason}: line")), "{note}");
    }
}

#[test]
fn a_second_line_of_names_is_noted_or_refused() {
    let first = "x y z intensity\n1 2 3 4\n2 3 4 5\n";
    let behind = "9 8 7 6\n5 4 3 2\n";
    let cloud = read(format!("{first}X Y Z Intensity\n{behind}x y z intensity\n{behind}")).unwrap();
    assert_eq!((cloud.report.points, cloud.world[2]), (6, [9.0, 8.0, 7.0]));
    assert_eq!(cloud.refused("line names the columns again"), 2);
    let note = notes(&cloud);
    let want = "2 lines name the columns again, the first is line 4 (`X Y Z Intensity`)";
    assert!(note.contains(want), "{note}");
    for other in ["z y x intensity", "x y z", "x y z intensity time"] {
        let error = error(format!("{first}{other}\n{behind}"));
        let want = format!("line 4 names other columns (`{other}`) than those before it");
        assert!(error.contains(&want), "{error}");
    }
    // The user says how all lines are read.
    let text = format!("{first}z y x intensity\n{behind}");
    let cloud = read_with(text, &with_columns("x=1,y=2,z=3")).unwrap();
    assert_eq!((cloud.report.points, cloud.world[2]), (4, [9.0, 8.0, 7.0]));
    // Without a first line of names, x, y and z must be where they are read.
    let cloud = read("1 2 3\n2 3 4\nx y z\n3 4 5\n").unwrap();
    assert!(notes(&cloud).contains("line 3 names the columns again"), "{}", notes(&cloud));
    assert!(error("1 2 3\n2 3 4\nz y x\n3 4 5\n").contains("line 3 names other columns"));
    // A comment may be prose: it is noted.
    let cloud = read(format!("{first}# z y x intensity\n{behind}")).unwrap();
    assert_eq!(cloud.report.points, 4);
    let want = "the comment in line 4 may name other columns";
    assert!(notes(&cloud).contains(want), "{}", notes(&cloud));
    assert!(!notes(&read(format!("{first}# x y z intensity\n{behind}")).unwrap()).contains(want));
}

#[test]
fn empty_fields_keep_their_points() {
    let text = "x,y,z,intensity,classification,amp,b_,gps_time\n\
                1,2,3,5,2,7,0.5,10.5\n4,5,6,,,,,\n7,8,9,-,NaN,null,n/a,\"\"\n";
    let cloud = read(text).unwrap();
    assert_eq!(cloud.report.points, 3);
    let want = "amp:f32 b_:f64 classification:u8 gps_time:f64 intensity:u16";
    assert_eq!(cloud.types(), want);
    assert_eq!(cloud.column("intensity").1, [5.0, 0.0, 0.0]);
    assert_eq!(cloud.column("classification").1, [2.0, 0.0, 0.0]);
    for name in ["amp", "b_", "gps_time"] {
        let values = cloud.column(name).1;
        assert!(!values[0].is_nan() && values[1..].iter().all(|v| v.is_nan()), "{name}");
    }
    let notes = notes(&cloud);
    assert!(notes.contains("2 points have no value for intensity: 0 stands for it"), "{notes}");
    assert!(notes.contains("2 points have no value for amp: NaN stands for it"), "{notes}");
    // Tabs enclose empty fields as well, unless they only align columns.
    let cloud = read("x\ty\tz\ti\tj\n1\t2\t3\t\t5\n1\t2\t3\t4\t\n").unwrap();
    assert_eq!((cloud.types(), cloud.world.len()), ("i:f32 j:f32".into(), 2));
    assert_eq!(read("1\t\t2\t\t3\n4\t\t5\t\t6\n").unwrap().world[1], [4.0, 5.0, 6.0]);
    assert_eq!(read("\t1\t2\t3\n\t4\t5\t6\n").unwrap().world[1], [4.0, 5.0, 6.0]);
}

#[test]
fn words_are_no_values() {
    let cloud = read("x,y,z,label,i\n1,2,3,tall tree,5\n4,5,6,house,n5\n7,8,9,,6\n").unwrap();
    assert_eq!((cloud.report.points, cloud.types()), (3, "i:f32".into()));
    let notes = notes(&cloud);
    assert!(notes.contains("column label has words, not numbers, and is left out"), "{notes}");
    assert!(notes.contains("1 points have a word, not a number, for i: NaN stands"), "{notes}");
}

#[test]
fn odd_lines_are_read() {
    for text in [
        "x,y,z,i\n1,2,3,4,\n5,6,7,8,\n",
        "x,y,z,i,\n1,2,3,4\n5,6,7,8\n",
        "1,2,3,4,,\n5,6,7,8,,\n",
        "1\t2 3\t 4\n5 6\t7\t8\n",
        "x y z i\r1 2 3 4\r5 6 7 8\r",
        "\u{FEFF}x y z i\r\n1 2 3 4\r\n5 6 7 8",
        "x y z i\r\r\n1 2 3 4\r\r\n5 6 7 8\r\r\n",
        "\"x\",\"y\",\"z\",\"i\"\n\"1\",\"2\",\"3\",\"4\"\n\"5\",\"6\",\"7\",\"8\"\n",
        "1e0 20e-1 3 .4e1\n+5 6. 7 8\n",
        "  1   2   3   4  \n  5   6   7   8\n",
        "x | y\nx;y;z;i\n1;2;3;4\n5;6;7;8\n",
        "%x y z i\n1 2 3 4 % seen\n5 6 7 8 // seen, twice\n",
    ] {
        let cloud = read(text).unwrap();
        assert_eq!(cloud.world, [[1.0, 2.0, 3.0], [5.0, 6.0, 7.0]], "{text:?}");
        assert_eq!(cloud.names().len(), 1, "{text:?}");
        assert_eq!(cloud.columns[0][0], 4);
        assert!(cloud.report.refused.is_empty());
    }
    let comments = "# one of very many comments before the points\n".repeat(5000);
    for rows in ["1 2 3\n4 5 6\n", "x y z\n1 2 3\n4 5 6\n"] {
        assert_eq!(read(format!("{comments}{rows}")).unwrap().report.points, 2);
    }
    assert!(error(&comments).contains("not three or more numbers"));
}

#[test]
fn other_texts_are_no_scans() {
    for text in [
        "v 1 2 3\nv 4 5 6\nf 1 2 3\n",
        "o thing\nv 1 2 3\n",
        "OFF\n8 6 12\n1 2 3\n4 5 6\n",
        "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n4 5 6\n",
        "solid a b\nfacet normal 0 0 1\nvertex 1 2 3\n",
        "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\n",
        "file,minx,miny,maxx,maxy\nstrip.las,0,0,20,20\n",
        "Once upon a time\nthere was 1 cloud of 2 x 3 points\n",
        "{\"x\": 1, \"y\": 2, \"z\": 3}\n",
        "<?xml version=\"1.0\"?>\n<a>1 2 3</a>\n",
        "# only a comment\n",
        "42\n",
    ] {
        let error = error(text);
        assert!(error.contains("not a scan file that Esker knows"), "{text:?}: {error}");
    }
}

#[test]
fn huge_lines_end_in_an_error() {
    let columns = "1 ".repeat(1_000_000);
    for text in [columns.clone(), format!("x y z\n{columns}"), format!("1 2 3\n{columns}\n")] {
        let error = error(text);
        assert!(error.contains("longer than 64 KiB") || error.contains("more than"), "{error}");
    }
    let names = (0..2000).map(|n| format!("a{n}")).collect::<Vec<_>>().join(",");
    let values = vec!["1"; 2003].join(",");
    assert!(read(format!("x,y,z,{names}\n{values}\n")).is_err());
}

/// A table, the bytes of a file that holds it, and its values.
#[derive(Clone, Debug)]
struct Table {
    names: Vec<String>,
    axes: [usize; 3],
    rows: Vec<Vec<String>>,
    bytes: Vec<u8>,
}

const AXES: [[&str; 3]; 7] = [
    ["x", "y", "z"],
    ["X [m]", "Y [m]", "Z [m]"],
    ["Easting", "Northing", "Elevation"],
    ["lon", "lat", "h"],
    ["POINT_X", "POINT_Y", "POINT_Z"],
    ["E", "N", "H"],
    ["Longitude (deg)", "Latitude (deg)", "Altitude (m)"],
];

fn tables() -> impl Strategy<Value = Table> {
    let shape = (3usize..9, 1usize..30, 0usize..7, 0usize..4, 0usize..6, any::<bool>());
    let digits = prop::collection::vec((any::<i32>(), 0u32..5), 9 * 30);
    let order = Just((0..9).collect::<Vec<usize>>()).prop_shuffle();
    (shape, digits, order).prop_map(|(shape, digits, order)| {
        let (columns, rows, spelling, mark, encoding, is_quoted) = shape;
        let order: Vec<usize> = order.into_iter().filter(|c| *c < columns).collect();
        let axes = [0, 1, 2].map(|axis| order.iter().position(|c| *c == axis).unwrap());
        let mark = [",", ";", "\t", ", "][mark];
        let has_commas = matches!(mark, ";" | "\t") && is_quoted;
        let names: Vec<String> = (order.iter())
            .map(|c| AXES[spelling].get(*c).map_or(format!("größe, {c}"), |n| (*n).to_owned()))
            .collect();
        let rows: Vec<Vec<String>> = (0..rows)
            .map(|row| (0..columns).map(|c| decimal(digits[row * columns + c])).collect())
            .collect();
        let quoted = |name: &String| format!("\"{name}\"");
        let mut text = names.iter().map(quoted).collect::<Vec<_>>().join(mark) + "\n";
        for row in &rows {
            text += &(row.join(mark).replace('.', if has_commas { "," } else { "." }) + "\n");
        }
        // Latin-1 is the first 256 characters of Unicode.
        let latin = text.chars().map(|c| u8::try_from(c as u32).unwrap()).collect();
        let bytes = match encoding {
            0 => text.into_bytes(),
            1 => latin,
            2 => utf_16(&format!("\u{FEFF}{text}"), false),
            3 => utf_16(&text, true),
            4 => text.replace('\n', "\r").into_bytes(),
            _ => text.replace('\n', "\r\n").into_bytes(),
        };
        Table { names, axes, rows, bytes }
    })
}

/// A number with digits after the point; the extent of the coordinates fits their grid.
fn decimal((value, decimals): (i32, u32)) -> String {
    format!("{:.*}", decimals as usize, f64::from(value / 100_000) / 10f64.powi(decimals as i32))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn tables_of_any_form_have_their_values(table in tables()) {
        let cloud = read(&table.bytes).unwrap();
        let value = |row: &Vec<String>, column: usize| row[column].parse::<f64>().unwrap();
        prop_assert_eq!(cloud.world.len(), table.rows.len());
        prop_assert!(cloud.report.refused.is_empty());
        for (place, row) in cloud.world.iter().zip(&table.rows) {
            for (axis, column) in table.axes.into_iter().enumerate() {
                prop_assert!((place[axis] - value(row, column)).abs() <= 1e-9, "{:?}", row);
            }
        }
        for (column, name) in table.names.iter().enumerate() {
            if !table.axes.contains(&column) {
                let want: Vec<f64> = table.rows.iter().map(|row| value(row, column)).collect();
                prop_assert_eq!(cloud.column(name).1, want);
            }
        }
    }

    #[test]
    fn damaged_tables_never_panic(
        table in tables(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        mark in 0usize..6,
    ) {
        let mut bytes = table.bytes;
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = [value, b'\n', b'"', b',', b'#', b'\t'][mark];
        }
        prop_assert!(is_error_one_line(read(&bytes)));
        prop_assert!(is_error_one_line(read_with(&bytes, &with_columns("x=1,y=3,z=2"))));
    }

    #[test]
    fn random_scans_of_counts_never_panic(text in "(([0-9]{1,3}|[0-9. -]{5,20}|[xyz \"#,]{3,8})\n){0,20}") {
        prop_assert!(is_error_one_line(read(text)));
    }
}
