//! The bounding box of points, as a pass over them computes it.

/// A bounding box that grows: least and greatest coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds([[f64; 3]; 2]);

impl Bounds {
    /// The box of no points.
    pub const EMPTY: Self = Self([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]]);

    /// Extends the box to a position without NaN.
    pub fn add(&mut self, place: [f64; 3]) {
        self.merge(Self([place; 2]));
    }

    /// Extends the box to another one.
    pub fn merge(&mut self, other: Self) {
        let ([low, high], [other_low, other_high]) = (&mut self.0, other.0);
        for i in 0..3 {
            low[i] = low[i].min(other_low[i]);
            high[i] = high[i].max(other_high[i]);
        }
    }

    /// Least and greatest coordinates; `None` if the box is empty.
    pub fn get(&self) -> Option<[[f64; 3]; 2]> {
        (self.0[0][0] <= self.0[1][0]).then_some(self.0)
    }
}
