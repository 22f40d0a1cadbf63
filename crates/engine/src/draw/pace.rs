//! What a frame will cost: a model of CPU time by method, from the points and pixels of a frame,
//! that [`crate::draw::calibration`] measures on this machine. It is of warm frames, all but the
//! first of a renderer, which also waits for memory. [`crate::draw::choice`] corrects it for a
//! view.

use crate::draw::method::{METHODS, Method};
use serde::{Deserialize, Serialize};

/// CPU time of a frame, milliseconds: linear in what the frame has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Of any frame.
    pub frame_ms: f64,
    /// A million points.
    pub points_ms: f64,
    /// A million pixels of the picture.
    pub pixels_ms: f64,
    /// A million covered pixels, beside what any pixel costs.
    pub covered_ms: f64,
}

/// What a frame has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Points that are drawn.
    pub points: f64,
    /// Pixels of the picture, with its margin.
    pub pixels: f64,
    /// Those that show a surface.
    pub covered: f64,
}

impl Load {
    /// What multiplies the terms of a cost.
    fn terms(self) -> [f64; 4] {
        [1.0, self.points / 1e6, self.pixels / 1e6, self.covered / 1e6]
    }
}

impl Cost {
    /// CPU time of a frame, milliseconds.
    pub fn cpu_ms(&self, load: Load) -> f64 {
        let own = [self.frame_ms, self.points_ms, self.pixels_ms, self.covered_ms];
        own.iter().zip(load.terms()).map(|(cost, term)| cost * term).sum()
    }

    /// The cost of which measured times differ least, by ratio; no term is negative.
    pub fn fit(measured: &[(Load, f64)]) -> Self {
        /// Rounds over all terms; two digits settle in a few hundred.
        const ROUNDS: usize = 2000;
        let rows: Vec<[f64; 4]> = measured
            .iter()
            .map(|(load, ms)| load.terms().map(|term| term / ms.max(1e-9)))
            .collect();
        // Least squares of ratios to one, a term at a time, without falling below zero.
        let mut cost = [0.0; 4];
        for _ in 0..ROUNDS {
            for i in 0..4 {
                let rest = |row: &[f64; 4]| {
                    1.0 - (0..4).filter(|&k| k != i).map(|k| row[k] * cost[k]).sum::<f64>()
                };
                let over: f64 = rows.iter().map(|row| row[i] * row[i]).sum();
                if over > 0.0 {
                    let sum: f64 = rows.iter().map(|row| row[i] * rest(row)).sum();
                    cost[i] = (sum / over).max(0.0);
                }
            }
        }
        let [frame_ms, points_ms, pixels_ms, covered_ms] = cost;
        Self { frame_ms, points_ms, pixels_ms, covered_ms }
    }
}

/// The model of a machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Threads that draw.
    pub threads: usize,
    /// CPU time of frames over their wall time.
    pub parallel: f64,
    /// Time that threads waited for a core while this was measured, over CPU time: what other
    /// programs took. 0 where the system does not tell.
    pub waited: f64,
    /// Cost of each method, by its name.
    pub costs: Vec<(String, Cost)>,
}

impl Pace {
    /// The cost of a method; `None` if it was not measured.
    pub fn cost(&self, method: Method) -> Option<&Cost> {
        let (_, name, _) = METHODS.iter().find(|(own, ..)| *own == method)?;
        self.costs.iter().find(|(known, _)| known == name).map(|(_, cost)| cost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fitted_cost_predicts_what_it_was_fitted_to() {
        let truth = Cost { frame_ms: 0.3, points_ms: 12.0, pixels_ms: 2.0, covered_ms: 30.0 };
        let load = |points, pixels, share| Load { points, pixels, covered: pixels * share };
        let loads = [
            load(1e5, 1.5e5, 0.9),
            load(4e5, 1.5e5, 0.5),
            load(4e5, 6e5, 0.9),
            load(1e6, 6e5, 0.3),
            load(2e5, 2e6, 0.6),
        ];
        let measured = loads.map(|load| (load, truth.cpu_ms(load)));
        let fitted = Cost::fit(&measured);
        for (load, ms) in measured {
            assert!((fitted.cpu_ms(load) / ms - 1.0).abs() < 0.02, "{fitted:?}");
        }
        let other = load(3e6, 1e6, 0.7);
        assert!((fitted.cpu_ms(other) / truth.cpu_ms(other) - 1.0).abs() < 0.1, "{fitted:?}");
    }

    #[test]
    fn no_term_of_a_cost_is_negative() {
        // More pixels that cost less: noise.
        let load = |pixels| Load { points: 1e5, pixels, covered: pixels };
        let cost = Cost::fit(&[(load(1e5), 5.0), (load(4e5), 4.0), (load(1e6), 4.5)]);
        let Cost { frame_ms, points_ms, pixels_ms, covered_ms } = cost;
        assert!([frame_ms, points_ms, pixels_ms, covered_ms].iter().all(|term| *term >= 0.0));
        assert!((cost.cpu_ms(load(5e5)) - 4.5).abs() < 0.5, "{cost:?}");
    }
}
