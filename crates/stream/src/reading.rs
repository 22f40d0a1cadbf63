//! Reads a batch into lent runs: planes are split into pieces, pieces that are close in the file
//! are joined into one read, and reads fill runs one after another. Bytes that were read are landed
//! as transfers. Failures are reported after the runs have landed, so that the next owner of a slot
//! writes to it last.

use crate::batch::{Batch, GAP_BYTES_MAX};
use crate::landing::{Landing, Run, Slot, Transfer};
use crate::planes::{LoadRequest, Planes};
use esker_format::PlaneKind;
use std::collections::HashMap;
use std::ops::Range;

/// Reason why a run takes no bytes.
const NO_ROOM: &str = "the memory that was lent for it is gone";

/// A part of a plane that fits into a run.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Piece {
    /// Index of the request in the batch.
    request: usize,
    kind: PlaneKind,
    slot: Slot,
    slot_offset: u64,
    /// Byte range in the file, or in the decoded copy of a cold plane.
    place: Range<u64>,
}

/// Pieces that one call reads.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Read {
    place: Range<u64>,
    pieces: Vec<Piece>,
}

/// Result of reading a batch.
#[derive(Debug, Default)]
pub(crate) struct Outcome {
    /// Requests that could not be read.
    pub(crate) failed: Vec<u64>,
    /// Reason of the first failure.
    pub(crate) fault: Option<String>,
    /// Bytes read.
    pub(crate) read_bytes: u64,
    /// Bytes read that belong to requested planes.
    pub(crate) useful_bytes: u64,
    /// Number of read calls.
    pub(crate) reads: u64,
}

/// Reads batches for one loader.
pub(crate) struct Reading<'a, L: Landing> {
    pub(crate) planes: &'a Planes,
    pub(crate) landing: &'a L,
    /// Lends a run, waiting for one; `None` once streaming stops.
    pub(crate) lend: &'a dyn Fn() -> Option<L::Run>,
}

/// A run that is being filled.
struct Filling<R> {
    run: R,
    at: usize,
    transfers: Vec<Transfer>,
}

impl<L: Landing> Reading<'_, L> {
    /// Reads the planes of a batch, beginning in `run`, and lands them. `None` once streaming
    /// stops.
    pub(crate) fn read(&self, batch: &Batch, run: L::Run) -> Option<Outcome> {
        let mut outcome = Outcome::default();
        let mut filling = Filling { run, at: 0, transfers: Vec::new() };
        let mut left = HashMap::new();
        let reads = self.hot_reads(batch, &mut left);
        if self.planes.forest.readers().is_some() {
            let places = reads.iter().map(|read| read.place.clone());
            self.planes.forest.will_read(&places.collect::<Vec<_>>());
        }
        for read in &reads {
            filling = self.read_hot(batch, read, filling, &mut left, &mut outcome)?;
        }
        for (index, request) in batch.iter().enumerate() {
            for &(kind, slot) in &request.planes {
                if self.planes.in_file(request.node, kind).is_none() {
                    let cold = ColdPlane { index, request, kind, slot };
                    filling = self.read_cold(batch, cold, filling, &mut left, &mut outcome)?;
                }
            }
        }
        self.landing.land(filling.run, filling.transfers);
        Some(outcome)
    }

    /// Plans the reads of all planes whose byte range is known. Counts the pieces of each request
    /// in `left`, a cold plane as one.
    fn hot_reads(&self, batch: &Batch, left: &mut HashMap<u64, usize>) -> Vec<Read> {
        let run_bytes = self.landing.run_bytes() as u64;
        let mut pieces = Vec::new();
        for (index, request) in batch.iter().enumerate() {
            let before = pieces.len();
            let mut cold = 0;
            for &(kind, slot) in &request.planes {
                match self.planes.in_file(request.node, kind) {
                    Some(place) => pieces.extend(split(index, kind, slot, place, run_bytes)),
                    None => cold += 1,
                }
            }
            left.insert(request.id, pieces.len() - before + cold);
        }
        pieces.sort_by_key(|p| p.place.start);
        joined(pieces, run_bytes)
    }

    /// Makes one read and notes its pieces as transfers.
    fn read_hot(
        &self,
        batch: &Batch,
        read: &Read,
        filling: Filling<L::Run>,
        left: &mut HashMap<u64, usize>,
        outcome: &mut Outcome,
    ) -> Option<Filling<L::Run>> {
        let bytes = (read.place.end - read.place.start) as usize;
        let mut filling = self.room(filling, bytes)?;
        let at = filling.at;
        let read_into =
            |buffer: &mut [u8]| self.planes.forest.read_exact_at(buffer, read.place.start);
        let done = match filling.run.fill(at..at + bytes, read_into) {
            Some(done) => done
                .map_err(|e| format!("{e}; it is tried again, check the disk or the connection")),
            None => Err(NO_ROOM.into()),
        };
        outcome.reads += 1;
        if let Err(fault) = done {
            outcome.fault.get_or_insert(fault);
            read.pieces.iter().for_each(|p| fail(&batch[p.request], &mut filling, outcome));
            return Some(filling);
        }
        outcome.read_bytes += bytes as u64;
        filling.at += bytes.next_multiple_of(Transfer::ALIGNMENT);
        for piece in &read.pieces {
            outcome.useful_bytes += piece.place.end - piece.place.start;
            let run_offset = at + (piece.place.start - read.place.start) as usize;
            filling.transfer(&batch[piece.request], piece, run_offset, left, outcome);
        }
        Some(filling)
    }

    /// Reads a cold plane, which is verified and decoded on the way, and copies it into runs.
    fn read_cold(
        &self,
        batch: &Batch,
        cold: ColdPlane<'_>,
        mut filling: Filling<L::Run>,
        left: &mut HashMap<u64, usize>,
        outcome: &mut Outcome,
    ) -> Option<Filling<L::Run>> {
        let ColdPlane { index, request, kind, slot } = cold;
        outcome.reads += 1;
        let copy = match cold_plane(self.planes, request.node, kind, slot.bytes) {
            Ok(copy) => copy,
            Err(fault) => {
                outcome.fault.get_or_insert(fault);
                fail(request, &mut filling, outcome);
                return Some(filling);
            }
        };
        outcome.read_bytes += slot.bytes;
        outcome.useful_bytes += slot.bytes;
        let parts: Vec<_> =
            split(index, kind, slot, 0..slot.bytes, self.landing.run_bytes() as u64).collect();
        // The plane was counted as one piece.
        *left.entry(request.id).or_default() += parts.len() - 1;
        for part in &parts {
            let bytes = (part.place.end - part.place.start) as usize;
            filling = self.room(filling, bytes)?;
            let at = filling.at;
            let part_bytes = &copy[part.place.start as usize..part.place.end as usize];
            if filling.run.fill(at..at + bytes, |b| b.copy_from_slice(part_bytes)).is_none() {
                outcome.fault.get_or_insert(NO_ROOM.into());
                fail(request, &mut filling, outcome);
                return Some(filling);
            }
            filling.at += bytes.next_multiple_of(Transfer::ALIGNMENT);
            filling.transfer(&batch[index], part, at, left, outcome);
        }
        Some(filling)
    }

    /// Returns a run with room for `bytes`: this run, or a new one after landing this run.
    fn room(&self, filling: Filling<L::Run>, bytes: usize) -> Option<Filling<L::Run>> {
        if filling.at == 0 || filling.at + bytes <= self.landing.run_bytes() {
            return Some(filling);
        }
        self.landing.land(filling.run, filling.transfers);
        let run = (self.lend)()?;
        Some(Filling { run, at: 0, transfers: Vec::new() })
    }
}

/// A cold plane of a request.
struct ColdPlane<'a> {
    index: usize,
    request: &'a LoadRequest,
    kind: PlaneKind,
    slot: Slot,
}

impl<R> Filling<R> {
    /// Notes a piece that is in the run; the last piece of a request carries the request's id.
    fn transfer(
        &mut self,
        request: &LoadRequest,
        piece: &Piece,
        run_offset: usize,
        left: &mut HashMap<u64, usize>,
        outcome: &Outcome,
    ) {
        if outcome.failed.contains(&request.id) {
            return;
        }
        let left = left.entry(request.id).or_default();
        *left = left.saturating_sub(1);
        self.transfers.push(Transfer {
            node: request.node,
            plane: piece.kind,
            run_offset,
            bytes: (piece.place.end - piece.place.start) as usize,
            slot: piece.slot,
            slot_offset: piece.slot_offset,
            request: (*left == 0).then_some(request.id),
        });
    }
}

/// Marks a request as failed and removes those of its transfers that have not landed.
fn fail<R>(request: &LoadRequest, filling: &mut Filling<R>, outcome: &mut Outcome) {
    if !outcome.failed.contains(&request.id) {
        outcome.failed.push(request.id);
        let slots = request.planes.iter().map(|&(_, slot)| slot).collect::<Vec<_>>();
        filling.transfers.retain(|t| !slots.contains(&t.slot));
    }
}

/// Splits a plane into parts of at most `run_bytes`; an empty plane gives one empty part.
fn split(
    request: usize,
    kind: PlaneKind,
    slot: Slot,
    place: Range<u64>,
    run_bytes: u64,
) -> impl Iterator<Item = Piece> {
    let bytes = place.end - place.start;
    (0..bytes.div_ceil(run_bytes).max(1)).map(move |part| {
        let slot_offset = part * run_bytes;
        let end = bytes.min(slot_offset + run_bytes);
        let place = place.start + slot_offset..place.start + end;
        Piece { request, kind, slot, slot_offset, place }
    })
}

/// Joins pieces, given in the order of the file, into reads of at most `run_bytes`.
fn joined(pieces: Vec<Piece>, run_bytes: u64) -> Vec<Read> {
    let mut reads: Vec<Read> = Vec::new();
    for piece in pieces {
        let end = piece.place.end;
        match reads.last_mut() {
            Some(read)
                if piece.place.start >= read.place.end
                    && piece.place.start - read.place.end <= GAP_BYTES_MAX
                    && end - read.place.start <= run_bytes =>
            {
                read.place.end = end;
                read.pieces.push(piece);
            }
            _ => reads.push(Read { place: piece.place.clone(), pieces: vec![piece] }),
        }
    }
    reads
}

/// Reads and decodes a cold plane.
fn cold_plane(planes: &Planes, node: u32, kind: PlaneKind, bytes: u64) -> Result<Vec<u8>, String> {
    let Planes { forest, filter, .. } = planes;
    let planes = filter.read(forest, node, &[kind]).map_err(|e| e.to_string())?;
    match planes.get(kind) {
        Some(plane) if plane.len() as u64 == bytes => Ok(plane.to_vec()),
        _ => {
            let (file, index) = (forest.file_of(node), forest.name_of(node).index);
            let (path, index) = (file.path(), file.table().index_in_file(index));
            Err(format!("{}: node {index} has no whole plane {kind:?}", path.display()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn reads_hold_every_requested_byte_and_few_others(
            lengths in prop::collection::vec((0u64..300_000, 0u64..100_000), 1..40),
            run_bytes in (64u64..4000).prop_map(|n| n * 64),
        ) {
            let (mut at, mut pieces, mut requested) = (64, Vec::new(), 0);
            for (i, &(gap, bytes)) in lengths.iter().enumerate() {
                at = (at + gap).next_multiple_of(64);
                let slot = Slot { offset: at, bytes };
                pieces.extend(split(i, PlaneKind::Colour, slot, at..at + bytes, run_bytes));
                requested += bytes;
                at += bytes;
            }
            let parts = pieces.len();
            let reads = joined(pieces, run_bytes);
            prop_assert_eq!(reads.iter().map(|r| r.pieces.len()).sum::<usize>(), parts);
            let mut covered = vec![0; lengths.len()];
            for read in &reads {
                prop_assert!(read.place.end - read.place.start <= run_bytes);
                let mut end = read.place.start;
                for piece in &read.pieces {
                    prop_assert!(piece.place.start >= end && piece.place.start - end <= GAP_BYTES_MAX);
                    prop_assert!(piece.place.end <= read.place.end);
                    // Parts come in order, each where the previous one ended.
                    prop_assert_eq!(piece.slot_offset, covered[piece.request]);
                    prop_assert_eq!(piece.place.start, piece.slot.offset + piece.slot_offset);
                    covered[piece.request] += piece.place.end - piece.place.start;
                    end = piece.place.end;
                }
            }
            prop_assert!(covered.iter().zip(&lengths).all(|(c, l)| *c == l.1));
            prop_assert_eq!(covered.iter().sum::<u64>(), requested);
        }
    }
}
