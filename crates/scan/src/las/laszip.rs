//! Checks the LASzip record and the chunk table before the decoder uses them: on some claims, `laz`
//! panics or allocates without limit. In: the VLR and the head and tail of the compressed points;
//! out: the items to decode and, if known, the position and count of every chunk.

use super::header::{Header, format_bytes, u16_at, u32_at, u64_at};
use super::vlr::{Records, Vlr};
use crate::error::ScanError;
use esker_points::read_at::Input;
use laz::decoders::ArithmeticDecoder;
use laz::decompressors::IntegerDecompressorBuilder;
use laz::{LazItem, LazVlr};
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

const USER: &str = "laszip encoded";
const RECORD: u16 = 22204;
/// Size of the record before its items, in bytes.
const HEAD_BYTES: usize = 34;
/// Greatest number of chunks in a file: 200 thousand million points at the usual 50,000 a chunk.
const CHUNKS_MAX: u64 = 1 << 22;
/// A chunk size of this, or 0, means chunks of varying size.
const VARIABLE: u32 = u32::MAX;

/// One chunk of compressed points; chunks follow each other without gaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// Number of its points that are read.
    pub points: u32,
    /// Size of its compressed bytes.
    pub bytes: u32,
}

/// How the points of a LAZ file are compressed.
#[derive(Clone, Debug)]
pub struct Compression {
    /// The items of a record, in the decoder's types.
    pub items: Vec<LazItem>,
    /// Number of layers of a chunk if fields are compressed separately (formats 6 to 10).
    pub layers: Option<usize>,
    /// Points in a chunk if all have the same number; `None` if there is one chunk.
    pub chunk_points: Option<u32>,
    /// The chunks, if the file has a chunk table or the chunks say where they end.
    pub chunks: Option<Vec<Chunk>>,
    /// Offset of the first compressed point, in bytes.
    pub start: u64,
    /// Offset after the last compressed point.
    pub end: u64,
}

/// The LASzip record of a file, if it has one.
pub fn record(records: &Records) -> Option<&Vlr> {
    records.find(USER, RECORD)
}

impl Compression {
    /// Checks the record against the header, and reads no chunk table: for files whose chunks are
    /// found otherwise.
    ///
    /// # Errors
    /// If the record is of a kind that is not read or contradicts the header.
    pub fn without_table(
        vlr: &Vlr,
        header: &Header,
        file_bytes: u64,
        path: &Path,
    ) -> Result<Self, ScanError> {
        let items = checked_items(&vlr.data, header, path)?;
        if u16_at(&vlr.data, 0) != 3 {
            let what = "its points are not compressed in layers, as COPC has it";
            return Err(ScanError::unsupported(path, what));
        }
        let layers = Some(items.iter().map(layers_of).sum());
        let (start, end) = (header.points_start, file_bytes);
        Ok(Self { items, layers, chunk_points: None, chunks: None, start, end })
    }

    /// Checks the record against the header and reads the chunk table. If the chunks say how many
    /// points they hold and the header claims another count, the count in `header` is corrected.
    ///
    /// # Errors
    /// If the record is of a kind that is not read or contradicts the header, or if the chunk table
    /// is damaged or has fewer points than the header claims.
    pub fn read(
        vlr: &Vlr,
        header: &mut Header,
        file: &mut Input,
        file_bytes: u64,
        path: &Path,
        notes: &mut Vec<String>,
    ) -> Result<Self, ScanError> {
        let compressor = u16_at(&vlr.data, 0);
        let items = checked_items(&vlr.data, header, path)?;
        let is_layered = compressor == 3;
        let layers = is_layered.then(|| items.iter().map(layers_of).sum());
        let size = u32_at(&vlr.data, 12);
        let mut found = Self {
            items,
            layers,
            chunk_points: (compressor != 1).then_some(size),
            chunks: None,
            start: header.points_start,
            end: file_bytes,
        };
        if compressor == 1 || header.points == 0 && !is_layered {
            found.chunks = (header.points == 0).then(Vec::new);
            return Ok(found);
        }
        let io = |e| ScanError::io(path, e);
        let table_at = table_place(file, header.points_start, file_bytes).map_err(io)?;
        found.start = header.points_start + 8;
        let is_variable = size == VARIABLE || size == 0;
        match table_at {
            // Without a claim, only a plausible chunk table gives the count.
            _ if header.points == 0 => {
                found.end = table_at
                    .filter(|at| *at >= found.start && *at + 8 <= file_bytes)
                    .unwrap_or(found.start);
                let chunks = found.read_table(file, header.record_bytes, is_variable, path);
                let mut chunks = chunks.unwrap_or_default();
                found.correct_count(&mut chunks, is_variable, file, header, notes).map_err(io)?;
                found.chunks = Some(if header.points > 0 { chunks } else { Vec::new() });
                return Ok(found);
            }
            Some(at) if at < found.start || at + 8 > file_bytes => {
                let what = format!(
                    "the chunk table is said to be at byte {at}, but the file ends at {file_bytes}: it is cut short or damaged"
                );
                return Err(ScanError::damaged(path, what));
            }
            Some(at) => {
                found.end = at;
                let mut chunks = found.read_table(file, header.record_bytes, is_variable, path)?;
                found.correct_count(&mut chunks, is_variable, file, header, notes).map_err(io)?;
                found.chunks = Some(found.trim(chunks, header.points, path, notes)?);
            }
            None if is_layered => {
                let chunks = found.walk(file, header, path)?;
                found.chunks = Some(found.trim(chunks, header.points, path, notes)?);
            }
            None if is_variable => {
                let what = "its chunks vary in size, but it has no chunk table: its writer did not finish it";
                return Err(ScanError::damaged(path, what));
            }
            None => {}
        }
        if found.chunks.is_some() && table_at.is_none() {
            notes.push(
                "it has no chunk table: its writer did not finish it; chunks were found by walking"
                    .into(),
            );
        } else if found.chunks.is_none() {
            notes.push(
                "it has no chunk table: its writer did not finish it; decoded on one core".into(),
            );
        }
        Ok(found)
    }

    /// Reads the entries of the chunk table: numbers compressed as `laz` compresses integers.
    fn read_table(
        &self,
        file: &mut Input,
        record_bytes: usize,
        is_variable: bool,
        path: &Path,
    ) -> Result<Vec<Chunk>, ScanError> {
        let cut = |e: std::io::Error| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                ScanError::damaged(path, "the chunk table is cut short or damaged")
            }
            _ => ScanError::io(path, e),
        };
        file.seek(SeekFrom::Start(self.end)).map_err(cut)?;
        let mut head = [0; 8];
        file.read_exact(&mut head).map_err(cut)?;
        let number = u64::from(u32_at(&head, 4));
        let room = self.end - self.start;
        // A chunk begins with a whole record.
        if number > room / record_bytes as u64 || number > CHUNKS_MAX {
            let what = format!(
                "the chunk table claims {number} chunks, more than {room} bytes of points can hold"
            );
            return Err(ScanError::damaged(path, what));
        }
        let mut chunks = Vec::new();
        if number == 0 {
            return Ok(chunks);
        }
        let mut decoder = ArithmeticDecoder::new(BufReader::new(file));
        decoder.read_init_bytes().map_err(cut)?;
        let mut integers =
            IntegerDecompressorBuilder::new().bits(32).contexts(2).build_initialized();
        let (mut points, mut bytes, mut sum) = (0, 0, 0);
        for _ in 0..number {
            if is_variable {
                points = integers.decompress(&mut decoder, points, 0).map_err(cut)?;
            }
            bytes = integers.decompress(&mut decoder, bytes, 1).map_err(cut)?;
            let points = if is_variable { points as u32 } else { self.chunk_points.unwrap_or(0) };
            let chunk = Chunk { points, bytes: bytes as u32 };
            sum += u64::from(chunk.bytes);
            if sum > room {
                let what = format!(
                    "the chunks of its chunk table take more than the {room} bytes of points: it is damaged"
                );
                return Err(ScanError::damaged(path, what));
            }
            chunks.push(chunk);
        }
        Ok(chunks)
    }

    /// Takes the count of points from the chunks if they give it: a table of varying chunks does,
    /// and so does the head of a layered chunk, of which only the last may have fewer points than
    /// the others.
    fn correct_count(
        &self,
        chunks: &mut Vec<Chunk>,
        is_variable: bool,
        file: &mut Input,
        header: &mut Header,
        notes: &mut Vec<String>,
    ) -> std::io::Result<()> {
        // Some writers begin a chunk that gets no point.
        while chunks.last().is_some_and(|c| c.points == 0) {
            chunks.pop();
        }
        let before = chunks.iter().rev().skip(1).map(|c| u64::from(c.bytes)).sum::<u64>();
        let Some(last) = chunks.last_mut() else { return Ok(()) };
        if !is_variable {
            let Some(layers) = self.layers else { return Ok(()) };
            let mut head = Vec::new();
            file.seek(SeekFrom::Start(self.start + before))?;
            let head_bytes = layered_head_bytes(header.record_bytes, layers) as u64;
            file.take(head_bytes).read_to_end(&mut head)?;
            match layered_chunk(&head, header.record_bytes, layers) {
                Some(head) if (1..=last.points).contains(&head.points) => last.points = head.points,
                _ => return Ok(()),
            }
        }
        let held = chunks.iter().map(|c| u64::from(c.points)).sum();
        if held != header.points {
            notes.push(format!(
                "the header claims {} points, but its chunks hold {held}; these are read",
                header.points
            ));
            header.points = held;
        }
        Ok(())
    }

    /// Finds layered chunks without a table, by the count and the sizes of layers in the head of
    /// each.
    fn walk(
        &self,
        file: &mut Input,
        header: &Header,
        path: &Path,
    ) -> Result<Vec<Chunk>, ScanError> {
        let layers = self.layers.unwrap_or(0);
        let (mut chunks, mut at, mut points) = (Vec::new(), self.start, 0);
        let mut head = vec![0; layered_head_bytes(header.record_bytes, layers)];
        while points < header.points && chunks.len() < CHUNKS_MAX as usize {
            let left = self.end - at;
            if left < head.len() as u64 {
                break;
            }
            let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut head));
            read.map_err(|e| ScanError::io(path, e))?;
            let is_sound = |c: &Chunk| c.points > 0 && u64::from(c.bytes) <= left;
            let chunk = layered_chunk(&head, header.record_bytes, layers).filter(is_sound);
            let Some(chunk) = chunk else { break };
            points += u64::from(chunk.points);
            at += u64::from(chunk.bytes);
            chunks.push(chunk);
        }
        Ok(chunks)
    }

    /// Keeps the chunks that the header's count needs, the last one with the remaining points.
    fn trim(
        &self,
        mut chunks: Vec<Chunk>,
        points: u64,
        path: &Path,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Chunk>, ScanError> {
        let mut left = points;
        let mut needed = 0;
        for chunk in &mut chunks {
            if left == 0 {
                break;
            }
            chunk.points = chunk.points.min(u32::try_from(left).unwrap_or(u32::MAX));
            left -= u64::from(chunk.points);
            needed += 1;
        }
        if left > 0 {
            let what = format!(
                "the header claims {points} points, but its chunks hold at most {}: it is cut short or damaged",
                points - left
            );
            return Err(ScanError::damaged(path, what));
        }
        if needed < chunks.len() {
            notes.push(format!(
                "{} of its {} chunks lie beyond the {points} points that the header claims and are left out",
                chunks.len() - needed,
                chunks.len()
            ));
            chunks.truncate(needed);
        }
        Ok(chunks)
    }
}

/// Offset of the chunk table: the number before the points or, from writers that could not seek
/// back, the file's last eight bytes; `None` if neither is plausible.
fn table_place(file: &mut Input, start: u64, file_bytes: u64) -> std::io::Result<Option<u64>> {
    if file_bytes < start + 8 {
        return Ok(Some(start));
    }
    let mut number_at = |at: u64| {
        let mut bytes = [0; 8];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut bytes)?;
        std::io::Result::Ok(u64_at(&bytes, 0))
    };
    let is_none = |place: u64| place as i64 <= start as i64;
    let place = number_at(start)?;
    if !is_none(place) {
        return Ok(Some(place));
    }
    let place = number_at(file_bytes - 8)?;
    Ok((!is_none(place) && place < file_bytes).then_some(place))
}

/// Bytes of a layered chunk before its layers: a record, its count of points, the layers' sizes.
fn layered_head_bytes(record_bytes: usize, layers: usize) -> usize {
    record_bytes + 4 + 4 * layers
}

/// Points and size of a layered chunk according to its head; `None` if `chunk` is shorter than the
/// head, or if more than 4 GiB are claimed.
pub fn layered_chunk(chunk: &[u8], record_bytes: usize, layers: usize) -> Option<Chunk> {
    let head = chunk.get(..layered_head_bytes(record_bytes, layers))?;
    let sizes = head[record_bytes + 4..].chunks_exact(4);
    let bytes = head.len() as u64 + sizes.map(|s| u64::from(u32_at(s, 0))).sum::<u64>();
    Some(Chunk { points: u32_at(head, record_bytes), bytes: u32::try_from(bytes).ok()? })
}

fn layers_of(item: &LazItem) -> usize {
    match u16::from(item.item_type()) {
        10 => 9,
        12 => 2,
        14 => usize::from(item.size()),
        _ => 1,
    }
}

/// The items of a record: exactly those of the point format, of versions that the decoder knows.
fn checked_items(vlr: &[u8], header: &Header, path: &Path) -> Result<Vec<LazItem>, ScanError> {
    let unsupported = |what: String| Err(ScanError::unsupported(path, what));
    let number = usize::from(u16_at(vlr, 32));
    if vlr.len() < HEAD_BYTES + 6 * number {
        let what = format!("its LASzip record of {} bytes is cut short", vlr.len());
        return Err(ScanError::damaged(path, what));
    }
    let (compressor, coder) = (u16_at(vlr, 0), u16_at(vlr, 2));
    if !(1..=3).contains(&compressor) {
        return unsupported(format!("LASzip compressor {compressor} is not known (1 to 3 are)"));
    }
    if coder != 0 {
        return unsupported(format!("LASzip coder {coder} is not known (0 is)"));
    }
    let items = vlr[HEAD_BYTES..].chunks_exact(6).take(number);
    let found: Vec<_> = items.map(|i| [u16_at(i, 0), u16_at(i, 2), u16_at(i, 4)]).collect();
    let sizes: usize = found.iter().map(|&[_, size, _]| usize::from(size)).sum();
    if sizes != header.record_bytes {
        let what = format!(
            "its LASzip record describes {sizes} bytes a point, but point format {} has {} here: fields are missing",
            header.point_format, header.record_bytes
        );
        return Err(ScanError::damaged(path, what));
    }
    let expected = expected_items(header);
    if !found.iter().map(|&[kind, size, _]| (kind, size)).eq(expected) {
        let what = format!(
            "the items of its LASzip record do not make point format {}",
            header.point_format
        );
        return Err(ScanError::damaged(path, what));
    }
    let versions = if compressor == 3 { 3..=4 } else { 1..=2 };
    if let Some([kind, _, version]) = found.iter().find(|[_, _, v]| !versions.contains(v)) {
        return unsupported(format!("LASzip item {kind} of version {version} is not known"));
    }
    match LazVlr::from_buffer(&vlr[..HEAD_BYTES + 6 * number]) {
        Ok(vlr) => Ok(vlr.items().clone()),
        Err(e) => Err(ScanError::damaged(path, format!("its LASzip record is damaged: {e}"))),
    }
}

/// Type and size of each item of a point format (LASzip's `laszip.hpp`).
fn expected_items(header: &Header) -> Vec<(u16, u16)> {
    let mut items = match header.point_format {
        0 => vec![(6, 20)],
        1 => vec![(6, 20), (7, 8)],
        2 => vec![(6, 20), (8, 6)],
        3 => vec![(6, 20), (7, 8), (8, 6)],
        4 => vec![(6, 20), (7, 8), (9, 29)],
        5 => vec![(6, 20), (7, 8), (8, 6), (9, 29)],
        6 => vec![(10, 30)],
        7 => vec![(10, 30), (11, 6)],
        8 => vec![(10, 30), (12, 8)],
        9 => vec![(10, 30), (13, 29)],
        _ => vec![(10, 30), (12, 8), (13, 29)],
    };
    let extra = header.record_bytes - format_bytes(header.point_format).unwrap_or(0);
    if extra > 0 {
        items.push((if header.point_format < 6 { 0 } else { 14 }, extra as u16));
    }
    items
}
