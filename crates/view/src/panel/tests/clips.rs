//! Tests of the controls for clips, the box and the spacing: numbers are typed exactly, and what is
//! only shown stays as it is.

use super::{Shown, Tab, some_clips, window};
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use esker_engine::{Clip, ClipShape, Filter};

/// Types a number into the field of a name, and ends with a key.
fn type_in(harness: &mut Harness<'_, Shown>, name: &str, text: &str, end: Key) {
    let field = harness.get_by_role_and_label(Role::SpinButton, name);
    field.click();
    harness.run_steps(3);
    // Clicked fields select their text.
    harness.event(Event::Text(text.to_owned()));
    harness.run_steps(2);
    harness.key_press(end);
    harness.run_steps(3);
}

/// The box of the only clip: centre, size and rotation.
fn oriented(shown: &Shown) -> [[f64; 3]; 3] {
    match shown.wanted.filter.clips[..] {
        [Clip { shape: ClipShape::Oriented { centre, size, rotation }, .. }] => {
            [centre, size, rotation]
        }
        ref other => panic!("{other:?}"),
    }
}

#[test]
fn a_clip_is_added_edited_switched_inverted_and_removed() {
    let mut harness = window(Shown::new(Tab::Filter), vec2(800.0, 1600.0), 1.0);
    harness.get_by_label("Add a clip").click();
    harness.run_steps(3);
    let [centre, size, rotation] = oriented(harness.state());
    let extent = harness.state().clouds.extent.unwrap();
    for axis in 0..3 {
        let [low, high] = extent[axis];
        assert!((centre[axis] - low.midpoint(high)).abs() < 0.02, "{centre:?} {extent:?}");
        let share = size[axis] / (high - low);
        let want = if axis == 2 { 1.0 } else { 0.5 };
        assert!((share - want).abs() < 0.01, "{size:?} {extent:?}");
    }
    assert_eq!(rotation, [0.0; 3]);
    type_in(&mut harness, "centre x", "4 512 345.123", Key::Enter);
    type_in(&mut harness, "size y", "12.5", Key::Enter);
    type_in(&mut harness, "turn z", "-30", Key::Enter);
    let [typed, size, rotation] = oriented(harness.state());
    assert_eq!(typed, [4_512_345.123, centre[1], centre[2]]);
    assert_eq!((size[1], rotation), (12.5, [-30.0, 0.0, 0.0]));
    // What is no number, a length below 0 and Escape change nothing; 17 digits are kept.
    type_in(&mut harness, "centre y", "east", Key::Enter);
    type_in(&mut harness, "size x", "7", Key::Escape);
    let [again, sizes, _] = oriented(harness.state());
    assert_eq!((again, sizes[0]), (typed, size[0]));
    type_in(&mut harness, "size x", "-7", Key::Enter);
    type_in(&mut harness, "centre z", "0.30000000000000004", Key::Enter);
    let [exact, sizes, _] = oriented(harness.state());
    assert_eq!((exact[2], sizes[0]), (0.1 + 0.2, 0.0));
    // A field that is left as it is keeps all digits.
    harness.get_by_role_and_label(Role::SpinButton, "centre z").click();
    harness.run_steps(3);
    harness.key_press(Key::Enter);
    harness.run_steps(3);
    assert_eq!(oriented(harness.state())[0][2], 0.1 + 0.2);
    harness.get_by_label("cut away").click();
    harness.run_steps(2);
    harness.get_by_label("clip 1").click();
    harness.run_steps(2);
    let clip = &harness.state().wanted.filter.clips[0];
    assert_eq!((clip.keeps_outside, clip.is_on), (true, false));
    assert!(harness.state().wanted.filter.is_all());
    harness.get_by_label("remove").click();
    harness.run_steps(2);
    harness.get_by_label("Add a plane").click();
    harness.run_steps(3);
    type_in(&mut harness, "normal x", "0.5", Key::Enter);
    type_in(&mut harness, "normal z", "0", Key::Enter);
    // The last direction stays.
    type_in(&mut harness, "normal x", "0", Key::Enter);
    let shape = harness.state().wanted.filter.clips[0].shape;
    assert!(matches!(shape, ClipShape::Plane { normal: [0.5, 0.0, 0.0], .. }), "{shape:?}");
}

#[test]
fn the_box_and_the_spacing_of_the_filter_are_typed_exactly() {
    let mut harness = window(Shown::new(Tab::Filter), vec2(800.0, 1600.0), 1.0);
    harness.get_by_label("within a box").click();
    harness.run_steps(3);
    let bounds = harness.state().wanted.filter.bounds.unwrap();
    let extent = harness.state().clouds.extent.unwrap();
    for axis in 0..3 {
        let [low, high] = extent[axis];
        assert!(bounds.min[axis] < low && bounds.max[axis] > high, "{bounds:?} {extent:?}");
        assert!(bounds.max[axis] - bounds.min[axis] < (high - low) * 1.01, "{bounds:?}");
    }
    // The other corner gives way.
    type_in(&mut harness, "least x", "9 512 345.123", Key::Enter);
    let typed = harness.state().wanted.filter.bounds.unwrap();
    assert_eq!((typed.min[0], typed.max[0]), (9_512_345.123, 9_512_345.123));
    harness.get_by_label("also heights").click();
    harness.run_steps(2);
    let flat = harness.state().wanted.filter.bounds.unwrap();
    assert_eq!((flat.min[2], flat.max[2]), (f64::NEG_INFINITY, f64::INFINITY));
    harness.get_by_label("also heights").click();
    harness.run_steps(2);
    let again = harness.state().wanted.filter.bounds.unwrap();
    assert_eq!((again.min[2], again.max[2]), (bounds.min[2], bounds.max[2]));
    type_in(&mut harness, "spacing", "0.125", Key::Enter);
    assert_eq!(harness.state().wanted.filter.max_spacing, Some(0.125));
    type_in(&mut harness, "spacing", "0", Key::Enter);
    assert_eq!(harness.state().wanted.filter.max_spacing, None);
    harness.get_by_label("within a box").click();
    harness.run_steps(2);
    assert_eq!(harness.state().wanted.filter, Filter::default());
}

#[test]
fn showing_the_tab_of_filters_changes_nothing() {
    let mut shown = Shown::new(Tab::Filter);
    shown.wanted.filter.clips = some_clips();
    shown.wanted.filter.bounds = "-4512345.1230000005,-1e300,1,1e-300".parse().ok();
    shown.wanted.filter.max_spacing = Some(0.1 + 0.2);
    let before = shown.wanted.filter.clone();
    let harness = window(shown, vec2(420.0, 2400.0), 1.0);
    assert_eq!(harness.state().wanted.filter, before);
}
