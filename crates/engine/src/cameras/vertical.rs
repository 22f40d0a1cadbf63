//! The direction in which elevations are measured: the axis, with its sign, that is nearest to the
//! up direction of the camera; z unless the user gives another one.

use glam::DVec3;
use std::fmt;
use std::str::FromStr;

/// Names of the axes.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];

/// An axis along which elevations grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vertical {
    /// 0 for x, 1 for y, 2 for z.
    pub(crate) axis: usize,
    /// Whether elevations grow against the axis.
    pub(crate) is_down: bool,
}

impl Default for Vertical {
    fn default() -> Self {
        Self { axis: 2, is_down: false }
    }
}

impl Vertical {
    /// The axis `axis` (0 for x, 1 for y, 2 for z), or the direction against it.
    pub fn of(axis: usize, is_down: bool) -> Self {
        Self { axis: axis.min(2), is_down }
    }

    /// 0 for x, 1 for y, 2 for z.
    pub fn axis(self) -> usize {
        self.axis
    }

    /// Whether elevations grow against the axis.
    pub fn is_down(self) -> bool {
        self.is_down
    }

    /// The direction in which elevations grow, unit length.
    pub fn direction(self) -> DVec3 {
        DVec3::AXES[self.axis] * if self.is_down { -1.0 } else { 1.0 }
    }

    /// The axis that is nearest to `up`. Of several it is the last.
    pub fn nearest(up: DVec3) -> Self {
        let axis = (0..3).max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs())).unwrap_or(2);
        Self { axis, is_down: up[axis] < 0.0 }
    }

    /// Elevations at the ends of a range of coordinates along the axis, or the other way round.
    pub(crate) fn turned(self, [low, high]: [f64; 2]) -> [f64; 2] {
        if self.is_down { [-high, -low] } else { [low, high] }
    }

    /// Coordinates of two elevations.
    pub(crate) fn coordinates(self, elevations: [f64; 2]) -> [f64; 2] {
        if self.is_down { elevations.map(|e| -e) } else { elevations }
    }

    /// Name of the elevations in legends.
    pub(crate) fn name(self) -> String {
        match (self.axis, self.is_down) {
            (2, false) => "elevation".to_owned(),
            (axis, is_down) => {
                format!("elevation along {}{}", if is_down { "-" } else { "" }, AXES[axis])
            }
        }
    }
}

impl fmt::Display for Vertical {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", if self.is_down { "-" } else { "" }, AXES[self.axis])
    }
}

impl FromStr for Vertical {
    type Err = String;

    /// Parses `x`, `y`, `z`, `-x`, `-y` or `-z`.
    fn from_str(text: &str) -> Result<Self, String> {
        let word = text.trim().to_ascii_lowercase();
        let (is_down, name) = word.strip_prefix('-').map_or((false, word.as_str()), |n| (true, n));
        let axis = AXES.iter().position(|axis| *axis == name);
        let axis = axis.ok_or_else(|| format!("`{text}` is none of x, y, z, -x, -y, -z"))?;
        Ok(Self { axis, is_down })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_read_as_they_are_written() {
        for axis in 0..3 {
            for is_down in [false, true] {
                let vertical = Vertical::of(axis, is_down);
                assert_eq!(vertical.to_string().parse(), Ok(vertical));
                assert_eq!(Vertical::nearest(vertical.direction()), vertical);
            }
        }
        for text in ["", "-", "w", "xy", "+z", "--z"] {
            assert!(text.parse::<Vertical>().is_err(), "{text}");
        }
    }

    #[test]
    fn elevations_grow_along_the_axis_nearest_to_up() {
        for (up, name) in [
            (DVec3::Z, "elevation"),
            (DVec3::Y, "elevation along y"),
            (DVec3::NEG_Y, "elevation along -y"),
            (DVec3::NEG_Z * 1e-9, "elevation along -z"),
            (DVec3::new(0.9, -0.2, 0.3), "elevation along x"),
            (DVec3::new(1.0, 1.0, 1.0), "elevation"),
            (DVec3::new(1.0, -1.0, 0.5), "elevation along -y"),
        ] {
            assert_eq!(Vertical::nearest(up).name(), name, "{up}");
        }
    }
}
