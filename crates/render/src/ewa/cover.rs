//! The pixels of a tile that a splat covers, four of a row at a time: where they are in the splat, and how deep its plane
//! is there. Most splats are no wider than four pixels and take a short way without any branch but that for their rows.

use super::clip::Lines;
use super::splat::{Splat, WIDENED};
use super::tiles::{Entry, LANES, TILE};
use crate::lanes::{Lane, Mask, counting};
use glam::Vec4;

/// Pixels of a tile's row in its buffers: what is worked on together may end past the tile.
pub const STRIDE: usize = TILE + LANES;

/// The part of the picture that a tile is.
#[derive(Clone, Copy, Debug)]
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
    pub from: [f32; 2],
}

impl Window {
    /// Of a tile whose first pixel is given, in a picture of so many columns and rows.
    pub fn new([left, top]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        Self {
            left,
            top,
            width: TILE.min(width - left),
            height: TILE.min(height - top),
            from: [left as f32 + 0.5, top as f32 + 0.5],
        }
    }
}

/// Neighbouring pixels of a row under a splat.
#[derive(Clone, Copy, Debug)]
pub struct Pixels {
    /// Row, from the tile's first.
    pub y: usize,
    /// Column of the first, from the tile's first.
    pub x: usize,
    /// Which of them are inside.
    pub inside: Mask,
    /// Square of the place in the splat, less than 1 inside.
    pub squared: Lane,
    /// Positive, finite.
    pub inverse_depth: Lane,
}

/// An ellipse over the columns that are worked on together: what it takes to go from a row to the next by additions.
struct Ellipse {
    /// Across it, along it, and the inverse depth on its plane, in a row; and their growth a row.
    here: [Lane; 3],
    growth: [Lane; 3],
    /// Between these its plane is followed.
    far: Lane,
    near: Lane,
}

impl Ellipse {
    /// At the columns from `x` on in row `y` of a tile.
    #[inline(always)]
    fn new(splat: &Splat, window: &Window, [x, y]: [u8; 2]) -> Self {
        let [across, shear, along, _, least, greatest] = splat.form;
        let [z, z_x, z_y] = splat.inverse_depth;
        let dx = counting(window.from[0] + f32::from(x) - splat.origin[0], 1.0);
        let dy = window.from[1] + f32::from(y) - splat.origin[1];
        let of = Vec4::splat;
        Self {
            here: [dx * across - shear * dy, of(along * dy), dx * z_x + (z + z_y * dy)],
            growth: [of(-shear), of(along), of(z_y)],
            far: of(least * WIDENED),
            near: of(greatest * (1.0 / WIDENED)),
        }
    }

    /// Square of the place in the splat, and inverse depth on its plane.
    #[inline(always)]
    fn row(&self) -> [Lane; 2] {
        let [u, v, plane] = self.here;
        [u * u + v * v, plane]
    }

    #[inline(always)]
    fn step(&mut self) {
        (0..3).for_each(|i| self.here[i] += self.growth[i]);
    }

    #[inline(always)]
    fn within(&self, plane: Lane) -> Lane {
        plane.max(self.far).min(self.near)
    }
}

/// Gives the pixels of a tile under an entry of its that is small.
#[inline(always)]
pub fn for_each_small(splat: &Splat, entry: &Entry, window: &Window, mut work: impl FnMut(Pixels)) {
    let mut ellipse = Ellipse::new(splat, window, [entry.left, entry.top]);
    let x = usize::from(entry.left);
    for y in usize::from(entry.top)..usize::from(entry.bottom) {
        let [squared, plane] = ellipse.row();
        let inverse_depth = ellipse.within(plane);
        work(Pixels { y, x, inside: squared.cmplt(Vec4::ONE), squared, inverse_depth });
        ellipse.step();
    }
}

/// Gives the pixels of a tile under any entry of its, as far as its lines keep them; of the camera the picture's middle
/// and the near plane.
#[inline(never)]
pub fn for_each(
    splat: &Splat,
    entry: &Entry,
    lines: Option<&Lines>,
    window: &Window,
    [cx, cy]: [f32; 2],
    near: f32,
    mut work: impl FnMut(Pixels),
) {
    let keep = |mut pixels: Pixels| {
        if let Some(lines) = lines {
            let (x, y) = (window.left + pixels.x, window.top + pixels.y);
            // The same for all splats on a pixel.
            let x = counting(0.0, 1.0) + (x as f32 + 0.5 - cx);
            pixels.inside &= lines.keep(x, y as f32 + 0.5 - cy);
        }
        work(pixels);
    };
    if splat.is_by_rays() {
        for_each_by_rays(splat, entry, window, near, keep);
    } else {
        for_each_of_ellipse(splat, entry, window, keep);
    }
}

#[inline(always)]
fn for_each_of_ellipse(
    splat: &Splat,
    entry: &Entry,
    window: &Window,
    mut work: impl FnMut(Pixels),
) {
    let [across, shear, along, amplitude, least, greatest] = splat.form;
    // The exact Gaussian of an ellipse: section 4.4's conic is that of the plane times the square of the inverse
    // depth, so what a weight lacks to the cutoff goes by that.
    let mend = if amplitude < 0.0 { least * greatest } else { 0.0 };
    let half_width = 1.0 / across;
    let from = splat.origin[0] - window.from[0] + 0.5;
    let (left, right) = (f32::from(entry.left), f32::from(entry.right));
    for y in entry.top..entry.bottom {
        let dy = window.from[1] + f32::from(y) - splat.origin[1];
        let v = along * dy;
        // Where the row crosses the ellipse, and a pixel more.
        let half = (1.0 - v * v).max(0.0).sqrt() * half_width + 1.0;
        let middle = from + shear * half_width * dy;
        // `as` rounds down, saturates, and takes what is not a number for 0.
        let past = |place: f32| (place + 0.5).clamp(left, right) as u8;
        for x in (past(middle - half)..past(middle + half)).step_by(LANES) {
            let ellipse = Ellipse::new(splat, window, [x, y]);
            let [mut squared, plane] = ellipse.row();
            let inside = squared.cmplt(Vec4::ONE);
            if !inside.any() {
                continue;
            }
            if mend > 0.0 {
                let z = plane.max(Vec4::splat(least)).min(Vec4::splat(greatest));
                let lacking = (Vec4::ONE - squared) * mend / (z * z);
                squared = (Vec4::ONE - lacking).max(Vec4::ZERO);
            }
            let inverse_depth = ellipse.within(plane);
            let (x, y) = (usize::from(x), usize::from(y));
            work(Pixels { y, x, inside, squared, inverse_depth });
        }
    }
}

/// The same where each pixel's ray meets the plane.
#[inline(always)]
fn for_each_by_rays(
    splat: &Splat,
    entry: &Entry,
    window: &Window,
    near: f32,
    mut work: impl FnMut(Pixels),
) {
    let [ux, uy, u0, vx, vy, v0] = splat.form;
    let [z, z_x, z_y] = splat.inverse_depth;
    let greatest = Vec4::splat(1.0 / near);
    let from = [window.from[0] - splat.origin[0], window.from[1] - splat.origin[1]];
    for y in usize::from(entry.top)..usize::from(entry.bottom) {
        let dy = from[1] + y as f32;
        for x in (usize::from(entry.left)..usize::from(entry.right)).step_by(LANES) {
            let dx = counting(from[0] + x as f32, 1.0);
            let inverse_depth = dx * z_x + (z + z_y * dy);
            let u = (dx * ux + (u0 + uy * dy)) / inverse_depth;
            let v = (dx * vx + (v0 + vy * dy)) / inverse_depth;
            let squared = u * u + v * v;
            // What is not a number is outside.
            let inside = inverse_depth.cmpgt(Vec4::ZERO)
                & inverse_depth.cmple(greatest)
                & squared.cmplt(Vec4::ONE);
            if !inside.any() {
                continue;
            }
            let squared = Vec4::select(inside, squared, Vec4::ONE);
            let inverse_depth = Vec4::select(inside, inverse_depth, greatest);
            work(Pixels { y, x, inside, squared, inverse_depth });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::splat::{Disc, Lens, Placed};
    use super::super::tiles::{Run, Tiles};
    use super::*;
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
            run.push(splat, bounds, None);
            run.sort();
            let mut found = vec![None; SIZE[0] * SIZE[1]];
            for tile in 0..tiles.columns * tiles.rows {
                let [left, top] = [tile % tiles.columns * TILE, tile / tiles.columns * TILE];
                let window = Window::new([left, top], SIZE);
                for (splat, entry) in run.of_tile(tile) {
                    let work = |p: Pixels| {
                        for k in (0..LANES).filter(|&k| p.inside.test(k) && p.x + k < window.width) {
                            let pixel = (top + p.y) * SIZE[0] + left + p.x + k;
                            assert!(found[pixel].is_none(), "once");
                            found[pixel] = Some([p.squared[k], p.inverse_depth[k]]);
                        }
                    };
                    if entry.is_small {
                        for_each_small(splat, entry, &window, work);
                    } else {
                        for_each(splat, entry, None, &window, [0.0; 2], NEAR, work);
                    }
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
