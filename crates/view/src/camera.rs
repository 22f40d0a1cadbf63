//! How the camera moves: flying, looking around, orbiting, zooming, panning, and gliding to a
//! place. Pure: seconds and pixels go in, a pose comes out; no window, no clock. All of it is in
//! `f64` and relative to the eye, so that nothing shakes at coordinates of 10^7; what decays does
//! so exponentially in time, so that the way does not depend on the frame rate.

use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Seconds in which a velocity or a zoom covers most (1 - 1/e) of what is left of it.
const EASE_S: f64 = 0.09;
/// Seconds of a glide.
const GLIDE_S: f64 = 0.7;
/// Steepest pitch, radians: straight up or down leaves no heading.
const PITCH_MAX_RAD: f64 = FRAC_PI_2 - 1e-3;
/// Share of the distance to a place that is left after flying to it.
const NEARER: f64 = 0.3;
/// Longest step, seconds: a frame that took longer does not throw the camera away.
const STEP_MAX_S: f64 = 0.25;
/// Range of the speed, in distances to what is seen a second.
const SPEED: [f64; 2] = [0.01, 100.0];
/// Range of the distance to what is seen, in sizes of the scene; no eye is farther from its middle
/// either, from where it still covers some pixels.
const DISTANCE: [f64; 2] = [1e-8, 30.0];

/// Where the camera stands and how it is turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The eye, world, the file's unit.
    pub eye: DVec3,
    /// Heading around the upward axis, radians, from the [`Frame`]'s ahead to its left.
    pub yaw: f64,
    /// Radians above the horizon.
    pub pitch: f64,
}

/// Which way is up, and the heading that yaw counts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    ahead: DVec3,
    left: DVec3,
    up: DVec3,
}

impl Frame {
    /// With this axis upwards; z where it is no direction.
    pub fn new(up: DVec3) -> Self {
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        let side = if up.y.abs() < 0.9 { DVec3::Y } else { DVec3::X };
        let ahead = side.reject_from(up).normalize_or(DVec3::Y);
        Self { ahead, left: up.cross(ahead), up }
    }

    /// The upward axis.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Right, up and back of a pose, world.
    fn axes(&self, yaw: f64, pitch: f64) -> DMat3 {
        let level = self.ahead * yaw.cos() + self.left * yaw.sin();
        let forward = level * pitch.cos() + self.up * pitch.sin();
        let right = level.cross(self.up);
        DMat3::from_cols(right, right.cross(forward), -forward)
    }

    /// Yaw and pitch of a direction; the heading stays where it points straight up or down.
    fn angles(&self, direction: DVec3, yaw: f64) -> (f64, f64) {
        let local =
            DVec3::new(direction.dot(self.ahead), direction.dot(self.left), direction.dot(self.up));
        let level = local.truncate().length();
        let yaw = if level > 1e-9 * local.length() { local.y.atan2(local.x) } else { yaw };
        (yaw, local.z.atan2(level).clamp(-PITCH_MAX_RAD, PITCH_MAX_RAD))
    }
}

/// Where a camera may go: about a scene, so that it always finds back and its numbers stay exact.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Room {
    /// The middle of the scene.
    middle: DVec3,
    /// How large it is, the file's unit.
    size: f64,
}

impl Room {
    /// The distance within its range that is nearest to this one.
    fn distance(&self, distance: f64) -> f64 {
        distance.clamp(self.size * DISTANCE[0], self.size * DISTANCE[1])
    }

    /// The place within it that is nearest to this one.
    fn place(&self, place: DVec3) -> DVec3 {
        let reach = self.size * DISTANCE[1];
        let arm = place - self.middle;
        if arm.length() <= reach { place } else { self.middle + arm.normalize_or_zero() * reach }
    }
}

/// A camera that is moved.
#[derive(Clone, Debug)]
pub struct Camera {
    frame: Frame,
    room: Room,
    pose: Pose,
    home: Pose,
    /// Distance to what is seen at home.
    home_distance: f64,
    fovy_rad: f64,
    /// Distance to what is seen: what a speed of 1 covers in a second, and where panning holds the
    /// scene.
    distance: f64,
    speed: f64,
    velocity: DVec3,
    /// Zoom that is left: the logarithm of a distance's ratio, and what is zoomed to.
    zoom: Option<(f64, DVec3)>,
    glide: Option<Glide>,
}

/// A way from pose to pose.
#[derive(Clone, Copy, Debug)]
struct Glide {
    from: Pose,
    to: Pose,
    /// What the way goes towards: its distance shrinks by equal ratios in equal times.
    centre: DVec3,
    /// Distance to what is seen at the end.
    distance: f64,
    seconds: f64,
}

impl Camera {
    /// Standing at `eye` and looking at `target`, which is also what [`Camera::go_home`] returns
    /// to. The scene is as large as they are apart, unless [`Camera::around`] tells.
    pub fn new(eye: DVec3, target: DVec3, up: DVec3, fovy_rad: f64) -> Self {
        let frame = Frame::new(up);
        let (yaw, pitch) = frame.angles(target - eye, 0.0);
        let pose = Pose { eye, yaw, pitch };
        let distance = usable(eye.distance(target)).unwrap_or(1.0);
        Self {
            frame,
            room: Room { middle: target, size: distance },
            pose,
            home: pose,
            home_distance: distance,
            fovy_rad,
            distance,
            speed: 1.0,
            velocity: DVec3::ZERO,
            zoom: None,
            glide: None,
        }
    }

    /// In a scene within these bounds.
    pub fn around(self, [low, high]: [DVec3; 2]) -> Self {
        let middle = low.midpoint(high);
        let size = high.distance(low) + self.home.eye.distance(middle);
        let Some(size) = usable(size) else { return self };
        let room = Room { middle, size };
        let distance = room.distance(self.home_distance);
        Self { room, home_distance: distance, distance, ..self }
    }

    /// Where it stands.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// The eye, world.
    pub fn eye(&self) -> DVec3 {
        self.pose.eye
    }

    /// The upward axis of the world.
    pub fn up(&self) -> DVec3 {
        self.frame.up
    }

    /// Right, up and back, world.
    pub fn axes(&self) -> DMat3 {
        self.frame.axes(self.pose.yaw, self.pose.pitch)
    }

    /// The direction it looks along.
    pub fn forward(&self) -> DVec3 {
        -self.axes().z_axis
    }

    /// Vertical field of view, radians.
    pub fn fovy_rad(&self) -> f64 {
        self.fovy_rad
    }

    /// Distance to what is seen, the file's unit.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Speed, in distances to what is seen a second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Whether it moves by itself: still gliding, zooming or slowing down.
    pub fn is_moving(&self) -> bool {
        let still = self.distance * 1e-4;
        self.glide.is_some() || self.zoom.is_some() || self.velocity.length() > still
    }

    /// The direction, unit length, through a pixel of a picture of this size.
    pub fn ray(&self, pixel: DVec2, size: DVec2) -> DVec3 {
        let focal = self.focal_px(size.y);
        let v = DVec3::new(pixel.x - size.x * 0.5, size.y * 0.5 - pixel.y, -focal);
        (self.axes() * v).normalize_or(self.forward())
    }

    /// The place at this eye depth behind a pixel.
    pub fn place(&self, pixel: DVec2, size: DVec2, depth: f64) -> DVec3 {
        let ray = self.ray(pixel, size);
        self.pose.eye + ray * (depth / ray.dot(self.forward()).max(1e-9))
    }

    /// Told how far away the scene is, eye depth; follows slowly, so that the speed does not jump
    /// where a near thing passes by.
    pub fn sees(&mut self, depth: f64, seconds: f64) {
        let Some(depth) = usable(depth) else { return };
        let share = 1.0 - (-step(seconds) / (4.0 * EASE_S)).exp();
        self.distance = self.room.distance(self.distance * (depth / self.distance).powf(share));
    }

    /// Faster or slower, by a factor.
    pub fn change_speed(&mut self, factor: f64) {
        self.speed = (self.speed * factor).clamp(SPEED[0], SPEED[1]);
    }

    /// Turns in place, radians to the left and upwards.
    pub fn look(&mut self, left: f64, up: f64) {
        self.hold();
        self.turn(left, up);
    }

    /// Turns around a place, which stays where it is on the picture.
    pub fn orbit(&mut self, pivot: DVec3, left: f64, up: f64) {
        self.hold();
        let before = self.axes();
        let arm = self.pose.eye - pivot;
        self.turn(left, up);
        self.go(pivot + self.axes() * (before.transpose() * arm));
    }

    /// Moves sideways, so that what lies at this depth follows the pointer; pixels to the right and
    /// down.
    pub fn pan(&mut self, right_px: f64, down_px: f64, depth: f64, height_px: f64) {
        self.hold();
        let axes = self.axes();
        let scale = depth / self.focal_px(height_px);
        self.go(self.pose.eye + (axes.y_axis * down_px - axes.x_axis * right_px) * scale);
    }

    /// Zooms towards a place, which stays where it is on the picture, by a ratio of distances below
    /// 1 (or away from it, above 1); eased over the next steps, as far as there is room.
    pub fn zoom(&mut self, place: DVec3, ratio: f64) {
        let Some(ratio) = usable(ratio) else { return };
        self.glide = None;
        let left = self.zoom.map_or(0.0, |(left, _)| left);
        // No more than leads from one end of the room to the other.
        let most = (DISTANCE[1] / DISTANCE[0]).ln();
        self.zoom = Some(((left + ratio.ln()).clamp(-most, most), place));
    }

    /// Glides towards a place until a share of the distance is left, and turns to it.
    pub fn fly_to(&mut self, place: DVec3) {
        let arm = self.pose.eye - place;
        let distance = self.room.distance(arm.length() * NEARER);
        let eye = self.room.place(place + arm.normalize_or_zero() * distance);
        let (yaw, pitch) = self.frame.angles(-arm, self.pose.yaw);
        self.glide_to(Pose { eye, yaw, pitch }, place, distance);
    }

    /// Glides back to where it stood first, and to what was seen from there.
    pub fn go_home(&mut self) {
        let ahead = -self.frame.axes(self.home.yaw, self.home.pitch).z_axis;
        let centre = self.home.eye + ahead * self.home_distance;
        self.glide_to(self.home, centre, self.home_distance);
    }

    /// The pose at this eye, looking along this direction.
    pub fn pose_along(&self, eye: DVec3, direction: DVec3) -> Pose {
        let (yaw, pitch) = self.frame.angles(direction, self.pose.yaw);
        Pose { eye, yaw, pitch }
    }

    /// Stands at a pose at once.
    pub fn stand(&mut self, pose: Pose) {
        self.hold();
        self.velocity = DVec3::ZERO;
        self.pose = Pose { eye: self.room.place(pose.eye), ..pose };
    }

    /// Goes on by so many seconds; `keys` are the directions held, to the right, upwards and ahead,
    /// each -1 to 1.
    pub fn step(&mut self, keys: DVec3, seconds: f64) {
        let seconds = step(seconds);
        if keys != DVec3::ZERO {
            self.hold();
        }
        if let Some(glide) = &mut self.glide {
            glide.seconds += seconds;
            self.pose = glide.pose();
            self.velocity = DVec3::ZERO;
            if glide.seconds >= GLIDE_S {
                self.distance = glide.distance;
                self.glide = None;
            }
            return;
        }
        let decayed = (-seconds / EASE_S).exp();
        self.ease_zoom(decayed);
        self.ease_flight(keys, seconds, decayed);
    }

    fn ease_zoom(&mut self, decayed: f64) {
        let Some((left, place)) = self.zoom else { return };
        let now = left * (1.0 - decayed);
        let arm = self.pose.eye - place;
        let least = arm.length().min(self.room.size * DISTANCE[0]);
        self.go(place + arm.normalize_or_zero() * (arm.length() * now.exp()).max(least));
        self.distance = self.room.distance(self.distance * now.exp());
        self.zoom = (left - now).abs().gt(&1e-4).then_some((left - now, place));
    }

    /// The velocity approaches what the keys ask for exponentially; the way is its integral.
    fn ease_flight(&mut self, keys: DVec3, seconds: f64, decayed: f64) {
        let axes = self.axes();
        let asked = axes.x_axis * keys.x + self.frame.up * keys.y - axes.z_axis * keys.z;
        let asked = asked * (self.speed * self.distance);
        let lag = (self.velocity - asked) * (1.0 - decayed) * EASE_S;
        self.go(self.pose.eye + asked * seconds + lag);
        self.velocity = asked + (self.velocity - asked) * decayed;
        if keys == DVec3::ZERO && self.velocity.length() < self.distance * 1e-4 {
            self.velocity = DVec3::ZERO;
        }
    }

    /// Stands at a place, as far as there is room.
    fn go(&mut self, eye: DVec3) {
        if eye.is_finite() {
            self.pose.eye = self.room.place(eye);
        }
    }

    fn turn(&mut self, left: f64, up: f64) {
        self.pose.yaw = (self.pose.yaw + left).rem_euclid(std::f64::consts::TAU);
        self.pose.pitch = (self.pose.pitch + up).clamp(-PITCH_MAX_RAD, PITCH_MAX_RAD);
    }

    /// The hand takes over from what moves by itself.
    fn hold(&mut self) {
        self.glide = None;
        self.zoom = None;
    }

    fn glide_to(&mut self, to: Pose, centre: DVec3, distance: f64) {
        self.hold();
        self.glide = Some(Glide { from: self.pose, to, centre, distance, seconds: 0.0 });
    }

    fn focal_px(&self, height_px: f64) -> f64 {
        height_px * 0.5 / (self.fovy_rad * 0.5).tan()
    }
}

impl Glide {
    fn pose(&self) -> Pose {
        let t = (self.seconds / GLIDE_S).clamp(0.0, 1.0);
        let t = t * t * (3.0 - 2.0 * t);
        if t >= 1.0 {
            return self.to;
        }
        let [a, b] = [self.from.eye - self.centre, self.to.eye - self.centre];
        let [near, far] = [a.length(), b.length()];
        let eye = if near > 0.0 && far > 0.0 {
            let way = (a / near).lerp(b / far, t).try_normalize().unwrap_or(a / near);
            self.centre + way * (near.powf(1.0 - t) * far.powf(t))
        } else {
            self.from.eye.lerp(self.to.eye, t)
        };
        let around = (self.to.yaw - self.from.yaw + std::f64::consts::PI)
            .rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        Pose {
            eye,
            yaw: self.from.yaw + around * t,
            pitch: self.from.pitch + (self.to.pitch - self.from.pitch) * t,
        }
    }
}

fn usable(distance: f64) -> Option<f64> {
    (distance.is_finite() && distance > 0.0).then_some(distance)
}

fn step(seconds: f64) -> f64 {
    if seconds.is_finite() { seconds.clamp(0.0, STEP_MAX_S) } else { 0.0 }
}
