//! Decides, from the sources and before the first point, the head and tail of a LAS file and the
//! layout of its records. LAS sources with the same record layout keep version, point format, extra
//! bytes and all VLRs and EVLRs. Otherwise the least point format with a field for every attribute
//! is taken, and attributes without a field become extra bytes.

use super::records::Records;
use super::system::{StatedSystem, crs_record, is_of_crs};
use crate::error::ScanError;
use crate::fields::{LEGACY, LEGACY_BLOCK};
use crate::las::extra_bytes;
use crate::las::header::{ADJUSTED_BIT, GpsTimes, Header, WKT_BIT, format_bytes, has_bit, set_bit};
use crate::las::points::Layout;
use crate::las::vlr::{Vlr, of_blocks};
use crate::las::{EXTRA_BYTES_MAX, NoData, gps_times};
use crate::write::encode::{Origin, Origins, Outline};
use crate::write::stated::conflict_note;
use crate::write::unique::unique;
use esker_points::attribute::names;
use esker_points::{AttrType, Attribute, Schema};
use laz::{LazVlr, LazVlrBuilder};
use std::path::Path;

/// Sizes of the headers of LAS 1.0 to 1.5, in bytes.
const HEADER_BYTES: [u16; 6] = [227, 227, 227, 235, 375, 393];
const HEADER_BYTES_1_4: u16 = HEADER_BYTES[4];
/// Greatest number of extra-bytes descriptions in a VLR.
const DESCRIPTIONS_MAX: usize = u16::MAX as usize / extra_bytes::DESCRIPTION_BYTES;
/// Note on the records of COPC, which hold for the order of the sources' points.
const COPC_DROPPED: &str = "the sources' COPC index is left out: the order of points changes";
/// Greatest size of all VLRs, in bytes: the header has 32 bits for the offset of the points.
const VLR_BYTES_MAX: usize = 1 << 30;

/// Kind of LAS file.
#[derive(Clone, Copy, Debug)]
pub enum Variant<'a> {
    /// Uncompressed.
    Las,
    /// Compressed, in chunks of one size.
    Laz,
    /// Compressed, in a chunk for each voxel of an octree. The text is that of the coordinate
    /// reference system to write in place of the sources', in WKT.
    Copc(Option<&'a str>),
}

impl Variant<'_> {
    /// Whether it has points of this format.
    fn holds(self, point_format: u8) -> bool {
        !matches!(self, Self::Copc(_)) || (6..=8).contains(&point_format)
    }
}

/// Head, tail and record layout of a LAS file.
pub struct LasPlan {
    /// The header, without counts, bounds and offsets.
    pub header: Vec<u8>,
    /// VLRs and then EVLRs.
    pub vlrs: Vec<Vlr>,
    /// Bytes between the VLRs and the points.
    pub tail: Vec<u8>,
    /// Layout of the records.
    pub records: Records,
    /// The LASzip record, if points are compressed.
    pub laszip: Option<LazVlr>,
    /// Differences from the sources, a line each.
    pub notes: Vec<String>,
}

/// Summary of the sources, added one by one.
#[derive(Default)]
struct SourceSummary {
    /// Header, VLRs and tail of the first LAS source.
    first: Option<(Vec<u8>, Vec<Vlr>, Vec<u8>)>,
    /// Point format and layout of the first LAS source.
    layout: Option<(u8, Layout)>,
    /// Whether layouts differ, or a source is not LAS.
    differ: bool,
    /// Whether a source is neither LAS of point format 0 to 5 nor has values that fit it.
    modern: bool,
    minor: u8,
    /// The first coordinate reference system that LAS can hold, and whether there is any.
    wkt: Option<String>,
    has_system: bool,
    dropped: Vec<&'static str>,
    conflicts: usize,
    /// Epoch of the GPS times of the first source with GPS times, and number of sources with
    /// another one.
    gps_times: Option<GpsTimes>,
    other_times: usize,
    /// Whether that first source is no LAS file.
    are_times_of_others: bool,
    /// No-data values of extra bytes.
    no_data: NoData,
    /// Whether the source whose coordinate reference system is written says that it is WKT.
    is_wkt: Option<bool>,
    /// Descriptions of extra bytes, each once.
    descriptions: Vec<Vec<u8>>,
    /// Number of sources with another coordinate reference system than the first that has one.
    other_systems: usize,
}

/// Plans a LAS file for the sources `origins`.
///
/// # Errors
/// If a source cannot be read or LAS cannot hold the attributes.
pub fn plan(
    path: &Path,
    outline: &Outline,
    origins: &mut Origins<'_>,
    variant: Variant<'_>,
) -> Result<LasPlan, ScanError> {
    let mut found = SourceSummary::default();
    let mut sources = 0usize;
    for origin in origins {
        sources += 1;
        found.add(&origin?, sources == 1);
    }
    let of_source = found.layout.as_ref().filter(|_| !found.differ);
    let of_source = of_source.filter(|(format, _)| variant.holds(*format));
    let of_source =
        of_source.and_then(|(f, layout)| Records::of_source(*f, layout, &outline.schema));
    let is_restored = of_source.is_some();
    let mut notes = Vec::new();
    let (records, mut extra) = match of_source {
        Some(records) => (records, Vec::new()),
        None => {
            let is_modern = found.modern || sources == 0;
            let format = least_format(&outline.schema, is_modern, variant);
            Records::of_format(format, format_bytes(format).unwrap_or(0), outline)
        }
    };
    check_extra(path, &records, &extra)?;
    let wanted: Vec<_> = extra.iter().map(|a| (a.name.clone(), a.ty)).collect();
    let (names, renamed) = unique(&wanted, &extra_bytes::avoided_names(), extra_bytes::NAME_BYTES);
    extra.iter_mut().zip(names).for_each(|(attribute, name)| attribute.name = name);
    let (header, mut vlrs, tail) = found.first.take().unwrap_or_else(new_head);
    let system = StatedSystem { wkt: found.wkt.take(), is_any: found.has_system };
    let system = match variant {
        Variant::Copc(given) => system.place_wkt(path, given, &mut vlrs)?,
        _ => system.place(&mut vlrs),
    };
    found.is_wkt = system.is_wkt.or(found.is_wkt);
    notes.extend(system.note);
    if is_copc(variant) {
        found.dropped.retain(|what| *what != COPC_DROPPED);
    }
    if !is_restored {
        vlrs.retain(|v| !(v.user == "LASF_Spec" && v.record == 4));
        if !extra.is_empty() {
            vlrs.insert(
                0,
                Vlr::new(
                    "LASF_Spec",
                    4,
                    "extra bytes",
                    extra_bytes::describe_all(&extra, &found.descriptions),
                ),
            );
        }
        found.note_format(sources, &records, &extra, &mut notes);
        let own = found.layout.as_ref().map(|(format, _)| *format);
        if let Some(own) = own.filter(|own| sources == 1 && !variant.holds(*own)) {
            let to = records.point_format;
            notes.push(format!(
                "point format {own} is written as {to}: COPC has formats 6, 7 and 8"
            ));
        }
        notes.extend(renamed);
        if records.widens_colours() {
            notes.push("colours of 8 bits are written with 16 as LAS asks, times 256".into());
        }
        if records.rounds_angles() {
            notes.push(
                "whole degrees of scan angles are written in steps of 0.006, off by at most 0.003"
                    .into(),
            );
        }
    }
    let laszip = match variant {
        Variant::Las => None,
        Variant::Laz => Some(laszip(path, &records, false)?),
        Variant::Copc(_) => Some(laszip(path, &records, true)?),
    };
    let is_compressed = laszip.is_some();
    place_laszip(laszip.as_ref(), &mut vlrs, path)?;
    if vlrs.iter().map(|v| v.head.len() + v.data.len()).sum::<usize>() > VLR_BYTES_MAX {
        return Err(ScanError::unsupported(path, "its VLRs would take over a GiB"));
    }
    found.differ = !is_restored;
    let is_long = outline.points_max > u32::MAX.into();
    let is_modern =
        vlrs.iter().any(Vlr::is_extended) || is_long || system.needs_1_4 || is_copc(variant);
    let needed = if is_modern { 4 } else { 0 };
    let mut header = with_version(header, &found, &records, needed, &mut notes);
    header[104] = records.point_format | if is_compressed { 0x80 } else { 0 };
    header[105..107].copy_from_slice(&(records.record_bytes as u16).to_le_bytes());
    if let Some(is_wkt) = found.is_wkt {
        set_bit(&mut header, WKT_BIT, is_wkt);
    }
    found.set_times(&mut header, &outline.schema, &mut notes);
    found.note_conflicts(&mut notes);
    Ok(LasPlan { header, vlrs, tail, records, laszip, notes })
}

/// Whether the file has an octree.
fn is_copc(variant: Variant<'_>) -> bool {
    matches!(variant, Variant::Copc(_))
}

impl SourceSummary {
    /// Sets the epoch of GPS times in the global encoding.
    fn set_times(&self, header: &mut [u8], schema: &Schema, notes: &mut Vec<String>) {
        if let Some(times) = self.gps_times {
            set_bit(header, ADJUSTED_BIT, times == GpsTimes::Adjusted);
            let has_times = schema.find_typed(names::GPS_TIME, AttrType::F64).is_some();
            if self.are_times_of_others && has_times && times == GpsTimes::Adjusted {
                notes.push(
                    "the global encoding says that GPS times are adjusted standard time".into(),
                );
            }
            if self.other_times > 0 {
                notes.push(format!(
                    "GPS times of {} sources have another epoch than the first's, which the global encoding gives ({}); they are written unchanged",
                    self.other_times,
                    times.name()
                ));
            }
        }
    }

    /// Notes what one file cannot hold of several sources.
    fn note_conflicts(&self, notes: &mut Vec<String>) {
        notes.extend(conflict_note(&self.no_data, "of which the file has the first"));
        notes.extend(self.dropped.iter().map(|&what| what.to_owned()));
        if self.other_systems > 0 {
            notes.push(format!(
                "{} sources have another coordinate reference system than the first that has one; only the first's is written, \
                 coordinates are unchanged",
                self.other_systems
            ));
        }
        if self.conflicts > 0 {
            let n = self.conflicts;
            notes.push(format!(
                "{n} VLRs of later sources differ from the first's and are left out"
            ));
        }
    }

    fn add(&mut self, origin: &Origin, is_first: bool) {
        self.has_system |= origin.crs.as_ref().is_some_and(|crs| !crs.text.is_empty());
        if self.wkt.is_none() {
            let text = origin.crs.as_ref().map(|crs| &crs.text);
            self.wkt = text.filter(|text| crs_record(text).is_some()).cloned();
        }
        self.no_data.add(&origin.verbatim);
        if let Some(times) = gps_times(&origin.verbatim) {
            self.are_times_of_others |=
                self.gps_times.is_none() && origin.block("las header").is_none();
            self.other_times += usize::from(*self.gps_times.get_or_insert(times) != times);
        }
        let parsed = origin.block("las header").and_then(|bytes| {
            // The blocks were checked when they were read; here their sizes are not trusted.
            let header = Header::parse(bytes, u64::MAX, Path::new("")).ok()?;
            (header.header_bytes == bytes.len() as u64).then_some((bytes, header))
        });
        let Some((bytes, header)) = parsed else {
            self.differ = true;
            self.modern |= origin.block(LEGACY_BLOCK) != Some(LEGACY);
            return;
        };
        let empty: &[u8] = &[];
        let block = |name| origin.block(name).unwrap_or(empty);
        let (records, tail) = of_blocks(&header, block("las vlrs"), block("las evlrs"));
        self.modern |= header.point_format >= 6;
        self.minor = self.minor.max(header.minor);
        let extra = header.record_bytes - format_bytes(header.point_format).unwrap_or(0);
        if extra <= EXTRA_BYTES_MAX {
            for description in extra_bytes::descriptions(&records) {
                let is_new = !self.descriptions.iter().any(|known| known == description);
                if is_new && self.descriptions.len() < DESCRIPTIONS_MAX {
                    self.descriptions.push(description.to_vec());
                }
            }
            let attributes = extra_bytes::attributes(&records, extra, &mut Vec::new());
            let layout = Layout::new(header.point_format, header.record_bytes, attributes);
            let same = self.layout.as_ref().is_none_or(|(format, l)| {
                *format == header.point_format
                    && l.schema == layout.schema
                    && l.fields == layout.fields
            });
            self.differ |= !same || (self.layout.is_none() && !is_first);
            self.layout.get_or_insert((header.point_format, layout));
        } else {
            self.differ = true;
        }
        let mut vlrs = records.vlrs;
        vlrs.retain(|v| self.is_kept(v));
        self.leave_one_system(&mut vlrs);
        if vlrs.iter().any(is_of_crs) {
            self.is_wkt = Some(has_bit(bytes, WKT_BIT));
        }
        match &mut self.first {
            None => self.first = Some((bytes.to_vec(), vlrs, tail.to_vec())),
            Some((_, kept, _)) => {
                // A source may have several records of the same number.
                let before = kept.len();
                for v in vlrs {
                    let alike = || {
                        kept[..before].iter().filter(|k| k.user == v.user && k.record == v.record)
                    };
                    if alike().any(|k| k.data == v.data) {
                        continue;
                    }
                    if alike().next().is_some() {
                        self.conflicts += 1;
                    } else {
                        kept.push(v);
                    }
                }
            }
        }
    }

    /// Removes the records of a coordinate reference system if an earlier source has one: a file
    /// has one system.
    fn leave_one_system(&mut self, vlrs: &mut Vec<Vlr>) {
        let kept: Vec<&Vlr> =
            self.first.iter().flat_map(|(_, kept, _)| kept).filter(|v| is_of_crs(v)).collect();
        if kept.is_empty() {
            return;
        }
        let is_equal = |v: &Vlr| kept.iter().any(|t| t.record == v.record && t.data == v.data);
        let differs = vlrs.iter().any(|v| is_of_crs(v) && !is_equal(v));
        self.other_systems += usize::from(differs);
        vlrs.retain(|v| !is_of_crs(v));
    }

    /// Whether a record still holds in the new file: indices into the order of points do not.
    fn is_kept(&mut self, vlr: &Vlr) -> bool {
        let what = match (vlr.user.as_str(), vlr.record) {
            ("copc", _) => COPC_DROPPED,
            ("LAStools", 30) => {
                "the sources' spatial index is left out: the order of points changes"
            }
            _ => return true,
        };
        if !self.dropped.contains(&what) {
            self.dropped.push(what);
        }
        false
    }

    fn note_format(
        &self,
        sources: usize,
        records: &Records,
        extra: &[Attribute],
        notes: &mut Vec<String>,
    ) {
        if self.layout.is_some() && sources > 1 {
            notes.push(format!(
                "the sources' records differ: all are written in point format {}, with zeros for what a point lacks",
                records.point_format
            ));
        }
        if !extra.is_empty() {
            let names: Vec<_> = extra.iter().map(|a| a.name.as_str()).collect();
            notes.push(format!("as extra bytes: {}", names.join(", ")));
        }
    }
}

/// The least point format that has a field for every attribute that LAS knows.
fn least_format(schema: &Schema, modern: bool, variant: Variant<'_>) -> u8 {
    let has = |name, ty| schema.find_typed(name, ty).is_some();
    let colour = schema.rgb().is_some();
    let nir = has(names::NIR, AttrType::U16);
    let time = has(names::GPS_TIME, AttrType::F64);
    // COPC has no formats with waveforms.
    let wave = has(names::WAVE_OFFSET, AttrType::U64) && !is_copc(variant);
    let modern = modern || is_copc(variant);
    match (modern, wave, nir, colour, time) {
        (true, true, false, false, _) => 9,
        (true, true, _, _, _) => 10,
        (true, false, true, _, _) => 8,
        (true, false, false, true, _) => 7,
        (true, false, false, false, _) => 6,
        (false, true, _, colour, _) => 4 + u8::from(colour),
        (false, false, _, colour, time) => u8::from(time) + 2 * u8::from(colour),
    }
}

fn check_extra(path: &Path, records: &Records, extra: &[Attribute]) -> Result<(), ScanError> {
    let bytes: usize = extra.iter().map(|a| a.ty.size()).sum();
    if extra.len() > DESCRIPTIONS_MAX || bytes > EXTRA_BYTES_MAX || records.record_bytes > 0xffff {
        let what = format!(
            "{} attributes of {bytes} bytes have no field in LAS; {DESCRIPTIONS_MAX} of {EXTRA_BYTES_MAX} bytes are written at most: export as .ply",
            extra.len()
        );
        return Err(ScanError::unsupported(path, what));
    }
    Ok(())
}

/// Header and VLRs of a file whose sources had none.
fn new_head() -> (Vec<u8>, Vec<Vlr>, Vec<u8>) {
    let mut header = vec![0; usize::from(HEADER_BYTES_1_4)];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"LASF");
    put(24, &[1, 4]);
    put(26, b"OTHER");
    put(58, concat!("Esker ", env!("CARGO_PKG_VERSION")).as_bytes());
    // Day and year of creation stay zero, so that the same points give the same file.
    put(94, &HEADER_BYTES_1_4.to_le_bytes());
    (header, Vec::new(), Vec::new())
}

/// The header in a version that has the point format, at least version `needed`. A restored header
/// otherwise keeps its version.
fn with_version(
    mut header: Vec<u8>,
    found: &SourceSummary,
    records: &Records,
    needed: u8,
    notes: &mut Vec<String>,
) -> Vec<u8> {
    let of_format = match records.point_format {
        _ if !found.differ => 0,
        0..=1 => 0,
        2..=3 => 2,
        4..=5 => 3,
        _ => 4,
    };
    let own = minor(&header);
    let minor = if found.differ { found.minor.min(4) } else { own }.max(of_format).max(needed);
    if minor > own {
        notes.push(format!("written as LAS 1.{minor}, which its records need"));
        let bytes = HEADER_BYTES[usize::from(minor)];
        header.truncate(usize::from(HEADER_BYTES[usize::from(own)]));
        header.resize(usize::from(bytes), 0);
        header[25] = minor;
        header[94..96].copy_from_slice(&bytes.to_le_bytes());
    }
    header
}

/// The LASzip record, for chunks of one size or of any.
fn laszip(path: &Path, records: &Records, is_variable: bool) -> Result<LazVlr, ScanError> {
    let extra = records.record_bytes - format_bytes(records.point_format).unwrap_or(0);
    let sized = |builder: LazVlrBuilder| {
        if is_variable { builder.with_variable_chunk_size() } else { builder }
    };
    LazVlrBuilder::default()
        .with_point_format(records.point_format, extra as u16)
        .map(|builder| sized(builder).build())
        .map_err(|e| ScanError::unsupported(path, format!("cannot be compressed: {e}")))
}

/// Replaces the LASzip record of the source, or inserts the new one after all other VLRs. Without a
/// new one, removes that of the source.
fn place_laszip(
    laszip: Option<&LazVlr>,
    vlrs: &mut Vec<Vlr>,
    path: &Path,
) -> Result<(), ScanError> {
    let is_laszip = |v: &Vlr| v.user == LazVlr::USER_ID && v.record == LazVlr::RECORD_ID;
    let place = vlrs.iter().position(is_laszip);
    vlrs.retain(|v| !is_laszip(v));
    if let Some(laszip) = laszip {
        let mut data = Vec::new();
        laszip.write_to(&mut data).map_err(|e| ScanError::unsupported(path, e.to_string()))?;
        let behind = vlrs.iter().position(Vlr::is_extended).unwrap_or(vlrs.len());
        let record = Vlr::new(LazVlr::USER_ID, LazVlr::RECORD_ID, LazVlr::DESCRIPTION, data);
        vlrs.insert(place.unwrap_or(behind).min(behind), record);
    }
    Ok(())
}

/// The minor version of a header.
pub fn minor(header: &[u8]) -> u8 {
    header[25]
}

/// Whether a header has 64-bit counts and EVLRs.
pub fn is_1_4(header: &[u8]) -> bool {
    minor(header) >= 4 && header.len() >= usize::from(HEADER_BYTES_1_4)
}
