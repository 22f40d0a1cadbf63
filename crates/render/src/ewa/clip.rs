//! Clip lines in the picture (`zwicker2004`, section 5). The paper projects two points of a line
//! and normalises them; here a line stays homogeneous, the plane through the line and the eye, so
//! its points may lie behind the camera. With `c` a point of the line relative to the eye and `e`
//! its direction, the sign of `(c x e) . ray` is the side on which the ray of a pixel lies. `c` and
//! `e` depend on the lattice and the eye only, and for the two splats of a pair the numbers differ
//! by their sign, so every pixel along the line belongs to exactly one of them.

use crate::ewa::splat::Box4;
use crate::inputs::camera::Camera;
use crate::simd::values::Values;
use esker_points::clip::{CLIP_BYTES, Clip, ClipLine, Grain};
use glam::{Vec2, Vec3};

/// Clip lines of a splat. The product of a line and the homogeneous pixel (x, y, 1), relative to
/// the centre of the picture, is the distance from the line in pixels, not negative where the splat
/// is kept. The layout is that of the GPU.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines {
    /// The first line.
    pub first: [f32; 3],
    /// How the lines are combined: [`WHOLE`], [`ONE`], [`BOTH`] or [`EITHER`].
    pub kept: f32,
    /// The second line.
    pub second: [f32; 3],
    /// Padding to a multiple of 16 bytes.
    pub unused: f32,
}

/// The splat has no lines.
pub const WHOLE: f32 = 0.0;
/// The first line decides.
pub const ONE: f32 = 1.0;
/// A pixel is kept if both lines keep it.
pub const BOTH: f32 = 2.0;
/// A pixel is kept if one of the lines keeps it.
pub const EITHER: f32 = 3.0;

/// Sine between the plane of a splat and the line of sight below which the centre decides which
/// side of a line is kept.
pub(crate) const FLAT: f32 = 0.1;
/// Factor of the radii of splats with lines. A point on an edge has neighbours on one side only,
/// which would leave notches; the lines cut off what would stick out.
pub const WIDER: f32 = 1.3;

/// Sine between the plane of a splat and the line of sight below which the splat is seen as a
/// stroke, whose low-pass may reach far beyond a line.
pub(crate) const STROKE: f32 = 0.5;
/// Pixels by which a stroke may reach beyond its kept part, for the low-pass.
pub(crate) const PAST: f32 = 1.0;
/// Thickness of a surface along the line of sight at a sharp edge, in pixels at its depth, and its
/// growth per pixel away from the edge. If a face hides another one that it meets at a right angle,
/// that one is at least 2 pixels farther off for each pixel from the edge, and shows as far as the
/// face is thicker.
pub(crate) const EDGE_PX: f32 = 1.0;
/// See [`EDGE_PX`].
pub(crate) const EDGE_GROWTH: f32 = 1.0;

/// Which pixels of a rectangle lie on the kept side of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    All,
    Some,
    None,
}

/// Computes the clip lines of the splats of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Clipping<'a> {
    /// Camera of the frame.
    pub camera: &'a Camera,
    /// Units of stored lines ([`Grain::new`]).
    pub grain: Grain,
}

impl Clipping<'_> {
    /// Clip lines of the point `index`, stored in `plane`. `hot` is its position on the lattice
    /// without the bits that hot positions drop, `centre` its position and `normal` its stored
    /// normal, both right, down and away from the eye.
    #[inline]
    pub fn lines(
        &self,
        plane: &[u8],
        index: usize,
        hot: [u32; 3],
        centre: Vec3,
        normal: Vec3,
    ) -> Option<Lines> {
        let clip = self.clip(plane, index, hot, normal)?;
        let seen = normal.dot(centre);
        // A round surface deviates from its lines, and at a grazing view that deviation dominates.
        // Then the side of the centre is kept, unless the other line may keep it.
        let is_flat = seen.abs() < FLAT * centre.length() && !clip.either;
        let own = is_flat.then_some(centre);
        let [first, second] = clip.lines.map(|line| self.line(&line?, seen, own));
        let first = first?;
        let kept = match (second, clip.either) {
            (None, _) => ONE,
            (Some(_), false) => BOTH,
            (Some(_), true) => EITHER,
        };
        Some(Lines { first, kept, second: second.unwrap_or_default(), unused: 0.0 })
    }

    /// Stored lines of a point; `None` if it has none, like most points.
    #[inline]
    fn clip(&self, plane: &[u8], index: usize, hot: [u32; 3], normal: Vec3) -> Option<Clip> {
        let bytes = plane.get(index * CLIP_BYTES..(index + 1) * CLIP_BYTES)?;
        let words = [0, 4, 8, 12]
            .map(|i| u32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]));
        if words[1] == 0 || normal == Vec3::ZERO {
            return None;
        }
        Some(Clip::of_words(words, hot, self.grain))
    }

    /// Adds a second line to a splat that has one line and is seen as a stroke; see
    /// [`Clipping::lines`]. `a` and `b` are its tangents.
    ///
    /// Most of the width of a stroke comes from the low-pass. A line crosses the stroke at any
    /// angle, so that pixels beside the stroke lie on the kept side far beyond its kept part. The
    /// second line ends the stroke there.
    pub fn ended(
        &self,
        lines: Lines,
        plane: &[u8],
        index: usize,
        hot: [u32; 3],
        [centre, normal, a, b]: [Vec3; 4],
    ) -> Lines {
        let is_stroke = normal.dot(centre).abs() < STROKE * centre.length();
        if lines.kept != ONE || !is_stroke {
            return lines;
        }
        let end = || {
            let line = self.clip(plane, index, hot, normal)?.lines[0]?;
            let [c, e] = self.seen(&line);
            let out = normal.cross(e) * if line.keeps_right { 1.0 } else { -1.0 };
            end([centre, normal, a, b], out, out.dot(c - centre))
        };
        let Some(end) = end() else { return lines };
        let focal = self.camera.focal_px;
        match in_pixels([end.x / focal, end.y / focal, end.z]) {
            Some([x, y, z]) => Lines { second: [x, y, z + PAST], kept: BOTH, ..lines },
            None => lines,
        }
    }

    /// A point of a line and its direction: right, down and away from the eye.
    #[inline]
    fn seen(&self, line: &ClipLine) -> [Vec3; 2] {
        let camera = self.camera;
        let [right, up, back] = camera.view_from_world;
        let view = |v: Vec3| Vec3::new(right.dot(v), -up.dot(v), -back.dot(v));
        let way = Vec3::from_array(line.along.map(|a| a as f32));
        let line = [camera.steps_from_anchor(line.from), way].map(|v| view(v * camera.step));
        camera.seen_line(line)
    }

    /// A line in homogeneous pixels; `None` if it is not finite or the eye lies on it. `seen` is
    /// the product of normal and centre; `own` is a point whose side is kept, else the normal
    /// decides.
    #[inline]
    fn line(&self, line: &ClipLine, seen: f32, own: Option<Vec3>) -> Option<[f32; 3]> {
        let [c, e] = self.seen(line);
        let plane = c.cross(e);
        // The splat lies left of the direction, seen from the side of its normal.
        let is_other = match own {
            Some(centre) => plane.dot(centre) < 0.0,
            None => (seen < 0.0) != line.keeps_right,
        };
        let sign = if is_other { -1.0 } else { 1.0 };
        let inverse = 1.0 / self.camera.focal_px;
        in_pixels([plane.x * inverse, plane.y * inverse, plane.z].map(|p| p * sign))
    }
}

/// Scales a line so that it gives distances in pixels; `None` if it is not finite or no line on the
/// picture.
#[inline]
fn in_pixels(line: [f32; 3]) -> Option<[f32; 3]> {
    let inverse = 1.0 / (line[0] * line[0] + line[1] * line[1]).sqrt();
    let line = line.map(|p| p * inverse);
    line.iter().all(|p| p.is_finite()).then_some(line)
}

/// End of the kept part of a splat that is seen as a stroke: the plane through that end, the eye
/// and the normal, oriented towards the kept part; right, down and away from the eye. The kept part
/// ends at the distance `reach` from the centre along `out`. `None` if the line does not shorten
/// the stroke or the eye is above the splat.
fn end([centre, normal, a, b]: [Vec3; 4], out: Vec3, reach: f32) -> Option<Vec3> {
    // In tangents from the centre the disc is a unit circle, and the ends of the stroke are the
    // points of contact of tangents from the foot of the eye.
    let flat = normal * normal.dot(centre) - centre;
    let eye = Vec2::new(flat.dot(a) / a.length_squared(), flat.dot(b) / b.length_squared());
    let on_disc = Vec2::new(out.dot(a), out.dot(b));
    let (out, reach) = (on_disc / on_disc.length(), reach / on_disc.length());
    let away = eye.length_squared();
    let aside = eye.perp() * (away - 1.0).max(0.0).sqrt();
    let past = [1.0, -1.0].map(|side| out.dot(eye + aside * side) / away - reach);
    let side = if past[0] >= past[1] { 1.0 } else { -1.0 };
    if !(away > 1.0 && past[0].max(past[1]) > 0.0 && reach.abs() < 1.0) {
        return None;
    }
    // The end of the chord that is seen farther to that side.
    let half = out.perp() * (1.0 - reach * reach).sqrt();
    let [p, q] = [out * reach + half, out * reach - half];
    let place = if (q - eye).perp_dot(p - eye) * side < 0.0 { p } else { q };
    let at = centre + a * place.x + b * place.y;
    let hand = if normal.dot(a.cross(b)) < 0.0 { -1.0 } else { 1.0 };
    Some(at.cross(normal) * -side * hand)
}

impl Lines {
    /// Removes lines that are more than `margin_px` away from all pixels within `bounds` that they
    /// keep. `None` if no pixel is kept, `Some(None)` if no line is left.
    #[inline]
    pub fn within(self, bounds: Box4, centre_px: [f32; 2], margin_px: f32) -> Option<Option<Self>> {
        let side = |line| side(line, bounds, centre_px, margin_px);
        let [first, second] = [self.first, self.second].map(side);
        let only = |line| Some(Some(Self { first: line, kept: ONE, ..self }));
        match (self.kept, first, second) {
            (ONE, Side::All, _) => Some(None),
            (ONE, Side::None, _) => None,
            (BOTH, Side::None, _) | (BOTH, _, Side::None) => None,
            (BOTH, Side::All, Side::All) => Some(None),
            (BOTH, Side::All, _) => only(self.second),
            (BOTH, _, Side::All) => only(self.first),
            (EITHER, Side::All, _) | (EITHER, _, Side::All) => Some(None),
            (EITHER, Side::None, Side::None) => None,
            (EITHER, Side::None, _) => only(self.second),
            (EITHER, _, Side::None) => only(self.first),
            _ => Some(Some(self)),
        }
    }

    /// Distances of pixels from the edge of what is kept, in pixels, not negative where the splat
    /// is kept; `x` and `y` are their centres relative to the centre of the picture.
    #[inline(always)]
    pub fn distance<V: Values>(&self, x: V, y: V) -> V {
        let from = |[lx, ly, l]: [f32; 3]| x * lx + (y * ly + l);
        let (a, b) = (from(self.first), from(self.second));
        if self.kept == BOTH {
            a.min(b)
        } else if self.kept == EITHER {
            a.max(b)
        } else {
            a
        }
    }
}

/// The side of a line on which the pixels of a box lie. [`Side::Some`] if rounding could decide
/// otherwise for a pixel, or a kept pixel is within `margin_px` of the line.
#[inline]
fn side(
    [lx, ly, l]: [f32; 3],
    [left, right, top, bottom]: Box4,
    [cx, cy]: [f32; 2],
    margin_px: f32,
) -> Side {
    /// Relative rounding error of the sum of three products.
    const ROUNDING: f32 = 1e-6;
    let [x0, x1] = [left as f32 + 0.5 - cx, right as f32 - 0.5 - cx];
    let [y0, y1] = [top as f32 + 0.5 - cy, bottom as f32 - 0.5 - cy];
    let least = (lx * x0).min(lx * x1) + (ly * y0).min(ly * y1) + l;
    let greatest = (lx * x0).max(lx * x1) + (ly * y0).max(ly * y1) + l;
    let size = lx.abs() * x0.abs().max(x1.abs()) + ly.abs() * y0.abs().max(y1.abs()) + l.abs();
    if least > size * ROUNDING + margin_px {
        Side::All
    } else if greatest < -size * ROUNDING {
        Side::None
    } else {
        Side::Some
    }
}
