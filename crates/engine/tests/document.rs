//! Requests of pictures survive being written as scene documents and read again; and values that
//! options refuse are refused in documents, with the name of the field.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_engine::cameras::camera::{Camera, OrthoHeight};
use esker_engine::document::{Document, save};
use esker_engine::draw::method::METHODS;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::light::settings::{FILTERS, Gloss, LightSettings};
#[cfg(feature = "light")]
use esker_engine::light::spec::parse;
use esker_engine::{
    Bounds, BuildOptions, Clip, ClipShape, Codec, ColourDepth, Dots, Filter, Flags, NormalsMode,
    PointSize, Polygon, Window,
};
use glam::DVec3;
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![-1e7..1e7f64, any::<f64>().prop_filter("finite", |value| value.is_finite())]
}

fn vector() -> impl Strategy<Value = DVec3> {
    [number(), number(), number()].prop_map(DVec3::from_array)
}

fn camera() -> impl Strategy<Value = Camera> {
    let direction = || vector().prop_filter("a direction", |v| *v != DVec3::ZERO);
    let ortho = prop_oneof![Just(OrthoHeight::Fit), (1e-9..1e9f64).prop_map(OrthoHeight::Units)];
    let places = (option::of(vector()), option::of(vector()), option::of(direction()));
    (places, option::of(direction()), option::of(0.1..170.0f64), option::of(ortho)).prop_map(
        |((eye, target, direction), up, fovy_deg, ortho)| Camera {
            eye,
            target: target
                .filter(|_| eye.is_none() || direction.is_none())
                .filter(|t| Some(*t) != eye),
            up,
            direction,
            fovy_deg: fovy_deg.filter(|_| ortho.is_none()),
            ortho,
        },
    )
}

fn clip() -> impl Strategy<Value = Clip> {
    let names = option::of(select(vec!["roof", "a \"b\" {c}", "é"]));
    let normal = vector().prop_filter("a direction", |v| *v != DVec3::ZERO);
    (names, any::<[bool; 2]>(), 0..3, [vector(), vector()], normal).prop_map(
        |(name, [is_on, keeps_outside], kind, [a, b], normal)| {
            let shape = match kind {
                0 => ClipShape::Box(Bounds { min: a.min(b).to_array(), max: a.max(b).to_array() }),
                1 => ClipShape::Oriented {
                    centre: a.to_array(),
                    size: b.abs().to_array(),
                    rotation: normal.to_array(),
                },
                _ => ClipShape::Plane { point: a.to_array(), normal: normal.to_array() },
            };
            Clip { name: name.map(str::to_owned), is_on, keeps_outside, shape }
        },
    )
}

fn filter() -> impl Strategy<Value = Filter> {
    let bounds = (vector(), vector(), any::<bool>()).prop_map(|(a, b, is_flat)| {
        let (mut min, mut max) = (a.min(b).to_array(), a.max(b).to_array());
        if is_flat {
            (min[2], max[2]) = (f64::NEG_INFINITY, f64::INFINITY);
        }
        Bounds { min, max }
    });
    let ring = || vec([number(), number()], 3..6);
    let polygon = vec(vec(ring(), 1..3), 1..3).prop_map(|p| Polygon::any_of(p).unwrap());
    let classes = select(vec!["2", "ground,3-5", "overlap", "12", "0-255", "1,3,5,255,overlap"]);
    let flags = || select(vec!["", "withheld", "overlap,key-point", "synthetic,withheld"]);
    let flags = (flags(), flags());
    let ranges =
        vec!["intensity:..4000", "gps_time:-1.5..", "id:9007199254740993..", "a:b:0.1..1e300"];
    let values = vec(select(ranges), 0..3);
    let last = (values, option::of(1e-9..1e9f64));
    let places = (option::of(bounds), option::of(polygon), vec(clip(), 0..3));
    (places, option::of(classes), flags, last).prop_map(
        |((bounds, polygon, clips), classes, (flags, without), (values, max_spacing))| {
            let parse =
                |word: &str| if word.is_empty() { Flags::default() } else { word.parse().unwrap() };
            Filter {
                bounds,
                polygon,
                clips,
                classes: classes.map(|words| words.parse().unwrap()),
                flags: parse(flags),
                without_flags: parse(without),
                values: values.into_iter().map(|text| text.parse().unwrap()).collect(),
                max_spacing,
            }
        },
    )
}

fn light() -> impl Strategy<Value = LightSettings> {
    #[cfg(feature = "light")]
    let lights = option::of(select(vec![
        "sun:225,40",
        "sky|sun:12.5,-3,0.3,0|lamp:1,-2.5,3e6,7",
        "lamp:0,0,0 sky:0.31",
    ]))
    .prop_map(|words| words.map(|words| parse(words).unwrap()));
    #[cfg(not(feature = "light"))]
    let lights = Just(None);
    let gloss = (0.0..=1.0f32, 0.05..=1.0f32);
    let gloss = gloss.prop_map(|(reflectance, roughness)| Gloss { reflectance, roughness });
    let counts = (1..65_537u32, 0..65u32, 1..1025u32);
    let rest = (any::<u64>(), option::of(1e-9..1e9f64), any::<bool>());
    (lights, option::of(gloss), counts, rest, select(FILTERS.to_vec())).prop_map(
        |(lights, gloss, (samples, bounces, shadow_samples), (seed, exposure, filters), filter)| {
            LightSettings {
                lights,
                samples,
                bounces,
                shadow_samples,
                filter: filter.0,
                filters_shadows: filters && gloss.is_none(),
                gloss,
                seed,
                exposure,
                ..LightSettings::default()
            }
        },
    )
}

fn build() -> impl Strategy<Value = BuildOptions> {
    let normals = select(vec![
        NormalsMode::Keep,
        NormalsMode::Estimate,
        NormalsMode::Fast,
        NormalsMode::None,
    ]);
    let codec = select(vec![Codec::Fast, Codec::Small, Codec::None]);
    let depth = option::of(select(vec![ColourDepth::Eight, ColourDepth::Sixteen]));
    let crs = select(vec!["EPSG:2154", "EPSG:4326+5720", "PROJCS[\"a \\ b\", UNIT[\"metre\",1]]"]);
    let unit = option::of(select(vec!["metre", "US survey foot", "degree"]));
    let columns = option::of(select(vec!["x=3,y=2,z=4", "x=Easting (m),y=2,z=3,intensity=a:b"]));
    let rest = (option::of(crs), unit, columns, 64..131_073u32, 0..9u64);
    (any::<[bool; 6]>(), normals, codec, depth, rest).prop_map(
        |(
            flags,
            normals,
            compress,
            colour_depth,
            (crs, unit, columns, node_capacity, skip_lines),
        )| {
            BuildOptions {
                normals,
                compress,
                colour_depth,
                crs: crs.map(|text| text.parse().unwrap()),
                unit: unit.map(str::to_owned),
                columns: columns.map(|text| text.parse().unwrap()),
                node_capacity,
                skip_lines,
                sharp_features: flags[0],
                tangents: flags[1],
                compact: flags[2],
                ignore_crs: flags[3],
                allow_rounding: flags[4],
                apply_viewpoint: flags[5],
                ..BuildOptions::default()
            }
        },
    )
}

prop_compose! {
    fn request()(
        size in [1..16_000u32, 1..15_000u32],
        window in option::of(any::<[u32; 4]>()),
        method in select(METHODS.to_vec()),
        camera in camera(),
        budget_points in any::<u64>(),
        (target_spacing_px, budget_ms) in (0.0..1e6f64, option::of(1e-9..1e9f64)),
        colour in option::of(select(vec!["rgb", "elevation:100..250.5", "odd:name", "z:..-7"])),
        filter in filter(),
        flags in any::<[bool; 4]>(),
        (size_px, eye_dome) in (option::of(1.0..64.0f32), 0.0..10.0f32),
        light in light(),
        build in build(),
    ) -> PictureRequest {
        PictureRequest {
            size,
            window: window.map(|[x, y, width, height]| Window { x, y, width, height }),
            method: method.0,
            camera,
            budget_points,
            target_spacing_px,
            budget_ms,
            colour_by: colour.map(str::to_owned),
            filter,
            shines: flags[0],
            evens_exposure: flags[1],
            culls_back: flags[2],
            full: flags[3],
            dots: Dots { size: size_px.map_or(PointSize::Adaptive, PointSize::Pixels), eye_dome },
            light,
            build,
            ..PictureRequest::default()
        }
    }
}

proptest! {
    #[test]
    fn a_request_is_the_same_from_its_document(request in request()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.json");
        save(&path, &[], None, &request).unwrap();
        let read = Document::read(&path).unwrap().request().unwrap();
        // Their texts have all digits of all numbers.
        prop_assert_eq!(format!("{read:?}"), format!("{request:?}"));
    }
}

#[test]
fn an_empty_document_is_the_request_without_options() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.json");
    std::fs::write(&path, r#"{"esker_scene": 1}"#).unwrap();
    let read = Document::read(&path).unwrap();
    let wanted = PictureRequest::of_options();
    assert_eq!(format!("{:?}", read.request().unwrap()), format!("{wanted:?}"));
    save(&path, &[], None, &wanted).unwrap();
    assert_eq!(Document::read(&path).unwrap(), read);
}

#[test]
fn a_value_that_no_option_takes_is_an_error_that_names_its_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.json");
    for (fields, field, what) in [
        (r#""size": [0, 9]"#, "`size`", "1 to 16384"),
        (r#""size": [16384, 16384]"#, "`size`", "250 million"),
        (
            r#""method": "guess""#,
            "`method`",
            "`guess` is none of auto, points, pull-push, ewa, lit",
        ),
        (r#""camera": "sideways""#, "`camera`", "`sideways`"),
        (r#""camera": {"eye": [1, 2, 3], "target": [1, 2, 3]}"#, "`camera`", "same point"),
        (r#""camera": {"ortho": 5, "fovy": 40}"#, "`camera`", "has no fovy"),
        (r#""camera": {"ortho": "wide"}"#, "`camera`", "`wide`"),
        (r#""camera": {"fovy": 0}"#, "`camera`", "fovy is 0"),
        (r#""camera": {"up": [0, 0, 0]}"#, "`camera`", "no direction"),
        (r#""budget_ms": 0"#, "`budget_ms`", "above 0"),
        (r#""target_spacing": -1"#, "`target_spacing`", "from 0"),
        (r#""colour": "z:5..5""#, "`colour`", "no extent"),
        (r#""colour": "z:a..5""#, "`colour`", "MIN..MAX"),
        (r#""point_size": 0"#, "`point_size`", "1 to 64"),
        (r#""point_size": "wide""#, "`point_size`", "`wide`"),
        (r#""eye_dome": 99"#, "`eye_dome`", "no strength"),
        (r#""filter": {"box": [1, 2, 3]}"#, "`filter.box`", "six or four"),
        (r#""filter": {"box": [2, 0, 1, 1]}"#, "`filter.box`", "least corner"),
        (r#""filter": {"polygon": "none.geojson"}"#, "`filter.polygon`", "none.geojson"),
        (r#""filter": {"polygon": [[[[0, 0], [1, 1]]]]}"#, "`filter.polygon`", "three corners"),
        (r#""filter": {"classes": "trees"}"#, "`filter.classes`", "`trees` is no class"),
        (r#""filter": {"flags": "red"}"#, "`filter.flags`", "`red` is no flag"),
        (r#""filter": {"without_flags": "red"}"#, "`filter.without_flags`", "`red` is no flag"),
        (r#""filter": {"where": ["intensity"]}"#, "`filter.where`", "ATTRIBUTE:MIN..MAX"),
        (r#""filter": {"max_spacing": 0}"#, "`filter.max_spacing`", "no length"),
        (r#""light": {"samples": 0}"#, "`light.samples`", "within 1 and 65536"),
        (r#""light": {"bounces": 65}"#, "`light.bounces`", "within 0 and 64"),
        (r#""light": {"shadow_samples": 0}"#, "`light.shadow_samples`", "within 1 and 1024"),
        (r#""light": {"filter": "box"}"#, "`light.filter`", "`box` is none of guided"),
        (r#""light": {"gloss": [2]}"#, "`light.gloss`", "REFLECTANCE"),
        (r#""light": {"gloss": [0.1], "filter_shadows": true}"#, "`light.filter_shadows`", "gloss"),
        (r#""light": {"exposure": 0}"#, "`light.exposure`", "above 0"),
        (r#""build": {"normals": "best"}"#, "`build.normals`", "`best` is none of"),
        (r#""build": {"compress": "best"}"#, "`build.compress`", "`best` is none of"),
        (r#""build": {"colour_bits": 7}"#, "`build.colour_bits`", "8 or 16"),
        (r#""build": {"columns": "x"}"#, "`build.columns`", "`x` has no `=`"),
        (r#""build": {"crs": "Lambert"}"#, "`build.crs`", "EPSG:NUMBER"),
        (r#""build": {"unit": "mile"}"#, "`build.unit`", "`mile` is none of metre"),
        (
            r#""clips": [{"box": [0, 0, 0, 1, 1, 1]}, {"box": [0, 0, 2, 1, 1, 1]}]"#,
            "`clips[1].box`",
            "no inside",
        ),
        (
            r#""bookmarks": [{"name": "a", "camera": {"fovy": 999}}]"#,
            "`bookmarks[0].camera`",
            "fovy is 999",
        ),
        (
            r#""camera_path": [{"time_s": 0, "camera": "target=1,2,3"}]"#,
            "`camera_path[0].camera`",
            "need an eye",
        ),
    ] {
        std::fs::write(&path, format!(r#"{{"esker_scene": 1, {fields}}}"#)).unwrap();
        let error = Document::read(&path).and_then(|document| document.request()).unwrap_err();
        let error = format!("{error:#}");
        assert!(error.contains("scene.json: "), "{error}");
        assert!(error.contains(field) && error.contains(what), "{fields}: {error}");
    }
}

#[cfg(feature = "light")]
#[test]
fn faults_of_lights_name_the_light() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.json");
    for (lights, field, what) in [
        (r#""sun:1,2", "moon""#, "`light.lights[1]`", "is none of sun:"),
        (r#""none.json""#, "`light.lights[0]`", "none.json: cannot read"),
        (r#""sky:none.png""#, "`light.lights[0]`", "none.png: cannot read"),
        (r#"{"version": 1, "lights": [{"kind": "moon"}]}"#, "`light.lights[0]`", "`moon`"),
        (r#"{"version": 9, "lights": []}"#, "`light.lights[0]`", "version is 9"),
    ] {
        let text = format!(r#"{{"esker_scene": 1, "light": {{"lights": [{lights}]}}}}"#);
        std::fs::write(&path, text).unwrap();
        let error = format!("{:#}", Document::read(&path).unwrap().request().unwrap_err());
        assert!(error.contains(field) && error.contains(what), "{lights}: {error}");
    }
}

#[test]
fn documents_without_a_visible_cloud_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.json");
    let of = |clouds: &str| {
        std::fs::write(&path, format!(r#"{{"esker_scene": 1, "clouds": [{clouds}]}}"#)).unwrap();
        Document::read(&path).unwrap().inputs()
    };
    for (clouds, what) in [
        ("", "`clouds`: none is visible"),
        (r#"{"file": "a.laz", "visible": false}"#, "`clouds`: none is visible"),
    ] {
        let error = format!("{:#}", of(clouds).unwrap_err());
        assert!(error.contains("scene.json: ") && error.contains(what), "{error}");
    }
    let inputs =
        of(r#"{"file": "sub/a.laz", "offset": [0, 0, 0]}, {"file": "b", "visible": false}"#);
    assert_eq!(inputs.unwrap(), [folder.path().join("sub/a.laz")]);
    let inputs = of(r#"{"file": "synthetic:office:1k:1"}"#);
    assert_eq!(inputs.unwrap(), [std::path::PathBuf::from("synthetic:office:1k:1")]);
}
