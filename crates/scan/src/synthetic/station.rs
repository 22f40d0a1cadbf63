//! Terrestrial scanning: each tripod turns once about z while its mirror sweeps a fan of angles, at
//! equal steps of both. So density falls with the square of the distance and the cosine of
//! incidence, and hidden surfaces are not seen. A ray that hits nothing is replaced by a random one
//! of the same turn, so that the number of points is as requested.

use super::draw::{Draw, cos_sin};
use super::point::Point;
use super::ray::{Hit, Ray, Vec3};
use super::scene::{BLOCK_POINTS, Scene};
use crate::source::Scanner;
use esker_points::Grid;
use std::ops::Range;

/// Lower end of the fan, turns: 65 degrees below the horizon; the tripod's foot is below that.
const FAN_LOW: f64 = -65.0 / 360.0;
/// Number of random rays before one is cast straight down.
const THROWS_MAX: usize = 16;
/// Step of coordinates, metres.
const SCALE: f64 = 0.001;
/// Noise of the range, metres: that of a good scanner on grey walls at 10 m.
const RANGE_NOISE_M: f64 = 0.001;
/// Noise of both angles, in steps: real scan lines are not perfectly regular.
const ANGLE_NOISE_STEPS: f64 = 0.15;
/// Noise of colours, 0 to 255.
const COLOUR_NOISE: f64 = 2.0;
/// Noise as a fraction of the intensity.
const INTENSITY_NOISE: f64 = 0.05;
/// Seconds from the beginning of one station to that of the next, and duration of one turn.
const STATION_S: f64 = 600.0;
const TURN_S: f64 = 240.0;
/// GPS time of the first station, as in LAS (adjusted standard time).
const START_S: f64 = 300_000_000.0;

/// A world into which rays are cast.
pub trait World: Send + Sync {
    /// The first hit of a ray from a station, if any.
    fn cast(&self, station: usize, ray: &Ray, draw: &mut Draw) -> Option<Hit>;
    /// Corners of a box around all hits.
    fn bounds(&self) -> [Vec3; 2];
}

/// A world and the tripods in it.
pub struct Terrestrial<W> {
    /// The world that is scanned.
    pub world: W,
    /// Positions of the tripods.
    pub stations: Vec<Vec3>,
    /// World coordinate of the origin.
    pub offset: Vec3,
    /// Number of points of all stations.
    pub points: u64,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Upper end of the fan, turns above the horizon; 0.25 is the zenith.
    pub fan_top: f64,
}

/// The scan pattern of one station, column by column.
struct Turn {
    station: usize,
    range: Range<u64>,
    rows: u64,
    columns: u64,
}

impl<W: World> Terrestrial<W> {
    fn turn(&self, station: usize) -> Turn {
        let n = self.stations.len() as u64;
        let first = |s: usize| s as u64 * self.points / n;
        let range = first(station)..first(station + 1);
        let points = range.end - range.start;
        let rows = (((points as f64 * (self.fan_top - FAN_LOW)).sqrt() + 0.5) as u64).max(1);
        Turn { station, range, rows, columns: points.div_ceil(rows).max(1) }
    }

    fn point(&self, turn: &Turn, index: u64, column: u64, row: u64) -> Point {
        let mut draw = Draw::new(self.seed, 0, index);
        let jitter = |draw: &mut Draw| 0.5 + ANGLE_NOISE_STEPS * draw.bell();
        let fan = self.fan_top - FAN_LOW;
        let mut azimuth = (column as f64 + jitter(&mut draw)) / turn.columns as f64;
        let mut elevation = FAN_LOW + (row as f64 + jitter(&mut draw)) / turn.rows as f64 * fan;
        let from = self.stations[turn.station];
        let mut hit = None;
        for _ in 0..THROWS_MAX {
            let ([ca, sa], [ce, se]) = (cos_sin(azimuth), cos_sin(elevation));
            let ray = Ray::new(from, [ca * ce, sa * ce, se]);
            hit = self.world.cast(turn.station, &ray, &mut draw).map(|hit| (ray, hit));
            if hit.is_some() {
                break;
            }
            (azimuth, elevation) = (draw.unit(), FAN_LOW + draw.unit() * fan);
        }
        let down = || {
            let ray = Ray::new(from, [0.0, 0.0, -1.0]);
            self.world.cast(turn.station, &ray, &mut draw.clone()).map(|hit| (ray, hit))
        };
        let time = (index - turn.range.start) as f64 / (turn.range.end - turn.range.start) as f64;
        let mut point = Point {
            returns: 0x11,
            flags: ((column & 1) << 6) as u8,
            // Steps of 0.006 degrees.
            scan_angle: (elevation * 60_000.0) as i16,
            point_source_id: turn.station as u16 + 1,
            gps_time: START_S + turn.station as f64 * STATION_S + time * TURN_S,
            ..Point::default()
        };
        if let Some((ray, hit)) = hit.or_else(down) {
            let noise = RANGE_NOISE_M * (1.0 + 0.03 * hit.t) * draw.bell();
            let place = ray.at(hit.t);
            point.position = Point::steps(ray.at(hit.t + noise), SCALE);
            point.classification = hit.material.class;
            point.set_intensity(&hit, INTENSITY_NOISE, &mut draw);
            let colour = hit.material.colour_at(self.seed, place).map(|c| c * hit.light);
            point.set_colour(colour, COLOUR_NOISE, &mut draw);
        }
        point
    }
}

impl<W: World> Scene for Terrestrial<W> {
    fn grid(&self) -> Grid {
        Grid { scale: [SCALE; 3], offset: self.offset }
    }

    fn scanner(&self) -> Option<Scanner> {
        let world = |place: &Vec3| [0, 1, 2].map(|i| place[i] + self.offset[i]);
        let places = self.stations.iter().enumerate();
        Some(Scanner::BySource(places.map(|(i, p)| (i as u16 + 1, world(p))).collect()))
    }

    fn bounds(&self) -> [Vec3; 2] {
        // Noise of the range stays within a few of its standard deviations.
        let [low, high] = self.world.bounds();
        [low.map(|c| c - 0.1), high.map(|c| c + 0.1)]
    }

    fn block(&self, range: Range<u64>, out: &mut Vec<Point>) {
        debug_assert!(range.end - range.start <= BLOCK_POINTS);
        let n = self.stations.len() as u64;
        let mut index = range.start;
        while index < range.end {
            // The station whose range of indices contains the index.
            let station = ((index + 1) * n - 1) / self.points;
            let turn = self.turn(station as usize);
            let (mut column, mut row) = {
                let within = index - turn.range.start;
                (within / turn.rows, within % turn.rows)
            };
            for index in index..range.end.min(turn.range.end) {
                out.push(self.point(&turn, index, column, row));
                row += 1;
                if row == turn.rows {
                    (column, row) = (column + 1, 0);
                }
            }
            index = range.end.min(turn.range.end);
        }
    }
}
