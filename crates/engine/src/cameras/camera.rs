//! The camera of a picture: from the command line, or fitted to the scan.

use crate::cameras::boxes::Boxes;
use crate::cameras::vertical::Vertical;
use anyhow::{Context, Result, bail, ensure};
use esker_lod::View;
use esker_points::Lattice;
use glam::DVec3;
use std::str::FromStr;

/// A camera from the command line; parts that are missing are fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Camera {
    /// Position.
    pub eye: Option<DVec3>,
    /// Point that it looks at; without one, the middle of the scan.
    pub target: Option<DVec3>,
    /// Up direction; z without one.
    pub up: Option<DVec3>,
    /// Direction of view, if there is no target.
    pub direction: Option<DVec3>,
    /// Vertical field of view, degrees; 60 without one.
    pub fovy_deg: Option<f64>,
    /// Height of the picture, if the projection is parallel.
    pub ortho: Option<OrthoHeight>,
}

/// Height of the picture of a parallel (orthographic) camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OrthoHeight {
    /// In the file's unit.
    Units(f64),
    /// As high as shows all of the scan.
    Fit,
}

impl FromStr for Camera {
    type Err = String;

    /// [`Camera::parse`] for command lines: an error has its causes in one line.
    fn from_str(text: &str) -> Result<Self, String> {
        Self::parse(text).map_err(|e| format!("{e:#}"))
    }
}

/// Least vertical field of view, degrees.
const FOVY_MIN_DEG: f64 = 0.00573;
/// Height of a fitted parallel view over that of the scan in it.
const ORTHO_MARGIN: f64 = 1.02;
/// Tangent of the greatest angle between the direction of a plan and z.
const PLAN_TILT: f64 = 0.01;
/// Greatest part along z, over its length, of an up direction across z.
const ACROSS: f64 = 1e-6;
/// Default of the vertical field of view, degrees.
const FOVY_DEG: f64 = 60.0;

impl Camera {
    /// Parses `eye=x,y,z;target=x,y,z;up=x,y,z;direction=x,y,z;fovy=60;ortho=HEIGHT`; every part
    /// may be missing.
    ///
    /// # Errors
    /// If a part is unknown, has invalid numbers, occurs twice, or contradicts another one.
    pub fn parse(text: &str) -> Result<Self> {
        let (mut camera, mut given) = (Self::default(), Vec::new());
        for part in text.split(';').map(str::trim).filter(|p| !p.is_empty()) {
            let (name, value) = part
                .split_once('=')
                .with_context(|| format!("`{part}` in the camera is not name=value"))?;
            let name = name.trim();
            ensure!(!given.contains(&name), "the camera's {name} is given twice");
            given.push(name);
            match name {
                "eye" => camera.eye = Some(vector(value)?),
                "target" => camera.target = Some(vector(value)?),
                "up" => camera.up = Some(vector(value)?),
                "direction" => camera.direction = Some(vector(value)?),
                "fovy" => {
                    let degrees: f64 =
                        value.trim().parse().with_context(|| format!("`{value}` is no angle"))?;
                    check_fovy(degrees)?;
                    camera.fovy_deg = Some(degrees);
                }
                "ortho" => camera.ortho = Some(ortho_height(value)?),
                other => {
                    bail!("the camera has eye, target, up, direction, fovy and ortho, no `{other}`")
                }
            }
        }
        for (name, vector) in [("up", camera.up), ("direction", camera.direction)] {
            ensure!(vector != Some(DVec3::ZERO), "the camera's {name} is 0,0,0: no direction");
        }
        ensure!(
            camera.eye.is_none() || camera.eye != camera.target,
            "the camera's eye and target are the same point"
        );
        let given = [camera.eye, camera.target, camera.direction].map(|part| part.is_some());
        ensure!(given != [true; 3], "of the camera's eye, target and direction two are enough");
        ensure!(
            camera.ortho.is_none() || camera.fovy_deg.is_none(),
            "a camera with ortho has no fovy: a parallel view has no angle"
        );
        Ok(camera)
    }

    /// The camera with the axis of an option `--up`, if it was given, upwards.
    ///
    /// # Errors
    /// If the camera has an up direction too.
    pub fn with_up(self, up: Option<Vertical>) -> Result<Self> {
        ensure!(
            up.is_none() || self.up.is_none(),
            "--up and the up of --camera are two up directions: leave out one"
        );
        Ok(Self { up: up.map(Vertical::direction).or(self.up), ..self })
    }

    /// View of a whole scan with which benchmarks begin: the nearest one that shows all of it,
    /// which need not be centred. It does not change, so that results of different versions
    /// compare.
    pub fn of_benchmarks(bounds: [[f64; 3]; 2], size: [u32; 2]) -> View {
        let bounds = bounds.map(DVec3::from_array);
        let direction = oblique(DVec3::Z);
        View::fit_upright(bounds, direction, DVec3::Z, FOVY_DEG.to_radians(), size)
    }

    /// The camera with places on the metric lattice, in place of the scan's coordinates. Directions
    /// are the same: they are those of lengths.
    #[must_use]
    pub fn measured(&self, lattice: &Lattice) -> Self {
        let measured = |place: DVec3| DVec3::from_array(lattice.measure(place.to_array()));
        Self { eye: self.eye.map(measured), target: self.target.map(measured), ..*self }
    }

    /// Axis along which elevations of a scan within `bounds` are measured: the one nearest to `up`.
    /// A parallel view along z is a plan, in which an `up` across z only chooses the upper side of
    /// the picture. An `up` with a part along z counts; that part changes no picture.
    pub fn vertical(&self, bounds: [[f64; 3]; 2]) -> Vertical {
        let [low, high] = bounds.map(DVec3::from_array);
        let target = self.target.unwrap_or(low.midpoint(high));
        let towards = self.direction.or(self.eye.map(|eye| target - eye));
        let is_plan = self.ortho.is_some()
            && towards.is_some_and(|t| t.truncate().length() <= PLAN_TILT * t.z.abs());
        let counts = |up: &DVec3| !is_plan || up.z.abs() > ACROSS * up.length();
        self.up.filter(counts).map_or(Vertical::default(), Vertical::nearest)
    }

    /// Inverse of [`Camera::measured`].
    #[must_use]
    pub fn unmeasured(&self, lattice: &Lattice) -> Self {
        let unmeasured = |place: DVec3| DVec3::from_array(lattice.unmeasure(place.to_array()));
        Self { eye: self.eye.map(unmeasured), target: self.target.map(unmeasured), ..*self }
    }

    /// [`Camera::view`] of a scan with these boxes.
    pub fn view_in(&self, boxes: &Boxes, size: [u32; 2]) -> View {
        self.view(if self.eye.is_some() { boxes.all } else { boxes.fitted }, size)
    }

    /// View of a scan within `bounds`, both on the metric lattice; fitted if the camera has no eye.
    pub fn view(&self, bounds: [[f64; 3]; 2], size: [u32; 2]) -> View {
        let fovy = self.fovy_deg.unwrap_or(FOVY_DEG).to_radians();
        let [low, high] = bounds.map(DVec3::from_array);
        let up = self.up.unwrap_or(DVec3::Z);
        let target = self.target.unwrap_or(low.midpoint(high));
        if let Some(height) = self.ortho {
            return self.parallel(height, target, [low, high], size);
        }
        if let Some(eye) = self.eye {
            let target =
                self.direction.map_or(target, |direction| eye + direction.normalize_or(direction));
            return View::look_at(eye, target, up, fovy, size[0], size[1]);
        }
        let direction = self.direction.unwrap_or_else(|| oblique(up));
        if self.target.is_none() {
            let view = View::fit_upright([low, high], direction, up, fovy, size);
            return view.centred(low, high);
        }
        // Around another target: far enough for the sphere around the scan.
        let radius = (high - low).length() * 0.5 + target.distance(low.midpoint(high));
        let narrow = (fovy * 0.5).tan() * f64::from(size[0].min(size[1])) / f64::from(size[1]);
        let distance = if radius > 0.0 { radius / narrow.atan().sin() } else { 1.0 };
        let eye = target - direction.normalize_or(DVec3::NEG_Z) * distance;
        View::look_at(eye, target, up, fovy, size[0], size[1])
    }
}

impl Camera {
    /// Parallel view of a scan, towards `target` unless the camera has an eye and a direction.
    fn parallel(
        &self,
        height: OrthoHeight,
        target: DVec3,
        [low, high]: [DVec3; 2],
        size: [u32; 2],
    ) -> View {
        let up = self.up.unwrap_or(DVec3::Z);
        let towards = match self.eye {
            Some(eye) => self.direction.unwrap_or(target - eye),
            None => self.direction.unwrap_or_else(|| oblique(up)),
        };
        // Before all of the scan.
        let radius = (high - low).length() * 0.5 + target.distance(low.midpoint(high));
        let before = target - towards.normalize_or(DVec3::NEG_Z) * radius.max(f64::MIN_POSITIVE);
        let eye = self.eye.unwrap_or(before);
        let view = View::look_at(eye, eye + towards, up, 1.0, size[0], size[1]);
        let height = match height {
            OrthoHeight::Units(height) => height,
            OrthoHeight::Fit => {
                let half = (high - low) * 0.5;
                let off = low.midpoint(high) - eye;
                let [x, y] = [view.world_from_view.x_axis, view.world_from_view.y_axis]
                    .map(|axis| axis.dot(off).abs() + half.dot(axis.abs()));
                let fitted = (x * f64::from(size[1]) / f64::from(size[0])).max(y);
                if fitted > 0.0 { fitted * 2.0 * ORTHO_MARGIN } else { 1.0 }
            }
        };
        view.parallel(height, low, high)
    }
}

/// Parses the height of the picture of a parallel camera.
fn ortho_height(text: &str) -> Result<OrthoHeight> {
    if text.trim().eq_ignore_ascii_case("fit") {
        return Ok(OrthoHeight::Fit);
    }
    let height = text.trim().parse::<f64>().ok().filter(|h| h.is_normal() && *h > 0.0);
    let height =
        height.with_context(|| format!("ortho is `{text}`, no height above 0 and no `fit`"))?;
    Ok(OrthoHeight::Units(height))
}

/// Checks a vertical field of view, degrees.
///
/// # Errors
/// If no picture can have it; the message has the limits.
pub fn check_fovy(degrees: f64) -> Result<()> {
    ensure!(
        (FOVY_MIN_DEG..175.0).contains(&degrees),
        "fovy is {degrees}, it must be at least {FOVY_MIN_DEG} and below 175 degrees"
    );
    Ok(())
}

/// A direction that looks down at about 35 degrees, a quarter turn from the axes.
fn oblique(up: DVec3) -> DVec3 {
    let up = up.normalize_or(DVec3::Z);
    let side = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
    let right = side.reject_from(up).normalize_or(DVec3::Y);
    let ahead = up.cross(right);
    ahead * 0.75 - right * 0.35 - up * 0.55
}

fn vector(text: &str) -> Result<DVec3> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|n| n.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
        .collect::<Option<_>>()
        .with_context(|| format!("`{text}` is not three numbers"))?;
    match numbers.as_slice() {
        &[x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => bail!("`{text}` is not three numbers"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_complete_camera_is_not_fitted() {
        let camera = Camera::parse("eye=1,2,3; target=4,5,6;up=0,1,0;fovy=40").unwrap();
        let view = camera.view([[0.0; 3], [9.0; 3]], [640, 480]);
        assert_eq!(view.eye, DVec3::new(1.0, 2.0, 3.0));
        assert!((view.forward() - DVec3::ONE.normalize_or_zero()).length() < 1e-12);
        assert!((view.fovy_rad.to_degrees() - 40.0).abs() < 1e-9);
    }

    #[test]
    fn an_eye_looks_along_a_direction() {
        let view = Camera::parse("eye=1e6,2,3;direction=0,-2,0").unwrap();
        let view = view.view([[0.0; 3], [9.0; 3]], [640, 480]);
        assert!((view.forward() - DVec3::NEG_Y).length() < 1e-12);
    }

    #[test]
    fn every_corner_of_a_fitted_scan_is_on_the_picture() {
        for text in ["", "up=0,1,0", "direction=0,0,-1", "direction=1,0,0;up=0,0,1;fovy=20"] {
            let view = Camera::parse(text)
                .unwrap()
                .view([[1e6, 2e6, -3.0], [1e6 + 80.0, 2e6 + 50.0, 40.0]], [800, 300]);
            for corner in 0..8 {
                let at = |bit: usize, low: f64, high: f64| {
                    if corner >> bit & 1 == 1 { high } else { low }
                };
                let p =
                    DVec3::new(at(0, 1e6, 1e6 + 80.0), at(1, 2e6, 2e6 + 50.0), at(2, -3.0, 40.0));
                let on = view.project(p).is_some_and(|p| view.is_on_picture(p));
                assert!(on, "{text}: {p} is off the picture");
            }
        }
    }

    #[test]
    fn a_parallel_camera_is_a_plan_of_the_scan() {
        let bounds = [[1e6, 2e6, -3.0], [1e6 + 80.0, 2e6 + 50.0, 40.0]];
        let size = [900, 600];
        let camera = "eye=1000040,2000025,100;direction=0,0,-1;up=0,1,0;ortho=60";
        let view = Camera::parse(camera).unwrap().view(bounds, size);
        for (x, y, z) in [(1e6, 2e6, -3.0), (1e6 + 80.0, 2e6 + 10.0, 40.0), (1e6 + 3.0, 2e6, 9.0)] {
            let seen = view.project(DVec3::new(x, y, z)).unwrap();
            let want = [450.0 + (x - 1_000_040.0) * 10.0, 300.0 - (y - 2_000_025.0) * 10.0];
            assert!((seen.x - want[0]).abs() < 1e-6 && (seen.y - want[1]).abs() < 1e-6, "{seen}");
            assert!((seen.z - view.near - (100.0 - z)).abs() < 1e-6, "{seen}");
        }
        // What is behind the eye is not drawn.
        assert!(view.project(DVec3::new(1e6, 2e6, 101.0)).is_none());
        for text in
            ["ortho=fit", "ortho=fit;direction=0,0,-1", "ortho=fit;up=1,0,0;target=1e6,2e6,0"]
        {
            let view = Camera::parse(text).unwrap().view(bounds, size);
            for corner in 0..8 {
                let p = [0, 1, 2].map(|axis| bounds[corner >> axis & 1][axis]);
                let on = view.project(p.into()).is_some_and(|p| view.is_on_picture(p));
                assert!(on, "{text}: {p:?} is off the picture");
            }
        }
    }

    #[test]
    fn a_plan_measures_elevations_along_z_whatever_is_up_in_the_picture() {
        let bounds = [[0.0; 3], [80.0, 50.0, 40.0]];
        for (text, up) in [
            ("", DVec3::Z),
            ("up=0,1,0", DVec3::Y),
            ("up=0,-1,0;direction=0,0,1", DVec3::NEG_Y),
            ("up=0,1,0.2;eye=40,25,90", DVec3::Y),
            ("up=0,1,0;ortho=fit", DVec3::Y),
            ("up=0,1,0;ortho=fit;direction=0,0.1,-1", DVec3::Y),
            ("up=0,1,0;ortho=fit;direction=0,0,-1", DVec3::Z),
            ("up=1,0,0;ortho=9;eye=40,25,90", DVec3::Z),
            ("up=0,1,-0.5;ortho=fit;direction=0,0,-1", DVec3::Y),
            ("up=0,0.5,-1;ortho=fit;direction=0,0,1", DVec3::NEG_Z),
        ] {
            let camera = Camera::parse(text).unwrap();
            assert_eq!(camera.vertical(bounds), Vertical::nearest(up), "{text}");
        }
    }

    #[test]
    fn an_axis_upwards_is_given_once() {
        let camera = Camera::parse("fovy=40").unwrap();
        let y = camera.with_up(Some(Vertical::nearest(DVec3::NEG_Y))).unwrap();
        assert_eq!(y, Camera { up: Some(DVec3::NEG_Y), ..camera });
        assert_eq!(y.with_up(None).unwrap(), y);
        let twice = y.with_up(Some(Vertical::default())).unwrap_err();
        assert!(twice.to_string().contains("two up directions"), "{twice}");
    }

    #[test]
    fn invalid_cameras_are_refused() {
        for text in [
            "eye=1,2",
            "look=1,2,3",
            "fovy=0",
            "fovy=200",
            "fovy=0.001",
            "eye=a,b,c",
            "eye=nan,0,0",
            "up",
            "up=0,0,0",
            "direction=0,0,0",
            "eye=1,2,3;target=1,2,3",
            "eye=1,2,3;eye=1,2,4",
            "eye=1,2,3;target=0,0,0;direction=1,0,0",
            "ortho=0",
            "ortho=-3",
            "ortho=1e400",
            "ortho=wide",
            "ortho=5;fovy=40",
        ] {
            assert!(Camera::parse(text).is_err(), "{text}");
        }
    }
}
