//! Random numbers, rays and splats for tests.

use esker_render::Splat;
use esker_trace::Ray;
use glam::Vec3;

/// A generator of random numbers (`splitmix64`).
pub struct Random(pub u64);

impl Random {
    /// A number in 0 to 1.
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1 << 24) as f32
    }

    /// A vector with components in -1 to 1.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    /// A unit vector, each direction as likely as any other.
    pub fn unit(&mut self) -> Vec3 {
        loop {
            let v = self.vector();
            if v.length_squared() > 1e-3 && v.length_squared() <= 1.0 {
                return v.normalize_or_zero();
            }
        }
    }

    /// A ray from a cube of twice the side of the clouds'.
    pub fn ray(&mut self) -> Ray {
        Ray::new(self.vector() * 2.0, self.unit())
    }
}

/// A splat with a colour of its own.
pub fn splat(centre: Vec3, normal: Vec3, radius: f32, index: usize) -> Splat {
    let colour = [1, 10, 100].map(|k| (index / k % 10) as f32 / 9.0);
    let (centre, normal) = (centre.to_array(), normal.to_array());
    Splat { centre, normal, radius, colour, draw: 0, index: index as u32 }
}
