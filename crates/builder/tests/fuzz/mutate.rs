//! Mutations of bytes: bits, numbers, ranges, and words of text.

/// A sequence of numbers that looks random, the same for each seed.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn draw(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.draw() >> 32) as usize % end.max(1)
    }
}

/// Numbers and words that texts get.
const WORDS: [&str; 34] = [
    "0",
    "-1",
    "1",
    "255",
    "65535",
    "65536",
    "4294967295",
    "4294967296",
    "2147483648",
    "9223372036854775807",
    "18446744073709551615",
    "99999999999999999999",
    "1e308",
    "-1e308",
    "1e999",
    "1e-320",
    "nan",
    "inf",
    "-",
    "",
    ".",
    "1,5",
    "\"",
    "\n",
    "\r",
    "\0",
    " ",
    "\t",
    ";",
    ",",
    "x y z",
    "</a>",
    "0.0000000000000000001",
    "\u{202e}",
];

/// Longest range that is moved, copied or removed.
const RANGE_MAX: usize = 600;
/// Longest file that mutations make of a seed.
const FILE_BYTES_MAX: usize = 1 << 18;

/// Changes `bytes` in one way; `other` is another seed.
pub fn mutate(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    if bytes.is_empty() {
        bytes.push(random.draw() as u8);
        return;
    }
    // Most of what a reader trusts stands at the beginning.
    let at = match random.below(2) {
        0 => random.below(bytes.len().min(1500)),
        _ => random.below(bytes.len()),
    };
    let range = at..(at + 1 + random.below(RANGE_MAX)).min(bytes.len());
    match random.below(13) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.draw() as u8,
        2..6 => number(bytes, at, random),
        6 => bytes.truncate(at),
        7 => drop(bytes.drain(range)),
        8 => {
            let copy = bytes[range].to_vec();
            let times = 1 + random.below(64);
            insert(bytes, at, &copy.repeat(times));
        }
        9 => {
            let noise: Vec<u8> = range.map(|_| random.draw() as u8).collect();
            insert(bytes, at, &noise);
        }
        10 => {
            let from = random.below(other.len());
            let part = other[from..].iter().take(range.len()).copied().collect::<Vec<_>>();
            if random.below(2) == 0 {
                drop(bytes.drain(range));
            }
            insert(bytes, at, &part);
        }
        _ => word(bytes, at, random),
    }
}

fn insert(bytes: &mut Vec<u8>, at: usize, part: &[u8]) {
    let room = FILE_BYTES_MAX.saturating_sub(bytes.len());
    bytes.splice(at..at, part[..part.len().min(room)].iter().copied());
}

/// Sets a number of 1 to 8 bytes, of either byte order, to an extreme or a neighbour.
fn number(bytes: &mut [u8], at: usize, random: &mut Random) {
    let size = 1 << random.below(4);
    let at = if random.below(3) > 0 { at / size * size } else { at };
    let Some(field) = bytes.get_mut(at..at + size) else { return };
    let mut word = [0; 8];
    word[..size].copy_from_slice(field);
    let value = u64::from_le_bytes(word);
    let bits = 8 * size as u32;
    let value = match random.below(12) {
        0 => 0,
        1 => u64::MAX,
        2 => value.wrapping_add(1),
        3 => value.wrapping_sub(1),
        4 => 1 << (bits - 1),
        5 => u64::MAX >> (64 - bits + 1),
        6 => f64::NAN.to_bits() >> (64 - bits),
        7 => f64::INFINITY.to_bits() >> (64 - bits),
        8 => f64::MAX.to_bits() >> (64 - bits),
        9 => 1 << random.below(bits as usize),
        10 => value.wrapping_mul(1 + random.below(1000) as u64),
        _ => random.draw(),
    };
    field.copy_from_slice(&value.to_le_bytes()[..size]);
    if random.below(4) == 0 {
        field.reverse();
    }
}

/// Puts a word in the place of the word at a position.
fn word(bytes: &mut Vec<u8>, at: usize, random: &mut Random) {
    let start = bytes[..at].iter().rposition(is_separator).map_or(0, |i| i + 1);
    let end = bytes[at..].iter().position(is_separator).map_or(bytes.len(), |i| at + i);
    let new = WORDS[random.below(WORDS.len())].bytes();
    if end - start < 100 {
        bytes.splice(start..end.max(start), new);
    }
}

fn is_separator(byte: &u8) -> bool {
    b" \t\r\n,;<>\"=".contains(byte)
}
