//! Encodings of cold planes: raw, constant, or byte by byte: all first bytes of the values, then
//! all second bytes, each run compressed on its own. Values are not stored as differences:
//! neighbours in a node are near in space, not in time. Decoding fills a buffer whose length
//! follows from the node's record, and allocates nothing else.

use crate::bytes::u32_at;
use crate::error::Fault;
use std::cmp::Ordering;
use std::ops::Range;

/// Level of zstd: 9 takes six times as long for 1 % less.
const ZSTD_LEVEL: i32 = 3;
/// Greatest size of a compressed plane, in sixteenths of the raw one: a smaller gain is not worth
/// decoding.
const SIXTEENTHS_MAX: usize = 15;

/// Compression of cold planes; hot planes are never compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Codec {
    /// No compression, except for planes of one value.
    None,
    /// LZ4: fast.
    #[default]
    Fast,
    /// Zstandard: a quarter smaller, twice the time.
    Small,
}

impl Codec {
    /// Name in metadata and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Fast => "fast",
            Self::Small => "small",
        }
    }

    /// The codec of this name; the default for an unknown name.
    pub(crate) fn from_name(name: &str) -> Self {
        let known = [Self::None, Self::Fast, Self::Small];
        known.into_iter().find(|codec| codec.name() == name).unwrap_or_default()
    }
}

/// Encoding of a plane's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// One value a point.
    Raw,
    /// One value for all points.
    Constant,
    /// Runs of bytes as LZ4 blocks.
    Lz4,
    /// Runs of bytes as Zstandard frames.
    Zstd,
    /// An encoding that this version does not know.
    Unknown(u8),
}

impl Encoding {
    /// Number on disk.
    pub fn number(self) -> u8 {
        match self {
            Self::Raw => 0,
            Self::Constant => 1,
            Self::Lz4 => 2,
            Self::Zstd => 3,
            Self::Unknown(number) => number,
        }
    }

    /// The encoding of this number.
    pub fn from_number(number: u8) -> Self {
        match number {
            0 => Self::Raw,
            1 => Self::Constant,
            2 => Self::Lz4,
            3 => Self::Zstd,
            other => Self::Unknown(other),
        }
    }
}

/// Buffers that are reused for each plane.
#[derive(Default)]
pub(crate) struct Scratch {
    run: Vec<u8>,
    packed: Vec<u8>,
}

/// Encodes the values in `out` from `start` on, in place.
pub(crate) fn encode(
    codec: Codec,
    value_bytes: usize,
    out: &mut Vec<u8>,
    start: usize,
    scratch: &mut Scratch,
) -> Encoding {
    if is_constant(&out[start..], value_bytes) {
        out.truncate(start + value_bytes);
        return Encoding::Constant;
    }
    let encoding = match codec {
        Codec::None => return Encoding::Raw,
        Codec::Fast => Encoding::Lz4,
        Codec::Small => Encoding::Zstd,
    };
    let values = &out[start..];
    let limit = values.len() / 16 * SIXTEENTHS_MAX;
    scratch.packed.clear();
    scratch.packed.resize(4 * value_bytes, 0);
    for byte in 0..value_bytes {
        let before = scratch.packed.len();
        gather(values, value_bytes, byte, &mut scratch.run);
        push_run(encoding, &scratch.run, &mut scratch.packed);
        let length = (scratch.packed.len() - before) as u32;
        scratch.packed[4 * byte..][..4].copy_from_slice(&length.to_le_bytes());
        if scratch.packed.len() > limit {
            return Encoding::Raw;
        }
    }
    out.truncate(start);
    out.extend_from_slice(&scratch.packed);
    encoding
}

/// Whether there are several values, all equal.
pub(crate) fn is_constant(values: &[u8], size: usize) -> bool {
    values.len() > size && values[size..] == values[..values.len() - size]
}

/// Appends a run, compressed, or raw if that is not longer.
fn push_run(encoding: Encoding, run: &[u8], packed: &mut Vec<u8>) {
    let start = packed.len();
    let room = match encoding {
        Encoding::Zstd => zstd::zstd_safe::compress_bound(run.len()),
        _ => lz4_flex::block::get_maximum_output_size(run.len()),
    };
    packed.resize(start + room, 0);
    let length = match encoding {
        Encoding::Zstd => {
            zstd::bulk::compress_to_buffer(run, &mut packed[start..], ZSTD_LEVEL).ok()
        }
        _ => lz4_flex::block::compress_into(run, &mut packed[start..]).ok(),
    };
    match length.filter(|&length| length < run.len()) {
        Some(length) => packed.truncate(start + length),
        None => {
            packed.truncate(start);
            packed.extend_from_slice(run);
        }
    }
}

/// Collects byte number `byte` of all values.
fn gather(values: &[u8], value_bytes: usize, byte: usize, run: &mut Vec<u8>) {
    fn strided<const N: usize>(values: &[u8], byte: usize, run: &mut Vec<u8>) {
        run.extend(values.as_chunks::<N>().0.iter().map(|value| value[byte]));
    }
    run.clear();
    match value_bytes {
        1 => run.extend_from_slice(values),
        2 => strided::<2>(values, byte, run),
        3 => strided::<3>(values, byte, run),
        4 => strided::<4>(values, byte, run),
        8 => strided::<8>(values, byte, run),
        _ => run.extend(values.chunks_exact(value_bytes).map(|value| value[byte])),
    }
}

/// Decodes the values of a plane of `points` points. `stored` has the length that the encoding
/// requires, which the directory's reader checks.
pub(crate) fn decode(
    encoding: Encoding,
    stored: &[u8],
    value_bytes: usize,
    points: usize,
) -> Result<Vec<u8>, Fault> {
    match encoding {
        Encoding::Raw => Ok(stored.to_vec()),
        Encoding::Constant => Ok(stored.repeat(points)),
        Encoding::Lz4 | Encoding::Zstd => decode_runs(encoding, stored, value_bytes, points)
            .ok_or_else(|| Fault::new("values", "they don't decode to one value a point")),
        Encoding::Unknown(number) => Err(Fault::unknown_encoding(number)),
    }
}

/// Decodes the values of some points of a plane of `points` points, which take `value_bytes` each.
/// At most one compressed plane is decoded as a whole.
pub(crate) fn decode_range(
    encoding: Encoding,
    stored: &[u8],
    value_bytes: usize,
    points: usize,
    range: Range<usize>,
) -> Result<Vec<u8>, Fault> {
    let bytes = range.start * value_bytes..range.end * value_bytes;
    let outside = || Fault::new("values", "they end too early");
    match encoding {
        Encoding::Raw => Ok(stored.get(bytes).ok_or_else(outside)?.to_vec()),
        Encoding::Constant => Ok(stored.repeat(range.len())),
        _ => {
            let mut values = decode(encoding, stored, value_bytes, points)?;
            values.truncate(bytes.end);
            values.drain(..bytes.start.min(values.len()));
            Ok(values)
        }
    }
}

fn decode_runs(
    encoding: Encoding,
    stored: &[u8],
    value_bytes: usize,
    points: usize,
) -> Option<Vec<u8>> {
    let (lengths, mut rest) = stored.split_at_checked(4 * value_bytes)?;
    let mut values = vec![0; points * value_bytes];
    let mut run = vec![0; points];
    for byte in 0..value_bytes {
        let (packed, behind) = rest.split_at_checked(u32_at(lengths, 4 * byte) as usize)?;
        rest = behind;
        let length = match packed.len().cmp(&points) {
            Ordering::Less => unpack(encoding, packed, &mut run)?,
            Ordering::Equal => {
                run.copy_from_slice(packed);
                points
            }
            Ordering::Greater => return None,
        };
        (length == points).then_some(())?;
        for (value, &b) in values.chunks_exact_mut(value_bytes).zip(&run) {
            value[byte] = b;
        }
    }
    rest.is_empty().then_some(values)
}

/// Decompresses one block or frame; returns its length.
fn unpack(encoding: Encoding, packed: &[u8], run: &mut [u8]) -> Option<usize> {
    if encoding == Encoding::Lz4 {
        return lz4_flex::block::decompress_into(packed, run).ok();
    }
    let frame = zstd::zstd_safe::find_frame_compressed_size(packed).ok()?;
    (frame == packed.len()).then(|| zstd::bulk::decompress_to_buffer(packed, run).ok())?
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packed(codec: Codec, size: usize, values: &[u8]) -> (Encoding, Vec<u8>) {
        let mut out = values.to_vec();
        (encode(codec, size, &mut out, 0, &mut Scratch::default()), out)
    }

    /// Values whose upper bytes vary little.
    fn values() -> impl Strategy<Value = (usize, Vec<u8>)> {
        let size = prop::sample::select(vec![1usize, 2, 3, 4, 8, 12]);
        (size, prop::collection::vec(any::<u16>(), 1..900), 0u32..16).prop_map(
            |(size, list, bits)| {
                let value = |v: &u16| {
                    let mut value = vec![7; size];
                    value[0] = (v >> bits) as u8;
                    value
                };
                (size, list.iter().flat_map(value).collect())
            },
        )
    }

    #[test]
    fn noise_stays_raw_and_one_value_is_stored_once() {
        let noise: Vec<u8> = (0..9000u64).map(|i| ((i * i * 0x9e37_79b9) >> 13) as u8).collect();
        let mixed: Vec<u8> = (0..9000u64).map(|i| if i % 3 == 0 { 0 } else { i as u8 }).collect();
        for codec in [Codec::None, Codec::Fast, Codec::Small] {
            assert_eq!(packed(codec, 1, &noise), (Encoding::Raw, noise.clone()));
            assert_eq!(packed(codec, 4, &[1, 2, 3, 4].repeat(90)).0, Encoding::Constant);
        }
        assert_eq!(packed(Codec::Fast, 3, &mixed).0, Encoding::Lz4);
        assert_eq!(packed(Codec::Small, 3, &mixed).0, Encoding::Zstd);
    }

    #[test]
    fn a_stream_that_holds_more_than_the_plane_is_refused() {
        let bomb = vec![0; 1 << 20];
        for encoding in [Encoding::Lz4, Encoding::Zstd] {
            let mut stored = vec![0; 4];
            push_run(encoding, &bomb, &mut stored);
            let length = (stored.len() - 4) as u32;
            stored[..4].copy_from_slice(&length.to_le_bytes());
            decode(encoding, &stored, 1, 100).unwrap_err();
            decode(encoding, &stored, 1, bomb.len() + 1).unwrap_err();
            // A run is not longer than its values.
            decode(encoding, &stored, 1, stored.len() - 5).unwrap_err();
            assert_eq!(decode(encoding, &stored, 1, bomb.len()).unwrap(), bomb);
        }
    }

    proptest! {
        #[test]
        fn values_come_back((size, values) in values(), small: bool) {
            let codec = if small { Codec::Small } else { Codec::Fast };
            let (encoding, stored) = packed(codec, size, &values);
            let points = values.len() / size;
            prop_assert_eq!(decode(encoding, &stored, size, points).unwrap(), values);
        }

        #[test]
        fn damaged_streams_give_values_of_the_right_length_or_an_error(
            (size, values) in values(), small: bool,
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
            cut in any::<prop::sample::Index>(), lie in 1usize..2000,
        ) {
            let codec = if small { Codec::Small } else { Codec::Fast };
            let (encoding, mut stored) = packed(codec, size, &values);
            prop_assume!(encoding.number() > 1);
            let points = values.len() / size;
            for (at, value) in edits {
                let at = at.index(stored.len());
                stored[at] ^= value;
            }
            for (stored, points) in [
                (&stored[..], points), (&stored[..], lie), (&stored[..cut.index(stored.len())], points),
            ] {
                if let Ok(values) = decode(encoding, stored, size, points) {
                    prop_assert_eq!(values.len(), points * size);
                }
            }
        }
    }
}
