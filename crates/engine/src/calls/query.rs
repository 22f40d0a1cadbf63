//! Reading points as a call: those of a file, and of the files that it names, that a filter
//! accepts, as columns: all at once, or in parts of any number of points in bounded memory.

use crate::machine::pool;
use anyhow::{Result, bail, ensure};
use esker_builder::{Query, QueryPoints, points_at};
use esker_format::Forest;
use esker_points::lattice::ORIGIN;
use esker_points::{Attribute, Filter, Task};
use std::sync::Arc;

/// Grid of the coordinates of points: a coordinate is a whole number times the scale plus the
/// offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointGrid {
    /// Length of a step on each axis.
    pub scale: [f64; 3],
    /// Coordinate of step 0.
    pub offset: [f64; 3],
    /// What is added to lattice coordinates.
    moved: [i64; 3],
}

impl PointGrid {
    /// Grid of a file: that of its scans, if all points have steps of 32 bits on it, as those of
    /// LAS do; otherwise one that is moved by whole steps.
    pub fn of(forest: &Forest) -> Self {
        let lattice = forest.exact_lattice();
        let own = |axis: usize| lattice.shift[axis].checked_sub(ORIGIN);
        let fits = |axis: usize| {
            let Some(moved) = own(axis) else { return false };
            let corners = forest.exact_bounds().unwrap_or_default();
            corners.iter().all(|corner| {
                let step = i64::from(corner[axis]).checked_add(moved);
                step.is_some_and(|step| i32::try_from(step).is_ok())
            })
        };
        let (mut offset, mut moved) = (lattice.offset, [-ORIGIN; 3]);
        for axis in 0..3 {
            match own(axis).filter(|_| fits(axis)) {
                Some(own) => moved[axis] = own,
                None => offset[axis] += lattice.shift[axis] as f64 * lattice.scale[axis],
            }
        }
        Self { scale: lattice.scale, offset, moved }
    }

    /// Step of a lattice coordinate. Those of valid files fit.
    fn step(&self, axis: usize, lattice: u32) -> i32 {
        (i64::from(lattice).wrapping_add(self.moved[axis])) as i32
    }

    /// Coordinates of the corners of a box on the lattice of the file.
    pub fn world(&self, corner: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let step = self.step(axis, corner[axis]);
            f64::from(step) * self.scale[axis] + self.offset[axis]
        })
    }
}

/// Points as columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointColumns {
    /// Steps on the grid ([`PointGrid`]), a column an axis.
    pub steps: [Vec<i32>; 3],
    /// Raw little-endian values of each attribute that was asked for, in their order.
    pub columns: Vec<Vec<u8>>,
}

impl PointColumns {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.steps[0].len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.steps[0].is_empty()
    }

    /// Makes room for `points` more points.
    fn reserve(&mut self, points: usize, sizes: &[usize]) {
        self.steps.iter_mut().for_each(|steps| steps.reserve_exact(points));
        let columns = self.columns.iter_mut().zip(sizes);
        columns.for_each(|(column, size)| column.reserve_exact(points.saturating_mul(*size)));
    }

    /// Appends points of a node.
    fn push(&mut self, grid: &PointGrid, points: &QueryPoints) {
        for (axis, steps) in self.steps.iter_mut().enumerate() {
            steps.extend(points.positions.iter().map(|p| grid.step(axis, p[axis])));
        }
        let columns = self.columns.iter_mut().zip(&points.columns);
        columns.for_each(|(column, values)| column.extend_from_slice(values));
    }

    /// Takes away the points behind the first `points`.
    fn split_off(&mut self, points: usize, sizes: &[usize]) -> Self {
        let steps = self.steps.each_mut().map(|steps| steps.split_off(points));
        let columns = self.columns.iter_mut().zip(sizes);
        let columns = columns.map(|(column, size)| column.split_off(points * size)).collect();
        Self { steps, columns }
    }

    /// Returns memory that is much larger than the points.
    fn shrink(&mut self) {
        let is_wide = |capacity: usize, length: usize| capacity > length + length / 8;
        for steps in &mut self.steps {
            if is_wide(steps.capacity(), steps.len()) {
                steps.shrink_to_fit();
            }
        }
        for column in &mut self.columns {
            if is_wide(column.capacity(), column.len()) {
                column.shrink_to_fit();
            }
        }
    }
}

/// Points that are being read.
pub struct PointQuery {
    query: Query,
    grid: PointGrid,
    attributes: Vec<Attribute>,
    sizes: Vec<usize>,
    /// Points that were read and not returned yet.
    left: PointColumns,
    has_begun: bool,
    /// Whether reading has failed: points would be missing from the rest.
    has_failed: bool,
    threads: usize,
}

impl PointQuery {
    /// Chooses the points of `forest` that `filter` accepts, and the attributes `columns` (indices
    /// of its schema), or all. They are read on `threads` threads (0: one a core).
    ///
    /// # Errors
    /// If the filter is wrong, there is no such attribute, or the file is damaged.
    pub fn new(
        forest: Arc<Forest>,
        filter: &Filter,
        columns: Option<&[usize]>,
        threads: usize,
    ) -> Result<Self> {
        let wanted = chosen(&forest, columns)?;
        // The spacings of nodes that were not read yet are estimates.
        let is_known = filter.max_spacing.is_none() || !forest.is_growing();
        let forest = if is_known { forest } else { Arc::new(Forest::clone(&forest).grown(true)?) };
        let attributes: Vec<_> =
            wanted.iter().map(|&i| forest.schema().attributes[i].clone()).collect();
        let sizes: Vec<usize> = attributes.iter().map(|a| a.ty.size()).collect();
        let grid = PointGrid::of(&forest);
        let query = Query::new(forest, filter, &wanted)?;
        let left = PointColumns { columns: vec![Vec::new(); sizes.len()], ..Default::default() };
        Ok(Self {
            query,
            grid,
            attributes,
            sizes,
            left,
            has_begun: false,
            has_failed: false,
            threads,
        })
    }

    /// The attributes, in the order of the columns.
    pub fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    /// Reads the next `points` points, or all that are left; fewer at the end, `None` behind it.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged, or `task` is cancelled; from then on always.
    pub fn read(&mut self, points: Option<usize>, task: &dyn Task) -> Result<Option<PointColumns>> {
        if !std::mem::replace(&mut self.has_begun, true) {
            task.phase("reading", Some(self.query.points_max()), "points");
        }
        let path = || self.query.forest().path().display();
        ensure!(!self.has_failed, "{}: reading it has failed before: begin again", path());
        let wanted = points.unwrap_or(usize::MAX).max(1);
        let threads = self.threads;
        let found = pool::run(threads, || self.fill(wanted, task));
        self.has_failed = found.is_err();
        let mut found = found?;
        if found.len() > wanted {
            self.left = found.split_off(wanted, &self.sizes);
        }
        found.shrink();
        Ok((!found.is_empty()).then_some(found))
    }

    /// Ends the query: points that it has returned were lost.
    pub fn end(&mut self) {
        self.has_failed = true;
    }

    /// Reads at least `wanted` points, if there are as many. The points of a group are appended
    /// while the next group is decoded.
    fn fill(&mut self, wanted: usize, task: &dyn Task) -> Result<PointColumns> {
        let empty =
            PointColumns { columns: vec![Vec::new(); self.sizes.len()], ..Default::default() };
        let mut found = std::mem::replace(&mut self.left, empty);
        // Only as much as is certain to come.
        if !self.query.is_partial() {
            let left = usize::try_from(self.query.points_max()).unwrap_or(usize::MAX);
            found.reserve(left.min(wanted.saturating_sub(found.len())), &self.sizes);
        }
        let (grid, query) = (self.grid, &mut self.query);
        let mut ready: Vec<QueryPoints> = Vec::new();
        loop {
            let is_full = found.len() + ready.iter().map(|p| p.positions.len()).sum::<usize>();
            let before = std::mem::take(&mut ready);
            if is_full >= wanted {
                before.iter().for_each(|points| found.push(&grid, points));
                return Ok(found);
            }
            let push = || before.iter().for_each(|points| found.push(&grid, points));
            let (read, ()) = rayon::join(|| query.read(task), push);
            match read? {
                Some(points) => ready = points,
                None => return Ok(found),
            }
        }
    }
}

/// Reads single points, each given by its node and its index in it
/// ([`crate::draw::layers::Layers::points`]), in the order given; with the attributes
/// `columns` (indices of the schema), or all, which are returned too.
///
/// # Errors
/// If there is no such point or attribute, a file cannot be read or is damaged, or `task` is
/// cancelled.
pub fn read_points(
    forest: &Forest,
    places: &[[u32; 2]],
    columns: Option<&[usize]>,
    threads: usize,
    task: &dyn Task,
) -> Result<(Vec<Attribute>, PointColumns)> {
    let wanted = chosen(forest, columns)?;
    let found = pool::run(threads, || Ok(points_at(forest, places, &wanted, task)?))?;
    let mut points =
        PointColumns { columns: vec![Vec::new(); wanted.len()], ..PointColumns::default() };
    points.push(&PointGrid::of(forest), &found);
    let attributes = wanted.iter().map(|&i| forest.schema().attributes[i].clone());
    Ok((attributes.collect(), points))
}

/// Indices of the attributes that are wanted, ascending and each once; of all by default.
fn chosen(forest: &Forest, columns: Option<&[usize]>) -> Result<Vec<usize>> {
    let count = forest.schema().attributes.len();
    let Some(columns) = columns else { return Ok((0..count).collect()) };
    if let Some(beyond) = columns.iter().find(|&&column| column >= count) {
        let path = forest.path().display();
        bail!("{path}: has no attribute {beyond}; it has {count} attributes");
    }
    let mut wanted = columns.to_vec();
    wanted.sort_unstable();
    wanted.dedup();
    Ok(wanted)
}
