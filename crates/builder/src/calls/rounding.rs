//! Compares what rounding coordinates to the lattice changes with the distances of points: more
//! than a part of it is noted, more than the distance would merge points and is an error.

use crate::error::BuildError;
use crate::options::Options;
use esker_format::{Metadata, SourceRecord};
use esker_points::{Lattice, NodeTable};

/// Rounding above this part of the typical distance of points is worth a note.
const ROUNDING_NOTED: f64 = 0.1;

/// Compares the rounding of coordinates with the typical distance of points; returns a note if it
/// is not small.
///
/// # Errors
/// If it exceeds the distance of the points of an input, unless the options allow that.
pub fn check_rounding(
    table: &NodeTable,
    metadata: &Metadata,
    options: &Options,
) -> Result<Option<String>, BuildError> {
    let lattice = &metadata.lattice;
    let share = |s: &SourceRecord| rounding_of(s, lattice) / spacing_of(s, lattice);
    let Some(worst) = metadata.sources.iter().max_by(|a, b| share(a).total_cmp(&share(b))) else {
        return Ok(None);
    };
    let (rounding, own) = (rounding_of(worst, lattice), spacing_of(worst, lattice));
    // In a tree of rounded points no distance is shorter than a step.
    let built = median_spacing(table);
    let spacing = if built > 0.0 { own.min(built) } else { own };
    if rounding <= spacing * ROUNDING_NOTED {
        return Ok(None);
    }
    let path = &worst.path;
    let what = format!(
        "{path}: coordinates are rounded by up to {rounding:.3e}, points are about {spacing:.3e} apart"
    );
    if rounding > own && !options.allow_rounding {
        return Err(BuildError::Options(format!(
            "{what}: build inputs that are far from each other into files of their own, or accept the rounding with --allow-rounding"
        )));
    }
    Ok(Some(what))
}

/// Length by which coordinates of a source are rounded at most. The record has the greatest error
/// of all axes, whose units may differ; on each axis it is at most half a step.
fn rounding_of(source: &SourceRecord, lattice: &Lattice) -> f64 {
    if !lattice.is_scaled() {
        return source.rounding_error_max;
    }
    let errors = lattice.scale.map(|step| source.rounding_error_max.min(step * 0.5));
    lattice.measure(errors).into_iter().fold(0.0, f64::max)
}

/// Distance of the points of a source if they were spread evenly over the largest face of its
/// bounds, or along its longest edge; infinite if it has no extent.
fn spacing_of(source: &SourceRecord, lattice: &Lattice) -> f64 {
    let Some([low, high]) = source.grid.bounds else { return f64::INFINITY };
    let mut edges = lattice.measure([0, 1, 2].map(|i| high[i] - low[i]));
    edges.sort_by(f64::total_cmp);
    let points = source.points.max(1) as f64;
    let spacing = (edges[2] / points).max((edges[2] * edges[1] / points).sqrt());
    if spacing > 0.0 { spacing } else { f64::INFINITY }
}

/// Median distance of points: half of the points lie in leaves where it is smaller.
fn median_spacing(table: &NodeTable) -> f64 {
    let leaves = table.nodes.iter().filter(|node| node.child_count == 0);
    let mut spacings: Vec<_> = leaves.map(|node| (node.spacing, node.points() as u64)).collect();
    spacings.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = spacings.iter().map(|(_, points)| points).sum::<u64>() / 2;
    let mut below = 0;
    let median = spacings.iter().find(|(_, points)| {
        below += points;
        below > half
    });
    median.map_or(0.0, |(spacing, _)| f64::from(*spacing))
}
