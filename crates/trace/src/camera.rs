//! Rays of a view, and its inverse: where a point lies on the picture. In: a view in world
//! coordinates and the origin of the scene. Out: rays and pixels relative to that origin, `f32`.

use crate::ray::Ray;
use esker_lod::View;
use glam::{DVec3, Vec2, Vec3};

/// A view relative to the origin of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye.
    pub eye: Vec3,
    /// Right, unit length.
    pub right: Vec3,
    /// Up, unit length.
    pub up: Vec3,
    /// Direction of the view, unit length.
    pub forward: Vec3,
    /// Width of the picture, pixels.
    pub width: usize,
    /// Height of the picture, pixels.
    pub height: usize,
    /// Pixels of a unit of length at unit eye depth.
    pub focal_px: f32,
    /// Depth of the near plane, where rays start.
    pub near: f32,
    /// Depth at which lengths have their size on the picture, if rays are parallel; 0 if they start
    /// at the eye.
    pub parallel_at: f32,
}

impl Camera {
    /// The view relative to `origin`, world coordinates.
    pub fn new(view: &View, origin: DVec3) -> Self {
        let axes = view.world_from_view;
        Self {
            eye: (view.eye - origin).as_vec3(),
            right: axes.x_axis.as_vec3(),
            up: axes.y_axis.as_vec3(),
            forward: -axes.z_axis.as_vec3(),
            width: view.width as usize,
            height: view.height as usize,
            focal_px: view.focal_px() as f32,
            near: view.near as f32,
            parallel_at: view.parallel_at.unwrap_or(0.0) as f32,
        }
    }

    /// Ray through a position of the picture, in pixels from the top left corner (centres at one
    /// half). It starts on the near plane.
    pub fn ray(&self, x_px: f32, y_px: f32) -> Ray {
        let x = (x_px - self.width as f32 * 0.5) / self.focal_px;
        let y = (self.height as f32 * 0.5 - y_px) / self.focal_px;
        if self.parallel_at > 0.0 {
            let beside = (self.right * x + self.up * y) * self.parallel_at;
            return Ray::new(self.eye + beside + self.forward * self.near, self.forward);
        }
        let towards = self.forward + self.right * x + self.up * y;
        Ray::new(self.eye + towards * self.near, towards.normalize_or(self.forward))
    }

    /// Eye depth of a point: its distance along the direction of the view.
    pub fn depth(&self, point: Vec3) -> f32 {
        (point - self.eye).dot(self.forward)
    }

    /// Depth from which depths guide filters: that of the near plane where rays are parallel, whose
    /// pinhole is so far away that the differences would be lost; else 0.
    pub(crate) fn guides_from(&self) -> f32 {
        if self.parallel_at > 0.0 { self.near } else { 0.0 }
    }

    /// Position of a point on the picture, pixels; `None` if it is nearer than the near plane.
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        let towards = point - self.eye;
        let depth = towards.dot(self.forward);
        if depth.is_nan() || depth < self.near {
            return None;
        }
        let at = if self.parallel_at > 0.0 { self.parallel_at } else { depth };
        let scale = self.focal_px / at;
        let centre = Vec2::new(self.width as f32, self.height as f32) * 0.5;
        Some(centre + Vec2::new(towards.dot(self.right), -towards.dot(self.up)) * scale)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_go_through_the_points_that_are_seen_there() {
        let (eye, target) = (DVec3::new(3.0, -20.0, 9.0), DVec3::new(0.0, 1.0, 0.0));
        let pinhole = View::look_at(eye, target, DVec3::Z, 0.8, 300, 200);
        let parallel = pinhole.parallel(12.0, DVec3::splat(-4.0), DVec3::splat(4.0));
        for view in [pinhole, parallel] {
            let camera = Camera::new(&view, DVec3::ZERO);
            for point in [Vec3::ZERO, Vec3::new(1.5, -2.0, 3.0), Vec3::new(-2.0, 2.0, -1.0)] {
                let at = camera.project(point).unwrap();
                let exact = view.project(point.as_dvec3()).unwrap();
                assert!(at.as_dvec2().distance(exact.truncate()) < 2e-2, "{at}, {exact}");
                let ray = camera.ray(at.x, at.y);
                let off = (point - ray.origin).cross(ray.direction).length();
                assert!(off < 2e-3, "{off} for {point}");
                assert!((camera.depth(ray.origin) - camera.near).abs() < 1e-3);
            }
        }
        let camera = Camera::new(&parallel, DVec3::ZERO);
        assert_eq!(camera.ray(3.0, 4.0).direction, camera.ray(290.0, 150.0).direction);
    }
}
