//! Eight splats at once: what [`crate::ewa::splat`] does with one disc, in registers of eight.

use crate::ewa::splat::{Box4, CONDITION_MAX, Lens, REACH_MAX, Splat, edges, ellipse};
use crate::ewa::sums::PAIR;
use crate::ewa::tiles::{LANES, Part, TILE};
use crate::simd::lanes::turned;
use crate::simd::values::{EIGHT, Values, bits};
use fearless_simd::{Bytes, Simd, SimdBase, f32x8, mask32x8, u32x8};
use glam::Vec4;

/// Eight ellipses and what becomes of them.
pub struct Ellipses<S: Simd> {
    /// Those of which something may be in the picture, a bit each.
    pub shows: u32,
    /// Those that are ellipses.
    pub ellipses: u32,
    /// Those of them that can be evaluated.
    usable: u32,
    /// All of [`Splat`] but its dye, a row of four values after the other.
    rows: [[f32x8<S>; 4]; 3],
    parts: Parts,
}

/// The parts of tiles that eight splats touch, where they touch no more than one.
struct Parts {
    /// Boxes: first columns and one past the last ones, first rows and one past the last ones.
    bounds: [[u32; EIGHT]; 4],
    /// The tile's number.
    tile: [u32; EIGHT],
    /// Columns and pairs of rows as in [`Part`], a byte each.
    sides: [u32; EIGHT],
    /// Those that touch one tile, a bit each.
    single: u32,
    /// Those that are narrow, a bit each.
    narrow: u32,
}

impl<S: Simd> Ellipses<S> {
    /// Of eight discs, as [`crate::ewa::splat::Disc::place`] does, in a picture of so many columns of tiles.
    #[inline(always)]
    pub fn new(
        lens: &Lens,
        columns: usize,
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
        let [x, y] = [0, 1].map(|i| {
            let (origin, half) = (e.origin[i], e.half[i]);
            edges(origin - half, origin + half, lens.size[i])
        });
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
                [e.origin[0], e.origin[1], across, shear],
                [along, amplitude, least, greatest],
                [z, z_x, z_y, e.back],
            ],
            parts: Parts::new(x, y, zero.cmplt(amplitude), columns),
        }
    }

    /// Those that can be drawn as ellipses.
    #[inline(always)]
    pub fn drawn(&self) -> u32 {
        self.shows & self.ellipses & self.usable
    }

    /// Writes some of them, a bit each, one after another. Dyes are left as they are.
    #[inline(always)]
    pub fn write(&self, which: u32, into: &mut [Splat; EIGHT]) {
        if which == 0xff {
            self.write_to([0, 1, 2, 3, 4, 5, 6, 7], into);
        } else {
            // Each over the one before, unless that is to stay.
            let mut places = [0; EIGHT];
            for k in 1..EIGHT {
                places[k] = places[k - 1] + (which >> (k - 1) & 1) as usize;
            }
            self.write_to(places, into);
        }
    }

    #[inline(always)]
    fn write_to(&self, places: [usize; EIGHT], into: &mut [Splat; EIGHT]) {
        for (i, row) in self.rows.iter().enumerate() {
            for (values, place) in side_by_side(*row).iter().zip(places) {
                let rows: &mut [[f32; 4]; 4] = bytemuck::cast_mut(&mut into[place % EIGHT]);
                rows[i] = values.to_array();
            }
        }
    }

    /// The box of one.
    #[inline(always)]
    pub fn bounds(&self, k: usize) -> Box4 {
        self.parts.bounds.map(|c| c[k % EIGHT])
    }

    /// The tile that one touches, and what of that, where it is no more than one.
    #[inline(always)]
    pub fn part(&self, k: usize) -> Option<(usize, Part)> {
        let Parts { tile, sides, single, narrow, .. } = &self.parts;
        let [left, right, first_pair, past_pair] = sides[k % EIGHT].to_le_bytes();
        let is_small = narrow >> k & 1 == 1;
        (single >> k & 1 == 1).then(|| {
            (tile[k % EIGHT] as usize, Part { is_small, left, right, first_pair, past_pair })
        })
    }
}

impl Parts {
    /// Of the boxes of ellipses, and whether they are plain.
    #[inline(always)]
    fn new<S: Simd>(
        x: [f32x8<S>; 2],
        y: [f32x8<S>; 2],
        is_plain: mask32x8<S>,
        columns: usize,
    ) -> Self {
        let [left, right, top, bottom] = [whole(x[0]), whole(x[1]), whole(y[0]), whole(y[1])];
        let (column, row) = (left >> TILE_LOG2, top >> TILE_LOG2);
        let is_single =
            column.simd_eq((right - 1) >> TILE_LOG2) & row.simd_eq((bottom - 1) >> TILE_LOG2);
        let is_narrow = (right - left).simd_le(LANES as u32);
        let (from_x, from_y) = (column << TILE_LOG2, row << TILE_LOG2);
        let sides = (left - from_x)
            | (right - from_x) << 8
            | (top - from_y) >> PAIR_LOG2 << 16
            | (bottom - from_y + (PAIR as u32 - 1)) >> PAIR_LOG2 << 24;
        Self {
            bounds: [left.into(), right.into(), top.into(), bottom.into()],
            tile: (row * columns as u32 + column).into(),
            sides: sides.into(),
            single: bits(is_single),
            narrow: bits(is_narrow & is_plain),
        }
    }
}

/// Log2 of [`TILE`].
const TILE_LOG2: u32 = TILE.ilog2();
/// Log2 of [`PAIR`].
const PAIR_LOG2: u32 = PAIR.ilog2();

/// Whole numbers with [`WHOLE`] added.
#[inline(always)]
fn whole<S: Simd>(edge: f32x8<S>) -> u32x8<S> {
    edge.bitcast::<u32x8<S>>() & 0xffff
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
    use super::*;
    use crate::ewa::splat::{Disc, Placed};
    use crate::simd::values::load;
    use fearless_simd::{Level, dispatch};
    use glam::{Vec2, Vec3};
    use proptest::prelude::*;

    /// Right, down and depth; a normal of any length; a radius, log2.
    type Round = ([f32; 3], [f32; 3], f32);

    fn agree(discs: [Round; EIGHT], lowpass: f32) -> Result<(), TestCaseError> {
        let lens = Lens {
            focal_px: 300.0,
            centre_px: Vec2::new(160.0, 120.0),
            size: Vec2::new(320.0, 240.0),
            near: 0.1,
            lowpass,
        };
        let discs = discs.map(|(at, normal, log)| {
            let normal = Vec3::from_array(normal).normalize_or(Vec3::Z);
            Disc::round(Vec3::from_array(at), normal, log.exp2())
        });
        let (shows, ellipses, drawn, splats, bounds) = dispatch!(Level::new(), simd => {
            let of = |of: &dyn Fn(&Disc) -> f32| load(simd, &std::array::from_fn(|k| of(&discs[k])));
            let parts = |part: &dyn Fn(&Disc) -> Vec3| [0, 1, 2].map(|i| of(&|d| part(d)[i]));
            let tangents = [parts(&|d| d.tangents[0]), parts(&|d| d.tangents[1])];
            let eight = Ellipses::new(&lens, 10, parts(&|d| d.centre), tangents, of(&|d| d.radius));
            let mut splats = [Splat::default(); EIGHT];
            eight.write(eight.drawn(), &mut splats);
            let bounds: [Box4; EIGHT] = std::array::from_fn(|k| eight.bounds(k));
            (eight.shows, eight.ellipses, eight.drawn(), splats, bounds)
        });
        let mut written = splats.iter();
        for (k, disc) in discs.iter().enumerate() {
            let is = |bits: u32| bits >> k & 1 == 1;
            match disc.place(&lens) {
                Placed::Drawn(splat, box4) if !splat.is_by_rays() => {
                    prop_assert!(is(drawn));
                    prop_assert_eq!(format!("{:?}", written.next()), format!("{:?}", Some(splat)));
                    prop_assert_eq!(bounds[k], box4);
                }
                Placed::Drawn(..) => prop_assert!(is(shows) && !is(ellipses)),
                Placed::Outside => prop_assert!(!is(drawn)),
                Placed::Dropped => prop_assert!(is(shows) && !is(drawn)),
            }
        }
        Ok(())
    }

    #[test]
    fn a_box_that_ends_at_a_middle_of_a_pixel_is_the_same() {
        let disc =
            ([0.0, -0.28869793, 2.9854128], [-0.46423763, 0.29723123, 0.29949716], -10.743054);
        agree([disc; EIGHT], 2.25).unwrap();
    }

    proptest! {
        #[test]
        fn eight_at_once_are_what_they_are_alone(
            discs in [0; EIGHT].map(|_| ([-2.0f32..2.0, -2.0f32..2.0, -0.5f32..3.0], [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], -12f32..1.0)),
            lowpass in prop::sample::select(vec![0.0f32, 2.25]),
        ) {
            agree(discs, lowpass)?;
        }
    }
}
