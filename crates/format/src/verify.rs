//! Verification: every checksum, every invariant, every byte. Everything that can be computed is
//! computed again and compared: pages from their points, boxes, statistics, the multiset hash.
//! Nodes are checked in parallel in the current rayon pool; each thread holds one page and a run of
//! its points.

use crate::codec::Encoding;
use crate::columns::check_parts;
use crate::error::{Fault, FormatError};
use crate::layout::{PageLayout, runs};
use crate::page::Page;
use crate::planes::Values;
use crate::points::PagePoints;
use crate::reader::EskerFile;
use crate::statistics::{BINS, Histograms, NodeStatistics, Ranges, Statistics};
use crate::table::check_pages_fill;
use esker_points::node::{Contour, Sides};
use esker_points::quant::hot_shift;
use esker_points::{Lattice, MultisetHash, Node, Task};
use rayon::prelude::*;
use std::ops::Range;
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
    let bytes = file.statistics_bytes()?;
    let nodes = file.table().nodes.len();
    let stored = Statistics::decode(&bytes, file.layout().schema(), nodes).map_err(damaged)?;
    check_parts(&bytes, file.table(), &stored).map_err(damaged)?;
    drop(bytes);
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
    if !sums.ranges.is_same(stored.histograms().ranges()) {
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
    let node = file.node(index)?;
    let layout = file.layout();
    let page = file.read_page(index)?;
    let fault = |fault: Fault| {
        let section = format!("page of node {index}, {}", fault.section);
        Fault { section, ..fault }.damaged(file.path())
    };
    check_padding(&page).map_err(fault)?;
    let sides = file.table().sides.get(index as usize).copied();
    let mut contour = ContourCheck::new(node, file.metadata().lattice.metric());
    let mut planes = PlaneCheck::new(&page);
    let mut found = NodeSums::new(layout);
    for run in runs(node.points(), layout.schema().record_bytes()) {
        task.check()?;
        let points = page.points_in(run.clone()).map_err(fault)?;
        contour.add(&points).map_err(fault)?;
        check_absent(layout, &points).map_err(fault)?;
        planes.add(node, run, &points).map_err(fault)?;
        found.add(layout, stored, &points);
        task.advance(points.len() as u64);
    }
    let [low, high] = contour.finish(sides).map_err(fault)?;
    planes.finish().map_err(fault)?;
    let mut sums = lock(sums);
    sums.points += node.points() as u64;
    sums.hash += found.hash;
    for (a, counts) in found.counts.iter().enumerate() {
        sums.histograms.add_counts(a, counts);
    }
    let [least, greatest] = sums.bounds.unwrap_or([low, high]);
    sums.bounds = Some([join(u32::min, least, low), join(u32::max, greatest, high)]);
    sums.ranges.merge(&found.ranges);
    Ok(found.statistics)
}

fn join(f: fn(u32, u32) -> u32, a: [u32; 3], b: [u32; 3]) -> [u32; 3] {
    [0, 1, 2].map(|i| f(a[i], b[i]))
}

/// What is computed from the points of a node, run by run.
struct NodeSums {
    statistics: NodeStatistics,
    hash: MultisetHash,
    ranges: Ranges,
    counts: Vec<[u64; BINS]>,
}

impl NodeSums {
    fn new(layout: &PageLayout) -> Self {
        let mut none = PagePoints::default();
        none.columns.resize(layout.schema().attributes.len(), Vec::new());
        Self {
            statistics: NodeStatistics::of(layout, &none),
            hash: MultisetHash::default(),
            ranges: Ranges::new(layout.schema()),
            counts: vec![[0; BINS]; layout.schema().attributes.len()],
        }
    }

    /// Adds points; the histograms have the ranges `stored`.
    fn add(&mut self, layout: &PageLayout, stored: &Ranges, points: &PagePoints) {
        self.statistics.merge(&NodeStatistics::of(layout, points));
        self.hash += points.hash(layout);
        self.ranges.add(layout, points);
        for (a, counts) in self.counts.iter_mut().enumerate() {
            let of_run = stored.counts_of(a, layout, points);
            counts.iter_mut().zip(of_run).for_each(|(sum, n)| *sum += n);
        }
    }
}

/// Checks that the bytes between planes are zero.
fn check_padding(page: &Page<'_>) -> Result<(), Fault> {
    let mut end = page.layout.directory_bytes();
    for (plane, entry) in page.layout.planes().iter().zip(&page.directory().entries) {
        let range = entry.range();
        if page.bytes()[end..range.start].iter().any(|&b| b != 0) {
            let what = "the bytes before it are not zero";
            return Err(Fault::new("planes", what).of_plane(&plane.kind.name()));
        }
        end = range.end;
    }
    if page.bytes()[end..].iter().any(|&b| b != 0) {
        return Err(Fault::new("planes", "the bytes behind them are not zero"));
    }
    Ok(())
}

/// Checks that every plane holds the values of the exact points, encoded as the format requires.
/// How well a plane is compressed is not checked.
struct PlaneCheck<'a> {
    page: &'a Page<'a>,
    /// The first value of each plane; `None` once another value was found.
    alike: Vec<Option<Vec<u8>>>,
    expected: Vec<u8>,
}

impl<'a> PlaneCheck<'a> {
    fn new(page: &'a Page<'a>) -> Self {
        let alike = vec![Some(Vec::new()); page.layout.planes().len()];
        Self { page, alike, expected: Vec::new() }
    }

    /// Checks the points of a run.
    fn add(&mut self, node: &Node, run: Range<usize>, points: &PagePoints) -> Result<(), Fault> {
        let layout = self.page.layout;
        let values = Values { layout, box_min: node.box_min, hot_shift: node.hot_shift, points };
        for (plane, alike) in layout.planes().iter().zip(&mut self.alike) {
            // Planes of unknown kinds cannot be computed.
            if !plane.kind.is_written() {
                continue;
            }
            self.expected.clear();
            values.push(plane, &mut self.expected);
            if self.page.plane_in(plane.kind, run.clone())?.as_ref() != Some(&self.expected) {
                let what = "it is not the one that the exact points give";
                return Err(Fault::new("planes", what).of_plane(&plane.kind.name()));
            }
            let size = (plane.value_bytes as usize).min(self.expected.len());
            let (first, rest) = self.expected.split_at(size);
            let is_one = *rest == self.expected[..self.expected.len() - size];
            let before = alike.take();
            *alike = before.filter(|of| is_one && (of.is_empty() || of == first));
            if alike.as_ref().is_some_and(Vec::is_empty) {
                *alike = Some(first.to_vec());
            }
        }
        Ok(())
    }

    /// Checks that cold planes of one value are stored as such.
    fn finish(self) -> Result<(), Fault> {
        let planes = self.page.layout.planes().iter().zip(&self.page.directory().entries);
        for ((plane, entry), alike) in planes.zip(self.alike) {
            let is_constant = alike.is_some() && self.page.points > 1;
            let is_checked = plane.kind.is_written() && !plane.hot;
            if is_checked && is_constant != (entry.encoding == Encoding::Constant) {
                let what = "one value for all points is not stored once";
                return Err(Fault::new("planes", what).of_plane(&plane.kind.name()));
            }
        }
        Ok(())
    }
}

/// Checks that points are in the node's cell, that its integer box begins at their least
/// coordinates and drops no more bits than needed, that the contour holds all of the node's own
/// points, up to rounding to `f32`, and that the occupancies of its plane and its sides are those
/// of the points. A point so close to the border of two of the 8 x 8 parts that the order of
/// summation decides may be counted in either.
struct ContourCheck<'a> {
    node: &'a Node,
    /// The metric lattice.
    lattice: Lattice,
    contour: Contour,
    size: f64,
    min: [u32; 3],
    max: [u32; 3],
    /// Parts that certainly have points, and those that may.
    must: [u64; 3],
    may: [u64; 3],
}

impl<'a> ContourCheck<'a> {
    fn new(node: &'a Node, lattice: Lattice) -> Self {
        let contour = node.contour();
        let size = contour.centre.iter().chain(&contour.half).fold(0.0f64, |m, c| m.max(c.abs()));
        let (min, max) = ([u32::MAX; 3], [0; 3]);
        Self { node, lattice, contour, size, min, max, must: [0; 3], may: [0; 3] }
    }

    fn add(&mut self, points: &PagePoints) -> Result<(), Fault> {
        let fault = |what: &str| Err(Fault::new("position plane", what));
        for p in &points.positions {
            self.min = join(u32::min, self.min, *p);
            self.max = join(u32::max, self.max, *p);
        }
        if !self.node.cell().contains(self.min) || !self.node.cell().contains(self.max) {
            return fault("a point lies outside the node's cell");
        }
        let (contour, corner, scale) = (&self.contour, self.node.corner, self.lattice.scale);
        for p in &points.positions {
            let local = [0, 1, 2].map(|i| f64::from(p[i] - corner[i]) * scale[i]);
            let from_centre = [0, 1, 2].map(|i| local[i] - contour.centre[i]);
            let along =
                contour.axes.map(|axis| (0..3).map(|i| axis[i] * from_centre[i]).sum::<f64>());
            if (0..3).any(|i| along[i].abs() > contour.half[i] + self.size * CONTOUR_SLACK) {
                return fault("a point lies outside the node's contour");
            }
            let near = local.iter().fold(self.size, |m, c| m.max(c.abs())) * OCCUPANCY_SLACK;
            let parts = [0, 1, 2].map(|i| parts(along[i], contour.half[i], near));
            for (mask, [column, row]) in [[0, 1], [2, 0], [2, 1]].into_iter().enumerate() {
                let (columns, rows) = (parts[column].clone(), parts[row].clone());
                let is_certain = columns.start() == columns.end() && rows.start() == rows.end();
                let bits = columns.fold(0u64, |bits, column| bits | 1 << column);
                let bits = rows.fold(0u64, |all, row| all | bits << (8 * row));
                self.may[mask] |= bits;
                self.must[mask] |= if is_certain { bits } else { 0 };
            }
        }
        Ok(())
    }

    /// Compares box and occupancies; returns the least and greatest coordinates.
    fn finish(self, sides: Option<Sides>) -> Result<[[u32; 3]; 2], Fault> {
        let fault = |what: &str| Err(Fault::new("position plane", what));
        let extent = (0..3).map(|i| self.max[i].saturating_sub(self.min[i])).max().unwrap_or(0);
        if self.min != self.node.box_min || hot_shift(extent) != self.node.hot_shift {
            return fault("the node's integer box is not that of its points");
        }
        let is_off = |(mask, stored): (usize, u64)| {
            stored & !self.may[mask] != 0 || self.must[mask] & !stored != 0
        };
        let stored = [self.node.occupancy].into_iter().chain(sides.into_iter().flatten());
        if stored.enumerate().any(is_off) {
            return fault("the occupancy of the node's contour is not that of its points");
        }
        Ok([self.min, self.max])
    }
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
