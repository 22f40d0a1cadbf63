//! Conditions of scans and views, and the values up to which pictures are rated: the one place that
//! has them. `esker bench stability` tests them, `docs/limits.md` lists them, and
//! [`super::conditions`] puts the values of a scan beside them.

use Measure::{
    Beside, DarkMesh, DarkPoints, Depth, Energy, Flip, Guided, Holes, LampLight, MeshLamp,
    MeshLight, Normals, Parts, Place, PointLight, Radius, Regression, Spill, Width,
};

/// A condition.
#[derive(Debug)]
pub struct Condition {
    /// Name in reports.
    pub name: &'static str,
    /// Meaning of its values.
    pub value_is: &'static str,
    /// What is bounded.
    pub gauges: &'static [Gauge],
}

/// A bound on an error of a method.
#[derive(Debug)]
pub struct Gauge {
    /// Method, as on the command line.
    pub method: &'static str,
    /// The error.
    pub measure: Measure,
    /// Maximum permissible error.
    pub bound: f64,
    /// Value of the condition up to which it must hold.
    pub rated_to: f64,
}

/// An error that is bounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Mean of FLIP, 0 to 1.
    Flip,
    /// Share of the interior of surfaces that is empty, or shows what lies behind.
    Holes,
    /// Mean error of depths inside surfaces, widths of a pixel.
    Depth,
    /// Mean error of normals, degrees.
    Normals,
    /// Distance of the middle of what is drawn from the middle of the picture, where the camera
    /// looks, pixels.
    Place,
    /// Share of the pixels that differ between a picture and its two halves.
    Parts,
    /// Width by which things are drawn too wide, in distances of their points.
    Width,
    /// Mean deviation of the radii of points from their distances, octaves, on the patches of the
    /// density where it is greater.
    Radius,
    /// Share of the chosen points that are in nodes of which no point is on the picture.
    Beside,
    /// Share by which the mean light of a closed mesh is off.
    MeshLight,
    /// Share by which the mean light of a closed surface of points is off.
    PointLight,
    /// Share by which the light of a lamp is off.
    LampLight,
    /// Share by which the light of a mesh that shines is off.
    MeshLamp,
    /// Share of the pixels of a mesh whose light is off by more than a step of 8 bits.
    DarkMesh,
    /// Share of the pixels of a surface of points whose light is off by more than that.
    DarkPoints,
    /// Share of the mean light that the filter adds or takes.
    Energy,
    /// Greatest share by which light is off that no bright pixel reaches, by the filter.
    Spill,
    /// Error of filtered light over that without normals as guides.
    Guided,
    /// Greatest difference of the guided filter from a regression in 64 bits, over the mean light
    /// around.
    Regression,
}

impl Measure {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flip => "FLIP",
            Self::Holes => "holes, share",
            Self::Depth => "depth, px",
            Self::Normals => "normals, degrees",
            Self::Place => "place, px",
            Self::Parts => "differing pixels, share",
            Self::Width => "extra width, spacings",
            Self::Radius => "radii, octaves",
            Self::Beside => "points of nodes beside, share",
            Self::MeshLight => "light in a mesh, share off",
            Self::PointLight => "light among points, share off",
            Self::LampLight => "light of a lamp, share off",
            Self::MeshLamp => "light of a mesh, share off",
            Self::DarkMesh => "wrong pixels of a mesh, share",
            Self::DarkPoints => "wrong pixels of points, share",
            Self::Energy => "energy of the filter, share off",
            Self::Spill => "spill of the filter, share off",
            Self::Guided => "error, times that without normals",
            Self::Regression => "guided filter, share off",
        }
    }
}

/// Share of the pixels by which a picture may differ from its two halves.
pub const PART_SHARE: f64 = 1e-5;

/// Share by which light may be off: a step of 255 in the middle of the greys of sRGB, whose curve
/// there has a slope of 0.018 a step.
pub const LIGHT_SHARE: f64 = 0.02;

const fn gauge(method: &'static str, measure: Measure, bound: f64, rated_to: f64) -> Gauge {
    Gauge { method, measure, bound, rated_to }
}

/// Density that changes within a node.
pub static DENSITY_JUMP: Condition = Condition {
    name: "density-jump",
    value_is: "ratio of densities within a node",
    gauges: &[gauge("pull-push", Holes, 0.01, 1.0), gauge("ewa", Holes, 0.01, 1.0)],
};

/// Coordinates rounded to a coarse step.
pub static STEP: Condition = Condition {
    name: "step",
    value_is: "step of the coordinates over the distance of points",
    gauges: &[
        gauge("pull-push", Flip, 0.1, 1.0),
        gauge("ewa", Flip, 0.1, 1.0),
        gauge("ewa", Depth, 1.0, 1.0),
        gauge("points", Normals, 10.0, 4.0),
    ],
};

/// Noise across a surface.
pub static NOISE: Condition = Condition {
    name: "noise",
    value_is: "standard deviation over the distance of points",
    gauges: &[
        gauge("pull-push", Flip, 0.1, 0.5),
        gauge("ewa", Flip, 0.1, 0.5),
        gauge("ewa", Depth, 1.0, 0.2),
        gauge("points", Normals, 10.0, 1.0),
    ],
};

/// Rows of a scanner that are farther apart than the points of a row.
pub static SCAN_LINES: Condition = Condition {
    name: "scan-lines",
    value_is: "distance of rows over that of columns",
    gauges: &[
        gauge("pull-push", Holes, 0.01, 10.0),
        gauge("ewa", Holes, 0.01, 10.0),
        gauge("points", Normals, 10.0, 50.0),
    ],
};

/// Points that are far apart on the picture.
pub static POINT_DISTANCE: Condition = Condition {
    name: "point-distance",
    value_is: "distance of points on the picture, pixels",
    gauges: &[
        gauge("auto", Holes, 0.01, 30.0),
        gauge("pull-push", Holes, 0.01, 30.0),
        gauge("ewa", Holes, 0.01, 1e3),
        gauge("ewa", Depth, 1.0, 1e3),
    ],
};

/// An eye close above a floor.
pub static EYE_HEIGHT: Condition = Condition {
    name: "eye-height",
    value_is: "height of the eye over a floor, distances of its points",
    gauges: &[
        gauge("pull-push", Holes, 0.01, 1.0),
        gauge("ewa", Holes, 0.01, 0.1),
        gauge("ewa", Flip, 0.1, 0.1),
    ],
};

/// A wide field of view.
pub static WIDE_VIEW: Condition = Condition {
    name: "wide-view",
    value_is: "field of view, degrees",
    gauges: &[
        gauge("pull-push", Holes, 0.01, 174.9),
        gauge("ewa", Holes, 0.01, 174.9),
        gauge("ewa", Flip, 0.1, 174.9),
    ],
};

/// A narrow field of view.
pub static NARROW_VIEW: Condition = Condition {
    name: "narrow-view",
    value_is: "field of view that a ball fills, degrees",
    gauges: &[
        gauge("pull-push", Flip, 0.1, 0.006),
        gauge("ewa", Flip, 0.1, 0.006),
        gauge("ewa", Depth, 1.0, 0.006),
    ],
};

/// An eye far from the scan.
pub static EYE_DISTANCE: Condition = Condition {
    name: "eye-distance",
    value_is: "distance of the eye, extents of the scan",
    gauges: &[
        gauge("points", Place, 1.0, 1e8),
        gauge("pull-push", Place, 1.0, 1e8),
        gauge("ewa", Place, 1.0, 1e8),
    ],
};

/// Many points at one place.
pub static SAME_PLACE: Condition = Condition {
    name: "same-place",
    value_is: "share of points at one place",
    gauges: &[gauge("pull-push", Holes, 0.01, 0.999), gauge("ewa", Holes, 0.01, 0.999)],
};

/// Thin parts.
pub static THICKNESS: Condition = Condition {
    name: "thickness",
    value_is: "width of strips over the distance of points",
    gauges: &[
        gauge("auto", Width, 2.5, 0.01),
        gauge("pull-push", Width, 2.5, 0.01),
        gauge("ewa", Width, 2.5, 2.0),
    ],
};

/// A rough surface, drawn in parts.
pub static PARTS: Condition = Condition {
    name: "parts",
    value_is: "distance of points of a rough surface on the picture, pixels",
    gauges: &[
        gauge("pull-push", Parts, PART_SHARE, 8.0),
        gauge("auto", Parts, PART_SHARE, 8.0),
        gauge("ewa", Parts, PART_SHARE, 8.0),
    ],
};

/// A camera that sees a small part of a scan.
pub static CLOSE_UP: Condition = Condition {
    name: "close-up",
    value_is: "height of the picture over that of the scan",
    gauges: &[gauge("points", Beside, 0.1, 0.5)],
};

/// Patches of two densities by turns.
pub static PATCHES: Condition = Condition {
    name: "patches",
    value_is: "ratio of densities of adjacent patches",
    gauges: &[gauge("ewa", Radius, 0.5, 30.0)],
};

/// Surfaces that reflect nearly all light, in a closed scene.
pub static ALBEDO: Condition = Condition {
    name: "albedo",
    value_is: "albedo of a closed scene, at 64 bounces",
    gauges: &[
        gauge("lit", MeshLight, LIGHT_SHARE, 0.9),
        gauge("lit", PointLight, LIGHT_SHARE, 0.9),
    ],
};

/// Small lamps.
pub static LAMP_SIZE: Condition = Condition {
    name: "lamp-size",
    value_is: "side of a square lamp over its distance",
    gauges: &[
        gauge("lit", LampLight, LIGHT_SHARE, 1e-11),
        gauge("lit", MeshLamp, LIGHT_SHARE, 1e-6),
    ],
};

/// Surfaces far from the eye, which is the origin of lit scenes: rays start from rounded places.
/// The bound is that of holes, as pixels are wrong in the same way.
pub static LIT_DISTANCE: Condition = Condition {
    name: "lit-distance",
    value_is: "distance of a lit surface from the eye, distances of its points",
    gauges: &[gauge("lit", DarkPoints, 0.01, 1e7), gauge("lit", DarkMesh, 0.01, 1e7)],
};

/// Pixels that are much brighter than others before they are filtered. Those above 1e18 are left
/// out of the filter and keep their light.
pub static HDR_RANGE: Condition = Condition {
    name: "hdr-range",
    value_is: "light of bright pixels over that of others, before the filter",
    gauges: &[gauge("lit", Energy, LIGHT_SHARE, 1e18), gauge("lit", Spill, LIGHT_SHARE, 1e6)],
};

/// Noise of the normals that guide the filter. Beyond the bound it would be better without them.
pub static GUIDE_NOISE: Condition = Condition {
    name: "guide-noise",
    value_is: "standard deviation of the normals that guide the filter, degrees",
    gauges: &[gauge("lit", Guided, 1.0, 60.0)],
};

/// A small epsilon of the guided filter, whose matrices are then nearly singular; it takes none
/// below 1e-10. The bound is half a step of 255 of white.
pub static FILTER_EPSILON: Condition = Condition {
    name: "filter-epsilon",
    value_is: "epsilon of the guided filter",
    gauges: &[gauge("lit", Regression, 0.002, 1e-10)],
};
