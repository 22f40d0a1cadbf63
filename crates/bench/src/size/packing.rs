//! Smaller forms of the hot planes. Each packs a plane of a file and unpacks it again, so that the
//! renderer draws planes of the usual form with the errors of the smaller one.

use esker_points::palette::Palette;
use esker_points::quant::{HOT_POSITION_BYTES, oct_decode, oct_encode};
use std::f32::consts::PI;

/// Greatest number of points of a small node: on a surface their spacing is a step of 8 bits.
pub const SMALL: usize = 4096;
/// Directions of the codebook: the values of a byte, but for one that stands for no normal.
const DIRECTIONS: usize = 255;

/// How positions are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Positions {
    /// Three `u16`, as in the file.
    Full,
    /// Three times this number of bits, over the node's greatest extent.
    Bits(u32),
    /// Three times 8 bits in nodes of at most [`SMALL`] points, else 10.
    BySize,
}

/// How colours are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colours {
    /// Four bytes, as in the file.
    Full,
    /// Five bits of red, six of green, five of blue.
    Packed565,
    /// A byte: the index into a trained palette.
    Palette,
}

/// How normals are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Normals {
    /// Two `i16` on the octahedron, as in the file.
    Full,
    /// Two `i8` on the octahedron.
    Octahedron8,
    /// A byte: the index into a codebook of directions spread evenly over the sphere.
    Codebook,
}

/// Forms of all hot planes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packing {
    /// Name in reports.
    pub name: &'static str,
    /// Form of positions and radii.
    pub positions: Positions,
    /// Form of colours.
    pub colours: Colours,
    /// Form of normals.
    pub normals: Normals,
}

impl Positions {
    /// Bits of a coordinate in a node of `points` points.
    fn bits(self, points: usize) -> u32 {
        match self {
            Self::Full => 16,
            Self::Bits(bits) => bits,
            Self::BySize => {
                if points <= SMALL {
                    8
                } else {
                    10
                }
            }
        }
    }

    /// Bytes of a point with its radius, in a node of `points` points.
    pub fn bytes(self, points: usize) -> usize {
        match self {
            Self::Full => HOT_POSITION_BYTES,
            _ => (3 * self.bits(points) as usize).div_ceil(8) + 1,
        }
    }

    /// Packs a plane and unpacks it again, each point to the middle of its step. Returns the step
    /// in units of hot steps.
    pub fn round_trip(self, plane: &mut [u8], points: usize) -> u32 {
        if self == Self::Full {
            return 1;
        }
        let coordinate =
            |point: &[u8], i: usize| u16::from_le_bytes([point[2 * i], point[2 * i + 1]]);
        let all = plane.chunks_exact(HOT_POSITION_BYTES);
        let greatest = all.flat_map(|p| (0..3).map(move |i| coordinate(p, i))).max().unwrap_or(0);
        let shift = (u16::BITS - greatest.leading_zeros()).saturating_sub(self.bits(points));
        for point in plane.chunks_exact_mut(HOT_POSITION_BYTES) {
            for i in 0..3 {
                let middle = (1u32 << shift) >> 1;
                let c = (u32::from(coordinate(point, i)) >> shift << shift) + middle;
                point[2 * i..][..2].copy_from_slice(&(c.min(0xffff) as u16).to_le_bytes());
            }
        }
        1 << shift
    }
}

impl Colours {
    /// Bytes of a point.
    pub fn bytes(self) -> usize {
        match self {
            Self::Full => 4,
            Self::Packed565 => 2,
            Self::Palette => 1,
        }
    }

    /// Packs a plane of RGBA and unpacks it. Returns the sum of squared differences of channels.
    pub fn round_trip(self, plane: &mut [u8], palette: Option<&Palette>) -> f64 {
        let mut squares = 0u64;
        for rgba in plane.chunks_exact_mut(4).filter(|rgba| rgba[3] != 0 && self != Self::Full) {
            let before = [rgba[0], rgba[1], rgba[2]];
            let after = match self {
                Self::Full => before,
                Self::Packed565 => {
                    [reduced(before[0], 5), reduced(before[1], 6), reduced(before[2], 5)]
                }
                Self::Palette => {
                    palette.map_or(before, |p| p.colours()[usize::from(p.nearest(before))])
                }
            };
            rgba[..3].copy_from_slice(&after);
            squares +=
                before.iter().zip(after).map(|(a, b)| u64::from(a.abs_diff(b)).pow(2)).sum::<u64>();
        }
        squares as f64
    }
}

/// The value of `bits` bits nearest to `value`, on the scale of 8 bits.
fn reduced(value: u8, bits: u32) -> u8 {
    let most = (1u32 << bits) - 1;
    let code = (u32::from(value) * most + 127) / 255;
    ((code * 255 + most / 2) / most) as u8
}

impl Normals {
    /// Bytes of a point.
    pub fn bytes(self) -> usize {
        match self {
            Self::Full => 4,
            Self::Octahedron8 => 2,
            Self::Codebook => 1,
        }
    }

    /// Packs a plane and unpacks it. Returns the sum of squared angles, radians, and their number.
    pub fn round_trip(self, plane: &mut [u8]) -> (f64, u64) {
        let (mut squares, mut count) = (0.0, 0);
        let codebook = if self == Self::Codebook { directions() } else { Vec::new() };
        for code in plane.chunks_exact_mut(4).filter(|_| self != Self::Full) {
            let [x, y] = [0, 2].map(|i| i16::from_le_bytes([code[i], code[i + 1]]));
            let before = oct_decode([x, y]);
            if before == [0.0; 3] {
                continue;
            }
            let after = match self {
                Self::Full => before,
                Self::Octahedron8 => {
                    let coarse =
                        |c: i16| (f32::from(c) / 32767.0 * 127.0).round() / 127.0 * 32767.0;
                    oct_decode([coarse(x) as i16, coarse(y) as i16])
                }
                Self::Codebook => nearest(&codebook, before),
            };
            let [x, y] = oct_encode(after);
            code[..2].copy_from_slice(&x.to_le_bytes());
            code[2..].copy_from_slice(&y.to_le_bytes());
            squares += f64::from(dot(before, after).clamp(-1.0, 1.0).acos()).powi(2);
            count += 1;
        }
        (squares, count)
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Directions spread evenly over the sphere, from the top down: a Fibonacci lattice
/// (`swinbank2006`).
fn directions() -> Vec<[f32; 3]> {
    let turn = PI * (3.0 - 5f32.sqrt());
    let direction = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f32 / DIRECTIONS as f32;
        let (sin, cos) = (turn * i as f32).sin_cos();
        let across = (1.0 - z * z).sqrt();
        [across * cos, across * sin, z]
    };
    (0..DIRECTIONS).map(direction).collect()
}

/// The direction of the codebook nearest to `n`. Only directions of about its height are compared.
fn nearest(codebook: &[[f32; 3]], n: [f32; 3]) -> [f32; 3] {
    let reach = 4.0 / (DIRECTIONS as f32).sqrt();
    let from = codebook.partition_point(|d| d[2] > n[2] + reach);
    let to = codebook.partition_point(|d| d[2] >= n[2] - reach);
    let near = codebook[from..to].iter().max_by(|a, b| dot(**a, n).total_cmp(&dot(**b, n)));
    near.copied().unwrap_or(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_position_stays_within_half_a_step(points in prop::collection::vec(any::<[u16; 3]>(), 1..40), bits in 6u32..12, low in 0u32..12) {
            let points: Vec<_> = points.iter().map(|p| p.map(|c| c >> low)).collect();
            let plane = |p: &[u16; 3]| [p[0].to_le_bytes(), p[1].to_le_bytes(), p[2].to_le_bytes(), [128, 0]].concat();
            let mut packed: Vec<u8> = points.iter().flat_map(plane).collect();
            let step = Positions::Bits(bits).round_trip(&mut packed, points.len());
            let greatest = u32::from(*points.iter().flatten().max().unwrap());
            prop_assert!(greatest / step < 1 << bits && (step == 1 || greatest / (step / 2) >= 1 << bits), "no wider than needed");
            for (p, q) in points.iter().zip(packed.chunks_exact(HOT_POSITION_BYTES)) {
                for i in 0..3 {
                    let q = u16::from_le_bytes([q[2 * i], q[2 * i + 1]]);
                    prop_assert!(u32::from(p[i].abs_diff(q)) <= step / 2);
                }
                prop_assert_eq!(&q[6..], &[128, 0]);
            }
        }

        #[test]
        fn a_packed_colour_is_off_by_half_a_step(rgb: [u8; 3]) {
            let mut plane = [rgb[0], rgb[1], rgb[2], 255];
            Colours::Packed565.round_trip(&mut plane, None);
            for (i, most) in [31u8, 63, 31].into_iter().enumerate() {
                prop_assert!(f32::from(plane[i].abs_diff(rgb[i])) <= 255.0 / f32::from(most) / 2.0 + 0.51);
            }
        }

        #[test]
        fn a_codebook_has_a_direction_nearby(n in prop::array::uniform3(-1f32..1.0)) {
            let norm = dot(n, n).sqrt();
            prop_assume!(norm > 0.01);
            let n = n.map(|c| c / norm);
            // 255 even directions are about 13 degrees apart, so that none is much farther away
            // than half of it.
            let found = nearest(&directions(), n);
            prop_assert!(dot(found, n) > 10f32.to_radians().cos());
            let best = directions().into_iter().map(|d| dot(d, n)).fold(-1.0, f32::max);
            prop_assert!((dot(found, n) - best).abs() < 1e-6, "the search compares all that may be nearest");
        }
    }
}
