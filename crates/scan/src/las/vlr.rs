//! Reads variable length records, before the points (VLRs) and after them (EVLRs), within a limit
//! and keeps them verbatim. Wrong counts and lengths end the list with a note; points stay
//! readable.

use super::header::{Header, u16_at, u64_at};
use crate::error::ScanError;
use esker_points::read_at::Input;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Greatest size of header, VLRs and EVLRs together that is kept; real files have kilobytes.
pub const VERBATIM_BYTES_MAX: u64 = 64 << 20;
/// Greatest number of VLRs, and of EVLRs; real files have a few. Empty records take more memory
/// than bytes in the file.
const RECORDS_MAX: u32 = 1 << 14;
/// Size of a VLR before its payload, in bytes.
pub const VLR_HEAD_BYTES: usize = 54;
const EVLR_HEAD_BYTES: usize = 60;
/// Record id of waveform packets in an EVLR of `LASF_Spec`.
const WAVEFORM_PACKETS: u16 = 65535;

/// User and record id of the hierarchy of COPC.
const HIERARCHY: (&str, u16) = ("copc", 1000);

/// One record, its data as in the file.
#[derive(Clone, Debug)]
pub struct Vlr {
    /// User id: `LASF_Projection`, `LASF_Spec`, `laszip encoded` ...
    pub user: String,
    /// Record id, a number of that user.
    pub record: u16,
    /// Head as in the file: that of a VLR, or the longer one of an EVLR.
    pub head: Vec<u8>,
    /// Payload.
    pub data: Vec<u8>,
}

impl Vlr {
    /// A VLR of at most 65,535 bytes.
    pub fn new(user: &str, record: u16, description: &str, data: Vec<u8>) -> Self {
        let mut head = vec![0; VLR_HEAD_BYTES];
        head[2..2 + user.len()].copy_from_slice(user.as_bytes());
        head[18..20].copy_from_slice(&record.to_le_bytes());
        // Fits: callers' records are bounded to 16 bits of length.
        head[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        head[22..22 + description.len()].copy_from_slice(description.as_bytes());
        Self { user: user.to_owned(), record, head, data }
    }

    /// Whether it is an EVLR.
    pub fn is_extended(&self) -> bool {
        self.head.len() == EVLR_HEAD_BYTES
    }
}

/// Which EVLRs are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// All but waveform packets.
    All,
    /// All but these and the hierarchy of COPC, of which pages are read when they are needed.
    WithoutHierarchy,
}

/// All records of a file, and its header, VLRs and EVLRs as bytes.
#[derive(Debug, Default)]
pub struct Records {
    /// VLRs and then EVLRs, in the file's order.
    pub vlrs: Vec<Vlr>,
    /// Name and bytes of each block that is kept.
    pub verbatim: Vec<(String, Vec<u8>)>,
}

impl Records {
    /// The first record of this user and number.
    pub fn find(&self, user: &str, record: u16) -> Option<&Vlr> {
        self.vlrs.iter().find(|v| v.user == user && v.record == record)
    }

    /// All records of this user and number, in the file's order.
    pub fn all<'a>(&'a self, user: &'a str, record: u16) -> impl Iterator<Item = &'a Vlr> {
        self.vlrs.iter().filter(move |v| v.user == user && v.record == record)
    }

    /// Reads header, VLRs and EVLRs of a file.
    ///
    /// # Errors
    /// If the system refuses a read, or if header and VLRs are larger than the limit.
    pub fn read(
        file: &mut Input,
        header: &Header,
        file_bytes: u64,
        path: &Path,
        notes: &mut Vec<String>,
    ) -> Result<Self, ScanError> {
        Self::read_kept(file, header, file_bytes, path, notes, Kept::All)
    }

    /// Variant of [`Records::read`] that may pass over EVLRs.
    ///
    /// # Errors
    /// As for [`Records::read`].
    pub fn read_kept(
        file: &mut Input,
        header: &Header,
        file_bytes: u64,
        path: &Path,
        notes: &mut Vec<String>,
        kept: Kept,
    ) -> Result<Self, ScanError> {
        if header.points_start > VERBATIM_BYTES_MAX {
            let what = format!(
                "header and VLRs are said to take {} bytes; {VERBATIM_BYTES_MAX} are read at most",
                header.points_start
            );
            return Err(ScanError::damaged(path, what));
        }
        // Bounded: `points_start` lies inside the file and under the limit.
        let mut head = vec![0; header.points_start as usize];
        let io = |e| ScanError::io(path, e);
        file.seek(SeekFrom::Start(0)).map_err(io)?;
        file.read_exact(&mut head).map_err(io)?;
        let region = head.split_off(header.header_bytes as usize);
        let mut records = Self { vlrs: walk_vlrs(&region, header.vlrs, notes).0, verbatim: vec![] };
        records.verbatim.push(("las header".into(), head));
        if !region.is_empty() {
            records.verbatim.push(("las vlrs".into(), region));
        }
        if let Some((start, number)) = header.evlrs {
            let evlrs = (start, number, kept);
            let read = records.read_evlrs(file, evlrs, file_bytes, notes).map_err(io)?;
            if !read.is_empty() {
                records.verbatim.push(("las evlrs".into(), read));
            }
        }
        Ok(records)
    }

    fn read_evlrs(
        &mut self,
        file: &mut Input,
        (start, number, keeps): (u64, u32, Kept),
        file_bytes: u64,
        notes: &mut Vec<String>,
    ) -> std::io::Result<Vec<u8>> {
        let mut budget =
            VERBATIM_BYTES_MAX - self.verbatim.iter().map(|(_, b)| b.len() as u64).sum::<u64>();
        let mut kept = Vec::new();
        let mut left_out = LeftOut::default();
        let mut at = start;
        for index in 0..number {
            if index == RECORDS_MAX {
                notes.push(behind_the_last("EVLRs", number));
                break;
            }
            let data_at = at.saturating_add(EVLR_HEAD_BYTES as u64);
            let mut head = [0; EVLR_HEAD_BYTES];
            if data_at <= file_bytes {
                file.seek(SeekFrom::Start(at))?;
                file.read_exact(&mut head)?;
            }
            let data_bytes = u64_at(&head, 20);
            if data_at > file_bytes || data_bytes > file_bytes - data_at {
                notes.push(format!(
                    "the header claims {number} EVLRs; number {} runs past the end of the file and is left out",
                    index + 1
                ));
                break;
            }
            at = data_at + data_bytes;
            let (user, record) = (text(&head[2..18]), u16_at(&head, 18));
            if user == "LASF_Spec" && record == WAVEFORM_PACKETS {
                continue;
            }
            let is_hierarchy = (user.as_str(), record) == HIERARCHY;
            if keeps == Kept::WithoutHierarchy && is_hierarchy {
                continue;
            }
            let Some(left) = budget.checked_sub(EVLR_HEAD_BYTES as u64 + data_bytes) else {
                left_out.add(&user, record, data_bytes);
                continue;
            };
            budget = left;
            // Bounded by the file's size and the budget.
            let mut data = vec![0; data_bytes as usize];
            file.read_exact(&mut data)?;
            kept.extend_from_slice(&head);
            kept.extend_from_slice(&data);
            self.vlrs.push(Vlr { user, record, head: head.to_vec(), data });
        }
        notes.extend(left_out.note());
        Ok(kept)
    }
}

/// EVLRs that are larger than the remaining budget.
#[derive(Default)]
struct LeftOut {
    first: Option<String>,
    number: u64,
    bytes: u64,
}

impl LeftOut {
    fn add(&mut self, user: &str, record: u16, bytes: u64) {
        self.first.get_or_insert_with(|| format!("{user} {record}"));
        self.number += 1;
        // They follow each other in the file, so the sum is bounded by its size.
        self.bytes += bytes;
    }

    fn note(&self) -> Option<String> {
        let (first, number, bytes) = (self.first.as_ref()?, self.number, self.bytes);
        Some(match number {
            1 => format!("the EVLR {first} of {bytes} bytes is not kept"),
            _ => format!("{number} EVLRs of {bytes} bytes are not kept; the first is {first}"),
        })
    }
}

/// The note on records beyond the greatest number.
fn behind_the_last(kind: &str, number: u32) -> String {
    format!(
        "the header claims {number} {kind}; {RECORDS_MAX} are kept at most, and those behind are left out"
    )
}

/// Parses blocks kept verbatim: the records, VLRs and then EVLRs, and the bytes after the VLRs,
/// which some files have before their points.
pub fn of_blocks<'a>(header: &Header, region: &'a [u8], evlrs: &[u8]) -> (Records, &'a [u8]) {
    let (mut vlrs, tail) = walk_vlrs(region, header.vlrs, &mut Vec::new());
    let mut rest = evlrs;
    while let Some((head, behind)) = rest.split_at_checked(EVLR_HEAD_BYTES) {
        let bytes = usize::try_from(u64_at(head, 20)).unwrap_or(usize::MAX);
        let Some((data, behind)) = behind.split_at_checked(bytes) else { break };
        let (user, record) = (text(&head[2..18]), u16_at(head, 18));
        vlrs.push(Vlr { user, record, head: head.to_vec(), data: data.to_vec() });
        rest = behind;
    }
    (Records { vlrs, verbatim: Vec::new() }, tail)
}

/// Parses VLRs; returns them and the bytes after them.
fn walk_vlrs<'a>(region: &'a [u8], number: u32, notes: &mut Vec<String>) -> (Vec<Vlr>, &'a [u8]) {
    let mut vlrs = Vec::new();
    let mut rest = region;
    for index in 0..number {
        if index == RECORDS_MAX {
            notes.push(behind_the_last("VLRs", number));
            break;
        }
        let data_bytes = usize::from(u16_at(rest, 20));
        let Some(data) = rest.get(VLR_HEAD_BYTES..).and_then(|r| r.get(..data_bytes)) else {
            notes.push(format!(
                "the header claims {number} VLRs; number {} runs into the points and is left out",
                index + 1
            ));
            break;
        };
        let (user, record) = (text(&rest[2..18]), u16_at(rest, 18));
        let head = rest[..VLR_HEAD_BYTES].to_vec();
        vlrs.push(Vlr { user, record, head, data: data.to_vec() });
        rest = &rest[VLR_HEAD_BYTES + data_bytes..];
    }
    (vlrs, rest)
}

/// Text of a field padded with zeros.
pub fn text(field: &[u8]) -> String {
    let end = field.iter().position(|&b| b == 0).unwrap_or(field.len());
    let printable =
        |c: char| if c.is_control() || c == char::REPLACEMENT_CHARACTER { '_' } else { c };
    String::from_utf8_lossy(&field[..end]).trim().chars().map(printable).collect()
}
