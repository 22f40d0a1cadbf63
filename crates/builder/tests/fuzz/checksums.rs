//! Makes the checksums of mutated files right again, so that mutations reach what lies behind them.

use super::target::Reader;

/// Makes the checksums right, of formats that have them.
pub fn seal(reader: Reader, bytes: &mut Vec<u8>) {
    match reader {
        Reader::E57 => seal_e57(bytes),
        Reader::Esker => seal_esker(bytes),
        _ => {}
    }
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    bytes.get(at..at.checked_add(4)?).map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize)
}

fn u64_at(bytes: &[u8], at: usize) -> Option<usize> {
    bytes.get(at..at.checked_add(8)?).map(|b| u64::from_le_bytes(b.try_into().unwrap()) as usize)
}

/// Sets the length in the header and the CRC-32C at the end of each page of 1,024 bytes.
fn seal_e57(bytes: &mut Vec<u8>) {
    const PAGE: usize = 1024;
    bytes.resize(bytes.len().max(1).next_multiple_of(PAGE), 0);
    let length = bytes.len() as u64;
    bytes[16..24].copy_from_slice(&length.to_le_bytes());
    for page in bytes.chunks_exact_mut(PAGE) {
        let (content, crc) = page.split_at_mut(PAGE - 4);
        crc.copy_from_slice(&crc32c(content).to_be_bytes());
    }
}

fn crc32c(bytes: &[u8]) -> u32 {
    let step = |crc: u32, &byte: &u8| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            crc >> 1 ^ (0x82f6_3b78 & (crc & 1).wrapping_neg())
        })
    };
    !bytes.iter().fold(!0, step)
}

/// Bytes of the footer of an `.esker` file, of a record of its table.
const FOOTER: usize = 192;
const NODE: usize = 144;

/// Seals directories, planes, sections and footer, as far as they are found.
fn seal_esker(bytes: &mut [u8]) {
    let Some(at) = bytes.len().checked_sub(FOOTER) else { return };
    let sections: Vec<(usize, usize)> = (0..4)
        .filter_map(|i| Some((u64_at(bytes, at + 64 + 24 * i)?, u64_at(bytes, at + 72 + 24 * i)?)))
        .collect();
    let [(table, table_bytes), ..] = sections[..] else { return };
    let nodes = table_bytes.min(bytes.len()) / NODE;
    for node in 0..nodes {
        let record = table.saturating_add(node * NODE);
        let (Some(page_bytes), Some(offset)) =
            (u32_at(bytes, record.saturating_add(132)), u64_at(bytes, record.saturating_add(136)))
        else {
            break;
        };
        let end = offset.saturating_add(page_bytes).min(bytes.len());
        if let Some(page) = bytes.get_mut(offset..end) {
            let _ = seal_page(page);
        }
    }
    for (i, (offset, length)) in sections.into_iter().enumerate() {
        let section = bytes.get(offset..offset.saturating_add(length));
        if let Some(crc) = section.map(crc32fast::hash) {
            bytes[at + 80 + 24 * i..][..4].copy_from_slice(&crc.to_le_bytes());
        }
    }
    let length = bytes.len() as u64;
    bytes[at + 160..][..8].copy_from_slice(&length.to_le_bytes());
    let crc = crc32fast::hash(&bytes[at..at + FOOTER - 4]);
    bytes[at + FOOTER - 4..].copy_from_slice(&crc.to_le_bytes());
}

fn seal_page(page: &mut [u8]) -> Option<()> {
    let count = u32_at(page, 8)? & 0xffff;
    let end = 12 + 20 * count;
    for entry in (12..end).step_by(20) {
        let (offset, length) = (u32_at(page, entry + 8)?, u32_at(page, entry + 12)?);
        if let Some(plane) = page.get(offset..offset + length) {
            let crc = crc32fast::hash(plane).to_le_bytes();
            page.get_mut(entry + 16..entry + 20)?.copy_from_slice(&crc);
        }
    }
    let crc = crc32fast::hash(page.get(..end)?);
    page.get_mut(end..end + 4)?.copy_from_slice(&crc.to_le_bytes());
    Some(())
}
