//! Errors and notes on pictures that show nothing: a filter without points is an error, as for an
//! export; a view without points is a note.

use crate::io::quantity::grouped;
use anyhow::{Result, ensure};
use esker_format::{Forest, ForestFilter, PlaneKind};
use esker_lod::Counters;
use esker_points::attribute::names;
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES};
use esker_points::{AttrType, Filter};

/// Refuses a filter by class or flags of a file without them.
///
/// # Errors
/// If `filter` wants classes, or flags, and no point has one.
pub fn check_classes(file: &Forest, filter: &Filter) -> Result<()> {
    let has = |name: &str| file.schema().find_typed(name, AttrType::U8).is_some();
    let (has_classes, has_flags) = (has(names::CLASSIFICATION), has(names::FLAGS));
    ensure!(
        has_classes || has_flags || filter.flags.is_empty(),
        "{}: has no flags, so that --flags would leave nothing; draw or export it without",
        file.path().display()
    );
    ensure!(
        has_classes || filter.classes.is_none_or(|classes| classes.has_overlap() && has_flags),
        "{}: has no classification, so that --classes would leave nothing; draw or export it without",
        file.path().display()
    );
    Ok(())
}

/// Refuses a filter that rejects all points of a file. Reads positions until an accepted point is
/// found, so it is called only if nothing was drawn.
///
/// # Errors
/// If no point is accepted, or positions cannot be read.
pub fn check_wanted(file: &Forest, shown: &ForestFilter) -> Result<()> {
    let points = file.points();
    if points == 0 || !shown.is_filtered() {
        return Ok(());
    }
    if file.is_partial() {
        let whole = file.whole()?;
        return check_wanted(&whole, &shown.of_other(&whole)?);
    }
    for node in 0..file.table().nodes.len() as u32 {
        if has_wanted(file, shown, node)? {
            return Ok(());
        }
    }
    let path = file.path().display();
    anyhow::bail!(
        "{path}: none of its {} points is wanted; look at --box, --polygon, --classes, --flags, --without-flags and --where",
        grouped(points)
    )
}

/// Whether the filter accepts any point of a node, not counting its subtree.
fn has_wanted(file: &Forest, shown: &ForestFilter, node: u32) -> Result<bool> {
    let prefix = shown.points_max(node).min(file.record(node).points());
    if prefix == 0 || !shown.hides_points(node) {
        return Ok(prefix > 0);
    }
    let planes = shown.read(file, node, &[PlaneKind::Position])?;
    let points = planes.get(PlaneKind::Position).unwrap_or_default();
    let mut points = points.as_chunks::<HOT_POSITION_BYTES>().0.iter().take(prefix);
    Ok(points.any(|point| point[HIDDEN_AT] == 0))
}

/// Why a picture shows nothing; `counters` are those of its choice.
pub fn why_nothing(file: &Forest, budget_points: u64, counters: &Counters) -> &'static str {
    match (file.points(), budget_points, counters.points) {
        (0, ..) => "nothing is seen: there are no points",
        (_, 0, _) => "nothing is seen: --budget-points 0 draws none",
        (.., 0) if counters.withheld > 0 => {
            "nothing is seen: --budget-points is too few for the first points of any node; give some hundreds more"
        }
        (.., 0) => {
            "nothing is seen: no point lies in the view: the camera looks past them, or is so close to a surface that they are beside the picture; --fit shows all that there is"
        }
        _ => {
            "nothing is seen: no point falls on a pixel, or all face away; --fit shows all that there is"
        }
    }
}
