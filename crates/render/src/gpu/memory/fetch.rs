//! Reads node planes back from GPU memory, for light: the CPU keeps no copy of planes that loaders
//! write there. In: a pool and the addresses of planes. Out: their bytes.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::{Gpu, readback};
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::table::PlaneAt;
use wgpu::BufferUsages;

/// Bytes that are read at a time, which bounds the memory that the host maps.
const STAGED_BYTES: u64 = 32 << 20;
/// Divisor of the sizes of copies, bytes.
const COPY_STEP: u64 = 4;

/// Reads planes and waits for them, in the order of `planes`. Planes without a place in the pool
/// ([`NodePool::place`]) are empty. What was written to the pool must have been submitted.
///
/// # Errors
/// If memory is refused or the device is lost.
pub fn read_planes(
    gpu: &Gpu,
    pool: &NodePool,
    planes: &[PlaneAt],
) -> Result<Vec<Vec<u8>>, GpuError> {
    let mut read = Vec::with_capacity(planes.len());
    let mut rest = planes;
    while !rest.is_empty() {
        let mut bytes = 0;
        let fits = |plane: &&PlaneAt| {
            bytes += plane.bytes.next_multiple_of(COPY_STEP);
            bytes <= STAGED_BYTES
        };
        let count = rest.iter().take_while(fits).count().max(1);
        let (group, others) = rest.split_at(count);
        read_group(gpu, pool, group, &mut read)?;
        rest = others;
    }
    Ok(read)
}

/// Reads planes through one buffer.
fn read_group(
    gpu: &Gpu,
    pool: &NodePool,
    planes: &[PlaneAt],
    read: &mut Vec<Vec<u8>>,
) -> Result<(), GpuError> {
    let taken = |plane: &PlaneAt| {
        let (page, word) = pool.place(*plane)?;
        let start = u64::from(word) * COPY_STEP;
        Some((pool.page(page as usize)?, start, plane.bytes.next_multiple_of(COPY_STEP)))
    };
    let total = planes.iter().filter_map(taken).map(|(_, _, bytes)| bytes).sum();
    let usage = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
    let staged = gpu.buffer("planes read back", total, usage)?;
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut at = 0;
    for (page, start, bytes) in planes.iter().filter_map(taken).filter(|taken| taken.2 > 0) {
        encoder.copy_buffer_to_buffer(page, start, &staged, at, bytes);
        at += bytes;
    }
    gpu.queue.submit([encoder.finish()]);
    let all = if total > 0 { readback::read(gpu, &[(&staged, total)])? } else { Vec::new() };
    let mut left = all.first().map_or(&[][..], Vec::as_slice);
    for plane in planes {
        let bytes = taken(plane).map_or(0, |(_, _, bytes)| bytes as usize);
        let (own, others) = left.split_at(bytes);
        read.push(own[..(plane.bytes as usize).min(bytes)].to_vec());
        left = others;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::testing::gpus;

    #[test]
    fn planes_are_read_as_they_were_written_and_unwritten_ones_are_empty() {
        for gpu in gpus() {
            let mut pool = NodePool::with_pages(&gpu, 1 << 20, 64 << 10);
            let bytes = |seed: u32, count: u32| -> Vec<u8> {
                (0..count).map(|i| (i * 7 + seed) as u8).collect()
            };
            let planes = [(0u64, 4096u32), ((64 << 10) + 256, 333), (1024 * 17, 1), (8192, 0)];
            for (i, &(offset, count)) in planes.iter().enumerate() {
                pool.write(&gpu, offset, &bytes(i as u32, count)).unwrap();
            }
            let at = |(offset, bytes): (u64, u32)| PlaneAt { offset, bytes: bytes.into() };
            let mut wanted: Vec<PlaneAt> = planes.into_iter().map(at).collect();
            wanted.insert(1, PlaneAt { offset: 512 << 10, bytes: 64 });
            wanted.push(PlaneAt { offset: u64::MAX, bytes: 64 });
            let read = read_planes(&gpu, &pool, &wanted).unwrap();
            let want = [bytes(0, 4096), vec![], bytes(1, 333), bytes(2, 1), vec![], vec![]];
            assert_eq!(read, want);
            assert_eq!(read_planes(&gpu, &pool, &[]).unwrap(), Vec::<Vec<u8>>::new());
            assert_eq!(gpu.fault(), None);
        }
    }
}
