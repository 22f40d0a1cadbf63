//! The axes and their values. A rated value is the hardest one of the sweep that keeps its bound,
//! or an easier one where the next is near the bound.

use crate::stability::axes::axis::Axis;
use crate::stability::axes::scenes;
use esker_engine::calls::conditions::rated;

static AXES: [Axis; 12] = [
    Axis {
        condition: &rated::DENSITY_JUMP,
        values: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e6, 1e8],
        scene: scenes::density_jump,
    },
    Axis {
        condition: &rated::STEP,
        values: &[0.001, 0.01, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0],
        scene: scenes::step,
    },
    Axis {
        condition: &rated::NOISE,
        values: &[0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0],
        scene: scenes::noise,
    },
    Axis {
        condition: &rated::SCAN_LINES,
        values: &[1.0, 3.0, 10.0, 20.0, 50.0, 100.0, 200.0],
        scene: scenes::scan_lines,
    },
    Axis {
        condition: &rated::POINT_DISTANCE,
        values: &[1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4],
        scene: scenes::point_distance,
    },
    Axis {
        condition: &rated::EYE_HEIGHT,
        values: &[30.0, 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01],
        scene: scenes::height,
    },
    Axis {
        condition: &rated::WIDE_VIEW,
        values: &[60.0, 90.0, 120.0, 150.0, 170.0, 174.9, 175.0],
        scene: scenes::wide,
    },
    Axis {
        condition: &rated::NARROW_VIEW,
        values: &[60.0, 10.0, 1.0, 0.1, 0.01, 0.006, 0.005],
        scene: scenes::narrow,
    },
    Axis {
        condition: &rated::EYE_DISTANCE,
        values: &[1.0, 1e2, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
        scene: scenes::eye_distance,
    },
    Axis {
        condition: &rated::SAME_PLACE,
        values: &[0.0, 0.5, 0.9, 0.99, 0.999],
        scene: scenes::same_place,
    },
    Axis {
        condition: &rated::THICKNESS,
        values: &[8.0, 4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.01],
        scene: scenes::thickness,
    },
    Axis {
        condition: &rated::PARTS,
        values: &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0],
        scene: scenes::parts,
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
