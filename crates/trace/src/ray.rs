//! Rays, and what they hit. Positions are `f32` relative to the origin of the scene, in the unit of
//! the file.

use glam::Vec3;

/// A ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Direction, unit length.
    pub direction: Vec3,
    /// Greatest distance of a hit; infinite for no limit.
    pub reach: f32,
}

impl Ray {
    /// A ray without limit.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, reach: f32::INFINITY }
    }

    /// Point at a distance.
    pub fn at(&self, distance: f32) -> Vec3 {
        self.origin + self.direction * distance
    }
}

/// The surface that a ray meets: of a splat blended with all that lie within two radii behind it,
/// or of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance of the frontmost primitive.
    pub distance: f32,
    /// Normal, unit length, turned against the ray. Blended for splats, interpolated for triangles.
    pub normal: Vec3,
    /// Diffuse albedo, linear light, 0 to 1 in each channel.
    pub albedo: Vec3,
    /// Emitted radiance, linear light; surfaces emit to both sides.
    pub emission: Vec3,
    /// Distance along the normal at which rays that leave the surface start: two radii for splats,
    /// less where a facing surface is nearer.
    pub lift: f32,
    /// Radius of the frontmost splat; zero for a triangle.
    pub radius: f32,
    /// Whether the stored normal of the frontmost primitive points away from the ray's origin.
    pub is_back: bool,
}

impl Hit {
    /// Whether a splat was hit, not a triangle.
    pub fn is_splat(&self) -> bool {
        self.radius > 0.0
    }

    /// Start of rays that leave the surface, which `ray` has met.
    pub fn start(&self, ray: &Ray) -> Vec3 {
        ray.at(self.distance) + self.normal * self.lift
    }
}
