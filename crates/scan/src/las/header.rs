//! Parses the public header of LAS 1.0 to 1.5 and checks it against the size of the file. Offsets
//! are those of the LAS 1.4 R15 specification, tables 3 to 5 (1.5 only appends fields). Counts and
//! bounds are hints; contradictions that make reading meaningless are refused here.

use crate::error::ScanError;
use esker_points::Grid;
use std::path::Path;

/// Size of the header of versions 1.0 to 1.2, in bytes.
pub const HEADER_BYTES_MIN: usize = 227;
/// Size of the header of version 1.3, with the start of the waveform packets.
const HEADER_BYTES_1_3: usize = 235;
/// Size of the header of version 1.4, with EVLRs and 64-bit counts.
const HEADER_BYTES_1_4: usize = 375;

/// Offset of the global encoding.
const ENCODING_AT: usize = 6;
/// Bit of the global encoding: GPS times are adjusted standard ones.
pub const ADJUSTED_BIT: u16 = 1;
/// Bit of the global encoding: the CRS is WKT.
pub const WKT_BIT: u16 = 1 << 4;

/// Whether a header has a bit of the global encoding.
pub fn has_bit(header: &[u8], bit: u16) -> bool {
    u16_at(header, ENCODING_AT) & bit > 0
}

/// Sets or clears a bit of the global encoding of a whole header.
pub fn set_bit(header: &mut [u8], bit: u16, is_set: bool) {
    let others = u16_at(header, ENCODING_AT) & !bit;
    let encoding = others | if is_set { bit } else { 0 };
    header[ENCODING_AT..][..2].copy_from_slice(&encoding.to_le_bytes());
}

/// Epoch of the GPS times of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpsTimes {
    /// The beginning of an unknown week.
    Week,
    /// 10^9 seconds after the beginning of 1980-01-06.
    Adjusted,
}

impl GpsTimes {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Week => "week",
            Self::Adjusted => "adjusted standard",
        }
    }

    /// The epoch of this name.
    pub(crate) fn of_name(name: &[u8]) -> Option<Self> {
        [Self::Week, Self::Adjusted].into_iter().find(|times| times.name().as_bytes() == name)
    }
}

/// The fields of the header that are used.
#[derive(Clone, Debug)]
pub struct Header {
    /// Minor version, 0 to 5.
    pub minor: u8,
    /// Size of the header as it claims, in bytes.
    pub header_bytes: u64,
    /// Offset at which points begin (LAZ: at which the offset of the chunk table is).
    pub points_start: u64,
    /// Claimed number of VLRs.
    pub vlrs: u32,
    /// Point format, 0 to 10.
    pub point_format: u8,
    /// The same as it is written, without the bit of compressed points.
    claimed_format: u8,
    /// Epoch of GPS times, if the point format has them.
    pub gps_times: Option<GpsTimes>,
    /// Whether the upper bits of the point format say that points are compressed.
    pub is_compressed: bool,
    /// Size of a point record, in bytes; at least that of the format.
    pub record_bytes: usize,
    /// Claimed number of points.
    pub points: u64,
    /// Scale and offset.
    pub grid: Grid,
    /// Claimed least and greatest coordinates.
    pub bounds: [[f64; 3]; 2],
    /// Offset at which EVLRs begin, and their number.
    pub evlrs: Option<(u64, u32)>,
    /// Offset at which waveform packets inside the file begin.
    pub waveforms_start: Option<u64>,
}

impl Header {
    /// Parses `head`, the beginning of a file of `file_bytes` bytes.
    ///
    /// # Errors
    /// If the header is truncated, of an unknown version or point format, or contradicts itself.
    pub fn parse(head: &[u8], file_bytes: u64, path: &Path) -> Result<Self, ScanError> {
        if head.len() < HEADER_BYTES_MIN {
            let what = format!(
                "cut inside the LAS header: {} bytes of at least {HEADER_BYTES_MIN}",
                head.len()
            );
            return Err(ScanError::damaged(path, what));
        }
        let (major, minor) = (head[24], head[25]);
        if major != 1 || minor > 5 {
            return Err(ScanError::unsupported(
                path,
                format!("LAS {major}.{minor} is not read (1.0 to 1.5 are)"),
            ));
        }
        let header_bytes = usize::from(u16_at(head, 94));
        let known = head.get(..header_bytes).unwrap_or(head);
        let point_format = head[104] & 0x3f;
        let is_adjusted = has_bit(head, ADJUSTED_BIT);
        let gps_times = if is_adjusted { GpsTimes::Adjusted } else { GpsTimes::Week };
        let header = Self {
            minor,
            header_bytes: header_bytes as u64,
            points_start: u64::from(u32_at(head, 96)),
            vlrs: u32_at(head, 100),
            point_format,
            claimed_format: head[104] & 0x7f,
            gps_times: (!matches!(point_format, 0 | 2)).then_some(gps_times),
            is_compressed: head[104] & 0xc0 != 0,
            record_bytes: usize::from(u16_at(head, 105)),
            points: point_count(known, minor),
            grid: Grid {
                scale: [131, 139, 147].map(|at| f64_at(head, at)),
                offset: [155, 163, 171].map(|at| f64_at(head, at)),
            },
            bounds: [
                [187, 203, 219].map(|at| f64_at(head, at)),
                [179, 195, 211].map(|at| f64_at(head, at)),
            ],
            evlrs: (minor >= 4 && known.len() >= HEADER_BYTES_1_4)
                .then(|| (u64_at(head, 235), u32_at(head, 243)))
                .filter(|&(_, number)| number > 0),
            waveforms_start: (minor >= 3 && known.len() >= HEADER_BYTES_1_3)
                .then(|| u64_at(head, 227))
                .filter(|&start| start > 0),
        };
        header.check(file_bytes, path)?;
        Ok(header)
    }

    fn check(&self, file_bytes: u64, path: &Path) -> Result<(), ScanError> {
        let damaged = |what: String| Err(ScanError::damaged(path, what));
        if self.header_bytes < HEADER_BYTES_MIN as u64 {
            return damaged(format!(
                "its header claims {} bytes; LAS needs at least {HEADER_BYTES_MIN}",
                self.header_bytes
            ));
        }
        if self.points_start < self.header_bytes {
            return damaged(format!(
                "its points are said to begin at byte {}, inside the header of {} bytes",
                self.points_start, self.header_bytes
            ));
        }
        if self.points_start > file_bytes {
            return damaged(format!(
                "its points are said to begin at byte {}, but the file ends at {file_bytes}",
                self.points_start
            ));
        }
        let Some(needed) = format_bytes(self.point_format) else {
            let what =
                format!("LAS point format {} is not read (0 to 10 are)", self.claimed_format);
            return Err(ScanError::unsupported(path, what));
        };
        if self.record_bytes < needed {
            return damaged(format!(
                "its point records are said to have {} bytes; format {} needs {needed}",
                self.record_bytes, self.point_format
            ));
        }
        for (axis, letter) in ['x', 'y', 'z'].into_iter().enumerate() {
            let (scale, offset) = (self.grid.scale[axis], self.grid.offset[axis]);
            if !scale.is_normal() || scale < 0.0 {
                return damaged(format!("the scale of axis {letter} is {scale}, no usable number"));
            }
            if !offset.is_finite() {
                return damaged(format!("the offset of axis {letter} is {offset}"));
            }
        }
        Ok(())
    }
}

/// The 64-bit count from version 1.4 on, if it is set; otherwise the legacy one.
fn point_count(known: &[u8], minor: u8) -> u64 {
    let legacy = u64::from(u32_at(known, 107));
    if minor < 4 || known.len() < HEADER_BYTES_1_4 {
        return legacy;
    }
    match u64_at(known, 247) {
        0 => legacy,
        count => count,
    }
}

/// Size of a record of this point format without extra bytes, in bytes.
pub fn format_bytes(point_format: u8) -> Option<usize> {
    [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67].get(usize::from(point_format)).copied()
}

/// Little-endian `u16` at offset `at`; 0 past the end, so that no length is trusted.
pub fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(array_at(bytes, at))
}

/// Little-endian `u32` at offset `at`; 0 past the end.
pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array_at(bytes, at))
}

/// Little-endian `u64` at offset `at`; 0 past the end.
pub fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array_at(bytes, at))
}

/// Little-endian `f64` at offset `at`; 0 past the end.
pub fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(array_at(bytes, at))
}

fn array_at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    bytes
        .get(at..)
        .and_then(|rest| rest.get(..N))
        .and_then(|slice| slice.try_into().ok())
        .unwrap_or([0; N])
}
