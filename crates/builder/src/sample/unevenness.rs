//! How the density of points varies: whether parts are far sparser or denser than the rest, and
//! whether it jumps or changes by degrees.

/// Distances beyond this multiple of the median, and below its inverse, are uneven in a leaf.
pub const UNEVEN: f32 = 6.0;
/// Points that are much farther apart than the median, from which on they are no strays.
const SPARSE_POINTS: usize = 32;
/// They cover at least this part of the area of a leaf; by cells, which hold less of what is beside
/// a dense part, [`SPARSE_AREA_OF_CELLS`].
pub const SPARSE_AREA: f64 = 1.0 / 3.0;
pub const SPARSE_AREA_OF_CELLS: f64 = 0.1;
/// The same for a part of a tree whose density jumps. The samples above have its sparse points,
/// which would be drawn too narrow in all of the cell of a node that is dense.
pub const JUMP_POINTS: usize = 4;
const JUMP_AREA: f64 = 1.0 / 30.0;
/// Distances beyond this multiple of the median are between dense and sparse.
const BETWEEN: f32 = 2.0;
/// What is between covers at most this part of the area of what is sparse, where density jumps.
pub const BETWEEN_AREA: f64 = 0.5;
/// Points that are closer together are at least 1 / `DENSE_SHARE` of a leaf or cell.
pub const DENSE_SHARE: usize = 32;
/// Points from which the density of a set is judged.
const POINTS_LEAST: usize = 256;

/// How the density of points varies.
pub struct Unevenness {
    /// Points that are much farther apart than the median.
    pub sparse: usize,
    /// Parts of the area that they cover, and that points cover that are a few times as far apart.
    sparse_area: f64,
    between_area: f64,
    /// Whether many points are much closer together than the median.
    is_dense: bool,
}

impl Unevenness {
    /// Of points with these local spacings, 0 where they are unknown.
    pub fn of(radii: &[f32]) -> Self {
        let mut known: Vec<f32> = radii.iter().copied().filter(|&radius| radius > 0.0).collect();
        if known.len() <= POINTS_LEAST {
            return Self { sparse: 0, sparse_area: 0.0, between_area: 0.0, is_dense: false };
        }
        let median = median(&mut known);
        let dense = known.iter().filter(|&&radius| radius < median / UNEVEN).count();
        let is_dense = dense * DENSE_SHARE >= known.len();
        Self { is_dense, ..Self::beyond(&known, [BETWEEN, UNEVEN].map(|ratio| ratio * median)) }
    }

    /// Of points whose local spacing is sparse beyond `uneven`, and between beyond `between`.
    pub fn beyond(radii: &[f32], [between, uneven]: [f32; 2]) -> Self {
        let area = |radius: f32| f64::from(radius).powi(2);
        let total: f64 = radii.iter().copied().map(area).sum::<f64>().max(f64::MIN_POSITIVE);
        let beyond = |least: f32| radii.iter().copied().filter(move |&radius| radius > least);
        let [all, sparse_area] =
            [between, uneven].map(|least| beyond(least).map(area).sum::<f64>() / total);
        Self {
            sparse: beyond(uneven).count(),
            sparse_area,
            between_area: all - sparse_area,
            is_dense: false,
        }
    }

    /// Whether sparse parts are large, or many points are dense.
    pub fn is_great(&self, sparse_area: f64) -> bool {
        self.is_dense || self.sparse >= SPARSE_POINTS && self.sparse_area > sparse_area
    }

    /// Whether the density jumps: sparse and dense parts lie side by side, and what is between
    /// covers little, at most `between` of the area of the sparse parts.
    pub fn is_jump(&self, between: f64) -> bool {
        self.sparse >= JUMP_POINTS
            && self.sparse_area > JUMP_AREA
            && self.between_area <= self.sparse_area * between
    }
}

/// Median of values, which it reorders; there must be some.
pub fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
