// Waves run in turns of 16, so that few dispatches are needed, and none of those does anything once the waves have
// come to rest.

const TURNS: u32 = 16u;
const TURN_WAVES: u32 = 16u;

struct Turns {
    // Whether a pixel went in a turn.
    went: array<atomic<u32>, 16>,
}
