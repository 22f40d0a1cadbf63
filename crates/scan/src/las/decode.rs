//! Decodes the points of a file as runs of raw records, in order: uncompressed or LASzip-compressed
//! bytes in, the result of `convert` for each run out, to `sink`, on the caller's thread. Chunks
//! are read in groups; each is decoded by itself on any thread of the current pool, while the sink
//! takes earlier ones. What a chunk claims is checked before the decoder allocates for it.

use super::items::{self, Decoder};
use super::laszip::{Chunk, Compression, layered_chunk};
use crate::ahead::Ahead;
use crate::caught;
use crate::error::ScanError;
use crate::source::BATCH_POINTS;
use esker_points::Task;
use esker_points::read_at::Input;
use std::collections::VecDeque;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

/// Greatest number of raw bytes in a run: bounds batches of files with very long records.
const RUN_BYTES: usize = 4 << 20;
/// Raw bytes in a group. Another group is read when none is under way, or when the pieces under way
/// are too few to occupy all threads.
const GROUP_BYTES: usize = 8 << 20;
/// Greatest number of chunks in a group: bounds the overhead of tiny chunks.
const GROUP_PIECES: usize = 512;
/// Pieces under way per thread, if one group and the next have fewer.
const PIECES_A_THREAD: usize = 2;
/// A chunk of more raw bytes than this is streamed: decoded on one core while it is read.
const CHUNK_BYTES_MAX: usize = 4 * GROUP_BYTES;
const READ_BYTES: usize = 256 << 10;
/// Greatest number of raw bytes under way on all threads.
pub const WINDOW_BYTES_MAX: u64 = 64 << 20;

/// Where the points of a file are, and how they are stored.
#[derive(Clone, Debug)]
pub struct Points {
    /// The file.
    pub path: PathBuf,
    /// Offset of the first point, in bytes.
    pub start: u64,
    /// Number of points to read.
    pub count: u64,
    /// Size of a record, in bytes.
    pub record_bytes: usize,
    /// Compression, if the points are compressed.
    pub compression: Option<Compression>,
    /// Greatest number of raw bytes under way on all threads.
    pub window_bytes_max: u64,
    /// Of how many points one is read; 1 for all.
    pub one_in: u32,
}

/// Converts whole records to a result; called on any thread.
pub type Convert<'a, T> = dyn Fn(&[u8]) -> Result<T, ScanError> + Sync + 'a;

/// Progress of the reading.
struct Reader {
    file: Input,
    at: u64,
    point: u64,
    chunk: usize,
}

/// Bytes read together, whose pieces are decoded in parallel.
struct Group {
    bytes: Vec<u8>,
    pieces: Vec<Piece>,
}

/// A run of records or a chunk in a group.
struct Piece {
    bytes: Range<usize>,
    points: usize,
    first_point: u64,
}

impl Points {
    /// Decodes a range of the points, in runs of at most [`BATCH_POINTS`], or a share of all points
    /// if only that is read. The range begins as by [`Points::begin_near`].
    ///
    /// # Errors
    /// What is wrong with the file, an error of `convert` or `sink`, or [`ScanError::Cancelled`].
    pub fn for_each_run<T: Send>(
        &self,
        points: Range<u64>,
        task: &dyn Task,
        convert: &Convert<'_, T>,
        sink: &mut dyn FnMut(T) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        if self.one_in > 1 {
            return self.for_each_sampled(self.one_in, task, convert, sink);
        }
        let file = Input::open(&self.path).map_err(|e| self.io(e))?;
        let mut reader = self.reader(file, points.start);
        let end = self.count.min(points.end);
        if let Some(c) = self.compression.as_ref().filter(|c| c.chunks.is_none()) {
            return self.stream(&mut reader, c, c.chunk_points, end, task, convert, sink);
        }
        // Pieces are decoded on the pool while this thread reads the next ones and passes earlier
        // ones to the sink.
        rayon::in_place_scope_fifo(|scope| {
            let mut spare = Vec::new();
            let (mut window, mut filled) = (VecDeque::new(), Ok(()));
            let (mut raw_bytes, group_bytes) = (0, self.group_bytes());
            loop {
                task.check()?;
                let pieces_max = PIECES_A_THREAD * rayon::current_num_threads();
                let has_room = raw_bytes as u64 <= self.window_bytes_max;
                if filled.is_ok()
                    && reader.point < end
                    && self.large_chunk(&reader).is_none()
                    && ((raw_bytes <= group_bytes && window.len() <= GROUP_PIECES)
                        || (window.len() < pieces_max && has_room))
                {
                    match self.fill(std::mem::take(&mut spare), &mut reader, end) {
                        Ok(group) => {
                            let group = Arc::new(group);
                            for (i, piece) in group.pieces.iter().enumerate() {
                                let bytes =
                                    (piece.points * self.record_bytes).max(piece.bytes.len());
                                let shared = Arc::clone(&group);
                                let decode = move || self.decode(&shared, i, convert);
                                let decoded = Ahead::begin(scope, decode);
                                raw_bytes += bytes;
                                window.push_back((bytes, Arc::clone(&group), decoded));
                            }
                        }
                        // Earlier pieces are passed on first; their errors take precedence.
                        Err(error) => filled = Err(error),
                    }
                } else if let Some((bytes, group, decoded)) = window.pop_front() {
                    // If the task has panicked, the scope panics, too.
                    for run in decoded
                        .wait()
                        .unwrap_or(Err(ScanError::Cancelled(esker_points::task::Cancelled)))?
                    {
                        sink(run)?;
                    }
                    raw_bytes -= bytes;
                    spare = Arc::into_inner(group).map_or(spare, |group| group.bytes);
                } else if let Some((compression, chunk)) = self.large_chunk(&reader)
                    && filled.is_ok()
                    && reader.point < end
                {
                    let chunk_end = end.min(reader.point + u64::from(chunk.points));
                    let behind = reader.at + u64::from(chunk.bytes);
                    self.check_large(&mut reader, compression, chunk)?;
                    self.stream(&mut reader, compression, None, chunk_end, task, convert, sink)?;
                    (reader.at, reader.chunk) = (behind, reader.chunk + 1);
                } else {
                    return filled;
                }
            }
        })
    }

    /// Number of the last point, at most `point`, at which reading can begin: that of any record,
    /// or the first of a chunk.
    pub fn begin_near(&self, point: u64) -> u64 {
        match &self.compression {
            _ if self.one_in > 1 => 0,
            None => point.min(self.count),
            Some(compression) => self.chunk_near(compression, point).2,
        }
    }

    /// The last chunk that begins at or before a point: its index, its offset, its first point.
    fn chunk_near(&self, compression: &Compression, point: u64) -> (usize, u64, u64) {
        let mut near = (0, self.start, 0);
        for chunk in compression.chunks.iter().flatten() {
            if near.2 + u64::from(chunk.points) > point {
                break;
            }
            near = (near.0 + 1, near.1 + u64::from(chunk.bytes), near.2 + u64::from(chunk.points));
        }
        near
    }

    /// A reader that begins at or before a point.
    fn reader(&self, file: Input, point: u64) -> Reader {
        let (chunk, at, point) = match &self.compression {
            None => (0, self.start + point * self.record_bytes as u64, point),
            Some(compression) => self.chunk_near(compression, point),
        };
        Reader { file, at, point, chunk }
    }

    /// Decodes a piece of a group.
    fn decode<T>(
        &self,
        group: &Group,
        piece: usize,
        convert: &Convert<'_, T>,
    ) -> Result<Vec<T>, ScanError> {
        let piece = &group.pieces[piece];
        let bytes = &group.bytes[piece.bytes.clone()];
        match &self.compression {
            None => convert(bytes).map(|run| vec![run]),
            Some(compression) => self.decode_chunk(compression, bytes, piece, convert),
        }
    }

    fn decode_chunk<T>(
        &self,
        compression: &Compression,
        bytes: &[u8],
        piece: &Piece,
        convert: &Convert<'_, T>,
    ) -> Result<Vec<T>, ScanError> {
        if let Some(layers) = compression.layers {
            self.check_layers(bytes, bytes.len() as u64, layers, piece.points as u64)?;
        }
        let mut decoder = self.decoder(compression, Cursor::new(bytes), piece.first_point)?;
        let mut runs = Vec::with_capacity(piece.points.div_ceil(self.run_points()));
        let mut records = Vec::new();
        let mut left = piece.points;
        while left > 0 {
            let points = left.min(self.run_points());
            let point = piece.first_point + (piece.points - left) as u64;
            records.resize(points * self.record_bytes, 0);
            self.guarded(point, || decoder.decompress_many(&mut records))?;
            runs.push(convert(&records)?);
            left -= points;
        }
        Ok(runs)
    }

    /// Streams points up to number `end` on this thread: one chunk, or chunks of `chunk_points`
    /// that follow each other without a table.
    #[expect(clippy::too_many_arguments, reason = "the caller's own arguments and the chunk's")]
    fn stream<T>(
        &self,
        reader: &mut Reader,
        compression: &Compression,
        chunk_points: Option<u32>,
        end: u64,
        task: &dyn Task,
        convert: &Convert<'_, T>,
        sink: &mut dyn FnMut(T) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        reader.file.seek(SeekFrom::Start(reader.at)).map_err(|e| self.io(e))?;
        let input = BufReader::with_capacity(READ_BYTES, reader.file.clone());
        let mut decoder = self.decoder(compression, input, reader.point)?;
        let chunk_points = chunk_points.filter(|&points| points > 0).map_or(u64::MAX, u64::from);
        let mut in_chunk = 0;
        let mut records = Vec::new();
        while reader.point < end {
            task.check()?;
            if in_chunk == chunk_points {
                decoder = self.decoder(compression, decoder.box_into_inner(), reader.point)?;
                in_chunk = 0;
            }
            let points = (end - reader.point).min(chunk_points - in_chunk);
            let points = points.min(self.run_points() as u64);
            records.resize(points as usize * self.record_bytes, 0);
            self.guarded(reader.point, || decoder.decompress_many(&mut records))?;
            sink(convert(&records)?)?;
            reader.point += points;
            in_chunk += points;
        }
        Ok(())
    }

    /// The next chunk, if it is too large for a group.
    fn large_chunk(&self, reader: &Reader) -> Option<(&Compression, Chunk)> {
        let compression = self.compression.as_ref()?;
        let chunk = *compression.chunks.as_ref()?.get(reader.chunk)?;
        self.is_large(chunk).then_some((compression, chunk))
    }

    pub(super) fn is_large(&self, chunk: Chunk) -> bool {
        let raw_bytes = chunk.points as usize * self.record_bytes;
        raw_bytes > CHUNK_BYTES_MAX || chunk.bytes as usize > CHUNK_BYTES_MAX
    }

    /// Compressed bytes of the largest chunk that is streamed and whose decoder needs all of them
    /// at once.
    pub fn held_bytes(&self) -> u64 {
        let layered = self.compression.iter().filter(|c| c.layers.is_some());
        let chunks = layered.filter_map(|c| c.chunks.as_ref()).flatten();
        chunks.filter(|&&c| self.is_large(c)).map(|c| c.bytes.into()).max().unwrap_or(0)
    }

    /// Checks the layers of a chunk that is streamed.
    fn check_large(
        &self,
        reader: &mut Reader,
        compression: &Compression,
        chunk: Chunk,
    ) -> Result<(), ScanError> {
        let Some(layers) = compression.layers else { return Ok(()) };
        reader.file.seek(SeekFrom::Start(reader.at)).map_err(|e| self.io(e))?;
        let mut head = Vec::new();
        let head_bytes = (self.record_bytes + 4 + 4 * layers) as u64;
        reader.file.by_ref().take(head_bytes).read_to_end(&mut head).map_err(|e| self.io(e))?;
        self.check_layers(&head, chunk.bytes.into(), layers, chunk.points.into())
    }

    /// Checks that a layered chunk has the expected number of points and that its layers lie inside
    /// it.
    pub(super) fn check_layers(
        &self,
        head: &[u8],
        bytes: u64,
        layers: usize,
        points: u64,
    ) -> Result<(), ScanError> {
        match layered_chunk(head, self.record_bytes, layers) {
            Some(claimed) if u64::from(claimed.bytes) > bytes => Err(self.damaged(format!(
                "a chunk of {bytes} bytes claims layers of {}: the compressed points are damaged",
                claimed.bytes
            ))),
            Some(claimed) if u64::from(claimed.points) < points => Err(self.damaged(format!(
                "a chunk holds {} points where {points} should be: the compressed points are damaged",
                claimed.points
            ))),
            Some(_) => Ok(()),
            None => Err(self.damaged("a chunk is shorter than its own head: the chunk table or the compressed points are damaged".into())),
        }
    }

    /// Greatest number of raw bytes in a group; its first piece may be larger.
    fn group_bytes(&self) -> usize {
        match &self.compression {
            Some(_) => GROUP_BYTES,
            // Uncompressed records are only copied, so a group that fits a cache is best.
            None => {
                let run = self.run_points() * self.record_bytes;
                let room = self.window_bytes_max as usize / 2;
                (rayon::current_num_threads() * run).min(room).max(run)
            }
        }
    }

    /// Reads the next group, at least one chunk or run, into `buffer`.
    fn fill(&self, mut buffer: Vec<u8>, reader: &mut Reader, end: u64) -> Result<Group, ScanError> {
        let mut pieces: Vec<Piece> = Vec::new();
        let (mut compressed, mut raw) = (0, 0);
        let group_bytes = self.group_bytes();
        while reader.point < end {
            let (points, bytes) = match self.compression.as_ref().and_then(|c| c.chunks.as_ref()) {
                None => {
                    let points = (end - reader.point).min(self.run_points() as u64) as usize;
                    (points, points * self.record_bytes)
                }
                // The chunks' counts add up to the file's count (`Compression::trim`).
                Some(chunks) => match chunks.get(reader.chunk) {
                    Some(c) => {
                        let points = u64::from(c.points).min(end - reader.point) as usize;
                        (points, c.bytes as usize)
                    }
                    None => break,
                },
            };
            (compressed, raw) = (compressed + bytes, raw + points * self.record_bytes);
            let is_large = self.large_chunk(reader).is_some();
            let is_full = raw.max(compressed) > group_bytes || pieces.len() >= GROUP_PIECES;
            if !pieces.is_empty() && (is_full || is_large) {
                compressed -= bytes;
                break;
            }
            let bytes = compressed - bytes..compressed;
            pieces.push(Piece { bytes, points, first_point: reader.point });
            reader.point += points as u64;
            reader.chunk += 1;
        }
        reader.file.seek(SeekFrom::Start(reader.at)).map_err(|e| self.io(e))?;
        buffer.clear();
        let read = reader.file.by_ref().take(compressed as u64).read_to_end(&mut buffer);
        if read.map_err(|e| self.io(e))? < compressed {
            return Err(self.damaged("the file was cut short while it was read".into()));
        }
        reader.at += compressed as u64;
        Ok(Group { bytes: buffer, pieces })
    }

    pub(super) fn decoder<'a, R: Read + Seek + Send + Sync + 'a>(
        &self,
        compression: &Compression,
        input: R,
        point: u64,
    ) -> Result<Decoder<'a, R>, ScanError> {
        self.guarded(point, || match compression.layers {
            Some(_) => items::layered(&compression.items, input),
            None => items::sequential(&compression.items, input),
        })
    }

    /// Runs the decoder. Its errors, and panics that damaged bytes may cause in it, become errors
    /// that name the position.
    pub(super) fn guarded<T>(
        &self,
        point: u64,
        decode: impl FnOnce() -> std::io::Result<T>,
    ) -> Result<T, ScanError> {
        let place = format!("at or after point {} of {}", point + 1, self.count);
        match caught::catch(decode) {
            Ok(Ok(done)) => Ok(done),
            Ok(Err(e)) if e.kind() == std::io::ErrorKind::UnexpectedEof => Err(self.damaged(
                format!("its compressed points end {place}: the file is cut short or damaged"),
            )),
            Ok(Err(e)) if e.kind() != std::io::ErrorKind::InvalidData => Err(self.io(e)),
            Ok(Err(_)) | Err(_) => {
                Err(self.damaged(format!("its compressed points are damaged {place}")))
            }
        }
    }

    pub(super) fn run_points(&self) -> usize {
        (RUN_BYTES / self.record_bytes).clamp(1, BATCH_POINTS)
    }

    pub(super) fn io(&self, source: std::io::Error) -> ScanError {
        ScanError::io(&self.path, source)
    }

    pub(super) fn damaged(&self, what: String) -> ScanError {
        ScanError::damaged(&self.path, what)
    }
}
