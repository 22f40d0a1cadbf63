//! Documents survive writing and reading: every value of every field, in any combination.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_scene::{
    Annotation, Bookmark, Build, Camera, CameraParts, Clip, Cloud, Filter, Keep, KeyFrame,
    LightItem, LightOptions, Measurement, MeasurementKind, OrientedBox, Plane, PolygonForm,
    Quantity, Scene, VERSION, parse,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// Numbers that JSON can hold, also tiny, huge and negative ones.
fn number() -> impl Strategy<Value = f64> {
    any::<f64>().prop_filter("finite", |value| value.is_finite())
}

fn place() -> impl Strategy<Value = [f64; 3]> {
    [number(), number(), number()]
}

/// Texts with quotes, blanks, separators of lists, line ends and letters of other scripts.
fn text() -> impl Strategy<Value = String> {
    "[a-zA-Z0-9_:.,\"\\\\ /\n\u{e4}\u{2192}]{0,12}x"
}

fn quantity() -> impl Strategy<Value = Quantity> {
    prop_oneof![number().prop_map(Quantity::Number), text().prop_map(Quantity::Word)]
}

fn camera() -> impl Strategy<Value = Camera> {
    let vector = || option::of(place());
    let parts =
        (vector(), vector(), vector(), vector(), option::of(number()), option::of(quantity()));
    let parts = parts.prop_map(|(eye, target, up, direction, fovy, ortho)| {
        Camera::Parts(CameraParts { eye, target, up, direction, fovy, ortho })
    });
    prop_oneof![parts, text().prop_map(Camera::Text)]
}

fn filter() -> impl Strategy<Value = Filter> {
    let corners = vec(vec(vec([number(), number()], 0..4), 0..3), 0..3);
    let polygon =
        prop_oneof![text().prop_map(PolygonForm::Word), corners.prop_map(PolygonForm::Polygons)];
    let words = || option::of(text());
    let bounds = option::of(vec(number(), 0..7));
    let last = (vec(text(), 0..3), option::of(number()));
    (bounds, option::of(polygon), words(), words(), words(), last).prop_map(
        |(bounds, polygon, classes, flags, without_flags, (values, max_spacing))| Filter {
            bounds,
            polygon,
            classes,
            flags,
            without_flags,
            values,
            max_spacing,
        },
    )
}

fn light() -> impl Strategy<Value = LightOptions> {
    let data = (text(), number()).prop_map(|(key, value)| {
        let value = serde_json::json!([{ "kind": "sun", "azimuth_deg": value }]);
        LightItem::Data([(key, value)].into_iter().collect())
    });
    let item = prop_oneof![text().prop_map(LightItem::Word), data];
    let counts = option::of([any::<u32>(), any::<u32>(), any::<u32>()]);
    let values =
        (option::of(vec(number(), 0..3)), any::<u64>(), option::of(number()), any::<bool>());
    (vec(item, 0..3), counts, values, option::of(text()), vec(text(), 0..2)).prop_map(
        |(lights, counts, (gloss, seed, exposure, filter_shadows), filter, mesh)| LightOptions {
            lights,
            samples: counts.map(|c| c[0]),
            bounces: counts.map(|c| c[1]),
            shadow_samples: counts.map(|c| c[2]),
            filter,
            filter_shadows,
            gloss,
            seed: (seed > 9).then_some(seed),
            exposure,
            mesh,
        },
    )
}

fn build() -> impl Strategy<Value = Build> {
    let words = || option::of(text());
    (
        any::<[bool; 6]>(),
        option::of(any::<u32>()),
        any::<u64>(),
        [words(), words(), words(), words(), words()],
    )
        .prop_map(|(flags, count, skip_lines, [normals, compress, columns, crs, unit])| {
            Build {
                normals,
                sharp_features: flags[0],
                tangents: flags[1],
                compact: flags[2],
                node_capacity: count,
                colour_bits: count,
                compress,
                ignore_crs: flags[3],
                allow_rounding: flags[4],
                columns,
                skip_lines,
                apply_viewpoint: flags[5],
                crs,
                unit,
            }
        })
}

fn clip() -> impl Strategy<Value = Clip> {
    let shape = (place(), place()).prop_filter("a normal", |(_, normal)| *normal != [0.0; 3]);
    (option::of(text()), any::<[bool; 2]>(), 0..3, shape, place()).prop_map(
        |(name, [enabled, inside], kind, (a, b), rotation)| {
            let [low, high] = [f64::min, f64::max].map(|of| [0, 1, 2].map(|i| of(a[i], b[i])));
            let bounds = [low[0], low[1], low[2], high[0], high[1], high[2]];
            let plane = Plane { point: a, normal: b };
            let oriented_box = OrientedBox { centre: a, size: b.map(f64::abs), rotation };
            Clip {
                name,
                enabled,
                keep: if inside { Keep::Inside } else { Keep::Outside },
                bounds: (kind == 0).then_some(bounds),
                oriented_box: (kind == 1).then_some(oriented_box),
                plane: (kind == 2).then_some(plane),
            }
        },
    )
}

fn measurement() -> impl Strategy<Value = Measurement> {
    let kinds = [
        (MeasurementKind::Coordinates, 1),
        (MeasurementKind::Distance, 4),
        (MeasurementKind::Height, 2),
        (MeasurementKind::Angle, 3),
        (MeasurementKind::Area, 5),
    ];
    (option::of(text()), proptest::sample::select(kinds.to_vec())).prop_flat_map(
        |(name, (kind, points))| {
            vec(place(), points).prop_map(move |points| Measurement {
                name: name.clone(),
                kind,
                points,
            })
        },
    )
}

fn path() -> impl Strategy<Value = Vec<KeyFrame>> {
    vec((0.001..1e6, camera()), 0..4).prop_map(|frames| {
        let mut time_s = 0.0;
        let later = frames.into_iter().map(|(step, camera): (f64, _)| {
            time_s += step;
            KeyFrame { time_s, camera }
        });
        later.collect()
    })
}

fn bookmarks() -> impl Strategy<Value = Vec<Bookmark>> {
    vec((text(), camera()), 0..4).prop_map(|marks| {
        let named = marks.into_iter().enumerate();
        named.map(|(i, (name, camera))| Bookmark { name: format!("{name}{i}"), camera }).collect()
    })
}

prop_compose! {
    fn scene()(
        clouds in vec((text(), any::<bool>(), place()), 0..4),
        build in build(),
        camera in camera(),
        (size, window) in (option::of(any::<[u32; 2]>()), option::of(any::<[u32; 4]>())),
        (method, colour) in (option::of(text()), option::of(text())),
        budget_points in option::of(any::<u64>()),
        [budget_ms, target_spacing, eye_dome] in [option::of(number()), option::of(number()), option::of(number())],
        filter in filter(),
        flags in any::<[bool; 4]>(),
        point_size in option::of(quantity()),
        light in light(),
        (clips, measurements, bookmarks, camera_path) in (vec(clip(), 0..3), vec(measurement(), 0..3), bookmarks(), path()),
        annotations in vec((text(), place()), 0..3),
    ) -> Scene {
        Scene {
            version: VERSION,
            clouds: clouds.into_iter().map(|(file, visible, offset)| Cloud { file, visible, offset }).collect(),
            build,
            camera,
            size,
            window,
            method,
            budget_points,
            budget_ms,
            target_spacing,
            colour,
            filter,
            no_highlights: flags[0],
            cull_back: flags[1],
            point_size,
            eye_dome,
            even_exposure: flags[2],
            full: flags[3],
            light,
            clips,
            measurements,
            annotations: annotations.into_iter().map(|(text, at)| Annotation { text, at }).collect(),
            bookmarks,
            camera_path,
        }
    }
}

proptest! {
    #[test]
    fn a_document_is_read_as_it_was_written(scene in scene()) {
        let text = scene.to_json().unwrap();
        prop_assert_eq!(&parse(&text).unwrap(), &scene);
        // Also behind the mark of some editors, and without the line ends.
        prop_assert_eq!(&parse(&format!("\u{feff}{text}")).unwrap(), &scene);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        prop_assert_eq!(&parse(&value.to_string()).unwrap(), &scene);
    }

    /// Any part of a document, and any document with a byte changed, is read or refused.
    #[test]
    fn damage_causes_no_panic(scene in scene(), at: prop::sample::Index, byte: u8, cut: bool) {
        let mut text = scene.to_json().unwrap().into_bytes();
        let at = at.index(text.len());
        // The last byte is a line end, the one before it the brace that closes the document.
        let is_open = cut && at + 2 <= text.len();
        if cut { text.truncate(at) } else { text[at] = byte }
        if let Ok(text) = String::from_utf8(text) {
            let is_read = parse(&text).is_ok();
            prop_assert!(!(is_open && is_read));
        }
    }
}

#[test]
fn a_document_is_written_for_people() {
    let scene = Scene {
        clouds: vec![Cloud::of("town.esker")],
        camera: Camera::Parts(CameraParts {
            eye: Some([1.0, 2.5, 3.0]),
            fovy: Some(40.0),
            ..CameraParts::default()
        }),
        measurements: vec![Measurement {
            name: None,
            kind: MeasurementKind::Distance,
            points: vec![[0.0; 3], [1.0, 0.0, 0.0]],
        }],
        ..Scene::default()
    };
    let written = r#"{
  "esker_scene": 1,
  "clouds": [
    {
      "file": "town.esker"
    }
  ],
  "camera": {
    "eye": [1.0, 2.5, 3.0],
    "fovy": 40.0
  },
  "measurements": [
    {
      "kind": "distance",
      "points": [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0]
      ]
    }
  ]
}
"#;
    assert_eq!(scene.to_json().unwrap(), written);
}

#[test]
fn a_number_that_json_cannot_hold_is_not_written() {
    for value in [f64::NAN, f64::INFINITY] {
        let scene = Scene { target_spacing: Some(value), ..Scene::default() };
        assert!(scene.to_json().unwrap_err().to_string().contains("not finite"));
        let scene = Scene {
            clouds: vec![Cloud { offset: [value; 3], ..Cloud::of("a") }],
            ..Scene::default()
        };
        assert!(scene.to_json().is_err());
    }
}
