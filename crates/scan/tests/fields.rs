//! Fields of LAS and colours are recognised by the names of any writer, in text, PLY and PCD, where
//! the values fit; what does not fit stays an attribute, with a note.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod cloud;

use cloud::{Cloud, read};
use esker_points::AttrType;
use std::fmt::Write;

/// A binary PLY of one point for each row of values.
fn ply(properties: &[(&str, &str)], rows: &[&[f64]]) -> Cloud {
    let mut head = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    for (ty, name) in [("float", "x"), ("float", "y"), ("float", "z")].iter().chain(properties) {
        let _ = writeln!(head, "property {ty} {name}");
    }
    head.push_str("end_header\n");
    for row in rows {
        let values: Vec<String> = row.iter().map(f64::to_string).collect();
        let _ = writeln!(head, "1 2 3 {}", values.join(" "));
    }
    read(head).unwrap()
}

fn noted(cloud: &Cloud, part: &str) -> bool {
    cloud.info.notes.iter().any(|note| note.contains(part))
}

#[test]
fn parts_of_packed_fields_are_combined() {
    let cloud = read(
        "X,Y,Z,Intensity,ReturnNumber,NumberOfReturns,ScanDirectionFlag,EdgeOfFlightLine,Classification,ScanAngleRank,UserData,PointSourceId,GpsTime,ScanChannel,Synthetic,KeyPoint,Withheld,Overlap\n\
         1,2,3,10,1,3,0,1,2.000,-20.000,4,7.000,1000.5,3,0,1,0,1\n\
         1,2,4,70,2,2,1,0,31.000,19.000,5,8.000,1001.5,0,1,0,1,0\n",
    )
    .unwrap();
    assert_eq!(
        cloud.types(),
        "classification:u8 flags:u8 gps_time:f64 intensity:u16 point_source_id:u16 returns:u8 scan_angle_rank:i8 user_data:u8"
    );
    assert_eq!(cloud.bytes("returns"), [0x31, 0x22]);
    assert_eq!(cloud.bytes("flags"), [0b1011_1010, 0b0100_0101]);
    assert_eq!(cloud.column("scan_angle_rank").1, [-20.0, 19.0]);
    assert!(noted(&cloud, "returns (ReturnNumber, NumberOfReturns)"), "{:?}", cloud.info.notes);
}

#[test]
fn scalar_fields_of_cloudcompare_become_fields_of_las() {
    let cloud = ply(
        &[
            ("float", "scalar_Return_Number"),
            ("float", "scalar_Number_Of_Returns"),
            ("float", "scalar_Scan_Angle_Rank"),
            ("float", "scalar_Intensity"),
            ("float", "scalar_Classification"),
            ("float", "scalar_Gps_Time"),
            ("float", "scalar_Point_Source_ID"),
            ("float", "scalar_Echo"),
        ],
        &[
            &[1.0, 2.0, -14.0, 700.0, 6.0, 0.25, 12.0, 0.5],
            &[2.0, 2.0, 3.0, 1.0, 2.0, 0.5, 1.0, 1.0],
        ],
    );
    assert_eq!(
        cloud.types(),
        "classification:u8 gps_time:f64 intensity:u16 point_source_id:u16 returns:u8 scalar_Echo:f32 scan_angle_rank:i8"
    );
    assert_eq!(cloud.bytes("returns"), [0x21, 0x22]);
    // A single intensity without other fields of LAS keeps its type.
    let alone = ply(&[("float", "scalar_Intensity")], &[&[700.0]]);
    assert_eq!(alone.types(), "intensity:f32");
}

#[test]
fn what_does_not_fit_its_field_is_kept_with_a_note() {
    let cloud = read(
        "x y z ReturnNumber NumberOfReturns Classification PointSourceId ScanAngle UserData flags\n\
         1 2 3 16 3 300 70000 12.3456 1.5 5\n1 2 3 1 3 1 1 1 1 5\n",
    )
    .unwrap();
    assert_eq!(
        cloud.types(),
        "Classification:u16 PointSourceId:i32 ReturnNumber:u8 ScanAngle:f64 UserData:f64 flags_:u8 returns:u8"
    );
    assert_eq!(cloud.bytes("returns"), [0x30, 0x30]);
    assert_eq!(cloud.column("ScanAngle").1, [12.3456, 1.0]);
    assert!(noted(&cloud, "do not fit"), "{:?}", cloud.info.notes);
    assert!(noted(&cloud, "`flags` is not the field of LAS"), "{:?}", cloud.info.notes);
}

#[test]
fn fields_of_their_own_type_need_no_note() {
    let cloud = ply(
        &[
            ("uchar", "user_data"),
            ("ushort", "point_source_id"),
            ("uchar", "classification"),
            ("uchar", "returns"),
            ("uchar", "flags"),
            ("double", "scan_angle"),
        ],
        &[&[255.0, 65_535.0, 255.0, 17.0, 128.0, 0.006]],
    );
    assert_eq!(
        cloud.types(),
        "classification:u8 flags:u8 point_source_id:u16 returns:u8 scan_angle:i16 user_data:u8"
    );
    assert!(!noted(&cloud, "read as") && !noted(&cloud, "do not fit"), "{:?}", cloud.info.notes);
}

#[test]
fn scan_angles_are_whole_degrees_or_steps() {
    let angle = |name: &str, values: [&str; 2]| {
        let text = format!(
            "x,y,z,{name},returns,flags\n1,2,3,{},17,0\n1,2,3,{},17,0\n",
            values[0], values[1]
        );
        let cloud = read(text).unwrap();
        let name = cloud.names().into_iter().find(|n| n.to_lowercase().contains("angle")).unwrap();
        let (ty, values) = cloud.column(name);
        (name.to_owned(), ty, values)
    };
    let of = |name: &str, ty, values: [f64; 2]| (name.to_owned(), ty, values.to_vec());
    let steps = AttrType::I16;
    for (name, values, want) in [
        ("scan_angle", ["-20.004", "0.006"], of("scan_angle", steps, [-3334.0, 1.0])),
        ("scan_angle", ["3.000", "0.000"], of("scan_angle", steps, [500.0, 0.0])),
        ("scan_angle", ["-20", "7"], of("scan_angle_rank", AttrType::I8, [-20.0, 7.0])),
        ("ScanAngleRank", ["-20.000", "3.0"], of("scan_angle_rank", AttrType::I8, [-20.0, 3.0])),
        ("Scan Angle", ["-20.004", "3.0"], of("scan_angle", steps, [-3334.0, 500.0])),
        ("ScanAngle", ["-12000", "3"], of("scan_angle", steps, [-12000.0, 3.0])),
        ("ScanAngle", ["151", "3"], of("ScanAngle", AttrType::U8, [151.0, 3.0])),
    ] {
        assert_eq!(angle(name, values), want, "{name} {values:?}");
    }
    // Without the packed bytes of LAS, the attribute itself says what a step is.
    let cloud = read("x,y,z,scan_angle\n1,2,3,0.006\n1,2,3,-1.2\n").unwrap();
    assert_eq!(cloud.info.schema.attributes[0].scale, 0.006);
}

#[test]
fn colours_of_any_type_and_scale_become_colours() {
    let names = ["red", "green", "blue"];
    let of = |ty: &'static str, rows: &[&[f64]]| ply(&names.map(|name| (ty, name)), rows);
    let bytes = of("float", &[&[0.792157, 0.368627, 1.0], &[0.0, 0.2, 0.4]]);
    assert_eq!(bytes.types(), "blue:u8 green:u8 red:u8");
    assert_eq!(bytes.column("red").1, [202.0, 0.0]);
    assert_eq!(bytes.column("blue").1, [255.0, 102.0]);
    assert!(noted(&bytes, "fractions of 0 to 1"));
    let fine = of("double", &[&[0.1234, 0.5, 1.0]]);
    assert_eq!(fine.column("red"), (AttrType::U16, vec![8087.0]));
    assert_eq!(fine.column("blue").1, [65_535.0]);
    assert_eq!(fine.report.colour_max, u16::MAX);
    for ty in ["int", "uint", "ushort", "float"] {
        let cloud = of(ty, &[&[255.0, 40.0, 0.0]]);
        assert_eq!(cloud.column("red").1, [255.0], "{ty}");
        assert!(cloud.info.schema.rgb().is_some(), "{ty}");
    }
    assert_eq!(of("int", &[&[256.0, 65_535.0, 0.0]]).types(), "blue:u16 green:u16 red:u16");
    let negative = of("int", &[&[-1.0, 4.0, 0.0]]);
    assert_eq!(negative.types(), "blue:i32 green:i32 red:i32");
    assert!(noted(&negative, "are attributes, no colours"));
    let text = read("X Y Z R G B\n0.5 1 2 0.792157 0.368627 0.317647\n").unwrap();
    assert_eq!(text.column("green"), (AttrType::U8, vec![94.0]));
    let pcd = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z r g b\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n\
        COUNT 1 1 1 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3 0.2 0.4 1\n";
    assert_eq!(read(pcd).unwrap().column("red"), (AttrType::U8, vec![51.0]));
    // Colours that are not numbers are black, and counted.
    let gaps = ply(&names.map(|n| ("float", n)), &[&[f64::NAN; 3], &[1.0, 0.2, 0.4]]);
    assert_eq!(gaps.column("red").1, [0.0, 255.0]);
    assert!(noted(&gaps, "3 values are no numbers"), "{:?}", gaps.info.notes);
    let endless = ply(&names.map(|n| ("float", n)), &[&[f64::INFINITY; 3], &[1.0, 0.2, 0.4]]);
    assert_eq!(endless.column("red").1, [0.0, 255.0]);
}

#[test]
fn halves_of_wide_integers_are_joined() {
    let cloud = ply(
        &[
            ("uint", "id_low"),
            ("uint", "id_high"),
            ("uint", "at_low"),
            ("int", "at_high"),
            ("uint", "a_low"),
        ],
        &[&[4_294_967_295.0, 4_294_967_295.0, 4_294_967_294.0, -1.0, 5.0]],
    );
    assert_eq!(cloud.types(), "a_low:u32 at:i64 id:u64");
    assert_eq!(cloud.bytes("id"), u64::MAX.to_le_bytes());
    assert_eq!(cloud.bytes("at"), (-2i64).to_le_bytes());
}

#[test]
fn a_packed_byte_alone_is_the_field_in_the_order_of_esker() {
    // Withheld, then none; as in an export of Esker without returns.
    let cloud = read("x,y,z,flags,intensity\n1,2,3,4,5\n2,3,4,0,6\n").unwrap();
    assert_eq!(cloud.types(), "flags:u8 intensity:u16");
    assert!(noted(&cloud, "`flags` is read as the byte of LAS"), "{:?}", cloud.info.notes);
    // A return of a pulse with two, and a point without returns.
    let cloud = read("x y z intensity returns\n1 2 3 4 34\n2 3 4 5 0\n").unwrap();
    assert_eq!(cloud.types(), "intensity:u16 returns:u8");
    // Any other order is of another program.
    let cloud = read("x,y,z,intensity,flags\n1,2,3,4,5\n2,3,4,0,6\n").unwrap();
    assert_eq!(cloud.types(), "flags_:u8 intensity:u16");
    // PLY states its writer.
    let flags = |comment: &str| {
        let text = format!(
            "ply\nformat ascii 1.0\n{comment}element vertex 1\nproperty float x\n\
             property float y\nproperty float z\nproperty uchar flags\nend_header\n1 2 3 4\n"
        );
        read(text).unwrap().types()
    };
    assert_eq!(flags("comment written by Esker 0.1.0\n"), "flags:u8");
    assert_eq!(flags(""), "flags_:u8");
}

#[test]
fn numbers_of_returns_are_no_packed_bytes() {
    let foreign = read("x,y,z,flags,returns\n1,2,3,7,3\n2,2,3,1,2\n").unwrap();
    assert_eq!(foreign.types(), "flags_:u8 returns_:u8");
    assert_eq!(foreign.column("returns_").1, [3.0, 2.0]);
    assert!(noted(&foreign, "`returns` is not the field of LAS, whose values have a number"));
    let alone = ply(&[("uchar", "returns")], &[&[3.0], &[20.0]]);
    assert_eq!(alone.types(), "returns_:u8");
}

#[test]
fn gps_times_outside_of_a_week_are_adjusted_standard_time() {
    let times = |values: [&str; 2]| {
        let text = format!("x,y,z,gps_time\n1,2,3,{}\n1,2,3,{}\n", values[0], values[1]);
        let cloud = read(text).unwrap();
        (esker_scan::las::gps_times(&cloud.info.verbatim), noted(&cloud, "adjusted standard time"))
    };
    let adjusted = (Some(esker_scan::las::GpsTimes::Adjusted), true);
    assert_eq!(times(["0.5", "604800"]), (None, false));
    assert_eq!(times(["0.5", "604801"]), adjusted);
    assert_eq!(times(["-1.5", "0"]), adjusted);
}
