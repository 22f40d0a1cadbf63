//! A generated point with the fields of LAS point format 7, and runs of points as batches.

use super::draw::{Draw, floor};
use super::ray::{Hit, Vec3};
use esker_points::attribute::names;
use esker_points::lattice::Placement;
use esker_points::{AttrType, Attribute, Batch, Column, Grid, Rounding, Schema};
use std::sync::Arc;

/// One point; the fields are those of the LAS specification, packed as in
/// `esker_points::attribute`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// Position in steps of the scene's grid.
    pub position: [i32; 3],
    /// Pulse return magnitude.
    pub intensity: u16,
    /// Return number (bits 0-3) and number of returns of the pulse (4-7).
    pub returns: u8,
    /// Scan direction and edge of flight line.
    pub flags: u8,
    /// ASPRS class.
    pub classification: u8,
    /// Meaning defined by the scene.
    pub user_data: u8,
    /// Scan angle in steps of 0.006 degrees.
    pub scan_angle: i16,
    /// Number of the station or strip.
    pub point_source_id: u16,
    /// GPS time, seconds.
    pub gps_time: f64,
    /// 8 bits in the upper byte, as in most exports.
    pub rgb: [u16; 3],
}

/// All attributes of a point.
pub fn schema() -> Schema {
    use AttrType::{F64, I16, U8, U16};
    let all = [
        (names::INTENSITY, U16),
        (names::RETURNS, U8),
        (names::FLAGS, U8),
        (names::CLASSIFICATION, U8),
        (names::USER_DATA, U8),
        (names::SCAN_ANGLE, I16),
        (names::POINT_SOURCE_ID, U16),
        (names::GPS_TIME, F64),
        (names::RED, U16),
        (names::GREEN, U16),
        (names::BLUE, U16),
    ];
    Schema::new(all.into_iter().map(|(name, ty)| Attribute::new(name, ty)).collect())
}

impl Point {
    /// Rounds a position to steps.
    pub fn steps(place: Vec3, scale: f64) -> [i32; 3] {
        // Multiplied by the steps per metre, a whole number.
        let a_metre = (1.0 / scale + 0.5) as i64 as f64;
        place.map(|c| floor(c * a_metre + 0.5).clamp(i32::MIN.into(), i32::MAX.into()) as i32)
    }

    /// Sets the colour from `colour` (0 to 1), with a camera's noise (0 to 255).
    pub fn set_colour(&mut self, colour: [f64; 3], noise: f64, draw: &mut Draw) {
        let grain = draw.triple();
        let value = |i: usize| (colour[i] * 255.0 + noise * grain[i]).clamp(0.0, 255.0);
        self.rgb = [0, 1, 2].map(|i| (value(i) as u16) << 8);
    }

    /// Sets the intensity of `hit`: weaker with distance and at grazing angles; `noise` is the
    /// standard deviation as a fraction.
    pub fn set_intensity(&mut self, hit: &Hit, noise: f64, draw: &mut Draw) {
        let far = 1.0 / (1.0 + hit.t * hit.t * (1.0 / 1600.0));
        let share = hit.material.reflectance * (0.3 + 0.7 * hit.incidence) * far;
        let value = share * 52_000.0 * (1.0 + noise * draw.bell());
        self.intensity = value.clamp(0.0, 65_535.0) as u16;
    }
}

/// A run of points as a batch.
pub struct Run {
    /// The points.
    pub batch: Batch,
    /// Greatest value of their colours.
    pub colour_max: u16,
    /// What placing changed; nothing on the lattice of the scene's own grid.
    pub rounding: Rounding,
}

/// Rounds points to the lattice and makes columns of them.
pub fn run(points: &[Point], schema: &Arc<Schema>, grid: &Grid, placement: &Placement) -> Run {
    let mut rounding = Rounding::default();
    let mut batch = Batch::with_capacity(Arc::clone(schema), points.len());
    for point in points {
        batch.positions.push(placement.integer(point.position, grid, &mut rounding));
    }
    for (attribute, column) in schema.attributes.iter().zip(&mut batch.columns) {
        match attribute.name.as_str() {
            names::INTENSITY => fill(column, points, |p| p.intensity.to_le_bytes()),
            names::RETURNS => fill(column, points, |p| [p.returns]),
            names::FLAGS => fill(column, points, |p| [p.flags]),
            names::CLASSIFICATION => fill(column, points, |p| [p.classification]),
            names::USER_DATA => fill(column, points, |p| [p.user_data]),
            names::SCAN_ANGLE => fill(column, points, |p| p.scan_angle.to_le_bytes()),
            names::POINT_SOURCE_ID => fill(column, points, |p| p.point_source_id.to_le_bytes()),
            names::GPS_TIME => fill(column, points, |p| p.gps_time.to_le_bytes()),
            names::RED => fill(column, points, |p| p.rgb[0].to_le_bytes()),
            names::GREEN => fill(column, points, |p| p.rgb[1].to_le_bytes()),
            names::BLUE => fill(column, points, |p| p.rgb[2].to_le_bytes()),
            other => unreachable!("the schema above has no {other}"),
        }
    }
    let colour_max = points.iter().flat_map(|p| p.rgb).max().unwrap_or(0);
    Run { batch, colour_max, rounding }
}

fn fill<const N: usize>(column: &mut Column, points: &[Point], of: impl Fn(&Point) -> [u8; N]) {
    column.resize(points.len() * N, 0);
    for (value, point) in column.as_chunks_mut().0.iter_mut().zip(points) {
        *value = of(point);
    }
}
