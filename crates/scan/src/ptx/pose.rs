//! Soundness of the matrix of a PTX scan: in the rows of its head, out a pose that keeps all points
//! apart and finite, and what was mended. A matrix that flattens points, or is not finite, would
//! put them at wrong places or at none.

/// Least volume of the cube that the matrix makes of a unit cube, as a share of the product of the
/// lengths of its rows: 1 for rotations with a scale, 0 if points are flattened.
const VOLUME_MIN: f64 = 1e-6;

/// Line of the head with the position of the scanner, from 0.
const STATION_LINE: usize = 2;

/// What was mended in a pose.
pub(crate) struct Mend {
    /// For messages, after the number of the scan.
    pub what: &'static str,
    /// Line of the head that gives the translation, from 0, if it is not the matrix.
    pub place_line: Option<usize>,
}

/// The rows of a sound pose: those given, or without their rotation if that is none, and at the
/// position of the scanner if the translation is not finite.
pub(crate) fn pose(rows: [[f64; 3]; 4], station: [f64; 3]) -> ([[f64; 3]; 4], Option<Mend>) {
    let is_finite = |row: &[f64; 3]| row.iter().all(|c| c.is_finite());
    let [a, b, c, at] = rows;
    let is_turn = volume(a, b, c) >= VOLUME_MIN;
    let is_placed = is_finite(&at);
    let (place, place_line) = match (is_placed, is_finite(&station)) {
        (true, _) => (at, None),
        (false, true) => (station, Some(STATION_LINE)),
        (false, false) => ([0.0; 3], None),
    };
    let what = match (is_turn, is_placed) {
        (true, true) => return (rows, None),
        (false, true) => "has a matrix that is no rotation: it is kept as not turned",
        (true, false) => "has a matrix without a position: the scanner's position is taken",
        (false, false) => {
            "has a matrix that is no pose: it is kept as not turned, at the scanner's position"
        }
    };
    let [a, b, c] = match is_turn {
        true => [a, b, c],
        false => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };
    ([a, b, c, place], Some(Mend { what, place_line }))
}

/// Volume between three rows of length 1; not a number if a row has no length or is not finite.
fn volume(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|row| {
        let length = row.iter().map(|c| c * c).sum::<f64>().sqrt();
        row.map(|c| c / length)
    });
    let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
    (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]).abs()
}
