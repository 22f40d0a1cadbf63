//! Intake: opens the inputs, chooses lattice, schema and classes from what they say of themselves,
//! and decodes each once into a partition. Where a header lied (a point off the lattice, colours of
//! another depth), it begins again with what is true.

use crate::budget::memory::Peak;
use crate::error::BuildError;
use crate::input::taking::{Parting, Taking};
use crate::rows::journal::Journal;
use crate::rows::journal_record::{Kind, Reading, Record};
use crate::rows::partition::{BUCKETS_MAX, Partition};
use crate::rows::row::RowLayout;
use crate::rows::scratch::Scratch;
use esker_format::Ranges;
use esker_points::lattice::GridKind;
use esker_points::{
    Batch, ColourDepth, InputGrid, Lattice, MultisetHash, PointClass, Schema, Task,
};
use esker_scan::{OpenOptions, ReadReport, ScanError, Source};
use rayon::ScopeFifo;
use rayon::prelude::*;
use std::path::PathBuf;

/// Rows that a bucket should have: few enough for a core's cache, enough that a bucket costs
/// nothing.
const BUCKET_ROWS: u64 = 1 << 13;

/// The longest step, in the file's unit: 2^32 of them squared, and what is drawn about them, are
/// numbers for `f32`.
const SCALE_MAX: f64 = 1e26;

/// The opened inputs, in byte order of their paths.
pub struct Intake {
    /// The inputs.
    pub sources: Vec<Box<dyn Source>>,
    /// What is known of their coordinates; bounds are corrected when they turn out wrong.
    grids: Vec<InputGrid>,
    /// What is known of their colours.
    depths: Vec<ColourDepth>,
    forced_depth: bool,
    /// The lattice, where it is given.
    pub lattice: Option<Lattice>,
    /// Whether rows have room for normals.
    pub estimates_normals: bool,
    /// Whether rows have room for clip lines.
    pub finds_edges: bool,
    /// Whether rows have room for shapes.
    pub finds_shapes: bool,
}

/// What was chosen for all inputs.
pub struct Plan {
    /// The lattice.
    pub lattice: Lattice,
    /// All attributes.
    pub schema: Schema,
    /// The classes of points.
    pub classes: Vec<PointClass>,
    /// The class of each source.
    pub class_of: Vec<u16>,
    /// Whether rows have room for normals.
    pub estimates_normals: bool,
    /// Whether rows have room for clip lines.
    pub finds_edges: bool,
    /// Whether rows have room for shapes.
    pub finds_shapes: bool,
    /// For each source, the file's attribute for each of its own.
    to_file: Vec<Vec<usize>>,
}

/// What the inputs held.
pub struct Taken {
    /// Rows by cell.
    pub partition: Partition,
    /// What became of each source's points.
    pub reports: Vec<ReadReport>,
    /// Hash of all points, as they were decoded.
    pub hash: MultisetHash,
    /// Range of each attribute.
    pub ranges: Ranges,
    /// Whether it is known of all points where they were scanned from.
    pub knows_scanners: bool,
}

/// Why a reading is void.
enum Void {
    /// The lattice does not hold this source's points.
    Bounds(usize),
    /// These sources' colours are of another depth than was thought.
    Colours,
}

fn path_bytes(source: &dyn Source) -> &[u8] {
    source.info().path.as_os_str().as_encoded_bytes()
}

/// Opens all inputs, each format told by content.
///
/// # Errors
/// Where one cannot be opened.
pub fn open(
    inputs: &[PathBuf],
    colour_depth: Option<ColourDepth>,
    task: &dyn Task,
) -> Result<Vec<Box<dyn Source>>, BuildError> {
    open_with(inputs, &OpenOptions { colour_depth, ..OpenOptions::default() }, task)
}

/// As [`open`], with all that may be said.
///
/// # Errors
/// As [`open`].
pub fn open_with(
    inputs: &[PathBuf],
    options: &OpenOptions,
    task: &dyn Task,
) -> Result<Vec<Box<dyn Source>>, BuildError> {
    let open = |path: &PathBuf| {
        task.check()?;
        Ok(esker_scan::open(path, options, task)?)
    };
    // On all cores, since there may be thousands. Of several errors the first input's is told.
    let opened: Vec<_> = inputs.par_iter().map(open).collect();
    opened.into_iter().collect()
}

impl Plan {
    /// The layout of rows.
    pub fn rows(&self) -> RowLayout {
        let rows = RowLayout::new(&self.schema, &self.classes);
        let rows = if self.estimates_normals { rows.with_normals() } else { rows };
        let rows = if self.finds_edges { rows.with_clip_lines() } else { rows };
        if self.finds_shapes { rows.with_tangents() } else { rows }
    }

    /// Bytes of a row.
    pub fn row_bytes(&self) -> usize {
        self.rows().bytes()
    }

    /// For each attribute of a source, the file's.
    pub fn to_file(&self, source: usize) -> &[usize] {
        &self.to_file[source]
    }
}

impl Intake {
    /// Takes opened inputs; `forced_depth` where the user said what their colours hold.
    pub fn new(mut sources: Vec<Box<dyn Source>>, forced_depth: bool) -> Self {
        sources.sort_by(|a, b| path_bytes(a.as_ref()).cmp(path_bytes(b.as_ref())));
        let grids = sources.iter().map(|s| s.info().grid.clone()).collect();
        let depth = |s: &dyn Source| s.info().colour_depth.unwrap_or(ColourDepth::Sixteen);
        let depths = sources.iter().map(|s| depth(s.as_ref())).collect();
        Self {
            sources,
            grids,
            depths,
            forced_depth,
            lattice: None,
            estimates_normals: false,
            finds_edges: false,
            finds_shapes: false,
        }
    }

    /// Chooses lattice, where none is given, schema and classes.
    ///
    /// # Errors
    /// Where an input's scale or offset is no number.
    pub fn plan(&self) -> Result<Plan, BuildError> {
        let chosen = Lattice::choose(&self.grids)?;
        self.plan_on(self.lattice.unwrap_or(chosen))
    }

    /// Chooses schema and classes on a given lattice.
    ///
    /// # Errors
    /// Where the inputs differ in more ways than a file can tell apart.
    pub fn plan_on(&self, lattice: Lattice) -> Result<Plan, BuildError> {
        self.check_scale(&lattice)?;
        let schema =
            self.sources.iter().fold(Schema::default(), |all, s| all.union(&s.info().schema));
        let (mut classes, mut class_of, mut to_file) = (Vec::new(), Vec::new(), Vec::new());
        for (source, &colour_depth) in self.sources.iter().zip(&self.depths) {
            let attributes = &source.info().schema.attributes;
            let own: Vec<usize> =
                attributes.iter().filter_map(|a| schema.find_typed(&a.name, a.ty)).collect();
            let mut present: Vec<u16> = own.iter().map(|&i| i as u16).collect();
            present.sort_unstable();
            let class = PointClass { present, colour_depth };
            let index = classes.iter().position(|c| *c == class).unwrap_or(classes.len());
            if index == classes.len() {
                classes.push(class);
            }
            class_of.push(u16::try_from(index).map_err(|_| {
                BuildError::Options(
                    "the inputs have over 65,536 different sets of attributes".into(),
                )
            })?);
            to_file.push(own);
        }
        if classes.is_empty() {
            classes.push(PointClass { present: Vec::new(), colour_depth: ColourDepth::Sixteen });
        }
        let Self { estimates_normals, finds_edges, finds_shapes, .. } = *self;
        Ok(Plan {
            lattice,
            schema,
            classes,
            class_of,
            estimates_normals,
            finds_edges,
            finds_shapes,
            to_file,
        })
    }

    fn check_scale(&self, lattice: &Lattice) -> Result<(), BuildError> {
        let Some(axis) = (0..3).find(|&i| lattice.scale[i] > SCALE_MAX) else { return Ok(()) };
        let scale = |i: &usize| self.grids[*i].grid.scale[axis];
        let coarsest = (0..self.grids.len()).max_by(|a, b| scale(a).total_cmp(&scale(b)));
        let path = coarsest.map(|i| self.sources[i].info().path.display().to_string());
        Err(BuildError::Options(format!(
            "{}: coordinates in steps of {:e} along {}, which no scan has; the file is damaged",
            path.unwrap_or_default(),
            lattice.scale[axis],
            ['x', 'y', 'z'][axis],
        )))
    }

    /// What was detected or said of a source's 16-bit colours, where it has such.
    pub fn colour_depth(&self, source: usize) -> Option<ColourDepth> {
        self.sources[source].info().colour_depth.map(|_| self.depths[source])
    }

    /// The grid of a source, with corrected bounds.
    pub fn grid(&self, source: usize) -> &InputGrid {
        &self.grids[source]
    }

    /// Points that the headers claim.
    pub fn points_hint(&self) -> u64 {
        self.sources.iter().fold(0, |n, s| n.saturating_add(s.info().points_hint))
    }

    /// Points that the headers claim, where the inputs are long enough for a bit each.
    pub fn points_likely(&self) -> u64 {
        let likely = |s: &dyn Source| match s.info().bytes {
            // Made from nothing: generated.
            0 => s.info().points_hint,
            bytes => s.info().points_hint.min(bytes.saturating_mul(8)),
        };
        self.sources.iter().fold(0, |n, s| n.saturating_add(likely(s.as_ref())))
    }

    /// Decodes everything into a partition that keeps `buffer_bytes_max` in memory.
    ///
    /// # Errors
    /// Where an input is damaged or scratch fails; on request.
    pub fn take(
        &mut self,
        (scratch, journal): (&mut Scratch, &mut Journal),
        buffer_bytes_max: usize,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<(Plan, Taken), BuildError> {
        let mut earlier = self.resume(journal)?;
        // A header may claim more room than its points have: the lattice must not be coarser for
        // it.
        let scale = self.plan()?.lattice.scale;
        let finest = |axis: usize| {
            self.grids.iter().map(|g| g.grid.scale[axis]).fold(f64::INFINITY, f64::min)
        };
        if self.lattice.is_none() && (0..3).any(|axis| scale[axis] > finest(axis)) {
            task.note(
                "the inputs' bounds need a lattice coarser than their coordinates; measuring them",
            );
            self.measure(0, task)?;
        }
        // Bounds and colours can be wrong once each, bounds again where an input changes meanwhile.
        for _ in 0..4 {
            let mut plan = self.plan()?;
            let earlier = std::mem::take(&mut earlier);
            let parting = Parting::new(self, &plan);
            let mut taking = Taking::new(&parting, (scratch, journal), buffer_bytes_max);
            taking.resume(earlier)?;
            let void = match self.read(taking, task, peak)? {
                Ok(taken) => match self.correct_colours(&mut plan, &taken.reports) {
                    None => return Ok((plan, taken)),
                    Some(void) => void,
                },
                Err(void) => void,
            };
            match void {
                Void::Bounds(source) => {
                    let path = self.sources[source].info().path.display().to_string();
                    task.note(&format!("{path}: points lie outside its header's bounds; measuring what is left and starting again"));
                    self.measure(source, task)?;
                }
                Void::Colours => task.note(
                    "colours are of another depth than the first points showed; starting again",
                ),
            }
            journal.tell(self.known())?;
            scratch.clear()?;
        }
        Err(BuildError::Options("the inputs change while they are read".into()))
    }

    /// True bounds of this source and of all after it: where one header lies, others may, and each
    /// of them would start the reading again.
    fn measure(&mut self, from: usize, task: &dyn Task) -> Result<(), BuildError> {
        task.phase("measuring", None, "points");
        for (source, grid) in self.sources.iter().zip(&mut self.grids).skip(from) {
            if grid.kind == GridKind::Integer {
                grid.bounds = source.survey(task)?;
            }
        }
        Ok(())
    }

    /// What was found out about the inputs, for the journal.
    pub fn known(&self) -> Record {
        let mut record = Record::new(Kind::Known);
        for (grid, &depth) in self.grids.iter().zip(&self.depths) {
            record.put(u8::from(grid.bounds.is_some()));
            record.put(grid.bounds.unwrap_or_default());
            record.put(u8::from(depth == ColourDepth::Eight));
        }
        record
    }

    /// Takes over what an earlier build has found out; what it has taken in since.
    fn resume(&mut self, journal: &mut Journal) -> Result<Vec<Vec<u8>>, BuildError> {
        let mut taken = Vec::new();
        loop {
            if let Some(known) = journal.ask_if(Kind::Known)? {
                self.restore(&known)
                    .ok_or_else(|| journal.damaged("what it knows of the inputs"))?;
                taken.clear();
            } else if let Some(more) = journal.ask_if(Kind::Taken)? {
                taken.push(more);
            } else {
                return Ok(taken);
            }
        }
    }

    fn restore(&mut self, known: &[u8]) -> Option<()> {
        let mut from = Reading(known);
        for (grid, depth) in self.grids.iter_mut().zip(&mut self.depths) {
            let (has_bounds, bounds) = (from.get::<u8>()? > 0, from.get()?);
            grid.bounds = has_bounds.then_some(bounds);
            let is_eight = from.get::<u8>()? > 0;
            *depth = if is_eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
        }
        Some(())
    }

    fn read(
        &self,
        taking: Taking<'_>,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<Result<Taken, Void>, BuildError> {
        task.phase("reading", Some(self.points_hint()), "points");
        rayon::in_place_scope_fifo(|scope| self.read_into(taking, scope, task, peak))
    }

    fn read_into<'s, 'a: 's>(
        &self,
        mut taking: Taking<'a>,
        scope: &ScopeFifo<'s>,
        task: &dyn Task,
        peak: &Peak,
    ) -> Result<Result<Taken, Void>, BuildError> {
        let (first, mut skipped) = taking.added;
        for i in 0..first {
            task.advance(taking.reports[i].points);
        }
        for (i, source) in self.sources.iter().enumerate().skip(first) {
            let placement = taking.plan().lattice.placement(&source.info().grid);
            let mut sink = |mut batch: Batch| -> Result<(), ScanError> {
                task.advance(batch.len() as u64);
                let known = batch.len().min(usize::try_from(skipped).unwrap_or(usize::MAX));
                skipped -= known as u64;
                batch.drop_first(known);
                if !batch.is_empty() {
                    taking.add(i, batch, scope).map_err(BuildError::through_sink)?;
                }
                peak.sample();
                Ok(task.check()?)
            };
            match source.read(&placement, task, &mut sink) {
                Ok(report) => taking.reports.push(report),
                Err(ScanError::OffLattice { .. }) => return Ok(Err(Void::Bounds(i))),
                Err(e) => {
                    // A later build goes on with what is in scratch. What stopped this one is told
                    // first.
                    let _ = taking.tell();
                    return Err(BuildError::from_sink(e));
                }
            }
            skipped = 0;
        }
        Ok(Ok(taking.finish()?))
    }

    /// The size of the partition's cells: by the bounds, and the smaller the more points there are.
    pub fn partition_log2(&self, plan: &Plan) -> u8 {
        let (mut min, mut max) = ([u32::MAX; 3], [0u32; 3]);
        for bounds in self.grids.iter().filter_map(|g| g.bounds) {
            for (corner, axis) in (0..6).map(|i| (i / 3, i % 3)) {
                // `as` saturates, also for bounds that are no numbers.
                let c = plan.lattice.steps_axis(axis, bounds[corner][axis]) as u32;
                min[axis] = min[axis].min(c);
                max[axis] = max[axis].max(c);
            }
        }
        if (0..3).any(|i| min[i] > max[i]) {
            (min, max) = ([0; 3], [u32::MAX; 3]);
        }
        let buckets = (self.points_hint() / BUCKET_ROWS).clamp(64, BUCKETS_MAX as u64);
        // Scans are surfaces: their cells are counted on the box's largest side. Of volumes there
        // are more, and they coarsen.
        let mut edges = [0, 1, 2].map(|i| u64::from(max[i] - min[i]));
        edges.sort_unstable();
        let cells = |log2: u8| ((edges[2] >> log2) + 1).saturating_mul((edges[1] >> log2) + 1);
        (0..32).rev().find(|&log2| cells(log2) >= buckets).unwrap_or(0)
    }

    /// Compares what the colours were taken for with what they are. Where the sources of a class
    /// agree, the class is put right; else everything must be read again with what is now known.
    fn correct_colours(&mut self, plan: &mut Plan, reports: &[ReadReport]) -> Option<Void> {
        if self.forced_depth {
            return None;
        }
        let mut split = false;
        for (i, report) in reports.iter().enumerate() {
            if self.sources[i].info().colour_depth.is_some() && report.colour_max > 0 {
                let eight = report.colour_max <= 255;
                self.depths[i] = if eight { ColourDepth::Eight } else { ColourDepth::Sixteen };
            }
        }
        for (class, entry) in plan.classes.iter_mut().enumerate() {
            let mut depths = (0..self.depths.len())
                .filter(|&i| usize::from(plan.class_of[i]) == class)
                .map(|i| self.depths[i]);
            let Some(first) = depths.next() else { continue };
            if depths.all(|d| d == first) {
                entry.colour_depth = first;
            } else {
                split = true;
            }
        }
        // Thought different and found alike: points of one class.
        let alike = (1..plan.classes.len()).any(|i| plan.classes[..i].contains(&plan.classes[i]));
        (split || alike).then_some(Void::Colours)
    }
}
