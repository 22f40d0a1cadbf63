//! The pixels of a tile that a splat covers, four columns of two rows at a time: where they are in the splat, and how deep
//! its plane is there. Most splats are no wider than four pixels and take a short way without any branch but that for their
//! rows.

use crate::ewa::clip::Lines;
use crate::ewa::splat::{Splat, WIDENED};
use crate::ewa::sums::{PAIR, PAIRS, Rows};
use crate::ewa::tiles::{LANES, Part, TILE};
use crate::simd::values::{EIGHT, Values, load};
use fearless_simd::{ExtractToken, Simd, SimdMask, f32x8, mask32x8};

/// Pixels of a tile's row in its buffers: what is worked on together may end past the tile.
pub const STRIDE: usize = TILE + LANES;

/// The part of the picture that a tile is.
#[derive(Clone, Debug)]
pub struct Window {
    /// Its first column.
    pub left: usize,
    /// Its first row.
    pub top: usize,
    /// Columns of it that are in the picture.
    pub width: usize,
    /// Rows of it that are in the picture.
    pub height: usize,
    /// Middle of its first pixel.
    from: [f32; 2],
    /// For each column, where the middles of pixels are that are worked on together from there on.
    columns: [[f32; EIGHT]; TILE],
    /// The same for each pair of rows.
    pairs: [[f32; EIGHT]; PAIRS],
}

impl Window {
    /// Of a tile whose first pixel is given, in a picture of so many columns and rows.
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

/// Neighbouring pixels of two rows under a splat, columns one after another.
#[derive(Clone, Copy)]
pub struct Pixels<S: Simd> {
    /// Pair of rows, from the tile's first.
    pub pair: usize,
    /// Column of the first, from the tile's first.
    pub x: usize,
    /// Which of them are inside.
    pub inside: mask32x8<S>,
    /// Square of the place in the splat, less than 1 inside.
    pub squared: f32x8<S>,
    /// Positive, finite.
    pub inverse_depth: f32x8<S>,
}

impl<S: Simd> Pixels<S> {
    /// Those of them that lines keep.
    #[inline(always)]
    fn kept(mut self, lines: Option<&Lines>, window: &Window, [cx, cy]: [f32; 2]) -> Self {
        if let Some(lines) = lines {
            let simd = self.squared.token();
            let (x, y) = (window.left + self.x, window.top + 2 * self.pair);
            // The same for all splats on a pixel.
            let x = load(simd, &COLUMNS) + (x as f32 + 0.5 - cx);
            let y = load(simd, &ROWS) + (y as f32 + 0.5 - cy);
            self.inside &= lines.keep(x, y);
        }
        self
    }
}

/// Columns and rows of pixels that are worked on together.
const COLUMNS: [f32; EIGHT] = [0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0];
const ROWS: [f32; EIGHT] = [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0];

/// An ellipse over the columns that are worked on together: what it takes to go from two rows to the next by additions.
struct Ellipse<S: Simd> {
    /// Across it, along it, and the inverse depth on its plane, in two rows; and their growth to the next.
    here: [f32x8<S>; 3],
    growth: [f32; 3],
    /// Between these its plane is followed.
    far: f32,
    near: f32,
}

impl<S: Simd> Ellipse<S> {
    /// At the columns from `x` on in a pair of rows of a tile. Its plane is followed to its nearest, or also a little
    /// before it.
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

    /// Square of the place in the splat, and inverse depth on its plane.
    #[inline(always)]
    fn rows(&self) -> [f32x8<S>; 2] {
        let [u, v, plane] = self.here;
        [u.mul_add(u, v * v), plane]
    }

    #[inline(always)]
    fn step(&mut self) {
        let [u, v, plane] = self.here;
        self.here = [u + self.growth[0], v + self.growth[1], plane + self.growth[2]];
    }

    #[inline(always)]
    fn within(&self, plane: f32x8<S>) -> f32x8<S> {
        Values::min(Values::max(plane, plane.like(self.far)), plane.like(self.near))
    }
}

/// Pairs of rows of a tile that a part of it lies in, each with its number.
#[inline(always)]
fn pairs<'a>(
    part: &Part,
    sums: &'a mut [Rows; PAIRS],
) -> impl Iterator<Item = (usize, &'a mut Rows)> {
    let (first, past) = (usize::from(part.first_pair), usize::from(part.past_pair));
    (first..).zip(&mut sums[first..past])
}

/// Gives the pixels of a tile under a small splat, with the pair of rows that they are in. Where `NEAREST`, none is nearer
/// than the nearest of the disc.
#[inline(always)]
pub fn for_each_small<S: Simd, const NEAREST: bool>(
    simd: S,
    splat: &Splat,
    part: &Part,
    window: &Window,
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    let (x, first) = (usize::from(part.left), usize::from(part.first_pair));
    // First of all, so that nothing is read before it is known to be needed.
    let pairs = pairs(part, sums);
    let mut ellipse = Ellipse::new::<NEAREST>(simd, splat, window, x, first);
    for (pair, rows) in pairs {
        let [squared, plane] = ellipse.rows();
        let inverse_depth = ellipse.within(plane);
        let inside = squared.cmplt(squared.like(1.0));
        work(rows, Pixels { pair, x, inside, squared, inverse_depth });
        ellipse.step();
    }
}

/// Gives the pixels of a tile under any splat, as far as its lines keep them; of the camera the picture's middle and the
/// near plane. Otherwise as [`for_each_small`].
#[inline(always)]
pub fn for_each<S: Simd, const NEAREST: bool>(
    simd: S,
    (splat, part, lines): (&Splat, &Part, Option<&Lines>),
    window: &Window,
    (middle, near): ([f32; 2], f32),
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    if splat.is_by_rays() {
        for_each_by_rays(
            simd,
            splat,
            part,
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
            part,
            window,
            sums,
            #[inline(always)]
            |rows, pixels| work(rows, pixels.kept(lines, window, middle)),
        );
    }
}

#[inline(always)]
fn for_each_of_ellipse<S: Simd, const NEAREST: bool>(
    simd: S,
    splat: &Splat,
    part: &Part,
    window: &Window,
    sums: &mut [Rows; PAIRS],
    mut work: impl FnMut(&mut Rows, Pixels<S>),
) {
    let [across, shear, along, amplitude, least, greatest] = splat.form;
    // The exact Gaussian of an ellipse: section 4.4's conic is that of the plane times the square of the inverse
    // depth, so what a weight lacks to the cutoff goes by that.
    let mend = if amplitude < 0.0 { least * greatest } else { 0.0 };
    let half_width = 1.0 / across;
    let from = splat.origin[0] - window.from[0] + 0.5;
    let (left, right) = (f32::from(part.left), f32::from(part.right));
    for (pair, rows) in pairs(part, sums) {
        // Where the two rows cross the ellipse, and a pixel more.
        let [upper, lower] = [0.0, 1.0].map(|row| {
            let dy = window.from[1] + (PAIR * pair) as f32 + row - splat.origin[1];
            let v = along * dy;
            let half = (1.0 - v * v).max(0.0).sqrt() * half_width + 1.0;
            let middle = from + shear * half_width * dy;
            [middle - half, middle + half]
        });
        // `as` rounds down, saturates, and takes what is not a number for 0.
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
            if mend > 0.0 {
                let z = Values::min(Values::max(plane, one * least), one * greatest);
                let lacking = (one - squared) * mend / (z * z);
                squared = Values::max(one - lacking, one.like(0.0));
            }
            let inverse_depth = ellipse.within(plane);
            work(rows, Pixels { pair, x, inside, squared, inverse_depth });
        }
    }
}

/// The same where each pixel's ray meets the plane.
#[inline(always)]
fn for_each_by_rays<S: Simd>(
    simd: S,
    splat: &Splat,
    part: &Part,
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
    for (pair, rows) in pairs(part, sums) {
        let dy = load(simd, &ROWS) + (from[1] + (PAIR * pair) as f32);
        for x in (part.left..part.right).step_by(LANES) {
            let dx = load(simd, &COLUMNS) + (from[0] + f32::from(x));
            let inverse_depth = dx * z_x + (dy * z_y + z);
            let u = (dx * ux + (dy * uy + u0)) / inverse_depth;
            let v = (dx * vx + (dy * vy + v0)) / inverse_depth;
            let squared = u * u + v * v;
            // What is not a number is outside.
            let inside =
                zero.cmplt(inverse_depth) & inverse_depth.cmple(greatest) & squared.cmplt(one);
            if !inside.any_true() {
                continue;
            }
            let squared = <f32x8<S> as Values>::select(inside, squared, one);
            let inverse_depth = <f32x8<S> as Values>::select(inside, inverse_depth, greatest);
            let x = usize::from(x);
            work(rows, Pixels { pair, x, inside, squared, inverse_depth });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ewa::splat::{Disc, Lens, Placed};
    use crate::ewa::sums::Sums;
    use crate::ewa::tiles::{Entry, Run, Tiles};
    use fearless_simd::{Level, dispatch};
    use glam::{Vec2, Vec3};
    use proptest::prelude::*;

    const SIZE: [usize; 2] = [75, 70];
    const NEAR: f32 = 0.05;

    proptest! {
        #[test]
        fn every_pixel_is_what_the_splat_is_at_its_middle(
            at in [-0.2f32..0.2, -0.2f32..0.2, 0.02f32..2.0], normal in [-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], log in -9f32..0.0,
        ) {
            let size = Vec2::new(SIZE[0] as f32, SIZE[1] as f32);
            let lens = Lens { focal_px: 200.0, centre_px: size * 0.5, size, near: NEAR, lowpass: 2.25 };
            let normal = Vec3::from_array(normal).normalize_or(Vec3::Z);
            let disc = Disc::round(Vec3::from_array(at), normal, log.exp2());
            let Placed::Drawn(splat, bounds) = disc.place(&lens) else { return Ok(()) };
            let tiles = Tiles::new(SIZE[0], SIZE[1]);
            let mut run = Run::default();
            run.clear(tiles);
            run.room()[0] = splat;
            run.take(splat.dye, bounds, None);
            run.sort();
            let mut sums = Sums::default();
            let mut found = vec![None; SIZE[0] * SIZE[1]];
            for tile in 0..tiles.columns * tiles.rows {
                let [left, top] = [tile % tiles.columns * TILE, tile / tiles.columns * TILE];
                let window = Window::new([left, top], SIZE);
                for (splat, Entry { part, .. }) in run.of_tile(tile) {
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
                        if part.is_small {
                            for_each_small::<_, false>(simd, splat, part, &window, sums.pairs(), work);
                        } else {
                            for_each::<_, false>(simd, (splat, part, None), &window, ([0.0; 2], NEAR), sums.pairs(), work);
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
                    // On the rim rounding decides.
                    (Some([q, _]), None) => prop_assert!(q > 0.999, "{place}: {q}"),
                    (None, Some([q, _])) => prop_assert!(q > 0.999, "{place}: {q}"),
                    (None, None) => {}
                }
            }
        }
    }
}
