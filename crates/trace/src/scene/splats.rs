//! Splats as a scene takes them: which are kept, their discs, and their tints (albedo and emitter).
//! Albedo from colours follows one rule for the whole scene, since colours of scans hold the light
//! of the day of the scan.

use crate::accel::disc::{Disc, Tint};
use esker_render::Splat;
use glam::Vec3;

/// Radius of a disc over the drawn radius of its splat, which is the spacing of the points. A
/// closed sphere sampled at random leaks 0.2 % of its rays at this factor, 1 % at 1.2.
pub const RADIUS_FACTOR: f32 = 1.4;
/// Greatest coordinate and radius that are kept: their squares stay finite in `f32`.
pub(crate) const COORDINATE_MAX: f32 = 1e15;
/// Luminance that the 95th percentile of the splats is scaled to by [`Albedo::Rgb`].
const ALBEDO_BRIGHT: f32 = 0.8;
/// Range of the albedo made of colours: white surfaces absorb some light, black ones not all.
const ALBEDO_RANGE: [f32; 2] = [0.02, 0.9];

/// Splats that the percentile of luminance is taken of: it is within 0.2 % then.
pub(crate) const SAMPLES: usize = 1 << 16;
/// Shares of red, green and blue in the luminance of linear light.
pub(crate) const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Splats that emit light.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitter {
    /// Which splats emit.
    pub members: Members,
    /// Emitted radiance, linear light.
    pub radiance: [f32; 3],
}

/// Which splats belong to an [`Emitter`].
#[derive(Clone, Debug, PartialEq)]
pub enum Members {
    /// Those whose centres lie in a box, relative to the origin of the scene.
    Box {
        /// Least corner.
        min: [f32; 3],
        /// Greatest corner.
        max: [f32; 3],
    },
    /// Those of these classes.
    Classes(Vec<u8>),
}

/// How the albedo of splats is made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Albedo {
    /// Of the colours: the 95th percentile of luminance is scaled to 0.8, each channel clamped to
    /// 0.02 to 0.9. Colours of scans hold light, which is then counted twice.
    #[default]
    Rgb,
    /// The same for all splats.
    Plain([f32; 3]),
    /// The colours as they are, clamped to 0 to 1.
    AsIs,
}

/// Splats of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct SplatInput<'a> {
    /// The splats. Radii are multiplied by [`RADIUS_FACTOR`].
    pub splats: &'a [Splat],
    /// Class of each splat, for emitters by class.
    pub classes: Option<&'a [u8]>,
    /// How the albedo is made.
    pub albedo: Albedo,
    /// Splats that emit; the first one that a splat belongs to counts.
    pub emitters: &'a [Emitter],
    /// Whether rays from the eye pass through splats whose normal points away from it. It has to be
    /// off for normals that do not distinguish front from back.
    pub cull_back_faces: bool,
}

/// Albedo of a tint.
#[inline(always)]
pub(crate) fn albedo_of(tint: Tint) -> Vec3 {
    Vec3::new(f32::from(tint[0]), f32::from(tint[1]), f32::from(tint[2])) / 65535.0
}

/// Whether a ray can meet a splat: it has an extent, and values that are finite and not beyond
/// `COORDINATE_MAX`.
#[inline(always)]
pub(crate) fn is_fine(splat: &Splat) -> bool {
    let [c, n] = [splat.centre, splat.normal].map(Vec3::from_array);
    let radius = splat.radius * RADIUS_FACTOR;
    let is_near = c.abs().cmple(Vec3::splat(COORDINATE_MAX)).all();
    // A sum with a NaN is NaN.
    let [r, g, b] = splat.colour;
    let square = n.length_squared();
    let has_length = square.is_finite() && square >= f32::MIN_POSITIVE || n == Vec3::ZERO;
    let is_number = has_length && !(r + g + b).is_nan();
    is_near && radius > 0.0 && radius <= COORDINATE_MAX && is_number
}

/// The disc of a splat that [`is_fine`].
#[inline(always)]
pub(crate) fn disc_of(splat: &Splat, tint: Tint) -> Disc {
    let normal = Vec3::from_array(splat.normal);
    let square = normal.length_squared();
    let normal = if normal == Vec3::ZERO { normal } else { normal / square.sqrt() };
    let radius = splat.radius * RADIUS_FACTOR;
    Disc { centre: Vec3::from_array(splat.centre), normal, radius, tint }
}

impl Albedo {
    /// Factor and range that colours are made to albedo with, from the luminances of some splats.
    pub(crate) fn rule(self, luminances: impl Iterator<Item = f32>) -> (f32, [f32; 2]) {
        if self != Self::Rgb {
            return (1.0, [0.0, 1.0]);
        }
        let mut bright: Vec<f32> = luminances.filter(|l| !l.is_nan()).collect();
        if bright.is_empty() {
            return (1.0, ALBEDO_RANGE);
        }
        let at = (bright.len() - 1) * 95 / 100;
        let percentile = *bright.select_nth_unstable_by(at, f32::total_cmp).1;
        let is_fine = percentile > 0.0 && percentile.is_finite();
        (if is_fine { ALBEDO_BRIGHT / percentile } else { 1.0 }, ALBEDO_RANGE)
    }
}

impl SplatInput<'_> {
    /// Factor and range that colours are made to albedo with.
    pub(crate) fn albedo_rule(&self) -> (f32, [f32; 2]) {
        let step = self.splats.len() / SAMPLES + 1;
        self.albedo.rule(self.splats.iter().step_by(step).map(|s| luminance(s.colour)))
    }

    /// Tint of splat `index`, by the rule of the scene.
    pub(crate) fn tint(&self, index: usize, (factor, [least, most]): (f32, [f32; 2])) -> Tint {
        let splat = &self.splats[index];
        let colour = if let Albedo::Plain(plain) = self.albedo { plain } else { splat.colour };
        let unit = |c: f32| ((c * factor).max(least).min(most) * 65535.0 + 0.5) as i32 as u16;
        let [r, g, b] = [unit(colour[0]), unit(colour[1]), unit(colour[2])];
        if self.emitters.is_empty() {
            return [r, g, b, 0];
        }
        let class = self.classes.and_then(|c| c.get(index)).copied();
        let emitter = self.emitters.iter().position(|e| e.members.have(splat, class));
        [r, g, b, emitter.map_or(0, |e| (e + 1).min(usize::from(u16::MAX)) as u16)]
    }
}

impl Members {
    /// Whether a splat of `class` belongs to these.
    fn have(&self, splat: &Splat, class: Option<u8>) -> bool {
        match self {
            Self::Box { min, max } => (0..3).all(|k| (min[k]..=max[k]).contains(&splat.centre[k])),
            Self::Classes(classes) => class.is_some_and(|c| classes.contains(&c)),
        }
    }
}

/// Luminance of a colour of linear light.
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b
}
