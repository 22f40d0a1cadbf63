//! Pose of a scan: rotation by a quaternion, then translation. Serves E57 and PCD.

/// Greatest difference of the length of a quaternion from 1 that is rounding.
const OFF_LENGTH_MAX: f64 = 1e-3;

/// The length of a quaternion, if it is not 1: [`Pose::new`] then takes it as scaled.
pub(crate) fn odd_length(quaternion: [f64; 4]) -> Option<f64> {
    let length = quaternion.iter().map(|c| c * c).sum::<f64>().sqrt();
    (length.is_finite() && length > 0.0 && (length - 1.0).abs() > OFF_LENGTH_MAX).then_some(length)
}

/// Position and rotation of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Columns of the rotation matrix.
    columns: [[f64; 3]; 3],
    pub at: [f64; 3],
    pub is_turned: bool,
}

impl Pose {
    pub const NONE: Self = Self {
        columns: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        at: [0.0; 3],
        is_turned: false,
    };

    /// The pose of a quaternion `[w, x, y, z]` of any length and a position; `None` if they are not
    /// a rotation and a finite position.
    pub fn new(quaternion: [f64; 4], at: [f64; 3]) -> Option<Self> {
        let length = quaternion.iter().map(|c| c * c).sum::<f64>().sqrt();
        let [w, x, y, z] = quaternion.map(|c| c / length);
        let columns = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
            [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
            [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let is_sound = columns.iter().flatten().chain(&at).all(|c| c.is_finite());
        let is_turned = [x, y, z] != [0.0; 3];
        is_sound.then_some(Self { columns, at, is_turned })
    }

    /// A pose without rotation.
    pub fn moved(at: [f64; 3]) -> Self {
        Self { at, ..Self::NONE }
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
