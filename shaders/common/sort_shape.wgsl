// Shape of the radix sort: a thread takes a few neighbouring pairs, so that their order is kept,
// and a digit has 4 bits, so that the counts of all threads of a group fit in its memory.

// Threads of a group.
const THREADS: u32 = 64u;
// Pairs of a thread.
const PAIRS: u32 = 16u;
// Values of a digit.
const DIGITS: u32 = 16u;

struct Sort {
    // Number of pairs.
    count: u32,
    // Number of groups.
    groups: u32,
    // Lowest bit of the digit.
    shift: u32,
    unused: u32,
}

// First pair of a thread.
fn first_of(group: u32, thread: u32) -> u32 {
    return (group * THREADS + thread) * PAIRS;
}

fn digit_of(key: u32) -> u32 {
    return (key >> sort.shift) % DIGITS;
}
