//! Turns: the rungs of the ladder of radii on which thinning descends, the same for all cells of a
//! file. So a cell picks nearly the same points at a turn as the cell above it, except along the
//! borders between its children.

/// Rungs in which the radius halves: a gap within a rung is at most a fifth wider than at its end.
pub const TURNS_PER_OCTAVE: u16 = 4;

/// Turn of points that are in no sample yet.
pub const LAST_TURN: u16 = u16::MAX;

/// Log2 of the largest radius: no `f64` is larger.
const OCTAVE_MAX: f64 = 1024.0;

/// First turn whose radius is at most `radius`, in the file's unit.
pub fn turn_at(radius: f64) -> u16 {
    let octaves = OCTAVE_MAX - radius.max(f64::MIN_POSITIVE).log2();
    (octaves * f64::from(TURNS_PER_OCTAVE)).ceil() as u16
}

/// Radius of a turn, in the file's unit.
pub fn radius_at(turn: u16) -> f64 {
    (OCTAVE_MAX - f64::from(turn) / f64::from(TURNS_PER_OCTAVE)).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_s_radius_is_the_next_rung_down() {
        for radius in [1e-300, 3.3e-5, 0.7, 1.0, 12_345.6, 1e300] {
            let turn = turn_at(radius);
            assert!(radius_at(turn) <= radius * (1.0 + 1e-12));
            assert!(radius_at(turn - 1) > radius * (1.0 - 1e-12));
        }
        assert!(turn_at(0.0) < LAST_TURN);
        assert!((radius_at(turn_at(8.0)) - 8.0).abs() < 1e-12);
    }
}
