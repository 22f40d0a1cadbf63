//! Loads the rows of cells from the objects of the takes, in the order of these objects, a few
//! blocks at a time, and checks them against their checksums.

use crate::error::BuildError;
use crate::jobs::cut_file::TakenObjects;
use crate::jobs::parts::{PartCell, TakenRows};
use crate::jobs::place::Place;
use crate::rows::partition::{RowBlock, block_of_rows};
use esker_points::Task;
use rayon::prelude::*;

/// Rows of a block.
const BLOCK_ROWS: u64 = 1 << 16;

/// Reads rows.
pub struct Loading<'a> {
    pub place: &'a dyn Place,
    pub takes: &'a TakenObjects,
    /// Bytes of a row.
    pub stride: usize,
    pub task: &'a dyn Task,
}

/// Rows of a cell in a block: all of them, or some.
#[derive(Clone, Copy)]
struct Piece {
    of: TakenRows,
    /// The first row, and the number of rows.
    first: u64,
    rows: u64,
}

/// A block of rows, with the CRC-32 of each piece.
type Block = (Vec<u8>, Vec<crc32fast::Hasher>);

impl Loading<'_> {
    /// Calls `take` with the rows of cells, block by block.
    ///
    /// # Errors
    /// If rows cannot be read or are damaged; if `take` fails, or on request.
    pub fn each_block(
        &self,
        cells: &[PartCell],
        take: &mut dyn FnMut(Vec<u8>) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        self.each(cells, &|rows| rows, take)
    }

    /// Calls `take` with the rows of cells, block by block, sorted into cells of `2^log2` steps.
    ///
    /// # Errors
    /// As for [`Loading::each_block`].
    pub fn each_sorted(
        &self,
        cells: &[PartCell],
        log2: u8,
        take: &mut dyn FnMut(RowBlock) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        self.each(cells, &|rows| block_of_rows(&rows, self.stride, log2), take)
    }

    fn each<T: Send>(
        &self,
        cells: &[PartCell],
        made: &(impl Fn(Vec<u8>) -> T + Sync),
        take: &mut dyn FnMut(T) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        let blocks = blocks_of(cells);
        // Of rows that are cut across blocks.
        let mut crc = crc32fast::Hasher::new();
        for group in blocks.chunks(2 * rayon::current_num_threads()) {
            self.task.check()?;
            let read = |pieces: &Vec<Piece>| {
                let (rows, crcs) = self.read(pieces)?;
                Ok((made(rows), crcs))
            };
            let read: Vec<Result<_, BuildError>> = group.par_iter().map(read).collect();
            for (pieces, read) in group.iter().zip(read) {
                let (block, crcs) = read?;
                for (piece, of_piece) in pieces.iter().zip(crcs) {
                    crc.combine(&of_piece);
                    if piece.first + piece.rows == piece.of.rows {
                        self.takes.check(self.place, &piece.of, &mut crc)?;
                    }
                }
                take(block)?;
            }
        }
        Ok(())
    }

    fn read(&self, pieces: &[Piece]) -> Result<Block, BuildError> {
        let stride = self.stride as u64;
        let rows: u64 = pieces.iter().map(|piece| piece.rows).sum();
        let mut block = vec![0; (rows * stride) as usize];
        let (mut at, mut crcs) = (0, Vec::with_capacity(pieces.len()));
        // Rows that follow each other in an object are read together.
        let follows = |a: &Piece, b: &Piece| {
            a.of.take == b.of.take
                && a.of.offset.saturating_add((a.first + a.rows).saturating_mul(stride))
                    == b.of.offset.saturating_add(b.first.saturating_mul(stride))
        };
        for run in pieces.chunk_by(follows) {
            let bytes = run.iter().map(|piece| piece.rows * stride).sum::<u64>() as usize;
            let into = &mut block[at..at + bytes];
            let offset = run[0].of.offset.saturating_add(run[0].first.saturating_mul(stride));
            self.takes.read(self.place, run[0].of.take, offset, into)?;
            for piece in run {
                let bytes = (piece.rows * stride) as usize;
                let mut crc = crc32fast::Hasher::new();
                crc.update(&block[at..at + bytes]);
                crcs.push(crc);
                at += bytes;
            }
        }
        Ok((block, crcs))
    }
}

/// Cuts the rows of cells, in the order of the objects, into blocks of [`BLOCK_ROWS`] rows.
fn blocks_of(cells: &[PartCell]) -> Vec<Vec<Piece>> {
    let mut all: Vec<TakenRows> = cells.iter().flat_map(|cell| cell.rows.iter().copied()).collect();
    all.sort_unstable_by_key(|rows| (rows.take, rows.offset));
    let (mut blocks, mut block, mut room) = (Vec::new(), Vec::new(), BLOCK_ROWS);
    for of in all.into_iter().filter(|rows| rows.rows > 0) {
        let mut first = 0;
        while first < of.rows {
            let rows = room.min(of.rows - first);
            block.push(Piece { of, first, rows });
            (first, room) = (first + rows, room - rows);
            if room == 0 {
                blocks.push(std::mem::take(&mut block));
                room = BLOCK_ROWS;
            }
        }
    }
    blocks.extend((!block.is_empty()).then_some(block));
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::Cell;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn blocks_hold_every_row_once_in_the_order_of_the_objects(counts in prop::collection::vec((0u32..3, 0u64..200_000), 0..20)) {
            let mut ends = [0u64; 3];
            let cells: Vec<PartCell> = counts.iter().map(|&(take, rows)| {
                let offset = ends[take as usize];
                ends[take as usize] += rows;
                let cell = Cell { corner: [0; 3], log2: 0 };
                PartCell { cell, rows: vec![TakenRows { take, crc: 0, offset, rows }] }
            }).collect();
            let blocks = blocks_of(&cells);
            let sizes: Vec<u64> =
                blocks.iter().map(|block| block.iter().map(|piece| piece.rows).sum()).collect();
            prop_assert!(sizes.iter().rev().skip(1).all(|&rows| rows == BLOCK_ROWS));
            prop_assert!(sizes.iter().all(|rows| (1..=BLOCK_ROWS).contains(rows)));
            // A stride of one: offsets count rows.
            let mut next = [0u64; 3];
            for piece in blocks.iter().flatten() {
                let at = &mut next[piece.of.take as usize];
                prop_assert_eq!(piece.of.offset + piece.first, *at);
                *at += piece.rows;
            }
            prop_assert_eq!(next, ends);
        }
    }
}
