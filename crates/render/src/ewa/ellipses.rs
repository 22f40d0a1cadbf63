//! Eight splats at once: what [`super::splat`] does with one disc, in registers of eight.

use super::splat::{Box4, CONDITION_MAX, Dye, Lens, MARGIN, REACH_MAX, Splat, ellipse};
use crate::lanes::turned;
use crate::values::{EIGHT, Values, WHOLE, bits};
use fearless_simd::{Simd, f32x8};
use glam::Vec4;

/// Eight ellipses and what becomes of them.
pub struct Ellipses {
    /// Those of which something may be in the picture, a bit each.
    pub shows: u32,
    /// Those that are ellipses.
    pub ellipses: u32,
    /// Those of them that can be evaluated.
    usable: u32,
    /// All of [`Splat`] but colour and normal, a row of four values after the other.
    rows: [[Vec4; EIGHT]; 3],
    /// With [`WHOLE`] added.
    bounds: [Vec4; EIGHT],
}

impl Ellipses {
    /// Of eight discs, as [`super::splat::Disc::place`] does.
    #[inline(always)]
    pub fn new<S: Simd>(
        lens: &Lens,
        centre: [f32x8<S>; 3],
        tangents: [[f32x8<S>; 3]; 2],
        radius: f32x8<S>,
    ) -> Self {
        let [a, b] = tangents;
        let depth = centre[2];
        let (zero, near) = (depth.like(0.0), depth.like(lens.near));
        let extent = Values::sqrt(a[2] * a[2] + b[2] * b[2]);
        let farthest = depth + extent;
        let is_before = near.cmple(farthest) & farthest.cmplt(near.like(f32::INFINITY));
        let is_ellipse = near.cmple(depth - extent) & extent.cmple(depth * REACH_MAX);
        let e = ellipse(lens, centre, tangents, radius);
        let x = edges(e.origin[0], e.half[0], lens.size.x);
        let y = edges(e.origin[1], e.half[1], lens.size.y);
        let is_seen = x[0].cmplt(x[1]) & y[0].cmplt(y[1]);
        let is_fine = zero.cmple(e.condition) & e.condition.cmplt(zero.like(CONDITION_MAX));
        // A sum with something infinite or not a number in it is so itself.
        let mut sum = zero;
        for value in e.form {
            sum += value * 0.0;
        }
        for value in e.inverse_depth {
            sum += value * 0.0;
        }
        let is_fine = is_fine & sum.cmpeq(zero) & zero.cmplt(e.back);
        let [across, shear, along, amplitude, least, greatest] = e.form;
        let [z, z_x, z_y] = e.inverse_depth;
        let ellipses = bits(is_ellipse);
        Self {
            shows: bits(is_before) & (!ellipses | bits(is_seen)),
            ellipses,
            usable: bits(is_fine),
            rows: [
                side_by_side([e.origin[0], e.origin[1], across, shear]),
                side_by_side([along, amplitude, least, greatest]),
                side_by_side([z, z_x, z_y, e.back]),
            ],
            bounds: side_by_side([x[0], x[1], y[0], y[1]]),
        }
    }

    /// Those that can be drawn as ellipses.
    #[inline(always)]
    pub fn drawn(&self) -> u32 {
        self.shows & self.ellipses & self.usable
    }

    /// One that can be drawn as an ellipse, of this colour and normal.
    #[inline(always)]
    pub fn get(&self, k: usize, dye: Dye) -> Splat {
        // As rows, which stay in registers.
        let row = |i: usize| self.rows[i][k % EIGHT].to_array();
        bytemuck::cast([row(0), row(1), row(2), bytemuck::cast(dye)])
    }

    /// Its box.
    #[inline(always)]
    pub fn bounds(&self, k: usize) -> Box4 {
        self.bounds[k % EIGHT].to_array().map(|c| c.to_bits() & 0xffff)
    }
}

/// First pixels whose middles are past the least and the greatest of places so far from others, with [`WHOLE`] added.
#[inline(always)]
fn edges<V: Values>(origin: V, half: V, size: f32) -> [V; 2] {
    let (zero, size) = (half.like(0.0), half.like(size));
    let (least, greatest) = (origin - half - MARGIN, origin + half + MARGIN);
    [least.max(zero).min(size) + WHOLE, greatest.max(zero).min(size) + WHOLE]
}

/// Four values each of eight, one's after another's.
#[inline(always)]
fn side_by_side<S: Simd>(values: [f32x8<S>; 4]) -> [Vec4; EIGHT] {
    let [a, b, c, d] = [*values[0], *values[1], *values[2], *values[3]];
    let four = |at: usize| {
        let of = |v: &[f32; EIGHT]| Vec4::from_slice(&v[at..at + 4]);
        turned([of(&a), of(&b), of(&c), of(&d)])
    };
    let ([e, f, g, h], [i, j, k, l]) = (four(0), four(4));
    [e, f, g, h, i, j, k, l]
}

#[cfg(test)]
mod tests {
    use super::super::splat::{Disc, Placed};
    use super::*;
    use fearless_simd::{Level, dispatch};
    use glam::{Vec2, Vec3};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn eight_at_once_are_what_they_are_alone(
            discs in [0; EIGHT].map(|_| ([-2.0f32..2.0, -2.0f32..2.0, -0.5f32..3.0], [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], -12f32..1.0)),
            lowpass in prop::sample::select(vec![0.0f32, 2.25]),
        ) {
            let lens = Lens { focal_px: 300.0, centre_px: Vec2::new(160.0, 120.0), size: Vec2::new(320.0, 240.0), near: 0.1, lowpass };
            let discs = discs.map(|(at, normal, log)| {
                let normal = Vec3::from_array(normal).normalize_or(Vec3::Z);
                Disc::round(Vec3::from_array(at), normal, log.exp2())
            });
            let eight = dispatch!(Level::new(), simd => {
                let of = |of: &dyn Fn(&Disc) -> f32| simd.load_array_f32x8(std::array::from_fn(|k| of(&discs[k])));
                let parts = |part: &dyn Fn(&Disc) -> Vec3| [0, 1, 2].map(|i| of(&|d| part(d)[i]));
                let tangents = [parts(&|d| d.tangents[0]), parts(&|d| d.tangents[1])];
                Ellipses::new(&lens, parts(&|d| d.centre), tangents, of(&|d| d.radius))
            });
            for (k, disc) in discs.iter().enumerate() {
                let is = |bits: u32| bits >> k & 1 == 1;
                match disc.place(&lens) {
                    Placed::Drawn(splat, bounds) if !splat.is_by_rays() => {
                        prop_assert!(is(eight.drawn()));
                        let dye = Dye { tint: [0.5, 0.25, k as f32], normal: k as u32 };
                        prop_assert_eq!(format!("{:?}", eight.get(k, dye)), format!("{:?}", Splat { dye, ..splat }));
                        prop_assert_eq!(eight.bounds(k), bounds);
                    }
                    Placed::Drawn(..) => prop_assert!(is(eight.shows) && !is(eight.ellipses)),
                    Placed::Outside => prop_assert!(!is(eight.drawn())),
                    Placed::Dropped => prop_assert!(is(eight.shows) && !is(eight.drawn())),
                }
            }
        }
    }
}
