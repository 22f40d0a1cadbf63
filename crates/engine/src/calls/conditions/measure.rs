//! Conditions of the points of a cell, of all that are drawn there at full resolution. Some points
//! are asked for their nearest neighbours; a query whose neighbours reach beyond the cell, where
//! other cells go on, does not count.

use esker_builder::attributes::eigen::Eigen;
use glam::DVec3;
use std::f64::consts::PI;

/// Points that are asked for their neighbours, of each kind: evenly spread over the points, and
/// evenly spread over the cell.
pub(super) const QUERIES: usize = 64;
/// Fewest queries, and points, of which a cell has a value.
const QUERIES_MIN: usize = 8;
const POINTS_MIN: usize = 64;
/// Neighbours of which the distance of points and the noise are taken.
const NEAR: usize = 16;
/// Neighbours of which the density is taken: random points then have densities that differ by 1.9
/// between the outermost shares.
const DENSE: usize = 32;
/// Neighbours of which the direction of a row is taken.
const ROW: usize = 6;
/// Neighbours of which the width is taken: a share of all points, within these numbers.
const WIDE: [usize; 2] = [32, 256];
const WIDE_SHARE: usize = 16;
/// Where the middle of the neighbours is farther away than this share of their radius, a surface
/// ends or its density jumps, and the density there is not that of the points.
const OFF_CENTRE: f64 = 0.3;
/// Step over the distance of places from which points at one place were put there by rounding.
const STEP_COARSE: f64 = 0.7;
/// Share of the queries at either end that count as strays.
const STRAYS: f64 = 0.03;
/// Share of the queries that are thinner than the width of a cell.
const THIN: f64 = 0.05;
/// Where the radius grows so many times for neighbours four times as many, points form a line: the
/// root of the 2 of surfaces and the 4 of lines, for the powers of other numbers.
const LINE_POWER: f64 = 0.75;

/// Points of a cell.
pub(super) struct CellPoints {
    /// Places, each once, in the metric unit of the file.
    pub places: Vec<DVec3>,
    /// Indices of the queries that are evenly spread over the points, and over the cell.
    pub by_points: Vec<usize>,
    pub by_place: Vec<usize>,
    /// The box of the cell; infinite where nothing goes on.
    pub inside: [DVec3; 2],
    /// Greatest common step of the coordinates, the metric unit.
    pub step: f64,
    /// Greatest share of the points at one place.
    pub same_place: f64,
    /// Points over places.
    pub points_a_place: f64,
}

/// Conditions of a cell; none where it has too few points.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CellConditions {
    pub density_jump: Option<f64>,
    pub step: Option<f64>,
    pub noise: Option<f64>,
    pub scan_lines: Option<f64>,
    pub same_place: Option<f64>,
    pub thickness: Option<f64>,
}

/// What a query measures.
struct Query {
    /// Distance of points on a surface.
    spacing: f64,
    /// Points in an area, none where the neighbours are on one side.
    density: Option<f64>,
    noise: f64,
    rows: Option<f64>,
    width: f64,
}

impl CellPoints {
    /// Measures the conditions.
    pub fn conditions(&self) -> CellConditions {
        let same_place = Some(self.same_place);
        if self.places.len() < POINTS_MIN {
            return CellConditions { same_place, ..Default::default() };
        }
        let ask = |of: &[usize]| of.iter().filter_map(|at| self.query(*at)).collect();
        let (even, spread): (Vec<Query>, Vec<Query>) = (ask(&self.by_points), ask(&self.by_place));
        if even.len() < QUERIES_MIN {
            return CellConditions { same_place, ..Default::default() };
        }
        let all = || even.iter().chain(&spread);
        let densities: Vec<f64> = all().filter_map(|query| query.density).collect();
        let spacing = quantile(even.iter().map(|query| query.spacing).collect(), 0.5);
        CellConditions {
            density_jump: (densities.len() >= QUERIES_MIN)
                .then(|| quantile(densities.clone(), 1.0 - STRAYS) / quantile(densities, STRAYS)),
            step: (spacing > 0.0).then(|| self.step_over(spacing)),
            noise: Some(quantile(even.iter().map(|query| query.noise).collect(), 0.5)),
            scan_lines: Some(even.iter().filter_map(|query| query.rows).collect::<Vec<_>>())
                .filter(|rows| rows.len() >= QUERIES_MIN)
                .map(|rows| quantile(rows, 0.5).max(1.0)),
            same_place,
            thickness: Some(quantile(even.iter().map(|query| query.width).collect(), THIN)),
        }
    }

    /// Step over the distance of points, which is `spacing` between places. Steps as long as that
    /// put several points at one place, which were apart before.
    fn step_over(&self, spacing: f64) -> f64 {
        let over = self.step / spacing;
        if over > STEP_COARSE { over * self.points_a_place.sqrt() } else { over }
    }

    /// Measures what is around a point; none if that reaches beyond the cell.
    fn query(&self, at: usize) -> Option<Query> {
        let here = self.places[at];
        let wide = (self.places.len() / WIDE_SHARE).clamp(WIDE[0], WIDE[1]);
        let mut offsets: Vec<DVec3> = self.places.iter().map(|place| *place - here).collect();
        let by_length = |a: &DVec3, b: &DVec3| a.length_squared().total_cmp(&b.length_squared());
        // The nearest is the point itself.
        offsets.select_nth_unstable_by(wide, by_length);
        offsets[..=wide].sort_unstable_by(by_length);
        let radius = |count: usize| offsets[count].length();
        let reach = radius(wide);
        let [low, high] = self.inside;
        if reach == 0.0 || (here - reach).cmplt(low).any() || (here + reach).cmpgt(high).any() {
            return None;
        }
        let spacing = radius(NEAR) * (PI / NEAR as f64).sqrt();
        let flatness = shape(&offsets[..=NEAR]).values[2].max(0.0).sqrt();
        let middle = offsets[1..=DENSE].iter().sum::<DVec3>() / DENSE as f64;
        let is_amid = middle.length() < OFF_CENTRE * radius(DENSE);
        let density = is_amid.then(|| DENSE as f64 / (PI * radius(DENSE).powi(2)));
        // The variance of even points along a line, or across a strip, is a twelfth of the square
        // of its length or width.
        let [length, width, _] =
            shape(&offsets[..=wide]).values.map(|value| (12.0 * value.max(0.0)).sqrt());
        let line = (wide as f64 / NEAR as f64).powf(LINE_POWER);
        let width = match reach > line * radius(NEAR) {
            // Points of a strip that is wider than their distance share its area.
            true => {
                let over = width * wide as f64 / length;
                if over > 1.0 { over.sqrt() } else { over }
            }
            false => width / spacing,
        };
        Some(Query {
            spacing,
            density,
            // A plane has three degrees of freedom.
            noise: flatness * ((NEAR + 1) as f64 / (NEAR - 2) as f64).sqrt() / spacing,
            rows: rows(&offsets[..=wide]),
            width,
        })
    }
}

/// Distance to the next row over that within a row: to the nearest points more across than along
/// the row, and more along than across it; none if no neighbour is on another row. `offsets` are in
/// the order of their lengths.
fn rows(offsets: &[DVec3]) -> Option<f64> {
    let row = DVec3::from_array(shape(&offsets[..=ROW]).axes[0]);
    let mut nearest = [f64::INFINITY; 2];
    for offset in &offsets[1..] {
        let (squared, along) = (offset.length_squared(), offset.dot(row).powi(2));
        let own = &mut nearest[usize::from(along < squared - along)];
        *own = own.min(squared);
    }
    let [along, across] = nearest;
    (along > 0.0 && across.is_finite()).then(|| (across / along).sqrt())
}

/// Principal axes of offsets, and the variances along them.
fn shape(offsets: &[DVec3]) -> Eigen {
    let count = offsets.len() as f64;
    let mean = offsets.iter().sum::<DVec3>() / count;
    let mut sums = [0.0; 6];
    for offset in offsets {
        let [x, y, z] = (*offset - mean).to_array();
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }
    Eigen::of(sums.map(|sum| sum / count))
}

/// The value below which a share of all values is; of nothing 0.
pub(super) fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values.get((share * last as f64).round() as usize).copied().unwrap_or(0.0)
}
