//! The equations of zwicker2004 in `f32` against the plain `f64` reference, over a million splats
//! and views, some of them extreme; and R' and the amplitude against a numerical convolution.

use crate::exact::{Exact, case, coefficient_error, direction, lens, log_even};
use crate::scene::Dice;
use esker_render::ewa::mapping::{amplitude, mapping};
use esker_render::ewa::splat::{Disc, Lens, Placement};
use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;
use std::fmt::Write;

const CASES: u64 = 1_000_000;

/// Greatest errors by the decade of the condition number, and counts of cases.
#[derive(Clone, Default)]
struct Worst {
    cases: [u64; 8],
    coefficients: [f64; 8],
    outside_box: u64,
    disagreeing: u64,
    compared: u64,
    worst_px: f64,
    by_rays: u64,
    ellipses: u64,
    dropped: u64,
}

impl Worst {
    fn join(mut self, other: Self) -> Self {
        for i in 0..8 {
            self.cases[i] += other.cases[i];
            self.coefficients[i] = self.coefficients[i].max(other.coefficients[i]);
        }
        self.outside_box += other.outside_box;
        self.disagreeing += other.disagreeing;
        self.compared += other.compared;
        self.worst_px = self.worst_px.max(other.worst_px);
        self.by_rays += other.by_rays;
        self.ellipses += other.ellipses;
        self.dropped += other.dropped;
        self
    }

    fn ellipse(&mut self, disc: &Disc, lens: &Lens) {
        let m = disc.mapping(lens.focal_px);
        let condition = f64::from(m.condition());
        let Some(worst) = coefficient_error(disc, lens) else { return };
        let decade = (condition.log10().max(0.0) as usize).min(7);
        self.cases[decade] += 1;
        self.coefficients[decade] = self.coefficients[decade].max(worst);
    }

    fn case(&mut self, dice: &mut Dice) {
        let (disc, lens) = case(dice);
        let exact = Exact::new(&disc, &lens);
        let (splat, bounds) = match disc.place(&lens) {
            Placement::Drawn(splat, bounds) => (splat, bounds),
            Placement::Outside => return,
            Placement::Dropped => {
                self.dropped += 1;
                return;
            }
        };
        let [left, right, top, bottom] = bounds.map(f64::from);
        if splat.is_by_rays() {
            self.by_rays += 1;
            // Places on the edge of the disc and close to it.
            for _ in 0..8 {
                let angle = dice.unit() * 6.3;
                let on = exact.p + exact.a * angle.cos() + exact.b * angle.sin();
                if on.z < 1e-2 {
                    continue;
                }
                let nudge = DVec2::from_angle(dice.unit() * 6.3) * log_even(dice, 0.011, 3.0);
                let place = on.truncate() * (exact.focal / on.z) + exact.centre + nudge;
                self.compare(&splat, bounds, place, |place| {
                    let near = 1e-3;
                    let slope = |d: DVec2| {
                        exact.meets(place + d).0.length() - exact.meets(place - d).0.length()
                    };
                    let gradient =
                        DVec2::new(slope(DVec2::X * 1e-4), slope(DVec2::Y * 1e-4)) / 2e-4;
                    let (u, depth) = exact.meets(place);
                    let distance = (u.length() - 1.0) / gradient.length().max(1e-300);
                    (exact.is_seen(place, near), if depth < 2.0 * near { 0.0 } else { distance })
                });
            }
            return;
        }
        self.ellipses += 1;
        self.ellipse(&disc, &lens);
        let Some(contour) = exact.isocontour() else { return };
        let filter = contour.filtered(f64::from(lens.lowpass));
        let (middle, extents) = exact.extents();
        let half = (extents + f64::from(lens.lowpass)).map(f64::sqrt);
        let (low, high) = (middle - half, middle + half);
        let pixels = |low: f64, high: f64, most: f64| {
            ((low - 0.5).ceil().max(0.0), ((high - 0.5).floor() + 1.0).min(most))
        };
        let (x0, x1) = pixels(low.x, high.x, 1024.0);
        let (y0, y1) = pixels(low.y, high.y, 768.0);
        if x0 < x1 && y0 < y1 && (x0 < left || x1 > right || y0 < top || y1 > bottom) {
            self.outside_box += 1;
        }
        for _ in 0..8 {
            let nudge = DVec2::from_angle(dice.unit() * 6.3) * log_even(dice, 0.011, 3.0);
            let place = filter.place(dice.unit() * 6.3) + nudge;
            self.compare(&splat, bounds, place, |place| {
                (filter.at(place) < 1.0, filter.distance(place))
            });
        }
    }

    /// Compares the splat with `exact` at the centre of the pixel that holds `place`, since splats
    /// are only evaluated at centres of pixels.
    fn compare(
        &mut self,
        splat: &esker_render::ewa::splat::Splat,
        bounds: [u32; 4],
        place: DVec2,
        exact: impl Fn(DVec2) -> (bool, f64),
    ) {
        let pixel = place.floor() + 0.5;
        let inside = pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(DVec2::new(1024.0, 768.0)).all();
        if !inside {
            return;
        }
        let (is_inside, distance) = exact(pixel);
        let [left, right, top, bottom] = bounds.map(f64::from);
        let in_box = (left..right).contains(&pixel.x) && (top..bottom).contains(&pixel.y);
        let ours = in_box && splat.at(pixel.as_vec2(), 1e-3).is_some();
        self.compared += 1;
        if ours != is_inside {
            self.worst_px = self.worst_px.max(distance.abs());
            self.disagreeing += u64::from(distance.abs() > 0.01);
        }
    }
}

#[test]
fn a_million_splats_agree_with_the_formulas_in_double_precision() {
    const BLOCKS: u64 = 64;
    let worst = (0..BLOCKS)
        .into_par_iter()
        .map(|block| {
            let mut dice = Dice(0x9e37_79b9_7f4a_7c15 ^ (block + 1));
            let mut worst = Worst::default();
            (0..CASES / BLOCKS).for_each(|_| worst.case(&mut dice));
            worst
        })
        .reduce(Worst::default, Worst::join);
    let mut table =
        String::from("condition  cases  worst relative error of the conic's coefficients\n");
    for decade in 0..8 {
        let (cases, error) = (worst.cases[decade], worst.coefficients[decade]);
        writeln!(table, "1e{decade:<8} {cases:>7}  {error:.1e}").unwrap();
    }
    eprintln!(
        "{table}{} ellipses, {} by rays, {} dropped; {} pixels compared, worst {} px",
        worst.ellipses, worst.by_rays, worst.dropped, worst.compared, worst.worst_px
    );
    assert!(worst.ellipses > 200_000 && worst.by_rays > 10_000 && worst.compared > 500_000);
    assert_eq!(worst.outside_box, 0, "boxes that do not contain their ellipse");
    assert_eq!(worst.disagreeing, 0, "pixels beyond 0.01 px that disagree");
    for (decade, error) in worst.coefficients.into_iter().enumerate() {
        // Rounding error times the greatest condition number of the decade.
        assert!(error < 8e-7 * 10f64.powi(decade as i32 + 1), "condition 1e{decade}: {error}");
    }
}

#[test]
fn the_filter_is_the_convolution_of_kernel_and_lowpass() {
    // Under an affine mapping all kernels are the same, so the integral is that of equation 2.
    for (a, b) in [([3.0, 0.4], [-0.3, 1.1]), ([0.5, 0.1], [0.2, 0.4]), ([6.0, 2.0], [0.01, 0.02])]
    {
        let cutoff = 1.5f64;
        let depth = 1e6;
        let tangent = |t: [f64; 2]| [t[0], t[1], 0.0].map(|c| c as f32 * cutoff as f32);
        let m = mapping([0.0, 0.0, depth], [tangent(a), tangent(b)], depth);
        let kernel = m.isocontour();
        let filter = kernel.with_lowpass((cutoff * cutoff) as f32);
        let height = f64::from(amplitude(&kernel, &filter));
        let det = a[0] * b[1] - a[1] * b[0];
        let projected = |x: DVec2| {
            let u = (x.x * b[1] - x.y * b[0]) / det;
            let v = (x.y * a[0] - x.x * a[1]) / det;
            (-0.5 * (u * u + v * v)).exp()
        };
        let lowpass = |x: DVec2| (-0.5 * x.length_squared()).exp() / std::f64::consts::TAU;
        let step = 0.02;
        for x in [DVec2::ZERO, DVec2::new(0.7, -0.4), DVec2::new(-1.5, 0.9)] {
            let mut sum = 0.0;
            for i in -400..=400 {
                for j in -400..=400 {
                    let y = DVec2::new(f64::from(i), f64::from(j)) * step;
                    sum += projected(x - y) * lowpass(y) * step * step;
                }
            }
            let q = f64::from(filter.conic().at(x.x as f32, x.y as f32));
            let ours = height * (-0.5 * cutoff * cutoff * q).exp();
            assert!((ours - sum).abs() < 2e-3 * sum + 1e-9, "{a:?} {b:?} {x}: {ours} and {sum}");
        }
    }
}

#[test]
fn weights_follow_the_exact_projected_gaussian() {
    // With the correction of the centre, every weight is that of the place on the plane; without
    // it, the weights are far off.
    let mut dice = Dice(77);
    let (mut worst, mut uncorrected) = (0f64, 0f64);
    let mut seen = 0;
    while seen < 2000 {
        let lens = lens(1024, 768, 600.0, 1e-3, 0.0);
        let depth = 2.0 + 3.0 * dice.unit() as f32;
        let slope = (Vec2::new(dice.unit() as f32, dice.unit() as f32) - 0.5) * 1.2;
        let centre = Vec3::new(slope.x, slope.y, 1.0) * depth;
        let disc =
            Disc::round(centre, direction(&mut dice), depth * (0.05 + 0.5 * dice.unit() as f32));
        let Placement::Drawn(splat, _) = disc.place(&lens) else { continue };
        let exact = Exact::new(&disc, &lens);
        let m = disc.mapping(lens.focal_px);
        if splat.is_by_rays() || m.condition() > 20.0 {
            continue;
        }
        seen += 1;
        let contour = exact.isocontour().unwrap();
        for k in 0..8 {
            let place = contour.middle.lerp(contour.place(f64::from(k)), 0.1 + 0.1 * f64::from(k));
            let Some([squared, _]) = splat.at(place.as_vec2(), 1e-3) else { panic!("{place}") };
            let weight = |q: f64| (-1.125 * q).exp();
            let truth = weight(exact.meets(place).0.length_squared());
            worst = worst.max((weight(f64::from(squared)) - truth).abs());
            uncorrected = uncorrected.max((weight(contour.at(place)) - truth).abs());
        }
    }
    eprintln!("weights: at most {worst:.4} off, without the correction {uncorrected:.3}");
    assert!(worst < 0.03 && uncorrected > 0.3);
}
