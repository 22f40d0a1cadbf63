//! The integer grid of scans: one for all scans, if their grids differ by whole steps.

use crate::pose::Pose;
use e57::{PointCloud, RecordDataType as Kind};
use esker_points::Grid;

/// Deviation from a whole step that counts as rounding noise of doubles, and the greatest number of
/// steps that doubles can distinguish.
const NOISE_STEPS: f64 = 1e-6;
const STEPS_MAX: f64 = 9.0e15;

/// Finds the grid on which all coordinates are integers, and the shift of each scan on it, in
/// steps. `places` holds the fields of the Cartesian coordinates of each scan, if it has them, and
/// its pose.
pub(crate) fn grid(
    clouds: &[PointCloud],
    places: &[(Option<[usize; 3]>, Pose)],
) -> Option<(Grid, Vec<[i64; 3]>)> {
    let mut grid: Option<Grid> = None;
    let mut shifts = vec![[0; 3]; places.len()];
    let scans_with_points =
        clouds.iter().zip(places).zip(&mut shifts).filter(|((cloud, _), _)| cloud.records > 0);
    for ((cloud, (xyz, pose)), shift) in scans_with_points {
        let xyz = (*xyz)?;
        if pose.is_turned {
            return None;
        }
        let mut own = Grid { scale: [1.0; 3], offset: pose.at };
        let mut ends = [[0; 3]; 2];
        for (axis, i) in xyz.into_iter().enumerate() {
            let Kind::ScaledInteger { min, max, scale, offset } = cloud.prototype[i].data_type
            else {
                return None;
            };
            if !scale.is_normal() || scale < 0.0 || !offset.is_finite() {
                return None;
            }
            (own.scale[axis], ends[0][axis], ends[1][axis]) = (scale, min, max);
            own.offset[axis] += offset;
        }
        let grid = *grid.get_or_insert(own);
        for axis in 0..3 {
            let steps = (own.offset[axis] - grid.offset[axis]) / grid.scale[axis];
            let is_whole = (steps - steps.round()).abs() < NOISE_STEPS && steps.abs() < STEPS_MAX;
            if own.scale[axis] != grid.scale[axis] || !is_whole {
                return None;
            }
            shift[axis] = steps.round() as i64;
            let is_narrow = |end: i64| {
                end.checked_add(shift[axis]).is_some_and(|end| i32::try_from(end).is_ok())
            };
            if !is_narrow(ends[0][axis]) || !is_narrow(ends[1][axis]) {
                return None;
            }
        }
    }
    grid.map(|grid| (grid, shifts))
}
