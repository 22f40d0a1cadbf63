//! Motion of the camera: flying, looking around, orbiting, zooming, panning, and gliding to a
//! point. Seconds and pixels go in, a pose comes out; nothing depends on a window or a clock.
//! Arithmetic is `f64` relative to the eye, so that the picture does not shake at coordinates of
//! 10^7. Velocities and zooms decay exponentially in time, so that the path does not depend on the
//! frame rate. A parallel (orthographic) picture shows lengths as a perspective one shows those at
//! the viewing distance, so that zooming and flying ahead change the height of the picture.

use crate::pose::{DISTANCE, GLIDE_S, Glide, MoveLimits, PITCH_MAX_RAD};
use esker_engine::cameras::boxes::Boxes;
use esker_engine::cameras::camera::{Camera as CameraRequest, OrthoHeight};
use esker_engine::{Lattice, View};
use glam::{DMat3, DVec2, DVec3};

pub use crate::pose::{Frame, Pose};

/// Time constant of velocities and zooms, seconds: all but 1/e of the rest is covered in it.
const EASE_S: f64 = 0.09;
/// Velocity, in viewing distances a second, below which the camera stops once no key is held: at 60
/// frames a second, half a pixel a frame of a picture some 700 pixels high.
const STILL: f64 = 0.04;
/// Logarithm of the ratio of distances that is left of a zoom when it ends at once: the border of
/// such a picture moves by half a pixel.
const ZOOM_LEFT: f64 = 1.5e-3;
/// Least speed of flying, in sizes of the scene a second at a speed of 1: near walls the viewing
/// distance goes to zero.
const PACE_MIN: f64 = 0.01;
/// Field of view of the perspective picture that takes the place of a parallel one, radians.
const PARALLEL_FOVY_RAD: f64 = std::f64::consts::FRAC_PI_3;
/// Share of the distance to a point that is left after flying to it.
const NEARER: f64 = 0.3;
/// Least distance of the target of a request, as a share of the size of coordinates, so that
/// rounding them does not turn the view.
const TARGET: f64 = 1e-6;
/// A lattice whose coordinates are lengths.
const UNIT: Lattice =
    Lattice { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3], factor: [1.0; 3] };
/// Longest time step, seconds, so that a slow frame does not move the camera far away.
const STEP_MAX_S: f64 = 0.25;
/// Range of the speed, in viewing distances a second.
const SPEED: [f64; 2] = [0.01, 100.0];

/// What a view depends on, except the size of the picture: pose, whether it is parallel, and its
/// height or field of view.
pub type Seen = (Pose, bool, f64);

/// A camera that moves by itself and by the user's input.
#[derive(Clone, Debug)]
pub struct Camera {
    frame: Frame,
    limits: MoveLimits,
    /// Boxes of what is shown.
    boxes: Boxes,
    /// Lattice of the scan's coordinates; those of the camera are on its metric lattice.
    lattice: Lattice,
    /// Distance of the target of requests, and the pose for which it was set. The viewing distance
    /// follows the scene also while the camera rests, and the view may not change with it.
    target: (Pose, f64),
    /// The request that the camera was made for, if no part of it is fitted, and its view.
    given: Option<(CameraRequest, Seen)>,
    pose: Pose,
    home: Pose,
    /// Viewing distance of the first view.
    home_distance: f64,
    fovy_rad: f64,
    /// Whether the picture is a parallel one.
    is_parallel: bool,
    /// Viewing distance: distance to the scene, which a speed of 1 covers in a second.
    distance: f64,
    speed: f64,
    /// Speed of flying, the file's unit a second, if it does not follow the viewing distance.
    fixed_pace: Option<f64>,
    velocity: DVec3,
    /// Rest of a zoom: logarithm of the ratio of distances, and the point that it approaches.
    zoom: Option<(f64, DVec3)>,
    glide: Option<Glide>,
}

impl Camera {
    /// Makes a camera at `eye` that looks at `target`; [`Camera::go_home`] returns to this view.
    /// The size of the scene is their distance, unless [`Camera::with_scene`] sets it.
    pub fn new(eye: DVec3, target: DVec3, up: DVec3, fovy_rad: f64) -> Self {
        let frame = Frame::new(up);
        let (yaw, pitch) = frame.angles(target - eye, 0.0);
        let pose = Pose { eye, yaw, pitch };
        let distance = positive(eye.distance(target)).unwrap_or(1.0);
        Self {
            frame,
            limits: MoveLimits { middle: target, size: distance },
            boxes: Boxes::equal([target.to_array(); 2]),
            lattice: UNIT,
            target: (pose, distance),
            given: None,
            pose,
            home: pose,
            home_distance: distance,
            fovy_rad,
            is_parallel: false,
            distance,
            speed: 1.0,
            fixed_pace: None,
            velocity: DVec3::ZERO,
            zoom: None,
            glide: None,
        }
    }

    /// Makes a camera with the picture of `view`. Without a target, its viewing distance is that of
    /// the middle of the scene, whose bounds are `scene`.
    pub fn of_view(view: &View, up: DVec3, target: Option<DVec3>, scene: [DVec3; 2]) -> Self {
        /// Least viewing distance, the file's unit.
        const NEAREST: f64 = 1e-6;
        let (ahead, middle) = (view.forward(), scene[0].midpoint(scene[1]));
        let camera = match view.parallel_at {
            None => {
                let distance = view.eye.distance(target.unwrap_or(middle)).max(NEAREST);
                Self::new(view.eye, view.eye + ahead * distance, up, view.fovy_rad)
            }
            Some(depth) => {
                let height = 2.0 * depth * view.tan_half().y;
                let distance = height * 0.5 / (PARALLEL_FOVY_RAD * 0.5).tan();
                let eye = view.eye + ahead * (view.depth(middle) - distance);
                let camera = Self::new(eye, eye + ahead * distance, up, PARALLEL_FOVY_RAD);
                Self { is_parallel: true, ..camera }
            }
        };
        let pitch = ahead.dot(camera.frame.up()).clamp(-1.0, 1.0).asin();
        if pitch.abs() <= PITCH_MAX_RAD {
            return camera.with_scene(scene);
        }
        // What is upwards in the picture of a view straight down lies ahead, and of one straight up
        // behind.
        let heading = view.world_from_view.y_axis * -pitch.signum();
        let (yaw, _) = camera.frame.angles(heading, 0.0);
        let pose = Pose { yaw, pitch, ..camera.pose };
        Self { pose, home: pose, ..camera }.with_scene(scene)
    }

    /// Sets the bounds of the scene.
    pub fn with_scene(self, [low, high]: [DVec3; 2]) -> Self {
        let middle = low.midpoint(high);
        let size = high.distance(low) + self.home.eye.distance(middle);
        let boxes = Boxes::equal([low.to_array(), high.to_array()]);
        let Some(size) = positive(size) else { return Self { boxes, ..self } };
        let limits = MoveLimits { middle, size };
        let distance = limits.clamp_distance(self.home_distance);
        Self { limits, boxes, home_distance: distance, distance, ..self }
    }

    /// Sets the lattice of the scan's coordinates.
    pub fn on_lattice(self, lattice: &Lattice) -> Self {
        Self { lattice: *lattice, ..self }
    }

    /// Keeps the request that the camera was made for, in the scan's coordinates, as that of its
    /// view, until it moves. No part of it may be fitted to the scan or to a size of pictures.
    pub fn given(self, request: CameraRequest) -> Self {
        Self { given: Some((request, self.seen())), ..self }
    }

    /// Sets the boxes of what is shown. The limits of movement stay.
    pub fn set_boxes(&mut self, boxes: Boxes) {
        self.boxes = boxes;
    }

    /// Present pose.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Position of the eye, world.
    pub fn eye(&self) -> DVec3 {
        self.pose.eye
    }

    /// Up axis of the world.
    pub fn up(&self) -> DVec3 {
        self.frame.up()
    }

    /// Right, up and back axes, world.
    pub fn axes(&self) -> DMat3 {
        self.frame.axes(self.pose.yaw, self.pose.pitch)
    }

    /// Viewing direction.
    pub fn forward(&self) -> DVec3 {
        -self.axes().z_axis
    }

    /// Vertical field of view, radians.
    pub fn fovy_rad(&self) -> f64 {
        self.fovy_rad
    }

    /// Whether the picture is a parallel (orthographic) one.
    pub fn is_parallel(&self) -> bool {
        self.is_parallel
    }

    /// Makes the picture a parallel one, or a perspective one. What lies at the eye depth `depth`
    /// keeps its size.
    pub fn set_parallel(&mut self, is_parallel: bool, depth: f64) {
        if is_parallel == self.is_parallel {
            return;
        }
        self.stop_animation();
        self.velocity = DVec3::ZERO;
        if is_parallel {
            self.distance = self.limits.clamp_distance(positive(depth).unwrap_or(self.distance));
        } else if depth.is_finite() {
            // To the viewing distance from what lies at this depth.
            self.move_to(self.pose.eye + self.forward() * (depth - self.distance));
        }
        self.is_parallel = is_parallel;
    }

    /// Height of a parallel picture, and of a perspective one at the viewing distance; the file's
    /// unit.
    pub fn height(&self) -> f64 {
        2.0 * self.distance * (self.fovy_rad * 0.5).tan()
    }

    /// View for a picture of this size, pixels: that of [`Camera::request`], to the bit, so that
    /// the picture of a saved scene is the same.
    pub fn view(&self, size: [u32; 2]) -> View {
        self.request().measured(&self.lattice).view_in(&self.boxes, size)
    }

    /// The view as a request of pictures, in the scan's coordinates. It is constant while the
    /// camera rests.
    pub fn request(&self) -> CameraRequest {
        if let Some((request, seen)) = self.given
            && seen == self.seen()
        {
            return request;
        }
        let ahead = along_axes(self.forward());
        let request = CameraRequest { up: Some(self.request_up(ahead)), ..Default::default() };
        let request = if self.is_parallel {
            // Without an eye, which the engine places before all of the scan.
            let target = Some(self.pose.eye + ahead * self.distance);
            let ortho = Some(OrthoHeight::Units(self.height()));
            CameraRequest { target, direction: Some(ahead), ortho, ..request }
        } else {
            let eye = self.pose.eye;
            let far = self.target.1.max(eye.abs().max_element() * TARGET);
            let fovy_deg = Some(self.fovy_rad.to_degrees());
            CameraRequest { eye: Some(eye), target: Some(eye + ahead * far), fovy_deg, ..request }
        };
        request.unmeasured(&self.lattice)
    }

    /// Up direction of the request of a view along `ahead`: its nearest axis is that of elevations,
    /// and it chooses what is upwards in the picture.
    fn request_up(&self, ahead: DVec3) -> DVec3 {
        let up = self.frame.up();
        if self.pose.pitch.abs() > PITCH_MAX_RAD {
            // Along the up axis, the heading decides what is upwards in the picture.
            return along_axes(up + self.axes().y_axis * 0.5);
        }
        // Where an up direction across z would be that of a plan, a part along the view, which does
        // not change the picture, makes it that of elevations.
        let is_plan = self.is_parallel && up.z.abs() < 0.5 && ahead.z.abs() > 0.5;
        if is_plan { up + ahead * 0.25_f64.copysign(up.z * ahead.z) } else { up }
    }

    /// What the view depends on.
    pub fn seen(&self) -> Seen {
        let length = if self.is_parallel { self.height() } else { self.fovy_rad };
        (self.pose, self.is_parallel, length)
    }

    /// What is added to eye depths of [`Camera::view`] for those of the camera: the eye of a
    /// parallel view lies far behind that of the camera, and its depths may be negative here.
    pub fn depth_offset(&self, view: &View) -> f64 {
        if self.is_parallel { -view.depth(self.pose.eye) } else { 0.0 }
    }

    /// Viewing distance, the file's unit.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Speed, in viewing distances a second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Speed of flying, the file's unit a second.
    pub fn pace(&self) -> f64 {
        match self.fixed_pace {
            Some(pace) => pace,
            None => self.speed * self.distance.max(self.limits.size * PACE_MIN),
        }
    }

    /// Whether the speed of flying stays as it is, instead of following the viewing distance.
    pub fn has_fixed_pace(&self) -> bool {
        self.fixed_pace.is_some()
    }

    /// Keeps the present speed of flying, or lets it follow the viewing distance again.
    pub fn fix_pace(&mut self, is_fixed: bool) {
        if is_fixed != self.has_fixed_pace() {
            self.fixed_pace = is_fixed.then(|| self.pace());
        }
    }

    /// Whether the camera moves without input: it is gliding, zooming or slowing down.
    pub fn is_moving(&self) -> bool {
        self.glide.is_some() || self.zoom.is_some() || self.velocity != DVec3::ZERO
    }

    /// Length of a pixel at this eye depth, in a picture of this height; the file's unit.
    pub fn pixel_at(&self, depth: f64, height_px: f64) -> f64 {
        let depth = if self.is_parallel { self.distance } else { depth };
        depth / self.focal_px(height_px)
    }

    /// Point behind a pixel at this eye depth, world.
    pub fn point_at(&self, pixel: DVec2, size: DVec2, depth: f64) -> DVec3 {
        let across = DVec2::new(pixel.x - size.x * 0.5, size.y * 0.5 - pixel.y);
        let across = across * self.pixel_at(depth, size.y);
        self.pose.eye + self.axes() * across.extend(-depth)
    }

    /// Makes the viewing distance approach `depth`, the eye depth of the scene, slowly, so that the
    /// speed does not jump when a near object passes by.
    pub fn follow_depth(&mut self, depth: f64, seconds: f64) {
        let Some(depth) = positive(depth).filter(|_| !self.is_parallel) else { return };
        let share = 1.0 - (-clamp_step(seconds) / (4.0 * EASE_S)).exp();
        self.distance =
            self.limits.clamp_distance(self.distance * (depth / self.distance).powf(share));
        if self.target.0 != self.pose {
            self.target = (self.pose, self.distance);
        }
    }

    /// Multiplies the speed by `factor`.
    pub fn change_speed(&mut self, factor: f64) {
        match &mut self.fixed_pace {
            Some(pace) => {
                let [least, most] = SPEED.map(|speed| speed * self.limits.size);
                *pace = (*pace * factor).clamp(least * PACE_MIN, most);
            }
            None => self.speed = (self.speed * factor).clamp(SPEED[0], SPEED[1]),
        }
    }

    /// Turns the camera in point, radians to the left and upwards.
    pub fn look(&mut self, left: f64, up: f64) {
        self.stop_animation();
        self.turn(left, up);
    }

    /// Turns the camera around `pivot`, which stays at its pixel.
    pub fn orbit(&mut self, pivot: DVec3, left: f64, up: f64) {
        self.stop_animation();
        let before = self.axes();
        let arm = self.pose.eye - pivot;
        self.turn(left, up);
        self.move_to(pivot + self.axes() * (before.transpose() * arm));
    }

    /// Moves sideways, so that a point at this eye depth follows the pointer; pixels to the right
    /// and down.
    pub fn pan(&mut self, right_px: f64, down_px: f64, depth: f64, height_px: f64) {
        self.stop_animation();
        let axes = self.axes();
        let scale = self.pixel_at(depth, height_px);
        self.move_to(self.pose.eye + (axes.y_axis * down_px - axes.x_axis * right_px) * scale);
    }

    /// Zooms towards a point, which stays at its pixel, by a ratio of distances: below 1 towards
    /// it, above 1 away from it. The zoom is eased over the next steps and ends at the limits of
    /// the movement.
    pub fn zoom(&mut self, point: DVec3, ratio: f64) {
        let Some(ratio) = positive(ratio) else { return };
        self.glide = None;
        let left = self.zoom.map_or(0.0, |(left, _)| left);
        // At most from one end of the range of distances to the other.
        let most = (DISTANCE[1] / DISTANCE[0]).ln();
        self.zoom = Some(((left + ratio.ln()).clamp(-most, most), point));
    }

    /// Glides towards a point until the share [`NEARER`] of the distance is left, and turns to it.
    pub fn fly_to(&mut self, point: DVec3) {
        if self.is_parallel {
            // Directions stay as they are: a parallel picture is a plan or a side.
            let distance = self.limits.clamp_distance(self.distance * NEARER);
            let eye = self.limits.clamp_eye(point - self.forward() * distance);
            return self.glide_to(Pose { eye, ..self.pose }, point, distance);
        }
        let arm = self.pose.eye - point;
        let distance = self.limits.clamp_distance(arm.length() * NEARER);
        let eye = self.limits.clamp_eye(point + arm.normalize_or_zero() * distance);
        let (yaw, pitch) = self.frame.angles(-arm, self.pose.yaw);
        self.glide_to(Pose { eye, yaw, pitch }, point, distance);
    }

    /// Glides to the pose of another camera on the same scene, which has the same up axis.
    pub fn glide_as(&mut self, other: &Self) {
        let centre = other.eye() + other.forward() * other.distance;
        self.glide_to(other.pose, centre, other.distance);
    }

    /// Replaces the first view by that of another camera on the same scene.
    pub fn set_home(&mut self, other: &Self) {
        (self.home, self.home_distance) = (other.home, other.home_distance);
    }

    /// Glides back to the first view.
    pub fn go_home(&mut self) {
        let ahead = -self.frame.axes(self.home.yaw, self.home.pitch).z_axis;
        let centre = self.home.eye + ahead * self.home_distance;
        self.glide_to(self.home, centre, self.home_distance);
    }

    /// Pose of a camera at `eye` that looks along `direction`.
    pub fn pose_along(&self, eye: DVec3, direction: DVec3) -> Pose {
        let (yaw, pitch) = self.frame.angles(direction, self.pose.yaw);
        Pose { eye, yaw, pitch }
    }

    /// Moves to a pose at once.
    pub fn set_pose(&mut self, pose: Pose) {
        self.stop_animation();
        self.velocity = DVec3::ZERO;
        self.pose = Pose { eye: self.limits.clamp_eye(pose.eye), ..pose };
    }

    /// Advances by a time step. `keys` are the directions of the held keys: right, up and ahead,
    /// each -1 to 1 times a factor of the speed.
    pub fn step(&mut self, keys: DVec3, seconds: f64) {
        let seconds = clamp_step(seconds);
        if keys != DVec3::ZERO {
            self.stop_animation();
        }
        if let Some(glide) = &mut self.glide {
            glide.seconds += seconds;
            self.pose = glide.pose();
            self.velocity = DVec3::ZERO;
            if self.is_parallel {
                self.distance = glide.distance();
            }
            if glide.seconds >= GLIDE_S {
                self.distance = glide.distances[1];
                self.glide = None;
            }
            return;
        }
        let decayed = (-seconds / EASE_S).exp();
        self.ease_zoom(decayed);
        let keys = if self.is_parallel { self.magnify(keys, seconds) } else { keys };
        self.ease_flight(keys, seconds, decayed);
    }

    fn ease_zoom(&mut self, decayed: f64) {
        let Some((left, point)) = self.zoom else { return };
        let eased = left * (1.0 - decayed);
        let now = if (left - eased).abs() > ZOOM_LEFT { eased } else { left };
        let arm = self.pose.eye - point;
        let distance = self.limits.clamp_distance(self.distance * now.exp());
        if self.is_parallel {
            // The height of the picture and what is beside the point change by the same ratio.
            self.move_to(point + arm * (distance / self.distance));
        } else {
            let least = arm.length().min(self.limits.size * DISTANCE[0]);
            self.move_to(point + arm.normalize_or_zero() * (arm.length() * now.exp()).max(least));
        }
        self.distance = distance;
        self.zoom = (left != now).then_some((left - now, point));
    }

    /// In a parallel picture the key ahead magnifies the middle, since coming nearer would change
    /// nothing. Returns the keys without it.
    fn magnify(&mut self, keys: DVec3, seconds: f64) -> DVec3 {
        if keys.z != 0.0 {
            let ratio = (-keys.z * self.pace() / self.distance * seconds).clamp(-1.0, 1.0).exp();
            let distance = self.limits.clamp_distance(self.distance * ratio);
            self.move_to(self.pose.eye + self.forward() * (self.distance - distance));
            self.distance = distance;
        }
        DVec3::new(keys.x, keys.y, 0.0)
    }

    /// The velocity approaches that of the keys exponentially; the distance covered is its
    /// integral.
    fn ease_flight(&mut self, keys: DVec3, seconds: f64, decayed: f64) {
        let axes = self.axes();
        let target = axes.x_axis * keys.x + self.frame.up() * keys.y - axes.z_axis * keys.z;
        let target = target * self.pace();
        let (speed, still) = (self.velocity.length(), self.distance * STILL);
        if keys == DVec3::ZERO && speed * decayed <= still {
            // It stops within this step, at the same place whatever the step.
            let way = (speed - still).max(0.0) * EASE_S;
            self.move_to(self.pose.eye + self.velocity.normalize_or_zero() * way);
            self.velocity = DVec3::ZERO;
            return;
        }
        let lag = (self.velocity - target) * (1.0 - decayed) * EASE_S;
        self.move_to(self.pose.eye + target * seconds + lag);
        self.velocity = target + (self.velocity - target) * decayed;
    }

    /// Moves the eye, within the limits.
    fn move_to(&mut self, eye: DVec3) {
        if eye.is_finite() {
            self.pose.eye = self.limits.clamp_eye(eye);
        }
    }

    fn turn(&mut self, left: f64, up: f64) {
        self.pose.yaw = (self.pose.yaw + left).rem_euclid(std::f64::consts::TAU);
        self.pose.pitch = (self.pose.pitch + up).clamp(-PITCH_MAX_RAD, PITCH_MAX_RAD);
    }

    /// Ends glides and zooms, because the user moves the camera.
    fn stop_animation(&mut self) {
        self.glide = None;
        self.zoom = None;
    }

    fn glide_to(&mut self, to: Pose, centre: DVec3, distance: f64) {
        self.stop_animation();
        let distances = [self.distance, distance];
        self.glide = Some(Glide { from: self.pose, to, centre, distances, seconds: 0.0 });
    }

    fn focal_px(&self, height_px: f64) -> f64 {
        height_px * 0.5 / (self.fovy_rad * 0.5).tan()
    }
}

/// A direction without parts along axes that are only rounding.
fn along_axes(direction: DVec3) -> DVec3 {
    DVec3::from_array(direction.to_array().map(|part| if part.abs() < 1e-14 { 0.0 } else { part }))
}

fn positive(distance: f64) -> Option<f64> {
    (distance.is_finite() && distance > 0.0).then_some(distance)
}

fn clamp_step(seconds: f64) -> f64 {
    if seconds.is_finite() { seconds.clamp(0.0, STEP_MAX_S) } else { 0.0 }
}
