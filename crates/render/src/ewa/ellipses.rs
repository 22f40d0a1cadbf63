//! Eight splats at once: [`crate::ewa::splat::Disc::place`] for eight discs in registers, with
//! their tiles. The test compares both.

use crate::ewa::splat::{Box4, CONDITION_MAX, Lens, REACH_MAX, Splat, edges, ellipse};
use crate::ewa::tiles::{LANES, PAIR, TILE, TileRect};
use crate::simd::lanes::turned;
use crate::simd::values::{EIGHT, Values, bits};
use fearless_simd::{Bytes, Simd, SimdBase, f32x8, mask32x8, u32x8};
use glam::Vec4;

/// Projections of eight discs as ellipses.
pub struct Ellipses<S: Simd> {
    /// Bit mask of the discs that may be in the picture.
    pub shows: u32,
    /// Bit mask of the discs whose projection is an ellipse.
    pub ellipses: u32,
    /// Bit mask of the ellipses that can be evaluated in `f32`.
    usable: u32,
    /// [`Splat`] without its attributes, in rows of four values.
    rows: [[f32x8<S>; 4]; 3],
    tile_rects: TileRects,
}

/// The tiles and rectangles of eight splats that touch one tile each.
struct TileRects {
    /// Bounds in the picture, as in [`Box4`].
    bounds: [[u32; EIGHT]; 4],
    /// Number of the tile.
    tile: [u32; EIGHT],
    /// Columns and pairs of rows of [`TileRect`], a byte each.
    sides: [u32; EIGHT],
    /// Bit mask of the splats that touch one tile only.
    single: u32,
    /// Bit mask of the splats that the fast path draws ([`TileRect::is_small`]).
    narrow: u32,
}

impl<S: Simd> Ellipses<S> {
    /// Projects eight discs, in a picture with `columns` tiles in a row. Their depths follow planes
    /// on which depth grows by `growth` ([`crate::ewa::splat::Ellipse::along_plane`]).
    #[inline(always)]
    pub fn new(
        lens: &Lens,
        columns: usize,
        centre: [f32x8<S>; 3],
        tangents: [[f32x8<S>; 3]; 2],
        radius: f32x8<S>,
        growth: [f32x8<S>; 2],
    ) -> Self {
        let [a, b] = tangents;
        let depth = centre[2];
        let (zero, near) = (depth.like(0.0), depth.like(lens.near));
        let extent = Values::sqrt(a[2] * a[2] + b[2] * b[2]);
        let farthest = depth + extent;
        let is_before = near.cmple(farthest) & farthest.cmplt(near.like(f32::INFINITY));
        let is_ellipse = near.cmple(depth - extent) & extent.cmple(depth * REACH_MAX);
        let e = ellipse(lens, centre, tangents, radius).along_plane(centre, growth, lens);
        let [x, y] = [0, 1].map(|i| {
            let (origin, half) = (e.origin[i], e.half[i]);
            edges(origin - half, origin + half, lens.size[i])
        });
        let is_seen = x[0].cmplt(x[1]) & y[0].cmplt(y[1]);
        let is_fine = zero.cmple(e.condition) & e.condition.cmplt(zero.like(CONDITION_MAX));
        // A sum with an infinite or NaN term is not 0.
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
            tile_rects: TileRects::new(x, y, zero.cmplt(amplitude), columns),
        }
    }

    /// Bit mask of the discs that are drawn as ellipses.
    #[inline(always)]
    pub fn drawn(&self) -> u32 {
        self.shows & self.ellipses & self.usable
    }

    /// Writes the splats of the bit mask `which` one after another. Their attributes are not
    /// changed.
    #[inline(always)]
    pub fn write(&self, which: u32, into: &mut [Splat; EIGHT]) {
        if which == 0xff {
            self.write_to([0, 1, 2, 3, 4, 5, 6, 7], into);
        } else {
            // A splat that is not in the mask is overwritten by the next one.
            let mut places = [0; EIGHT];
            for k in 1..EIGHT {
                places[k] = places[k - 1] + (which >> (k - 1) & 1) as usize;
            }
            self.write_to(places, into);
        }
    }

    /// Writes splat `k` to `into[places[k]]`.
    #[inline(always)]
    fn write_to(&self, places: [usize; EIGHT], into: &mut [Splat; EIGHT]) {
        for (i, row) in self.rows.iter().enumerate() {
            for (values, place) in side_by_side(*row).iter().zip(places) {
                let rows: &mut [[f32; 4]; 4] = bytemuck::cast_mut(&mut into[place % EIGHT]);
                rows[i] = values.to_array();
            }
        }
    }

    /// Bounds of splat `k`.
    #[inline(always)]
    pub fn bounds(&self, k: usize) -> Box4 {
        self.tile_rects.bounds.map(|c| c[k % EIGHT])
    }

    /// The tile that splat `k` touches and the rectangle in it; `None` if the splat touches several
    /// tiles.
    #[inline(always)]
    pub fn tile_rect(&self, k: usize) -> Option<(usize, TileRect)> {
        let TileRects { tile, sides, single, narrow, .. } = &self.tile_rects;
        let [left, right, first_pair, past_pair] = sides[k % EIGHT].to_le_bytes();
        let is_small = narrow >> k & 1 == 1;
        (single >> k & 1 == 1).then(|| {
            (tile[k % EIGHT] as usize, TileRect { is_small, left, right, first_pair, past_pair })
        })
    }
}

impl TileRects {
    /// Computes tiles from the edges of ellipses ([`edges`]) and whether these are plain
    /// ([`Splat::is_plain`]).
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

/// The integer of numbers that have [`crate::simd::values::WHOLE`] added.
#[inline(always)]
fn whole<S: Simd>(edge: f32x8<S>) -> u32x8<S> {
    edge.bitcast::<u32x8<S>>() & 0xffff
}

/// Transposes four values of eight splats to one vector a splat.
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
    use crate::ewa::splat::{Disc, Placement};
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
            origin_px: Vec2::ZERO,
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
            let eight = Ellipses::new(&lens, 10, parts(&|d| d.centre), tangents, of(&|d| d.radius), [load(simd, &[0.0; EIGHT]); 2]);
            let mut splats = [Splat::default(); EIGHT];
            eight.write(eight.drawn(), &mut splats);
            let bounds: [Box4; EIGHT] = std::array::from_fn(|k| eight.bounds(k));
            (eight.shows, eight.ellipses, eight.drawn(), splats, bounds)
        });
        let mut written = splats.iter();
        for (k, disc) in discs.iter().enumerate() {
            let is = |bits: u32| bits >> k & 1 == 1;
            match disc.place(&lens) {
                Placement::Drawn(splat, box4) if !splat.is_by_rays() => {
                    prop_assert!(is(drawn));
                    prop_assert_eq!(format!("{:?}", written.next()), format!("{:?}", Some(splat)));
                    prop_assert_eq!(bounds[k], box4);
                }
                Placement::Drawn(..) => prop_assert!(is(shows) && !is(ellipses)),
                Placement::Outside => prop_assert!(!is(drawn)),
                Placement::Dropped => prop_assert!(is(shows) && !is(drawn)),
            }
        }
        Ok(())
    }

    #[test]
    fn a_box_that_ends_at_the_centre_of_a_pixel_is_the_same() {
        let disc =
            ([0.0, -0.28869793, 2.9854128], [-0.46423763, 0.29723123, 0.29949716], -10.743054);
        agree([disc; EIGHT], 2.25).unwrap();
    }

    proptest! {
        #[test]
        fn eight_discs_at_once_make_the_same_splats_as_one_by_one(
            discs in [0; EIGHT].map(|_| ([-2.0f32..2.0, -2.0f32..2.0, -0.5f32..3.0], [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], -12f32..1.0)),
            lowpass in prop::sample::select(vec![0.0f32, 2.25]),
        ) {
            agree(discs, lowpass)?;
        }
    }
}
