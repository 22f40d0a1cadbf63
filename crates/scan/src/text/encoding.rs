//! Decodes the encodings of text files: UTF-8 and single-byte encodings are read as they are, since
//! numbers and separators are ASCII in both; UTF-16, recognised by its byte order mark or by its
//! zero bytes, is turned into UTF-8 while it is read. Names that are not UTF-8 are read as Windows
//! 1252, which contains Latin-1.

use std::io::Read;

/// Byte order marks of UTF-8 and of UTF-16.
const UTF_8_MARK: &[u8] = b"\xEF\xBB\xBF";
const UTF_16_LE_MARK: &[u8] = b"\xFF\xFE";
const UTF_16_BE_MARK: &[u8] = b"\xFE\xFF";
/// Bytes of UTF-16 that are decoded at once.
const CHUNK_BYTES: usize = 16 << 10;
/// Least number of bytes, and number of bytes examined, to recognise UTF-16 without a mark.
const UNMARKED_BYTES: std::ops::Range<usize> = 8..4096;
/// Characters of the bytes 0x80 to 0x9F in Windows 1252. Five of them have none there, and stand
/// for control characters in Latin-1.
const WINDOWS_1252: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8D}', 'Ž', '\u{8F}',
    '\u{90}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9D}', 'ž', 'Ÿ',
];

/// How the characters of a file are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// UTF-8, or an encoding whose characters are single bytes.
    Bytes,
    /// UTF-16, little or big endian.
    Utf16 { is_big: bool },
}

/// The encoding of a file that begins with `head`, and the length of its byte order mark.
pub(crate) fn encoding_of(head: &[u8]) -> (Encoding, usize) {
    if head.starts_with(UTF_8_MARK) {
        return (Encoding::Bytes, UTF_8_MARK.len());
    }
    for (mark, is_big) in [(UTF_16_LE_MARK, false), (UTF_16_BE_MARK, true)] {
        if head.starts_with(mark) {
            return (Encoding::Utf16 { is_big }, mark.len());
        }
    }
    let unmarked = [false, true].into_iter().find(|&is_big| is_unmarked_utf_16(head, is_big));
    (unmarked.map_or(Encoding::Bytes, |is_big| Encoding::Utf16 { is_big }), 0)
}

/// Whether text without a mark is UTF-16: nearly all upper bytes are zero, no lower byte is.
fn is_unmarked_utf_16(head: &[u8], is_big: bool) -> bool {
    let units = head[..head.len().min(UNMARKED_BYTES.end)].chunks_exact(2);
    let count = units.len();
    let [mut zero_lower, mut zero_upper] = [0; 2];
    for unit in units {
        let (upper, lower) = if is_big { (unit[0], unit[1]) } else { (unit[1], unit[0]) };
        zero_lower += usize::from(lower == 0);
        zero_upper += usize::from(upper == 0);
    }
    2 * count >= UNMARKED_BYTES.start && zero_lower == 0 && 10 * zero_upper >= 9 * count
}

/// The text of bytes that are UTF-8 or, else, Windows 1252.
pub(crate) fn decoded(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&b| windows_1252(b)).collect(),
    }
}

fn windows_1252(byte: u8) -> char {
    match byte {
        0x80..=0x9F => WINDOWS_1252[usize::from(byte - 0x80)],
        _ => char::from(byte),
    }
}

/// A stream of UTF-16 as UTF-8. What is no character becomes U+FFFD.
pub(crate) struct Utf16ToUtf8<R> {
    input: R,
    is_big: bool,
    /// Bytes read and not decoded yet: less than a character, except while a chunk is decoded.
    raw: Vec<u8>,
    text: Vec<u8>,
    taken: usize,
    ended: bool,
}

impl<R: Read> Utf16ToUtf8<R> {
    /// Decodes `input`, which is behind the byte order mark.
    pub fn new(input: R, is_big: bool) -> Self {
        Self { input, is_big, raw: Vec::new(), text: Vec::new(), taken: 0, ended: false }
    }

    fn decode_chunk(&mut self) -> std::io::Result<()> {
        let want = (CHUNK_BYTES - self.raw.len()) as u64;
        self.ended = (self.input.by_ref().take(want).read_to_end(&mut self.raw)? as u64) < want;
        let unit = |pair: &[u8]| match self.is_big {
            true => u16::from_be_bytes([pair[0], pair[1]]),
            false => u16::from_le_bytes([pair[0], pair[1]]),
        };
        let mut units: Vec<u16> = self.raw.chunks_exact(2).map(unit).collect();
        let is_half = |unit: &u16| (0xD800..0xDC00).contains(unit);
        if !self.ended && units.last().is_some_and(is_half) {
            units.pop();
        }
        self.raw.drain(..2 * units.len());
        if self.ended && !self.raw.is_empty() {
            units.push(0xDC00);
            self.raw.clear();
        }
        let chars = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER));
        self.text = chars.collect::<String>().into_bytes();
        self.taken = 0;
        Ok(())
    }
}

impl<R: Read> Read for Utf16ToUtf8<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while self.taken == self.text.len() && !self.ended {
            self.decode_chunk()?;
        }
        let left = &self.text[self.taken..];
        let bytes = left.len().min(buffer.len());
        buffer[..bytes].copy_from_slice(&left[..bytes]);
        self.taken += bytes;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utf_16(text: &str, is_big: bool) -> Vec<u8> {
        let bytes = |unit: u16| if is_big { unit.to_be_bytes() } else { unit.to_le_bytes() };
        text.encode_utf16().flat_map(bytes).collect()
    }

    #[test]
    fn encodings_are_recognised() {
        for is_big in [false, true] {
            let text = utf_16("\u{FEFF}x y z\r\n", is_big);
            assert_eq!(encoding_of(&text), (Encoding::Utf16 { is_big }, 2));
            assert_eq!(encoding_of(&text[2..]), (Encoding::Utf16 { is_big }, 0));
        }
        assert_eq!(encoding_of("\u{FEFF}1 2 3".as_bytes()), (Encoding::Bytes, 3));
        for bytes in [&b"1 2 3"[..], b"", b"1\0", b"1 2\0\0\0\0\0\0", &[0; 100]] {
            assert_eq!(encoding_of(bytes), (Encoding::Bytes, 0));
        }
    }

    #[test]
    fn utf_16_is_decoded_whatever_the_chunks() {
        let text = "Höhe 𝄞 1,5\n".repeat(5000);
        for is_big in [false, true] {
            let mut got = String::new();
            let bytes = utf_16(&text, is_big);
            Utf16ToUtf8::new(&bytes[..], is_big).read_to_string(&mut got).unwrap();
            assert!(got == text);
        }
        let mut got = String::new();
        Utf16ToUtf8::new(&b"1\0\0\xD82\0\x33"[..], false).read_to_string(&mut got).unwrap();
        assert_eq!(got, "1\u{FFFD}2\u{FFFD}");
    }

    #[test]
    fn names_are_utf_8_or_windows_1252() {
        assert_eq!(decoded("Höhe".as_bytes()), "Höhe");
        assert_eq!(decoded(b"H\xF6he \x80\x96\x9F"), "Höhe €–Ÿ");
    }
}
