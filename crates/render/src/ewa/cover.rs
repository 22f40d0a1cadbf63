//! Rasterises splats: finds the pixels of a tile that a splat covers, four columns of two rows at a
//! time, with their squared distance from its centre and the inverse depth of its plane. Most
//! splats are at most four pixels wide and take a fast path whose only branch is the loop over
//! rows.

use crate::ewa::clip::Lines;
use crate::ewa::splat::{Splat, WIDENED};
use crate::ewa::sums::{PAIRS, Rows};
use crate::ewa::tiles::{LANES, PAIR, TILE, TileRect};
use crate::simd::values::{EIGHT, Values, load};
use fearless_simd::{ExtractToken, Simd, SimdMask, f32x8, mask32x8};

/// Position of a tile in the picture.
#[derive(Clone, Debug)]
pub struct Window {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// Number of columns in the picture.
    pub width: usize,
    /// Number of rows in the picture.
    pub height: usize,
    /// Centre of its first pixel.
    from: [f32; 2],
    /// For each column, the x coordinates of the centres of eight pixels from there on.
    columns: [[f32; EIGHT]; TILE],
    /// For each pair of rows, the y coordinates of the centres of eight pixels.
    pairs: [[f32; EIGHT]; PAIRS],
}

impl Window {
    /// The tile with this first pixel, in a picture of `width` x `height` pixels.
    pub fn new([left, top]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let from = [left as f32 + 0.5, top as f32 + 0.5];
        let column = |x: usize| COLUMNS.map(|own| own + (from[0] + x as f32));
        let pair = |pair: usize| ROWS.map(|own| own + (from[1] + (PAIR * pair) as f32));
        Self {
            left,
            top,
            width: TILE.min(width - left),
            height: TILE.min(height - top),
            from,
            columns: std::array::from_fn(column),
            pairs: std::array::from_fn(pair),
        }
    }
}

/// Four columns of two rows under a splat, column by column.
#[derive(Clone, Copy)]
pub struct Pixels<S: Simd> {
    /// Pair of rows in the tile.
    pub pair: usize,
    /// First column in the tile.
    pub x: usize,
    /// Mask of the pixels inside the splat.
    pub inside: mask32x8<S>,
    /// Squared distance from the centre of the splat, less than 1 inside.
    pub squared: f32x8<S>,
    /// Inverse depth of its plane, positive and finite.
    pub inverse_depth: f32x8<S>,
    /// Distance from its clip lines, pixels; infinite without lines.
    pub from_edge: f32x8<S>,
}

impl<S: Simd> Pixels<S> {
    /// Removes the pixels that clip lines cut off. `cx` and `cy` are the centre of the picture.
    #[inline(always)]
    fn kept(mut self, lines: Option<&Lines>, window: &Window, [cx, cy]: [f32; 2]) -> Self {
        if let Some(lines) = lines {
            let simd = self.squared.token();
            let (x, y) = (window.left + self.x, window.top + 2 * self.pair);
            // These numbers depend on the pixel only, so both splats of a pair decide alike.
            let x = load(simd, &COLUMNS) + (x as f32 + 0.5 - cx);
            let y = load(simd, &ROWS) + (y as f32 + 0.5 - cy);
            self.from_edge = lines.distance(x, y);
            self.inside &= simd.splat_f32x8(0.0).cmple(self.from_edge);
        }
        self
    }
}

/// Columns and rows of the eight pixels of a register.
const COLUMNS: [f32; EIGHT] = [0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0];
const ROWS: [f32; EIGHT] = [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0];

/// Incremental evaluation of an ellipse: additions lead from a pair of rows to the next.
struct Ellipse<S: Simd> {
    /// Distances across and along the ellipse and inverse depth of its plane, in the current pair
    /// of rows.
    here: [f32x8<S>; 3],
    /// Growth of `here` to the next pair of rows.
    growth: [f32; 3],
    /// Least inverse depth to which the plane is followed.
    far: f32,
    /// Greatest inverse depth to which the plane is followed.
    near: f32,
}

impl<S: Simd> Ellipse<S> {
    /// Evaluates a splat at the columns from `x` on in a pair of rows. The plane is followed to the
    /// nearest depth of the disc (`NEAREST`), or somewhat beyond it.
    #[inline(always)]
    fn new<const NEAREST: bool>(
        simd: S,
        splat: &Splat,
        window: &Window,
        x: usize,
        pair: usize,
    ) -> Self {
        let [across, shear, along, _, least, greatest] = splat.form;
        let [z, z_x, z_y] = splat.inverse_depth;
        let columns = load(simd, &window.columns[x % TILE]);
        let rows = load(simd, &window.pairs[pair % PAIRS]);
        let (dx, dy) = (columns - splat.origin[0], rows - splat.origin[1]);
        Self {
            here: [
                dx.mul_add(dx.like(across), -(dy * shear)),
                dy * along,
                dx.mul_add(dx.like(z_x), dy.mul_add(dy.like(z_y), dy.like(z))),
            ],
            growth: [-2.0 * shear, 2.0 * along, 2.0 * z_y],
            far: least * WIDENED,
            near: if NEAREST { greatest } else { greatest * (1.0 / WIDENED) },
        }
    }

    /// Squared distance from the centre, and inverse depth of the plane.
    #[inline(always)]
    fn rows(&self) -> [f32x8<S>; 2] {
        let [u, v, plane] = self.here;
        [u.mul_add(u, v * v), plane]
    }

    /// Goes on to the next pair of rows.
    #[inline(always)]
    fn step(&mut self) {
        let [u, v, plane] = self.here;
        self.here = [u + self.growth[0], v + self.growth[1], plane + self.growth[2]];
    }

    /// Clamps inverse depths to the range in which the plane is followed.
    #[inline(always)]
    fn within(&self, plane: f32x8<S>) -> f32x8<S> {
        Values::min(Values::max(plane, plane.like(self.far)), plane.like(self.near))
    }
}

/// The pairs of rows that `rect` touches, with their numbers.
#[inline(always)]
fn pairs<'a>(
    rect: &TileRect,
    sums: &'a mut [Rows; PAIRS],
) -> impl Iterator<Item = (usize, &'a mut Rows)> {
    let (first, past) = (usize::from(rect.first_pair), usize::from(rect.past_pair));
    (first..).zip(&mut sums[first..past])
}

/// Calls `work` with the pixels of a tile under a small splat ([`TileRect::is_small`]) and the pair
/// of rows that they are in. With `NEAREST`, no pixel is nearer than the disc.
#[inline(always)]
pub fn for_each_small<S: Simd, const NEAREST: bool>(
    simd: S,
    splat: &Splat,
    rect: &TileRect,
    window: &Window,
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    let (x, first) = (usize::from(rect.left), usize::from(rect.first_pair));
    // Before anything else, so that nothing is read for an empty range.
    let pairs = pairs(rect, sums);
    let mut ellipse = Ellipse::new::<NEAREST>(simd, splat, window, x, first);
    for (pair, rows) in pairs {
        let [squared, plane] = ellipse.rows();
        let inverse_depth = ellipse.within(plane);
        let inside = squared.cmplt(squared.like(1.0));
        let from_edge = squared.like(f32::INFINITY);
        work(rows, Pixels { pair, x, inside, squared, inverse_depth, from_edge });
        ellipse.step();
    }
}

/// Calls `work` with the pixels of a tile under any splat, without those that its clip lines cut
/// off; see [`for_each_small`]. `middle` and `near` are the centre of the picture and the near
/// plane.
#[inline(always)]
pub fn for_each<S: Simd, const NEAREST: bool>(
    simd: S,
    (splat, rect, lines): (&Splat, &TileRect, Option<&Lines>),
    window: &Window,
    (middle, near): ([f32; 2], f32),
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    if splat.is_by_rays() {
        for_each_by_rays(
            simd,
            splat,
            rect,
            window,
            near,
            sums,
            #[inline(always)]
            |rows, pixels| work(rows, pixels.kept(lines, window, middle)),
        );
    } else {
        for_each_of_ellipse::<_, NEAREST>(
            simd,
            splat,
            rect,
            window,
            sums,
            #[inline(always)]
            |rows, pixels| work(rows, pixels.kept(lines, window, middle)),
        );
    }
}

/// [`for_each`] for ellipses.
#[inline(always)]
fn for_each_of_ellipse<S: Simd, const NEAREST: bool>(
    simd: S,
    splat: &Splat,
    rect: &TileRect,
    window: &Window,
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    let [across, shear, along, amplitude, least, greatest] = splat.form;
    // The exact Gaussian, as in `Splat::exact_squared`; 0 for the affine approximation.
    let exact = if amplitude < 0.0 { least * greatest } else { 0.0 };
    let half_width = 1.0 / across;
    let from = splat.origin[0] - window.from[0] + 0.5;
    let (left, right) = (f32::from(rect.left), f32::from(rect.right));
    for (pair, rows) in pairs(rect, sums) {
        // The interval in which each row crosses the ellipse, a pixel wider on both sides.
        let [upper, lower] = [0.0, 1.0].map(|row| {
            let dy = window.from[1] + (PAIR * pair) as f32 + row - splat.origin[1];
            let v = along * dy;
            let half = (1.0 - v * v).max(0.0).sqrt() * half_width + 1.0;
            let middle = from + shear * half_width * dy;
            [middle - half, middle + half]
        });
        // `as` rounds down, saturates, and turns NaN into 0.
        let past = |place: f32| (place + 0.5).clamp(left, right) as u8;
        let columns = past(upper[0].min(lower[0]))..past(upper[1].max(lower[1]));
        for x in columns.step_by(LANES) {
            let x = usize::from(x);
            let ellipse = Ellipse::new::<NEAREST>(simd, splat, window, x, pair);
            let [mut squared, plane] = ellipse.rows();
            let one = squared.like(1.0);
            let inside = squared.cmplt(one);
            if !inside.any_true() {
                continue;
            }
            if exact > 0.0 {
                let z = Values::min(Values::max(plane, one * least), one * greatest);
                let lacking = (one - squared) * exact / (z * z);
                squared = Values::max(one - lacking, one.like(0.0));
            }
            let inverse_depth = ellipse.within(plane);
            let from_edge = one.like(f32::INFINITY);
            work(rows, Pixels { pair, x, inside, squared, inverse_depth, from_edge });
        }
    }
}

/// [`for_each`] for splats evaluated by rays, where the ray of each pixel meets the plane.
#[inline(always)]
fn for_each_by_rays<S: Simd>(
    simd: S,
    splat: &Splat,
    rect: &TileRect,
    window: &Window,
    near: f32,
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    let [ux, uy, u0, vx, vy, v0] = splat.form;
    let [z, z_x, z_y] = splat.inverse_depth;
    let greatest = simd.splat_f32x8(1.0 / near);
    let (zero, one) = (greatest.like(0.0), greatest.like(1.0));
    let from = [window.from[0] - splat.origin[0], window.from[1] - splat.origin[1]];
    for (pair, rows) in pairs(rect, sums) {
        let dy = load(simd, &ROWS) + (from[1] + (PAIR * pair) as f32);
        for x in (rect.left..rect.right).step_by(LANES) {
            let dx = load(simd, &COLUMNS) + (from[0] + f32::from(x));
            let inverse_depth = dx * z_x + (dy * z_y + z);
            let u = (dx * ux + (dy * uy + u0)) / inverse_depth;
            let v = (dx * vx + (dy * vy + v0)) / inverse_depth;
            let squared = u * u + v * v;
            // NaN is outside.
            let inside =
                zero.cmplt(inverse_depth) & inverse_depth.cmple(greatest) & squared.cmplt(one);
            if !inside.any_true() {
                continue;
            }
            let squared = <f32x8<S> as Values>::select(inside, squared, one);
            let inverse_depth = <f32x8<S> as Values>::select(inside, inverse_depth, greatest);
            let x = usize::from(x);
            let from_edge = one.like(f32::INFINITY);
            work(rows, Pixels { pair, x, inside, squared, inverse_depth, from_edge });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ewa::splat::{Disc, Lens, Placement};
    use crate::ewa::sums::Sums;
    use crate::ewa::tiles::{SplatRun, TileEntry, Tiles};
    use fearless_simd::{Level, dispatch};
    use glam::{Vec2, Vec3};
    use proptest::prelude::*;

    const SIZE: [usize; 2] = [75, 70];
    const NEAR: f32 = 0.05;

    proptest! {
        #[test]
        fn every_pixel_is_what_the_splat_is_at_its_centre(
            at in [-0.2f32..0.2, -0.2f32..0.2, 0.02f32..2.0], normal in [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], log in -9f32..0.0,
        ) {
            let size = Vec2::new(SIZE[0] as f32, SIZE[1] as f32);
            let lens = Lens { focal_px: 200.0, centre_px: size * 0.5, origin_px: Vec2::ZERO, size, near: NEAR, lowpass: 2.25 };
            let normal = Vec3::from_array(normal).normalize_or(Vec3::Z);
            let disc = Disc::round(Vec3::from_array(at), normal, log.exp2());
            let Placement::Drawn(splat, bounds) = disc.place(&lens) else { return Ok(()) };
            let tiles = Tiles::new(SIZE[0], SIZE[1]);
            let mut run = SplatRun::default();
            run.clear(tiles);
            run.room()[0] = splat;
            run.push(splat.attributes, bounds, None);
            run.sort();
            let mut sums = Sums::default();
            let mut found = vec![None; SIZE[0] * SIZE[1]];
            for tile in 0..tiles.columns * tiles.rows {
                let [left, top] = [tile % tiles.columns * TILE, tile / tiles.columns * TILE];
                let window = Window::new([left, top], SIZE);
                for (splat, TileEntry { rect, .. }) in run.of_tile(tile) {
                    dispatch!(Level::new(), simd => {
                        let work = |_: &mut Rows, p: Pixels<_>| {
                            let inside = <[i32; EIGHT]>::from(p.inside);
                            for k in (0..EIGHT).filter(|&k| inside[k] != 0) {
                                let (x, y) = (p.x + k / 2, 2 * p.pair + k % 2);
                                if x >= window.width || y >= window.height {
                                    continue;
                                }
                                let pixel = (top + y) * SIZE[0] + left + x;
                                assert!(found[pixel].is_none(), "once");
                                found[pixel] = Some([p.squared[k], p.inverse_depth[k]]);
                            }
                        };
                        if rect.is_small {
                            for_each_small::<_, false>(simd, splat, rect, &window, sums.pairs(), work);
                        } else {
                            for_each::<_, false>(simd, (splat, rect, None), &window, ([0.0; 2], NEAR), sums.pairs(), work);
                        }
                    });
                }
            }
            let greatest = splat.inverse_depth[0].abs().max(1.0 / disc.centre.z);
            for (pixel, found) in found.into_iter().enumerate() {
                let place = Vec2::new((pixel % SIZE[0]) as f32, (pixel / SIZE[0]) as f32) + 0.5;
                match (splat.at(place, NEAR), found) {
                    (Some([q, z]), Some([own_q, own_z])) => {
                        prop_assert!((q - own_q).abs() < 1e-3, "{place}: {q} {own_q}");
                        prop_assert!((z - own_z).abs() < 1e-4 * greatest, "{place}: {z} {own_z}");
                    }
                    // At the boundary rounding decides.
                    (Some([q, _]), None) => prop_assert!(q > 0.999, "{place}: {q}"),
                    (None, Some([q, _])) => prop_assert!(q > 0.999, "{place}: {q}"),
                    (None, None) => {}
                }
            }
        }
    }
}
