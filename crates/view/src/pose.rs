//! Poses of a camera, the axes that they refer to, and animated movements between them. Nothing
//! depends on a window or a clock.

use glam::{DMat3, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Duration of a glide, seconds.
pub const GLIDE_S: f64 = 0.7;
/// Steepest pitch that turning leads to, radians. The pose of a view from above is steeper; its
/// heading is its yaw.
pub const PITCH_MAX_RAD: f64 = FRAC_PI_2 - 1e-3;

/// Range of the viewing distance, in sizes of the scene. The eye is never farther from the middle
/// of the scene than the upper end, from where the scene still covers some pixels.
pub const DISTANCE: [f64; 2] = [1e-8, 30.0];

/// Region in which a camera may move around a scene, so that it finds back and its coordinates stay
/// exact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveLimits {
    /// Middle of the scene.
    pub middle: DVec3,
    /// Size of the scene, the file's unit.
    pub size: f64,
}

impl MoveLimits {
    /// Clamps a viewing distance to its range.
    pub fn clamp_distance(&self, distance: f64) -> f64 {
        distance.clamp(self.size * DISTANCE[0], self.size * DISTANCE[1])
    }

    /// Returns the position of the region that is nearest to `eye`.
    pub fn clamp_eye(&self, eye: DVec3) -> DVec3 {
        let reach = self.size * DISTANCE[1];
        let arm = eye - self.middle;
        if arm.length() <= reach { eye } else { self.middle + arm.normalize_or_zero() * reach }
    }
}

/// Position and orientation of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the eye in world coordinates, the file's unit.
    pub eye: DVec3,
    /// Heading around the up axis, radians, counted from the `ahead` axis of the [`Frame`] to the
    /// left.
    pub yaw: f64,
    /// Angle above the horizon, radians.
    pub pitch: f64,
}

/// Axes that yaw and pitch refer to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    ahead: DVec3,
    left: DVec3,
    up: DVec3,
}

impl Frame {
    /// Makes a frame with this up axis; z if `up` has no direction.
    pub fn new(up: DVec3) -> Self {
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        let side = if up.y.abs() < 0.9 { DVec3::Y } else { DVec3::X };
        let ahead = side.reject_from(up).normalize_or(DVec3::Y);
        Self { ahead, left: up.cross(ahead), up }
    }

    /// Up axis.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Right, up and back axes of a pose, world.
    pub fn axes(&self, yaw: f64, pitch: f64) -> DMat3 {
        let level = self.ahead * yaw.cos() + self.left * yaw.sin();
        let forward = level * pitch.cos() + self.up * pitch.sin();
        let right = level.cross(self.up);
        DMat3::from_cols(right, right.cross(forward), -forward)
    }

    /// Yaw and pitch of a direction; `yaw` is kept if the direction is vertical.
    pub fn angles(&self, direction: DVec3, yaw: f64) -> (f64, f64) {
        let local =
            DVec3::new(direction.dot(self.ahead), direction.dot(self.left), direction.dot(self.up));
        let level = local.truncate().length();
        let yaw = if level > 1e-9 * local.length() { local.y.atan2(local.x) } else { yaw };
        (yaw, local.z.atan2(level).clamp(-PITCH_MAX_RAD, PITCH_MAX_RAD))
    }
}

/// An animated movement between two poses.
#[derive(Clone, Copy, Debug)]
pub struct Glide {
    /// Pose at the start.
    pub from: Pose,
    /// Pose at the end.
    pub to: Pose,
    /// Point that the movement approaches; its distance shrinks by equal ratios in equal times.
    pub centre: DVec3,
    /// Viewing distances at the start and at the end.
    pub distances: [f64; 2],
    /// Time since the start, seconds.
    pub seconds: f64,
}

impl Glide {
    /// Share of the way, 0 to 1, with a slow start and a slow end.
    fn share(&self) -> f64 {
        let t = (self.seconds / GLIDE_S).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// Viewing distance, which changes by equal ratios in equal times.
    pub fn distance(&self) -> f64 {
        let ([from, to], t) = (self.distances, self.share());
        from.powf(1.0 - t) * to.powf(t)
    }

    /// Pose at this time.
    pub fn pose(&self) -> Pose {
        let t = self.share();
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
