//! GPS times of a LAZ file: four sequences of times, each continued by a multiple of its last
//! difference (LASzip `lasreaditemcompressed_v2.cpp` GPSTIME11, `_v3.cpp` POINT14).

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;
use std::io::{self, Read};

/// Number of sequences.
const SEQUENCES: usize = 4;
/// Greatest multiple of the last difference that has a code, and the least one.
const MULTIPLE_MAX: i32 = 500;
const MULTIPLE_MIN: i32 = -10;
/// First code behind those of multiples.
const BEHIND_MULTIPLES: u32 = (MULTIPLE_MAX - MULTIPLE_MIN + 1) as u32;
/// A difference takes effect if this many in a row were predicted badly.
const BAD_MAX: u32 = 3;

/// One sequence of times.
#[derive(Clone, Copy, Debug, Default)]
struct Sequence {
    /// Last time: the bits of an `f64`.
    time: i64,
    /// Difference that multiples refer to.
    difference: i32,
    /// Number of bad predictions in a row.
    bad: u32,
}

impl Sequence {
    fn advance(&mut self, difference: i32) {
        self.time = self.time.wrapping_add(difference.into());
    }

    /// Notes a bad prediction; after too many, `difference` is taken over.
    fn note_bad(&mut self, difference: i32) {
        self.bad += 1;
        if self.bad > BAD_MAX {
            (self.difference, self.bad) = (difference, 0);
        }
    }
}

/// Decoder of GPS times.
pub struct GpsTimes {
    sequences: [Sequence; SEQUENCES],
    current: usize,
    newest: usize,
    /// Whether there is a code for the same time again: 1, and 0 if not.
    same_codes: u32,
    without_difference: ArithmeticModel,
    multiple: ArithmeticModel,
    integers: IntegerDecompressor,
}

impl GpsTimes {
    /// Decoder of times that come after `first`, the bits of an `f64`; `same_has_code` if codes
    /// can say that a time is the same again.
    pub fn new(first: i64, same_has_code: bool) -> Self {
        let same_codes = u32::from(same_has_code);
        let codes = SEQUENCES as u32 + same_codes;
        let mut sequences = [Sequence::default(); SEQUENCES];
        sequences[0].time = first;
        Self {
            sequences,
            current: 0,
            newest: 0,
            same_codes,
            without_difference: ArithmeticModelBuilder::new(1 + codes).build(),
            multiple: ArithmeticModelBuilder::new(BEHIND_MULTIPLES + codes).build(),
            integers: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
        }
    }

    /// The next time, as the bits of an `f64`.
    ///
    /// # Errors
    /// If the data end, or go from sequence to sequence without a time.
    pub fn next<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<i64> {
        // No writer changes the sequence more than once for a time.
        for _ in 0..=SEQUENCES {
            let change = if self.sequences[self.current].difference == 0 {
                self.next_without_difference(decoder)?
            } else {
                self.next_by_multiple(decoder)?
            };
            if change == 0 {
                return Ok(self.sequences[self.current].time);
            }
            self.current = (self.current + change as usize) % SEQUENCES;
        }
        Err(io::Error::new(io::ErrorKind::InvalidData, "GPS time without an end"))
    }

    /// Decodes in a sequence whose last difference is 0; returns by how many sequences to go on.
    fn next_without_difference<R: Read>(
        &mut self,
        decoder: &mut ArithmeticDecoder<R>,
    ) -> io::Result<u32> {
        let code = decoder.decode_symbol(&mut self.without_difference)?;
        let Some(code) = code.checked_sub(self.same_codes) else { return Ok(0) };
        match code {
            0 => {
                let sequence = &mut self.sequences[self.current];
                sequence.difference = self.integers.decompress(decoder, 0, 0)?;
                sequence.advance(sequence.difference);
                sequence.bad = 0;
            }
            1 => self.begin_sequence(decoder)?,
            _ => return Ok(code - 1),
        }
        Ok(0)
    }

    /// Decodes in a sequence that has a difference; returns by how many sequences to go on.
    fn next_by_multiple<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<u32> {
        let code = decoder.decode_symbol(&mut self.multiple)?;
        if code >= BEHIND_MULTIPLES {
            match (code - BEHIND_MULTIPLES).checked_sub(self.same_codes) {
                None => {}
                Some(0) => self.begin_sequence(decoder)?,
                Some(change) => return Ok(change),
            }
            return Ok(0);
        }
        let sequence = &mut self.sequences[self.current];
        let code = code as i32;
        let (multiple, context) = match code {
            0 => (0, 7),
            1 => (1, 1),
            2..10 => (code, 2),
            10..MULTIPLE_MAX => (code, 3),
            MULTIPLE_MAX => (code, 4),
            _ if MULTIPLE_MAX - code > MULTIPLE_MIN => (MULTIPLE_MAX - code, 5),
            _ => (MULTIPLE_MIN, 6),
        };
        let predicted = sequence.difference.wrapping_mul(multiple);
        let difference = self.integers.decompress(decoder, predicted, context)?;
        sequence.advance(difference);
        match multiple {
            0 | MULTIPLE_MIN | MULTIPLE_MAX => sequence.note_bad(difference),
            1 => sequence.bad = 0,
            _ => {}
        }
        Ok(0)
    }

    /// Begins a new sequence, in the place of the oldest, with a time that is far from all.
    fn begin_sequence<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        let predicted = (self.sequences[self.current].time >> 32) as i32;
        let high = self.integers.decompress(decoder, predicted, 8)?;
        let time = i64::from(high) << 32 | i64::from(decoder.read_int()?);
        self.newest = (self.newest + 1) % SEQUENCES;
        self.current = self.newest;
        self.sequences[self.current] = Sequence { time, ..Sequence::default() };
        Ok(())
    }
}

/// The item of GPS times in records that are compressed one after the other, version 2.
#[derive(Default)]
pub struct GpsTimeItem {
    times: Option<GpsTimes>,
}

impl<R: Read> FieldDecompressor<R> for GpsTimeItem {
    fn size_of_field(&self) -> usize {
        size_of::<i64>()
    }

    fn decompress_first(&mut self, src: &mut R, first_point: &mut [u8]) -> io::Result<()> {
        let mut first = [0; 8];
        src.read_exact(&mut first)?;
        first_point.copy_from_slice(&first);
        self.times = Some(GpsTimes::new(i64::from_le_bytes(first), true));
        Ok(())
    }

    fn decompress_with(
        &mut self,
        decoder: &mut ArithmeticDecoder<R>,
        buf: &mut [u8],
    ) -> io::Result<()> {
        let Some(times) = &mut self.times else { return Ok(()) };
        buf.copy_from_slice(&times.next(decoder)?.to_le_bytes());
        Ok(())
    }
}
