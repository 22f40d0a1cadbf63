//! Colour tables of the shaders (`shaders/common/colour.wgsl`): a colour map becomes runs of
//! doubles, each of one colour, whose ends are found by evaluating the map itself. So CPU and GPU
//! agree on every value, though shaders have no `f64`. Also the table from linear light to sRGB
//! bytes.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::same_values;
use crate::gpu::device::{Counted, Gpu};
use crate::inputs::colour::{
    ColourBy, ColourMap, ENCODE_ENTRIES, Encoder, Gradient, MapTable, hue,
};
use esker_points::Lattice;
use glam::Vec3;

/// Any colour map; the number of a [`ColourBy`] does not depend on it.
const MAP: ColourMap = ColourMap { low: 0.0, high: 1.0, gradient: Gradient::Grey };

same_values!(common_encode == crate::inputs::colour { ENCODE_STEPS = ENCODE_ENTRIES });
same_values!(common_colour == crate::inputs::colour {
    BY_PLAIN = ColourBy::Plain.number(),
    BY_RGB = ColourBy::Rgb.number(),
    BY_VALUE = ColourBy::Scalar(MAP).number(),
    BY_X = ColourBy::Coordinate(0, MAP).number(),
    BY_Y = ColourBy::Coordinate(1, MAP).number(),
    BY_Z = ColourBy::Coordinate(2, MAP).number(),
    BY_EYE_DEPTH = ColourBy::EyeDepth(MAP).number(),
    BY_CELL = ColourBy::Cell.number(),
    BY_NORMAL = ColourBy::Normal.number(),
});

/// Number of runs at most.
pub const RUNS_MAX: usize = 256;

/// All doubles but NaN, in runs of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourRuns {
    /// First value of each run, as [`ordered`] bits, and its colour. The first run begins at
    /// negative infinity.
    pub runs: Vec<(u64, Vec3)>,
    /// Colour of NaN.
    pub no_number: Vec3,
}

impl ColourRuns {
    /// Runs of the values that a frame maps to colours; `None` if it maps none.
    pub fn of(by: &ColourBy, lattice: &Lattice) -> Option<Self> {
        match by {
            ColourBy::Scalar(map) | ColourBy::EyeDepth(map) => {
                let table = MapTable::new(map);
                Some(Self::found(|v| table.entry(v), map.low, table.colours(), MapTable::NO_NUMBER))
            }
            ColourBy::Coordinate(axis, map) => {
                let (table, axis) = (MapTable::new(map), (*axis).min(2));
                let entry = |steps| table.entry(lattice.world_axis(axis, steps));
                let low = lattice.steps_axis(axis, map.low);
                Some(Self::found(entry, low, table.colours(), MapTable::NO_NUMBER))
            }
            ColourBy::Codes(book) => {
                Some(Self::found(|v| usize::from(v as u8), 0.0, &book.colours(), 0))
            }
            ColourBy::Cell => {
                let hues = std::array::from_fn::<_, 256, _>(|log2| hue(log2 as u32));
                Some(Self::found(|v| usize::from(v as u8), 0.0, &hues, 0))
            }
            ColourBy::Plain | ColourBy::Rgb | ColourBy::Normal => None,
        }
    }

    /// Finds the ends of runs by bisection between values with different entries. Entries are
    /// monotonic, except at `low` in a map without extent, hence `low` is one of the ends.
    fn found(entry: impl Fn(f64) -> usize, low: f64, colours: &[Vec3], no_number: usize) -> Self {
        let first = ordered(f64::NEG_INFINITY);
        let mut ends = [first, ordered(-f64::MAX), ordered(low), ordered(f64::MAX)].to_vec();
        ends.push(ordered(f64::INFINITY));
        ends.retain(|&bits| !value_of(bits).is_nan());
        ends.sort_unstable();
        let at = |bits| entry(value_of(bits));
        let mut runs = vec![(first, colours[at(first)])];
        for pair in ends.windows(2) {
            let (mut from, to) = (pair[0], pair[1]);
            while at(from) != at(to) && runs.len() < RUNS_MAX {
                // Bisects to the first value with another entry than `from`.
                let (mut same, mut other) = (from, to);
                while other - same > 1 {
                    let middle = same + (other - same) / 2;
                    if at(middle) == at(from) { same = middle } else { other = middle }
                }
                runs.push((other, colours[at(other)]));
                from = other;
            }
        }
        Self { runs, no_number: colours[no_number] }
    }
}

/// Bits of a double, mapped so that they compare as unsigned numbers like the doubles.
pub fn ordered(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

fn value_of(ordered: u64) -> f64 {
    f64::from_bits(if ordered >> 63 == 1 { ordered & !(1 << 63) } else { !ordered })
}

/// Creates the uniform `EncodeTable` of `shaders/common/encode.wgsl`.
///
/// # Errors
/// If memory is refused.
pub fn encode_table(gpu: &Gpu) -> Result<Counted, GpuError> {
    let mut bytes: Vec<u8> = (0..=ENCODE_ENTRIES)
        .map(|i| Encoder::get().bytes(Vec3::splat(i as f32 / ENCODE_ENTRIES as f32))[0])
        .collect();
    bytes.resize(crate::gpu::device::shader::sources::layout::EncodeTable::SIZE, 0);
    let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
    let buffer = gpu.buffer("encode table", bytes.len() as u64, usage)?;
    gpu.queue.write_buffer(&buffer, 0, &bytes);
    Ok(buffer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::colour::Codebook;

    fn looked_up(runs: &ColourRuns, value: f64) -> Vec3 {
        if value.is_nan() {
            return runs.no_number;
        }
        let bits = ordered(value);
        runs.runs[runs.runs.partition_point(|r| r.0 <= bits) - 1].1
    }

    #[test]
    fn runs_colour_every_value_as_the_map_does() {
        let extremes = [0.0, -0.0, -1e300, 1e300, f64::MAX, f64::MIN_POSITIVE, f64::NAN];
        let infinities = [f64::INFINITY, f64::NEG_INFINITY, 3e8, 3e8 + 7.0, 5e-324, 0.5];
        let values: Vec<f64> = extremes.into_iter().chain(infinities).collect();
        let (scale, offset) = ([1e-3, 0.01, 2.5e-4], [10.0, -7.0, 0.5]);
        let lattice = Lattice { scale, offset, shift: [5; 3], ..Lattice::default() };
        for &low in &values {
            for &high in &values {
                let map = ColourMap { low, high, gradient: Gradient::Viridis };
                let table = MapTable::new(&map);
                let runs = ColourRuns::of(&ColourBy::Scalar(map), &lattice).unwrap();
                let along = [0, 1, 2].map(|axis| {
                    ColourRuns::of(&ColourBy::Coordinate(axis, map), &lattice).unwrap()
                });
                let found = [&runs].into_iter().chain(&along);
                assert!(found.into_iter().all(|runs| runs.runs.len() <= RUNS_MAX));
                assert!(runs.runs.is_sorted_by(|a, b| a.0 < b.0));
                let between = (0..200).map(|i| low + (high - low) * (f64::from(i) / 199.0));
                for v in between.chain(values.iter().copied()) {
                    assert_eq!(looked_up(&runs, v), table.at(v), "{v} in {map:?}");
                    for (axis, runs) in along.iter().enumerate() {
                        let at = lattice.world_axis(axis, v);
                        assert_eq!(looked_up(runs, v), table.at(at), "{v} steps in {map:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn runs_colour_every_code() {
        let lattice =
            Lattice { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let own = Codebook::Own(std::array::from_fn(|i| [i as u8, (i * 7) as u8, 0]));
        let along = Codebook::Along(Gradient::Viridis);
        for book in [Codebook::Classes, Codebook::Labels, along, own] {
            let (runs, colours) =
                (ColourRuns::of(&ColourBy::Codes(book), &lattice).unwrap(), book.colours());
            for v in [-3.0, -0.0, 0.0, 0.9, 2.0, 17.5, 22.0, 254.0, 255.0, 300.0, f64::NAN] {
                assert_eq!(looked_up(&runs, v), colours[usize::from(v as u8)], "{v} of {book:?}");
            }
        }
    }
}
