//! The axes, their values and what is rated. A rated value is the hardest one of the sweep that
//! keeps its bound, or an easier one where the next is near the bound.

use crate::stability::axes::axis::Measure::{Depth, Flip, Holes, Normals, Parts, Place, Width};
use crate::stability::axes::axis::{Axis, Gauge, Measure};
use crate::stability::axes::scenes;
use crate::stability::relations::PART_SHARE;

const fn gauge(method: &'static str, measure: Measure, bound: f64, rated_to: f64) -> Gauge {
    Gauge { method, measure, bound, rated_to }
}

static AXES: [Axis; 12] = [
    Axis {
        name: "density-jump",
        value_is: "ratio of densities within a node",
        values: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e6, 1e8],
        scene: scenes::density_jump,
        gauges: &[gauge("pull-push", Holes, 0.01, 1.0), gauge("ewa", Holes, 0.01, 1.0)],
    },
    Axis {
        name: "step",
        value_is: "step of the coordinates over the distance of points",
        values: &[0.001, 0.01, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0],
        scene: scenes::step,
        gauges: &[
            gauge("pull-push", Flip, 0.1, 1.0),
            gauge("ewa", Flip, 0.1, 1.0),
            gauge("ewa", Depth, 1.0, 1.0),
            gauge("points", Normals, 10.0, 4.0),
        ],
    },
    Axis {
        name: "noise",
        value_is: "standard deviation over the distance of points",
        values: &[0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0],
        scene: scenes::noise,
        gauges: &[
            gauge("pull-push", Flip, 0.1, 0.5),
            gauge("ewa", Flip, 0.1, 0.5),
            gauge("ewa", Depth, 1.0, 0.2),
            gauge("points", Normals, 10.0, 1.0),
        ],
    },
    Axis {
        name: "scan-lines",
        value_is: "distance of rows over that of columns",
        values: &[1.0, 3.0, 10.0, 20.0, 50.0, 100.0, 200.0],
        scene: scenes::scan_lines,
        gauges: &[
            gauge("pull-push", Holes, 0.01, 10.0),
            gauge("ewa", Holes, 0.01, 10.0),
            gauge("points", Normals, 10.0, 50.0),
        ],
    },
    Axis {
        name: "point-distance",
        value_is: "distance of points on the picture, pixels",
        values: &[1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4],
        scene: scenes::point_distance,
        gauges: &[
            gauge("auto", Holes, 0.01, 30.0),
            gauge("pull-push", Holes, 0.01, 30.0),
            gauge("ewa", Holes, 0.01, 1e3),
            gauge("ewa", Depth, 1.0, 1e3),
        ],
    },
    Axis {
        name: "eye-height",
        value_is: "height of the eye over a floor, distances of its points",
        values: &[30.0, 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01],
        scene: scenes::height,
        gauges: &[
            gauge("pull-push", Holes, 0.01, 1.0),
            gauge("ewa", Holes, 0.01, 0.1),
            gauge("ewa", Flip, 0.1, 0.1),
        ],
    },
    Axis {
        name: "wide-view",
        value_is: "field of view, degrees",
        values: &[60.0, 90.0, 120.0, 150.0, 170.0, 174.9, 175.0],
        scene: scenes::wide,
        gauges: &[
            gauge("pull-push", Holes, 0.01, 174.9),
            gauge("ewa", Holes, 0.01, 174.9),
            gauge("ewa", Flip, 0.1, 174.9),
        ],
    },
    Axis {
        name: "narrow-view",
        value_is: "field of view that a ball fills, degrees",
        values: &[60.0, 10.0, 1.0, 0.1, 0.01, 0.006, 0.005],
        scene: scenes::narrow,
        gauges: &[
            gauge("pull-push", Flip, 0.1, 0.006),
            gauge("ewa", Flip, 0.1, 0.006),
            gauge("ewa", Depth, 1.0, 0.006),
        ],
    },
    Axis {
        name: "eye-distance",
        value_is: "distance of the eye, extents of the scan",
        values: &[1.0, 1e2, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
        scene: scenes::eye_distance,
        gauges: &[
            gauge("points", Place, 1.0, 1e8),
            gauge("pull-push", Place, 1.0, 1e8),
            gauge("ewa", Place, 1.0, 1e8),
        ],
    },
    Axis {
        name: "same-place",
        value_is: "share of points at one place",
        values: &[0.0, 0.5, 0.9, 0.99, 0.999],
        scene: scenes::same_place,
        gauges: &[gauge("pull-push", Holes, 0.01, 0.999), gauge("ewa", Holes, 0.01, 0.999)],
    },
    Axis {
        name: "thickness",
        value_is: "width of strips over the distance of points",
        values: &[8.0, 4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.01],
        scene: scenes::thickness,
        gauges: &[
            gauge("auto", Width, 2.5, 0.01),
            gauge("pull-push", Width, 2.5, 0.01),
            gauge("ewa", Width, 2.5, 2.0),
        ],
    },
    Axis {
        name: "parts",
        value_is: "distance of points of a rough surface on the picture, pixels",
        values: &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0],
        scene: scenes::parts,
        gauges: &[
            gauge("pull-push", Parts, PART_SHARE, 8.0),
            gauge("auto", Parts, PART_SHARE, 8.0),
            gauge("ewa", Parts, PART_SHARE, 8.0),
        ],
    },
];

/// All axes.
pub(in crate::stability) fn all() -> &'static [Axis] {
    &AXES
}
