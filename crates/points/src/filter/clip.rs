//! Clips: boxes, which may be turned, and planes, with the side whose points are kept. [`Clip`] is
//! the user's input in world units, parsed from a text and formatted to one; `region` has its faces
//! on a lattice.

use super::bounds::Bounds;
use super::condition::FilterError;
use crate::lattice::Lattice;
use std::fmt;
use std::str::FromStr;

/// A region of space whose points are kept, or cut away.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Name for people.
    pub name: Option<String>,
    /// Whether it has an effect.
    pub is_on: bool,
    /// Whether the points outside are kept, instead of those inside. Points on a face are inside.
    pub keeps_outside: bool,
    /// The region.
    pub shape: ClipShape,
}

/// A region of space. Where coordinates are degrees, lengths and directions are in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClipShape {
    /// A box along the axes of the coordinates.
    Box(Bounds),
    /// A box of any orientation.
    Oriented {
        /// Its centre.
        centre: [f64; 3],
        /// Lengths of its edges, 0 or more.
        size: [f64; 3],
        /// Degrees by which it is turned about the axes z, y and x: about x first, then about y,
        /// then about z, anticlockwise as seen from the end of each axis.
        rotation: [f64; 3],
    },
    /// The half space behind a plane, away from its normal.
    Plane {
        /// A point of the plane.
        point: [f64; 3],
        /// Normal of the plane, of any length but 0.
        normal: [f64; 3],
    },
}

impl From<ClipShape> for Clip {
    /// A clip without a name that keeps the points inside.
    fn from(shape: ClipShape) -> Self {
        Self { name: None, is_on: true, keeps_outside: false, shape }
    }
}

impl Clip {
    /// The clip that keeps exactly the points that this one does not keep.
    #[must_use]
    pub fn inverted(self) -> Self {
        Self { keeps_outside: !self.keeps_outside, ..self }
    }

    /// Checks the numbers of the clip.
    ///
    /// # Errors
    /// If one is not finite, a length is below 0, the least corner of a box is above the greatest
    /// one, or a normal is 0.
    pub fn check(&self) -> Result<(), FilterError> {
        let fault = |what: &str| Err(FilterError(format!("a clip {what}")));
        let numbers = match &self.shape {
            ClipShape::Box(Bounds { min, max }) => [*min, *max, [0.0; 3]],
            ClipShape::Oriented { centre, size, rotation } => [*centre, *size, *rotation],
            ClipShape::Plane { point, normal } => [*point, *normal, [0.0; 3]],
        };
        if !numbers.iter().flatten().all(|number| number.is_finite()) {
            return fault("has a number that is not finite");
        }
        match self.shape {
            ClipShape::Box(Bounds { min, max }) if (0..3).any(|i| min[i] > max[i]) => {
                fault("has a box without inside: the least corner comes first")
            }
            ClipShape::Oriented { size, .. } if size.iter().any(|length| *length < 0.0) => {
                fault("has a size below 0")
            }
            ClipShape::Plane { normal, .. } if normal == [0.0; 3] => {
                fault("has the normal 0,0,0, which is no direction")
            }
            _ => Ok(()),
        }
    }

    /// The box along the axes of the coordinates of `lattice` outside of which it keeps no point;
    /// `None` if there is none.
    pub fn extent(&self, lattice: &Lattice) -> Option<Bounds> {
        if !self.is_on || self.keeps_outside {
            return None;
        }
        match self.shape {
            ClipShape::Box(bounds) => Some(bounds),
            ClipShape::Oriented { centre, size, rotation } => {
                Some(around(centre, size, &axes(rotation), lattice))
            }
            ClipShape::Plane { .. } => None,
        }
    }
}

/// The box along the axes of the coordinates around an oriented one with these axes.
pub(super) fn around(
    centre: [f64; 3],
    size: [f64; 3],
    axes: &[[f64; 3]; 3],
    lattice: &Lattice,
) -> Bounds {
    let reach = |i: usize| (0..3).map(|k| (axes[k][i] * size[k]).abs() / 2.0).sum::<f64>();
    let reach = lattice.unmeasure([reach(0), reach(1), reach(2)]);
    Bounds {
        min: [0, 1, 2].map(|i| centre[i] - reach[i]),
        max: [0, 1, 2].map(|i| centre[i] + reach[i]),
    }
}

/// Axes of a box that is turned by these degrees about z, y and x, of length 1.
pub(super) fn axes([z, y, x]: [f64; 3]) -> [[f64; 3]; 3] {
    let [(sz, cz), (sy, cy), (sx, cx)] = [z, y, x].map(sin_cos);
    [
        [cz * cy, sz * cy, -sy],
        [cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, cy * sx],
        [cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx],
    ]
}

/// Sine and cosine of an angle in degrees, exact for right angles.
fn sin_cos(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        // `rem_euclid` rounds small negative angles up to 360.
        0.0 | 360.0 => (0.0, 1.0),
        degrees => degrees.to_radians().sin_cos(),
    }
}

/// The parts of the text of a clip, in the order in which they are written.
const PARTS_OF_TEXT: &str = "box=x0,y0,z0,x1,y1,z1, or centre=x,y,z;size=x,y,z;rotation=z,y,x, or \
                             point=x,y,z;normal=x,y,z; and keep=inside or keep=outside";

impl FromStr for Clip {
    type Err = FilterError;

    /// Parses parts that are separated by `;`, in any order: `box=x0,y0,z0,x1,y1,z1`; or
    /// `centre=x,y,z`, `size=x,y,z` and perhaps `rotation=z,y,x` or `rotation=z`; or `point=x,y,z`
    /// and `normal=x,y,z`; and perhaps `keep=inside` or `keep=outside`.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let fault = |what: String| FilterError(format!("`{text}` is no clip: {what}"));
        let mut parts: Vec<(&str, &str)> = Vec::new();
        for part in text.split(';').map(str::trim).filter(|part| !part.is_empty()) {
            let (name, value) = part
                .split_once('=')
                .map(|(name, value)| (name.trim(), value.trim()))
                .ok_or_else(|| fault(format!("`{part}` has no `=`; it needs {PARTS_OF_TEXT}")))?;
            if parts.iter().any(|(other, _)| *other == name) {
                return Err(fault(format!("`{name}` occurs twice")));
            }
            parts.push((name, value));
        }
        let mut take = |name: &str| {
            let at = parts.iter().position(|(own, _)| *own == name)?;
            Some(parts.swap_remove(at).1)
        };
        let numbers = |name: &str, value: &str| {
            let numbers = value.split(',').map(|n| n.trim().parse::<f64>());
            let numbers: Option<Vec<f64>> =
                numbers.map(|n| n.ok().filter(|n| n.is_finite())).collect();
            numbers.ok_or_else(|| fault(format!("`{name}={value}` is not made of numbers")))
        };
        let three = |name: &str, value: &str| {
            <[f64; 3]>::try_from(numbers(name, value)?)
                .map_err(|_| fault(format!("`{name}` needs three numbers")))
        };
        let keeps_outside = match take("keep") {
            None | Some("inside") => false,
            Some("outside") => true,
            Some(other) => {
                return Err(fault(format!("keep is inside or outside, not `{other}`")));
            }
        };
        let shape = if let Some(value) = take("box") {
            let bounds = <[f64; 6]>::try_from(numbers("box", value)?);
            let [x0, y0, z0, x1, y1, z1] =
                bounds.map_err(|_| fault("`box` needs six numbers".into()))?;
            ClipShape::Box(Bounds { min: [x0, y0, z0], max: [x1, y1, z1] })
        } else if let (Some(centre), Some(size)) = (take("centre"), take("size")) {
            let rotation = match take("rotation") {
                None => [0.0; 3],
                Some(value) => match numbers("rotation", value)?[..] {
                    [z] => [z, 0.0, 0.0],
                    [z, y, x] => [z, y, x],
                    _ => return Err(fault("`rotation` needs one number or three".into())),
                },
            };
            let (centre, size) = (three("centre", centre)?, three("size", size)?);
            ClipShape::Oriented { centre, size, rotation }
        } else if let (Some(point), Some(normal)) = (take("point"), take("normal")) {
            ClipShape::Plane { point: three("point", point)?, normal: three("normal", normal)? }
        } else {
            return Err(fault(format!("it needs {PARTS_OF_TEXT}")));
        };
        if let Some((name, _)) = parts.first() {
            return Err(fault(format!("`{name}` does not belong there; it needs {PARTS_OF_TEXT}")));
        }
        let clip = Self { keeps_outside, ..Self::from(shape) };
        clip.check().map_err(|e| fault(e.0))?;
        Ok(clip)
    }
}

impl fmt::Display for Clip {
    /// Formats as [`Clip::from_str`] parses; without the name, and whether it is switched on.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let three = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
        match self.shape {
            ClipShape::Box(Bounds { min, max }) => write!(f, "box={},{}", three(min), three(max)),
            ClipShape::Oriented { centre, size, rotation } => {
                write!(f, "centre={};size={}", three(centre), three(size))?;
                match rotation {
                    [0.0, 0.0, 0.0] => Ok(()),
                    _ => write!(f, ";rotation={}", three(rotation)),
                }
            }
            ClipShape::Plane { point, normal } => {
                write!(f, "point={};normal={}", three(point), three(normal))
            }
        }?;
        if self.keeps_outside { f.write_str(";keep=outside") } else { Ok(()) }
    }
}
