//! The axes and their values. A rated value is the hardest one of the sweep that keeps its bound,
//! or an easier one where the next is near the bound.

use crate::stability::axes::axis::{Axis, Subject};
use crate::stability::axes::scenes;
#[cfg(feature = "light")]
use crate::stability::light;
use esker_engine::calls::conditions::rated;

/// Traced light, where the program has it.
macro_rules! of_light {
    ($measure:path) => {{
        #[cfg(feature = "light")]
        let subject = Subject::Light($measure);
        #[cfg(not(feature = "light"))]
        let subject = Subject::LeftOut;
        subject
    }};
}

static AXES: [Axis; 20] = [
    Axis {
        condition: &rated::DENSITY_JUMP,
        values: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e6, 1e8],
        subject: Subject::Scan(scenes::density_jump),
    },
    Axis {
        condition: &rated::STEP,
        values: &[0.001, 0.01, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0],
        subject: Subject::Scan(scenes::step),
    },
    Axis {
        condition: &rated::NOISE,
        values: &[0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0],
        subject: Subject::Scan(scenes::noise),
    },
    Axis {
        condition: &rated::SCAN_LINES,
        values: &[1.0, 3.0, 10.0, 20.0, 50.0, 100.0, 200.0],
        subject: Subject::Scan(scenes::scan_lines),
    },
    Axis {
        condition: &rated::POINT_DISTANCE,
        values: &[1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4],
        subject: Subject::Scan(scenes::point_distance),
    },
    Axis {
        condition: &rated::EYE_HEIGHT,
        values: &[30.0, 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01],
        subject: Subject::Scan(scenes::height),
    },
    Axis {
        condition: &rated::WIDE_VIEW,
        values: &[60.0, 90.0, 120.0, 150.0, 170.0, 174.9, 175.0],
        subject: Subject::Scan(scenes::wide),
    },
    Axis {
        condition: &rated::NARROW_VIEW,
        values: &[60.0, 10.0, 1.0, 0.1, 0.01, 0.006, 0.005],
        subject: Subject::Scan(scenes::narrow),
    },
    Axis {
        condition: &rated::EYE_DISTANCE,
        values: &[1.0, 1e2, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
        subject: Subject::Scan(scenes::eye_distance),
    },
    Axis {
        condition: &rated::SAME_PLACE,
        values: &[0.0, 0.5, 0.9, 0.99, 0.999],
        subject: Subject::Scan(scenes::same_place),
    },
    Axis {
        condition: &rated::THICKNESS,
        values: &[8.0, 4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.01],
        subject: Subject::Scan(scenes::thickness),
    },
    Axis {
        condition: &rated::PARTS,
        values: &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0],
        subject: Subject::Scan(scenes::parts),
    },
    Axis {
        condition: &rated::CLOSE_UP,
        values: &[0.5, 0.2, 0.1, 0.05, 0.02],
        subject: Subject::Scan(scenes::close_up),
    },
    Axis {
        condition: &rated::PATCHES,
        values: &[1.0, 3.0, 10.0, 30.0, 100.0],
        subject: Subject::Scan(scenes::patches),
    },
    Axis {
        condition: &rated::ALBEDO,
        values: &[0.2, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0],
        subject: of_light!(light::paths::albedo),
    },
    Axis {
        condition: &rated::LAMP_SIZE,
        values: &[1.0, 0.1, 0.01, 1e-4, 1e-6, 1e-7, 1e-8, 1e-10, 1e-11, 1e-12, 1e-16, 1e-20],
        subject: of_light!(light::paths::lamp_size),
    },
    Axis {
        condition: &rated::LIT_DISTANCE,
        values: &[1e2, 1e4, 1e5, 1e6, 1e7, 3e7, 1e8, 1e9],
        subject: of_light!(light::paths::distance),
    },
    Axis {
        condition: &rated::HDR_RANGE,
        values: &[1.0, 1e2, 1e4, 1e6, 1e8, 1e10, 1e12, 1e14, 1e16, 1e18, 1e20],
        subject: of_light!(light::filters::range),
    },
    Axis {
        condition: &rated::GUIDE_NOISE,
        values: &[0.0, 1.0, 3.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0],
        subject: of_light!(light::filters::guide_noise),
    },
    Axis {
        condition: &rated::FILTER_EPSILON,
        values: &[1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14],
        subject: of_light!(light::filters::epsilon),
    },
];

/// All axes.
pub(in crate::stability) fn all() -> &'static [Axis] {
    &AXES
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::report::short;
    use std::path::Path;

    #[test]
    fn the_limits_that_are_written_down_are_those_that_are_tested() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/limits.md");
        let text = std::fs::read_to_string(path).expect("docs/limits.md");
        let rows: Vec<Vec<&str>> = text
            .lines()
            .filter(|line| line.starts_with("| "))
            .map(|line| line.split('|').skip(1).take(6).map(str::trim).collect())
            .skip(1)
            .collect();
        let tested = all().iter().flat_map(|axis| {
            axis.condition.gauges.iter().map(|gauge| {
                [
                    axis.condition.name.to_owned(),
                    axis.condition.value_is.to_owned(),
                    gauge.method.to_owned(),
                    gauge.measure.name().to_owned(),
                    short(gauge.bound),
                    short(gauge.rated_to),
                ]
            })
        });
        assert_eq!(rows, tested.collect::<Vec<_>>());
    }

    #[test]
    fn rated_values_are_values_of_their_sweep() {
        for axis in all() {
            for gauge in axis.condition.gauges {
                assert!(axis.values.contains(&gauge.rated_to), "{}", axis.condition.name);
            }
        }
    }
}
