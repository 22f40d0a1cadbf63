//! Lookup of filtered indirect light by similarity of normal and depth (`bauszat2011`, section 3.2,
//! equations 3 to 5). In: what a ray of a pixel sees, and the guides. Out: the neighbouring guide
//! that is most similar.

use super::guide::{Seen, footprint};
use crate::camera::Camera;
use glam::Vec3;

/// Cosine between the normals of a sample and of a guide, below which the guide does not fit.
pub(crate) const FIT_COS: f32 = 0.5;
/// Distance of a sample from the plane of its guide, in half widths of a pixel, above which the
/// guide does not fit: surfaces curve and waver by a few pixels, primitives under a pixel are
/// farther from what is behind them.
pub(crate) const FIT_PIXELS: f32 = 8.0;

/// Squared difference of normals up to which they are equal: the rounding of blends on a plane,
/// which must not choose the guide.
const NORMAL_ROUNDING: f32 = 1e-6;
/// Difference of depths up to which they are equal, as a share of the depth.
const DEPTH_ROUNDING: f32 = 1e-5;

/// Difference of similarities up to which guides are equally similar, and the first is taken: those
/// of a row on a floor differ by rounding.
const NEAR_TIE: f32 = 1e-4;

/// The guide of a neighbouring pixel: its index, and its place among the 3 x 3 around the pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Neighbour {
    pub index: usize,
    pub slot: usize,
}

/// Squared differences over the greatest of them, subtracted from 1 (equations 4 and 5). If all
/// are at most `rounding`, all are similar.
fn similarities(differences: [f32; 4], valid: [bool; 4], rounding: f32) -> [f32; 4] {
    let most = (0..4).filter(|&i| valid[i]).map(|i| differences[i]).fold(0.0, f32::max);
    differences.map(|difference| if most > rounding { 1.0 - difference / most } else { 1.0 })
}

/// The guide of the four pixel centres around (`x_px`, `y_px`), a position within pixel `x`, `y`,
/// that is most similar to `seen`; `None` if none fits (figure 3b).
pub(crate) fn most_similar(
    camera: &Camera,
    guides: &[Seen],
    [x, y]: [usize; 2],
    [x_px, y_px]: [f32; 2],
    seen: &Seen,
) -> Option<Neighbour> {
    let sides = |at: usize, px: f32, end: usize| {
        let beside = if px < at as f32 + 0.5 { at.checked_sub(1) } else { Some(at + 1) };
        [Some(at), beside.filter(|&beside| beside < end)]
    };
    let (columns, rows) = (sides(x, x_px, camera.width), sides(y, y_px, camera.height));
    // The pixel itself is the first: it is taken where several are equally similar.
    let places = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| columns[i].zip(rows[j]));
    let index =
        places.map(|place| place.map_or(y * camera.width + x, |(i, j)| j * camera.width + i));
    let valid = [0, 1, 2, 3].map(|i| places[i].is_some() && guides[index[i]].receives());
    let normals = similarities(
        index.map(|i| guides[i].surface.normal.distance_squared(seen.surface.normal)),
        valid,
        NORMAL_ROUNDING,
    );
    let differences = index.map(|i| (guides[i].depth - seen.depth).abs());
    let depths = similarities(differences, valid, DEPTH_ROUNDING * seen.depth);
    let mut best = None;
    let mut most = f32::NEG_INFINITY;
    for i in 0..4 {
        let similarity = normals[i] * depths[i];
        if valid[i] && similarity > most + NEAR_TIE {
            (best, most) = (Some(i), similarity);
        }
    }
    let (i, (column, row)) = best.and_then(|i| Some((i, places[i]?)))?;
    let slot = (row + 1 - y) * 3 + (column + 1 - x);
    fits(camera, &guides[index[i]], seen).then_some(Neighbour { index: index[i], slot })
}

/// Whether the light at a guide can stand for that at `seen`: both lie on one surface.
pub(crate) fn fits(camera: &Camera, guide: &Seen, seen: &Seen) -> bool {
    let (a, b) = (&guide.surface, &seen.surface);
    let off = |normal: Vec3| normal.dot(a.point - b.point).abs();
    let limit = FIT_PIXELS * footprint(camera, seen.depth) + a.lift.max(b.lift);
    a.normal.dot(b.normal) >= FIT_COS && off(a.normal).min(off(b.normal)) <= limit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::surface::Surface;
    use esker_lod::View;
    use glam::DVec3;

    fn camera() -> Camera {
        let view = View::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 1.0, 3, 3);
        Camera::new(&view, DVec3::ZERO)
    }

    fn seen(normal: Vec3, depth: f32) -> Seen {
        let point = Vec3::new(0.0, 0.0, -depth);
        let surface = Surface { point, normal, albedo: Vec3::ONE, ..Surface::default() };
        Seen { surface, depth }
    }

    fn find(guides: &[Seen], at: [f32; 2], what: &Seen) -> Option<usize> {
        most_similar(&camera(), guides, [1, 1], at, what).map(|found| {
            assert_eq!(found.slot, found.index, "the picture is the 3 x 3 around the pixel");
            found.index
        })
    }

    #[test]
    fn the_pixel_itself_is_taken_where_all_are_alike() {
        let guides = [seen(Vec3::Z, 2.0); 9];
        for at in [[1.2, 1.2], [1.8, 1.2], [1.2, 1.9], [1.7, 1.7]] {
            assert_eq!(find(&guides, at, &seen(Vec3::Z, 2.0)), Some(4));
        }
    }

    #[test]
    fn the_most_similar_of_the_four_centres_around_is_taken_and_misses_are_not() {
        let mut guides = [seen(Vec3::Z, 2.0); 9];
        let other = seen(Vec3::X, 2.1);
        guides[1] = other;
        assert_eq!(find(&guides, [1.3, 1.3], &other), Some(1));
        assert_eq!(find(&guides, [1.3, 1.3], &seen(Vec3::Z, 2.0)), Some(4));
        // Below the centre the row above is not among the four.
        assert_eq!(find(&guides, [1.3, 1.8], &other), None);
        guides[1] = Seen::NOTHING;
        assert_eq!(find(&guides, [1.3, 1.3], &other), None);
    }

    #[test]
    fn a_primitive_under_a_pixel_has_no_guide() {
        let guides = [seen(Vec3::Z, 200.0); 9];
        assert_eq!(find(&guides, [1.5, 1.5], &seen(Vec3::Z, 2.0)), None);
        assert_eq!(find(&[Seen::NOTHING; 9], [1.5, 1.5], &seen(Vec3::Z, 2.0)), None);
    }

    #[test]
    fn differences_over_zero_count_as_similar() {
        assert_eq!(similarities([0.0; 4], [true; 4], 0.0), [1.0; 4]);
        let valid = [true, true, false, true];
        assert_eq!(similarities([1.0, 2.0, 8.0, 4.0], valid, 0.5)[..2], [0.75, 0.5]);
        assert_eq!(similarities([1.0, 2.0, 8.0, 4.0], valid, 4.0), [1.0; 4]);
    }
}
