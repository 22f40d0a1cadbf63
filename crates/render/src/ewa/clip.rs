//! Clip lines in the picture (zwicker2004, section 5). The paper projects two points of a line and normalises them;
//! here a line stays homogeneous, the plane through it and the eye, so its points may lie behind the camera. A pixel's
//! ray is on the plane's one side or on its other: with `c` a point of the line and `e` its way, against the eye, it is
//! the sign of `(c x e) . ray`. Both depend on the lattice and the eye alone, not on the splat, and numbers only change
//! their sign from one splat of a pair to the other: what the one leaves the other takes, to the pixel.

use crate::inputs::camera::Camera;
use crate::simd::values::Values;
use esker_points::clip::{CLIP_BYTES, Clip, ClipLine, Grain};
use glam::{Vec2, Vec3};

use crate::ewa::splat::Box4;

/// The lines of a splat, each over the homogeneous pixel (x, y, 1) from the picture's middle: not negative where the splat
/// is kept. As large as on the GPU.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines {
    /// The first.
    pub first: [f32; 3],
    /// What is kept: [`WHOLE`], [`ONE`], [`BOTH`] or [`EITHER`].
    pub kept: f32,
    /// The second.
    pub second: [f32; 3],
    /// To a whole multiple of 16 bytes.
    pub unused: f32,
}

/// There is no line.
pub const WHOLE: f32 = 0.0;
/// What the first line keeps.
pub const ONE: f32 = 1.0;
/// What both lines keep.
pub const BOTH: f32 = 2.0;
/// What either line keeps.
pub const EITHER: f32 = 3.0;

/// Sine between a splat's plane and the line of sight under which it is seen flat.
pub(crate) const FLAT: f32 = 0.1;
/// Radii of splats with lines over what they would be without: on an edge there are neighbours on one side only, and lines
/// hold what would stick out.
pub const WIDER: f32 = 1.3;

/// The same sine under which a line may cross a splat so that its low-pass reaches far.
pub(crate) const STROKE: f32 = 0.5;
/// Pixels by which a splat may reach past what is kept of it, for the low-pass.
pub(crate) const PAST: f32 = 1.0;

/// What of a rectangle of pixels lies on a line's kept side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    All,
    Some,
    None,
}

/// What a frame's lines are made with.
#[derive(Clone, Copy, Debug)]
pub struct Clipping<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// As in [`Grain::new`].
    pub grain: Grain,
}

impl Clipping<'_> {
    /// The lines of the point `index` of a plane, which lies at `hot` on the lattice without its dropped bits and at
    /// `centre` against the eye; `normal` as it is stored. Both right, down and away from the eye.
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
        // Round surfaces leave their lines a little; seen flat, that is all that is seen of the way to the line. The
        // centre is on its own side then, unless the other line keeps it.
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

    /// The lines of a point as the file has them; `None` where there are none, as most splats have.
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

    /// The lines of a splat with one line, with a second one where it is seen flat; arguments as in [`Clipping::lines`].
    ///
    /// Seen flat a splat is a stroke, and the low-pass is most of its width. A line crosses it at any angle, so that pixels
    /// beside the stroke are on the kept side far beyond what is kept of the stroke itself. The second line ends it there.
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
        let [x, y, z] = [end.x / focal, end.y / focal, end.z];
        let second = [x, y, z + x.hypot(y) * PAST];
        if !second.iter().all(|p| p.is_finite()) || second == [0.0; 3] {
            return lines;
        }
        Lines { second, kept: BOTH, ..lines }
    }

    /// A point of a line and the way to another one: right, down and away from the eye.
    #[inline]
    fn seen(&self, line: &ClipLine) -> [Vec3; 2] {
        let camera = self.camera;
        let [right, up, back] = camera.view_from_world;
        let view = |v: Vec3| Vec3::new(right.dot(v), -up.dot(v), -back.dot(v));
        let way = Vec3::from_array(line.along.map(|a| a as f32));
        [camera.steps_from_eye(line.from), way].map(|v| view(v * camera.step))
    }

    /// A line over the homogeneous pixel; `None` where it is no number, or the eye lies in it.
    #[inline]
    fn line(&self, line: &ClipLine, seen: f32, own: Option<Vec3>) -> Option<[f32; 3]> {
        let [c, e] = self.seen(line);
        let plane = c.cross(e);
        // The splat's own side: left of the way, as its normal looks at it.
        let is_other = match own {
            Some(centre) => plane.dot(centre) < 0.0,
            None => (seen < 0.0) != line.keeps_right,
        };
        let sign = if is_other { -1.0 } else { 1.0 };
        let inverse = 1.0 / self.camera.focal_px;
        let own = [plane.x * inverse, plane.y * inverse, plane.z].map(|p| p * sign);
        let is_usable = own.iter().all(|p| p.is_finite()) && own != [0.0; 3];
        is_usable.then_some(own)
    }
}

/// Where what a line keeps of a splat ends along the stroke that it is seen as, where the line cuts that short: the plane
/// there through the eye and along the normal, right, down and away from the eye, towards what is kept. Kept is what is as
/// far as `reach` along `out`, from the centre; `None` also where the eye is over the splat.
fn end([centre, normal, a, b]: [Vec3; 4], out: Vec3, reach: f32) -> Option<Vec3> {
    // In the splat's plane, in tangents from its centre: the disc is a unit circle, and from under the eye the ends of the
    // stroke are where rays touch it.
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
    // The end of the line on the disc that is seen farther to that side.
    let half = out.perp() * (1.0 - reach * reach).sqrt();
    let [p, q] = [out * reach + half, out * reach - half];
    let place = if (q - eye).perp_dot(p - eye) * side < 0.0 { p } else { q };
    let at = centre + a * place.x + b * place.y;
    let hand = if normal.dot(a.cross(b)) < 0.0 { -1.0 } else { 1.0 };
    Some(at.cross(normal) * -side * hand)
}

impl Lines {
    /// The same without lines that do not cut the pixels of a box; `None` where nothing of it is kept. `Some(None)` where
    /// all is.
    #[inline]
    pub fn within(self, bounds: Box4, centre_px: [f32; 2]) -> Option<Option<Self>> {
        let [first, second] = [self.first, self.second].map(|line| side(line, bounds, centre_px));
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

    /// Those of some pixels that are kept; `x` and `y` are their middles from the picture's.
    #[inline(always)]
    pub fn keep<V: Values>(&self, x: V, y: V) -> V::Mask {
        let is_kept = |[lx, ly, l]: [f32; 3]| x.like(0.0).cmple(x * lx + (y * ly + l));
        let (a, b) = (is_kept(self.first), is_kept(self.second));
        if self.kept == BOTH {
            a & b
        } else if self.kept == EITHER {
            a | b
        } else {
            a
        }
    }
}

/// On which side of a line the pixels of a box lie. Near the line rounding decides, pixel by pixel.
#[inline]
fn side([lx, ly, l]: [f32; 3], [left, right, top, bottom]: Box4, [cx, cy]: [f32; 2]) -> Side {
    /// Rounding of the sum of three products.
    const ROUNDING: f32 = 1e-6;
    let [x0, x1] = [left as f32 + 0.5 - cx, right as f32 - 0.5 - cx];
    let [y0, y1] = [top as f32 + 0.5 - cy, bottom as f32 - 0.5 - cy];
    let least = (lx * x0).min(lx * x1) + (ly * y0).min(ly * y1) + l;
    let greatest = (lx * x0).max(lx * x1) + (ly * y0).max(ly * y1) + l;
    let size = lx.abs() * x0.abs().max(x1.abs()) + ly.abs() * y0.abs().max(y1.abs()) + l.abs();
    if least > size * ROUNDING {
        Side::All
    } else if greatest < -size * ROUNDING {
        Side::None
    } else {
        Side::Some
    }
}
