//! Views of the whole scan: the first one, as the command line requests it, and those from the
//! sides, in perspective or parallel (orthographic). A file, a request and the axis that points
//! upwards go in, cameras come out.

use crate::camera::Camera;
use esker_engine::calls::info;
use esker_engine::cameras::camera::{Camera as CameraRequest, OrthoHeight};
use esker_engine::cameras::up::upright;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::{Forest, Lattice};
use glam::DVec3;

/// Greatest part of the axis of elevations to the right of a picture in which it is upwards.
const LEVEL: f64 = 1e-9;
/// Greatest difference between the axes of a camera and those of the request that it stands for.
const TURNED: f64 = 1e-6;

/// A side from which the scan is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// From above.
    Top,
    /// From below.
    Bottom,
    /// From the front.
    Front,
    /// From behind.
    Back,
    /// From the left.
    Left,
    /// From the right.
    Right,
    /// From the front, the right and above, each axis as short as the others.
    Isometric,
}

/// Views of a file.
pub struct Views {
    /// The first view as the command line requests it, with the up direction that was guessed.
    request: CameraRequest,
    /// The same in the scan's coordinates.
    given: CameraRequest,
    /// The axis that points upwards.
    vertical: Vertical,
    /// Why it does, if that was guessed.
    note: Option<&'static str>,
    /// The box that views are fitted to.
    bounds: [[f64; 3]; 2],
    /// Lattice of the scan's coordinates.
    lattice: Lattice,
}

impl Views {
    /// Views of a file without the clouds `hidden`, of which `given` is the first one.
    pub fn new(file: &Forest, given: &CameraRequest, hidden: &[usize]) -> Self {
        let measured = given.measured(file.lattice());
        let (request, vertical, guess) = upright(file, measured, info::bounds(file));
        let given = CameraRequest { up: request.up, ..*given };
        let note = guess.map(|guess| guess.reason());
        let bounds = info::fitted_bounds_without(file, hidden);
        Self { request, given, vertical, note, bounds, lattice: *file.lattice() }
    }

    /// The axis that points upwards.
    pub fn vertical(&self) -> Vertical {
        self.vertical
    }

    /// Why it does, if that was guessed.
    pub fn note(&self) -> Option<&'static str> {
        self.note
    }

    /// Makes another axis point upwards. The first view then shows all of the scan.
    pub fn set_vertical(&mut self, vertical: Vertical) {
        let CameraRequest { fovy_deg, ortho, .. } = self.request;
        let ortho = ortho.map(|_| OrthoHeight::Fit);
        let up = Some(vertical.direction());
        self.request = CameraRequest { up, fovy_deg, ortho, ..CameraRequest::default() };
        (self.vertical, self.note) = (vertical, None);
    }

    /// The first view, for a picture of `size` pixels.
    pub fn first(&self, size: [u32; 2]) -> Camera {
        self.camera(&self.request, size)
    }

    /// The first view as a parallel or a perspective one. If the request is for the other kind,
    /// all of the scan is shown.
    pub fn home(&self, is_parallel: bool, size: [u32; 2]) -> Camera {
        let mut request = self.request;
        if request.ortho.is_some() != is_parallel {
            request.ortho = is_parallel.then_some(OrthoHeight::Fit);
            request.fovy_deg = request.fovy_deg.filter(|_| !is_parallel);
            if let (Some(eye), None) = (request.eye, request.direction) {
                let [low, high] = self.bounds.map(DVec3::from_array);
                request.direction = Some(request.target.unwrap_or(low.midpoint(high)) - eye);
            }
            (request.eye, request.target) = (None, None);
        }
        self.camera(&request, size)
    }

    /// View of all of the scan from a side, with the field of view of the first one.
    pub fn seen_from(&self, side: Side, is_parallel: bool, size: [u32; 2]) -> Camera {
        let (direction, up) = towards(self.vertical, side);
        self.along(direction, up, is_parallel, size)
    }

    /// View of all of the scan along the axis of a direction, from the side to which it points.
    pub fn along_axis(&self, axis: DVec3, is_parallel: bool, size: [u32; 2]) -> Camera {
        let up = self.vertical.direction();
        let steep = axis.dot(up);
        match steep {
            s if s > 0.5 => self.seen_from(Side::Top, is_parallel, size),
            s if s < -0.5 => self.seen_from(Side::Bottom, is_parallel, size),
            _ => self.along(-axis, up, is_parallel, size),
        }
    }

    fn along(&self, direction: DVec3, up: DVec3, is_parallel: bool, size: [u32; 2]) -> Camera {
        let request = CameraRequest {
            direction: Some(direction),
            up: Some(up),
            fovy_deg: self.request.fovy_deg.filter(|_| !is_parallel),
            ortho: is_parallel.then_some(OrthoHeight::Fit),
            ..CameraRequest::default()
        };
        self.camera(&request, size)
    }

    fn camera(&self, request: &CameraRequest, size: [u32; 2]) -> Camera {
        let view = request.view(self.bounds, size);
        let scene = self.bounds.map(DVec3::from_array);
        let (up, vertical) = (request.up.unwrap_or(DVec3::Z), self.vertical.direction());
        // In a plan, the request's up is a side of the picture. Where the axis of elevations is
        // upwards in the picture too, or along the view, it is the one to turn around.
        let is_level = vertical.dot(view.world_from_view.x_axis).abs() < LEVEL;
        let is_upright = Vertical::nearest(up) == self.vertical && !is_level;
        let up = if is_upright { up } else { vertical };
        let target = request.target.filter(|_| request.eye.is_some());
        let camera = Camera::of_view(&view, up, target, scene).on_lattice(&self.lattice);
        let is_seen_so = camera.axes().abs_diff_eq(view.world_from_view, TURNED);
        if is_seen_so && request == &self.request && is_complete(request) {
            camera.given(self.given)
        } else {
            camera
        }
    }
}

/// Whether no part of a request is fitted to the scan or to the size of pictures.
fn is_complete(request: &CameraRequest) -> bool {
    let has_direction = request.direction.is_some() || request.target.is_some();
    match request.ortho {
        Some(OrthoHeight::Units(_)) => {
            has_direction && (request.eye.is_some() || request.target.is_some())
        }
        Some(OrthoHeight::Fit) => false,
        None => has_direction && request.eye.is_some(),
    }
}

/// Direction of the view from a side, and what is upwards in its picture.
fn towards(vertical: Vertical, side: Side) -> (DVec3, DVec3) {
    let (ahead, up) = (ahead(vertical), vertical.direction());
    let right = ahead.cross(up);
    match side {
        Side::Top => (-up, ahead),
        Side::Bottom => (up, -ahead),
        Side::Front => (ahead, up),
        Side::Back => (-ahead, up),
        Side::Left => (right, up),
        Side::Right => (-right, up),
        Side::Isometric => (ahead - right - up, up),
    }
}

/// Direction of the view from the front: along y where z is up, as surveys have it, so that x is to
/// the right; along -z where y is up, as models have it; along z where -y is up, as cameras have
/// it.
fn ahead(vertical: Vertical) -> DVec3 {
    match (vertical.axis(), vertical.is_down()) {
        (1, false) => DVec3::NEG_Z,
        (1, true) => DVec3::Z,
        _ => DVec3::Y,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_engine::cameras::boxes::Boxes;
    use esker_engine::document;
    use esker_engine::draw::scene::PictureRequest;
    use glam::{DMat3, DVec2};

    const SIDES: [Side; 7] = [
        Side::Top,
        Side::Bottom,
        Side::Front,
        Side::Back,
        Side::Left,
        Side::Right,
        Side::Isometric,
    ];
    const SIZE: [u32; 2] = [900, 600];
    const LATTICE: Lattice =
        Lattice { scale: [0.001; 3], offset: [0.0; 3], shift: [0; 3], factor: [1.0; 3] };

    fn views(vertical: Vertical) -> Views {
        let bounds = [[1e6, 2e6, -3.0], [1e6 + 80.0, 2e6 + 50.0, 40.0]];
        let request = CameraRequest { up: Some(vertical.direction()), ..CameraRequest::default() };
        let lattice = LATTICE;
        Views { request, given: request, vertical, note: None, bounds, lattice }
    }

    fn verticals() -> impl Iterator<Item = Vertical> {
        (0..3).flat_map(|axis| [false, true].map(|is_down| Vertical::of(axis, is_down)))
    }

    #[test]
    fn every_side_shows_all_of_the_scan_with_its_axes_where_they_belong() {
        for vertical in verticals() {
            let views = views(vertical);
            for (side, is_parallel) in SIDES.into_iter().flat_map(|s| [(s, false), (s, true)]) {
                let camera = views.seen_from(side, is_parallel, SIZE);
                assert_eq!(camera.is_parallel(), is_parallel);
                let (direction, up) = towards(vertical, side);
                let what = format!("{side:?} with {vertical} up");
                assert!(camera.forward().angle_between(direction) < 1e-6, "{what}");
                assert!(camera.axes().y_axis.dot(up) > 0.5, "{what}");
                let view = camera.view(SIZE);
                let off = DMat3::abs_diff_eq(&view.world_from_view, camera.axes(), 1e-6);
                assert!(off, "{what}: the picture is turned");
                let mut span = [DVec2::INFINITY, DVec2::NEG_INFINITY];
                for corner in 0..8 {
                    let p = [0, 1, 2].map(|axis| views.bounds[corner >> axis & 1][axis]);
                    let on = view.project(p.into()).unwrap();
                    assert!(view.is_on_picture(on), "{what}: {p:?} is at {on}");
                    span = [span[0].min(on.truncate()), span[1].max(on.truncate())];
                }
                let share = (span[1] - span[0]) / DVec2::new(900.0, 600.0);
                assert!(share.max_element() > 0.8, "{what}: the scan takes {share} of the picture");
            }
        }
    }

    #[test]
    fn surveys_have_x_to_the_right_and_y_upwards_in_a_plan() {
        let camera = views(Vertical::default()).seen_from(Side::Top, true, SIZE);
        let axes = camera.axes();
        assert!(axes.x_axis.distance(DVec3::X) < 1e-9 && axes.y_axis.distance(DVec3::Y) < 1e-9);
        let front = views(Vertical::default()).seen_from(Side::Front, true, SIZE).axes();
        assert!(front.x_axis.distance(DVec3::X) < 1e-9 && front.y_axis.distance(DVec3::Z) < 1e-9);
    }

    #[test]
    fn the_first_view_is_that_of_the_engine_and_a_plan_keeps_its_heading() {
        for (text, is_complete) in [
            ("", false),
            ("direction=0,0,-1;up=1,0.2,0;ortho=60", false),
            ("eye=1e6,2e6,90;target=1000040,2000025,0", true),
            ("eye=1000000.3,2000000.7,90;direction=0.7,0.2,-0.13;fovy=41.3", true),
            ("eye=1000000.3,2000000.7,90;direction=0,0,-3;up=0.3,0.7,0;fovy=41.3", true),
            ("target=1000000.3,2000000.7,9;direction=0,0,-1;up=1,0.2,0;ortho=60.1", true),
            ("eye=1000000.3,2000000.7,90;target=1000007,2000003,9;up=0,0.1,1;ortho=60.1", true),
        ] {
            let (request, views) =
                (CameraRequest::parse(text).unwrap(), views(Vertical::default()));
            let wanted = request.view(views.bounds, SIZE);
            let views = Views { request, given: request, ..views };
            let view = views.first(SIZE).view(SIZE);
            assert!(!is_complete || view == wanted, "{text}: {view:?} is not {wanted:?}");
            for corner in 0..8 {
                let p = [0, 1, 2].map(|axis| views.bounds[corner >> axis & 1][axis]);
                let [a, b] = [&wanted, &view].map(|view| view.project(p.into()).unwrap());
                assert!(a.truncate().distance(b.truncate()) < 1e-3, "{text}: {a} and {b}");
            }
        }
    }

    /// The request of a camera, written as a document and read again.
    fn saved(camera: CameraRequest) -> CameraRequest {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.json");
        let request = PictureRequest { camera, ..PictureRequest::of_options() };
        document::save(&path, &[], None, &request).unwrap();
        document::Document::read(&path).unwrap().request().unwrap().camera
    }

    /// Checks that documents with the view of `camera` have the same picture and vertical, here and
    /// in a window that opens them.
    fn check_saved(camera: &Camera, views: &Views, boxes: Boxes, size: [u32; 2], what: &str) {
        let read = saved(camera.request());
        let measured = read.measured(&views.lattice);
        let view = camera.view(size);
        assert_eq!(measured.view_in(&boxes, size), view, "{what}");
        assert_eq!(measured.vertical(boxes.all), views.vertical, "{what}");
        let reopened = Views { request: measured, given: read, ..*views };
        let mut again = reopened.first(size);
        again.set_boxes(boxes);
        assert_eq!(again.view(size), view, "{what}: opened again");
        assert!(again.up().distance(camera.up()) < 1e-9, "{what}: {}", again.up());
        let parts = [again.eye().distance(camera.eye()), again.height() - camera.height()];
        if camera.is_parallel() {
            assert!(parts[1].abs() < 1e-9 * camera.height(), "{what}: {parts:?}");
        } else {
            assert!(parts[0] < 1e-6, "{what}: {parts:?}");
        }
        // Its request is the same once it has moved, but for rounding.
        again.look(0.1, 0.0);
        assert_ne!(again.request(), read, "{what}");
    }

    #[test]
    fn a_document_of_any_view_has_the_same_picture_to_the_bit() {
        let uneven = Lattice { factor: [0.7, 1.1, 1.0], ..LATTICE };
        for (vertical, lattice) in
            verticals().flat_map(|vertical| [LATTICE, uneven].map(|of| (vertical, of)))
        {
            let views = Views { lattice, ..views(vertical) };
            for (side, is_parallel) in SIDES.into_iter().flat_map(|s| [(s, false), (s, true)]) {
                let what = format!("{side:?}, {vertical} up, parallel: {is_parallel}");
                let size = [901, 333];
                let mut camera = views.seen_from(side, is_parallel, size);
                let [low, high] = views.bounds;
                let fitted = [low.map(|v| v + 1.3), high.map(|v| v - 2.7)];
                for boxes in [Boxes::equal(views.bounds), Boxes { all: views.bounds, fitted }] {
                    camera.set_boxes(boxes);
                    check_saved(&camera, &views, boxes, size, &what);
                    check_saved(&camera, &views, boxes, [640, 1001], &what);
                }
                let boxes = Boxes { all: views.bounds, fitted };
                let middle = DVec3::from_array(low).midpoint(high.into());
                camera.pan(13.0, -7.0, 40.0, 333.0);
                check_saved(&camera, &views, boxes, size, &format!("{what}, moved"));
                camera.zoom(middle, 0.3);
                (0..200).for_each(|_| camera.step(DVec3::ZERO, 0.05));
                check_saved(&camera, &views, boxes, size, &format!("{what}, nearer"));
                camera.orbit(middle, 0.7, -0.2);
                check_saved(&camera, &views, boxes, size, &format!("{what}, turned"));
            }
        }
    }

    #[test]
    fn another_axis_upwards_shows_all_of_the_scan_anew() {
        let mut views = views(Vertical::default());
        views.request = CameraRequest::parse("eye=1,2,3;target=4,5,6;fovy=40").unwrap();
        views.set_vertical(Vertical::of(1, false));
        let camera = views.first(SIZE);
        assert!((camera.fovy_rad().to_degrees() - 40.0).abs() < 1e-9);
        assert_eq!(camera.up(), DVec3::Y);
        let view = camera.view(SIZE);
        let middle = DVec3::from_array(views.bounds[0]).midpoint(views.bounds[1].into());
        assert!(view.is_on_picture(view.project(middle).unwrap()));
    }
}
