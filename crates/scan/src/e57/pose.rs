//! The pose of a scan in an E57 file.

use e57::PointCloud;

/// Position and rotation of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Columns of the rotation matrix.
    columns: [[f64; 3]; 3],
    pub at: [f64; 3],
    pub is_turned: bool,
}

impl Pose {
    /// The pose of scans without one.
    pub const NONE: Self = Self {
        columns: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        at: [0.0; 3],
        is_turned: false,
    };

    /// The pose of a scan; `None` if it is not a rotation and a finite position.
    pub fn of(cloud: &PointCloud) -> Option<Self> {
        let Some(pose) = &cloud.transform else { return Some(Self::NONE) };
        let (q, t) = (&pose.rotation, &pose.translation);
        let length = (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z).sqrt();
        let [w, x, y, z] = [q.w, q.x, q.y, q.z].map(|c| c / length);
        let columns = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let at = [t.x, t.y, t.z];
        let is_sound = columns.iter().flatten().chain(&at).all(|c| c.is_finite());
        let is_turned = [x, y, z] != [0.0; 3];
        is_sound.then_some(Self { columns, at, is_turned })
    }

    /// Transforms a direction to the file's coordinates.
    pub fn turned(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = self.columns;
        if !self.is_turned {
            return [x, y, z];
        }
        [0, 1, 2].map(|i| x * a[i] + y * b[i] + z * c[i])
    }

    /// Transforms a position to the file's coordinates.
    pub fn placed(&self, place: [f64; 3]) -> [f64; 3] {
        let turned = self.turned(place);
        [0, 1, 2].map(|i| turned[i] + self.at[i])
    }
}
