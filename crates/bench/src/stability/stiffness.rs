//! Exponents of the time of a build: how it grows with the number of points, and with what makes a
//! scan difficult. A build that is stiff in a property takes a power of it.

use crate::quantile::quantile;
use crate::stability::axes::scenes;
use crate::stability::cloud::Cloud;
use crate::stability::lab::Lab;
use crate::stability::report::{Stiffness, Verdict};
use anyhow::Result;
use esker_builder::Options;
use esker_engine::machine::system;
use std::time::Instant;

/// Greatest slope.
const SLOPE_MAX: f64 = 1.1;
/// Builds whose median is taken.
const RUNS: usize = 3;
/// Points of scans whose number does not change, quickly and in full.
const POINTS: [usize; 2] = [100_000, 1_000_000];

/// A property, its values, and the scan of a value with a number of points.
type Property = (&'static str, &'static [f64], fn(f64, usize) -> Cloud);

const PROPERTIES: [Property; 4] = [
    ("number of points", &[0.25, 0.5, 1.0, 2.0, 4.0], |times, points| {
        scenes::plane((points as f64 * times) as usize)
    }),
    ("points at one place, one to", &[1.0, 2.0, 10.0, 100.0, 1000.0], |times, points| {
        scenes::coincident(1.0 - 1.0 / times, points)
    }),
    ("density jump", &[1.0, 1e2, 1e4, 1e6, 1e8], |jump, points| scenes::jump(jump, points).0),
    ("distance of an outlier, extents", &[1.0, 1e2, 1e4, 1e6], |times, points| {
        scenes::outlier(times, points)
    }),
];

/// Measures all properties.
///
/// # Errors
/// If a scan cannot be built.
pub(super) fn all(lab: &Lab<'_>) -> Result<Vec<Stiffness>> {
    PROPERTIES.into_iter().map(|property| one(property, lab)).collect()
}

fn one((axis, values, scan): Property, lab: &Lab<'_>) -> Result<Stiffness> {
    lab.phase(&format!("time: {axis}"))?;
    let mut cpu_ms = Vec::new();
    let points = POINTS[usize::from(lab.is_full)];
    for value in values {
        let cloud = scan(*value, points);
        let mut times = Vec::new();
        for _ in 0..RUNS {
            let (start, before) = (Instant::now(), system::cpu_ms());
            lab.build(&[&cloud], &Options::default())?;
            let wall_ms = start.elapsed().as_secs_f64() * 1e3;
            let taken = system::cpu_ms().zip(before).map(|(now, before)| now - before);
            times.push(taken.unwrap_or(wall_ms));
        }
        cpu_ms.push(quantile(&times, 0.5));
    }
    let slope = slope(values, &cpu_ms);
    let verdict = if slope <= SLOPE_MAX { Verdict::Holds } else { Verdict::Breaks };
    Ok(Stiffness { axis, values: values.to_vec(), cpu_ms, slope, bound: SLOPE_MAX, verdict })
}

/// Slope of a line fitted to the logarithms of values and times.
fn slope(values: &[f64], times: &[f64]) -> f64 {
    let logs: Vec<(f64, f64)> =
        values.iter().zip(times).map(|(x, y)| (x.ln(), y.max(1e-3).ln())).collect();
    let count = logs.len().max(1) as f64;
    let mean_x = logs.iter().map(|(x, _)| x).sum::<f64>() / count;
    let mean_y = logs.iter().map(|(_, y)| y).sum::<f64>() / count;
    let above: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let below: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    if below > 0.0 { above / below } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_power_is_its_exponent() {
        let values = [1.0, 2.0, 8.0, 64.0];
        let times = values.map(|v: f64| 7.0 * v.powf(1.3));
        assert!((slope(&values, &times) - 1.3).abs() < 1e-9);
        assert_eq!(slope(&[3.0], &[5.0]), 0.0);
    }
}
