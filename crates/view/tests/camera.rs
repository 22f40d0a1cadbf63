//! How the camera moves, as claims: what stays under the pointer, what does not depend on the frame
//! rate, what stays exact at large coordinates.

use esker_view::camera::Camera;
use glam::{DVec2, DVec3};
use proptest::prelude::*;

const SIZE: DVec2 = DVec2::new(1280.0, 800.0);
/// Where surveys lie: metres from the origin of their projection.
const FAR_OUT: DVec3 = DVec3::new(1e7, -2e7, 300.0);

fn camera() -> Camera {
    Camera::new(FAR_OUT, FAR_OUT + DVec3::new(30.0, 40.0, -20.0), DVec3::Z, 1.0)
}

/// Where a place lies on the picture, pixels.
fn pixel(camera: &Camera, place: DVec3) -> DVec2 {
    let v = camera.axes().transpose() * (place - camera.eye());
    let focal = SIZE.y * 0.5 / (camera.fovy_rad() * 0.5).tan();
    DVec2::new(SIZE.x * 0.5 + v.x * focal / -v.z, SIZE.y * 0.5 - v.y * focal / -v.z)
}

fn run(camera: &mut Camera, keys: DVec3, seconds: f64, frames: u32) {
    for _ in 0..frames {
        camera.step(keys, seconds / f64::from(frames));
    }
}

#[test]
fn a_place_is_what_the_ray_through_its_pixel_meets() {
    let camera = camera();
    for at in [DVec2::new(640.0, 400.0), DVec2::new(3.0, 790.0), DVec2::new(1200.0, 10.0)] {
        let place = camera.place(at, SIZE, 57.0);
        assert!(pixel(&camera, place).distance(at) < 1e-4);
        let depth = (place - camera.eye()).dot(camera.forward());
        assert!((depth - 57.0).abs() < 1e-6);
    }
}

#[test]
fn what_is_orbited_stays_where_it_is_on_the_picture() {
    let mut camera = camera();
    let at = DVec2::new(300.0, 600.0);
    let pivot = camera.place(at, SIZE, 25.0);
    let distance = camera.eye().distance(pivot);
    for i in 0..200 {
        camera.orbit(pivot, 0.05, if i % 3 == 0 { 0.04 } else { -0.03 });
        assert!(pixel(&camera, pivot).distance(at) < 1e-3, "after {i} turns");
    }
    assert!((camera.eye().distance(pivot) - distance).abs() < 1e-6);
}

#[test]
fn what_is_zoomed_to_stays_where_it_is_and_comes_nearer_by_the_ratio() {
    let mut camera = camera();
    let at = DVec2::new(1000.0, 150.0);
    let place = camera.place(at, SIZE, 40.0);
    let before = camera.eye().distance(place);
    camera.zoom(place, 0.5);
    for _ in 0..100 {
        camera.step(DVec3::ZERO, 0.02);
        assert!(pixel(&camera, place).distance(at) < 1e-3);
    }
    assert!((camera.eye().distance(place) / before - 0.5).abs() < 1e-3);
    assert!(!camera.is_moving());
}

#[test]
fn what_is_panned_follows_the_pointer() {
    let mut camera = camera();
    let at = DVec2::new(500.0, 300.0);
    let place = camera.place(at, SIZE, 33.0);
    camera.pan(120.0, -45.0, 33.0, SIZE.y);
    assert!(pixel(&camera, place).distance(at + DVec2::new(120.0, -45.0)) < 1e-3);
}

#[test]
fn flying_does_not_depend_on_the_frame_rate() {
    let fly = |frames_a_second: u32| {
        let mut camera = camera();
        run(&mut camera, DVec3::Z, 2.0, 2 * frames_a_second);
        run(&mut camera, DVec3::X, 1.0, frames_a_second);
        run(&mut camera, DVec3::ZERO, 1.0, frames_a_second);
        camera.eye() - FAR_OUT
    };
    let [slow, fast] = [fly(10), fly(240)];
    // What is slower than a ten-thousandth of the distance a second counts as standing.
    assert!(slow.distance(fast) < 1e-3, "{slow} and {fast}");
    assert!(slow.length() > 50.0, "two seconds at a distance a second go far: {}", slow.length());
}

#[test]
fn flying_ahead_is_along_the_view_and_up_is_up() {
    let mut camera = camera();
    let forward = camera.forward();
    run(&mut camera, DVec3::Z, 1.0, 60);
    let moved = (camera.eye() - FAR_OUT).try_normalize().unwrap();
    assert!(moved.distance(forward) < 1e-6);
    let before = camera.eye();
    run(&mut camera, DVec3::ZERO, 2.0, 60);
    let before = (camera.eye() - before).z + before.z;
    run(&mut camera, DVec3::Y, 1.0, 60);
    assert!(camera.eye().z > before + 1.0);
}

#[test]
fn it_comes_to_rest() {
    let mut camera = camera();
    run(&mut camera, DVec3::ONE, 1.0, 30);
    assert!(camera.is_moving());
    run(&mut camera, DVec3::ZERO, 3.0, 90);
    assert!(!camera.is_moving());
    let pose = camera.pose();
    run(&mut camera, DVec3::ZERO, 1.0, 30);
    assert_eq!(camera.pose(), pose, "at rest nothing creeps, so that nothing is drawn anew");
}

#[test]
fn a_double_click_brings_the_place_to_the_middle_and_nearer() {
    let mut camera = camera();
    let place = camera.place(DVec2::new(200.0, 700.0), SIZE, 60.0);
    let before = camera.eye().distance(place);
    camera.fly_to(place);
    run(&mut camera, DVec3::ZERO, 1.0, 20);
    assert!(pixel(&camera, place).distance(SIZE * 0.5) < 1.0);
    assert!(camera.eye().distance(place) < before * 0.31);
    camera.go_home();
    run(&mut camera, DVec3::ZERO, 1.0, 20);
    assert_eq!(camera.eye(), FAR_OUT);
    assert!(!camera.is_moving());
}

/// What can happen to a camera.
#[derive(Clone, Debug)]
enum Move {
    Wheel { at: DVec2, depth: Option<f64>, ratio: f64 },
    Pan(DVec2, Option<f64>),
    Orbit { at: DVec2, depth: Option<f64>, turn: DVec2 },
    Look(DVec2),
    Fly { keys: DVec3, seconds: f64 },
    FlyTo(DVec2, Option<f64>),
    Sees(f64),
    Speed(f64),
    Home,
}

impl Move {
    /// Has the hand make it, and the camera follow for a while.
    fn make(&self, camera: &mut Camera) {
        let depth = |depth: Option<f64>| depth.unwrap_or(camera.distance());
        let place = |at: DVec2, d: Option<f64>| camera.place(at * SIZE, SIZE, depth(d));
        let mut keys = DVec3::ZERO;
        let mut seconds = 0.3;
        match *self {
            Self::Wheel { at, depth, ratio } => camera.zoom(place(at, depth), ratio),
            Self::Pan(by, d) => camera.pan(by.x, by.y, depth(d), SIZE.y),
            Self::Orbit { at, depth, turn } => camera.orbit(place(at, depth), turn.x, turn.y),
            Self::Look(turn) => camera.look(turn.x, turn.y),
            Self::FlyTo(at, depth) => camera.fly_to(place(at, depth)),
            Self::Sees(depth) => camera.sees(depth, 1.0),
            Self::Speed(factor) => camera.change_speed(factor),
            Self::Home => camera.go_home(),
            Self::Fly { keys: held, seconds: length } => (keys, seconds) = (held, length),
        }
        run(camera, keys, seconds, 10);
    }
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    let share = || (0.0..1.0, 0.0..1.0).prop_map(|(x, y)| DVec2::new(x, y));
    let by = |most: f64| (-most..most, -most..most).prop_map(|(x, y)| DVec2::new(x, y));
    // Factors and depths of any size, the smallest and largest included.
    let any = || (-300.0f64..300.0).prop_map(|power| 10.0f64.powf(power));
    let depth = || prop::option::of((-3.0f64..6.0).prop_map(|power| 10.0f64.powf(power)));
    let keys = (-4.0..4.0, -4.0..4.0, -4.0..4.0)
        .prop_map(|(right, up, ahead)| DVec3::new(right, up, ahead));
    let one = prop_oneof![
        4 => (share(), depth(), any()).prop_map(|(at, depth, ratio)| Move::Wheel { at, depth, ratio }),
        1 => (by(1e5), depth()).prop_map(|(by, depth)| Move::Pan(by, depth)),
        1 => (share(), depth(), by(9.0)).prop_map(|(at, depth, turn)| Move::Orbit { at, depth, turn }),
        1 => by(9.0).prop_map(Move::Look),
        2 => (keys, 0.0..2.0).prop_map(|(keys, seconds)| Move::Fly { keys, seconds }),
        1 => (share(), depth()).prop_map(|(at, depth)| Move::FlyTo(at, depth)),
        1 => any().prop_map(Move::Sees),
        1 => any().prop_map(Move::Speed),
        1 => Just(Move::Home),
    ];
    prop::collection::vec(one, 0..40)
}

proptest! {
    #[test]
    fn home_is_found_from_wherever_the_hand_went(moves in moves()) {
        let (low, high) = (FAR_OUT + 5.0, FAR_OUT + DVec3::new(60.0, 80.0, 9.0));
        let mut camera = camera().around([low, high]);
        let (home, distance) = (camera.pose(), camera.distance());
        for step in &moves {
            step.make(&mut camera);
            let apart = camera.eye().distance(FAR_OUT);
            prop_assert!(apart < 10_000.0, "{:?} led to {} from the scene", step, apart);
            prop_assert!(camera.distance() > 1e-7 && camera.distance() < 10_000.0);
            prop_assert!((camera.axes().determinant() - 1.0).abs() < 1e-9);
        }
        camera.go_home();
        run(&mut camera, DVec3::ZERO, 1.0, 20);
        prop_assert!(!camera.is_moving());
        prop_assert_eq!((camera.pose(), camera.distance()), (home, distance));
    }
}

#[test]
fn a_hand_on_the_keys_ends_a_glide() {
    let mut camera = camera();
    let place = camera.place(SIZE * 0.5, SIZE, 60.0);
    camera.fly_to(place);
    run(&mut camera, DVec3::X, 0.1, 5);
    run(&mut camera, DVec3::ZERO, 3.0, 60);
    assert!(camera.eye().distance(place) > 50.0, "it has not gone on gliding");
}

#[test]
fn steep_views_keep_their_heading_and_never_turn_over() {
    let mut camera = Camera::new(DVec3::Z * 100.0, DVec3::ZERO, DVec3::Z, 1.0);
    assert!(camera.forward().z < -0.99);
    for _ in 0..100 {
        camera.look(0.01, 0.2);
        assert!(camera.axes().y_axis.z >= 0.0, "up stays up");
        assert!((camera.axes().determinant() - 1.0).abs() < 1e-9);
    }
    assert!(camera.forward().z > 0.99);
}

#[test]
fn any_axis_can_be_upwards() {
    for up in [DVec3::X, DVec3::Y, -DVec3::Z, DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO] {
        let mut camera = Camera::new(DVec3::new(5.0, 6.0, 7.0), DVec3::ZERO, up, 1.0);
        let to_target = (-DVec3::new(5.0, 6.0, 7.0)).try_normalize().unwrap();
        assert!(camera.forward().distance(to_target) < 1e-3, "{up}: it looks at its target");
        camera.look(1.0, 0.3);
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        assert!(camera.axes().x_axis.dot(up).abs() < 1e-9, "{up}: the horizon is level");
    }
}

#[test]
fn the_speed_follows_what_is_seen_within_its_range() {
    let mut camera = camera();
    for _ in 0..200 {
        camera.sees(1500.0, 0.02);
    }
    assert!((camera.distance() / 1500.0 - 1.0).abs() < 0.01);
    camera.sees(f64::INFINITY, 0.02);
    camera.sees(f64::NAN, 0.02);
    camera.sees(0.0, 0.02);
    assert!(camera.distance().is_finite() && camera.distance() > 0.0);
    for _ in 0..100 {
        camera.change_speed(10.0);
    }
    assert_eq!(camera.speed(), 100.0);
}

#[test]
fn frames_that_took_for_ever_do_not_throw_it_away() {
    let mut camera = camera();
    camera.step(DVec3::Z, 1e9);
    camera.step(DVec3::Z, f64::NAN);
    camera.step(DVec3::Z, -5.0);
    assert!(camera.eye().distance(FAR_OUT) < 100.0);
}
