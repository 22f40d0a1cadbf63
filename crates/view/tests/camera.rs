//! Tests of the camera's motion: what stays under the pointer, what does not depend on the frame
//! rate, what stays exact at large coordinates.

#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

use esker_view::camera::Camera;
use glam::{DVec2, DVec3};
use proptest::prelude::*;

const SIZE: DVec2 = DVec2::new(1280.0, 800.0);
/// Position of a typical survey: metres from the origin of its map projection.
const FAR_OUT: DVec3 = DVec3::new(1e7, -2e7, 300.0);

fn camera() -> Camera {
    Camera::new(FAR_OUT, FAR_OUT + DVec3::new(30.0, 40.0, -20.0), DVec3::Z, 1.0)
}

/// Pixel that a point is projected to.
fn pixel(camera: &Camera, point: DVec3) -> DVec2 {
    let v = camera.axes().transpose() * (point - camera.eye());
    let focal = SIZE.y * 0.5 / (camera.fovy_rad() * 0.5).tan();
    DVec2::new(SIZE.x * 0.5 + v.x * focal / -v.z, SIZE.y * 0.5 - v.y * focal / -v.z)
}

fn run(camera: &mut Camera, keys: DVec3, seconds: f64, frames: u32) {
    for _ in 0..frames {
        camera.step(keys, seconds / f64::from(frames));
    }
}

#[test]
fn a_point_projects_to_the_pixel_that_it_was_picked_at() {
    let camera = camera();
    for at in [DVec2::new(640.0, 400.0), DVec2::new(3.0, 790.0), DVec2::new(1200.0, 10.0)] {
        let point = camera.point_at(at, SIZE, 57.0);
        assert!(pixel(&camera, point).distance(at) < 1e-4);
        let depth = (point - camera.eye()).dot(camera.forward());
        assert!((depth - 57.0).abs() < 1e-6);
    }
}

#[test]
fn the_pivot_of_an_orbit_stays_at_its_pixel() {
    let mut camera = camera();
    let at = DVec2::new(300.0, 600.0);
    let pivot = camera.point_at(at, SIZE, 25.0);
    let distance = camera.eye().distance(pivot);
    for i in 0..200 {
        camera.orbit(pivot, 0.05, if i % 3 == 0 { 0.04 } else { -0.03 });
        assert!(pixel(&camera, pivot).distance(at) < 1e-3, "after {i} turns");
    }
    assert!((camera.eye().distance(pivot) - distance).abs() < 1e-6);
}

#[test]
fn the_target_of_a_zoom_stays_at_its_pixel_and_comes_nearer_by_the_ratio() {
    let mut camera = camera();
    let at = DVec2::new(1000.0, 150.0);
    let point = camera.point_at(at, SIZE, 40.0);
    let before = camera.eye().distance(point);
    camera.zoom(point, 0.5);
    for _ in 0..100 {
        camera.step(DVec3::ZERO, 0.02);
        assert!(pixel(&camera, point).distance(at) < 1e-3);
    }
    assert!((camera.eye().distance(point) / before - 0.5).abs() < 1e-3);
    assert!(!camera.is_moving());
}

#[test]
fn a_panned_point_follows_the_pointer() {
    let mut camera = camera();
    let at = DVec2::new(500.0, 300.0);
    let point = camera.point_at(at, SIZE, 33.0);
    camera.pan(120.0, -45.0, 33.0, SIZE.y);
    assert!(pixel(&camera, point).distance(at + DVec2::new(120.0, -45.0)) < 1e-3);
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
    assert!(slow.distance(fast) < 1e-3, "{slow} and {fast}");
    assert!(slow.length() > 50.0, "two seconds at a distance a second go far: {}", slow.length());
}

#[test]
fn flying_ahead_follows_the_view_and_flying_up_the_up_axis() {
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
fn the_camera_comes_to_rest() {
    let mut camera = camera();
    run(&mut camera, DVec3::ONE, 1.0, 30);
    assert!(camera.is_moving());
    run(&mut camera, DVec3::ZERO, 3.0, 90);
    assert!(!camera.is_moving());
    let pose = camera.pose();
    run(&mut camera, DVec3::ZERO, 1.0, 30);
    assert_eq!(
        camera.pose(),
        pose,
        "a camera at rest keeps its pose, so that nothing is drawn again"
    );
}

#[test]
fn flying_to_a_point_brings_it_to_the_middle_and_nearer() {
    let mut camera = camera();
    let point = camera.point_at(DVec2::new(200.0, 700.0), SIZE, 60.0);
    let before = camera.eye().distance(point);
    camera.fly_to(point);
    run(&mut camera, DVec3::ZERO, 1.0, 20);
    assert!(pixel(&camera, point).distance(SIZE * 0.5) < 1.0);
    assert!(camera.eye().distance(point) < before * 0.31);
    camera.go_home();
    run(&mut camera, DVec3::ZERO, 1.0, 20);
    assert_eq!(camera.eye(), FAR_OUT);
    assert!(!camera.is_moving());
}

/// An input of the camera.
#[derive(Clone, Debug)]
enum Move {
    Wheel { at: DVec2, depth: Option<f64>, ratio: f64 },
    Pan(DVec2, Option<f64>),
    Orbit { at: DVec2, depth: Option<f64>, turn: DVec2 },
    Look(DVec2),
    Fly { keys: DVec3, seconds: f64 },
    FlyTo(DVec2, Option<f64>),
    Depth(f64),
    Speed(f64),
    Home,
    Parallel(bool, Option<f64>),
}

impl Move {
    /// Applies the input, and lets the camera move for a while.
    fn make(&self, camera: &mut Camera) {
        let depth = |depth: Option<f64>| depth.unwrap_or(camera.distance());
        let point = |at: DVec2, d: Option<f64>| camera.point_at(at * SIZE, SIZE, depth(d));
        let mut keys = DVec3::ZERO;
        let mut seconds = 0.3;
        match *self {
            Self::Wheel { at, depth, ratio } => camera.zoom(point(at, depth), ratio),
            Self::Pan(by, d) => camera.pan(by.x, by.y, depth(d), SIZE.y),
            Self::Orbit { at, depth, turn } => camera.orbit(point(at, depth), turn.x, turn.y),
            Self::Look(turn) => camera.look(turn.x, turn.y),
            Self::FlyTo(at, depth) => camera.fly_to(point(at, depth)),
            Self::Depth(depth) => camera.follow_depth(depth, 1.0),
            Self::Speed(factor) => camera.change_speed(factor),
            Self::Home => camera.go_home(),
            Self::Parallel(is_parallel, d) => camera.set_parallel(is_parallel, depth(d)),
            Self::Fly { keys: held, seconds: length } => (keys, seconds) = (held, length),
        }
        run(camera, keys, seconds, 10);
    }
}

fn moves() -> impl Strategy<Value = Vec<Move>> {
    let share = || (0.0..1.0, 0.0..1.0).prop_map(|(x, y)| DVec2::new(x, y));
    let by = |most: f64| (-most..most, -most..most).prop_map(|(x, y)| DVec2::new(x, y));
    // Factors and depths of any size, the smallest and largest included.
    let size = || (-300.0f64..300.0).prop_map(|power| 10.0f64.powf(power));
    let depth = || prop::option::of((-3.0f64..6.0).prop_map(|power| 10.0f64.powf(power)));
    let keys = (-4.0..4.0, -4.0..4.0, -4.0..4.0)
        .prop_map(|(right, up, ahead)| DVec3::new(right, up, ahead));
    let one = prop_oneof![
        4 => (share(), depth(), size()).prop_map(|(at, depth, ratio)| Move::Wheel { at, depth, ratio }),
        1 => (by(1e5), depth()).prop_map(|(by, depth)| Move::Pan(by, depth)),
        1 => (share(), depth(), by(9.0)).prop_map(|(at, depth, turn)| Move::Orbit { at, depth, turn }),
        1 => by(9.0).prop_map(Move::Look),
        2 => (keys, 0.0..2.0).prop_map(|(keys, seconds)| Move::Fly { keys, seconds }),
        1 => (share(), depth()).prop_map(|(at, depth)| Move::FlyTo(at, depth)),
        1 => size().prop_map(Move::Depth),
        1 => size().prop_map(Move::Speed),
        1 => Just(Move::Home),
        1 => (any::<bool>(), depth()).prop_map(|(is_on, depth)| Move::Parallel(is_on, depth)),
    ];
    prop::collection::vec(one, 0..40)
}

proptest! {
    #[test]
    fn home_is_reached_after_any_moves(moves in moves()) {
        let (low, high) = (FAR_OUT + 5.0, FAR_OUT + DVec3::new(60.0, 80.0, 9.0));
        let mut camera = camera().with_scene([low, high]);
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

/// The camera with a parallel picture.
fn parallel() -> Camera {
    let (low, high) =
        (FAR_OUT + DVec3::new(5.0, 5.0, -30.0), FAR_OUT + DVec3::new(60.0, 80.0, 9.0));
    let mut camera = camera().with_scene([low, high]);
    camera.set_parallel(true, camera.distance());
    camera
}

/// Pixel and depth of a point in the picture that is drawn.
fn drawn(camera: &Camera, point: DVec3) -> (DVec2, f64) {
    let view = camera.view([SIZE.x as u32, SIZE.y as u32]);
    let on = view.project(point).unwrap();
    (on.truncate(), on.z + camera.depth_offset(&view))
}

#[test]
fn a_parallel_picture_shows_points_where_they_are_picked() {
    let camera = parallel();
    let across = camera.height() / SIZE.y;
    // The sphere around the scene begins 6.5 before the eye of the camera.
    for (at, depth) in [(DVec2::new(640.0, 400.0), 57.0), (DVec2::new(3.0, 790.0), -6.0)] {
        let point = camera.point_at(at, SIZE, depth);
        let (pixel, seen) = drawn(&camera, point);
        assert!(pixel.distance(at) < 1e-4 && (seen - depth).abs() < 1e-6, "{pixel} {seen}");
        let beside = camera.point_at(at + DVec2::X, SIZE, depth);
        assert!((beside.distance(point) - across).abs() < 1e-6, "one length at any depth");
    }
}

#[test]
fn another_projection_keeps_the_size_of_what_is_at_its_depth() {
    let mut camera = camera().with_scene([FAR_OUT - 70.0, FAR_OUT + 70.0]);
    for depth in [3.0, 40.0, 90.0] {
        let at = [DVec2::new(640.0, 400.0), DVec2::new(900.0, 150.0)];
        let points = at.map(|at| camera.point_at(at, SIZE, depth));
        camera.set_parallel(true, depth);
        for (at, point) in at.iter().zip(points) {
            assert!(drawn(&camera, point).0.distance(*at) < 1e-3, "{depth}: parallel");
        }
        // What was there is at the same depth, until the camera moves.
        camera.zoom(points[0], 0.7);
        run(&mut camera, DVec3::ZERO, 1.0, 50);
        let seen = points.map(|point| drawn(&camera, point));
        camera.set_parallel(false, seen[0].1);
        for ((at, _), point) in seen.iter().zip(points) {
            assert!(drawn(&camera, point).0.distance(*at) < 1e-3, "{depth}: perspective");
        }
        camera.go_home();
        run(&mut camera, DVec3::ZERO, 1.0, 50);
    }
}

#[test]
fn zooming_a_parallel_picture_changes_its_height_around_the_pointer() {
    let mut camera = parallel();
    let at = DVec2::new(1000.0, 150.0);
    for depth in [50.0, -7.0] {
        let (point, before) = (camera.point_at(at, SIZE, depth), camera.height());
        camera.zoom(point, 0.5);
        for _ in 0..100 {
            camera.step(DVec3::ZERO, 0.02);
            assert!(drawn(&camera, point).0.distance(at) < 1e-3);
        }
        assert!((camera.height() / before - 0.5).abs() < 1e-3 && !camera.is_moving());
    }
}

#[test]
fn a_parallel_picture_is_panned_and_turned_around_the_pointer() {
    let mut camera = parallel();
    let at = DVec2::new(500.0, 300.0);
    let point = camera.point_at(at, SIZE, 33.0);
    camera.pan(120.0, -45.0, 33.0, SIZE.y);
    let moved = at + DVec2::new(120.0, -45.0);
    assert!(drawn(&camera, point).0.distance(moved) < 1e-3);
    for i in 0..200 {
        camera.orbit(point, 0.05, if i % 3 == 0 { 0.04 } else { -0.03 });
        assert!(drawn(&camera, point).0.distance(moved) < 1e-3, "after {i} turns");
    }
}

#[test]
fn flying_ahead_in_a_parallel_picture_magnifies_its_middle_and_nothing_is_cut_off() {
    let mut camera = parallel();
    let middle = camera.point_at(SIZE * 0.5, SIZE, 20.0);
    let before = camera.height();
    run(&mut camera, DVec3::Z, 0.5, 30);
    assert!(camera.height() < before * 0.8);
    let (at, _) = drawn(&camera, middle);
    assert!(at.distance(SIZE * 0.5) < 1e-3);
    // Also what lies behind the eye of the camera is drawn.
    let behind = camera.point_at(SIZE * 0.5, SIZE, -15.0);
    assert!(drawn(&camera, behind).0.distance(SIZE * 0.5) < 1e-3);
    run(&mut camera, DVec3::NEG_Z, 0.5, 30);
    assert!((camera.height() / before - 1.0).abs() < 0.02);
}

#[test]
fn flying_to_a_point_of_a_parallel_picture_keeps_its_direction() {
    let mut camera = parallel();
    let point = camera.point_at(DVec2::new(200.0, 700.0), SIZE, 60.0);
    let (before, forward) = (camera.height(), camera.forward());
    camera.fly_to(point);
    run(&mut camera, DVec3::ZERO, 1.0, 20);
    assert!(drawn(&camera, point).0.distance(SIZE * 0.5) < 1e-3);
    assert!((camera.height() / before - 0.3).abs() < 1e-6);
    assert_eq!(camera.forward(), forward);
    assert!(camera.is_parallel() && !camera.is_moving());
}

#[test]
fn keys_end_a_glide() {
    let mut camera = camera();
    let point = camera.point_at(SIZE * 0.5, SIZE, 60.0);
    camera.fly_to(point);
    run(&mut camera, DVec3::X, 0.1, 5);
    run(&mut camera, DVec3::ZERO, 3.0, 60);
    assert!(camera.eye().distance(point) > 50.0, "the glide has ended");
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
        assert!(
            camera.forward().distance(to_target) < 1e-3,
            "{up}: the camera looks at its target"
        );
        camera.look(1.0, 0.3);
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        assert!(camera.axes().x_axis.dot(up).abs() < 1e-9, "{up}: the horizon is level");
    }
}

#[test]
fn the_viewing_distance_follows_depths_and_the_speed_stays_in_its_range() {
    let mut camera = camera();
    for _ in 0..200 {
        camera.follow_depth(1500.0, 0.02);
    }
    assert!((camera.distance() / 1500.0 - 1.0).abs() < 0.01);
    camera.follow_depth(f64::INFINITY, 0.02);
    camera.follow_depth(f64::NAN, 0.02);
    camera.follow_depth(0.0, 0.02);
    assert!(camera.distance().is_finite() && camera.distance() > 0.0);
    for _ in 0..100 {
        camera.change_speed(10.0);
    }
    assert_eq!(camera.speed(), 100.0);
}

#[test]
fn slow_frames_do_not_move_the_camera_far_away() {
    let mut camera = camera();
    camera.step(DVec3::Z, 1e9);
    camera.step(DVec3::Z, f64::NAN);
    camera.step(DVec3::Z, -5.0);
    assert!(camera.eye().distance(FAR_OUT) < 100.0);
}
