//! Quantiles of measured values: what reports give in place of single times.

use esker_render::PassTimes;

/// Smallest of `values` that at least `share` of them, 0 to 1, do not exceed; 0 if there is none.
pub(crate) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
}

/// Median time of whole frames, milliseconds; `None` if there is no frame.
pub(crate) fn median_ms(frames: &[PassTimes]) -> Option<f64> {
    let all: Vec<f64> = frames.iter().map(|s| s.total_ms).collect();
    (!all.is_empty()).then(|| quantile(&all, 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|s| quantile(&values, s)), [1.0, 50.0, 99.0, 100.0]);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }
}
