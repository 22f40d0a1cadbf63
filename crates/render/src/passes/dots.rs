//! Runs the passes of points that are drawn alone, as dots: all of method *points* after project,
//! and those that method *auto* runs beside the passes of surfaces.

use crate::frame::{Frame, Picture, PointSize, Stats};
use crate::inputs::lookup::Lookup;
use crate::pass::Pass;
use crate::passes::eye_dome::eye_dome;
use crate::passes::grow::Grow;
use crate::passes::overlay::{DotLight, overlay};
use crate::passes::resolve::resolve;
use crate::passes::split::split;
use crate::plan::FramePlan;
use std::sync::atomic::AtomicU64;

/// Memory of the passes.
#[derive(Default)]
pub(crate) struct Dots {
    grow: Grow,
    /// Frame buffer of the dots among surfaces, and their number.
    among: Vec<AtomicU64>,
    count: u64,
}

impl Dots {
    /// Runs a pass of dots; `target` is the frame buffer. Adds to the counts of pixels.
    pub(crate) fn run(
        &mut self,
        pass: Pass,
        frame: &Frame<'_>,
        plan: &FramePlan,
        lookup: &Lookup<'_>,
        target: &mut Vec<AtomicU64>,
        (picture, stats): (&mut Picture, &mut Stats),
    ) {
        let Self { grow, among, count } = self;
        let width = picture.width as usize;
        match pass {
            Pass::Split => {
                *count = split(lookup, plan.carries_normals, target, width, among);
                stats.pixels_projected += *count;
            }
            // Without dots the picture is finished already.
            _ if plan.mixes_dots() && *count == 0 => (),
            Pass::Grow if plan.mixes_dots() => {
                grow.run(lookup, PointSize::Adaptive, among, width);
            }
            Pass::Grow => grow.run(lookup, frame.dots.size, target, width),
            Pass::Overlay => {
                let light = DotLight { has_normals: plan.carries_normals, shines: plan.shines };
                stats.pixels_covered += overlay(lookup, light, among, picture);
            }
            Pass::Resolve => {
                stats.pixels_covered = resolve(lookup, target, frame.background, picture);
                stats.pixels_projected = stats.pixels_covered;
            }
            Pass::EyeDome => {
                let dots = plan.mixes_dots().then_some(&among[..]);
                eye_dome(picture, frame.dots.eye_dome, dots);
            }
            _ => (),
        }
    }

    /// Runs split alone.
    pub(crate) fn split(&mut self, lookup: &Lookup<'_>, plan: &FramePlan, target: &[AtomicU64]) {
        let width = lookup.camera.size[0] as usize;
        split(lookup, plan.carries_normals, target, width, &mut self.among);
    }
}
