//! What a frame will cost, and the settings of the best picture within a time: a model of CPU time
//! by method, from the points and pixels of a frame, that [`crate::draw::calibration`] measures on
//! this machine. Without a budget of time nothing depends on it.

use crate::draw::method::{METHODS, Method};
use crate::draw::scene::{PictureRequest, PictureScene};
use anyhow::{Result, ensure};
use esker_format::Forest;
use esker_lod::covered_share;
use serde::{Deserialize, Serialize};

/// Scales of the picture's sides that are tried, finest first.
const SCALES: [f64; 9] = [1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.42, 0.35, 0.28];
/// Fewest points that a budget leaves.
const POINTS_MIN: u64 = 10_000;

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

/// The settings of the best picture within a time.
#[derive(Clone, Debug)]
pub struct Paced {
    /// The request with these settings, of a picture of `scale` times the size.
    pub request: PictureRequest,
    /// Side of the drawn picture over that of the wanted one.
    pub scale: f64,
    /// CPU time that the model predicts, milliseconds.
    pub cpu_ms: f64,
    /// Wall time that follows, milliseconds.
    pub wall_ms: f64,
}

/// Chooses settings for a picture of `file` that takes at most `budget_ms` of wall time: those of
/// the request if there is time, else a coarser resolution, then points alone, then fewer points.
/// If nothing is fast enough, the fastest.
///
/// # Errors
/// If the method was not measured, or the choice of nodes fails.
pub fn paced(
    file: &Forest,
    request: &PictureRequest,
    pace: &Pace,
    budget_ms: f64,
) -> Result<Paced> {
    ensure!(
        pace.cost(request.method).is_some() && request.window.is_none(),
        "a budget of time is for whole pictures by auto, pull-push, ewa or points"
    );
    let predicted = |request: PictureRequest, scale: f64| predict(file, request, scale, pace);
    let whole = predicted(request.clone(), 1.0)?;
    if whole.wall_ms <= budget_ms {
        return Ok(whole);
    }
    for scale in SCALES.into_iter().skip(1) {
        let coarser = predicted(request.clone(), scale)?;
        if coarser.wall_ms <= budget_ms {
            return Ok(coarser);
        }
    }
    let alone = PictureRequest { method: Method::Points, ..request.clone() };
    let mut last = predicted(alone.clone(), SCALES[SCALES.len() - 1])?;
    let mut points = alone.budget_points.min(file.points());
    while last.wall_ms > budget_ms && points > POINTS_MIN {
        points /= 2;
        let fewer = PictureRequest { budget_points: points.max(POINTS_MIN), ..alone.clone() };
        last = predicted(fewer, SCALES[SCALES.len() - 1])?;
    }
    Ok(last)
}

/// Predicts the time of a picture of `scale` times the size of the request.
fn predict(file: &Forest, request: PictureRequest, scale: f64, pace: &Pace) -> Result<Paced> {
    let size = request.size.map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    let request = PictureRequest { size, ..request };
    let scene = PictureScene::choose(file, &request)?;
    let load = load_of(file, &scene);
    let cpu_ms = pace.cost(request.method).copied().unwrap_or_default().cpu_ms(load);
    Ok(Paced { request, scale, cpu_ms, wall_ms: cpu_ms / pace.parallel.max(1e-3) })
}

/// What a frame of a scene has, estimated before it is drawn.
pub fn load_of(file: &Forest, scene: &PictureScene) -> Load {
    let view = &scene.view;
    let pixels = f64::from(view.width) * f64::from(view.height);
    let share = covered_share(&file.table().nodes, file.metric(), view, &scene.selection.drawn);
    Load { points: scene.selection.counters.points as f64, pixels, covered: share * pixels }
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
