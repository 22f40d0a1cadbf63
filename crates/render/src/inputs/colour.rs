//! Colours of points: their sources ([`ColourBy`]), maps from values to colours, and conversion
//! between sRGB bytes and linear light. Averages and lighting are computed in linear light; bytes
//! are sRGB on both ends.

use crate::simd::values::{Values, WHOLE};
use fearless_simd::{Bytes, Simd, f32x8, u32x8};
use glam::Vec3;
use std::sync::LazyLock;

/// Source of the colours of points.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[allow(clippy::large_enum_variant, reason = "there is one a frame")]
pub enum ColourBy {
    /// One colour for all points.
    #[default]
    Plain,
    /// The colour plane.
    Rgb,
    /// The scalar plane, mapped to colours.
    Scalar(ColourMap),
    /// The scalar plane, whose values are numbers below 256 with a colour each.
    Codes(Codebook),
    /// World coordinate along an axis (0 for x, 1 for y, 2 for z), mapped to colours.
    Coordinate(usize, ColourMap),
    /// Eye depth, mapped to colours.
    EyeDepth(ColourMap),
    /// Size of the cell of the node, one hue a size: shows the levels of detail.
    Cell,
    /// The world normal, with x, y, z as red, green, blue.
    Normal,
}

impl ColourBy {
    /// Number of the source in shaders.
    pub const fn number(&self) -> u32 {
        match self {
            Self::Plain => 0,
            Self::Rgb => 1,
            Self::Scalar(_) | Self::Codes(_) => 2,
            Self::Coordinate(0, _) => 3,
            Self::Coordinate(1, _) => 4,
            Self::Coordinate(..) => 5,
            Self::EyeDepth(_) => 6,
            Self::Cell => 7,
            Self::Normal => 8,
        }
    }

    /// Whether the colour plane is read.
    pub fn reads_plane(&self) -> bool {
        matches!(self, Self::Rgb | Self::Scalar(_) | Self::Codes(_))
    }

    /// Whether colours stand for names, so that a mixture of two colours means nothing.
    pub fn names(&self) -> bool {
        matches!(self, Self::Codes(Codebook::Classes | Codebook::Labels) | Self::Cell)
    }
}

/// Colours of numbers below 256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "there is one a frame")]
pub enum Codebook {
    /// ASPRS classes.
    Classes,
    /// Labels, one hue each.
    Labels,
    /// A palette from 0 to 254 ([`esker_points::codes`]); 255 stands for NaN.
    Along(Gradient),
    /// These colours (sRGB), for files that number the colours of their points.
    Own([[u8; 3]; 256]),
}

impl Codebook {
    /// Colour of each number, linear light.
    pub fn colours(self) -> [Vec3; 256] {
        match self {
            Self::Classes => std::array::from_fn(|class| class_colour(class as u8)),
            Self::Own(colours) => colours.map(linear),
            Self::Labels => std::array::from_fn(|label| hue(label as u32)),
            Self::Along(gradient) => {
                let high = f64::from(esker_points::codes::LAST);
                let table = MapTable::new(&ColourMap { low: 0.0, high, gradient });
                std::array::from_fn(|code| match code as u8 {
                    esker_points::codes::NO_NUMBER => table.colours[MapTable::NO_NUMBER],
                    code => table.at(f64::from(code)),
                })
            }
        }
    }
}

/// A map from a range of values to colours. Values are as stored; if a schema scales an attribute,
/// the caller scales the range back. Values outside the range have the colour of the nearer end;
/// NaN is grey.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColourMap {
    /// Value of the first colour.
    pub low: f64,
    /// Value of the last colour.
    pub high: f64,
    /// The colours.
    pub gradient: Gradient,
}

/// A sequence of colours to map values to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Gradient {
    /// Perceptually uniform, from dark blue over green to yellow; suitable for colour-blind viewers
    /// (`smith2015`).
    #[default]
    Viridis,
    /// Black to white.
    Grey,
    /// Green lowlands over ochre to white peaks, for elevations.
    Terrain,
    /// Rainbow of even lightness steps, in which small differences are seen (`mikhailov2019`).
    Turbo,
    /// Perceptually uniform, from black over purple to pale yellow (`smith2015`).
    Magma,
    /// Perceptually uniform, from blue over red to yellow (`smith2015`).
    Plasma,
    /// Perceptually uniform, from blue to yellow; the same to colour-blind viewers (`nunez2018`).
    Cividis,
    /// Blue over grey to red, for values around a middle (`moreland2009`).
    CoolWarm,
}

impl Gradient {
    /// All gradients, in the order of lists.
    pub const ALL: [Self; 8] = [
        Self::Viridis,
        Self::Turbo,
        Self::Grey,
        Self::Terrain,
        Self::Magma,
        Self::Plasma,
        Self::Cividis,
        Self::CoolWarm,
    ];

    /// The gradient of this name, in any case.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|gradient| gradient.name().eq_ignore_ascii_case(name))
    }

    /// Its colours at even distances, sRGB.
    fn stops(self) -> &'static [[u8; 3]] {
        match self {
            Self::Viridis => &VIRIDIS,
            Self::Grey => &GREY,
            Self::Terrain => &TERRAIN,
            Self::Turbo => &TURBO,
            Self::Magma => &MAGMA,
            Self::Plasma => &PLASMA,
            Self::Cividis => &CIVIDIS,
            Self::CoolWarm => &COOL_WARM,
        }
    }

    /// Name of the gradient.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viridis => "viridis",
            Self::Grey => "grey",
            Self::Terrain => "terrain",
            Self::Turbo => "turbo",
            Self::Magma => "magma",
            Self::Plasma => "plasma",
            Self::Cividis => "cividis",
            Self::CoolWarm => "coolwarm",
        }
    }
}

/// Colour of points without colours (sRGB): a warm clay.
pub const PLAIN: [u8; 3] = [204, 196, 184];
/// Colour of NaN.
const NO_NUMBER: [u8; 3] = [128, 128, 128];

/// Colours of each palette at even distances, sRGB; colours in between are interpolated in linear
/// light. Viridis: `smith2015`.
const VIRIDIS: [[u8; 3]; 11] = [
    [68, 1, 84],
    [72, 36, 117],
    [65, 68, 135],
    [53, 95, 141],
    [42, 120, 142],
    [33, 145, 140],
    [34, 168, 132],
    [68, 191, 112],
    [122, 209, 81],
    [189, 223, 38],
    [253, 231, 37],
];
const GREY: [[u8; 3]; 2] = [[16, 16, 16], [255, 255, 255]];
const TERRAIN: [[u8; 3]; 6] = [
    [44, 92, 70],
    [93, 140, 80],
    [170, 172, 98],
    [196, 160, 104],
    [168, 134, 118],
    [246, 244, 240],
];
/// Turbo: `mikhailov2019`.
const TURBO: [[u8; 3]; 17] = [
    [48, 18, 59],
    [64, 64, 162],
    [70, 107, 227],
    [66, 148, 255],
    [40, 188, 235],
    [24, 221, 194],
    [50, 242, 152],
    [109, 254, 98],
    [164, 252, 60],
    [205, 236, 52],
    [238, 207, 58],
    [253, 172, 52],
    [251, 126, 33],
    [235, 80, 14],
    [208, 47, 5],
    [169, 22, 1],
    [122, 4, 3],
];
/// Magma and plasma: `smith2015`.
const MAGMA: [[u8; 3]; 11] = [
    [0, 0, 4],
    [20, 14, 54],
    [59, 15, 112],
    [100, 26, 128],
    [140, 41, 129],
    [183, 55, 121],
    [222, 73, 104],
    [247, 112, 92],
    [254, 159, 109],
    [254, 207, 146],
    [252, 253, 191],
];
/// As [`MAGMA`].
const PLASMA: [[u8; 3]; 11] = [
    [13, 8, 135],
    [65, 4, 157],
    [106, 0, 168],
    [143, 13, 164],
    [177, 42, 144],
    [204, 71, 120],
    [225, 100, 98],
    [242, 132, 75],
    [252, 166, 54],
    [252, 206, 37],
    [240, 249, 33],
];
/// Cividis: `nunez2018`.
const CIVIDIS: [[u8; 3]; 11] = [
    [0, 34, 78],
    [8, 51, 112],
    [53, 69, 108],
    [79, 87, 108],
    [102, 105, 112],
    [125, 124, 120],
    [148, 142, 119],
    [174, 163, 113],
    [200, 184, 102],
    [229, 207, 82],
    [254, 232, 56],
];
/// Blue over grey to red: `moreland2009`.
const COOL_WARM: [[u8; 3]; 11] = [
    [59, 76, 192],
    [89, 119, 227],
    [123, 159, 249],
    [158, 190, 255],
    [192, 212, 245],
    [221, 220, 220],
    [242, 203, 183],
    [247, 172, 142],
    [238, 132, 104],
    [214, 82, 68],
    [180, 4, 38],
];

/// Colours of the ASPRS classes 0 to 22 (`asprs2019`, table 17), sRGB.
const CLASSES: [[u8; 3]; 23] = [
    [150, 150, 150], // never classified
    [190, 190, 190], // unclassified
    [168, 124, 82],  // ground
    [178, 214, 130], // low vegetation
    [104, 178, 82],  // medium vegetation
    [40, 126, 58],   // high vegetation
    [214, 92, 72],   // building
    [232, 64, 196],  // low point, noise
    [244, 214, 92],  // model key point
    [66, 134, 222],  // water
    [126, 96, 160],  // rail
    [110, 116, 124], // road
    [206, 180, 150], // overlap
    [240, 170, 60],  // wire, guard
    [250, 206, 90],  // wire, conductor
    [150, 90, 50],   // transmission tower
    [226, 140, 120], // wire connector
    [132, 160, 190], // bridge deck
    [250, 60, 60],   // high noise
    [176, 132, 196], // overhead structure
    [140, 110, 84],  // ignored ground
    [236, 244, 250], // snow
    [96, 96, 96],    // temporal exclusion
];

/// Entries of the table from linear light to sRGB: enough that dark colours are at most one byte
/// off.
pub(crate) const ENCODE_ENTRIES: usize = 1 << 13;

static TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f64 / 255.0;
        (if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }) as f32
    })
});

/// Bytes of the entries and of full light.
type Table = [u8; ENCODE_ENTRIES + 1];

static TO_SRGB: LazyLock<Box<Table>> = LazyLock::new(|| {
    let mut table = Box::new([255; ENCODE_ENTRIES + 1]);
    for (i, byte) in table.iter_mut().enumerate().take(ENCODE_ENTRIES) {
        let c = i as f64 / ENCODE_ENTRIES as f64;
        let s = if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
        *byte = (s * 255.0).round() as u8;
    }
    table
});

/// Converts sRGB bytes to linear light.
#[inline]
pub fn linear(srgb: [u8; 3]) -> Vec3 {
    let table = &*TO_LINEAR;
    Vec3::from_array(srgb.map(|c| table[usize::from(c)]))
}

/// Converts linear light to sRGB bytes, clamped; NaN becomes black.
#[derive(Clone, Copy, Debug)]
pub struct Encoder(&'static Table);

impl Encoder {
    /// The encoder; its table is computed at the first call.
    pub fn get() -> Self {
        Self(&TO_SRGB)
    }

    /// sRGB bytes of a colour.
    #[inline]
    pub fn bytes(self, c: Vec3) -> [u8; 3] {
        // `as` saturates and turns NaN into zero.
        c.to_array()
            .map(|c| self.0[((c * ENCODE_ENTRIES as f32 + 0.5) as usize).min(ENCODE_ENTRIES)])
    }
}

/// Coefficients of sRGB beyond its linear segment in powers of the fourth root of light, lowest
/// first; exact to a hundredth of a byte.
const CURVE: [f32; 5] = [-16.475_954, 50.014_74, 286.283_55, -85.552_58, 20.739_016];
/// Slope of the linear segment of sRGB, bytes, and its end.
const STRAIGHT: f32 = 12.92 * 255.0;
const STRAIGHT_END: f32 = 0.003_130_8;

/// Converts eight colours from linear light to opaque sRGB words, red in the lowest byte; clamped,
/// and NaN becomes black.
#[inline(always)]
pub(crate) fn words<S: Simd>([r, g, b]: [f32x8<S>; 3]) -> u32x8<S> {
    (bytes(r) | bytes(g) << 8) | (bytes(b) << 16 | 0xff00_0000)
}

/// sRGB bytes of light in the lowest bits of words, whose highest byte is undefined; the other bits
/// are zero.
#[inline(always)]
fn bytes<S: Simd>(light: f32x8<S>) -> u32x8<S> {
    let light = Values::min(Values::max(light, light.like(0.0)), light.like(1.0));
    let x = light.sqrt().sqrt();
    let [a, b, c, d, e] = CURVE.map(|power| x.like(power));
    let curve = Values::mul_add(
        x,
        Values::mul_add(x, Values::mul_add(x, Values::mul_add(x, e, d), c), b),
        a,
    );
    let is_curved = light.like(STRAIGHT_END).cmplt(light);
    let byte = f32x8::select(is_curved, curve, light * STRAIGHT);
    (byte + WHOLE).bitcast()
}

/// Table of a colour map, linear light.
#[derive(Clone, Debug)]
pub struct MapTable {
    low: f64,
    per_unit: f64,
    /// Colours of the palette, then the colour of NaN.
    colours: Vec<Vec3>,
}

impl MapTable {
    const ENTRIES: usize = 256;
    /// Entry of NaN.
    pub(crate) const NO_NUMBER: usize = Self::ENTRIES;

    /// Computes the table of a map.
    pub fn new(map: &ColourMap) -> Self {
        let stops = map.gradient.stops();
        let last = Self::ENTRIES - 1;
        let gradient = (0..=last).map(|i| {
            let at = i as f32 / last as f32 * (stops.len() - 1) as f32;
            let k = (at as usize).min(stops.len() - 2);
            linear(stops[k]).lerp(linear(stops[k + 1]), at - k as f32)
        });
        let colours = gradient.chain([linear(NO_NUMBER)]).collect();
        // An empty range maps to its first colour.
        let per_unit = last as f64 / (map.high - map.low);
        let per_unit = if per_unit.is_finite() { per_unit } else { 0.0 };
        Self { low: map.low, per_unit, colours }
    }

    /// Colour of a value, linear light.
    #[inline]
    pub fn at(&self, value: f64) -> Vec3 {
        self.colours[self.entry(value)]
    }

    /// Entry of a value.
    #[inline]
    pub(crate) fn entry(&self, value: f64) -> usize {
        let i = (value - self.low) * self.per_unit + 0.5;
        if i.is_nan() {
            return Self::NO_NUMBER;
        }
        (i.max(0.0) as usize).min(Self::ENTRIES - 1)
    }

    /// Colours of the entries.
    pub(crate) fn colours(&self) -> &[Vec3] {
        &self.colours
    }
}

/// Colour of an ASPRS class, linear light. Classes above 22 have a hue each.
pub fn class_colour(class: u8) -> Vec3 {
    match CLASSES.get(usize::from(class)) {
        Some(&c) => linear(c),
        None => hue(u32::from(class)),
    }
}

/// Hue of a small number, linear light: golden-angle steps around the colour wheel keep
/// neighbouring numbers distinct.
pub fn hue(number: u32) -> Vec3 {
    let turn = (number as f32 * 0.618_034).fract() * std::f32::consts::TAU;
    let wave = |shift: f32| 0.5 + 0.38 * (turn + shift).cos();
    Vec3::new(wave(0.0), wave(-2.094_395), wave(2.094_395)).powf(1.6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::values::{EIGHT, load};
    use fearless_simd::{Level, dispatch};

    #[test]
    fn bytes_survive_linear_light() {
        for c in 0..=255u8 {
            let [back, ..] = Encoder::get().bytes(linear([c; 3]));
            assert!(back.abs_diff(c) <= 1, "{c} came back as {back}");
        }
        assert_eq!(Encoder::get().bytes(Vec3::new(f32::NAN, 9.0, -3.0)), [0, 255, 0]);
    }

    #[test]
    fn words_are_the_nearest_bytes() {
        let curve = |c: f64| match c {
            c if c <= 0.003_130_8 => 12.92 * 255.0 * c,
            c => 255.0 * (1.055 * c.powf(1.0 / 2.4) - 0.055),
        };
        let words_of = |light: [f32; EIGHT]| {
            let words = dispatch!(Level::new(), simd => {
                let light = load(simd, &light);
                <[u32; EIGHT]>::from(words([light, light * 0.5, light * 0.0]))
            });
            words.map(u32::to_le_bytes)
        };
        for step in 0..=10_000 {
            let light = step as f32 * 1e-4;
            let [r, g, b, a] = words_of([light; EIGHT])[step % EIGHT];
            assert!((f64::from(r) - curve(f64::from(light))).abs() < 0.51);
            assert!((f64::from(g) - curve(f64::from(light * 0.5))).abs() < 0.51);
            assert_eq!([b, a], [0, 255]);
        }
        let any = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 9.0, -3.0, 1.0, 0.0, -0.0];
        assert_eq!(words_of(any).map(|[r, ..]| r), [0, 255, 0, 255, 0, 255, 0, 0]);
        for c in 0..=255u8 {
            assert_eq!(words_of([linear([c; 3]).x; EIGHT])[0][0], c);
        }
    }

    #[test]
    fn maps_take_any_value_and_any_range() {
        let values = [0.0, -1e300, 1e300, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 0.5];
        for low in values {
            for high in values {
                let table = MapTable::new(&ColourMap { low, high, gradient: Gradient::Viridis });
                for v in values {
                    assert!(table.at(v).is_finite());
                }
            }
        }
    }

    #[test]
    fn gradients_have_names_and_neighbouring_stops_differ() {
        for gradient in Gradient::ALL {
            assert_eq!(Gradient::of_name(gradient.name()), Some(gradient));
            let stops = gradient.stops();
            assert!(stops.len() >= 2 && stops.windows(2).all(|pair| pair[0] != pair[1]));
        }
        assert_eq!(Gradient::of_name("rainbow"), None);
    }

    #[test]
    fn the_ends_of_a_map_are_the_ends_of_its_palette() {
        let map = ColourMap { low: 10.0, high: 20.0, gradient: Gradient::Viridis };
        let table = MapTable::new(&map);
        assert_eq!(Encoder::get().bytes(table.at(10.0)), VIRIDIS[0]);
        assert_eq!(Encoder::get().bytes(table.at(25.0)), VIRIDIS[10]);
        assert_eq!(Encoder::get().bytes(table.at(15.0)), VIRIDIS[5]);
    }
}
