//! Mutations of `.esker` files whose checksums are made right again, so that they reach the rules
//! behind them: other tokens in the metadata, other numbers in tables, pages and statistics.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_format::Footer;
use esker_format::footer::{FOOTER_BYTES, Section};
use esker_points::Node;
use std::ops::Range;

/// A sequence of numbers that looks random, the same in each run.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32) as usize % end.max(1)
    }

    fn of<'a>(&mut self, list: &[&'a str]) -> &'a str {
        list[self.below(list.len())]
    }
}

/// Texts that are put in place of tokens.
const TOKENS: [&str; 52] = [
    "null",
    "true",
    "false",
    "0",
    "1",
    "-1",
    "2",
    "10",
    "255",
    "256",
    "65535",
    "65536",
    "4294967296",
    "18446744073709551615",
    "18446744073709551616",
    "-9223372036854775809",
    "123456789012345678901234",
    "18014398509481984",
    "18014398509481985",
    "-0",
    "-0.0",
    "0.0",
    "1.0",
    "1e2",
    "1.5",
    "1e308",
    "1e400",
    "5e-324",
    "1e-320",
    "NaN",
    "Infinity",
    "-Infinity",
    "\"NaN\"",
    "\"inf\"",
    "\"-inf\"",
    "\"+inf\"",
    "\"infinity\"",
    "\"1.5\"",
    "\"\"",
    "\"x\"",
    "\"u8\"",
    "\"sixteen\"",
    "\"\\ud800\"",
    "\"\\ud83d\\ude00\"",
    "\"\\u00e9\"",
    "\"a\\qb\"",
    "[]",
    "{}",
    "[[]]",
    "{\"u8\":null}",
    "[0,0,0]",
    "01",
];

/// Members that are inserted.
const MEMBERS: [&str; 14] = [
    "\"unknown\":1e400,",
    "\"unknown\":\"\\ud800\",",
    "\"\\ud800\":0,",
    "\"unknown\":NaN,",
    "\"unknown\":[-0,{\"unknown\":{}}],",
    "\"factor\":[1,1,1e9],",
    "\"factor\":1e400,",
    "\"class\":0,",
    "\"points\":1,",
    "\"palette\":null,",
    "\"palette\":[[1,2,3],[255,0,0]],",
    "\"palette\":[],",
    "\"kind\":10,",
    "\"description\":\"twice\",",
];

/// A mutation of `good`, valid but for what was changed.
pub fn mutate(good: &[u8], random: &mut Random) -> Vec<u8> {
    let footer = footer_of(good);
    let mut bytes = good.to_vec();
    let section = |s: &Section| s.offset as usize..(s.offset + s.bytes) as usize;
    match random.below(10) {
        0..4 => return with_metadata(good, random),
        4 | 5 => change(&mut bytes, section(&footer.table), random),
        6 => change(&mut bytes, section(&footer.statistics), random),
        7 => change_footer(&mut bytes, footer, random),
        _ => change(&mut bytes, 64..footer.table.offset as usize, random),
    }
    seal(&mut bytes);
    bytes
}

fn footer_of(bytes: &[u8]) -> Footer {
    Footer::decode(bytes[bytes.len() - FOOTER_BYTES..].try_into().unwrap()).unwrap()
}

/// Sets a number of 1 to 8 bytes to an extreme, a neighbour of its value, or anything.
fn change(bytes: &mut [u8], range: Range<usize>, random: &mut Random) {
    if range.is_empty() {
        return;
    }
    let size = 1 << random.below(4);
    // Most fields are aligned to their size.
    let at = range.start + random.below(range.len()) / size * size;
    let Some(field) = bytes.get_mut(at..at + size) else { return };
    let mut word = [0; 8];
    word[..size].copy_from_slice(field);
    let value = u64::from_le_bytes(word);
    let value = match random.below(8) {
        0 => 0,
        1 => u64::MAX,
        2 => value.wrapping_add(1),
        3 => value.wrapping_sub(1),
        4 => value ^ 1 << random.below(8 * size),
        5 => 1 << (8 * size - 1),
        6 => f64::NAN.to_bits() >> (64 - 8 * size),
        _ => random.below(usize::MAX) as u64,
    };
    field.copy_from_slice(&value.to_le_bytes()[..size]);
}

fn change_footer(bytes: &mut [u8], mut footer: Footer, random: &mut Random) {
    match random.below(7) {
        6 => footer.version ^= 3,
        0 => footer.points = footer.points.wrapping_add(1),
        1 => footer.hash.0 ^= 1,
        2 => footer.rounding_error_max = [-0.0, f64::NAN, f64::INFINITY, 0.0][random.below(4)],
        3 => footer.node_capacity ^= 1,
        4 => footer.nodes = footer.nodes.wrapping_sub(1),
        _ => footer.verbatim.bytes = footer.verbatim.bytes.wrapping_add(1),
    }
    let at = bytes.len() - FOOTER_BYTES;
    bytes[at..].copy_from_slice(&footer.encode());
}

/// The file with other tokens in its metadata.
fn with_metadata(good: &[u8], random: &mut Random) -> Vec<u8> {
    let mut footer = footer_of(good);
    let start = footer.metadata.offset as usize;
    let end = start + footer.metadata.bytes as usize;
    let mut json = String::from_utf8(good[start..end].to_vec()).unwrap();
    for _ in 0..=random.below(2) {
        change_token(&mut json, random);
    }
    let mut bytes = good[..start].to_vec();
    bytes.extend_from_slice(json.as_bytes());
    if random.below(40) == 0 {
        // No longer UTF-8, or a byte order mark.
        let at = start + random.below(json.len());
        bytes[at] = 0xff;
    }
    bytes.extend_from_slice(&good[end..good.len() - FOOTER_BYTES]);
    footer.verbatim.offset = (start + json.len()) as u64;
    footer.metadata.bytes = json.len() as u64;
    footer.file_bytes = (bytes.len() + FOOTER_BYTES) as u64;
    bytes.extend_from_slice(&footer.encode());
    seal(&mut bytes);
    bytes
}

fn change_token(json: &mut String, random: &mut Random) {
    let tokens = tokens(json);
    let token = tokens[random.below(tokens.len())].clone();
    match random.below(10) {
        0 => json.replace_range(token, ""),
        1 => {
            let twice = json[token.clone()].to_owned();
            json.insert_str(token.end, &format!(",{twice}"));
        }
        2 => {
            let other = json[tokens[random.below(tokens.len())].clone()].to_owned();
            json.replace_range(token, &other);
        }
        3 | 4 => {
            let objects: Vec<_> = tokens.iter().filter(|t| &json[(*t).clone()] == "{").collect();
            let at = objects[random.below(objects.len())].end;
            json.insert_str(at, random.of(&MEMBERS));
        }
        5 => {
            // Nesting about the bound.
            let depth = 97 + random.below(6);
            let (open, close) = ("[".repeat(depth), "]".repeat(depth));
            json.insert_str(1, &format!("\"deep\":{open}{close},"));
        }
        _ => {
            let values = tokens.iter().filter(|t| !"[]{},:".contains(&json[(*t).clone()]));
            let values: Vec<_> = values.cloned().collect();
            let value = values[random.below(values.len())].clone();
            json.replace_range(value, random.of(&TOKENS));
        }
    }
}

/// Ranges of the tokens of a JSON text.
fn tokens(json: &str) -> Vec<Range<usize>> {
    let (bytes, mut tokens, mut at) = (json.as_bytes(), Vec::new(), 0);
    while at < bytes.len() {
        let start = at;
        at += 1;
        match bytes[start] {
            b' ' => continue,
            b'"' => {
                while at < bytes.len() && bytes[at] != b'"' {
                    at += 1 + usize::from(bytes[at] == b'\\');
                }
                at += 1;
            }
            b'[' | b']' | b'{' | b'}' | b',' | b':' => {}
            _ => {
                while at < bytes.len() && !b"[]{},: \"".contains(&bytes[at]) {
                    at += 1;
                }
            }
        }
        tokens.push(start..at.min(bytes.len()));
    }
    tokens
}

/// Makes the checksums right again, as far as what they cover can be found.
fn seal(bytes: &mut [u8]) {
    let mut footer = footer_of(bytes);
    let table = footer.table.offset as usize..(footer.table.offset + footer.table.bytes) as usize;
    if let Some(table) = bytes.get(table) {
        let nodes: Vec<Node> =
            table.chunks_exact(size_of::<Node>()).map(bytemuck::pod_read_unaligned).collect();
        for node in nodes {
            let end = node.page_offset.saturating_add(u64::from(node.page_bytes));
            let end = (end as usize).min(bytes.len());
            if let Some(page) = bytes.get_mut(node.page_offset as usize..end) {
                seal_page(page);
            }
        }
    }
    let place = |s: &Section| s.offset as usize..s.offset.saturating_add(s.bytes) as usize;
    if let Some(statistics) = bytes.get_mut(place(&footer.statistics)) {
        seal_sides(statistics);
    }
    let crc = |s: &Section| bytes.get(place(s)).map_or(s.crc, crc32fast::hash);
    footer.table.crc = crc(&footer.table);
    footer.statistics.crc = crc(&footer.statistics);
    footer.metadata.crc = crc(&footer.metadata);
    footer.verbatim.crc = crc(&footer.verbatim);
    let at = bytes.len() - FOOTER_BYTES;
    bytes[at..].copy_from_slice(&footer.encode());
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    bytes.get(at..at + 4).map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize)
}

fn seal_page(page: &mut [u8]) {
    let Some(count) = u32_at(page, 8).map(|word| word & 0xffff) else { return };
    let end = 12 + 20 * count;
    for entry in (12..end).step_by(20) {
        let (Some(offset), Some(length)) = (u32_at(page, entry + 8), u32_at(page, entry + 12))
        else {
            return;
        };
        let Some(plane) = page.get(offset..offset + length) else { continue };
        let crc = crc32fast::hash(plane).to_le_bytes();
        let Some(place) = page.get_mut(entry + 16..entry + 20) else { return };
        place.copy_from_slice(&crc);
    }
    let Some(crc) = page.get(..end).map(crc32fast::hash) else { return };
    if let Some(place) = page.get_mut(end..end + 4) {
        place.copy_from_slice(&crc.to_le_bytes());
    }
}

/// Makes the checksum of the column of sides right, if there is one.
fn seal_sides(statistics: &mut [u8]) {
    let Some(count) = u32_at(statistics, 4) else { return };
    for entry in (16..16 + 24 * count).step_by(24) {
        let (Some(kind), Some(at)) = (u32_at(statistics, entry), u32_at(statistics, entry + 8))
        else {
            return;
        };
        let Some(length) = u32_at(statistics, entry + 16) else { return };
        if kind & 0xffff == 8 && length >= 8 {
            let Some(column) = statistics.get_mut(at..at + length) else { return };
            let (words, crc) = column.split_at_mut(length - 8);
            crc[..4].copy_from_slice(&crc32fast::hash(words).to_le_bytes());
        }
    }
}
