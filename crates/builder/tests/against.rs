//! Headers with wrong bounds or colour depths, inputs with different attributes, and the detection
//! of inputs that change after a build.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::{
    BuildError, Options, against_forest, against_sources, append, build, build_sources,
};
use esker_format::{EskerFile, Forest};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth};
use esker_scan::{Crs, OpenOptions};
use given::{Given, boxed, given, whole};

fn options() -> Options {
    Options { node_capacity: 256, ..Default::default() }
}

fn points(count: u64) -> Vec<[i32; 3]> {
    (0..count).map(|i| [below(3 * i, 9000), below(3 * i + 1, 9000), below(3 * i + 2, 99)]).collect()
}

/// Three inputs: without attributes; with times; with colours and an attribute of another type.
fn three() -> Vec<Given> {
    let bare = given("a.xyz", [0.01; 3], points(900));
    let times = given("b.las", [0.001; 3], points(1500))
        .with("gps_time", AttrType::F64, |i| (i as f64).to_bits())
        .with("intensity", AttrType::U16, |i| i);
    let colours = given("c.las", [0.002, 0.002, 0.01], points(700))
        .with("red", AttrType::U16, |i| i << 8)
        .with("green", AttrType::U16, |i| i)
        .with("blue", AttrType::U16, |i| i * 7)
        .with("intensity", AttrType::U8, |i| i)
        .coloured(ColourDepth::Sixteen);
    vec![bare, times, colours]
}

#[test]
fn inputs_of_different_attributes_make_a_union_and_points_keep_their_own() {
    let (_, file) = whole(&three(), &options());
    let metadata = file.metadata();
    let names: Vec<_> = metadata.schema.attributes.iter().map(|a| a.key()).collect();
    assert_eq!(
        names,
        [
            ("blue", AttrType::U16),
            ("gps_time", AttrType::F64),
            ("green", AttrType::U16),
            ("intensity", AttrType::U8),
            ("intensity", AttrType::U16),
            ("red", AttrType::U16),
        ]
    );
    let present: Vec<_> =
        metadata.sources.iter().map(|s| &metadata.classes[usize::from(s.class)].present).collect();
    assert_eq!(present, [&vec![], &vec![1, 4], &vec![0, 2, 3, 5]]);
    // The finest scale of each axis.
    assert_eq!(metadata.lattice.scale, [0.001; 3]);
}

fn differs(file: &EskerFile, sources: &[Given]) -> String {
    match against_sources(file, boxed(sources), &Silent) {
        Err(BuildError::Differs(text)) => text,
        other => panic!("{other:?}"),
    }
}

#[test]
fn any_change_of_an_input_is_detected() {
    let (_, file) = whole(&three(), &options());
    let changed = |change: fn(&mut Vec<Given>)| {
        let mut sources = three();
        change(&mut sources);
        differs(&file, &sources)
    };
    let hash = "its points (hash";
    assert!(changed(|s| s[1].columns[0][8 * 700] ^= 1).contains(hash));
    assert!(changed(|s| s[2].columns[3][0] ^= 128).contains(hash));
    assert!(changed(|s| s[0].positions[899][2] += 1).contains(hash));
    // A value moved from one point to another: each column is the same multiset as before.
    assert!(changed(|s| s[1].columns[1].swap(0, 2)).contains(hash));
    let duplicated = changed(|s| {
        s[0].positions[5] = s[0].positions[6];
    });
    assert!(duplicated.contains(hash));
    let less = changed(|s| {
        s[0].positions.pop();
    });
    assert!(less.contains("holds 3100 points, the inputs hold 3099"), "{less}");
    let more = changed(|s| s[0].positions.push([0; 3]));
    assert!(more.contains("the inputs hold 3101"), "{more}");
    let far = changed(|s| s[0].positions[0] = [i32::MAX; 3]);
    assert!(far.contains("does not hold 1 points of the inputs, such as"), "{far}");
    let fewer = changed(|s| {
        s.pop();
    });
    assert!(fewer.contains("was built from 3 inputs, 2 are named"), "{fewer}");
    let attributes = changed(|s| s[0] = s[0].clone().with("user_data", AttrType::U8, |_| 0));
    assert!(attributes.contains("its attributes are not those"), "{attributes}");
    // The order of points and of inputs makes no difference.
    let mut sources = three();
    sources.reverse();
    sources[2].positions.reverse();
    against_sources(&file, boxed(&sources), &Silent).unwrap();
}

#[test]
fn wrong_bounds_restart_the_build_on_a_lattice_that_fits() {
    let far = |i: u64| [below(2 * i, 1000) + 2_000_000_000, below(2 * i + 1, 1000), 5];
    let a = given("a", [0.001; 3], points(3000)).with("user_data", AttrType::U8, |i| i);
    let b = given("b", [0.1; 3], (0..3000).map(far).collect());
    let honest = whole(&[a.clone(), b.clone()], &options());
    let zero = Some([[0.0; 3], [1.0; 3]]);
    for sources in [
        [a.clone(), b.clone().claiming(zero)],
        [a.clone().claiming(zero), b.clone().claiming(zero)],
        [a.clone(), b.clone().claiming(None)],
        [a.clone(), b.clone().claiming(Some([[f64::NAN; 3], [f64::INFINITY; 3]]))],
        [a.clone(), b.clone().claiming(Some([[5.0; 3], [-5.0; 3]]))],
        [a.clone().claiming(Some([[-1e300; 3], [-1e299; 3]])), b.clone().claiming(zero)],
    ] {
        let (report, file) = whole(&sources, &options());
        assert_eq!(report.points_out, 6000);
        assert_eq!(file.metadata().lattice, honest.1.metadata().lattice);
        assert_eq!(report.hash, honest.0.hash);
    }
    // The integers of a single input always fit, whatever its bounds.
    let (_, file) = whole(&[b.claiming(zero)], &options());
    assert_eq!(file.metadata().lattice.shift, [0; 3]);
}

fn coloured(name: &str, value: fn(u64) -> u64, depth: ColourDepth) -> Given {
    let red = |i| if i == 0 { 255 } else { value(i) };
    given(name, [0.01; 3], points(2000))
        .with("red", AttrType::U16, red)
        .with("green", AttrType::U16, value)
        .with("blue", AttrType::U16, |_| 0)
        .coloured(depth)
}

#[test]
fn wrong_colour_depths_are_corrected() {
    use ColourDepth::{Eight, Sixteen};
    let dark = |name, depth| coloured(name, |i| i % 256, depth);
    let bright = |name, depth| coloured(name, |i| i * 32, depth);
    let depths = |sources: &[Given]| {
        let (_, file) = whole(sources, &options());
        let metadata = file.metadata();
        let of = |s: &esker_format::SourceRecord| {
            let class = metadata.classes[usize::from(s.class)].colour_depth;
            assert_eq!(s.colour_depth, Some(class));
            class
        };
        let depths: Vec<_> = metadata.sources.iter().map(of).collect();
        (depths, metadata.classes.len())
    };
    assert_eq!(depths(&[dark("a", Sixteen)]), (vec![Eight], 1));
    assert_eq!(depths(&[bright("a", Eight)]), (vec![Sixteen], 1));
    assert_eq!(depths(&[dark("a", Eight), bright("b", Eight)]), (vec![Eight, Sixteen], 2));
    assert_eq!(depths(&[dark("a", Sixteen), bright("b", Sixteen)]), (vec![Eight, Sixteen], 2));
    assert_eq!(depths(&[dark("a", Sixteen), bright("b", Eight)]), (vec![Eight, Sixteen], 2));
    // Two depths that were detected as different and turn out to be equal make one class.
    assert_eq!(depths(&[dark("a", Eight), dark("b", Sixteen)]), (vec![Eight, Eight], 1));
}

#[test]
fn a_colour_depth_that_the_user_names_is_kept() {
    let dark = coloured("a", |i| i % 256, ColourDepth::Sixteen);
    let options = Options { colour_depth: Some(ColourDepth::Sixteen), ..options() };
    let (_, file) = whole(&[dark], &options);
    assert_eq!(file.metadata().sources[0].colour_depth, Some(ColourDepth::Sixteen));
    assert!(file.metadata().sources[0].colour_depth_forced);
}

/// A source with `Amp` in steps of `scale`, in the system `crs`.
fn amplified(scale: f64, offset: f64, crs: &str) -> Given {
    let mut source = given("a.las", [0.01; 3], points(100)).with("Amp", AttrType::I16, |i| i);
    let schema = std::sync::Arc::make_mut(&mut source.info.schema);
    (schema.attributes[0].scale, schema.attributes[0].offset) = (scale, offset);
    source.info.crs = Some(Crs { text: crs.into(), unit: Some("metre".into()) });
    source
}

const UTM: &str = r#"PROJCS["WGS 84 / UTM zone 32N",AUTHORITY["EPSG","32632"]]"#;
const OTHER: &str = r#"PROJCS["WGS 84 / UTM zone 33N",AUTHORITY["EPSG","32633"]]"#;

/// The same stored values mean something else.
#[test]
fn another_meaning_of_the_same_values_is_detected() {
    let (_, file) = whole(&[amplified(0.01, 0.0, UTM)], &options());
    assert!(against_sources(&file, boxed(&[amplified(0.01, 0.0, UTM)]), &Silent).is_ok());
    for (source, want) in [
        (amplified(0.5, 0.0, UTM), "its `Amp` is 0.01 * n + 0, that of the inputs 0.5 * n + 0"),
        (amplified(0.01, 3.0, UTM), "0.01 * n + 3"),
        (amplified(0.01, 0.0, OTHER), "states another coordinate reference system"),
    ] {
        let text = differs(&file, &[source]);
        assert!(text.contains(want), "{text}");
    }
}

#[test]
fn a_system_that_contradicts_that_of_the_user_is_refused() {
    let of_user =
        |text: &str| Options { crs: Some(Crs { text: text.into(), unit: None }), ..options() };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("t.esker");
    let build = |options: &Options| {
        build_sources(boxed(&[amplified(1.0, 0.0, UTM)]), &out, options, &Silent)
    };
    let error = build(&of_user(OTHER)).unwrap_err().to_string();
    assert!(error.contains("--crs") && error.contains("UTM zone 33N"), "{error}");
    build(&of_user(UTM)).unwrap();
    // A neighbour that states none is noted.
    let bare = given("b.las", [0.01; 3], points(50));
    let out = folder.path().join("u.esker");
    let sources = boxed(&[amplified(1.0, 0.0, UTM), bare]);
    let report = build_sources(sources, &out, &options(), &Silent).unwrap();
    let notes = report.notes.join("\n");
    assert!(notes.contains("b.las: the coordinate reference system is not stated"), "{notes}");
}

/// Text does not tell types: what one tile needs, all get.
#[test]
fn an_attribute_of_text_has_one_type_in_all_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, values: [&str; 3]| {
        let path = folder.path().join(name);
        let rows = values.map(|v| format!("{}.5,2,3,{v}\n", v.len()));
        std::fs::write(&path, format!("x,y,z,h\n{}", rows.concat())).unwrap();
        path
    };
    let (whole_numbers, gaps) = (file("a.csv", ["2", "4", "9"]), file("b.csv", ["2", "", "300"]));
    let fine = file("c.csv", ["2.37", "4.01", "-1"]);
    let out = folder.path().join("t.esker");
    let types = |forest: &Forest| -> Vec<_> {
        forest.schema().attributes.iter().map(|a| (a.name.clone(), a.ty)).collect()
    };
    let inputs = [whole_numbers.clone(), gaps, fine.clone()];
    build(&inputs, &out, &options(), &Silent).unwrap();
    let forest = Forest::open(&out).unwrap();
    assert_eq!(types(&forest), [("h".to_owned(), AttrType::F64)]);
    against_forest(&forest, &inputs, &OpenOptions::default(), &Silent).unwrap();
    // Appended ones take the type that is there; where it does not hold them, a note says so.
    let (base, longer) = (folder.path().join("base.esker"), folder.path().join("longer.esker"));
    build(std::slice::from_ref(&fine), &base, &options(), &Silent).unwrap();
    let tile = std::slice::from_ref(&whole_numbers);
    let report = append(&base, tile, &longer, &options(), &Silent).unwrap();
    assert!(!report.notes.join("\n").contains("stay apart"), "{:?}", report.notes);
    let forest = Forest::open(&longer).unwrap();
    assert_eq!(types(&forest), [("h".to_owned(), AttrType::F64)]);
    against_forest(
        &forest,
        &[fine.clone(), whole_numbers.clone()],
        &OpenOptions::default(),
        &Silent,
    )
    .unwrap();
    let (base, longer) = (folder.path().join("narrow.esker"), folder.path().join("wide.esker"));
    build(tile, &base, &options(), &Silent).unwrap();
    let report = append(&base, std::slice::from_ref(&fine), &longer, &options(), &Silent).unwrap();
    let notes = report.notes.join("\n");
    assert!(notes.contains("stay apart: h (u8 in ") && notes.contains("f64 in "), "{notes}");
    let forest = Forest::open(&longer).unwrap();
    against_forest(&forest, &[fine, whole_numbers], &OpenOptions::default(), &Silent).unwrap();
}
