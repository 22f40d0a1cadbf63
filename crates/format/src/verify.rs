//! Verify: every checksum, every invariant, every byte. What can be computed again is computed again and
//! compared: pages from their points, boxes, statistics, the multiset hash. Nodes are checked in parallel
//! in the current rayon pool; each thread holds one page.

use crate::error::{Fault, FormatError};
use crate::layout::PageLayout;
use crate::page::{PagePoints, encode_page};
use crate::reader::EskerFile;
use crate::statistics::{Histograms, NodeStatistics, Ranges, Statistics};
use crate::table::check_pages_fill;
use esker_points::quant::hot_shift;
use esker_points::{Lattice, MultisetHash, Node, Task};
use rayon::prelude::*;
use std::sync::Mutex;

/// What was verified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VerifyReport {
    /// Points decoded.
    pub points: u64,
    /// Nodes.
    pub nodes: u64,
    /// Multiset hash of the decoded points, equal to the footer's.
    pub hash: MultisetHash,
    /// Bytes of the file.
    pub bytes: u64,
}

/// What all threads add to.
struct Sums {
    points: u64,
    hash: MultisetHash,
    ranges: Ranges,
    histograms: Histograms,
}

/// Checks the whole file.
///
/// # Errors
/// The first fault found, or [`FormatError::Cancelled`].
pub fn verify(file: &EskerFile, task: &dyn Task) -> Result<VerifyReport, FormatError> {
    let footer = file.footer();
    file.check_section(footer.verbatim, "verbatim section")?;
    let damaged = |fault: Fault| fault.damaged(file.path());
    check_pages_fill(file.table(), footer.table.offset).map_err(damaged)?;
    let stored = file.statistics()?;
    let sums = Mutex::new(Sums {
        points: 0,
        hash: MultisetHash::default(),
        ranges: Ranges::new(file.layout().schema()),
        histograms: Histograms::new(stored.histograms().ranges().clone()),
    });
    task.phase("verify", Some(footer.points), "points");
    let own: Vec<NodeStatistics> = (0..file.table().nodes.len() as u32)
        .into_par_iter()
        .map(|node| verify_node(file, node, task, stored.histograms().ranges(), &sums))
        .collect::<Result<_, FormatError>>()?;
    let sums = sums.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    if sums.points != footer.points {
        return Err(damaged(Fault::new("footer", "its count of points is not that of the pages")));
    }
    if sums.hash != footer.hash {
        let what =
            format!("its multiset hash is {}, that of the points {}", footer.hash, sums.hash);
        return Err(damaged(Fault::new("footer", what)));
    }
    if sums.ranges != *stored.histograms().ranges() {
        return Err(damaged(Fault::new(
            "statistics",
            "a histogram's range is not that of the points",
        )));
    }
    let again = Statistics::assemble(file.table(), file.layout().schema(), own, sums.histograms);
    if again != stored {
        return Err(damaged(Fault::new("statistics", "they are not those of the points")));
    }
    Ok(VerifyReport {
        points: sums.points,
        nodes: footer.nodes,
        hash: sums.hash,
        bytes: footer.file_bytes,
    })
}

fn lock(sums: &Mutex<Sums>) -> std::sync::MutexGuard<'_, Sums> {
    sums.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn verify_node(
    file: &EskerFile,
    index: u32,
    task: &dyn Task,
    stored: &Ranges,
    sums: &Mutex<Sums>,
) -> Result<NodeStatistics, FormatError> {
    task.check()?;
    let node = file.node(index)?;
    let layout = file.layout();
    let page = file.read_page(index)?;
    let fault = |fault: Fault| {
        let section = format!("page of node {index}, {}", fault.section);
        Fault { section, ..fault }.damaged(file.path())
    };
    let points = page.points().map_err(fault)?;
    check_box(node, &points).map_err(fault)?;
    check_contour(node, &file.metadata().lattice, &points).map_err(fault)?;
    check_absent(layout, &points).map_err(fault)?;
    // Planes of unknown kinds cannot be made again; where there are none, every byte can.
    let known = layout.planes().iter().all(|p| p.kind.is_written());
    if known && encode_page(layout, node.box_min, node.hot_shift, &points) != page.bytes() {
        return Err(fault(Fault::new("planes", "they are not those that the exact points give")));
    }
    let statistics = NodeStatistics::of(layout, &points);
    let hash = points.hash(layout);
    let mut ranges = Ranges::new(layout.schema());
    ranges.add(layout, &points);
    for a in 0..layout.schema().attributes.len() {
        let counts = stored.counts_of(a, layout, &points);
        lock(sums).histograms.add_counts(a, &counts);
    }
    let mut sums = lock(sums);
    sums.points += points.len() as u64;
    sums.hash += hash;
    sums.ranges.merge(&ranges);
    drop(sums);
    task.advance(points.len() as u64);
    Ok(statistics)
}

/// Points lie in the node's cell; its integer box begins at their least coordinates and drops no more bits
/// than they need.
fn check_box(node: &Node, points: &PagePoints) -> Result<(), Fault> {
    let fault = |what: &str| Err(Fault::new("position plane", what));
    let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
    for p in &points.positions {
        for axis in 0..3 {
            min[axis] = min[axis].min(p[axis]);
            max[axis] = max[axis].max(p[axis]);
        }
    }
    if !node.cell().contains(min) || !node.cell().contains(max) {
        return fault("a point lies outside the node's cell");
    }
    let extent = (0..3).map(|i| max[i] - min[i]).max().unwrap_or(0);
    if min != node.box_min || hot_shift(extent) != node.hot_shift {
        return fault("the node's integer box is not that of its points");
    }
    Ok(())
}

/// The contour holds all of the node's own points, but for the rounding of its numbers to `f32`.
fn check_contour(node: &Node, lattice: &Lattice, points: &PagePoints) -> Result<(), Fault> {
    let contour = node.contour();
    let size = contour.centre.iter().chain(&contour.half).fold(0.0f64, |m, c| m.max(c.abs()));
    let slack = size * 1e-5;
    for p in &points.positions {
        let from_centre = [0, 1, 2]
            .map(|i| f64::from(p[i] - node.corner[i]) * lattice.scale[i] - contour.centre[i]);
        for (axis, half) in contour.axes.iter().zip(contour.half) {
            let along: f64 = (0..3).map(|i| axis[i] * from_centre[i]).sum();
            if along.abs() > half + slack {
                return Err(Fault::new(
                    "position plane",
                    "a point lies outside the node's contour",
                ));
            }
        }
    }
    Ok(())
}

/// What a point does not have is stored as zeros.
fn check_absent(layout: &PageLayout, points: &PagePoints) -> Result<(), Fault> {
    for (a, attribute) in layout.schema().attributes.iter().enumerate() {
        if (0..layout.classes().len()).all(|class| layout.has_attribute(class, a)) {
            continue;
        }
        for (i, value) in points.columns[a].chunks_exact(attribute.ty.size()).enumerate() {
            if !layout.has_attribute(points.class(i), a) && value.iter().any(|&b| b != 0) {
                let what = format!("a point without {} has a value of it", attribute.name);
                return Err(Fault::new("attribute planes", what));
            }
        }
    }
    Ok(())
}
