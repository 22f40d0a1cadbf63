//! Airborne scanning: overlapping strips, flown to and fro, with an oscillating mirror and up to
//! five echoes per pulse. The area grows with the number of points, so their density is that of a
//! survey. A pulse's position follows from the index of its first echo, so any block of points can
//! be made alone; the last pulse of a block loses the echoes that do not fit.

use super::draw::{Draw, cos_sin, noise, smooth};
use super::landscape::{Echo, HEIGHTS, Landscape};
use super::point::Point;
use super::ray::{Hit, Vec3};
use super::scene::{BLOCK_POINTS, Scene};
use esker_points::Grid;
use std::ops::Range;

/// Step of coordinates, metres.
const SCALE: f64 = 0.001;
/// Approximate points per square metre, and echoes per pulse.
const DENSITY: f64 = 12.0;
const ECHOES: f64 = 1.35;
/// Least edge of the area, metres: fewer points are less dense.
const EDGE_MIN: f64 = 120.0;
/// Greatest distance of strips, metres, and ratio of a strip's width to that distance.
const APART_MAX: f64 = 320.0;
const OVERLAP: f64 = 1.35;
/// Greatest angle of the mirror, turns, and its tangent.
const ANGLE_MAX: f64 = 20.0 / 360.0;
const TANGENT_MAX: f64 = 0.363_970_234_266_202_36;
/// Noise along the range and across it, metres.
const RANGE_NOISE_M: f64 = 0.03;
const ACROSS_NOISE_M: f64 = 0.12;
/// Noise of colours, 0 to 255: as of an aerial picture taken at another time.
const COLOUR_NOISE: f64 = 11.0;
/// Noise as a fraction of the intensity: speckle.
const INTENSITY_NOISE: f64 = 0.18;
/// Pulses per second; seconds between strips; GPS time of the first strip, as in LAS.
const PULSES_A_S: f64 = 300_000.0;
const TURN_S: f64 = 180.0;
const START_S: f64 = 301_000_000.0;

/// The survey of an area.
struct Survey {
    country: Landscape,
    points: u64,
    seed: u64,
    edge: f64,
    strips: u64,
    /// Width of a strip and height of the aircraft, metres.
    width: f64,
    height: f64,
    /// Swings of the mirror per strip.
    swings: f64,
}

/// Values that all echoes of a pulse share.
struct Pulse {
    strip: u64,
    x: f64,
    /// Position of the aircraft across the strips.
    middle: f64,
    angle: f64,
    tangent: f64,
    time: f64,
    flags: u8,
}

/// Makes the scene.
pub fn make(points: u64, seed: u64) -> Box<dyn Scene> {
    let edge = (points as f64 / DENSITY).sqrt().max(EDGE_MIN);
    let strips = ((edge / APART_MAX) as u64 + 1).max(2);
    let width = edge / strips as f64 * OVERLAP;
    let pulses = points as f64 / strips as f64 / ECHOES;
    // Scan lines are as far apart as pulses in a line.
    let swings = (pulses * edge / width).sqrt().max(1.0);
    let height = 0.5 * width / TANGENT_MAX;
    let country = Landscape { seed };
    Box::new(Survey { country, points, seed, edge, strips, width, height, swings })
}

impl Survey {
    fn pulse(&self, index: u64, draw: &mut Draw) -> Pulse {
        let strip = ((index + 1) * self.strips - 1) / self.points;
        let first = strip * self.points / self.strips;
        let flown = (index - first) as f64 / (self.points as f64 / self.strips as f64);
        let swing = flown * self.swings;
        let (whole, part) = (swing as u64, swing - (swing as u64) as f64);
        let is_back = whole & 1 == 1;
        // The mirror slows down where it turns.
        let swung = 0.65 * part + 0.35 * smooth(part);
        let swung = if is_back { 1.0 - swung } else { swung };
        let seed = self.seed ^ strip;
        let roll = 0.002 * noise(seed, flown * self.edge / 40.0, 0.5);
        let angle = ANGLE_MAX * (2.0 * swung - 1.0) + roll;
        let [c, s] = cos_sin(angle);
        // Wind changes the speed of the aircraft.
        let gust = 0.03 * noise(seed, flown * 6.0, 7.5);
        let along = (flown + gust * smooth(8.0 * flown) * smooth(8.0 * (1.0 - flown))) * self.edge;
        let along = along + ACROSS_NOISE_M * draw.bell();
        let pulse_s = ECHOES / PULSES_A_S;
        Pulse {
            strip,
            x: if strip & 1 == 0 { along } else { self.edge - along },
            middle: (strip as f64 + 0.5) * self.edge / self.strips as f64,
            angle,
            tangent: s / c,
            time: START_S + strip as f64 * TURN_S + (index as f64 + 0.9 * draw.unit()) * pulse_s,
            flags: u8::from(is_back) << 6 | u8::from(!(0.002..0.998).contains(&part)) << 7,
        }
    }

    fn point(
        &self,
        pulse: &Pulse,
        echo: &Echo,
        number: usize,
        of: usize,
        draw: &mut Draw,
    ) -> Point {
        let z = echo.z + RANGE_NOISE_M * draw.bell();
        let y =
            pulse.middle + (self.height - echo.z) * pulse.tangent + ACROSS_NOISE_M * draw.bell();
        let mut point = Point {
            position: Point::steps([pulse.x, y, z], SCALE),
            returns: (number | of << 4) as u8,
            flags: pulse.flags,
            classification: echo.material.class,
            // The width of the echo, which vegetation increases.
            user_data: (30.0 + 6.0 * draw.bell() + 4.0 * (of - 1) as f64) as u8,
            scan_angle: (pulse.angle * 60_000.0) as i16,
            point_source_id: pulse.strip as u16 + 1,
            gps_time: pulse.time,
            ..Point::default()
        };
        // Echoes share the energy of the pulse; the intensity does not depend on the aircraft's
        // height.
        let hit = Hit { t: 0.0, incidence: 0.9, light: 1.0, material: echo.material };
        point.set_intensity(&hit, INTENSITY_NOISE, draw);
        point.intensity /= of as u16;
        let shade = 1.0 + 0.1 * draw.bell();
        point.set_colour(echo.material.colour.map(|c| f64::from(c) * shade), COLOUR_NOISE, draw);
        point
    }
}

impl Scene for Survey {
    fn grid(&self) -> Grid {
        Grid { scale: [SCALE; 3], offset: [600_000.0, 5_300_000.0, 500.0] }
    }

    fn bounds(&self) -> [Vec3; 2] {
        // Strips exceed the edge by half their overlap, and by more on slopes.
        let over = 0.5 * (self.width - self.edge / self.strips as f64) + 80.0;
        [[-1.0, -over, HEIGHTS[0]], [self.edge + 1.0, self.edge + over, HEIGHTS[1]]]
    }

    fn block(&self, range: Range<u64>, out: &mut Vec<Point>) {
        debug_assert!(range.end - range.start <= BLOCK_POINTS);
        let mut index = range.start;
        while index < range.end {
            let mut draw = Draw::new(self.seed, 0, index);
            let pulse = self.pulse(index, &mut draw);
            // Hills hide nothing at these angles: their height alone decides where the beam meets
            // them.
            let reach = |z: f64| pulse.middle + (self.height - z) * pulse.tangent;
            let y = reach(self.country.hills(pulse.x, reach(0.0)));
            let echoes = self.country.echoes(pulse.x, y, &mut draw);
            let count = echoes.all().len().min((range.end - index) as usize);
            for (i, echo) in echoes.all()[..count].iter().enumerate() {
                out.push(self.point(&pulse, echo, i + 1, count, &mut draw));
            }
            index += count as u64;
        }
    }
}
