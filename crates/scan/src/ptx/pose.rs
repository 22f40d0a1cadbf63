//! Soundness of the matrix of a PTX scan: in the head's numbers, out a pose that keeps all points
//! apart and finite, and notes on it. A matrix that flattens points, or is not finite, would put
//! them at wrong places or at none. One that is written by columns is transposed; one that scales
//! or mirrors points is applied, with a note.

/// Least volume of the cube that the matrix makes of a unit cube, as a share of the product of the
/// lengths of its rows: 1 for rotations with a scale, 0 if points are flattened.
const VOLUME_MIN: f64 = 1e-6;
/// Greatest difference of a rotation's lengths and products of rows from 1 and 0: matrices are
/// written with six digits, and by some programs with four.
const OFF_TURN_MAX: f64 = 1e-3;
/// Greatest difference of the fourth column from 0, 0, 0, 1.
const OFF_COLUMN_MAX: f64 = 1e-9;
/// The fourth column of a matrix that is applied to rows.
const LAST: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

/// Where the head gives the translation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// The last row of the matrix.
    Row,
    /// The last column of the matrix.
    Column,
    /// The line with the position of the scanner.
    Station,
}

/// The numbers of a head that make the pose.
pub(crate) struct Given {
    /// The matrix as it is written.
    pub matrix: [[f64; 4]; 4],
    /// The position of the scanner.
    pub station: [f64; 3],
    /// The axes of the scanner.
    pub axes: [[f64; 3]; 3],
}

/// A sound pose.
pub(crate) struct Sound {
    /// A point is `x * rows[0] + y * rows[1] + z * rows[2] + rows[3]`.
    pub rows: [[f64; 3]; 4],
    pub place: Place,
    /// What was mended or is unusual, after the number of the scan.
    pub remarks: Vec<String>,
}

/// The sound pose: the one given, transposed if it is written by columns, without its rotation if
/// that is none, and at the position of the scanner if the translation is not finite.
pub(crate) fn pose(given: &Given) -> Sound {
    let written = given.matrix;
    let transposed = [0, 1, 2, 3].map(|row| written.map(|of| of[row]));
    let mut remarks = Vec::new();
    let is_column_major = !is_affine(&written) && is_affine(&transposed);
    let matrix = if is_column_major { transposed } else { written };
    let rows = matrix.map(|[x, y, z, _]| [x, y, z]);
    let (mut rows, place) = (rows, if is_column_major { Place::Column } else { Place::Row });
    if is_column_major {
        let agrees = is_close(&rows[..3], &given.axes) && is_near(rows[3], given.station);
        let agrees = if agrees { ", as its axes and its position say" } else { "" };
        remarks.push(format!("has a matrix written by columns: it is transposed{agrees}"));
    } else if is_affine(&written) {
        let by_columns = transposed.map(|[x, y, z, _]| [x, y, z]);
        if is_close(&by_columns[..3], &given.axes) && !is_close(&rows[..3], &given.axes) {
            let what = "has axes of the transposed matrix: the matrix is applied as it is written";
            remarks.push(what.into());
        }
    }
    let is_finite = |row: &[f64; 3]| row.iter().all(|c| c.is_finite());
    let is_turn = volume(rows[0], rows[1], rows[2]).abs() >= VOLUME_MIN;
    let is_placed = is_finite(&rows[3]);
    let place = match (is_placed, is_finite(&given.station)) {
        (true, _) => place,
        (false, true) => {
            rows[3] = given.station;
            Place::Station
        }
        (false, false) => {
            rows[3] = [0.0; 3];
            place
        }
    };
    match (is_turn, is_placed) {
        (true, true) => {
            remarks.extend(distortion(&rows));
            if !is_affine(&matrix) {
                let what = "has a matrix whose fourth column is not 0 0 0 1: it is not applied";
                remarks.push(what.into());
            }
        }
        (false, true) => {
            remarks.push("has a matrix that is no rotation: it is kept as not turned".into());
        }
        (true, false) => {
            let what = "has a matrix without a position: the scanner's position is taken";
            remarks.push(what.into());
        }
        (false, false) => {
            let what = "has a matrix that is no pose: it is kept as not turned, at the scanner's \
                position";
            remarks.push(what.into());
        }
    }
    if !is_turn {
        let [_, _, _, at] = rows;
        rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], at];
    }
    Sound { rows, place, remarks }
}

/// Whether points that are transformed by the matrix, as rows, keep a fourth coordinate of 1.
fn is_affine(matrix: &[[f64; 4]; 4]) -> bool {
    matrix.iter().zip(LAST).all(|(row, last)| (row[3] - last).abs() <= OFF_COLUMN_MAX)
}

fn is_close(rows: &[[f64; 3]], others: &[[f64; 3]]) -> bool {
    let pairs = rows.iter().flatten().zip(others.iter().flatten());
    pairs.into_iter().all(|(a, b)| (a - b).abs() <= OFF_TURN_MAX)
}

/// Whether two positions are the same but for the digits that programs write.
fn is_near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 0.01 + 1e-6 * a.abs())
}

/// What a matrix does to points beside turning and moving them.
fn distortion(rows: &[[f64; 3]; 4]) -> Option<String> {
    let [a, b, c, _] = *rows;
    let lengths = [a, b, c].map(length);
    let volume = volume(a, b, c);
    let is_one = |factor: f64| (factor - 1.0).abs() <= OFF_TURN_MAX;
    let mut does = Vec::new();
    if volume < 0.0 {
        does.push("mirrors points".to_owned());
    }
    if !lengths.into_iter().all(is_one) {
        let [x, y, z] = lengths;
        does.push(match is_one(y / x) && is_one(z / x) {
            true => format!("scales points by {}", short(x)),
            false => {
                format!(
                    "scales points by {}, {} and {} along its axes",
                    short(x),
                    short(y),
                    short(z)
                )
            }
        });
    }
    if volume.abs() < 1.0 - OFF_TURN_MAX {
        does.push("shears points".to_owned());
    }
    (!does.is_empty())
        .then(|| format!("has a matrix that {}: it is applied as it is", does.join(" and ")))
}

/// A factor to six digits.
fn short(factor: f64) -> f64 {
    format!("{factor:.5e}").parse().unwrap_or(factor)
}

fn length(row: [f64; 3]) -> f64 {
    row.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// Volume between three rows of length 1, negative if they are left-handed; not a number if a row
/// has no length or is not finite.
fn volume(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|row| {
        let length = length(row);
        row.map(|c| c / length)
    });
    let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
    a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]
}
