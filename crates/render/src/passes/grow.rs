//! Grow (method *points*): draws points as round dots that face the eye. `project` gives each point
//! one pixel; a pixel then shows the nearest of the points whose dots reach it. The cost depends on
//! the number of pixels, not of points. A point that lost its pixel needs no dot: the winner's dot
//! has the same centre, and covers it if the sizes are equal.

use crate::frame::{ADAPTIVE_MAX, PointSize};
use crate::inputs::lookup::Lookup;
use crate::passes::project::{EMPTY, unpack};
use esker_points::quant::SCALED_CODE_MAX;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Radius of an adaptive dot over the distance of points: no place of an even sample is farther
/// from a point. The distance is the typical one of the drawn sample, or that to the points around
/// if it is less. It is never more, or a lone point would become a ball.
pub(crate) const ADAPTIVE_FACTOR: f32 = 0.84;
/// Radius of a dot of one pixel, which is added to those of adaptive dots: they are drawn at the
/// centres of pixels.
pub(crate) const PIXEL_RADIUS: f32 = 0.5;

/// Memory of the pass.
#[derive(Default)]
pub(crate) struct Grow {
    grown: Vec<AtomicU64>,
    /// Radii of the dots of pixels, in pixels, if they differ.
    radii: Vec<f32>,
}

impl Grow {
    /// Replaces the frame buffer by that of dots.
    pub(crate) fn run(
        &mut self,
        lookup: &Lookup<'_>,
        size: PointSize,
        target: &mut Vec<AtomicU64>,
        width: usize,
    ) {
        let Self { grown, radii } = self;
        let reach = match size {
            PointSize::Pixels(_) => {
                radii.clear();
                size.radius_max()
            }
            PointSize::Adaptive => {
                let thins = lookup.frame.thins_points();
                let thinned_px = if thins { lookup.frame.target_spacing_px as f32 } else { 0.0 };
                let radius = |value: &AtomicU64| match value.load(Relaxed) {
                    EMPTY => 0.0,
                    value => adaptive_radius(lookup, value, thinned_px),
                };
                target.par_iter().map(radius).collect_into_vec(radii);
                radii.par_iter().copied().reduce(|| PIXEL_RADIUS, f32::max)
            }
        };
        grown.resize_with(target.len(), || AtomicU64::new(EMPTY));
        let rows = target.len() / width.max(1);
        grown.par_chunks_mut(width.max(1)).enumerate().for_each_init(
            || vec![EMPTY; width],
            |nearest, (y, to)| {
                nearest.fill(EMPTY);
                let steps = reach as usize;
                for row in y.saturating_sub(steps)..rows.min(y + steps + 1) {
                    let start = row * width;
                    let down2 = (row.abs_diff(y) as f32).powi(2);
                    for (x, value) in target[start..start + width].iter().enumerate() {
                        let value = value.load(Relaxed);
                        let radius = radii.get(start + x).copied().unwrap_or(reach);
                        if value == EMPTY || down2 > radius * radius {
                            continue;
                        }
                        let aside = (radius * radius - down2).sqrt() as usize;
                        let dot = x.saturating_sub(aside)..width.min(x + aside + 1);
                        nearest[dot].iter_mut().for_each(|n| *n = value.min(*n));
                    }
                }
                to.iter_mut().zip(&*nearest).for_each(|(to, &value)| *to.get_mut() = value);
            },
        );
        std::mem::swap(grown, target);
    }
}

/// Radius of an adaptive dot, pixels, where points are thinned to a distance of `thinned_px`: there
/// is no gap between neighbours.
fn adaptive_radius(lookup: &Lookup<'_>, value: u64, thinned_px: f32) -> f32 {
    let (depth, point) = unpack(value);
    let (draw, index) = lookup.list.find(point);
    let (offset, code) = lookup.draws[draw].positions.offset(index);
    let stored = lookup.radius_factors[usize::from(code)];
    let stored = if code > SCALED_CODE_MAX { stored } else { stored.min(1.0) };
    let apart_px = lookup.spacing(draw, offset, code) * lookup.camera.focal_px / depth;
    let apart_px = if code > SCALED_CODE_MAX { apart_px } else { apart_px.max(thinned_px) };
    let radius = apart_px * stored * ADAPTIVE_FACTOR + PIXEL_RADIUS;
    // NaN is not greater.
    if radius > PIXEL_RADIUS { radius.min(ADAPTIVE_MAX) } else { PIXEL_RADIUS }
}
