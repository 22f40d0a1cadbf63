//! The decoder of a LASzip record, one part for each of its items. The parts are those of `laz`,
//! but for the two that decode GPS times: there, `laz` calls itself as often as the data say, and
//! damaged data end the stack.

mod gps_time;
mod median;
mod point14;

use gps_time::GpsTimeItem;
use laz::record::{
    LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor,
};
use laz::{DecompressionSelection, LazItem, LazItemType};
use point14::Point14;
use std::io::{self, Read, Seek};

/// A decoder of records.
pub type Decoder<'a, R> = Box<dyn RecordDecompressor<R> + 'a>;

/// Decoder of one layered chunk of records of these items.
///
/// # Errors
/// If an item has no layered form.
pub fn layered<'a, R: Read + Seek + Send + Sync + 'a>(
    items: &[LazItem],
    input: R,
) -> io::Result<Decoder<'a, R>> {
    let mut decoder = LayeredPointRecordDecompressor::new(input);
    for item in items {
        match item.item_type() {
            LazItemType::Point14 => decoder.add_field_decompressor(Point14::new(item.version())),
            _ => decoder.set_fields_from(&vec![*item]).map_err(io::Error::other)?,
        }
    }
    decoder.set_selection(DecompressionSelection::all());
    Ok(Box::new(decoder))
}

/// Decoder of records of these items that are compressed one after the other; it is at the
/// beginning of a chunk.
///
/// # Errors
/// If an item has only a layered form.
pub fn sequential<'a, R: Read + Seek + Send + Sync + 'a>(
    items: &[LazItem],
    input: R,
) -> io::Result<Decoder<'a, R>> {
    let mut decoder = SequentialPointRecordDecompressor::new(input);
    for item in items {
        match (item.item_type(), item.version()) {
            (LazItemType::GpsTime, 2) => decoder.add_field_decompressor(GpsTimeItem::default()),
            _ => decoder.set_fields_from(&vec![*item]).map_err(io::Error::other)?,
        }
    }
    Ok(Box::new(decoder))
}

#[cfg(test)]
mod tests;
