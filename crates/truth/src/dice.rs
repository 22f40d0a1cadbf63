//! Random numbers that are the same on every machine.

/// Random number generator (xorshift64*) with the same sequence on every machine.
pub struct Dice(
    /// Seed, not zero; later the state.
    pub u64,
);

impl Dice {
    /// Uniform random number in 0..1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }
}
