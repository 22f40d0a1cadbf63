//! Order of the points of a batch in LAZ. LAZ stores differences to the previous point, so
//! neighbours in time, or without times in space, take fewer bytes than the evenly spread samples
//! in which nodes keep their points. The order of points has no meaning in Esker or LAS.
//!
//! `laz` compares the GPS times of point formats 6 to 10 as numbers: it takes -0 for no change
//! after 0, but predicts from -0 then, and all later times of the chunk come out wrong. -0 is
//! therefore written as 0.

use super::records::Records;
use crate::write::encode::{Encode, Encoded};
use esker_points::attribute::names;
use esker_points::morton::encode3;
use esker_points::{AttrType, Batch};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of the GPS time in records of point formats 6 to 10.
const TIME: std::ops::Range<usize> = 22..30;

/// Encodes records in an order that compresses well.
pub struct Ordered {
    /// Layout of the records.
    pub records: Records,
    /// Number of GPS times of -0, which are written as 0.
    pub negative_zeros: Arc<AtomicU64>,
}

impl Encode for Ordered {
    fn encode(&self, batch: &Batch) -> Encoded {
        let mut out = self.records.encode(batch);
        let stride = self.records.record_bytes;
        if self.records.point_format >= 6 {
            let mut count = 0;
            for record in out.bytes.chunks_exact_mut(stride) {
                let time = &mut record[TIME];
                if *time == (-0.0_f64).to_le_bytes() {
                    time.fill(0);
                    count += 1;
                }
            }
            self.negative_zeros.fetch_add(count, Ordering::Relaxed);
        }
        let mut bytes = Vec::with_capacity(out.bytes.len());
        for i in order(batch) {
            bytes.extend_from_slice(&out.bytes[i as usize * stride..][..stride]);
        }
        out.bytes = bytes;
        out
    }
}

/// Indices of the points by time, else along a Morton curve; the sort is stable.
fn order(batch: &Batch) -> Vec<u32> {
    let time = batch.schema.find_typed(names::GPS_TIME, AttrType::F64);
    let times = time.map_or(&[][..], |a| &batch.columns[a]).chunks_exact(8);
    let bits = times.map(|t| u64::from_le_bytes(t.try_into().unwrap_or([0; 8])));
    // Integers that sort as the times do.
    let mut keys: Vec<(u128, u32)> = bits
        .zip(0..)
        .map(|(bits, i)| (if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }.into(), i))
        .collect();
    if keys.iter().all(|(key, _)| *key == keys[0].0) {
        keys = batch.positions.iter().zip(0..).map(|(&p, i)| (encode3(p), i)).collect();
    }
    keys.sort_unstable();
    keys.into_iter().map(|(_, i)| i).collect()
}
