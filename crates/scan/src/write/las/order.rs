//! Order of the points of a batch in LAZ. LAZ stores differences to the previous point, so
//! neighbours in time, or without times in space, take fewer bytes than the evenly spread samples
//! in which nodes keep their points. The order of points has no meaning in Esker or LAS.

use super::records::Records;
use crate::write::encode::{Encode, Encoded};
use esker_points::attribute::names;
use esker_points::morton::encode3;
use esker_points::{AttrType, Batch};

/// Encodes records in an order that compresses well.
pub struct Ordered(pub Records);

impl Encode for Ordered {
    fn encode(&self, batch: &Batch) -> Encoded {
        let mut out = self.0.encode(batch);
        let stride = self.0.record_bytes;
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
