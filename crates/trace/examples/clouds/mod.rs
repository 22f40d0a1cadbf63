//! Generated clouds of discs for `rays`: an office, a terrain and a cluster of spheres, with the
//! noise of a scanner.

use esker_render::Splat;
use glam::Vec3;
use std::f32::consts::PI;

/// Makes a cloud of a number of splats.
pub type Make = fn(&mut Random, usize) -> Cloud;

/// Splats and where they are seen from.
pub struct Cloud {
    pub splats: Vec<Splat>,
    pub eye: Vec3,
    pub target: Vec3,
    pub lamp: Vec3,
    pub lamp_radius: f32,
}

/// A rectangle: corner and two edges.
type Side = (Vec3, Vec3, Vec3);

/// Sides of a box.
fn sides(min: Vec3, max: Vec3) -> Vec<Side> {
    let s = max - min;
    let [x, y, z] = [Vec3::X * s.x, Vec3::Y * s.y, Vec3::Z * s.z];
    vec![(min, x, y), (min, y, z), (min, z, x), (max, -y, -x), (max, -z, -y), (max, -x, -z)]
}

/// A room with desks, cabinets, lamps and a hundred small things.
pub fn office(random: &mut Random, count: usize) -> Cloud {
    let mut all = sides(Vec3::ZERO, Vec3::new(12.0, 8.0, 3.0));
    for i in 0..12 {
        let at = Vec3::new(1.0 + (i % 4) as f32 * 2.8, 1.0 + (i / 4) as f32 * 2.3, 0.0);
        let top = at + Vec3::Z * 0.72;
        all.extend(sides(top, top + Vec3::new(1.6, 0.8, 0.03)));
        for leg in [[0.0, 0.0], [1.55, 0.0], [0.0, 0.75], [1.55, 0.75]] {
            let foot = at + Vec3::new(leg[0], leg[1], 0.0);
            all.extend(sides(foot, foot + Vec3::new(0.05, 0.05, 0.72)));
        }
        for _ in 0..8 {
            let thing = top + Vec3::new(random.next() * 1.4, random.next() * 0.6, 0.03);
            let size = Vec3::new(random.next(), random.next(), random.next()) * 0.25 + 0.03;
            all.extend(sides(thing, thing + size));
        }
        all.extend(sides(at + Vec3::X * 1.8, at + Vec3::new(2.3, 0.6, 1.6)));
    }
    let area = |s: &Side| s.1.cross(s.2).length();
    let total: f32 = all.iter().map(area).sum();
    let spacing = (total / count as f32).sqrt();
    let mut splats = Vec::with_capacity(count);
    for side in &all {
        let n = (area(side) / total * count as f32).round() as usize;
        for _ in 0..n {
            let at = side.0 + side.1 * random.next() + side.2 * random.next();
            splats.push(random.splat(at, side.1.cross(side.2).normalize_or_zero(), spacing));
        }
    }
    let (eye, target) = (Vec3::new(0.5, 0.5, 1.7), Vec3::new(8.0, 5.5, 0.8));
    Cloud { splats, eye, target, lamp: Vec3::new(6.0, 4.0, 2.8), lamp_radius: 0.4 }
}

/// Hills of 1 km with noise, seen from above.
pub fn terrain(random: &mut Random, count: usize) -> Cloud {
    let spacing = 1000.0 / (count as f32).sqrt();
    let height = |x: f32, y: f32| {
        (1..7)
            .map(|k| {
                let f = 0.004 * (1 << k) as f32;
                let (a, b) = ((x * f + k as f32).sin(), (y * f * 1.1 - k as f32).cos());
                a * b * 60.0 / (1 << k) as f32
            })
            .sum::<f32>()
    };
    let splats = (0..count).map(|_| {
        let (x, y) = (random.next() * 1000.0, random.next() * 1000.0);
        let slope = |dx: f32, dy: f32| height(x + dx, y + dy) - height(x - dx, y - dy);
        let normal = Vec3::new(-slope(0.5, 0.0), -slope(0.0, 0.5), 1.0).normalize_or_zero();
        random.splat(Vec3::new(x, y, height(x, y)), normal, spacing)
    });
    let splats = splats.collect();
    let (eye, target) = (Vec3::new(-100.0, 200.0, 150.0), Vec3::new(500.0, 500.0, 0.0));
    Cloud { splats, eye, target, lamp: Vec3::new(2e4, 1e4, 1e4), lamp_radius: 100.0 }
}

/// Two hundred spheres that overlap, on a plane.
pub fn spheres(random: &mut Random, count: usize) -> Cloud {
    let all: Vec<(Vec3, f32)> = (0..200)
        .map(|_| {
            let at = random.unit() * random.next().sqrt() * 4.0;
            (Vec3::new(at.x, at.y, at.z.abs()), 0.2 + 0.5 * random.next())
        })
        .collect();
    let area: f32 = all.iter().map(|s| 4.0 * PI * s.1 * s.1).sum::<f32>() + 400.0;
    let spacing = (area / count as f32).sqrt();
    let mut splats = Vec::with_capacity(count);
    for &(centre, radius) in &all {
        let n = (4.0 * PI * radius * radius / area * count as f32) as usize;
        for _ in 0..n {
            let normal = random.unit();
            splats.push(random.splat(centre + normal * radius, normal, spacing));
        }
    }
    while splats.len() < count {
        let at = Vec3::new(random.next() - 0.5, random.next() - 0.5, 0.0) * 20.0;
        splats.push(random.splat(at, Vec3::Z, spacing));
    }
    let (eye, target) = (Vec3::new(9.0, 2.0, 5.0), Vec3::new(0.0, 0.0, 1.0));
    Cloud { splats, eye, target, lamp: Vec3::new(3.0, 3.0, 9.0), lamp_radius: 0.5 }
}

/// A generator of random numbers (`splitmix64`).
pub struct Random(pub u64);

impl Random {
    /// A number in 0 to 1.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1 << 24) as f32
    }

    /// A unit vector.
    pub fn unit(&mut self) -> Vec3 {
        let (z, turn) = (self.next() * 2.0 - 1.0, self.next() * 2.0 * PI);
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * turn.cos(), r * turn.sin(), z)
    }

    /// A splat of a scanned surface: off by a tenth of the spacing, its normal by some degrees.
    fn splat(&mut self, at: Vec3, normal: Vec3, spacing: f32) -> Splat {
        Splat {
            centre: (at + normal * (self.next() - 0.5) * 0.2 * spacing).to_array(),
            radius: spacing,
            normal: (normal + self.unit() * 0.1).normalize_or_zero().to_array(),
            colour: [0.5; 3],
            draw: 0,
            index: 0,
        }
    }
}
