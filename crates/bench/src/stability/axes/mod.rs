//! Axes of conditions: an analytic scene gets worse along one of them, and pictures are compared
//! with exact ones, until a bound breaks. Values are listed from easy to hard. The bound must hold
//! up to the rated value; what happens beyond is reported.

mod axis;
pub(super) mod scenes;
mod table;

use crate::error_time::analytic::Analytic;
use crate::error_time::compare::{Errors, errors};
use crate::error_time::perfect::Reference;
use crate::stability::lab::{Built, Lab, Shot};
use crate::stability::relations::halves_differ;
use crate::stability::report::{Case, Limits, StabilityReport, Verdict};
use anyhow::{Result, ensure};
use axis::{Axis, Subject};
use esker_engine::calls::conditions::rated::{Gauge, Measure};
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_format::Forest;
use esker_lod::CompactOctree;
use esker_points::task::Silent;
use esker_render::Picture;
use esker_render::inputs::camera::Positions;
use esker_render::inputs::splats::splats;
use glam::{DVec2, DVec3};
use scenes::{Patches, Scene};
pub(super) use table::all;

/// Checks the names of parts.
///
/// # Errors
/// If there is no part of a name.
pub(super) fn check_names(parts: &[String]) -> Result<()> {
    let known = ["relations", "axes", "stiffness"].into_iter();
    let known: Vec<&str> = known.chain(all().iter().map(|axis| axis.condition.name)).collect();
    for part in parts {
        ensure!(
            known.contains(&&**part),
            "there is no part `{part}`; there are {}",
            known.join(", ")
        );
    }
    Ok(())
}

/// Sweeps an axis, and adds its cases and limits to the report.
///
/// # Errors
/// If the task is cancelled. Other errors are verdicts.
pub(super) fn sweep(
    axis: &'static Axis,
    lab: &Lab<'_>,
    report: &mut StabilityReport,
) -> Result<()> {
    #[cfg(not(feature = "light"))]
    if matches!(axis.subject, Subject::LeftOut) {
        report.left_out.push(axis.condition.name);
        return Ok(());
    }
    let first = report.cases.len();
    for value in values(axis, lab.is_full) {
        lab.phase(&format!("{} {value}", axis.condition.name))?;
        let found = match axis.subject {
            Subject::Scan(scene) => {
                scene(value, lab).and_then(|scene| measured(&scene, axis, value, lab))
            }
            #[cfg(feature = "light")]
            Subject::Light(light) => {
                Ok(light(value).into_iter().map(|off| (off, Vec::new())).collect())
            }
            #[cfg(not(feature = "light"))]
            Subject::LeftOut => Ok(Vec::new()),
        };
        lab.phase(axis.condition.name)?;
        let refusal = found.as_ref().err().map(|e| format!("{e:#}"));
        for (k, gauge) in axis.condition.gauges.iter().enumerate() {
            let (measured, mut messages) = match &found {
                Ok(each) => (Some(each[k].0).filter(|m| m.is_finite()), each[k].1.clone()),
                Err(_) => (None, refusal.iter().cloned().collect()),
            };
            messages.dedup();
            let is_rated = rank(axis, value) <= rank(axis, gauge.rated_to);
            let verdict = match measured {
                Some(measured) if measured <= gauge.bound => Verdict::Holds,
                _ if is_rated => Verdict::Broken,
                _ if found.is_ok() => Verdict::Breaks,
                _ => Verdict::Refused,
            };
            report.cases.push(Case {
                axis: axis.condition.name,
                method: gauge.method,
                measure: gauge.measure.name(),
                value,
                bound: gauge.bound,
                measured,
                verdict,
                messages,
            });
        }
    }
    let own: Vec<Case> = report.cases[first..].to_vec();
    report.axes.extend(axis.condition.gauges.iter().map(|gauge| limits(axis, gauge, &own)));
    Ok(())
}

/// The values that are tried; in full, also one between each two.
fn values(axis: &Axis, is_full: bool) -> Vec<f64> {
    if !is_full {
        return axis.values.to_vec();
    }
    let between = axis.values.windows(2).flat_map(|pair| {
        let [a, b] = [pair[0], pair[1]];
        [a, if a * b > 0.0 { (a * b).sqrt() } else { 0.5 * (a + b) }]
    });
    between.chain(axis.values.last().copied()).collect()
}

/// How hard a value of an axis is: its place in the list.
fn rank(axis: &Axis, value: f64) -> f64 {
    let ends = axis.values.first().zip(axis.values.last());
    let is_falling = ends.is_some_and(|(first, last)| first > last);
    if is_falling { -value } else { value }
}

/// Limits of a gauge, of its cases in order.
fn limits(axis: &'static Axis, gauge: &Gauge, cases: &[Case]) -> Limits {
    let is_own = |case: &&Case| case.method == gauge.method && case.measure == gauge.measure.name();
    let own: Vec<&Case> = cases.iter().filter(is_own).collect();
    let broken = own.iter().position(|case| case.verdict != Verdict::Holds);
    let at_rated = own.iter().find(|case| case.value == gauge.rated_to);
    let last = match broken {
        Some(at) => at.checked_sub(1).map(|at| own[at]),
        None => own.last().copied(),
    };
    Limits {
        axis: axis.condition.name,
        value_is: axis.condition.value_is,
        method: gauge.method,
        measure: gauge.measure.name(),
        bound: gauge.bound,
        rated_to: gauge.rated_to,
        at_rated: at_rated.and_then(|case| case.measured),
        holds_to: last.map(|case| case.value),
        breaks_at: broken.map(|at| own[at].value),
        broken_to: broken.and_then(|at| own[at].measured),
        message: broken.and_then(|at| own[at].messages.first().cloned()),
    }
}

/// What each gauge measures of a scene, the worst of its cameras, and notes to the user.
fn measured(
    scene: &Scene,
    axis: &Axis,
    value: f64,
    lab: &Lab<'_>,
) -> Result<Vec<(f64, Vec<String>)>> {
    let built = lab.build(&[&scene.cloud], &scene.options)?;
    let one = |gauge: &Gauge| {
        let mut worst = (0.0f64, built.notes.clone());
        for (k, camera) in scene.cameras.iter().enumerate() {
            let name = format!("{}-{value}-{k}", axis.condition.name);
            let (measured, notes) = with_camera(scene, &built, (&name, camera), gauge, lab)?;
            worst.0 = worst.0.max(measured);
            worst.1.extend(notes);
        }
        Ok(worst)
    };
    axis.condition.gauges.iter().map(one).collect()
}

fn with_camera(
    scene: &Scene,
    built: &Built,
    (name, camera): (&str, &Camera),
    gauge: &Gauge,
    lab: &Lab<'_>,
) -> Result<(f64, Vec<String>)> {
    let request = lab.request(camera, gauge.method);
    let Shot { picture, view, notes } = lab.shot(&built.file, &request)?;
    let truth = Analytic::new(gauge.measure.name(), scene.truth(), view);
    lab.keep(&format!("{name}-{}", gauge.method), &picture)?;
    if gauge.measure == Measure::Normals {
        return Ok((lab.normal_error(&built.file, camera, &truth)?, notes));
    }
    if gauge.measure == Measure::Parts {
        return Ok((halves_differ(lab, &built.file, &request)?, notes));
    }
    if gauge.measure == Measure::Beside {
        return Ok((beside(&built.file, &request)?, notes));
    }
    if let (Measure::Radius, Some(patches)) = (gauge.measure, scene.patches) {
        return Ok((radius_error(&built.file, &request, &patches)?, notes));
    }
    let reference = truth.picture(&view)?;
    let of: Errors = errors(&picture, &reference, view.focal_px());
    lab.keep(&format!("{name}-exact"), &reference.picture())?;
    let open = of.hole_share + of.bleeding_share;
    let measured = match gauge.measure {
        Measure::Flip => of.flip,
        Measure::Holes => open,
        Measure::Depth if open < 1.0 => of.depth_px,
        Measure::Depth => f64::INFINITY,
        Measure::Place => misplaced(&picture),
        Measure::Width => outside(&picture, &reference) / scene.outline_px,
        // Measured above, or on traced light.
        _ => f64::INFINITY,
    };
    Ok((measured, notes))
}

/// Share of the points chosen for a picture of all detail that are in nodes of which none of these
/// points is on the picture; infinite if nothing is chosen.
///
/// # Errors
/// If the points cannot be read.
fn beside(file: &Forest, request: &PictureRequest) -> Result<f64> {
    let request = PictureRequest { target_spacing_px: 0.0, ..request.clone() };
    let scene = PictureScene::read(file, &request, &Silent)?;
    let (view, lattice) = (&scene.view, file.metric());
    let (mut beside, mut all) = (0, 0);
    for draw in scene.draws(file) {
        let positions = Positions::of(&draw);
        let is_seen = |i: usize| {
            let (offset, _) = positions.offset(i);
            let place = [0, 1, 2].map(|k| draw.node.box_min[k] + offset[k]);
            let projected = view.project(DVec3::from_array(lattice.world(place)));
            projected.is_some_and(|on| view.is_on_picture(on))
        };
        all += positions.len;
        beside += if (0..positions.len).any(is_seen) { 0 } else { positions.len };
    }
    Ok(if all == 0 { f64::INFINITY } else { beside as f64 / all as f64 })
}

/// Mean deviation of the radii of points from their distances, octaves: on dense or on sparse
/// patches, where it is greater; infinite if there are no points.
///
/// # Errors
/// If the points cannot be read.
fn radius_error(file: &Forest, request: &PictureRequest, patches: &Patches) -> Result<f64> {
    let request = PictureRequest { target_spacing_px: 0.0, ..request.clone() };
    let scene = PictureScene::read(file, &request, &Silent)?;
    let (drawn, hidden) = (&scene.selection.drawn, &scene.selection.hidden);
    let octree = CompactOctree::with_hidden(file.table(), drawn, hidden);
    let draws = scene.draws(file);
    let frame = scene.appearance.frame(file, &scene.view, &draws, &octree);
    let mut sums = [[0.0; 2]; 2];
    for splat in splats(&frame, DVec3::ZERO) {
        let spacing = patches.spacing_at(DVec3::from_array(splat.centre.map(f64::from)));
        let [sum, count] = &mut sums[usize::from(spacing > 1.0)];
        *sum += (f64::from(splat.radius) / spacing).log2().abs();
        *count += 1.0;
    }
    let drawn = sums.iter().filter(|[_, count]| *count > 0.0);
    let worst = drawn.map(|[sum, count]| sum / count).reduce(f64::max);
    Ok(worst.unwrap_or(f64::INFINITY))
}

/// Distance of the middle of the covered pixels from that of the picture; infinite of none.
fn misplaced(picture: &Picture) -> f64 {
    let width = picture.width as usize;
    let covered = picture.depth.iter().enumerate().filter(|(_, depth)| depth.is_finite());
    let place = |at: usize| DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
    let places: Vec<DVec2> = covered.map(|(at, _)| place(at)).collect();
    let middle = DVec2::new(f64::from(picture.width), f64::from(picture.height)) * 0.5;
    match places.len() {
        0 => f64::INFINITY,
        count => middle.distance(places.iter().sum::<DVec2>() / count as f64),
    }
}

/// Number of pixels that are drawn where there is nothing.
fn outside(picture: &Picture, reference: &Reference) -> f64 {
    let pairs = picture.depth.iter().zip(&reference.depth);
    pairs.filter(|(drawn, wanted)| drawn.is_finite() && !wanted.is_finite()).count() as f64
}
