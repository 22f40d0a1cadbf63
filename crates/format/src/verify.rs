//! Verification: every checksum, every invariant, every byte. Everything that can be computed is
//! computed again and compared: pages from their points, boxes, statistics, the multiset hash.
//! Nodes are checked in parallel in the current rayon pool; each thread holds one page.

use crate::codec::{Encoding, is_constant};
use crate::error::{Fault, FormatError};
use crate::layout::PageLayout;
use crate::page::Page;
use crate::planes::Values;
use crate::points::PagePoints;
use crate::reader::EskerFile;
use crate::statistics::{Histograms, NodeStatistics, Ranges, Statistics};
use crate::table::check_pages_fill;
use esker_points::node::Sides;
use esker_points::quant::hot_shift;
use esker_points::{Lattice, MultisetHash, Node, Task};
use rayon::prelude::*;
use std::sync::Mutex;

/// Tolerance of points outside the contour, relative to its size: its numbers are `f32`.
const CONTOUR_SLACK: f64 = 1e-5;
/// Uncertainty of a projected position, relative to the greatest number involved: a few sums of
/// `f64`.
const OCCUPANCY_SLACK: f64 = 1e-12;

/// Result of a verification.
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

/// Sums over all threads.
struct Sums {
    points: u64,
    hash: MultisetHash,
    ranges: Ranges,
    histograms: Histograms,
    bounds: Option<[[u32; 3]; 2]>,
}

/// Checks the whole file.
///
/// # Errors
/// The first fault found, or [`FormatError::Cancelled`].
pub fn verify(file: &EskerFile, task: &dyn Task) -> Result<VerifyReport, FormatError> {
    let footer = file.footer();
    file.check_verbatim()?;
    let damaged = |fault: Fault| fault.damaged(file.path());
    check_pages_fill(file.table(), footer.table.offset).map_err(damaged)?;
    let stored = file.statistics()?;
    let sums = Mutex::new(Sums {
        points: 0,
        hash: MultisetHash::default(),
        ranges: Ranges::new(file.layout().schema()),
        histograms: Histograms::new(stored.histograms().ranges().clone()),
        bounds: None,
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
    if sums.bounds != file.metadata().bounds {
        return Err(damaged(Fault::new("metadata", "its bounds are not those of the points")));
    }
    if sums.ranges != *stored.histograms().ranges() {
        return Err(damaged(Fault::new(
            "statistics",
            "a histogram's range is not that of the points",
        )));
    }
    let mut again =
        Statistics::assemble(file.table(), file.layout().schema(), own, sums.histograms);
    // The sides have been compared with the points; older files have none.
    again.sides.clone_from(&stored.sides);
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
    let [low, high] = check_box(node, &points).map_err(fault)?;
    let sides = file.table().sides.get(index as usize).copied();
    check_contour(node, sides, &file.metadata().lattice, &points).map_err(fault)?;
    check_absent(layout, &points).map_err(fault)?;
    check_planes(node, &page, &points).map_err(fault)?;
    let statistics = NodeStatistics::of(layout, &points);
    let hash = points.hash(layout);
    let mut ranges = Ranges::new(layout.schema());
    ranges.add(layout, &points);
    let counts: Vec<_> = (0..layout.schema().attributes.len())
        .map(|a| stored.counts_of(a, layout, &points))
        .collect();
    let mut sums = lock(sums);
    sums.points += points.len() as u64;
    sums.hash += hash;
    for (a, counts) in counts.iter().enumerate() {
        sums.histograms.add_counts(a, counts);
    }
    let [least, greatest] = sums.bounds.unwrap_or([low, high]);
    let join = |f: fn(u32, u32) -> u32, a: [u32; 3], b: [u32; 3]| [0, 1, 2].map(|i| f(a[i], b[i]));
    sums.bounds = Some([join(u32::min, least, low), join(u32::max, greatest, high)]);
    sums.ranges.merge(&ranges);
    drop(sums);
    task.advance(points.len() as u64);
    Ok(statistics)
}

/// Checks that every plane holds the values of the exact points, encoded as the format requires,
/// and that the bytes between planes are zero. How well a plane is compressed is not checked.
fn check_planes(node: &Node, page: &Page<'_>, points: &PagePoints) -> Result<(), Fault> {
    let layout = page.layout;
    let values = Values { layout, box_min: node.box_min, hot_shift: node.hot_shift, points };
    let mut expected = Vec::new();
    let mut end = layout.directory_bytes();
    for (plane, entry) in layout.planes().iter().zip(&page.directory().entries) {
        let range = entry.range();
        let fault = |what| Err(Fault::new("planes", what).of_plane(&plane.kind.name()));
        if page.bytes()[end..range.start].iter().any(|&b| b != 0) {
            return fault("the bytes before it are not zero");
        }
        end = range.end;
        // Planes of unknown kinds cannot be computed.
        if !plane.kind.is_written() {
            continue;
        }
        expected.clear();
        values.push(plane, &mut expected);
        if page.plane(plane.kind)?.as_ref() != Some(&expected) {
            return fault("it is not the one that the exact points give");
        }
        let is_constant = is_constant(&expected, plane.value_bytes as usize);
        if !plane.hot && is_constant != (entry.encoding == Encoding::Constant) {
            return fault("one value for all points is not stored once");
        }
    }
    if page.bytes()[end..].iter().any(|&b| b != 0) {
        return Err(Fault::new("planes", "the bytes behind them are not zero"));
    }
    Ok(())
}

/// Checks that points are in the node's cell, and that its integer box begins at their least
/// coordinates and drops no more bits than needed. Returns their least and greatest coordinates.
fn check_box(node: &Node, points: &PagePoints) -> Result<[[u32; 3]; 2], Fault> {
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
    Ok([min, max])
}

/// Checks that the contour holds all of the node's own points, up to rounding to `f32`, and that
/// the occupancies of its plane and its sides are those of the points. A point so close to the
/// border of two of the 8 x 8 parts that the order of summation decides may be counted in either.
fn check_contour(
    node: &Node,
    sides: Option<Sides>,
    lattice: &Lattice,
    points: &PagePoints,
) -> Result<(), Fault> {
    let fault = |what: &str| Err(Fault::new("position plane", what));
    let contour = node.contour();
    let size = contour.centre.iter().chain(&contour.half).fold(0.0f64, |m, c| m.max(c.abs()));
    let (mut must, mut may) = ([0u64; 3], [0u64; 3]);
    for p in &points.positions {
        let local = [0, 1, 2].map(|i| f64::from(p[i] - node.corner[i]) * lattice.scale[i]);
        let from_centre = [0, 1, 2].map(|i| local[i] - contour.centre[i]);
        let along = contour.axes.map(|axis| (0..3).map(|i| axis[i] * from_centre[i]).sum::<f64>());
        if (0..3).any(|i| along[i].abs() > contour.half[i] + size * CONTOUR_SLACK) {
            return fault("a point lies outside the node's contour");
        }
        let near = local.iter().fold(size, |m, c| m.max(c.abs())) * OCCUPANCY_SLACK;
        let parts = [0, 1, 2].map(|i| parts(along[i], contour.half[i], near));
        for (mask, [column, row]) in [[0, 1], [2, 0], [2, 1]].into_iter().enumerate() {
            let (columns, rows) = (parts[column].clone(), parts[row].clone());
            let is_certain = columns.start() == columns.end() && rows.start() == rows.end();
            let bits = columns.fold(0u64, |bits, column| bits | 1 << column);
            let bits = rows.fold(0u64, |all, row| all | bits << (8 * row));
            may[mask] |= bits;
            must[mask] |= if is_certain { bits } else { 0 };
        }
    }
    let is_off =
        |(mask, stored): (usize, u64)| stored & !may[mask] != 0 || must[mask] & !stored != 0;
    let stored = [node.occupancy].into_iter().chain(sides.into_iter().flatten());
    if stored.enumerate().any(is_off) {
        return fault("the occupancy of the node's contour is not that of its points");
    }
    Ok(())
}

/// Eighths of an edge that a position along it, uncertain by `near`, may be in.
fn parts(along: f64, half: f64, near: f64) -> std::ops::RangeInclusive<u32> {
    let part = |t: f64| (((t / (2.0 * half) + 0.5) * 8.0) as u32).min(7);
    if half > 0.0 { part(along - near)..=part(along + near) } else { 0..=7 }
}

/// Checks that absent values are stored as zeros.
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
